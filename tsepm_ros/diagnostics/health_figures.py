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
from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from operator import attrgetter
from typing import TYPE_CHECKING, NamedTuple

from tsepm_ros.session.drop_reasons import DETECTIONS, drop_reason_of

if TYPE_CHECKING:  # `tsepm health` reads levels alone
    from tsepm_ros.session.session import SessionSnapshot
    from tsepm_ros.settings.node_options import DiagnosticsOptions
OVERALL = "overall"
"""Entry of the worst level, for scripts."""
LAST_SCANS = 50
"""Scans of which intervals and the density of detections are judged."""
MAX_RECORDS = 10_000
"""Records of the window that are kept at most: bounds memory and time."""
MIN_INTERVAL = 0.75
"""Least time between two events that count as one state, s: each is in a report of its second."""


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
    """The status of all: the worst level, its entry, the level of each entry, and all drops."""
    worst = max(statuses, key=lambda status: ORDER.index(status.level))
    message = f"{worst.task}: {worst.message}" if worst.level else "every entry is OK"
    levels = {status.task: status.level.name for status in statuses}
    drops = Counter[str]()
    for values in (status.values for status in statuses):
        drops.update({name: n for name, n in values.items() if name.startswith("dropped.")})
    return Status(OVERALL, worst.level, message, {**levels, **drops})


def goes_on(times: Sequence[float], now: float, interval: float, window: float) -> bool:
    """Whether what happened at these times, s, goes on.

    Until twice the longest time between two of it has passed since the last, or twice the interval
    of the input; at most for the window: all s.
    """
    late = [time for time in times if now - time <= window]
    # The last may be nan, and is then not the largest.
    usual = max([MIN_INTERVAL, *(b - a for a, b in pairwise(late)), interval])
    return bool(late) and now - late[-1] <= min(2.0 * usual, window)


class Occurrences:
    """When something happened that is counted, and how often of late."""

    def __init__(self) -> None:
        self._notes: deque[tuple[float, int]] = deque(maxlen=MAX_RECORDS)
        self._before = 0

    def note(self, time: float, total: int) -> None:
        """Note the count at a time, s; one that has not grown is none."""
        if total < self._before or (self._notes and total < self._notes[-1][1]):  # a reset
            self._notes.clear()
            self._before = 0
        if total > (self._notes[-1][1] if self._notes else self._before):
            self._notes.append((time, total))

    def number(self, now: float, interval: float, window: float) -> int:
        """How often it happened in the window, s, while it goes on; else 0."""
        while self._notes and self._notes[0][0] < now - window:
            self._before = self._notes.popleft()[1]
        on = goes_on([time for time, _ in self._notes], now, interval, window)
        return self._notes[-1][1] - self._before if on else 0


class LatencyFigures(NamedTuple):
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
    topic : str
        Full name of the input's topic.
    publishers : sequence of str
        Nodes that publish the input, each so often.
    best_effort : bool
        Whether each publisher offers best effort only.
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

    topic: str = "the topic"
    publishers: Sequence[str] = ("",)
    best_effort: bool = False
    unread: Sequence[str] = ()
    subscribed_type: str = ""
    other_readable: Sequence[str] = ()
    mismatches_heard: Mapping[str, int] = field(default_factory=dict)
    mismatches: Sequence[str] = ()
    unused_own_ship: str = ""
    topics: Mapping[str, str] = field(default_factory=dict)
    clock_fault: str = ""
    file_fault: str = ""

    @property
    def of_several(self) -> str:
        """Says which nodes publish the input, if it is more than one publisher; else empty."""
        return f"; {self.topic} is published by {' and '.join(self.publishers)}" * (
            len(self.publishers) > 1
        )


class ScanRecord(NamedTuple):
    """A processed scan: its time on the first clock (s), number of detections and latency."""

    time: float
    detections: int
    latency: LatencyFigures


@dataclass(frozen=True, kw_only=True)
class InputFigures:
    """The health of one input: what rules judge.

    Attributes
    ----------
    options : DiagnosticsOptions
    noun : str
        A message of the input, in words.
    connections : Connections
    arrivals : sequence of (float, float)
        Of each message, used or not, its time of arrival on the first clock and its stamp, s: of
        the window, and the last `LAST_SCANS` of any age.
    since : float
        Time since the arrival of the last message, s; nan before the first message.
    waited : float
        Time for which the input has been published, s.
    patience : float
        Time without a message that is never said, s.
    user : str
        What needs the messages, in words.
    behind : float
        Age of the newest message at the newest of what needs it, by the stamps, s.
    time : float
        Present time on the first clock, s.
    dropped : mapping of str to int
        All drops by reason.
    late : Counter of str
        Those that go on, by reason: their number in the window.
    findings : mapping of str to str
        What the node has found, a sentence by subject.
    healthy : str
        Message where nothing is wrong.
    values : mapping of str to object
        Further figures.
    """

    options: DiagnosticsOptions
    noun: str = "scan"
    connections: Connections
    arrivals: Sequence[tuple[float, float]] = ()
    since: float = math.nan
    waited: float = 0.0
    patience: float = 1.0
    user: str = "scan"
    behind: float = math.nan
    time: float
    dropped: Mapping[str, int] = field(default_factory=dict)
    late: Counter[str] = field(default_factory=Counter)
    findings: Mapping[str, str] = field(default_factory=dict)
    healthy: str = "all is well"
    values: Mapping[str, object] = field(default_factory=dict)

    @cached_property
    def interval(self) -> float:
        """Median of the last stamps' intervals, s; nan while unknown."""
        stamps = [stamp for _, stamp in self.arrivals[-LAST_SCANS:]]
        intervals = [b - a for a, b in pairwise(stamps) if b > a]
        return statistics.median(intervals) if intervals else math.nan

    @property
    def period(self) -> float:
        """Expected time between messages, s; nan while unknown."""
        return self.options.scan_period or self.interval

    @property
    def max_interval(self) -> float:
        """Maximum interval without a gap, s; nan while unknown."""
        return self.options.scan_period_factor * self.period

    @property
    def gaps(self) -> int:
        """Number of intervals that ended in the window and exceed `max_interval`, as they go on."""
        begin = self.time - self.options.window
        ends, before, longest = list[float](), 0.0, self.max_interval
        for (_, last), (time, stamp) in pairwise(self.arrivals):
            interval = stamp - last
            # An increase after a decrease is the return from a single bad stamp.
            if time >= begin and before >= 0 and interval > longest:
                ends.append(time)
            before = interval
        return len(ends) if self.goes_on(ends) else 0

    def goes_on(self, times: Sequence[float]) -> bool:
        """Whether what happened at these times, s, goes on, see `goes_on`."""
        return goes_on(times, self.time, self.interval, self.options.window)

    def dropped_of(self, task: str) -> dict[str, object]:
        """Total drops of a task, as values."""
        return {
            f"dropped.{name}": number
            for name, number in sorted(self.dropped.items())
            if drop_reason_of(name).task == task
        }

    def recent_drops(self, task: str, *, of_detections: bool = False) -> Counter[str]:
        """Drops of a task that go on: of single detections, or of everything else."""
        return Counter(
            {
                name: number
                for name, number in self.late.items()
                if drop_reason_of(name).task == task
                and (drop_reason_of(name).lost == "detection") is of_detections
            }
        )


@dataclass(frozen=True, kw_only=True)
class HealthFigures(InputFigures):
    """The health of a session: of its input of scans, and what else its rules judge.

    Attributes
    ----------
    snapshot : SessionSnapshot
    cut : int
        Hypotheses that a limit cut in the window, while it goes on.
    scans : sequence of ScanRecord
        The processed scans of the window, and the last `LAST_SCANS` of any age.
    empty, empty_time : int, float
        Number of the last scans without a detection, and time since the last with one, s.
    usual : float
        Detections of clutter per scan, as learned before these.
    every : float
        Time between scans of all sensors, s; nan: that of the only one.
    own_ship : InputFigures
    """

    snapshot: SessionSnapshot
    cut: int = 0
    scans: Sequence[ScanRecord]
    empty: int = 0
    empty_time: float = 0.0
    usual: float = 0.0
    every: float = math.nan
    own_ship: InputFigures

    def longest_latency(self, part: str) -> float:
        """Largest part of a latency in the window, s; 0 without a scan."""
        return max(map(attrgetter(f"latency.{part}"), self.recent), default=0.0)

    def median_latency(self, part: Callable[[LatencyFigures], float]) -> float:
        """Median of a part of the latencies in the window, s; 0 without a scan."""
        return statistics.median([part(scan.latency) for scan in self.recent] or [0.0])

    @cached_property
    def recent(self) -> list[ScanRecord]:
        """The scans of the window."""
        return [scan for scan in self.scans if self.time - scan.time <= self.options.window]

    @cached_property
    def dropped_share(self) -> float:
        """Share of the window's detections that were dropped one by one, while that goes on."""
        number = self.recent_drops(DETECTIONS, of_detections=True).total()
        taken = sum(scan.detections for scan in self.recent)
        return number / max(number + taken, 1)

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
