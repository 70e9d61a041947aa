# Copyright 2026 tsepm_ros developers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""Figures of a session's health, and the levels that entries of the diagnostics have."""

from __future__ import annotations

import enum
import math
import statistics
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

from tsepm_ros.session.drop_reasons import DETECTIONS, drop_reason_of

if TYPE_CHECKING:  # `tsepm health` reads levels alone
    from tsepm_ros.session.session import SessionSnapshot
    from tsepm_ros.settings.node_options import DiagnosticsOptions
OVERALL = "overall"
"""Entry of the worst level, for scripts."""
LAST_SCANS = 50
"""Scans of which intervals and the density of detections are judged."""


class Level(enum.IntEnum):
    """Level of a status, numbered as in diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3

    @classmethod
    def _missing_(cls, value: object) -> Level:
        """The level of a number that is none: whatever a node means with it, it is no health."""
        return cls.ERROR


@dataclass(frozen=True)
class Status:
    """Health of one task.

    Attributes
    ----------
    task : str
    level : Level
    message : str
        One or several sentences, the worst first.
    values : dict of str to object
        Figures.
    """

    task: str
    level: Level
    message: str
    values: Mapping[str, object]


ORDER = (Level.OK, Level.WARN, Level.STALE, Level.ERROR)
"""From the best to the worst: stale is the absence of news, and less than an error."""


def overall(statuses: Sequence[Status]) -> Status:
    """The status of all: the worst level, the entry that has it, and the level of each entry."""
    worst = max(statuses, key=lambda status: ORDER.index(status.level))
    message = f"{worst.task}: {worst.message}" if worst.level else "every entry is OK"
    return Status(
        OVERALL, worst.level, message, {status.task: status.level.name for status in statuses}
    )


@dataclass(frozen=True)
class LatencyFigures:
    """Latency of a scan and its parts, s.

    Attributes
    ----------
    to_tracks, to_all : float
        From the start of the callback that processed the scan to the publication of `tracks`, and
        to the end of publishing.
    waiting : float
        Wait for own-ship data before the callback.
    core : float
        Computing time of the initiator.
    publishing : float
        Building and publishing messages.
    """

    to_tracks: float = 0.0
    to_all: float = 0.0
    waiting: float = 0.0
    core: float = 0.0
    publishing: float = 0.0

    @property
    def total(self) -> float:
        """From arrival to the end of publishing, s."""
        return self.waiting + self.to_all


@dataclass(frozen=True)
class Connections:
    """State of the connections, from the middleware.

    Attributes
    ----------
    subscribed : bool
        Whether a publisher of detections was found.
    unread : sequence of str
        Published types of the detections other than the subscribed type.
    subscribed_type : str
        The subscribed type; empty if there is no subscription.
    other_readable : sequence of str
        Types of `unread` that the node can read after a new start.
    mismatches_heard : mapping of str to int
        Number of events of incompatible quality of service, by topic.
    mismatches : sequence of str
        Topics that have an incompatible endpoint now.
    unused_own_ship : str
        Topic of own-ship data that is published without a subscription of the node.
    topics : mapping of str to str
        Full names of the node's topics, by their names without remapping.
    clock_fault : str
        A sentence while the node's clock stands still.
    file_fault : str
        A sentence while what is learned is not kept in its file.
    """

    subscribed: bool = True
    unread: Sequence[str] = ()
    subscribed_type: str = ""
    other_readable: Sequence[str] = ()
    mismatches_heard: Mapping[str, int] = field(default_factory=dict)
    mismatches: Sequence[str] = ()
    unused_own_ship: str = ""
    topics: Mapping[str, str] = field(default_factory=dict)
    clock_fault: str = ""
    file_fault: str = ""


class ScanRecord(NamedTuple):
    """A processed scan: its time on the first clock (s), number of detections and latency."""

    time: float
    detections: int
    latency: LatencyFigures


@dataclass(frozen=True)
class CountFigures:
    """Counts of a session, since its start or over a period.

    Attributes
    ----------
    detections : int
        Detections that were processed.
    cut : int
        Hypotheses that a limit cut.
    dropped : Counter of str
        Drops by reason.
    """

    detections: int = 0
    cut: int = 0
    dropped: Counter[str] = field(default_factory=Counter)

    @classmethod
    def of(cls, snapshot: SessionSnapshot) -> CountFigures:
        """Counts of a session up to now."""
        totals = snapshot.totals
        cut = totals.cut_potential_tracks + totals.cut_confirmations
        return cls(totals.detections, cut, Counter(snapshot.dropped))

    def __sub__(self, before: CountFigures) -> CountFigures:
        return CountFigures(
            max(self.detections - before.detections, 0),
            self.cut - before.cut,
            self.dropped - before.dropped,
        )


@dataclass(frozen=True, kw_only=True)
class HealthFigures:
    """The input of all rules and entries.

    Attributes
    ----------
    options : DiagnosticsOptions
    snapshot : SessionSnapshot
    connections : Connections
    recent : CountFigures
        Counts of the window.
    scans : sequence of ScanRecord
        The processed scans of the window, and the last `LAST_SCANS` of any age.
    arrivals : sequence of (float, float)
        Of each scan, processed or not, its time of arrival on the first clock and its stamp, s: of
        the window, and the last `LAST_SCANS` of any age.
    since_scan, since_own_ship : float
        Time since the arrival of the last message, s; nan before the first message.
    time : float
        Present time on the first clock, s.
    """

    options: DiagnosticsOptions
    snapshot: SessionSnapshot
    connections: Connections
    recent: CountFigures
    scans: Sequence[ScanRecord]
    arrivals: Sequence[tuple[float, float]]
    since_scan: float
    since_own_ship: float
    time: float

    def longest_latency(self, part: Callable[[LatencyFigures], float]) -> float:
        """Largest part of a latency in the window, s; 0 without a scan."""
        return max(self._parts(part), default=0.0)

    def median_latency(self, part: Callable[[LatencyFigures], float]) -> float:
        """Median of a part of the latencies in the window, s; 0 without a scan."""
        return statistics.median(self._parts(part) or [0.0])

    def _parts(self, part: Callable[[LatencyFigures], float]) -> list[float]:
        window = self.options.window
        return [part(scan.latency) for scan in self.scans if self.time - scan.time <= window]

    @property
    def interval(self) -> float:
        """Median of the last stamps' intervals, s; nan while unknown."""
        stamps = [stamp for _, stamp in self.arrivals[-LAST_SCANS:]]
        intervals = [b - a for a, b in pairwise(stamps) if b > a]
        return statistics.median(intervals) if intervals else math.nan

    @property
    def period(self) -> float:
        """Expected time between scans, s; nan while unknown."""
        return self.options.scan_period or self.interval

    @property
    def max_interval(self) -> float:
        """Maximum interval without a gap, s; nan while unknown."""
        return self.options.scan_period_factor * self.period

    @property
    def gaps(self) -> int:
        """Number of intervals that ended in the window and exceed `max_interval`."""
        begin = self.time - self.options.window
        number, before, longest = 0, 0.0, self.max_interval
        for (_, last), (time, stamp) in pairwise(self.arrivals):
            interval = stamp - last
            # An increase after a decrease is the return from a single bad stamp.
            number += time >= begin and before >= 0 and interval > longest
            before = interval
        return number

    @property
    def dropped_share(self) -> float:
        """Share of the window's detections that were dropped one by one."""
        number = self.recent_drops(DETECTIONS, of_detections=True).total()
        return number / max(number + self.recent.detections, 1)

    @property
    def own_ship_behind(self) -> float:
        """Age of the newest own-ship data at the newest scan, s; nan while unknown."""
        scan, own_ship = self.snapshot.scan_stamp, self.snapshot.own_ship_stamp
        return math.nan if scan is None or own_ship is None else scan - own_ship

    @property
    def exposure(self) -> float:
        """Coverage area, summed over the last scans, m^2."""
        return len(self.scans[-LAST_SCANS:]) * self.snapshot.coverage_area

    @property
    def clutter_expected(self) -> float:
        """Expected number of clutter detections of the scans at the density in use."""
        return self.snapshot.clutter_density * self.exposure

    @property
    def detections(self) -> int:
        """Detections of the last scans."""
        return sum(scan.detections for scan in self.scans[-LAST_SCANS:])

    @property
    def detection_density(self) -> float:
        """Detections of the scans over their exposure, 1/m^2; nan while unknown."""
        return self.detections / self.exposure if self.exposure else math.nan

    def dropped_of(self, task: str) -> dict[str, object]:
        """Total drops of a task, as values."""
        return {
            f"dropped.{name}": number
            for name, number in sorted(self.snapshot.dropped.items())
            if drop_reason_of(name).task == task
        }

    def recent_drops(self, task: str, *, of_detections: bool = False) -> Counter[str]:
        """Drops of a task in the window: of single detections, or of everything else."""
        return Counter(
            {
                name: number
                for name, number in self.recent.dropped.items()
                if drop_reason_of(name).task == task
                and (drop_reason_of(name).lost == "detection") is of_detections
            }
        )
