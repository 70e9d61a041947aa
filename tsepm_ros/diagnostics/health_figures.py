"""The figures from which health is judged."""

from __future__ import annotations

import math
import statistics
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

from tsepm_ros.session.drop_reasons import DETECTIONS, reason_of
from tsepm_ros.session.snapshot import SessionSnapshot
from tsepm_ros.settings.diagnostics_options import DiagnosticsOptions


@dataclass(frozen=True)
class Latency:
    """Time that a scan took, s.

    Attributes
    ----------
    to_tracks, to_all : float
        From the entry of the callback that processed it until `tracks`, and until everything, was
        published.
    waiting : float
        Before that, for own-ship data.
    core : float
        The initiator's part.
    publishing : float
        Making and publishing messages.
    """

    to_tracks: float = 0.0
    to_all: float = 0.0
    waiting: float = 0.0
    core: float = 0.0
    publishing: float = 0.0

    @property
    def total(self) -> float:
        """From arrival until everything was published, s."""
        return self.waiting + self.to_all


@dataclass(frozen=True)
class Connections:
    """What the middleware reports.

    Attributes
    ----------
    subscribed : bool
        Whether a publisher of detections was found.
    unread : sequence of str
        Types other than that subscribed to as which the detections are published.
    mismatches_heard : mapping of str to int
        Events of qualities of service that do not fit, by topic.
    mismatches : sequence of str
        The topics on which there is such an endpoint now.
    unused_own_ship : str
        Topic on which own-ship data is published that is not listened to.
    """

    subscribed: bool = True
    unread: Sequence[str] = ()
    mismatches_heard: Mapping[str, int] = field(default_factory=dict)
    mismatches: Sequence[str] = ()
    unused_own_ship: str = ""


@dataclass(frozen=True)
class ScanRecord:
    """One processed scan: when, by the first clock (s), its detections and latency."""

    time: float
    detections: int
    latency: Latency


@dataclass(frozen=True)
class Arrival:
    """One scan, processed or not: when it arrived, by the first clock (s), and its stamp (s)."""

    time: float
    stamp: float


@dataclass(frozen=True)
class Counts:
    """Counts of a session, from its start or over a time.

    Attributes
    ----------
    detections : int
        Detections that were taken.
    cut : int
        Hypotheses that a limit cut.
    dropped : Counter of str
        Drops by reason.
    """

    detections: int = 0
    cut: int = 0
    dropped: Counter[str] = field(default_factory=Counter)

    @classmethod
    def of(cls, snapshot: SessionSnapshot) -> Counts:
        """Counts of a session up to now."""
        totals = snapshot.totals
        cut = totals.cut_potential_tracks + totals.cut_confirmations
        return cls(totals.detections, cut, Counter(snapshot.dropped))

    def __sub__(self, before: Counts) -> Counts:
        return Counts(
            max(self.detections - before.detections, 0),
            self.cut - before.cut,
            self.dropped - before.dropped,
        )


@dataclass(frozen=True, kw_only=True)
class HealthFigures:
    """Everything that a status is made from.

    Attributes
    ----------
    options : DiagnosticsOptions
    snapshot : SessionSnapshot
    connections : Connections
    recent : Counts
        Those of the window.
    scans : sequence of ScanRecord
        The last ones, of any age.
    arrivals : sequence of Arrival
        The last ones, of any age.
    since_scan, since_own_ship : float
        Time since the last message of each arrived, s; nan before the first.
    time : float
        Now, by the first clock, s.
    """

    options: DiagnosticsOptions
    snapshot: SessionSnapshot
    connections: Connections
    recent: Counts
    scans: Sequence[ScanRecord]
    arrivals: Sequence[Arrival]
    since_scan: float
    since_own_ship: float
    time: float

    def longest_latency(self, part: Callable[[Latency], float]) -> float:
        """Largest part of a latency in the window, s; 0 without a scan."""
        window = self.options.window
        recent = (scan.latency for scan in self.scans if self.time - scan.time <= window)
        return max(map(part, recent), default=0.0)

    @property
    def interval(self) -> float:
        """Median of the stamps' intervals, s; nan while unknown."""
        steps = [b.stamp - a.stamp for a, b in pairwise(self.arrivals) if b.stamp > a.stamp]
        return statistics.median(steps) if steps else math.nan

    @property
    def period(self) -> float:
        """Expected time between scans, s; nan while unknown."""
        return self.options.scan_period or self.interval

    @property
    def longest_interval(self) -> float:
        """Longest interval that is no gap, s; nan while unknown."""
        return self.options.scan_period_factor * self.period

    @property
    def gaps(self) -> int:
        """Intervals that ended in the window and were too long."""
        begin = self.time - self.options.window
        number, before = 0, 0.0
        for a, b in pairwise(self.arrivals):
            step = b.stamp - a.stamp
            # A rise after a fall is the way back from a single bad stamp.
            number += b.time >= begin and before >= 0 and step > self.longest_interval
            before = step
        return number

    @property
    def dropped_share(self) -> float:
        """Share of the window's detections that were dropped one by one."""
        number = self.recent_drops(DETECTIONS, of_detections=True).total()
        return number / max(number + self.recent.detections, 1)

    @property
    def own_ship_source(self) -> str:
        """Where the sensor's pose comes from."""
        return self.snapshot.own_ship_source

    @property
    def own_ship_behind(self) -> float:
        """Age of the newest own-ship data at the newest scan, s; nan while unknown."""
        scan, own_ship = self.snapshot.scan_stamp, self.snapshot.own_ship_stamp
        return math.nan if scan is None or own_ship is None else scan - own_ship

    @property
    def exposure(self) -> float:
        """Area in which the scans could detect, summed over the scans, m^2."""
        return len(self.scans) * self.snapshot.coverage_area

    @property
    def clutter_expected(self) -> float:
        """Detections of the scans if all were clutter of the density in use."""
        return self.snapshot.clutter_density * self.exposure

    @property
    def detections(self) -> int:
        """Detections of the scans."""
        return sum(scan.detections for scan in self.scans)

    @property
    def detection_density(self) -> float:
        """Detections of the scans over their exposure, 1/m^2; nan while unknown."""
        return self.detections / self.exposure if self.exposure else math.nan

    def dropped_of(self, task: str) -> dict[str, object]:
        """Totals of the drops that belong to a task, as values."""
        return {
            f"dropped.{name}": number
            for name, number in sorted(self.snapshot.dropped.items())
            if reason_of(name).task == task
        }

    def recent_drops(self, task: str, *, of_detections: bool = False) -> Counter[str]:
        """Drops of the window that belong to a task: of single detections, or of all else."""
        return Counter(
            {
                name: number
                for name, number in self.recent.dropped.items()
                if reason_of(name).task == task
                and (reason_of(name).lost == "detection") is of_detections
            }
        )
