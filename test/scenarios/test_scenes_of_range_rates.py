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
"""Range rates of the simulation, and what the methods make of them in whole scenes."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import cauchy, kstest
from support.builders import assert_same_tracks

from tsepm_ros import Scan, SensorModel, make_initiator
from tsepm_ros.tools.evaluation.measures import cramer_rao_measure
from tsepm_ros.tools.simulation import CLUTTER, Scenario, Simulator
from tsepm_ros.tools.simulation.scenario import ScenarioOwnShipMotion, ScenarioTargetArea

SENSOR = SensorModel(
    range_std=10.0, range_std_fraction=0.0, azimuth_std=math.radians(1.0), range_rate_std=0.25
)

SHIP = np.array([5.0, -3.0])

TIMES = 10.0 * np.arange(5)

NOW = TIMES[-1]

TRUTH = np.array([4700.0, 3.0, 2200.0, 4.0])  # at NOW


def truth_at(time: float) -> tuple[np.ndarray, np.ndarray]:
    """Position and velocity of the target."""
    return TRUTH[0::2] + (time - NOW) * TRUTH[1::2], TRUTH[1::2]


def bound(sensor: SensorModel) -> np.ndarray:
    positions = np.array([truth_at(time)[0] for time in TIMES])
    sensors = SHIP * TIMES[:, None]
    moving = np.tile(TRUTH[1::2] - SHIP, (len(TIMES), 1))
    return cramer_rao_measure(positions, TIMES, sensors, sensor, NOW, moving)


def test_the_bound_with_range_rates_is_by_numerical_differentiation():
    blind = replace(SENSOR, range_rate_std=0.0)

    def rates(state: np.ndarray) -> np.ndarray:
        offset = state[0::2] + (TIMES - NOW)[:, None] * state[1::2] - SHIP * TIMES[:, None]
        return ((state[1::2] - SHIP) * offset).sum(axis=1) / np.hypot(*offset.T)

    step = np.array([1.0, 1e-3, 1.0, 1e-3])
    jacobian = np.stack(
        [(rates(TRUTH + h) - rates(TRUTH - h)) / (2 * h.sum()) for h in np.diag(step)], axis=1
    )
    information = np.linalg.inv(bound(blind)) + jacobian.T @ jacobian / SENSOR.range_rate_std**2
    expected = np.linalg.inv(information)
    np.testing.assert_allclose(bound(SENSOR), expected, rtol=1e-5, atol=1e-5)


def test_a_detection_whose_range_rate_contradicts_its_step_is_outside_the_gate_of_tsepm():
    # 3 m/s away, by its steps; the range rates say so, or that it comes closer.
    sensor = replace(SENSOR, clutter_density=1e-9)
    for rate, starts in ((3.0, 1), (-3.0, 0)):
        initiator = make_initiator("tsepm", sensor=sensor, min_hits=4, window=5)
        confirmed = [
            len(
                initiator.process(
                    Scan(60.0 * k, [3000.0 + 180.0 * k], [0.3], features={"range_rate": [rate]})
                )
            )
            for k in range(5)
        ]
        assert sum(confirmed) == starts


MOVING = Scenario(
    name="moving",
    scans=60,
    period=12.0,
    sensor=SensorModel(range_rate_std=0.3, clutter_range_rate=2.0),
    sound_speed=1500.0,
    areas=(ScenarioTargetArea(count=20, ranges=(3000.0, 8000.0), azimuths=(-3.0, 3.0), speed=4.0),),
    own_ship=ScenarioOwnShipMotion(yaw=0.4, speed=6.0, turn_rate=0.002),
)


def test_simulated_clutter_has_the_range_rates_that_it_is_taken_for():
    over_ground = []
    for simulated in Simulator(MOVING, 3):
        pose = MOVING.own_ship.pose
        scan, clutter = simulated.scan, simulated.origin == CLUTTER
        arrival = scan.stamp + 2.0 * scan.time_offset
        yaw = np.array([pose(time)[2] for time in arrival])
        sight = np.stack([np.cos(scan.azimuth + yaw), np.sin(scan.azimuth + yaw)], axis=1)
        own = (sight * scan.sensor_velocity).sum(axis=1)
        over_ground.append((scan.features["range_rate"] + own)[clutter])
    assert kstest(np.concatenate(over_ground), cauchy(scale=2.0).cdf).pvalue > 0.01


def test_simulated_targets_have_the_rate_at_which_their_echoes_grow_longer():
    # The mean of both legs, followed by the simulator's own echoes from ping to ping.
    simulator = Simulator(replace(MOVING, scans=20), 4)
    errors = []
    for simulated in simulator:
        time, scan = simulated.scan.stamp, simulated.scan
        for rate, target in zip(scan.features["range_rate"], simulated.origin, strict=True):
            if target != CLUTTER:
                state = simulator.targets[target]
                ahead, behind = (simulator._echo(state, time + dt)[0] for dt in (0.05, -0.05))
                errors.append(rate - (ahead - behind) / 0.1)
    # 360 errors of 0.3 m/s: a mean within 3 standard errors and the term of second order, 0.4 %.
    assert np.mean(errors) == pytest.approx(0.0, abs=3 * 0.3 / math.sqrt(len(errors)) + 0.02)
    assert np.std(errors) == pytest.approx(0.3, rel=3 / math.sqrt(2 * len(errors)))


def test_range_rates_change_no_other_draw():
    silent = replace(MOVING, sensor=replace(MOVING.sensor, range_rate_std=0.0))
    for one, other in zip(Simulator(MOVING, 5), Simulator(silent, 5), strict=True):
        np.testing.assert_array_equal(one.scan.range, other.scan.range)
        np.testing.assert_array_equal(one.scan.azimuth, other.scan.azimuth)
        assert set(one.scan.features) == {"range_rate"} and not other.scan.features


FEW = Scenario(
    name="few",
    scans=8,
    sensor=SensorModel(max_range=3000.0, clutter_density=2e-6, range_rate_std=0.3),
    areas=(ScenarioTargetArea(count=3, ranges=(500.0, 2800.0), azimuths=(-3.0, 3.0), speed=5.0),),
    own_ship=ScenarioOwnShipMotion(yaw=0.4, speed=4.0),
)

OPTIONS = {"score": {"false_tracks_per_hour": 30.0}, "tsepm": {}, "multiple_model": {}}


@pytest.mark.parametrize(
    ("method", "unused"),
    [
        *(("score", unused) for unused in ("parameter", "nan", "absurd", "absent")),
        *((method, "absurd") for method in ("tsepm", "multiple_model")),
    ],
)
def test_range_rates_that_are_not_used_or_not_measured_change_nothing(method, unused):
    plain = make_initiator(
        method, sensor=replace(FEW.sensor, range_rate_std=0.0), **OPTIONS[method]
    )
    std = 0.0 if unused == "parameter" else 0.3
    given = make_initiator(
        method, sensor=replace(FEW.sensor, range_rate_std=std), **OPTIONS[method]
    )
    started = 0
    for simulated in Simulator(FEW, 6):
        scan = simulated.scan
        rates = scan.features["range_rate"]
        features = {
            "parameter": {"range_rate": rates},
            "nan": {"range_rate": np.full(len(scan), np.nan)},
            "absurd": {"range_rate": np.resize([1e300, -np.inf, 2e6], len(scan))},
            "absent": {},
        }[unused]
        one = plain.process(replace(scan, features={}, sensor_velocity=(0.0, 0.0)))
        other = given.process(replace(scan, features=features))
        assert_same_tracks(list(one), list(other))
        np.testing.assert_array_equal(plain.current.state, given.current.state)
        started += len(one)
    assert started


@pytest.mark.long
@pytest.mark.parametrize(("true", "least"), [(3.0, 0.5), (0.5, 0.2), (8.0, 0.2)])
def test_the_wanted_rate_is_kept_where_clutter_has_range_rates_of_any_spread(true, least):
    # Given as 3 m/s, learned: without that 0.5 gives 17 times as many, and 8 half as many.
    sensor = SensorModel(range_rate_std=0.3, clutter_range_rate=true)
    wish, scans = 100.0, 150
    scene = Scenario(name="clutter", scans=scans + 10, sensor=sensor)
    initiator = make_initiator(
        "score",
        sensor=replace(sensor, clutter_range_rate=3.0),
        false_tracks_per_hour=wish,
        clutter_density="estimated",
    )
    confirmed = [len(initiator.process(one.scan)) for one in Simulator(scene, 7)]
    rate = sum(confirmed[10:]) / (scans * 12.0 / 3600.0)
    assert least * wish < rate < 2 * wish
