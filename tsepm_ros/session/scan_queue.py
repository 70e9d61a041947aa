"""The order of scans, and the queue of those that wait for own ship.

Elapsed time on one or several clocks.

Classification of a scan's stamp: next, late, a restart, or the first after a long gap.

The queue of scans that wait for processing, and the classification of their stamps.
"""

from __future__ import annotations

import enum
import math
import statistics
from collections import deque
from typing import NamedTuple

import numpy as np

from tsepm_ros.own_ship.registration import SensorScan
from tsepm_ros.session.drop_reasons import Rejection

Now = float | tuple[float, ...]
"""Time on one clock or on several, s."""


def waited(since: Now, now: Now) -> float:
    """Minimum elapsed time over the clocks, s; a clock that was set back is ignored."""
    elapsed = np.atleast_1d(np.subtract(now, since))
    return float(elapsed[elapsed >= 0].min(initial=math.inf))


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
        """Classify the next stamp (s) relative to the scans accepted so far.

        One that is far back is a restart if the next stamp confirms it; so are late scans in a row
        whose stamps rise.
        """
        if self._stamp is None:
            return Arrival.NEXT
        interval = stamp - self._stamp
        if interval > 0.0:
            return Arrival.GAP if interval > self.gap_limit else Arrival.NEXT
        if -interval > self.restart_jump and interval < 0.0:
            return Arrival.FAR_BACK
        if interval == 0.0 and not self._late_stamps:
            return Arrival.SAME_STAMP
        if self._late_stamps and stamp <= self._late_stamps[-1]:
            self._late_stamps.clear()
        self._late_stamps.append(stamp)
        return Arrival.RESTART if len(self._late_stamps) >= MAX_LATE_SCANS else Arrival.LATE

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


QUEUE_LENGTH = 1000
"""Maximum number of scans that wait for own-ship data."""

UNUSABLE = Arrival.SAME_STAMP, Arrival.LATE, Arrival.FAR_BACK
"""Classifications of scans that are dropped."""


class Waiting(NamedTuple):
    """The first scan in the queue.

    Attributes
    ----------
    scan : SensorScan
    arrival : Arrival
    seconds : float
        Time that it waited, s.
    refusal : Refusal or None
        Of a scan whose stamp does not permit processing.
    """

    scan: SensorScan
    arrival: Arrival
    seconds: float
    refusal: Rejection | None


class ScanQueue:
    """Scans from their arrival until they are processed or dropped.

    Parameters
    ----------
    order : ScanOrder
        Of the scans processed so far.
    length : int, optional
        Maximum number of scans; the oldest scan is dropped beyond it.

    Attributes
    ----------
    scans : deque
        Times of arrival, and the scans that wait.
    """

    def __init__(self, order: ScanOrder, length: int = QUEUE_LENGTH) -> None:
        self._order = order
        self._length = length
        self.scans: deque[tuple[Now, SensorScan]] = deque()
        self._arrival: Arrival | None = None  # of the first

    @property
    def newest_stamp(self) -> float | None:
        """Stamp of the waiting scan that arrived last, s."""
        return self.scans[-1][1].scan.stamp if self.scans else None

    def add(self, arrived: SensorScan, now: Now) -> Rejection | None:
        """Add a scan that arrived at `now`, s; refuse the oldest scan if the queue is full."""
        self.scans.append((now, arrived))
        if len(self.scans) <= self._length:
            return None
        self.remove_first()
        return Rejection("queue_full", f"more than {self._length} scans wait for own-ship data")

    def first(self, now: Now, *, last: bool) -> Waiting | None:
        """The first scan in the queue, classified by its stamp.

        If the stamp is far back, the next scan's stamp distinguishes a restart from a bad stamp.

        Parameters
        ----------
        now : float or tuple of float
            s.
        last : bool
            Whether no further scan follows.

        Returns
        -------
        Waiting or None
            None if the queue is empty, or the classification needs the next scan.
        """
        if not self.scans:
            return None
        if self._arrival is None:
            self._arrival = self._classify(last)
        if self._arrival is None:
            return None
        (since, scan), refusal = self.scans[0], None
        if self._arrival in UNUSABLE:
            stamp = scan.scan.stamp
            reason = "stamp_not_set" if stamp == 0.0 else f"scan_{self._arrival.value}"
            fault = "not set" if stamp == 0.0 else "not later than the last scan's"
            refusal = Rejection(reason, f"the stamp of a scan, {stamp:.3f} s, is {fault}")
        return Waiting(scan, self._arrival, waited(since, now), refusal)

    def remove_first(self) -> None:
        """Remove the first scan."""
        self.scans.popleft()
        self._arrival = None

    def clear(self) -> None:
        """Remove all scans."""
        self.scans.clear()
        self._arrival = None

    def _classify(self, last: bool) -> Arrival | None:
        """Classify the first scan's stamp; None if that needs the next scan."""
        _, arrived = self.scans[0]
        stamp = arrived.scan.stamp
        arrival = self._order.classify(stamp)
        if arrival is not Arrival.FAR_BACK:
            return arrival
        if len(self.scans) == 1:
            return Arrival.FAR_BACK if last else None
        since, following = self.scans[1]
        if not self._order.is_confirmed(stamp, following.scan.stamp):
            return Arrival.FAR_BACK
        self.scans[0] = since, arrived  # its wait for own-ship data begins only now
        return Arrival.RESTART
