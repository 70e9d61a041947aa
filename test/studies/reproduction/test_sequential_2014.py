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
"""Sequential 2014: the scene, its readings, and the chapter."""

import csv
import dataclasses
import math

import numpy as np
import pytest

from tsepm_ros import Scan, make_initiator
from tsepm_ros.studies.reproduction import (
    sequential_2014,
)
from tsepm_ros.studies.reproduction.monte_carlo import AS_GIVEN
from tsepm_ros.studies.reproduction.report import (
    ReportSetting,
    report_claim,
    report_count,
    write_report,
)
from tsepm_ros.studies.reproduction.sequential_2014 import MAIN, Counts2014
from tsepm_ros.tools.evaluation.intervals import IntervalEstimate


def test_the_scene_is_the_published_one():
    targets = np.array(sequential_2014.hexagon(np.random.default_rng(1)))
    place = targets[:, 0::2]
    np.testing.assert_allclose(np.hypot(*place.T), 6000.0)
    np.testing.assert_allclose(np.hypot(*(place - np.roll(place, 1, axis=0)).T), 6000.0)
    np.testing.assert_allclose(np.hypot(*targets[:, 1::2].T), 5.0)
    scenario = sequential_2014.hexagon_case(12.0, 0.9)
    assert scenario.duration == 120.0
    assert scenario.sensor.clutter_density * scenario.area == pytest.approx(30.0)
    assert scenario.own_ship.pose(50.0)[:2].tolist() == pytest.approx([0.0, -200.0])
    assert scenario.own_ship.pose(150.0)[:2].tolist() == pytest.approx([200.0, 0.0], abs=1.0)


def test_targets_without_errors_are_started_by_every_reading_in_the_sixth_scan():
    one = sequential_2014.hexagon_case(12.0, 1.0)
    exact = dataclasses.replace(
        one.sensor, range_std_fraction=1e-6, azimuth_std=1e-6, clutter_density=1e-12
    )
    counts = sequential_2014.run_hexagon(dataclasses.replace(one, sensor=exact), [1, 0])
    for gate, matching in sequential_2014.MATCHED:
        for kind in ("true", "all"):
            assert counts[f"{gate}, {matching}: {kind}"] == [0.0] * 5 + [6.0] * 6
    for name in sequential_2014.ESTIMATORS:
        errors = np.reshape(counts[name], (6, 4))
        assert np.abs(errors).max() < 0.1
    assert counts["pure"] == [1.0] * 6


def counts(period, rows):
    array = np.array(rows, float)
    return Counts2014(period, 0.9, *sequential_2014.DEFAULT_READING, array, array)


def test_times_become_scans():
    one = counts(12.0, [np.arange(11)])
    # Seventy-two seconds: the sixth scan if the first takes an interval, else the seventh.
    assert [mean.value for mean in one.formed(one.true)] == [5, 6, 7, 8, 9]
    assert [mean.value for mean in one.formed(one.true, earlier=True)] == [6, 7, 8, 9, 10]
    shorter = counts(8.0, [np.arange(16)])
    assert [mean.value for mean in shorter.formed(shorter.true)] == [8, 9, 11, 12, 14]
    assert counts(12.0, [[6] * 11] * 3 + [[5] * 11]).at_least(6).value == 0.75


def test_tracks_as_listed_are_served_in_the_order_of_their_first_detections():
    """Two tracks of one scan, one detection nearer to the second: the first listed takes it."""
    sensor = sequential_2014.hexagon_case(*MAIN).sensor
    given = {"max_speed": 10.0, **AS_GIVEN, "min_hits": 2, "window": 3}
    taken = {}
    for method in ("sequential", sequential_2014.AS_LISTED):
        initiator = make_initiator(method, sensor=sensor, **given)
        initiator.process(Scan(stamp=0.0, range=[1000.0, 1060.0], azimuth=[0.0, 0.0]))
        [track] = initiator.process(Scan(stamp=12.0, range=[1050.0], azimuth=[0.0]))
        taken[method] = track.hits[0]
    assert taken == {"sequential": (0, 1), sequential_2014.AS_LISTED: (0, 0)}


def test_a_claim_agrees_by_the_interval_and_the_published_error():
    estimate = IntervalEstimate(0.5, 0.4, 0.6)
    for published, error, verdict in (
        (0.59, 0.0, "agrees"),
        (0.63, 0.0, "differs"),
        (0.63, 1.0, "agrees"),
        (0.35, 1.0, "differs"),
    ):
        assert report_claim("", estimate, ".2f", published, error)[1:] == [
            "0.50 (0.40-0.60)",
            verdict,
        ]
    for value, verdict in ((0.1, "holds"), (-0.1, "reversed"), (0.02, "open")):
        one = IntervalEstimate(value, value - 0.05, value + 0.05)
        assert report_claim("", one, "+.2f")[2] == verdict
    assert report_count("", [True, False])[1:] == ["in 1 of 2", "in part"]
    assert [report_count("", [met])[2] for met in (True, False)] == ["holds", "open"]


def test_the_published_speed_error_is_below_the_bound():
    closed = math.sqrt(2.0 / math.pi) * 90.0 / (12.0 * math.sqrt(82.5))
    assert sequential_2014.min_speed_error(10, 12.0) == pytest.approx(closed, rel=1e-3)
    assert closed > sequential_2014.TABLE_1["least_squares"][1]


@pytest.mark.long
def test_the_chapter_is_written(tmp_path):
    pytest.importorskip("matplotlib")
    setting = ReportSetting(folder=tmp_path / "runs", runs=3)
    parts = sequential_2014.reproduce(setting, {MAIN: sequential_2014.hexagon_case(*MAIN)})
    write_report(parts, tmp_path / "report.md")
    rows = list(csv.reader((tmp_path / "sequential_2014_starts.csv").open()))
    assert rows[1][:4] == ["-", "-", "-", "published"]
    assert {(row[2], row[3]) for row in rows[2:]} == set(sequential_2014.MATCHED)
    errors = list(csv.reader((tmp_path / "sequential_2014_table_1.csv").open()))
    assert [row[2] for row in errors[1:4]] == ["82.3", "114.5", "210.6"]
    others = list(csv.reader((tmp_path / "sequential_2014_conventional.csv").open()))
    assert [row[0] for row in others[1:]] == list(sequential_2014.CONVENTIONAL)
    assert float(others[-1][1]) > 3.0, "the method of the source starts its targets"
    for name in ("figures_8_9", "figures_10_11"):
        assert (tmp_path / f"sequential_2014_{name}.png").exists()


def test_runs_depend_on_the_seed_and_the_run_alone(tmp_path):
    setting = ReportSetting(folder=tmp_path / "one", runs=2, seed=3)
    again = dataclasses.replace(setting, folder=tmp_path / "other", runs=1)
    [first], [second] = (
        one.results(sequential_2014.run_hexagon, [sequential_2014.hexagon_case(*MAIN)], 9)
        for one in (setting, again)
    )
    assert first[0] == second[0] != first[1]
