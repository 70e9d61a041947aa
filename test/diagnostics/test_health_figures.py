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
"""Figures of health: levels, latencies, counts of a period, and intervals of scans."""

import math
from collections import Counter
from types import SimpleNamespace

import pytest

from tsepm_ros.diagnostics.health_figures import (
    Connections,
    HealthFigures,
    InputFigures,
    LatencyFigures,
    Level,
    Occurrences,
    ScanRecord,
    Status,
    goes_on,
    overall,
)
from tsepm_ros.session.drop_reasons import DETECTIONS
from tsepm_ros.settings.node_options import DiagnosticsOptions


def figures(scans=(), arrivals=(), time=100.0, dropped=None, **snapshot) -> HealthFigures:
    given = {"options": DiagnosticsOptions(), "connections": Connections(), "time": time}
    return HealthFigures(
        **given,
        snapshot=SimpleNamespace(**snapshot),
        late=Counter(dropped or {}),
        scans=scans,
        arrivals=arrivals,
        own_ship=InputFigures(**given),
    )


@pytest.mark.parametrize("number", [4, 7, 255])
def test_a_level_of_another_node_that_is_none_is_the_worst(number):
    assert Level(number) is Level.ERROR
    assert [Level(one).value for one in range(4)] == [0, 1, 2, 3]


@pytest.mark.parametrize(
    ("levels", "worst"),
    [
        ((Level.OK, Level.OK), Level.OK),
        ((Level.OK, Level.WARN), Level.WARN),
        ((Level.STALE, Level.WARN), Level.STALE),
        ((Level.STALE, Level.ERROR), Level.ERROR),
    ],
)
def test_the_overall_status_is_the_worst_and_silence_is_less_than_an_error(levels, worst):
    both = overall([Status(f"task {n}", level, "text", {}) for n, level in enumerate(levels)])
    assert both.level == worst
    assert both.message == (f"task {levels.index(worst)}: text" if worst else "every entry is OK")
    assert list(both.values) == ["task 0", "task 1"]


def test_latency_is_from_the_arrival_to_the_end_of_publishing():
    assert LatencyFigures(to_tracks=0.5, to_all=1.0, waiting=2.0).total == 3.0


@pytest.mark.parametrize(
    ("times", "interval", "lasts"),
    [
        ([], 1.0, -1.0),
        ([0.0], math.nan, 1.5),
        ([0.0], 0.2, 1.5),
        ([0.0], 12.0, 24.0),
        ([-10.0, 0.0], 0.2, 20.0),
        ([-10.1, -10.0, -0.1, 0.0], 0.2, 19.8),
        ([-50.0, 0.0], 0.2, 20.0),
        ([-70.0, 0.0], 0.2, 1.5),
    ],
    ids=[
        "never",
        "once",
        "fast",
        "slow",
        "again",
        "in_pairs",
        "until_the_first_is_old",
        "long_ago",
    ],
)
def test_what_happened_is_over_after_twice_the_time_in_which_it_would_come_again(
    times, interval, lasts
):
    on = [tenth / 10 for tenth in range(700) if goes_on(times, tenth / 10, interval, 60.0)]
    assert (on[-1] if on else -1.0) == pytest.approx(lasts, abs=0.11) or lasts > 11.0
    assert on == [tenth / 10 for tenth in range(len(on))], "without a break"


def test_occurrences_are_counted_in_the_window_and_a_total_that_fell_begins_anew():
    late = Occurrences()
    assert late.number(0.0, 1.0, 60.0) == 0
    for time in range(0, 100, 10):
        late.note(float(time), time // 10 + 1)
        late.note(float(time), time // 10 + 1)
    assert late.number(90.0, 1.0, 60.0) == 7, "at 30, 40, ... 90"
    assert late.number(111.0, 1.0, 60.0) == 0
    late.note(200.0, 1)
    assert late.number(200.0, 1.0, 60.0) == 1


def test_latencies_are_those_of_the_window():
    late = [
        ScanRecord(time, 5, LatencyFigures(to_all=to)) for time, to in ((1.0, 9.0), (99.0, 1.0))
    ]
    now = figures(late)
    assert now.longest_latency("to_all") == 1.0
    assert now.median_latency(lambda latency: latency.total) == 1.0
    assert figures().longest_latency("total") == 0.0


def test_a_gap_is_an_interval_beyond_the_factor_of_the_median_and_no_return_of_a_stamp():
    stamps = [0.0, 1.0, 2.0, 3.0, 9.0, 10.0, 11.0, 5.0, 12.0, 13.0]
    now = figures(time=96.0, arrivals=[(91.0 + n, stamp) for n, stamp in enumerate(stamps)])
    assert now.interval == 1.0
    assert now.gaps == 1
    assert math.isnan(figures().period)


def test_the_density_is_that_of_the_detections_over_the_exposure():
    scans = [ScanRecord(99.0, n, LatencyFigures()) for n in (10, 30)]
    now = figures(scans, coverage_area=1e6, clutter_density=1e-5)
    assert (now.detections, now.exposure) == (40, 2e6)
    assert now.detection_density == 2e-5
    assert now.clutter_expected == pytest.approx(20.0)


DROPPED = {"range_not_positive": 20, "scan_late": 3}


def test_dropped_detections_are_told_from_dropped_scans():
    now = figures([ScanRecord(99.0, 60, LatencyFigures())], dropped=DROPPED)
    assert now.recent_drops(DETECTIONS, of_detections=True) == {"range_not_positive": 20}
    assert "range_not_positive" not in now.recent_drops(DETECTIONS)
    assert now.dropped_share == 0.25
