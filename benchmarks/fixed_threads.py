"""One thread for numpy's libraries and a folder for matplotlib's cache; import before numpy."""

from __future__ import annotations

import os
from pathlib import Path

BUILD = Path(__file__).resolve().parents[1] / "build"

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[name] = "1"
os.environ.setdefault("MPLCONFIGDIR", str(BUILD / "matplotlib"))
