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

An entry has its figures, its message while healthy, and its rules, see `input_health`.
docs/diagnostics.md lists them. `Health` has the history behind them.
"""

from __future__ import annotations

import dataclasses
import math
import statistics
from collections import deque
from collections.abc import Callable, Collection, Mapping
from typing import Any

from tsepm_ros.diagnostics.health_figures import (
    LAST_SCANS,
    MAX_RECORDS,
    Connections,
    HealthFigures,
    InputFigures,
    LatencyFigures,
    Level,
    ScanRecord,
    Status,
    overall,
)
from tsepm_ros.diagnostics.input_health import (
    CHECK_NAVIGATION,
    NO_CONNECTIONS,
    Entry,
    Judgement,
    NodeHealth,
    Rule,
    finding,
    first_clock,
    said_behind,
    said_dropped,
    said_gaps,
    said_nothing_yet,
    said_overdue,
    said_silence,
    said_stale,
    said_unread_type,
    said_when,
    status_of,
)
from tsepm_ros.session.drop_reasons import (
    DETECTIONS,
    INITIATION,
    LAND,
    OWN_SHIP,
    TRACKER,
)
from tsepm_ros.session.inputs import Now
from tsepm_ros.session.session import SessionSnapshot
from tsepm_ros.settings.node_options import DiagnosticsOptions

LATENCY, CLUTTER, QUALITY_OF_SERVICE = "latency", "clutter", "quality of service"
SENSOR = "sensor parameters"
"""Entries without drops."""
OF_EACH_SENSOR = (DETECTIONS, SENSOR)
"""Entries that there are once for each of several sensors."""
COVERAGE = ("min_range", "max_range", "azimuth_min", "azimuth_max")
MIN_SCANS = 5
"""Minimum number of scans for a judgement of the density of detections."""
CLUTTER_FACTOR = 3.0
"""Largest factor between the density of detections and the clutter density in use: a choice."""
MIN_DETECTIONS = 20.0
"""Minimum number of detections, expected or observed, for that judgement."""

MIN_EMPTY_TIME, MIN_MISSED = 10.0, 28.0
"""Least time without a detection, s, and least clutter missed in it, detections, that are said:
with half of that clutter, chance would leave it out once in a million."""

_SEE_REASONS = "See the reasons below"
_NO_SCAN = "Check the topic and its type: `ros2 topic info -v`; remap `detections`"
_LOST_PINGS = "Check the driver and the network; leave `scan_period` at 0 where the period varies"
_PERIOD = ("scan_period", "scan_period_factor")
_EMPTY_RAYS = (
    "See the reasons below; if a sensor marks empty rays in its own way, raise `max_dropped_share`"
)
_CUT = "hypotheses cut"


def _drops_of(task: str, level: Level, remedy: str) -> Rule:
    """The rule of a task's drops, except those of single detections."""
    return Rule(
        level,
        "Input of this entry was dropped",
        lambda now: said_dropped(now.recent_drops(task), now.connections),
        remedy,
    )


def _scan_rate(now: HealthFigures) -> str:
    interval, period, factor = now.interval, now.period, now.options.scan_period_factor
    differs = interval > factor * period or interval * factor < period
    return said_when(differs, f"a scan every {interval:.3g} s, expected is {period:.3g} s")


def _empty_scans(now: HealthFigures) -> str:
    said = (
        f"no detection in the last {now.empty} scans ({now.empty_time:.3g} s), where clutter gave "
        f"{now.usual:.2g} a scan: is the transducer or the receiver dead or out of the water, was "
        "its gain or threshold changed, or does nothing return an echo here?"
    )
    missed = now.empty * now.usual >= MIN_MISSED and now.empty_time >= MIN_EMPTY_TIME
    explained = now.recent_drops(DETECTIONS, of_detections=True)
    return said_when(missed and not explained, said)


def _detections_dropped(now: HealthFigures) -> str:
    share = now.dropped_share
    drops = said_dropped(now.recent_drops(DETECTIONS, of_detections=True))
    return said_when(
        share > now.options.max_dropped_share, f"{100 * share:.3g} % of the detections {drops}"
    )


def health_unused_own_ship(topic: str) -> str:
    """Return the sentence for own-ship data that is published on a topic and not used."""
    return (
        f"odometry is published on {topic}, but own_ship_source is none: the sensor is assumed "
        "not to move"
    )


def _own_ship_unused(now: HealthFigures) -> str:
    topic = now.connections.unused_own_ship
    return said_when(
        bool(topic) and now.snapshot.own_ship_source == "none", health_unused_own_ship(topic)
    )


def _of_odometry(judge: Callable[[InputFigures], str]) -> Judgement:
    """A judgement of odometry alone: data from tf is looked up when it is needed."""

    def judged(now: HealthFigures) -> str:
        return judge(now.own_ship) if now.snapshot.own_ship_source == "odometry" else ""

    return judged


def _overload(now: HealthFigures) -> str:
    median = now.median_latency(lambda latency: latency.core + latency.publishing)
    interval = now.interval if math.isnan(now.every) else now.every
    return said_when(
        median > interval,
        f"a scan takes {median:.3g} s, longer than the scan interval of {interval:.3g} s",
    )


def _long_latency(now: HealthFigures) -> str:
    longest = now.longest_latency("total")
    late = [one.time for one in now.scans if one.latency.total > now.options.max_latency]
    return said_when(
        now.goes_on(late),
        f"a scan was finished {longest:.3g} s after its arrival"
        + f"; from stamp to arrival: {now.values.get('latencies')}" * ("latencies" in now.values),
    )


def _is_density_judged(now: HealthFigures) -> bool:
    """Whether there are enough scans and detections to judge the density in use."""
    number = max(now.detections, now.clutter_expected)
    return len(now.scans) >= MIN_SCANS and number >= MIN_DETECTIONS


def _densities(now: HealthFigures) -> str:
    """The density in use in words, and the density of detections if it can be judged."""
    observed = f", detections have {now.detection_density:.3g}"
    judged = said_when(_is_density_judged(now), observed)
    return f"{now.snapshot.clutter_density:.3g} per m^2 in use{judged}"


def _clutter_contradicted(now: HealthFigures) -> str:
    observed, expected = max(now.detections, 1.0), now.clutter_expected
    differs = max(observed, expected) > CLUTTER_FACTOR * min(observed, expected)
    return said_when(
        differs and now.snapshot.clutter_given and _is_density_judged(now),
        f"clutter density of {_densities(now)}",
    )


def _mismatches(now: HealthFigures) -> str:
    return "; ".join(
        f"incompatible quality of service on {topic}: not connected"
        for topic in now.connections.mismatches
    )


def _detections(now: HealthFigures) -> str:
    every = said_when(not math.isnan(now.interval), f", a scan every {now.interval:.3g} s")
    return f"{now.snapshot.totals.detections} detections{every}"


def _own_ship(now: HealthFigures) -> str:
    source, at_rest = now.snapshot.own_ship_source, "not needed: the sensor does not move"
    return at_rest if source == "none" else f"own-ship data from {source}"


def _initiation_values(now: HealthFigures) -> Mapping[str, object]:
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
        **now.values,
        **now.dropped_of(INITIATION),
    }


def _detections_values(now: HealthFigures) -> Mapping[str, object]:
    return {
        "received": now.snapshot.totals.detections,
        "dropped_share": now.dropped_share,
        "scan_interval_s": now.interval,
        "scan_period_expected_s": now.period,
        "since_last_scan_s": now.since,
        "intensity": now.snapshot.intensity,
        "no_detections": _empty_scans(now).partition(":")[0],
        "sweep": now.snapshot.sweep,
        "sweep_latency_ms": 1e3 * now.snapshot.sweep_latency,
        **now.values,
        **now.dropped_of(DETECTIONS),
    }


def _own_ship_values(now: HealthFigures) -> Mapping[str, object]:
    if now.snapshot.own_ship_source == "none":
        return {"source": "none"}
    return {
        "source": now.snapshot.own_ship_source,
        "mounting": now.snapshot.mounting,
        "mounting_yaw": now.snapshot.mounting_yaw,
        "age_s": now.own_ship.since,
        "behind_newest_scan_s": now.own_ship.behind,
        "waiting_for_own_ship": now.snapshot.waiting,
        **now.dropped_of(OWN_SHIP),
    }


def _latency_values(now: HealthFigures) -> Mapping[str, object]:
    last = now.scans[-1].latency if now.scans else LatencyFigures()
    seconds = {
        "latency": last.to_tracks,
        "latency_all": last.to_all,
        "waiting": last.waiting,
        "core": last.core,
        "publishing": last.publishing,
        "total_most": now.longest_latency("total"),
        "waiting_most": now.longest_latency("waiting"),
        "core_most": now.longest_latency("core"),
        "publishing_most": now.longest_latency("publishing"),
    }
    return {f"{name}_ms": 1e3 * value for name, value in seconds.items()}


def _sensor_values(now: HealthFigures) -> Mapping[str, object]:
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


def _quality_values(now: HealthFigures) -> Mapping[str, object]:
    mismatches = sorted(now.connections.mismatches_heard.items())
    return {
        **{f"topics.{name}": topic for name, topic in now.connections.topics.items()},
        **{f"mismatches.{name}": number for name, number in mismatches},
    }


ENTRIES: dict[str, Entry] = {
    INITIATION: Entry(
        lambda now: (
            f"{now.snapshot.totals.scans} scans, {now.snapshot.totals.confirmed} confirmed tracks"
        ),
        _initiation_values,
        (
            (_drops_of(INITIATION, Level.ERROR, "See `internal_error` below"),),
            (
                Rule(
                    Level.WARN,
                    "No scan could be used",
                    lambda now: said_when(
                        not now.snapshot.totals.scans and now.late.total() > 0,
                        "none of the scans so far could be used",
                    ),
                    "The log says why",
                ),
            ),
            (
                Rule(
                    Level.WARN,
                    "Hypotheses were cut by a limit",
                    lambda now: said_when(now.cut > 0, f"a limit cut {now.cut} hypotheses"),
                    "Check the entry `clutter`; raise `max_potential_tracks` or `max_scan_time` "
                    "if computing time is left",
                ),
            ),
        ),
    ),
    DETECTIONS: Entry(
        _detections,
        _detections_values,
        (
            (
                Rule(
                    Level.ERROR,
                    "Detections are published as a type that the node does not read",
                    said_unread_type,
                    "Restart the node, or set `detections_type`; for images start `sonar_detector`",
                ),
                Rule(
                    Level.WARN,
                    "No scan has arrived, or there is no publisher",
                    said_nothing_yet,
                    _NO_SCAN,
                ),
                Rule(
                    Level.STALE,
                    "No scan arrives any more",
                    said_stale,
                    "The driver has stopped",
                    ("stale_time",),
                ),
                Rule(
                    Level.WARN,
                    "The next scan is overdue",
                    said_overdue,
                    _LOST_PINGS,
                    _PERIOD,
                ),
            ),
            (
                Rule(
                    Level.WARN,
                    "Scans are empty for 10 s or more where clutter was learned",
                    _empty_scans,
                    "Check that the sonar still pings and hears; none if no echo is possible here",
                ),
            ),
            (
                Rule(
                    Level.WARN,
                    "Scans arrive at another rate than expected",
                    _scan_rate,
                    _LOST_PINGS,
                    _PERIOD,
                ),
                Rule(
                    Level.WARN,
                    "There are gaps between scans",
                    said_gaps,
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
            (_drops_of(DETECTIONS, Level.WARN, _SEE_REASONS),),
            finding(
                "late",
                "With several sensors, the scans of one arrive after others stopped waiting",
                "Raise `max_wait`, or compare the clocks of the sensors",
            ),
            (
                Rule(
                    Level.ERROR,
                    "Every detection is dropped",
                    lambda now: said_when(now.dropped_share == 1.0, _detections_dropped(now)),
                    _EMPTY_RAYS,
                    ("max_dropped_share",),
                ),
                Rule(
                    Level.WARN,
                    "Too many detections are dropped one by one",
                    _detections_dropped,
                    _EMPTY_RAYS,
                    ("max_dropped_share",),
                ),
            ),
        ),
    ),
    OWN_SHIP: Entry(
        _own_ship,
        _own_ship_values,
        (
            (
                Rule(
                    Level.WARN,
                    "Odometry is published, but `own_ship_source` is none",
                    _own_ship_unused,
                    "Set `own_ship_source` to odometry if the sonar moves",
                ),
            ),
            finding(
                "registration",
                "Echoes of fixed objects do not stay in place in the fixed frame",
                "As the message says",
            ),
            finding(
                "own_ship_frozen",
                "Heading or position is the same to the last bit on the way",
                "Check its source",
            ),
            finding(
                "own_ship_error",
                "Own ship's stated error hides all motion",
                "As the message says",
            ),
            (
                Rule(
                    Level.WARN,
                    "Own-ship data was dropped, or scans were dropped for lack of it",
                    lambda now: said_when(
                        now.snapshot.own_ship_source != "none",
                        said_dropped(now.recent_drops(OWN_SHIP), now.own_ship.connections),
                    ),
                    CHECK_NAVIGATION,
                ),
            ),
            (
                Rule(
                    Level.WARN,
                    "No own-ship data has arrived",
                    _of_odometry(said_nothing_yet),
                    CHECK_NAVIGATION,
                ),
                Rule(
                    Level.STALE,
                    "Own-ship data has stopped",
                    _of_odometry(said_stale),
                    "The navigation has stopped",
                    ("stale_time",),
                ),
                Rule(
                    Level.WARN,
                    "Own-ship data is too old now",
                    _of_odometry(lambda own: said_silence(own, own.options.max_own_ship_age)),
                    CHECK_NAVIGATION,
                    ("max_own_ship_age",),
                ),
                Rule(
                    Level.WARN,
                    "Own-ship data is too old at the newest scan",
                    _of_odometry(said_behind),
                    CHECK_NAVIGATION,
                    ("max_own_ship_age",),
                ),
            ),
        ),
    ),
    LATENCY: Entry(
        lambda now: f"at most {1e3 * now.longest_latency('total'):.3g} ms",
        _latency_values,
        (
            (
                Rule(
                    Level.ERROR,
                    "Processing and publishing take longer than the scan interval, in the median "
                    "of the window",
                    _overload,
                    "Raise the sonar's detection threshold, or reduce `max_potential_tracks` and "
                    "`max_scan_time`",
                ),
            ),
            (
                Rule(
                    Level.WARN,
                    "A scan was finished too late after its arrival",
                    _long_latency,
                    "`waiting`: own-ship data, or scans of another sensor (`max_wait`), arrive "
                    "late. `core`: see `clutter`. `publishing`: reduce the subscribers to markers",
                    ("max_latency",),
                ),
            ),
        ),
    ),
    CLUTTER: Entry(
        _densities,
        lambda now: {
            "clutter_density": now.snapshot.clutter_density,
            "detection_density": now.detection_density,
        },
        (
            (
                Rule(
                    Level.WARN,
                    "The density of the last detections differs from the given clutter density "
                    f"by a factor of {CLUTTER_FACTOR:g}",
                    _clutter_contradicted,
                    "Set `clutter_density` to estimated, or `sensor.clutter_density` to "
                    "`detection_density`. Check the coverage, to which it refers",
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
        lambda now: "; mounting ".join(
            filter(None, ["nothing speaks against them", str(now.values.get("alignment", ""))])
        ),
        _sensor_values,
        (
            finding(
                "coverage",
                "All detections lie in less than half of the given coverage",
                "Set the parameters that the message names",
            ),
            finding(
                "coverage_too_small",
                "More than 5 % of the detections of 100 pings are outside the coverage",
                "Set the parameters that the message names; nothing if the coverage is limited on "
                "purpose",
            ),
            finding(
                "errors",
                "The errors of the detections of confirmed tracks differ from the given errors by "
                "more than a factor of 1.5",
                "Set the parameters that the message names: too small errors lose targets, too "
                "large errors delay tracks",
            ),
            finding(
                "misalignment",
                "With several sensors, detections of the same targets differ between sensors by "
                "more than their errors",
                "As the message says",
            ),
            finding(
                "confirmations",
                "At least 30 tracks were confirmed within an hour, more than ten times the target "
                "false-track rate",
                "See docs/watch_and_operate.md, too many tracks",
            ),
        ),
    ),
    QUALITY_OF_SERVICE: Entry(
        lambda now: "all connections are compatible",
        _quality_values,
        (
            (
                Rule(
                    Level.ERROR,
                    "A publisher or subscriber has an incompatible quality of service",
                    _mismatches,
                    "Set the reliability and durability of the other side as in docs/topics.md, "
                    "or `detections_reliability`",
                ),
            ),
        ),
    ),
    TRACKER: Entry(
        lambda now: (
            "no report yet"
            if now.snapshot.tracker == "none"
            else f"the last report is of {abs(now.snapshot.tracker_lag):.3g} s "
            f"{'before' if now.snapshot.tracker_lag >= 0.0 else 'after'} the last scan"
        ),
        lambda now: {
            "tracker": now.snapshot.tracker,
            "report_lag_s": now.snapshot.tracker_lag,
            **now.dropped_of(TRACKER),
        },
        (
            (_drops_of(TRACKER, Level.WARN, _SEE_REASONS),),
            (
                Rule(
                    Level.WARN,
                    "The downstream tracker has stopped reporting",
                    lambda now: said_when(
                        now.snapshot.tracker == "silent"
                        or math.inf > now.snapshot.tracker_silence > now.options.stale_time,
                        "the downstream tracker is silent: no report for "
                        f"{now.snapshot.tracker_lag:.3g} s",
                    ),
                    "Restart the tracker; after `tracked_timeout` this node maintains its tracks",
                    ("stale_time",),
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
        ((_drops_of(LAND, Level.WARN, _SEE_REASONS),),),
    ),
}
"""Every entry by its task, in the order of publication."""


class Health(NodeHealth):
    """Records the history of a session for its diagnostics.

    Parameters
    ----------
    options : DiagnosticsOptions
    noun : str, optional
        A scan, in words.

    Attributes
    ----------
    scans : deque of ScanRecord
        The processed scans of the window, and the last `LAST_SCANS` of any age.
    """

    def __init__(self, options: DiagnosticsOptions, noun: str = "scan") -> None:
        super().__init__({DETECTIONS: noun, OWN_SHIP: "own-ship data"}, options)

    def reset(self) -> None:
        """Discard the history."""
        super().reset()
        self.scans: deque[ScanRecord] = deque(maxlen=MAX_RECORDS)
        self._empty, self._filled, self._usual = 0, math.nan, 0.0

    def processed(self, detections: int, latency: LatencyFigures, now: Now) -> None:
        """Record a processed scan."""
        time = first_clock(now)
        self.remember(self.scans, ScanRecord(time, detections, latency))
        self._empty = 0 if detections else self._empty + 1
        self._filled = time if detections else self._filled

    def report(
        self,
        snapshot: SessionSnapshot,
        now: Now,
        connections: Connections = NO_CONNECTIONS,
        own_ship: Connections = NO_CONNECTIONS,
    ) -> list[Status]:
        """Return the status of every task, and of all; see `judge`."""
        statuses = self.judge(snapshot, now, connections, own_ship)
        return [overall(statuses), *statuses]

    def judge(
        self,
        snapshot: SessionSnapshot,
        now: Now,
        connections: Connections = NO_CONNECTIONS,
        own_ship: Connections = NO_CONNECTIONS,
        tasks: Collection[str] = ENTRIES.keys(),
        sensor: str = "",
        **more: Any,
    ) -> list[Status]:
        """Return the status of tasks, each with the name of a sensor in front, if it has a name.

        Parameters
        ----------
        snapshot : SessionSnapshot
        now : float or tuple of float
            Time on the clocks of `heard` and `processed`, s. The first clock measures the window.
        connections, own_ship : Connections, optional
            Of the detections, and of own-ship data.
        tasks : collection of str, optional
        sensor : str, optional
        **more
            Further arguments of `HealthFigures`.

        Returns
        -------
        list of Status
        """
        scan, own = snapshot.scan_stamp, snapshot.own_ship_stamp
        if self.scans and not self._empty:
            observed = statistics.mean([one.detections for one in self.scans][-LAST_SCANS:])
            self._usual = min(observed, snapshot.clutter_density * snapshot.coverage_area)
        given = self.figures(DETECTIONS, now, connections)
        interval = InputFigures(**given).interval
        totals = snapshot.totals
        cut = {_CUT: totals.cut_potential_tracks + totals.cut_confirmations}
        late = self.late({**snapshot.dropped, **cut}, now, interval)
        behind = math.nan if scan is None or own is None else scan - own
        figures = HealthFigures(
            **given,
            dropped=snapshot.dropped,
            cut=late.pop(_CUT, 0),
            late=late,
            findings=snapshot.findings,
            snapshot=snapshot,
            scans=tuple(self.scans),
            empty=self._empty,
            empty_time=first_clock(now) - self._filled,
            usual=self._usual,
            own_ship=InputFigures(**self.figures(OWN_SHIP, now, own_ship, behind=behind)),
            **more,
        )
        front = f"{sensor}/" if sensor else ""
        return [status_of(front + task, ENTRIES[task], figures) for task in tasks]
