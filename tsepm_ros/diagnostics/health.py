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
"""Health of a session: its entries on /diagnostics, as tables of figures, conditions and sentences.

An entry has its figures, its message while healthy, and its rules. A rule is a condition with a
level, thresholds and a remedy; its judgement returns the sentence that names the problem, or an
empty one. docs/diagnostics.md lists them. `Health` has the history behind them: arrivals, latencies
and counts of the window.

Counts are totals since the start or the last reset; a level covers the last
`DiagnosticsOptions.window` only.
"""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from tsepm_ros.diagnostics.health_figures import (
    LAST_SCANS,
    Connections,
    CountFigures,
    HealthFigures,
    LatencyFigures,
    Level,
    ScanRecord,
    Status,
    overall,
)
from tsepm_ros.session.drop_reasons import DETECTIONS, INITIATION, LAND, OWN_SHIP, TRACKER
from tsepm_ros.session.inputs import Now, input_waited
from tsepm_ros.session.session import SessionSnapshot
from tsepm_ros.settings.node_options import DiagnosticsOptions

LATENCY, CLUTTER, QUALITY_OF_SERVICE = "latency", "clutter", "quality of service"
SENSOR = "sensor parameters"
"""Entries without drops."""
COVERAGE = ("min_range", "max_range", "azimuth_min", "azimuth_max")
MIN_SCANS = 5
"""Minimum number of scans for a judgement of the density of detections."""
CLUTTER_FACTOR = 3.0
"""Largest factor between the density of detections and the clutter density in use: a choice."""
MIN_DETECTIONS = 20.0
"""Minimum number of detections, expected or observed, for that judgement."""

Judgement = Callable[[HealthFigures], str]
_SEE_REASONS = "See the reasons below"
_NO_SCAN = "Check the topic and its type: `ros2 topic info -v`; remap `detections`"
_LOST_PINGS = (
    "Pings are lost: check the driver and the network. For a sonar with a variable period, leave "
    "`scan_period` at 0"
)
_PERIOD = ("scan_period", "scan_period_factor")
_NAVIGATION = "Check the navigation; compare its clock with the sonar's"
_EMPTY_RAYS = (
    "See the reasons below; if a sensor marks empty rays in its own way, raise `max_dropped_share`"
)
MAX_RECORDS = 10_000
"""Scans of the window that are remembered at most: bounds memory and time."""
NO_CONNECTIONS = Connections()
"""Connections of a session without a node."""


@dataclass(frozen=True)
class Rule:
    """One problem that an entry may have.

    Attributes
    ----------
    level : Level
        Level of an entry with the problem.
    condition : str
        When there is the problem, a sentence for docs/diagnostics.md.
    judge : callable
        Returns the sentence that names the problem, or an empty sentence.
    remedy : str
    thresholds : tuple of str
        Options of `DiagnosticsOptions` that are thresholds of the rule.
    """

    level: Level
    condition: str
    judge: Judgement
    remedy: str
    thresholds: tuple[str, ...] = ()


@dataclass(frozen=True)
class Entry:
    """One entry.

    Attributes
    ----------
    healthy : callable
        Returns the message if no rule applies.
    values : callable
        Returns the figures.
    rules : tuple of tuple of Rule
        Of the rules in one tuple, only the first that applies counts.
    """

    healthy: Judgement
    values: Callable[[HealthFigures], Mapping[str, object]]
    rules: tuple[tuple[Rule, ...], ...]


def _health_when(applies: bool, sentence: str) -> str:
    return sentence if applies else ""


def _health_dropped(drops: Mapping[str, int]) -> str:
    """Drops by reason, the most frequent first; empty if there are none."""
    ordered = sorted(drops.items(), key=lambda drop: -drop[1])
    return _health_when(bool(drops), "dropped: " + ", ".join(f"{n} {name}" for name, n in ordered))


def _health_drops_of(task: str, level: Level, remedy: str) -> Rule:
    """The rule of a task's drops, except those of single detections."""
    return Rule(
        level,
        "Input of this entry was dropped",
        lambda now: _health_dropped(now.recent_drops(task)),
        remedy,
    )


def health_unread_type(now: HealthFigures) -> str:
    """Detections are published as a type that the node does not read."""
    connections = now.connections
    readable = connections.other_readable
    other = ", ".join(name for name in connections.unread if name not in readable)
    sentences = [f"{other}, which the node does not read"] if other else []
    if readable:
        after = f"after a new start: it has subscribed to {connections.subscribed_type}"
        sentences.append(f"{', '.join(readable)}, which the node reads only {after}")
    return _health_when(
        bool(sentences), f"detections are published as {'; and as '.join(sentences)}"
    )


def _health_scan_rate(now: HealthFigures) -> str:
    interval, period, factor = now.interval, now.period, now.options.scan_period_factor
    differs = interval > factor * period or interval * factor < period
    return _health_when(differs, f"a scan every {interval:.3g} s, expected is {period:.3g} s")


def _health_scan_overdue(now: HealthFigures) -> str:
    said = f"no scan for {now.since_scan:.3g} s, expected is a scan every {now.period:.3g} s"
    return _health_when(now.since_scan > now.max_interval, said)


def _health_scan_gaps(now: HealthFigures) -> str:
    number = now.gaps
    gaps = "1 gap" if number == 1 else f"{number} gaps"
    return _health_when(number > 0, f"{gaps} between scans longer than {now.max_interval:.3g} s")


def _health_detections_dropped(now: HealthFigures) -> str:
    share = now.dropped_share
    drops = _health_dropped(now.recent_drops(DETECTIONS, of_detections=True))
    said = f"{100 * share:.3g} % of the detections {drops}"
    return _health_when(share > now.options.max_dropped_share, said)


def health_unused_own_ship(topic: str) -> str:
    """Return the sentence for own-ship data that is published on a topic and not used."""
    return (
        f"odometry is published on {topic}, but own_ship_source is none: the sensor is assumed "
        "not to move"
    )


def _health_own_ship_unused(now: HealthFigures) -> str:
    topic = now.connections.unused_own_ship
    unused = bool(topic) and now.snapshot.own_ship_source == "none"
    return _health_when(unused, health_unused_own_ship(topic))


def _health_of_odometry(now: HealthFigures, applies: bool, sentence: str) -> str:
    """A sentence on odometry alone: data from tf is looked up when it is needed."""
    return _health_when(now.snapshot.own_ship_source == "odometry" and applies, sentence)


def _health_no_own_ship(now: HealthFigures, limit: float) -> str:
    age = now.since_own_ship
    return _health_of_odometry(now, age > limit, f"no own-ship data for {age:.3g} s")


def _health_own_ship_behind(now: HealthFigures) -> str:
    behind = now.own_ship_behind
    late = behind > now.options.max_own_ship_age
    return _health_of_odometry(
        now, late, f"own-ship data is {behind:.3g} s older than the newest scan"
    )


def _health_overload(now: HealthFigures) -> str:
    median = now.median_latency(lambda latency: latency.core + latency.publishing)
    said = f"a scan takes {median:.3g} s, longer than the scan interval of {now.interval:.3g} s"
    return _health_when(median > now.interval, said)


def _health_long_latency(now: HealthFigures) -> str:
    longest = now.longest_latency(lambda latency: latency.total)
    late = longest > now.options.max_latency
    return _health_when(late, f"a scan was finished {longest:.3g} s after its arrival")


def _health_is_density_judged(now: HealthFigures) -> bool:
    """Whether there are enough scans and detections to judge the density in use."""
    number = max(now.detections, now.clutter_expected)
    return len(now.scans) >= MIN_SCANS and number >= MIN_DETECTIONS


def _health_densities(now: HealthFigures) -> str:
    """The density in use in words, and the density of detections if it can be judged."""
    observed = f", detections have {now.detection_density:.3g}"
    in_use = f"{now.snapshot.clutter_density:.3g} per m^2 in use"
    return in_use + _health_when(_health_is_density_judged(now), observed)


def _health_clutter_contradicted(now: HealthFigures) -> str:
    observed, expected = max(now.detections, 1.0), now.clutter_expected
    differs = max(observed, expected) > CLUTTER_FACTOR * min(observed, expected)
    return _health_when(
        differs and _health_is_density_judged(now), f"clutter density of {_health_densities(now)}"
    )


def _health_mismatches(now: HealthFigures) -> str:
    return "; ".join(
        f"incompatible quality of service on {topic}: not connected"
        for topic in now.connections.mismatches
    )


def _health_detections(now: HealthFigures) -> str:
    every = _health_when(not math.isnan(now.interval), f", a scan every {now.interval:.3g} s")
    return f"{now.snapshot.totals.detections} detections{every}"


def _health_own_ship(now: HealthFigures) -> str:
    source = now.snapshot.own_ship_source
    if source == "none":
        return "not needed: the sensor does not move"
    return f"own-ship data from {source}"


def _health_initiation_values(now: HealthFigures) -> Mapping[str, object]:
    snapshot = now.snapshot
    return {
        **dataclasses.asdict(snapshot.totals),
        "potential_tracks": snapshot.potential_tracks,
        "potential_tracks_most": snapshot.totals.potential_tracks,
        "tracks": snapshot.tracks,
        **{f"tracks.{state}": number for state, number in snapshot.states.items()},
        **{f"ended.{reason}": number for reason, number in sorted(snapshot.ends.items())},
        "fixed_echoes": snapshot.fixed_echoes,
        "detection_probability": snapshot.detection_probability,
        "detection_probability_estimated": snapshot.detection_probability_estimated,
        **now.dropped_of(INITIATION),
    }


def _health_detections_values(now: HealthFigures) -> Mapping[str, object]:
    return {
        "received": now.snapshot.totals.detections,
        "dropped_share": now.dropped_share,
        "scan_interval_s": now.interval,
        "scan_period_expected_s": now.period,
        "since_last_scan_s": now.since_scan,
        "intensity": now.snapshot.intensity,
        "sweep": now.snapshot.sweep,
        "sweep_latency_ms": 1e3 * now.snapshot.sweep_latency,
        **now.dropped_of(DETECTIONS),
    }


def _health_own_ship_values(now: HealthFigures) -> Mapping[str, object]:
    if now.snapshot.own_ship_source == "none":
        return {"source": "none"}
    return {
        "source": now.snapshot.own_ship_source,
        "mounting": now.snapshot.mounting,
        "mounting_yaw": now.snapshot.mounting_yaw,
        "age_s": now.since_own_ship,
        "behind_newest_scan_s": now.own_ship_behind,
        "waiting_for_own_ship": now.snapshot.waiting,
        **now.dropped_of(OWN_SHIP),
    }


def _health_latency_values(now: HealthFigures) -> Mapping[str, object]:
    last = now.scans[-1].latency if now.scans else LatencyFigures()
    seconds = {
        "latency": last.to_tracks,
        "latency_all": last.to_all,
        "waiting": last.waiting,
        "core": last.core,
        "publishing": last.publishing,
        "total_most": now.longest_latency(lambda latency: latency.total),
        "waiting_most": now.longest_latency(lambda latency: latency.waiting),
        "core_most": now.longest_latency(lambda latency: latency.core),
        "publishing_most": now.longest_latency(lambda latency: latency.publishing),
    }
    return {f"{name}_ms": 1e3 * value for name, value in seconds.items()}


def _health_sensor_values(now: HealthFigures) -> Mapping[str, object]:
    learned = now.snapshot.sensor_figures
    values: dict[str, object] = {
        **{name: getattr(learned.sensor, name) for name in COVERAGE},
        "confirmed_tracks": learned.confirmed,
        "confirmed_tracks_within_s": learned.duration,
    }
    for prefix, source, names in (
        ("seen", learned.seen, COVERAGE),
        ("fitted", learned.errors, ("range_std", "range_std_fraction", "azimuth_std")),
    ):
        if source is not None:
            values |= {f"{prefix}_{name}": getattr(source, name) for name in names}
    return values


def _health_quality_values(now: HealthFigures) -> Mapping[str, object]:
    mismatches = sorted(now.connections.mismatches_heard.items())
    return {
        **{f"topics.{name}": topic for name, topic in now.connections.topics.items()},
        **{f"mismatches.{name}": number for name, number in mismatches},
    }


def _health_sensor_rule(subject: str, condition: str, remedy: str) -> tuple[Rule, ...]:
    def judge(now: HealthFigures) -> str:
        return now.snapshot.sensor_findings.get(subject, "")

    return (Rule(Level.WARN, condition, judge, remedy),)


ENTRIES: dict[str, Entry] = {
    INITIATION: Entry(
        lambda now: (
            f"{now.snapshot.totals.scans} scans, {now.snapshot.totals.confirmed} confirmed tracks"
        ),
        _health_initiation_values,
        (
            (_health_drops_of(INITIATION, Level.ERROR, "See `internal_error` below"),),
            (
                Rule(
                    Level.WARN,
                    "Hypotheses were cut by a limit",
                    lambda now: _health_when(
                        now.recent.cut > 0, f"a limit cut {now.recent.cut} hypotheses"
                    ),
                    "Too many detections for the limits: check the entry `clutter`; raise "
                    "`max_potential_tracks` or `max_scan_time` if computing time is left",
                ),
            ),
        ),
    ),
    DETECTIONS: Entry(
        _health_detections,
        _health_detections_values,
        (
            (
                Rule(
                    Level.ERROR,
                    "Detections are published as a type that the node does not read",
                    health_unread_type,
                    "Restart the node, or set `detections_type`; for images start `sonar_detector`",
                ),
                Rule(
                    Level.WARN,
                    "There is no publisher of detections",
                    lambda now: _health_when(
                        not now.connections.subscribed, "no publisher of detections yet"
                    ),
                    _NO_SCAN,
                ),
                Rule(
                    Level.WARN,
                    "No scan has arrived",
                    lambda now: _health_when(math.isnan(now.since_scan), "no scan yet"),
                    _NO_SCAN,
                ),
                Rule(
                    Level.STALE,
                    "No scan arrives any more",
                    lambda now: _health_when(
                        now.since_scan > now.options.stale_time,
                        f"no scan for {now.since_scan:.3g} s",
                    ),
                    "The driver has stopped",
                    ("stale_time",),
                ),
                Rule(
                    Level.WARN,
                    "The next scan is overdue",
                    _health_scan_overdue,
                    _LOST_PINGS,
                    _PERIOD,
                ),
            ),
            (
                Rule(
                    Level.WARN,
                    "Scans arrive at another rate than expected",
                    _health_scan_rate,
                    _LOST_PINGS,
                    _PERIOD,
                ),
                Rule(
                    Level.WARN,
                    "There are gaps between scans",
                    _health_scan_gaps,
                    _LOST_PINGS,
                    _PERIOD,
                ),
            ),
            (
                Rule(
                    Level.WARN,
                    "The node's clock, which is simulated, stands still",
                    lambda now: now.connections.clock_fault,
                    "Publish /clock, or set `use_sim_time` to false",
                ),
            ),
            (_health_drops_of(DETECTIONS, Level.WARN, _SEE_REASONS),),
            (
                Rule(
                    Level.ERROR,
                    "Every detection is dropped",
                    lambda now: _health_when(
                        now.dropped_share == 1.0, _health_detections_dropped(now)
                    ),
                    _EMPTY_RAYS,
                    ("max_dropped_share",),
                ),
                Rule(
                    Level.WARN,
                    "Too many detections are dropped one by one",
                    _health_detections_dropped,
                    _EMPTY_RAYS,
                    ("max_dropped_share",),
                ),
            ),
        ),
    ),
    OWN_SHIP: Entry(
        _health_own_ship,
        _health_own_ship_values,
        (
            (
                Rule(
                    Level.WARN,
                    "Odometry is published, but `own_ship_source` is none",
                    _health_own_ship_unused,
                    "Set `own_ship_source` to odometry if the sonar moves",
                ),
            ),
            (
                Rule(
                    Level.WARN,
                    "Echoes of what stands do not fall together in the fixed frame",
                    lambda now: now.snapshot.registration,
                    "As the sentence says",
                ),
            ),
            (
                Rule(
                    Level.WARN,
                    "The heading stays equal to the last bit while the course turns",
                    lambda now: now.snapshot.own_ship_finding,
                    "Check the compass",
                ),
            ),
            (
                Rule(
                    Level.WARN,
                    "Own-ship data that is used was dropped, or scans were dropped for lack of it",
                    lambda now: _health_when(
                        now.snapshot.own_ship_source != "none",
                        _health_dropped(now.recent_drops(OWN_SHIP)),
                    ),
                    _NAVIGATION,
                ),
            ),
            (
                Rule(
                    Level.WARN,
                    "No own-ship data has arrived",
                    lambda now: _health_of_odometry(
                        now, math.isnan(now.since_own_ship), "no own-ship data yet"
                    ),
                    _NAVIGATION,
                ),
                Rule(
                    Level.STALE,
                    "Own-ship data has stopped",
                    lambda now: _health_no_own_ship(now, now.options.stale_time),
                    "The navigation has stopped; scans of a moving vessel are dropped",
                    ("stale_time",),
                ),
                Rule(
                    Level.WARN,
                    "Own-ship data is too old now",
                    lambda now: _health_no_own_ship(now, now.options.max_own_ship_age),
                    _NAVIGATION,
                    ("max_own_ship_age",),
                ),
                Rule(
                    Level.WARN,
                    "Own-ship data is too old at the newest scan",
                    _health_own_ship_behind,
                    _NAVIGATION,
                    ("max_own_ship_age",),
                ),
            ),
        ),
    ),
    LATENCY: Entry(
        lambda now: f"at most {1e3 * now.longest_latency(lambda latency: latency.total):.3g} ms",
        _health_latency_values,
        (
            (
                Rule(
                    Level.ERROR,
                    "Processing and publishing take longer than the scan interval, in the median "
                    "of the window",
                    _health_overload,
                    "The node cannot keep up: raise the sonar's detection threshold, or reduce "
                    "`max_potential_tracks` and `max_scan_time`",
                ),
            ),
            (
                Rule(
                    Level.WARN,
                    "A scan was finished too late after its arrival",
                    _health_long_latency,
                    "`waiting`: own-ship data arrives late. `core`: see `clutter`. `publishing`: "
                    "reduce the subscribers to markers",
                    ("max_latency",),
                ),
            ),
        ),
    ),
    CLUTTER: Entry(
        _health_densities,
        lambda now: {
            "clutter_density": now.snapshot.clutter_density,
            "detection_density": now.detection_density,
        },
        (
            (
                Rule(
                    Level.WARN,
                    "The density of the last detections differs from the clutter density in use "
                    f"by a factor of {CLUTTER_FACTOR:g}",
                    _health_clutter_contradicted,
                    "Set `clutter_density` to estimated, or `sensor.clutter_density` to "
                    "`detection_density`. Too low a value causes false tracks, too high a "
                    "value prevents tracks. Check `sensor.max_range` and the sector too: the "
                    "density refers to that coverage",
                ),
            ),
            (
                Rule(
                    Level.WARN,
                    "`learned_file` is not used",
                    lambda now: now.connections.file_fault,
                    "Give another path, or move the file",
                ),
            ),
        ),
    ),
    SENSOR: Entry(
        lambda now: "nothing speaks against them",
        _health_sensor_values,
        (
            _health_sensor_rule(
                "coverage",
                "All detections fall in less than half of the coverage as given",
                "Set the parameters that the message names. The density and the threshold already "
                "refer to where detections fall; tracks are still predicted over the whole "
                "coverage as given",
            ),
            _health_sensor_rule(
                "coverage_too_small",
                "More than 5 % of the detections are outside the coverage",
                "Set the parameters that the message names; nothing if the coverage is limited on "
                "purpose",
            ),
            _health_sensor_rule(
                "errors",
                "The errors of the detections of confirmed tracks differ from the given errors by "
                "more than a factor of 1.5",
                "Set the parameters that the message names: errors that are too small lose "
                "targets, errors that are too large delay tracks and admit false tracks",
            ),
            _health_sensor_rule(
                "confirmations",
                "At least 30 tracks were confirmed within an hour, more than ten times the target "
                "false-track rate",
                "See docs/watch_and_operate.md, too many tracks: objects that stand still, several "
                "detections per target, clumped clutter",
            ),
        ),
    ),
    QUALITY_OF_SERVICE: Entry(
        lambda now: "all connections are compatible",
        _health_quality_values,
        (
            (
                Rule(
                    Level.ERROR,
                    "A publisher or subscriber has an incompatible quality of service",
                    _health_mismatches,
                    "The message names the topic: set the reliability and durability of the other "
                    "side as in docs/topics.md, or set `detections_reliability`",
                ),
            ),
        ),
    ),
    TRACKER: Entry(
        lambda now: {"none": "no report yet", "alive": "reports arrive"}.get(
            now.snapshot.tracker, ""
        ),
        lambda now: {"tracker": now.snapshot.tracker, **now.dropped_of(TRACKER)},
        (
            (_health_drops_of(TRACKER, Level.WARN, _SEE_REASONS),),
            (
                Rule(
                    Level.WARN,
                    "The downstream tracker has stopped reporting",
                    lambda now: _health_when(
                        now.snapshot.tracker == "silent", "the downstream tracker is silent"
                    ),
                    "The node maintains the tracker's tracks; restart the tracker",
                ),
            ),
        ),
    ),
    LAND: Entry(
        lambda now: (
            f"detections on {now.snapshot.land_area:.3g} m^2 are left out"
            if now.snapshot.land_area
            else "no land is charted"
        ),
        lambda now: {
            "land_area_m2": now.snapshot.land_area,
            "on_land": now.snapshot.totals.on_land,
            **now.dropped_of(LAND),
        },
        ((_health_drops_of(LAND, Level.WARN, _SEE_REASONS),),),
    ),
}
"""Every entry by its task, in the order of publication."""


def health_status(task: str, entry: Entry, now: HealthFigures) -> Status:
    """Return the status of an entry: the sentences of its rules that apply, the worst first."""
    sentences: list[tuple[Level, str]] = []
    for alternatives in entry.rules:
        judged = ((rule.level, rule.judge(now)) for rule in alternatives)
        sentences += [(level, sentence) for level, sentence in judged if sentence][:1]
    sentences = sorted(sentences, key=lambda judgement: -judgement[0]) or [
        (Level.OK, entry.healthy(now))
    ]
    message = "; ".join(sentence for _, sentence in sentences)
    return Status(task, sentences[0][0], message, entry.values(now))


class Health:
    """Records the history of a session for its diagnostics.

    Parameters
    ----------
    options : DiagnosticsOptions

    Attributes
    ----------
    options : DiagnosticsOptions
        May be replaced at any time.
    scans : deque of ScanRecord
        The processed scans of the window, and the last `LAST_SCANS` of any age.
    """

    def __init__(self, options: DiagnosticsOptions) -> None:
        self.options = options
        self.reset()

    def reset(self) -> None:
        """Discard the history."""
        self.scans: deque[ScanRecord] = deque(maxlen=MAX_RECORDS)
        self._arrivals: deque[tuple[float, float]] = deque(maxlen=MAX_RECORDS)
        self._heard: dict[str, Now] = {}
        self._counts: deque[tuple[float, CountFigures]] = deque()

    def heard(self, task: str, now: Now) -> None:
        """Record the time of an arrival of data for a task, `DETECTIONS` or `OWN_SHIP`."""
        self._heard[task] = now

    def arrived(self, stamp: float, now: Now) -> None:
        """Record the stamp (s) of an arriving scan, processed or not."""
        self._remember(self._arrivals, (_first_health(now), stamp))

    def processed(self, detections: int, latency: LatencyFigures, now: Now) -> None:
        """Record a processed scan."""
        self._remember(self.scans, ScanRecord(_first_health(now), detections, latency))

    def report(
        self, snapshot: SessionSnapshot, now: Now, connections: Connections = NO_CONNECTIONS
    ) -> list[Status]:
        """Return the status of every task.

        Parameters
        ----------
        snapshot : SessionSnapshot
        now : float or tuple of float
            Time on the clocks of `heard` and `processed`, s. The first clock measures the window.
        connections : Connections, optional

        Returns
        -------
        list of Status
        """
        figures = HealthFigures(
            options=self.options,
            snapshot=snapshot,
            connections=connections,
            recent=self._recent(CountFigures.of(snapshot), _first_health(now)),
            scans=tuple(self.scans),
            arrivals=tuple(self._arrivals),
            since_scan=self._since(DETECTIONS, now),
            since_own_ship=self._since(OWN_SHIP, now),
            time=_first_health(now),
        )
        statuses = [health_status(task, entry, figures) for task, entry in ENTRIES.items()]
        return [overall(statuses), *statuses]

    def _remember(self, records: deque[Any], newest: tuple[Any, ...]) -> None:
        """Add a record; forget those before the window, except the last `LAST_SCANS` of all."""
        records.append(newest)
        while len(records) > LAST_SCANS and records[0][0] < newest[0] - self.options.window:
            records.popleft()

    def _since(self, task: str, now: Now) -> float:
        return input_waited(self._heard[task], now) if task in self._heard else math.nan

    def _recent(self, counts: CountFigures, time: float) -> CountFigures:
        """Record the present counts and return the counts since the beginning of the window."""
        begin = time - self.options.window
        while len(self._counts) > 1 and self._counts[1][0] <= begin:
            self._counts.popleft()
        at_begin = self._counts and self._counts[0][0] <= begin
        before = self._counts[0][1] if at_begin else CountFigures()
        self._counts.append((time, counts))
        return counts - before


def _first_health(now: Now) -> float:
    return now[0] if isinstance(now, tuple) else now
