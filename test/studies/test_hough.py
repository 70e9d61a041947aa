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
"""The Hough transform and the modified one on scenes by hand."""

import numpy as np
import pytest
from support.builders import scan_at

from tsepm_ros import SensorModel, make_initiator
from tsepm_ros.studies import hough

SENSOR = SensorModel(range_std=1.0, range_std_fraction=0.0, azimuth_std=1e-4)


def run(scans, **options):
    made = make_initiator("hough", sensor=SENSOR, **options)
    return [t for k, where in enumerate(scans) for t in made.process(scan_at(12.0 * k, where))]


def line(seen: str, velocity=(3.0, 4.0)):
    """Scans of a target that is seen where there is a 1."""
    return [
        [np.array([1000.0, 2000.0]) + 12.0 * k * np.array(velocity)] if one == "1" else []
        for k, one in enumerate(seen)
    ]


def test_a_cell_is_that_of_the_normal_form():
    made = make_initiator("hough", sensor=SENSOR, angles=90, cell=50.0)
    offset = np.array([[300.0, 400.0], [-20.0, 7.0]])
    cell, from_middle = made.method._cells(offset)
    for i, (x, y) in enumerate(offset):
        for j in range(90):
            theta = np.pi * j / 90
            rho = x * np.cos(theta) + y * np.sin(theta)
            assert cell[i, j] == np.floor(rho / 50.0) * 90 + j
            middle = (np.floor(rho / 50.0) + 0.5) * 50.0
            assert from_middle[i, j] == pytest.approx(abs(rho - middle), abs=1e-9)


@pytest.mark.parametrize(
    ("seen", "hits"),
    [
        ("111111", [0, 1, 2, 3, 4, 5]),
        ("10111011", [0, 2, 3, 4, 6, 7]),
        ("101110011", None),
        ("11111", None),
    ],
)
def test_six_of_eight_scans_on_a_line_confirm_it(seen, hits):
    tracks = run(line(seen))
    assert [[scan for scan, _ in track.hits] for track in tracks] == ([hits] if hits else [])
    for track in tracks:
        np.testing.assert_allclose(track.velocity, [3.0, 4.0], atol=0.01)


def test_detections_of_one_scan_are_one_vote_and_two_lines_two_tracks():
    crowd = [[(1000.0 + 10.0 * k, 2000.0) for k in range(20)]]
    assert run([*crowd, [], *crowd]) == []
    scans = [a + b for a, b in zip(line("111111"), line("111111", (-4.0, 3.0)), strict=True)]
    scans = [[*where, np.array([-3000.0, -1000.0 + 60.0 * k])] for k, where in enumerate(scans)]
    tracks = run(scans)
    assert {track.hits[-1][1] for track in tracks} >= {2}
    used = [hit for track in tracks for hit in track.hits]
    assert len(used) == len(set(used))


def test_a_line_may_bend_within_a_cell_but_not_beyond():
    bent = [[(1000.0 + 60.0 * k, 2000.0 + (0.0 if k < 3 else 40.0 * (k - 2)))] for k in range(6)]
    assert len(run(bent, cell=400.0)) == 1
    assert run(bent, cell=10.0, angles=180) == []


@pytest.mark.parametrize(("speed", "found"), [(9.9, 1), (10.1, 0)])
def test_a_line_faster_than_the_limit_is_refused(speed, found):
    assert len(run(line("111111", (speed, 0.0)))) == found


def test_time_plays_no_part_in_a_line():
    order = [0, 3, 1, 4, 2, 5]
    scans = line("111111")
    (track,) = run([scans[k] for k in order])
    assert len(track.hits) == 6


def test_the_image_is_bounded(monkeypatch):
    monkeypatch.setattr(hough, "MAX_VOTES", 450)
    made = make_initiator("hough", sensor=SENSOR)
    made.process(scan_at(0.0, [(1000.0 + 10.0 * k, 0.0) for k in range(30)]))
    assert made.statistics.potential_tracks == 10
    assert made.statistics.cut_potential_tracks == 20


@pytest.mark.parametrize("seed", range(5))
def test_an_empty_scan_after_others_tells_of_no_line(seed):
    rng = np.random.default_rng(seed)
    made = make_initiator("hough", sensor=SENSOR)
    for k in range(12):
        where = rng.uniform(-5000.0, 5000.0, (20 * (k % 3), 2))
        made.process(scan_at(12.0 * k, where))
        assert len(where) or len(made.potential_tracks()) == 0


def test_the_cell_of_number_minus_one_is_one_as_the_others():
    # The last angle and the first cell below rho 0; the newest detection's cells lie below it.
    made = make_initiator("hough", sensor=SENSOR, angles=2, cell=300.0)
    made.process(scan_at(0.0, [(5000.0, -10.0)]))
    made.process(scan_at(12.0, [(-5000.0, -5000.0)]))
    assert len(made.potential_tracks()) == 0


def hits_of(scans, **options):
    made = make_initiator("modified_hough", sensor=SENSOR, **options)
    return [t.hits for k, where in enumerate(scans) for t in made.process(scan_at(12.0 * k, where))]


def path(*directions: float, step: float = 60.0):
    """Scans of one detection each that goes a step in each direction, rad."""
    steps = step * np.array([[np.cos(one), np.sin(one)] for one in directions])
    return [
        [point] for point in np.vstack([[2000.0, 0.0], 2000.0 * np.eye(2)[0] + steps.cumsum(0)])
    ]


@pytest.mark.parametrize(
    ("directions", "found"),
    [
        ((0.0, 0.0, 0.0), 1),
        ((0.0, 0.49, 0.98), 1),
        ((0.0, 0.51, 0.51), 0),
        ((0.0, 0.0, np.pi), 0),
        ((3.0, -3.0, 3.0), 1),
        ((1.5, 1.7, 1.5), 1),
    ],
    ids=["straight", "bends slowly", "bends", "turns back", "across pi", "across the normal"],
)
def test_zero_crossings_that_follow_each_other_are_close_and_of_one_sign(directions, found):
    assert len(hits_of(path(*directions))) == found


def test_the_angle_is_that_between_zero_crossings():
    # theta of the zero crossing of each pair of curves, and the slope there.
    rng = np.random.default_rng(1)
    for _ in range(50):
        points = np.array([2000.0, 0.0]) + rng.uniform(-50, 50, (3, 2))
        crossings = []
        for step in np.diff(points, axis=0):
            theta = np.arctan2(-step[0], step[1])  # of step . (cos, sin) = 0
            slope = -step[0] * np.sin(theta) + step[1] * np.cos(theta)
            assert abs(slope) == pytest.approx(np.hypot(*step))
            crossings.append(theta)  # chosen where the slope is positive: one sign
        turn = abs((crossings[1] - crossings[0] + np.pi) % (2 * np.pi) - np.pi)
        found = hits_of([[one] for one in points], min_hits=3, window=3, max_turn=0.7)
        assert len(found) == (turn <= 0.7)


@pytest.mark.parametrize(("step", "found"), [(119.9, 1), (120.1, 0)])
def test_the_slope_is_within_the_limit_of_the_speed(step, found):
    assert len(hits_of(path(0.0, 0.0, 0.0, step=step))) == found


def test_every_detection_on_the_line_is_followed_and_a_scan_may_be_missed():
    scans = path(0.0, 0.0, 0.0)
    scans[2].insert(0, (2110.0, 5.0))  # nearer to the turn of none, but leads nowhere
    scans[3] = [(2180.0, 0.0)]
    found = hits_of(scans)
    assert len(found) == 1
    assert found[0][-1] == (3, 0)
    scans = path(0.0, 0.0, 0.0, 0.0)
    scans[1] = []
    assert hits_of(scans) == [((0, 0), (2, 0), (3, 0), (4, 0))]
