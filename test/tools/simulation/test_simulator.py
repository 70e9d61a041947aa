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
"""Simulated scans: repeatable, and with the statistics that the scenario says."""

import dataclasses
import math

import numpy as np
import pytest
from scipy import stats
from scipy.optimize import brentq

from tsepm_ros import SensorModel
from tsepm_ros.tools.simulation import (
    CLUTTER,
    Scenario,
    Simulator,
    load_scenario,
    shipped_scenarios,
)
from tsepm_ros.tools.simulation.scenario import (
    ClutterPatch,
    ScenarioOwnShipMotion,
    ScenarioTargetArea,
    ScenarioWaypointMotion,
    scenario_from,
)

EXACT = SensorModel(
    range_std=1e-6,
    range_std_fraction=0.0,
    azimuth_std=1e-9,
    detection_probability=1.0,
    clutter_density=1e-15,
    max_range=1e5,
)


def scenario(**changes) -> Scenario:
    return Scenario("test", **{"scans": 200, "period": 5.0, **changes})


def scans_of(one: Scenario, seed: int = 1):
    return list(Simulator(one, seed))


@pytest.mark.parametrize("name", shipped_scenarios())
def test_a_shipped_scenario_gives_the_same_scans_with_a_seed_to_the_bit(name):
    scenario = load_scenario(name)
    one, other = (scans_of(scenario, 7) for _ in range(2))
    assert (scenario.name, len(one)) == (name, scenario.total_scans)
    for a, b in zip(one, other, strict=True):
        for field in ("range", "azimuth", "sensor_pose"):
            assert getattr(a.scan, field).tobytes() == getattr(b.scan, field).tobytes()
        for field in a.scan.features:
            assert a.scan.features[field].tobytes() == b.scan.features[field].tobytes()
        assert a.origin.tobytes() == b.origin.tobytes()
        assert a.truth.tobytes() == b.truth.tobytes()
        assert (a.scan.stamp, a.complete) == (b.scan.stamp, b.complete)


def test_several_sensors_see_the_same_targets_each_at_its_own_times_from_its_own_place():
    moving = ScenarioOwnShipMotion(50.0, -20.0, 0.5, speed=6.0, turn_rate=0.05)
    scene = scenario_from(
        {
            "sensors": ["bow", "mast"],
            "scans": 6,
            "sensor": dataclasses.asdict(EXACT) | {"range_rate_std": 1e-3},
            "bow": {"period": 1.0, "mounting": {"x": 8.0, "y": -3.0, "yaw": 1.2}},
            "mast": {"period": 1.5},
            "own_ship": dataclasses.asdict(moving),
            "targets": [
                {"state": [900.0, -3.0, 400.0, 2.0]},
                {"ranges": [500.0, 900.0], "azimuths": [0.0, 6.0], "speed": 4.0},
            ],
        }
    )
    simulator = Simulator(scene, 3)
    drawn = list(simulator)
    assert [(one.scan.stamp, one.scan.sensor) for one in drawn] == [
        *((0.0, "bow"), (0.0, "mast"), (1.0, "bow"), (1.5, "mast"), (2.0, "bow"), (3.0, "bow")),
        *((3.0, "mast"), (4.0, "bow"), (4.5, "mast"), (5.0, "bow")),
    ]
    for one in drawn:
        scan, time = one.scan, one.scan.stamp
        x, y, yaw = moving.pose(time)
        vx, vy, turn = moving.rates(time)
        ahead, port, looks = (8.0, -3.0, 1.2) if scan.sensor == "bow" else (0.0, 0.0, 0.0)
        arm = ahead * np.exp(1j * yaw) + port * 1j * np.exp(1j * yaw)
        place, velocity = x + 1j * y + arm, vx + 1j * vy + 1j * turn * arm
        np.testing.assert_allclose(scan.sensor_pose, [place.real, place.imag, yaw + looks])
        assert sorted(one.origin) == [0, 1]
        for row, target in enumerate(one.origin):
            state = simulator.truth(time)[target]
            offset = state[0] + 1j * state[2] - place
            measured = scan.range[row] * np.exp(1j * (scan.azimuth[row] + yaw + looks))
            assert measured == pytest.approx(offset, abs=1e-4)
            relative = state[1] + 1j * state[3] - velocity
            along = (relative * np.conj(offset)).real / abs(offset)
            assert scan.features["range_rate"][row] == pytest.approx(along, abs=6e-3)


def test_the_clutter_of_several_sensors_is_independent_and_that_of_one_unmoved_by_another():
    both = {"sensors": ["one", "two"], "scans": 4, "sensor": {"clutter_density": 1e-6}}
    of_both = {name: [*part] for name, part in Simulator(scenario_from(both), 1).sensors.items()}
    alone = Simulator(scenario_from({**both, "sensors": ["one"]}), 1)
    for one, two, again in zip(of_both["one"], of_both["two"], alone, strict=True):
        assert one.scan.range.tobytes() == again.scan.range.tobytes()
        assert not set(one.scan.range) & set(two.scan.range)


CLUTTER_SENSOR = SensorModel(
    min_range=2000.0, max_range=6000.0, azimuth_min=2.0, azimuth_max=4.5, clutter_density=5e-7
)


@pytest.fixture(scope="module")
def clutter():
    """200 scans of clutter only, over a sector that reaches across pi."""
    return [simulated.scan for simulated in scans_of(scenario(sensor=CLUTTER_SENSOR))]


def test_clutter_is_poisson_in_number_and_uniform_per_area_over_the_coverage(clutter):
    # Mean and dispersion of 200 counts, each at 99.9 % two-sided.
    counts = np.array([len(scan) for scan in clutter])
    expected = 5e-7 * 0.5 * 2.5 * (6000.0**2 - 2000.0**2)
    assert expected == pytest.approx(20.0)
    assert abs(counts.mean() - expected) < 3.3 * math.sqrt(expected / 200)
    dispersion = np.square(counts - counts.mean()).sum() / counts.mean()
    assert 5e-4 < stats.chi2(199).cdf(dispersion) < 1 - 5e-4
    # Kolmogorov-Smirnov at 0.1 % on some 4000 detections: range squared, and azimuth.
    range_ = np.concatenate([scan.range for scan in clutter])
    azimuth = np.concatenate([scan.azimuth for scan in clutter])
    assert CLUTTER_SENSOR.covers(range_, azimuth).all()
    square = (range_**2 - 2000.0**2) / (6000.0**2 - 2000.0**2)
    turned = np.mod(azimuth - 2.0, 2 * np.pi) / 2.5
    for values in (square, turned):
        assert stats.kstest(values, "uniform").pvalue > 1e-3
    assert abs(stats.pearsonr(square, turned).statistic) < 3.3 / math.sqrt(len(square))


def test_a_clutter_box_stays_where_it_is_while_the_ship_moves_and_turns():
    one = scenario(
        sensor=SensorModel(clutter_density=2e-6, max_range=9000.0),
        clutter_box=(1000.0, 3000.0, -500.0, 2000.0),
        own_ship=ScenarioOwnShipMotion(-300.0, 50.0, 1.0, speed=4.0, turn_rate=0.02),
    )
    points = []
    for simulated in Simulator(one, 3):
        x, y, yaw = simulated.scan.sensor_pose
        angle = simulated.scan.azimuth + yaw
        points.append(
            np.stack(
                [x + simulated.scan.range * np.cos(angle), y + simulated.scan.range * np.sin(angle)]
            )
        )
    east, north = np.concatenate(points, axis=1)
    # 2000 expected; 99.9 % of the count, Kolmogorov-Smirnov at 0.1 % on both axes.
    assert abs(len(east) - 2000) < 3.3 * math.sqrt(2000)
    assert stats.kstest((east - 1000.0) / 2000.0, "uniform").pvalue > 1e-3
    assert stats.kstest((north + 500.0) / 2500.0, "uniform").pvalue > 1e-3


SENSOR = SensorModel(
    range_std=20.0,
    range_std_fraction=0.01,
    azimuth_std=0.03,
    detection_probability=0.8,
    clutter_density=1e-15,
)
RING = tuple(
    np.array([4000.0 * math.cos(a), 0.0, 4000.0 * math.sin(a), 0.0])
    for a in np.linspace(-3.0, 3.0, 20)
)


@pytest.fixture(scope="module")
def echoes():
    """20 still targets seen 200 times: errors in units of their deviations, and the origins."""
    errors, origins = [], []
    deviation = math.hypot(20.0, 0.01 * 4000.0)
    for simulated in scans_of(scenario(sensor=SENSOR, targets=RING)):
        truth = simulated.truth[simulated.origin]
        range_error = simulated.scan.range - np.hypot(truth[:, 0], truth[:, 2])
        turned = simulated.scan.azimuth - np.arctan2(truth[:, 2], truth[:, 0])
        azimuth_error = np.remainder(turned + np.pi, 2 * np.pi) - np.pi
        errors.append(np.stack([range_error / deviation, azimuth_error / 0.03]))
        origins.append(simulated.origin)
    return np.concatenate(errors, axis=1), origins


def test_measurement_errors_are_normal_with_the_sensor_s_deviations(echoes):
    # Some 3200 errors: Kolmogorov-Smirnov at 0.1 % against the standard normal, and no
    # correlation between range and azimuth at 99.9 %.
    errors, _ = echoes
    for values in errors:
        assert stats.kstest(values, "norm").pvalue > 1e-3
        assert abs(values.std() - 1) < 3.3 / math.sqrt(2 * len(values))
    assert abs(stats.pearsonr(*errors).statistic) < 3.3 / math.sqrt(errors.shape[1])


def test_targets_outside_the_coverage_or_that_sound_never_reaches_are_not_detected():
    sensor = dataclasses.replace(
        EXACT, min_range=1000.0, max_range=5000.0, azimuth_min=-1.0, azimuth_max=1.0
    )
    positions = [(3000.0, 0.0), (900.0, 0.0), (5100.0, 0.0), (-3000.0, 0.0), (0.0, 3000.0)]
    one = scenario(
        sensor=sensor, targets=tuple(np.array([x, 0.0, y, 0.0]) for x, y in positions), scans=20
    )
    for simulated in Simulator(one, 1):
        assert simulated.origin.tolist() == [0]
    away = np.array([100.0, 2.0, 0.0, 0.0])
    slow_sound = scenario(sensor=EXACT, targets=[away], sound_speed=1.0, scans=5)
    assert [len(one.scan) for one in scans_of(slow_sound)] == [0] * 5


MOVING = scenario(
    sensor=EXACT,
    sound_speed=1500.0,
    scans=20,
    period=30.0,
    targets=(
        np.array([5000.0, -12.0, 300.0, 9.0]),
        np.array([-7000.0, 3.0, 1000.0, -15.0]),
        np.array([100.0, 1.0, -900.0, 2.0]),
    ),
    own_ship=ScenarioOwnShipMotion(50.0, -80.0, 0.6, speed=9.0, turn_rate=-0.015),
)


SQUARE = dataclasses.replace(
    MOVING,
    own_ship=ScenarioWaypointMotion(
        ((-200.0, -200.0), (200.0, -200.0), (200.0, 200.0), (-200.0, 200.0)), 4.0, 0.05, closed=True
    ),
)


def independent_echo(one: Scenario, state: np.ndarray, stamp: float) -> tuple[float, float, float]:
    """Times of reflection and arrival and the azimuth at arrival, by root finding."""

    def target(t):
        return state[0::2] + state[1::2] * t

    sent = one.own_ship.pose(stamp)[:2]
    reflected = brentq(
        lambda t: math.dist(target(t), sent) - 1500.0 * (t - stamp), stamp, stamp + 30, xtol=1e-13
    )
    there = target(reflected)
    arrived = brentq(
        lambda t: math.dist(one.own_ship.pose(t)[:2], there) - 1500.0 * (t - reflected),
        reflected,
        reflected + 30,
        xtol=1e-13,
    )
    x, y, yaw = one.own_ship.pose(arrived)
    return reflected, arrived, math.atan2(there[1] - y, there[0] - x) - yaw


@pytest.mark.parametrize("one", [MOVING, SQUARE], ids=["circle", "square"])
def test_echoes_follow_the_ping_out_to_the_moving_target_and_back_to_the_moving_ship(one):
    # The errors drawn, 1e-6 m and 1e-9 rad, are the smallest that a sensor may have: five of them
    # for each of 60 echoes, and what is left of the equation stays below 1e-6 m.
    for simulated in Simulator(one, 1):
        stamp = simulated.scan.stamp
        assert sorted(simulated.origin.tolist()) == [0, 1, 2]
        for k, target in enumerate(simulated.origin):
            _, arrived, azimuth = independent_echo(one, one.targets[target], stamp)
            range_ = 1500.0 * (arrived - stamp) / 2
            assert abs(simulated.scan.range[k] - range_) < 6e-6
            difference = math.remainder(simulated.scan.azimuth[k] - azimuth, 2 * math.pi)
            assert abs(difference) < 6e-9
            assert (
                abs(
                    math.dist(simulated.truth[target][0::2], simulated.scan.sensor_pose[:2])
                    - range_
                )
                > 1e-3
            )


def test_a_position_is_valid_at_the_middle_of_the_echo_and_the_scan_complete_at_its_end():
    for simulated in Simulator(MOVING, 1, start=500.0):
        np.testing.assert_array_equal(simulated.scan.time_offset, simulated.scan.range / 1500.0)
        last = simulated.scan.stamp + 2 * simulated.scan.range.max() / 1500.0
        assert simulated.complete == pytest.approx(last, abs=1e-9)


def test_one_target_s_luck_does_not_change_another_s():
    # The second target's echo is the same whether the first is within the coverage or not.
    sensor = dataclasses.replace(SENSOR, detection_probability=1.0, max_range=5000.0)
    second = np.array([0.0, 0.0, 3000.0, 0.0])

    def echo_of_second(first: float) -> float:
        targets = (np.array([first, 0.0, 0.0, 0.0]), second)
        (simulated,) = Simulator(scenario(sensor=sensor, targets=targets, scans=1), 5)
        return simulated.scan.range[simulated.origin == 1].item()

    assert echo_of_second(3000.0) == echo_of_second(8000.0)


def test_features_are_those_of_each_target_and_of_clutter():
    # Means within 4 standard errors, deviations within 10 %: over 2000 detections of each.
    given = {"intensity": (50.0, 4.0), "range_width": (30.0, 2.0)}
    drawn = ScenarioTargetArea(1, (2000.0, 9000.0), (0.0, 1.0), 0.0, {"intensity": (70.0, 1.0)})
    one = scenario(
        scans=2000,
        sensor=dataclasses.replace(EXACT, max_range=1e4, clutter_density=3e-9),
        targets=(np.array([5000.0, 0.0, 0.0, 0.0]),),
        target_features=(given,),
        areas=(drawn,),
        clutter_features={"intensity": (20.0, 5.0), "range_width": (1.0, 1e-9)},
    )
    scans = scans_of(one)
    origin = np.concatenate([made.origin for made in scans])
    values = {
        name: np.concatenate([made.scan.features[name] for made in scans])
        for name in ("intensity", "range_width")
    }
    assert set(scans[0].scan.features) == {"intensity", "range_width"}
    for target, (mean, deviation) in {0: (50, 4), 1: (70, 1), CLUTTER: (20, 5)}.items():
        found = values["intensity"][origin == target]
        assert len(found) > 1500
        assert found.mean() == pytest.approx(mean, abs=4 * deviation / math.sqrt(len(found)))
        assert found.std() == pytest.approx(deviation, rel=0.1)
    assert np.isnan(values["range_width"][origin == 1]).all(), "not given"
    np.testing.assert_allclose(values["range_width"][origin == CLUTTER], 1.0, atol=1e-7)


def test_a_patch_adds_clutter_of_its_density_where_the_sensor_sees():
    # The own ship moves; half of the patch is beyond the range. 3.3 standard errors of 4000.
    box = (8000.0, 12000.0, -500.0, 500.0)
    one = scenario(
        scans=200,
        sensor=dataclasses.replace(EXACT, max_range=10_000.0),
        clutter_patches=(ClutterPatch(box, 1e-5),),
        own_ship=ScenarioOwnShipMotion(speed=1.0, yaw=0.5),
    )
    number, expected = 0, 0.0
    for made in Simulator(one, 2):
        x, y, yaw = made.scan.sensor_pose
        azimuth = made.scan.azimuth + yaw
        east = x + made.scan.range * np.cos(azimuth)
        north = y + made.scan.range * np.sin(azimuth)
        assert (east >= box[0] - 1e-6).all()
        assert (np.abs(north) <= 500.0 + 1e-6).all()
        assert (made.origin == CLUTTER).all()
        number += len(made.scan)
        rows = np.linspace(-500.0, 500.0, 201)
        reach = x + np.sqrt(10_000.0**2 - (rows - y) ** 2) - box[0]
        expected += 1e-5 * 1000.0 * reach.mean()
    assert number == pytest.approx(expected, abs=3.3 * math.sqrt(expected))


def test_a_scan_in_parts_sees_each_target_in_the_sector_of_its_time():
    still = np.array([3000.0, 0.0, 4000.0, 0.0])
    moving = np.array([-2000.0, 7.0, -300.0, -3.0])
    one = scenario(targets=(still, moving), sensor=EXACT, scans=6, sound_speed=0.0)
    parts = list(Simulator(one, 1).parts(10))
    assert len(parts) == 60
    assert [part.scan.stamp for part in parts] == pytest.approx(np.arange(60) * 0.5)
    for place, part in enumerate(parts):
        time, start = 0.5 * place, -math.pi + place % 10 * 0.2 * math.pi
        expected = []
        for x, vx, y, vy in (still, moving):
            angle = math.atan2(y + vy * time, x + vx * time)
            if start <= angle < start + 0.2 * math.pi:
                expected.append(math.hypot(x + vx * time, y + vy * time))
        assert sorted(part.scan.range) == pytest.approx(sorted(expected), abs=1e-3)
        assert (part.scan.azimuth >= start - 1e-6).all()
        assert (part.scan.azimuth <= start + 0.2 * math.pi + 1e-6).all()


def test_targets_are_there_at_the_first_scans_after_a_warm_up_of_any_sensor():
    scene = {"sensors": ["a", "b"], "scans": 30, "warm_up": 3, "targets": [{"state": [9, 0, 9, 0]}]}
    scenario = scenario_from(scene | {"a": {"period": 0.1}, "b": {"period": 0.3}}, "two.yaml")
    assert len(Simulator(scenario, 1).truth(0.3)) == 1, "3 * 0.1 is above 0.3"


def test_the_targets_appear_after_the_warm_up_in_their_states():
    scenario = load_scenario("box", {"warm_up": 5, "scans": 4})
    simulator = Simulator(scenario, 3)
    scans = list(simulator)
    assert len(scans) == 9
    for index, simulated in enumerate(scans):
        assert simulated.scan.stamp == 12.0 * index
        assert len(simulated.truth) == (index >= 5)
        assert index >= 5 or (simulated.origin < 0).all()
        assert len(simulated.origin) > 10
    assert scans[5].truth.tolist() == [[5000.0, 5.0, 5000.0, 0.0]]
    assert scans[8].truth[0, 0] == 5000.0 + 3 * 12.0 * 5.0
    hits = [scan for scan in scans if (scan.origin == 0).any()]
    assert len(hits) >= 2
    for simulated in hits:
        (row,) = np.flatnonzero(simulated.origin == 0)
        x, _, y, _ = simulated.truth[0]
        assert abs(simulated.scan.range[row] - np.hypot(x, y)) < 5 * 0.015 * np.hypot(x, y)
