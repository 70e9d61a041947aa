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
"""Environment 2018: readings of the distances, and the chapter."""

import itertools

import numpy as np
import pytest
from scipy.stats import norm

from tsepm_ros.studies.assignment import AssignmentPairs, nearest_first_assignment
from tsepm_ros.studies.reproduction import environment_2018 as environment
from tsepm_ros.tools.commands.cli import main

TIMES = np.arange(0.0, 240.0, 0.01)


def distances():
    """Distance of the targets over time, by complex numbers: bearings are clockwise from north."""
    courses = []
    for distance, azimuth, speed, heading in environment.ENCOUNTER:
        begin, step = (np.exp(1j * np.radians(90.0 - angle)) for angle in (azimuth, heading))
        courses.append(distance * begin + speed * step * TIMES)
    return np.abs(courses[1] - courses[0])


def test_one_combination_of_the_readings_does_what_the_text_says_not_the_printed_one():
    apart = distances()
    closest = float(TIMES[apart.argmin()])
    assert apart.min() == pytest.approx(188.6, abs=0.1)
    states, times = environment.encounter(), np.arange(0.0, 240.0, 0.5)
    right = []
    for reading in itertools.product(environment.SLOPES, environment.ANGLES, environment.SIGNS):
        values = environment.time_of_closest_approach(states, times, reading)
        if environment.holds(times, values, closest) == "holds":
            right.append(", ".join(reading))
            np.testing.assert_allclose(values, closest - times, atol=0.01)
    assert right == ["phi_r from y, with quadrants, with a minus instead of bars"]
    printed = environment.PICTURED["as printed"]
    assert (environment.time_of_closest_approach(states, times, printed) >= 0.0).all()


@pytest.mark.parametrize(
    ("values", "verdict"),
    [
        ([2.0, 1.0, -1.0, -2.0], "holds"),
        ([2.0, 1.0, 1.0, 2.0], "does not hold"),
        ([-2.0, -1.0, -1.0, -2.0], "does not hold"),
        ([1.0, 2.0, -1.0, -2.0], "does not hold"),
        ([2.0, 1.0, -2.0, -1.0], "does not hold"),
    ],
    ids=["described", "bars", "sign", "grows before", "shrinks after"],
)
def test_the_description(values, verdict):
    assert environment.holds(np.arange(4.0), np.array(values), 1.5) == verdict


def test_the_published_distances_need_one_detection_per_track():
    each, pairs = environment.smallest(np.array(environment.ENVIRONMENT_TABLE_1))
    assert each.tolist() == [False, True]
    assert pairs


def test_the_smallest_pair_first_is_the_package_s():
    rng = np.random.default_rng(2)
    seen = set()
    for _ in range(50):
        table = rng.random((2, 2))
        chosen = nearest_first_assignment(
            AssignmentPairs(np.array([0, 1, 0, 1]), np.array([0, 0, 1, 1]), table.ravel())
        )
        straight = bool((chosen.parent == chosen.row).all())
        assert environment.smallest(table)[1] == straight
        seen.add(straight)
    assert seen == {True, False}


def test_the_printed_decision_by_hand():
    # Mean (2, 4) of three detections; with (6, 8) it is (3, 5): 1 + 1.
    history = np.array([[1.0, 4.0], [2.0, 4.0], [3.0, 4.0]])
    assert environment.decision(history, np.array([6.0, 8.0])) == pytest.approx(2.0)


def test_the_printed_decision_shrinks_with_the_history():
    # As printed no threshold fits a short and a long history: why it is not what is used.
    rng = np.random.default_rng(1)
    short, long = rng.standard_normal((500, 3, 3)), rng.standard_normal((500, 30, 3))
    candidate = rng.standard_normal((500, 3))
    assert (
        environment.decision(short, candidate).mean()
        > 30 * environment.decision(long, candidate).mean()
    )


@pytest.mark.parametrize("offset", [0.5, 1.0, 2.0])
def test_long_histories_decide_as_known_means_do(offset):
    """Within 4 standard errors of Phi(d / 2), d the distance of the means."""
    trials = 4000
    made = environment.decide(np.random.default_rng(1), trials, offset, (300, 300))
    share = norm.cdf(0.5 * offset * np.sqrt(environment.FEATURES))
    error = np.sqrt(share * (1.0 - share) / trials)
    assert made[0].value == pytest.approx(share, abs=4.0 * error + 1e-3)


def test_a_longer_history_draws_all_detections():
    equal, unlike = (
        environment.decide(np.random.default_rng(1), 1000, 1.0, histories)
        for histories in ((10, 10), (30, 5))
    )
    assert equal[0].low > 0.75
    assert unlike[0].high < 0.55


def test_the_command_writes_the_chapter(tmp_path):
    pytest.importorskip("matplotlib")
    assert main(["reproduce", "environment_2018", "--runs", "2", "--out", str(tmp_path)]) == 0
    text = (tmp_path / "report.md").read_text()
    assert "closest after 122.7 s, 189 m apart" in text
    assert "gives the published decision" in text
    assert (tmp_path / "environment_2018_figure_4.png").exists()
    rows = (tmp_path / "environment_2018_table_1.csv").read_text().splitlines()
    assert len(rows) == 1 + len(environment.OFFSETS) * len(environment.HISTORIES)
