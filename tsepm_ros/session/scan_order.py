"""What a scan's stamp means: next, late, a restart, or the first after a long gap."""

from __future__ import annotations

import enum
import statistics
from collections import deque

MIN_INTERVALS = 3
"""Intervals that must be known before a gap can be told from a slow sonar."""


LONGEST_INTERVAL = 3600.0
"""Longest time between scans that is believed while no others are known, s."""


LATE_IN_A_ROW = 3
"""Late scans with rising stamps, and none other between, that are a restart after all."""


class Arrival(enum.Enum):
    """How a scan relates to those before it."""

    NEXT = "next"
    SAME_STAMP = "same_stamp"
    LATE = "late"
    FAR_BACK = "far_back"
    RESTART = "restart"
    GAP = "gap"


class ScanOrder:
    """Judges the stamps of arriving scans.

    Parameters
    ----------
    window : int
        Scans of the confirmation window.
    restart_jump : float
        A stamp farther back than this, s, is a restart (a looping bag, a reset clock) if the next
        one confirms it; nearer it is a late scan.
    max_gap : float
        A stamp farther ahead than this, s, leaves nothing to continue; 0: `window` times the
        median interval of the last scans.
    """

    def __init__(self, window: int, restart_jump: float, max_gap: float) -> None:
        self.restart_jump = restart_jump
        self.max_gap = max_gap
        self._intervals: deque[float] = deque(maxlen=window)
        self._stamp: float | None = None
        self._late_stamps: list[float] = []

    def judge(self, stamp: float) -> Arrival:
        """Judge the next stamp (s) against the scans accepted so far."""
        arrival = self._compare(stamp)
        if arrival is Arrival.LATE or (arrival is Arrival.SAME_STAMP and self._late_stamps):
            return self._late(stamp)
        return arrival

    def is_far_back(self, stamp: float) -> bool:
        """Whether a stamp (s) is a restart only if the one after it says so too."""
        return self._compare(stamp) is Arrival.RESTART

    def is_confirmed(self, stamp: float, following: float) -> bool:
        """Whether the stamp `following` (s) is of the run that one far back (s) would begin.

        It is if it is later, but still before the last one accepted, and near.
        """
        assert self._stamp is not None
        near = following - stamp <= max(self.gap_limit, LONGEST_INTERVAL)
        return stamp < following < self._stamp and near

    def accept(self, stamp: float, arrival: Arrival) -> None:
        """Go on from a scan that is processed; one that is dropped leaves no trace in the order."""
        self._late_stamps.clear()
        if arrival is Arrival.NEXT and self._stamp is not None:
            self._intervals.append(stamp - self._stamp)
        elif arrival in (Arrival.RESTART, Arrival.GAP):
            self._intervals.clear()  # the sonar may have changed its period
        self._stamp = stamp

    @property
    def gap_limit(self) -> float:
        """The gap, s, beyond which nothing is continued."""
        if self.max_gap > 0:
            return self.max_gap
        if len(self._intervals) < MIN_INTERVALS:
            return LONGEST_INTERVAL
        assert self._intervals.maxlen is not None
        return self._intervals.maxlen * statistics.median(self._intervals)

    def resize(self, window: int) -> None:
        """Change the window's number of scans."""
        self._intervals = deque(self._intervals, maxlen=window)

    def reset(self) -> None:
        """Forget all stamps."""
        self._intervals.clear()
        self._late_stamps.clear()
        self._stamp = None

    def _late(self, stamp: float) -> Arrival:
        """A late scan; but some that follow one another are the scans of a restart."""
        if self._late_stamps and stamp <= self._late_stamps[-1]:
            self._late_stamps.clear()
        self._late_stamps.append(stamp)
        return Arrival.RESTART if len(self._late_stamps) >= LATE_IN_A_ROW else Arrival.LATE

    def _compare(self, stamp: float) -> Arrival:
        if self._stamp is None:
            return Arrival.NEXT
        step = stamp - self._stamp
        if step == 0:
            return Arrival.SAME_STAMP
        if step < 0:
            return Arrival.RESTART if -step > self.restart_jump else Arrival.LATE
        return Arrival.GAP if step > self.gap_limit else Arrival.NEXT
