"""Elapsed time on one or several clocks."""

from __future__ import annotations

import math

import numpy as np

Now = float | tuple[float, ...]
"""Time on one clock or on several, s."""


def waited(since: Now, now: Now) -> float:
    """Minimum elapsed time over the clocks, s; a clock that was set back is ignored."""
    elapsed = np.atleast_1d(np.subtract(now, since))
    return float(elapsed[elapsed >= 0].min(initial=math.inf))
