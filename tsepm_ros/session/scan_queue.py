"""The queue of scans that wait for processing, and the classification of their stamps."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from tsepm_ros.own_ship.registration import SensorScan
from tsepm_ros.session.clocks import Now, waited
from tsepm_ros.session.refusal import Refusal
from tsepm_ros.session.scan_order import Arrival, ScanOrder

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
    """

    scan: SensorScan
    arrival: Arrival
    seconds: float

    @property
    def usable(self) -> bool:
        """Whether the stamp permits processing."""
        return self.arrival not in UNUSABLE

    def refuse(self) -> Refusal | None:
        """Refuse a scan whose stamp does not permit processing."""
        if self.usable:
            return None
        stamp = self.scan.scan.stamp
        reason = "stamp_not_set" if stamp == 0.0 else f"scan_{self.arrival.value}"
        fault = "not set" if stamp == 0.0 else "not later than the last scan's"
        return Refusal(reason, f"the stamp of a scan, {stamp:.3f} s, is {fault}")


class ScanQueue:
    """Scans from their arrival until they are processed or dropped.

    Parameters
    ----------
    order : ScanOrder
        Of the scans processed so far.
    length : int, optional
        Maximum number of scans; the oldest scan is dropped beyond it.
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
        """Stamp of the waiting scan that arrived last, s."""
        return self._scans[-1][1].scan.stamp if self._scans else None

    def add(self, arrived: SensorScan, now: Now) -> Refusal | None:
        """Add a scan that arrived at `now`, s; refuse the oldest scan if the queue is full."""
        self._scans.append((now, arrived))
        if len(self._scans) <= self._length:
            return None
        self.remove_first()
        return Refusal("queue_full", f"more than {self._length} scans wait for own-ship data")

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
        if not self._scans:
            return None
        if self._arrival is None:
            self._arrival = self._classify(last)
        if self._arrival is None:
            return None
        since, scan = self._scans[0]
        return Waiting(scan, self._arrival, waited(since, now))

    def remove_first(self) -> None:
        """Remove the first scan."""
        self._scans.popleft()
        self._arrival = None

    def clear(self) -> None:
        """Remove all scans."""
        self._scans.clear()
        self._arrival = None

    def _classify(self, last: bool) -> Arrival | None:
        """Classify the first scan's stamp; None if that needs the next scan."""
        _, arrived = self._scans[0]
        stamp = arrived.scan.stamp
        arrival = self._order.classify(stamp)
        if not self._order.is_far_back(stamp):
            return arrival
        if len(self._scans) == 1:
            return Arrival.FAR_BACK if last else None
        since, following = self._scans[1]
        if not self._order.is_confirmed(stamp, following.scan.stamp):
            return Arrival.FAR_BACK
        self._scans[0] = since, arrived  # its wait for own-ship data begins only now
        return Arrival.RESTART
