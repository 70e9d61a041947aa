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
"""The heuristic method on scenes by hand."""

import numpy as np
import pytest
from support.builders import scan_at

from tsepm_ros import SensorModel, make_initiator
from tsepm_ros.studies.path_following import PathDisplacements

SENSOR = SensorModel(range_std=1.0, range_std_fraction=0.0, azimuth_std=1e-4)


def run(scans, **options):
    """Hits of the tracks started; scans are lists of positions, 12 s apart."""
    made = make_initiator("heuristic", sensor=SENSOR, **options)
    tracks = [t for k, where in enumerate(scans) for t in made.process(scan_at(12.0 * k, where))]
    return [track.hits for track in tracks], tracks


def along_x(*steps: float):
    """Scans of one detection each that moves by the steps, m."""
    return [[(2000.0 + x, 0.0)] for x in np.cumsum([0.0, *steps])]


@pytest.mark.parametrize(
    ("steps", "options", "found"),
    [
        ((60.0, 60.0), {}, 1),
        ((119.9, 119.9), {}, 1),
        ((120.1, 120.1), {}, 0),
        ((120.1, 60.0), {}, 0),
        ((60.0, 120.1), {}, 0),
        ((100.0, 100.0), {"min_step_speed": 8.3}, 1),
        ((100.0, 100.0), {"min_step_speed": 8.4}, 0),
        ((-70.0, 73.9), {}, 1),
        ((-70.0, 74.1), {}, 0),
        ((10.0, 38.7), {"max_acceleration": 0.2}, 1),
        ((10.0, 38.9), {"max_acceleration": 0.2}, 0),
        ((60.0, -60.0), {"max_turn": 3.0}, 0),
        ((60.0, 30.0), {"max_turn": 0.1}, 1),
        ((122.0, 122.0), {"gate_sigmas": 3.0}, 1),
    ],
    ids=str,
)
def test_the_rules_are_those_of_equation_2(steps, options, found):
    assert len(run(along_x(*steps), **options)[0]) == found


def test_accelerations_are_over_the_middles_of_the_steps_and_the_largest_is_the_evaluation():
    _, (track,) = run(along_x(60.0, 40.0))
    assert track.evaluation == pytest.approx(20.0 / 144.0, rel=1e-3)
    position = np.array([[[0.0, 0.0], [30.0, 0.0], [30.0, 80.0]]])
    steps = PathDisplacements.of(position, np.array([[0.0, 10.0, 30.0]]))
    assert steps.acceleration == pytest.approx(5.0 / 15.0)
    assert steps.turn == pytest.approx(np.pi / 2)


TARGET = [(2000.0, 100.0)], [(2060.0, 100.0)], [(2120.0, 100.0)]


@pytest.mark.parametrize(
    ("scans", "options", "hits"),
    [
        (
            [*along_x(60.0), [(2150.0, 0.0), (2121.0, 0.0), (2060.0, 30.0)]],
            {},
            [((0, 0), (1, 0), (2, 1))],
        ),
        (
            [[(2000.0, 0.0)], [(2000.0, 90.0), (2050.0, 0.0)], [(2100.0, 0.0)]],
            {},
            [((0, 0), (1, 1), (2, 0))],
        ),
        (along_x(*[60.0] * 5), {}, [((0, 0), (1, 0), (2, 0)), ((3, 0), (4, 0), (5, 0))]),
        ([[(2000.0, 0.0)], *TARGET], {"max_acceleration": 0.5}, [((1, 0), (2, 0), (3, 0))]),
        ([*along_x(60.0), [], [(2180.0, 0.0)]], {}, []),
        ([*along_x(60.0), [], [(2180.0, 0.0)]], {"window": 4}, [((0, 0), (1, 0), (3, 0))]),
    ],
    ids=[
        "of several the least acceleration",
        "every second detection is tried",
        "hits of a confirmed track are no other's",
        "any may be the first",
        "no scan may be missed",
        "but where the rule allows it",
    ],
)
def test_which_detections_become_hits(scans, options, hits):
    assert run(scans, **options)[0] == hits
