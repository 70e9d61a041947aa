"""The scans that wait: in which order they are processed, and what their stamps mean."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from tsepm_ros.own_ship.registration import SensorScan
from tsepm_ros.session.clocks import Now, waited
from tsepm_ros.session.refusal import Refusal
from tsepm_ros.session.scan_order import Arrival, ScanOrder

QUEUE_LENGTH = 1000
"""Scans that may wait for own-ship data at once."""

UNUSABLE = Arrival.SAME_STAMP, Arrival.LATE, Arrival.FAR_BACK
"""Arrivals of scans that are dropped."""


class Waiting(NamedTuple):
    """The first scan that waits.

    Attributes
    ----------
    scan : SensorScan
    arrival : Arrival
    seconds : float
        Time that it waited, s.
    """

    scan: SensorScan
    arrival: Arrival
    seconds: float

    @property
    def usable(self) -> bool:
        """Whether its stamp lets it be processed."""
        return self.arrival not in UNUSABLE

    def refuse(self) -> Refusal | None:
        """Why its stamp does not let it be processed."""
        if self.usable:
            return None
        stamp = self.scan.scan.stamp
        reason = "stamp_not_set" if stamp == 0.0 else f"scan_{self.arrival.value}"
        return Refusal(reason, f"the scan of {stamp:.3f} s is not later than the last one")


class ScanQueue:
    """Scans from their arrival until they are processed or dropped.

    Parameters
    ----------
    order : ScanOrder
        Of the scans processed so far.
    length : int, optional
        Scans that may wait; the oldest gives way.
    """

    def __init__(self, order: ScanOrder, length: int = QUEUE_LENGTH) -> None:
        self._order = order
        self._length = length
        self._scans: deque[tuple[Now, SensorScan]] = deque()
        self._arrival: Arrival | None = None  # of the first

    def __len__(self) -> int:
        """Number of scans that wait."""
        return len(self._scans)

    @property
    def newest_stamp(self) -> float | None:
        """Stamp of the scan that arrived last of those that wait, s."""
        return self._scans[-1][1].scan.stamp if self._scans else None

    def add(self, arrived: SensorScan, now: Now) -> Refusal | None:
        """Add a scan that arrived at `now`, s; says so where the oldest gave way to it."""
        self._scans.append((now, arrived))
        if len(self._scans) <= self._length:
            return None
        self.remove_first()
        return Refusal("queue_full", f"more than {self._length} scans wait for own-ship data")

    def first(self, now: Now, *, last: bool) -> Waiting | None:
        """The first scan that waits, judged by its stamp.

        One whose stamp is far back is judged by the scan after it, which alone tells a restart from
        a bad stamp.

        Parameters
        ----------
        now : float or tuple of float
            s.
        last : bool
            Whether no scan follows any more.

        Returns
        -------
        Waiting or None
            None where no scan waits, or only the next one tells.
        """
        if not self._scans:
            return None
        if self._arrival is None:
            self._arrival = self._judged(last)
        if self._arrival is None:
            return None
        since, scan = self._scans[0]
        return Waiting(scan, self._arrival, waited(since, now))

    def remove_first(self) -> None:
        """Take the first scan out."""
        self._scans.popleft()
        self._arrival = None

    def clear(self) -> None:
        """Take all scans out."""
        self._scans.clear()
        self._arrival = None

    def _judged(self, last: bool) -> Arrival | None:
        """Judge the first scan's stamp."""
        _, arrived = self._scans[0]
        stamp = arrived.scan.stamp
        arrival = self._order.judge(stamp)
        if not self._order.is_far_back(stamp):
            return arrival
        if len(self._scans) == 1:
            return Arrival.FAR_BACK if last else None
        since, following = self._scans[1]
        if not self._order.is_confirmed(stamp, following.scan.stamp):
            return Arrival.FAR_BACK
        self._scans[0] = since, arrived  # until now it did not wait for own-ship data
        return Arrival.RESTART
