"""What a figure depends on: the release, its golden outputs, and the code of this very moment."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Iterable
from pathlib import Path

import tsepm_ros

PACKAGE = Path(tsepm_ros.__file__).parent
GOLDENS = PACKAGE.parent / "test" / "golden"


def goldens_digest() -> str:
    """Digest of the golden outputs, with which figures are measured; empty outside a source tree.

    It changes where results change on purpose, not where code is renamed, moved or made faster.
    """
    return _digest(GOLDENS.glob("*.json")) if GOLDENS.is_dir() else ""


@functools.cache
def code_key(*files: Path) -> str:
    """Digest of the package's modules, and of other files, by which stored runs are found again.

    Any change of the code discards an unfinished study: its runs are of one code.
    """
    return _digest([*PACKAGE.rglob("*.py"), *files])


def _digest(files: Iterable[Path]) -> str:
    content = hashlib.sha256()
    for path in sorted(files):
        content.update(path.name.encode() + path.read_bytes())
    return content.hexdigest()[:8]
