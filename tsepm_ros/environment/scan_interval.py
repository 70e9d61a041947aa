"""The interval between scans, from their stamps."""

from __future__ import annotations

import statistics
from collections import deque

MAX_INTERVALS = 50
"""Intervals of which the median is taken."""


class ScanInterval:
    """Median of the last intervals: a lost ping or a pause does not change it."""

    def __init__(self) -> None:
        self._intervals: deque[float] = deque(maxlen=MAX_INTERVALS)
        self._median = 0.0

    def update(self, interval: float) -> None:
        """Take the time since the scan before, s; 0 for the first scan."""
        if interval > 0.0:
            self._intervals.append(interval)
            self._median = statistics.median(self._intervals)

    @property
    def median(self) -> float:
        """Median interval, s; 0 while it is unknown."""
        return self._median
