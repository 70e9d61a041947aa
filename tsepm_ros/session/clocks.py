"""Time passed, where there are several clocks."""

from __future__ import annotations

import math

import numpy as np

Now = float | tuple[float, ...]
"""Time on one clock or on several, s."""


def waited(since: Now, now: Now) -> float:
    """Least time that has passed on any clock, s; one that was set back tells nothing."""
    passed = np.atleast_1d(np.subtract(now, since))
    return float(passed[passed >= 0].min(initial=math.inf))
