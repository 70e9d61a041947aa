"""Classification of a scan's stamp: next, late, a restart, or the first after a long gap."""

from __future__ import annotations

import enum
import statistics
from collections import deque

MIN_INTERVALS = 3
"""Minimum number of known intervals that distinguish a gap from a slow sonar."""

MAX_INTERVAL = 3600.0
"""Maximum time between scans while fewer intervals are known, s."""

MAX_LATE_SCANS = 3
"""Consecutive late scans with rising stamps that are a restart."""


class Arrival(enum.Enum):
    """Relation of a scan to the scans before it."""

    NEXT = "next"
    SAME_STAMP = "same_stamp"
    LATE = "late"
    FAR_BACK = "far_back"
    RESTART = "restart"
    GAP = "gap"


class ScanOrder:
    """Classifies the stamps of arriving scans.

    Parameters
    ----------
    window : int
        Scans of the confirmation window.
    restart_jump : float
        Backward step, s, above which a stamp is a restart (a looping bag, a reset clock) if the
        next stamp confirms it; a smaller step is a late scan.
    max_gap : float
        Forward step, s, above which potential tracks are not continued; 0: `window` times the
        median interval of the last scans.
    """

    def __init__(self, window: int, restart_jump: float, max_gap: float) -> None:
        self.restart_jump = restart_jump
        self.max_gap = max_gap
        self._intervals: deque[float] = deque(maxlen=window)
        self._stamp: float | None = None
        self._late_stamps: list[float] = []

    def classify(self, stamp: float) -> Arrival:
        """Classify the next stamp (s) relative to the scans accepted so far."""
        arrival = self._compare(stamp)
        if arrival is Arrival.LATE or (arrival is Arrival.SAME_STAMP and self._late_stamps):
            return self._late(stamp)
        return arrival

    def is_far_back(self, stamp: float) -> bool:
        """Whether a stamp (s) is a restart if the next stamp confirms it."""
        return self._compare(stamp) is Arrival.RESTART

    def is_confirmed(self, stamp: float, following: float) -> bool:
        """Whether the stamp `following` (s) confirms a restart at a stamp far back (s).

        It does if it is after that stamp by no more than a gap, and before the last accepted stamp.
        """
        assert self._stamp is not None
        near = following - stamp <= max(self.gap_limit, MAX_INTERVAL)
        return stamp < following < self._stamp and near

    def accept(self, stamp: float, arrival: Arrival) -> None:
        """Continue from a processed scan; a dropped scan does not change the order."""
        self._late_stamps.clear()
        if arrival is Arrival.NEXT and self._stamp is not None:
            self._intervals.append(stamp - self._stamp)
        elif arrival in (Arrival.RESTART, Arrival.GAP):
            self._intervals.clear()  # the sonar may have changed its period
        self._stamp = stamp

    @property
    def gap_limit(self) -> float:
        """The gap, s, above which potential tracks are not continued."""
        if self.max_gap > 0:
            return self.max_gap
        if len(self._intervals) < MIN_INTERVALS:
            return MAX_INTERVAL
        assert self._intervals.maxlen is not None
        return self._intervals.maxlen * statistics.median(self._intervals)

    def resize(self, window: int) -> None:
        """Change the number of scans in the window."""
        self._intervals = deque(self._intervals, maxlen=window)

    def reset(self) -> None:
        """Forget all stamps."""
        self._intervals.clear()
        self._late_stamps.clear()
        self._stamp = None

    def _late(self, stamp: float) -> Arrival:
        """Classify a late scan; consecutive late scans with rising stamps are a restart."""
        if self._late_stamps and stamp <= self._late_stamps[-1]:
            self._late_stamps.clear()
        self._late_stamps.append(stamp)
        return Arrival.RESTART if len(self._late_stamps) >= MAX_LATE_SCANS else Arrival.LATE

    def _compare(self, stamp: float) -> Arrival:
        if self._stamp is None:
            return Arrival.NEXT
        interval = stamp - self._stamp
        if interval == 0:
            return Arrival.SAME_STAMP
        if interval < 0:
            return Arrival.RESTART if -interval > self.restart_jump else Arrival.LATE
        return Arrival.GAP if interval > self.gap_limit else Arrival.NEXT
