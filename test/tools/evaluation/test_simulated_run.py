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
"""Judging confirmed tracks: each is exactly one of true, redundant, misplaced and false."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from tsepm_ros import ConfirmedTrack, SensorModel
from tsepm_ros.methods.registry import available_methods, registered_method
from tsepm_ros.own_ship.registration import Mounting
from tsepm_ros.tools.evaluation.simulated_run import (
    NO_TARGET,
    Outcome,
    judge_simulated_starts,
    simulated_limit,
    simulated_measurement_sigma,
    simulated_operating_points,
    simulated_origins_of,
)
from tsepm_ros.tools.simulation import Scenario, load_scenario
from tsepm_ros.tools.simulation.scenario import ScenarioOwnShipMotion

TRUE, REDUNDANT = Outcome.TRUE, Outcome.REDUNDANT

MISPLACED, FALSE = Outcome.MISPLACED, Outcome.FALSE

SENSOR = SensorModel(range_std=30.0, range_std_fraction=0.0, azimuth_std=0.02)

TARGETS = np.array([[3000.0, 5.0, 0.0, 0.0], [0.0, 0.0, -5000.0, 4.0]])

# Per scan: detection 0 comes from target 0, 1 from target 1, 2 and 3 are clutter.
ORIGINS = [np.array([0, 1, -1, -1])] * 5


def truth_at(stamp: float) -> np.ndarray:
    states = TARGETS.copy()
    states[:, 0::2] += stamp * states[:, 1::2]
    return states


def track(sources: list[int], target: int = 0, off=(0.0, 0.0), stamp: float = 100.0):
    """A track with these detections, one per scan, displaced from a target by `off`."""
    state = truth_at(stamp)[target]
    state[0::2] += off
    hits = tuple(enumerate(sources))
    return ConfirmedTrack(0, stamp, state, np.diag([900.0, 1.0, 900.0, 1.0]), hits, 0.0)


def judged(*tracks, origins=ORIGINS, sensor_x=0.0):
    scenario = Scenario("test", sensor=SENSOR, own_ship=ScenarioOwnShipMotion(x=sensor_x))
    return judge_simulated_starts(
        SimpleNamespace(scenario=scenario, truth=truth_at), tracks, origins
    )


def outcomes(*tracks, **more):
    return [one.outcome for one in judged(*tracks, **more)]


@pytest.mark.parametrize(
    ("sources", "outcome", "pure"),
    [
        pytest.param([0, 0, 0, 0, 0], TRUE, True, id="all"),
        pytest.param([0, 0, 2, 0, 3], TRUE, False, id="3 of 5"),
        pytest.param([0, 0, 1, 0, 1], TRUE, False, id="3 of 5, 2 from another target"),
        pytest.param([0, 0, 2, 3, 2], FALSE, False, id="2 of 5"),
        pytest.param([0, 2, 0, 3], FALSE, False, id="exactly half"),
        pytest.param([0, 1, 0, 1], FALSE, False, id="half and half"),
        pytest.param([2, 3, 2, 3, 2], FALSE, False, id="clutter only"),
    ],
)
def test_a_track_on_the_target_is_true_with_more_than_half_of_its_hits(sources, outcome, pure):
    (one,) = judged(track(sources))
    assert one.outcome is outcome
    assert one.pure is pure
    assert one.target == (0 if outcome is TRUE else NO_TARGET)


def test_the_first_true_track_of_a_target_is_true_and_later_ones_are_redundant():
    good, far = track([0] * 5), track([0] * 5, off=(1e4, 0.0))
    assert outcomes(good, good, good) == [TRUE, REDUNDANT, REDUNDANT]
    assert outcomes(far, good, far) == [MISPLACED, TRUE, MISPLACED]
    assert outcomes(track([2] * 5), good) == [FALSE, TRUE]


@pytest.mark.parametrize("direction", [(1.0, 0.0), (0.0, 1.0), (-0.6, 0.8)])
@pytest.mark.parametrize(("factor", "outcome"), [(2.999, TRUE), (3.001, MISPLACED)])
def test_three_sigma_of_the_larger_axis_is_the_border(direction, factor, outcome):
    # Target 0 is 3500 m away at the stamp: across 0.02 * 3500 = 70 m, along 30 m.
    sigma = simulated_measurement_sigma(SENSOR, np.array([3500.0, 0.0]))
    assert sigma == pytest.approx(70.0, rel=1e-3)
    off = factor * sigma * np.array(direction)
    assert outcomes(track([0] * 5, off=off)) == [outcome]


def test_the_border_is_measured_from_the_sensor_and_for_the_target_that_gave_the_hits():
    off = (0.0, 100.0)  # 3 sigma: 210 m seen from the origin, 90 m from 500 m away
    tracks = [track([0] * 5, off=off)]
    near = judged(*tracks, sensor_x=3000.0)
    assert outcomes(*tracks) == [TRUE]
    assert near[0].outcome is MISPLACED
    (one,) = judged(track([1] * 5, target=0))
    assert (one.outcome, one.target) == (MISPLACED, 1)


def test_the_border_of_several_sensors_is_the_largest_of_those_that_look_at_the_target():
    near = SensorModel(range_std=1.0, range_std_fraction=0.0, azimuth_std=0.001, max_range=900.0)
    far = Scenario("far", sensor=SENSOR, mounting=Mounting(x=10.0))
    scenes = {"near": Scenario("near", sensor=near), "far": far}
    for x, sigma in ((500.0, 30.0), (3010.0, 60.0), (1e5, 0.02 * (1e5 - 10.0))):
        target = np.array([x, 0.0, 0.0, 0.0])
        found = simulated_limit(Scenario("both", sensors=scenes), target, 0.0)
        assert found == pytest.approx(3.0 * sigma, rel=1e-3)
    alone = simulated_limit(Scenario("near", sensors={"near": scenes["near"]}), target, 0.0)
    assert alone == pytest.approx(3.0 * 100.0, rel=1e-3), "if none does, of all"


def test_errors_are_those_from_the_target():
    (one,) = judged(track([0] * 5, off=(30.0, -40.0)))
    assert one.position_error == pytest.approx(50.0)
    assert one.velocity_error == 0.0
    assert one.nees == pytest.approx(2500.0 / 900.0)
    (false,) = judged(track([2] * 5))
    assert math.isnan(false.position_error)
    assert math.isnan(false.nees)


def test_origins_are_those_of_the_scans_that_were_processed():
    # The second was dropped, and clocks round to ns.
    origins = [np.array([scan]) for scan in range(4)]
    found = simulated_origins_of([0.0, 24.0 + 1e-9, 36.0 - 1e-9], [0.0, 12.0, 24.0, 36.0], origins)
    assert [int(one[0]) for one in found] == [0, 2, 3]
    assert simulated_origins_of([], [], []) == []
    assert simulated_origins_of([5.0], [5.0], origins[:1]) == origins[:1]


BOX = load_scenario("box")


@pytest.mark.parametrize("method", available_methods())
def test_every_method_takes_the_options_of_its_points(method):
    points = simulated_operating_points([method])
    assert len(points) == len(registered_method(method).operating_points) > 0
    for point in points:
        made = point.make(BOX).method
        assert type(made) is registered_method(method)
        for name, value in point.options.items():
            assert getattr(made.options, name) == value


def test_defaults_are_one_point_a_method_with_the_options_given():
    points = simulated_operating_points(["tsepm", "score"], {"min_hits": 4}, defaults=True)
    told = [(point.method, point.label, dict(point.options)) for point in points]
    assert told == [("tsepm", "as given", {"min_hits": 4}), ("score", "default", {})]


@pytest.mark.parametrize("name", ["not_there:measure", "math:pi", "math:sin", "math:absent"])
def test_a_measure_that_gives_no_number_is_refused_by_its_name(name):
    with pytest.raises(ValueError, match=name):
        simulated_operating_points(["score"], measures=[name])


def test_an_option_goes_to_the_methods_that_have_it_and_replaces_what_their_sweep_varies():
    points = simulated_operating_points(
        ["tsepm", "score"], {"miss_probability": 0.01, "max_speed": 5.0}
    )
    for point in points:
        assert point.options["max_speed"] == 5.0
        assert ("miss_probability" in point.options) == (point.method == "score")
    assert len(points) == len(simulated_operating_points(["tsepm", "score"]))
    points = simulated_operating_points(["tsepm", "score"], {"min_hits": 4})
    given = [point for point in points if point.method == "tsepm"]
    assert [dict(point.options) for point in given] == [{"min_hits": 4}]
    assert len(points) == 1 + len(registered_method("score").operating_points)
