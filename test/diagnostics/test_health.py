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
"""Levels, sentences and figures of every task, and the page that says what to do."""

import dataclasses
import math
from pathlib import Path

import pytest

from tsepm_ros.diagnostics.health import ENTRIES, SENSOR, Health
from tsepm_ros.diagnostics.health_figures import (
    MAX_RECORDS,
    Connections,
    LatencyFigures,
    Level,
    Status,
)
from tsepm_ros.diagnostics.input_health import INPUTS
from tsepm_ros.parameters import parameter_table
from tsepm_ros.session.consistency_checks import SensorFigures
from tsepm_ros.session.drop_reasons import DETECTIONS, OWN_SHIP
from tsepm_ros.session.inputs import input_waited
from tsepm_ros.session.session import SessionSnapshot
from tsepm_ros.settings.node_options import DiagnosticsOptions
from tsepm_ros.tracker.clutter.density import ClutterExtent
from tsepm_ros.tracker.clutter.sensor_performance import FittedErrors
from tsepm_ros.tracker.method import ScanStatistics

GOOD = SessionSnapshot(
    totals=ScanStatistics(),
    potential_tracks=0,
    fixed_echoes=2,
    tracks=0,
    dropped={},
    waiting=0,
    detection_probability=0.9,
    detection_probability_estimated=0.8,
    clutter_density=1e-6,
    coverage_area=1e8,
    own_ship_source="none",
    mounting="not needed",
    own_ship_stamp=None,
    scan_stamp=None,
    tracker="none",
)


class Run:
    """A session's health over time, on one clock."""

    def __init__(self, **options: float) -> None:
        self.health = Health(DiagnosticsOptions(**options))
        self.figures = GOOD
        self.connections = Connections()

    def scan(self, time: float, stamp: float | None = None, detections: int = 100, **latency):
        """Process a scan, at once after its arrival."""
        self.health.heard(DETECTIONS, time)
        one = ScanStatistics(scans=1, detections=detections)
        self.figures = dataclasses.replace(self.figures, totals=self.figures.totals + one)
        self.health.arrived(time if stamp is None else stamp, time)
        self.health.processed(detections, LatencyFigures(**latency), time)

    def scans(self, *times: float) -> None:
        for time in times:
            self.scan(time)

    def drop(self, reason: str, number: int = 1) -> None:
        before = self.figures.dropped
        dropped = {**before, reason: before.get(reason, 0) + number}
        self.figures = dataclasses.replace(self.figures, dropped=dropped)

    def set(self, **values: object) -> None:
        self.figures = dataclasses.replace(self.figures, **values)

    def status(self, task: str, time: float) -> Status:
        found = {one.task: one for one in self.health.report(self.figures, time, self.connections)}
        return found[task]

    def said(self, task: str, time: float) -> tuple[Level, str]:
        status = self.status(task, time)
        return status.level, status.message


def test_states_and_ends_of_tracks_are_counted_by_name():
    run = Run()
    run.set(tracks=3, states={"confirmed": 3, "coasting": 2}, ends={"missed": 4, "left": 1})
    values = dict(run.status("track initiation", 0.0).values)
    counts = {name: values[name] for name in values if name.startswith(("tracks", "ended"))}
    assert counts == {
        "tracks": 3,
        "tracks.confirmed": 3,
        "tracks.coasting": 2,
        "ended.left": 1,
        "ended.missed": 4,
    }


def test_a_run_without_faults_is_ok_everywhere():
    run = Run()
    run.set(own_ship_source="odometry", own_ship_stamp=60.0, scan_stamp=60.0)
    for time in range(0, 72, 12):
        run.health.heard(OWN_SHIP, float(time))
        run.scan(float(time))
    levels = {one.task: one.level for one in run.health.report(run.figures, 61.0)}
    assert set(levels.values()) == {Level.OK}
    assert run.said("track initiation", 61.0)[1] == "6 scans, 0 confirmed tracks"
    assert run.said("detections", 61.0)[1] == "600 detections, a scan every 12 s"


def test_that_no_scan_could_be_used_is_said_before_what_else_is_odd():
    run = Run()
    for time in range(6):
        run.health.heard(DETECTIONS, float(time))
        run.health.arrived(time + 9.0 * (time > 3), float(time))  # with a gap
        run.drop("own_ship_stale")
        said = run.said("overall", float(time))
    assert said == (Level.WARN, "track initiation: none of the scans so far could be used")
    run.scan(6.0)
    assert run.status("track initiation", 6.0).level == Level.OK


def test_silence_is_judged_by_the_median_of_the_stamps_then_by_the_stale_time():
    run = Run(stale_time=60.0)
    run.scans(0.0, 12.0, 24.0)
    assert run.status("detections", 24.0 + 24.0).level == Level.OK
    said = (Level.WARN, "no scan for 25 s, expected is one every 12 s")
    assert run.said("detections", 24.0 + 25.0) == said
    assert run.said("detections", 24.0 + 61.0) == (Level.STALE, "no scan for 61 s")


def test_silence_counts_on_the_clock_on_which_it_is_shorter_and_that_was_not_set_back():
    health = Health(DiagnosticsOptions(stale_time=60.0))
    health.heard(DETECTIONS, (0.0, 0.0))
    for now, level in [((100.0, 1.0), Level.OK), ((100.0, 61.0), Level.STALE)]:
        (found,) = (one for one in health.report(GOOD, now) if one.task == "detections")
        assert found.level == level
    assert input_waited((0.0, 0.0), (5.0, 3.0)) == 3.0
    assert input_waited((0.0, 10.0), (5.0, 3.0)) == 5.0
    assert input_waited(10.0, 3.0) == math.inf


@pytest.mark.parametrize(
    ("interval", "level"),
    [(24.0, Level.OK), (24.5, Level.WARN), (6.0, Level.OK), (5.9, Level.WARN)],
)
def test_a_rate_other_than_the_expected_is_a_warning(interval, level):
    run = Run(scan_period=12.0, scan_period_factor=2.0)
    run.scans(*(index * interval for index in range(4)))
    assert run.status("detections", 3 * interval).level == level


def test_a_gap_between_scans_is_a_warning_for_the_window():
    run = Run(window=60.0)
    run.scans(0.0, 12.0, 24.0, 60.0, 72.0)
    said = (Level.WARN, "1 gap between scans longer than 24 s")
    assert run.said("detections", 72.0) == said
    run.scans(84.0, 96.0, 108.0, 120.0)
    assert run.status("detections", 121.0).level == Level.OK
    run.scans(132.0, 168.0, 180.0, 216.0, 228.0)
    said = (Level.WARN, "2 gaps between scans longer than 24 s")
    assert run.said("detections", 228.0) == said


def test_scans_that_arrive_but_are_not_processed_leave_no_gap():
    run = Run()
    run.scans(0.0, 12.0, 24.0)
    for time in (36.0, 48.0, 60.0):  # dropped for lack of own-ship data
        run.health.heard(DETECTIONS, time)
        run.health.arrived(time, time)
    run.scans(72.0, 84.0)
    assert run.said("detections", 84.0) == (Level.OK, "500 detections, a scan every 12 s")


def test_a_drop_warns_while_it_goes_on_and_is_counted_for_good():
    run = Run(window=60.0)
    run.scan(0.0)
    run.status("detections", 1.0)
    run.drop("scan_late", 2)
    run.drop("short_data")
    said = (Level.WARN, "dropped: 2 scan_late, 1 short_data")
    for time in range(2, 5):  # until twice the interval has passed
        run.scan(float(time))
        assert run.said("detections", time) == said
    run.scan(5.0)
    status = run.status("detections", 5.0)
    assert status.level == Level.OK
    assert status.values["dropped.scan_late"] == 2
    run.scans(*map(float, range(6, 13)))
    run.drop("scan_late")
    assert run.said("detections", 12.0) == (Level.WARN, "dropped: 3 scan_late")
    run.scans(*map(float, range(13, 32)))
    assert run.said("detections", 31.0)[0] == Level.WARN, "it comes every 10 s"
    run.scans(32.0, 33.0)
    assert run.said("detections", 33.0)[0] == Level.OK
    run.scans(*map(float, range(34, 101)))
    run.drop("scan_late")
    assert run.said("detections", 100.0) == (Level.WARN, "dropped: 1 scan_late")


@pytest.mark.parametrize(
    ("dropped", "taken", "level"), [(10, 90, Level.OK), (11, 89, Level.WARN), (100, 0, Level.ERROR)]
)
def test_single_detections_are_judged_by_their_share(dropped, taken, level):
    run = Run(max_dropped_share=0.1)
    run.scan(0.0, detections=taken)
    run.drop("range_not_finite", dropped)
    status = run.status("detections", 0.0)
    assert status.level == level
    assert status.values["dropped_share"] == pytest.approx(dropped / 100)
    assert ("range_not_finite" in status.message) == (level > Level.OK)


@pytest.mark.parametrize(
    ("reason", "task", "level"),
    [
        ("own_ship_stale", "own ship", Level.WARN),
        ("tracked_late", "downstream tracker", Level.WARN),
        ("internal_error", "track initiation", Level.ERROR),
        ("short_data", "detections", Level.WARN),
    ],
)
def test_a_drop_stands_in_the_entry_that_it_belongs_to_and_in_no_other(reason, task, level):
    run = Run()
    run.set(own_ship_source="tf")
    run.scan(0.0)
    run.drop(reason)
    found = run.health.report(run.figures, 0.0)
    assert {one.task for one in found if one.level > Level.OK} == {task, "overall"}
    assert found[0].values[f"dropped.{reason}"] == 1, "overall has all"
    (entry,) = (one for one in found[1:] if f"dropped.{reason}" in one.values)
    assert (entry.task, entry.level) == (task, level)


def test_a_limit_that_cut_is_a_warning_for_the_window():
    run = Run(window=60.0)
    run.set(totals=ScanStatistics(scans=1, cut_potential_tracks=2, cut_confirmations=3))
    assert run.said("track initiation", 0.0) == (Level.WARN, "a limit cut 5 hypotheses")
    assert run.status("track initiation", 61.0).level == Level.OK


def test_own_ship_data_that_is_published_and_not_used_is_a_warning_while_it_is():
    run = Run()
    run.connections = Connections(unused_own_ship="/boat/own_ship/odometry")
    level, message = run.said("own ship", 0.0)
    assert level == Level.WARN
    assert "/boat/own_ship/odometry, but own_ship_source is none" in message
    run.set(own_ship_source="tf")
    assert run.said("own ship", 0.0)[0] == Level.OK


def test_a_wrong_registration_is_a_warning_of_own_ship_while_it_is_found():
    run, said = Run(), "own ship is late: give own_ship_delay"
    run.set(own_ship_source="tf", findings={"registration": said})
    assert run.said("own ship", 0.0) == (Level.WARN, said)
    run.set(findings={})
    assert run.said("own ship", 0.0)[0] == Level.OK


def test_the_age_of_own_ship_data_is_judged_now_and_at_the_newest_scan():
    run = Run(max_own_ship_age=3.0, stale_time=60.0)
    run.set(own_ship_source="odometry", own_ship_stamp=100.0, scan_stamp=103.0)
    run.health.heard(OWN_SHIP, 0.0)
    assert run.said("own ship", 3.0) == (Level.OK, "own-ship data from odometry")
    assert run.status("own ship", 3.0).values["mounting"] == "not needed"
    assert run.said("own ship", 4.0) == (Level.WARN, "no own-ship data for 4 s")
    assert run.said("own ship", 61.0) == (Level.STALE, "no own-ship data for 61 s")
    run.health.heard(OWN_SHIP, 61.0)
    run.set(scan_stamp=103.5)
    said = (Level.WARN, "own-ship data is 3.5 s older than the newest scan")
    assert run.said("own ship", 61.0) == said
    assert run.status("own ship", 61.0).values["behind_newest_scan_s"] == 3.5


def test_latency_is_split_and_judged_as_a_whole():
    run = Run(max_latency=1.0, window=60.0)
    run.scan(0.0, waiting=0.7, core=0.2, publishing=0.05, to_tracks=0.24, to_all=0.27)
    run.scan(12.0, waiting=0.8, core=0.2, publishing=0.05, to_tracks=0.24, to_all=0.27)
    status = run.status("latency", 12.0)
    assert (status.level, status.message) == (
        Level.WARN,
        "a scan was finished 1.07 s after its arrival",
    )
    assert {name: round(value) for name, value in status.values.items()} == {
        "latency_ms": 240,
        "latency_all_ms": 270,
        "waiting_ms": 800,
        "core_ms": 200,
        "publishing_ms": 50,
        "total_most_ms": 1070,
        "waiting_most_ms": 800,
        "core_most_ms": 200,
        "publishing_most_ms": 50,
    }
    run.scan(24.0)
    assert run.status("latency", 73.0).level == Level.OK


def test_work_that_takes_longer_than_the_sonar_is_an_error_and_is_said_first_but_one_scan_is_none():
    run = Run(max_latency=1.0)
    for time in (0.0, 2.0, 4.0):
        run.scan(time, core=1.5, publishing=0.6, to_all=2.1)
    level, message = run.said("latency", 4.0)
    assert level == Level.ERROR
    assert message.startswith("a scan takes 2.1 s, longer than the scan interval of 2 s")
    assert message.index("longer than the scan interval") < message.index("after its arrival")
    run = Run()
    for ping in range(10):  # 5 a second, of which one takes 0.6 s
        run.scan(0.2 * ping, core=0.6 if ping == 4 else 0.01)
    assert run.status("latency", 1.8).level == Level.OK


def test_the_overall_entry_has_the_worst_level_and_its_reason():
    run = Run()
    run.scans(0.0, 12.0)
    first, *others = run.health.report(run.figures, 13.0)
    assert (first.task, first.level, first.message) == ("overall", Level.OK, "every entry is OK")
    assert first.values == {one.task: "OK" for one in others}
    run.drop("internal_error")
    run.drop("scan_late")
    first = run.status("overall", 14.0)
    assert (first.level, first.values["detections"]) == (Level.ERROR, "WARN")
    assert first.message == "track initiation: dropped: 1 internal_error"
    assert run.status("detections", 13.0 + 100.0).level == Level.STALE
    assert run.status("overall", 13.0 + 100.0).level != Level.OK


@pytest.mark.parametrize(
    ("detections", "level"), [(33, Level.WARN), (34, Level.OK), (300, Level.OK), (301, Level.WARN)]
)
def test_a_clutter_density_that_detections_contradict_is_a_warning(detections, level):
    run = Run()  # 100 are expected
    for index in range(5):
        assert run.status("clutter", 12.0 * index).level == Level.OK, "too few scans"
        run.scan(12.0 * index, detections=detections)
    status = run.status("clutter", 60.0)
    assert status.level == level
    assert status.values["detection_density"] == pytest.approx(detections / 1e8)
    run.set(clutter_given=False)  # detections of what is followed are not learned as clutter
    assert run.status("clutter", 60.0).level == Level.OK


def test_a_few_detections_say_nothing_of_the_clutter_density():
    run = Run()
    run.set(coverage_area=1e6, clutter_density=1e-8)  # 0.2 are expected in all
    for index in range(19):
        run.scan(12.0 * index, detections=1)
    assert run.status("clutter", 220.0).level == Level.OK
    run.scan(228.0, detections=1)
    assert run.status("clutter", 228.0).level == Level.WARN


@pytest.mark.parametrize(
    ("unread", "readable", "said"),
    [
        ([], [], ""),
        (["a/A"], [], "published as a/A, which the node does not read"),
        (["a/A"], ["a/A"], "published as a/A, which the node reads only after a new start"),
        (["a/A", "b/B"], ["b/B"], "a/A, which the node does not read; and as b/B, which the node"),
    ],
)
def test_types_that_are_read_after_a_new_start_are_told_from_those_that_are_not(
    unread, readable, said
):
    run = Run()
    run.scan(0.0)
    run.connections = Connections(unread=unread, other_readable=readable, subscribed_type="c/C")
    level, message = run.said("detections", 0.0)
    assert level == (Level.ERROR if said else Level.OK)
    assert said in message and ("it has subscribed to c/C" in message) == bool(readable)


def test_learned_sensor_figures_are_reported_once_they_are_known():
    run = Run()
    assert not {"seen_max_range", "fitted_range_std"} & set(run.status(SENSOR, 0.0).values)
    seen = ClutterExtent(20.0, 300.0, -1.0, 1.0)
    errors = FittedErrors(0.0, 0.01, 0.02, 1.0, 1.0, 200.0)
    run.set(sensor_figures=SensorFigures(seen=seen, seen_detections=5, errors=errors, confirmed=3))
    values = run.status(SENSOR, 0.0).values
    assert (values["seen_min_range"], values["seen_max_range"]) == (20.0, 300.0)
    assert (values["seen_azimuth_min"], values["seen_azimuth_max"]) == (-1.0, 1.0)
    assert (values["fitted_range_std"], values["fitted_range_std_fraction"]) == (0.0, 0.01)
    assert (values["fitted_azimuth_std"], values["confirmed_tracks"]) == (0.02, 3)


@pytest.mark.parametrize("subject", ["coverage", "coverage_too_small", "errors", "confirmations"])
def test_what_does_not_fit_the_scans_is_a_warning(subject):
    run = Run()
    run.set(findings={subject: "set it"})
    assert run.said(SENSOR, 0.0) == (Level.WARN, "set it")


def test_scans_that_were_parts_of_turns_set_no_interval_and_their_drops_stay():
    run = Run()
    for k in range(100):
        run.scan(0.02 * k, core=0.05)
    assert run.status("latency", 2.0).level == Level.ERROR
    run.drop("scan_late")
    run.health.forget_arrivals()
    run.health.scans.clear()
    run.scans(8.0, 16.0)
    assert "dropped: 1 scan_late" in run.said("detections", 16.0)[1]
    assert run.status("latency", 16.0).level == Level.OK
    assert "no scan for 24 s, expected is one every 8 s" in run.said("detections", 40.0)[1]


def test_reset_forgets_drops_scans_and_arrivals():
    run = Run()
    run.scans(0.0, 12.0)
    run.drop("scan_late")
    run.status("detections", 12.0)
    run.health.reset()
    run.figures = GOOD
    assert run.said("detections", 13.0) == (
        Level.WARN,
        "no scan yet, though the topic is published",
    )
    assert not run.health.scans


def test_what_is_remembered_of_scans_is_the_window_and_bounded():
    """At 20 pings a second, 60 s are 1200 scans."""
    run = Run(max_latency=1.0, window=60.0)
    run.scan(0.0, core=2.9, to_all=2.9)
    for k in range(1, 1000):
        run.scan(3.0 + 0.05 * k)
        if k == 10:
            assert run.said("latency", 1.0)[0] != Level.OK
            assert "1 gap" in run.said("detections", 4.0)[1]
    for k in range(1000, 1400):
        run.scan(3.0 + 0.05 * k)
    assert run.said("latency", 73.0)[0] == Level.OK
    assert len(run.health.scans) <= 1202
    run = Run(window=86_400.0)
    for k in range(MAX_RECORDS + 10):
        run.health.arrived(0.01 * k, 0.01 * k)
    assert len(run.health._arrivals["detections"]) == MAX_RECORDS


@pytest.mark.parametrize("interval", [0.2, 1.0, 12.0])
def test_scans_that_become_empty_where_clutter_was_learned_are_said_until_they_are_not(interval):
    run, time = Run(), 0.0
    run.set(clutter_density=8e-8)  # 8 a scan

    def scans(seconds: float, number: int) -> None:
        nonlocal time
        for _ in range(math.ceil(seconds / interval)):
            time += interval
            run.scan(time, detections=number)
            run.status("detections", time)

    scans(30 * interval, 8)
    scans(9.0 if interval < 9.0 else 3 * interval, 0)
    assert run.status("detections", time).level == Level.OK, "not for long, or few are missed"
    scans(20.0 if interval < 9.0 else 3 * interval, 0)
    level, message = run.said("detections", time)
    assert level == Level.WARN and "where clutter gave 8 a scan: is the transducer" in message
    fact = run.status("detections", time).values["no_detections"]
    assert message.startswith(f"{fact}: "), "the alarm says it without the remedy"
    scans(interval, 1)
    assert run.status("detections", time).level == Level.OK
    assert run.status("detections", time).values["no_detections"] == ""


@pytest.mark.parametrize(
    ("density", "number", "reason"),
    [(1e-9, 8, ""), (8e-8, 0, ""), (8e-8, 8, "outside_coverage")],
    ids=["only_targets_were_seen", "nothing_ever", "all_are_outside"],
)
def test_empty_scans_are_no_dead_sonar_where_something_else_explains_them(density, number, reason):
    run = Run(max_dropped_share=1.0)
    run.set(clutter_density=density)
    for time in range(100):
        run.scan(float(time), detections=number if time < 30 else 0)
        if reason and time >= 30:
            run.drop(reason, 8)
        message = run.said("detections", float(time))[1]
        assert "transducer" not in message


PAGE = (Path(__file__).parents[2] / "docs/diagnostics.md").read_text(encoding="utf-8")
THRESHOLDS = {row.name for row in parameter_table(DiagnosticsOptions)}


RULES = [
    rule for entry in [*ENTRIES.values(), *INPUTS.values()] for some in entry.rules for rule in some
]


def test_the_page_has_every_rule_with_its_remedy_and_every_threshold():
    assert all(rule.condition in PAGE and f"| {rule.remedy} |" in PAGE for rule in RULES)
    unnamed = [name for name in THRESHOLDS if f"`diagnostics.{name}`" not in PAGE]
    assert unnamed == []
    of_rules = {name for rule in RULES for name in rule.thresholds}
    assert of_rules == THRESHOLDS - {"window"}, "the window says how long a finding stands"
