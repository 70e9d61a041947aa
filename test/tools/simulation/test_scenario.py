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
"""Scenarios: what can be simulated, strengths of echoes, and files refused by their keys."""

import dataclasses
import math
import re

import numpy as np
import pytest
from scipy import stats

from tsepm_ros.tools.simulation import Simulator, load_scenario
from tsepm_ros.tools.simulation.scenario import (
    ClutterStrength,
    ScenarioOwnShipMotion,
    ScenarioStrengths,
    ScenarioTargetArea,
    TargetStrength,
    scenario_from,
)


def test_the_box_is_the_paper_s_scene():
    box = load_scenario("box")
    assert [state.tolist() for state in box.targets] == [[5000.0, 5.0, 5000.0, 0.0]]
    assert (box.period, box.sensor.clutter_density) == (12.0, 1e-6)
    assert box.area == 6000.0**2
    assert box.duration == 15 * 12.0


def test_degrees_are_read_where_a_key_says_so():
    scenario = scenario_from(
        {
            "own_ship": {"yaw_deg": 90.0, "turn_rate_deg": 1.0, "speed": 5.0},
            "targets": [{"ranges": [1, 2], "azimuths_deg": [0, 180], "speed": 0.1, "count": 3}],
        }
    )
    assert scenario.own_ship.yaw == pytest.approx(math.pi / 2)
    assert scenario.own_ship.turn_rate == pytest.approx(math.radians(1.0))
    assert scenario.areas == (ScenarioTargetArea(3, (1.0, 2.0), (0.0, math.pi), 0.1),)


def area(**changes):
    return {"targets": [{"ranges": [10, 20], "azimuths": [0, 1], "speed": 1.0, **changes}]}


SQUARE = [[0.0, 0.0], [400.0, 0.0], [400.0, 400.0], [0.0, 400.0]]


def course(**changes):
    return {"own_ship": {"waypoints": SQUARE, "speed": 4.0, "turn_rate": 0.05, **changes}}


def two(**changes):
    """A picture of two sensors."""
    return {"sensors": ["port", "mast"], "scans": 8, "period": 2.0, **changes}


def test_a_sensor_of_several_takes_its_own_values_and_else_the_plain_ones():
    scene = scenario_from(
        two(
            sensor={"max_range": 500.0, "azimuth_std_deg": 2.0},
            sound_speed=1500.0,
            warm_up=2,
            own_ship={"speed": 3.0},
            targets=[{"state": [1, 0, 1, 0]}],
            port={"mounting": {"x": 2.0, "yaw_deg": 90.0}, "sensor": {"azimuth_std": 0.01}},
            mast={"period": 0.5, "sound_speed": 0.0, "sensor": {"max_range": 900.0}},
        ),
        "pier.yaml",
    )
    port, mast = scene.sensors.values()
    assert list(scene.sensors) == ["port", "mast"]
    assert (port.sensor.max_range, mast.sensor.max_range) == (500.0, 900.0)
    assert port.sensor.azimuth_std == 0.01, "degrees below do not hold beside its own radians"
    assert mast.sensor.azimuth_std == pytest.approx(math.radians(2.0))
    assert (port.sound_speed, mast.sound_speed) == (1500.0, 0.0)
    assert (port.mounting.x, port.mounting.yaw) == (2.0, pytest.approx(math.pi / 2))
    assert not mast.mounting.given
    assert (port.scans, port.warm_up, mast.scans, mast.warm_up) == (8, 2, 32, 8)
    assert (scene.name, scene.scans, scene.warm_up, scene.target_start) == ("pier", 40, 10, 4.0)
    assert scene.period * scene.scans == pytest.approx(16.0)
    expected = (8 * port.area + 32 * mast.area) / 40
    assert scene.area == pytest.approx(expected), "the mean over the scans"
    assert all(one.own_ship.speed == 3.0 and len(one.targets) == 1 for one in (port, mast))


def test_a_change_of_a_value_of_one_sensor_leaves_the_others(tmp_path):
    path = tmp_path / "pier.yaml"
    path.write_text("sensors: [port, mast]\nport: {sensor: {max_range: 500.0}}\n")
    changes = {"port.sensor.clutter_density": 1e-5, "sensor.max_range": 900.0}
    port, mast = load_scenario(str(path), changes).sensors.values()
    assert (port.sensor.max_range, port.sensor.clutter_density) == (500.0, 1e-5)
    assert (mast.sensor.max_range, mast.sensor.clutter_density) == (900.0, 1e-6)


REFUSED = [
    (two(port={"sensor": {"rnage_std": 1}}), "scenario.port.sensor: unknown key 'rnage_std'"),
    (two(port={"scans": 9}), "scenario.port.scans: scans is of the picture as a whole; give scans"),
    (two(port={"targets": []}), "scenario.port.targets: targets is of the picture as a whole"),
    (two(port={"period": -1.0}), "scenario.port.period must be above 0"),
    (two(port=5), "scenario.port must be a mapping"),
    (two(prot={}), "unknown key 'prot'; known are name, "),
    (two(sensors="port"), "sensors must be "),
    (two(sensors=["port", "port"]), "sensors must be at most 32 different names"),
    (two(sensors=["targets"]), "scenario.sensors must be names, none of them a key such as period"),
    (two(sensors=[]), "scenario.sensors must be names"),
    (two(warm_up=1, mast={"period": 1.5}), "no whole scans of mast of 1.5 s: give a multiple"),
    (two(mast={"period": 1e-7}), "scenario.scans must be from 1 to 10000000; got 160000008"),
    ({"mounting": {"roll": 3.14}}, "scenario.mounting: unknown key 'roll'; known are x, y, yaw"),
    ({"mounting": {"x": 5000.0}}, "scenario.mounting: x must be"),
    ([], "must be a mapping"),
    (None, "must be a mapping"),
    ({"colour": 1}, "unknown key 'colour'"),
    ({"sensor": {"rnage_std": 1.0}}, "sensor: unknown key 'rnage_std'"),
    ({"sensor": {"azimuth_std": -1}}, "sensor: azimuth_std must be"),
    ({"sensor": None}, "sensor must be a mapping"),
    ({"own_ship": {"sped": 1.0}}, "own_ship: unknown key 'sped'"),
    ({"own_ship": {"speed": math.nan}}, "own_ship.speed"),
    ({"own_ship": 5}, "own_ship must be a mapping"),
    (course(waypoints=None), "own_ship.waypoints must be a list"),
    (course(waypoints=[[0, 0], [1]]), "own_ship.waypoints[1] must be"),
    (course(waypoints=[[0, 0]]), "own_ship: waypoints must be at least two"),
    (course(waypoints=[[0, 0]] * 2), "each apart from the one before"),
    (course(turn_rate=0.01), "turns of 400 m radius do not fit"),
    (course(waypoints=[[0, 0], [900, 0], [0, 0]]), "radius do not fit"),
    (course(turn_rate=0.0), "turn_rate above 0"),
    (course(speed=-1.0), "speed must be at least 0"),
    (course(closed="yes"), "closed must be true or false"),
    (course(yaw=1.0), "own_ship: unknown key 'yaw'"),
    (
        {"target": []},
        "unknown key 'target'; known are name, scans, period, sensor, sound_speed, targets",
    ),
    ({"areas": []}, "areas are given under targets"),
    ({"targets": [{"ranges": [100.0, 200.0]}]}, "targets[0]: azimuths is missing"),
    ({"scans": 0}, "scans"),
    ({"warm_up": -1}, "warm_up must be from 0 to"),
    ({"name": "a/b"}, "name must be a text without /"),
    ({"name": 5}, "name must be a text without /"),
    ({"period": 0.0}, "period"),
    ({"period": -12.0}, "period"),
    ({"period": math.inf}, "period must be a finite number"),
    ({"sound_speed": -1.0}, "sound_speed"),
    ({"clutter_box": [0, 1, 0]}, "clutter_box must be a list of 4"),
    ({"clutter_box": "big"}, "clutter_box must be a list of 4"),
    ({"targets": [5]}, "targets[0] must be a mapping"),
    ({"targets": [{"state": [1, 2, 3]}]}, "targets[0].state must be a list"),
    ({"targets": [{"state": [1, 2, 3, math.nan]}]}, "targets[0].state must be"),
    ({"targets": [{"state": [1, 2, 3, 10**400]}]}, "targets[0].state must be"),
    (area(ranges=None), "targets[0].ranges must be a list of 2"),
    (area(azimuths=[0]), "targets[0].azimuths must be a list of 2"),
    (area(spede=1.0), "targets[0]: unknown key 'spede'"),
    (area(features={"colour": [1, 2]}), "targets[0].features: unknown key 'colour'"),
    ({"clutter_features": {"intensity": 5.0}}, "clutter_features.intensity must be a list of 2"),
    (
        {"clutter_features": {"intensity": [5.0, -1.0]}},
        "clutter_features.intensity: standard deviation",
    ),
    ({"clutter_patches": 5}, "clutter_patches must be a list"),
    (
        {"clutter_patches": [{"box": [0, 1, 0], "density": 1e-6}]},
        "clutter_patches[0].box must be a list of 4",
    ),
    (
        {"clutter_patches": [{"box": [0, 1, 0, 1], "density": -1e-6}]},
        "clutter_patches[0]: density must be at least 0",
    ),
    ({"clutter_patches": [{"box": [0, 1, 0, 1]}]}, "clutter_patches[0]:"),
    ({"targets": None}, "targets"),
    ({"targets": 5}, "targets"),
    ({"scans": "16"}, "scans"),
    ({"scans": 2.5}, "scans"),
    ({"period": "12"}, "period"),
    ({"sound_speed": None}, "sound_speed"),
    ({"own_ship": {"speed": "fast"}}, "own_ship"),
    ({"own_ship": {"yaw_deg": "east"}}, "own_ship"),
    (area(count=-1), "count"),
    (area(count=1.5), "count"),
    (area(speed="fast"), "speed"),
    (area(ranges=[20, 10]), "ranges"),
    ({"clutter_box": [8000, 2000, 0, 1]}, "clutter_box"),
    ({"targets": [{"state": [1, 2, 3, 4], "sped": 1}]}, "sped"),
    ({"areas": 5}, "areas"),
]


@pytest.mark.parametrize(("content", "sentence"), REFUSED)
def test_a_bad_scenario_is_refused_by_its_key(content, sentence):
    with pytest.raises(ValueError) as refused:
        scenario_from(content)
    assert sentence in str(refused.value)


def test_drawn_targets_that_cannot_stay_in_their_ranges_are_refused():
    with pytest.raises(ValueError, match=r"no target stays within \(10.0, 20.0\) m"):
        Simulator(scenario_from(area(speed=50.0)), 1)


def test_a_missing_or_malformed_file_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"cannot be read: No such file .*check the path"):
        load_scenario(str(tmp_path / "none.yaml"))
    for content in ("a: [1, 2", "targets: " + "[" * 5_000):
        (tmp_path / "bad.yaml").write_text(content)
        with pytest.raises(ValueError, match="is not valid YAML"):
            load_scenario(str(tmp_path / "bad.yaml"))


def integrated(motion: ScenarioOwnShipMotion, time: float, steps: int = 20_000) -> np.ndarray:
    """The pose by small steps."""
    t = (np.arange(steps) + 0.5) * time / steps
    yaw = motion.yaw + motion.turn_rate * t
    x = motion.x + motion.speed * np.cos(yaw).sum() * time / steps
    y = motion.y + motion.speed * np.sin(yaw).sum() * time / steps
    return np.array([x, y, motion.yaw + motion.turn_rate * time])


@pytest.mark.parametrize("turn_rate", [0.0, 1e-12, 1e-6, 0.01, -0.02])
@pytest.mark.parametrize("time", [0.0, 30.0, 600.0])
def test_the_own_ship_moves_along_its_heading(turn_rate, time):
    motion = ScenarioOwnShipMotion(10.0, -20.0, 2.5, speed=7.0, turn_rate=turn_rate)
    np.testing.assert_allclose(motion.pose(time), integrated(motion, time), atol=1e-3)


COURSES = {
    "square": course(closed=True),
    "clockwise": course(closed=True, waypoints=SQUARE[::-1]),
    "open": course(),
    "straight through": course(closed=True, waypoints=[[0, 0], [200, 0], *SQUARE[1:]]),
    "zigzag": course(waypoints=[[0, 0], [300, 0], [500, 250], [800, 100], [1000, 600]]),
}


@pytest.mark.parametrize("name", COURSES)
def test_a_course_is_run_at_its_speed_and_turns_at_its_rate(name):
    motion = scenario_from(COURSES[name]).own_ship
    times = np.arange(0.0, 1500.0, 0.25)
    poses = np.array([motion.pose(time) for time in times])
    # No jump, no step aside, no slowing down: chords of arcs are shorter by (0.05 * 0.25)^2 / 24.
    steps = np.diff(poses[:, :2], axis=0)
    np.testing.assert_allclose(np.hypot(*steps.T), 4.0 * 0.25, rtol=1e-5)
    turned = wrapped(np.diff(poses[:, 2]))
    along = np.arctan2(steps[:, 1], steps[:, 0]) - (poses[:-1, 2] + turned / 2)
    np.testing.assert_allclose(wrapped(along), 0.0, atol=2e-3)
    assert np.abs(turned).max() <= 0.05 * 0.25 + 1e-12
    rates = np.array([motion.rates(time) for time in times])
    np.testing.assert_allclose(np.hypot(*rates.T[:2]), 4.0)
    ahead = np.arctan2(rates[:, 1], rates[:, 0]) - poses[:, 2]
    np.testing.assert_allclose(wrapped(ahead), 0.0, atol=1e-9)
    same = rates[:-1, 2] == rates[1:, 2]
    np.testing.assert_allclose(turned[same], 0.25 * rates[:-1, 2][same], atol=1e-12)


def wrapped(angle):
    return np.remainder(np.asarray(angle) + math.pi, 2 * math.pi) - math.pi


@pytest.mark.parametrize("name", COURSES)
def test_a_course_touches_its_sides_and_cuts_its_corners(name):
    motion = scenario_from(COURSES[name]).own_ship
    places = np.array([motion.pose(time)[:2] for time in np.arange(0.0, 900.0, 0.1)])
    corners = np.array(motion.waypoints)
    ends = np.roll(corners, -1, axis=0) if motion.closed else corners[1:]
    for begin, end in zip(corners, ends, strict=False):
        middle = 0.5 * (begin + end)
        assert np.hypot(*(places - middle).T).min() < 0.25, "not cut half way"
    for before, at, after in zip(corners, corners[1:], corners[2:], strict=False):
        one, other = at - before, after - at
        turn = abs(wrapped(math.atan2(*other[::-1]) - math.atan2(*one[::-1])))
        # An arc of radius R between two tangents passes their corner at R (1 / cos(turn / 2) - 1).
        expected = 80.0 * (1 / math.cos(turn / 2) - 1)
        assert np.hypot(*(places - at).T).min() == pytest.approx(expected, abs=0.25)


def test_a_closed_course_repeats_and_an_open_one_goes_straight_on():
    square, way = (scenario_from(course(closed=closed)).own_ship for closed in (True, False))
    lap = (1600.0 - 4 * 2 * 80.0) / 4.0 + 2 * math.pi / 0.05
    for time in (100.0, 333.0, 500.0):
        np.testing.assert_allclose(square.pose(time + 3 * lap), square.pose(time), atol=1e-9)
        further = way.pose(1e4 + time) - way.pose(1e4)
        np.testing.assert_allclose(further, [-4.0 * time, 0.0, 0.0], atol=1e-9)
    assert way.pose(1e4)[1] == pytest.approx(400.0)


@pytest.mark.parametrize(
    "one",
    [
        ScenarioTargetArea(40, (6000.0, 9000.0), (0.0, math.pi / 2), 5.0),
        ScenarioTargetArea(40, (1000.0, 1600.0), (-1.0, 4.0), 8.0),
        ScenarioTargetArea(40, (100.0, 2000.0), (0.0, 2 * math.pi), 10.0),
    ],
    ids=["quadrant", "narrow ring", "round the middle"],
)
def test_drawn_targets_stay_within_their_ranges_for_the_whole_run(one):
    states = np.array(one.draw(np.random.default_rng(1), 180.0))
    assert len(states) == 40
    assert np.hypot(states[:, 1], states[:, 3]) == pytest.approx(np.full(40, one.speed))
    azimuth = np.mod(np.arctan2(states[:, 2], states[:, 0]) - one.azimuths[0], 2 * np.pi)
    assert (azimuth <= one.azimuths[1] - one.azimuths[0] + 1e-12).all()
    for t in np.linspace(0.0, 180.0, 300):
        distance = np.hypot(states[:, 0] + t * states[:, 1], states[:, 2] + t * states[:, 3])
        assert (distance >= one.ranges[0] - 1e-9).all()
        assert (distance <= one.ranges[1] + 1e-9).all()


def test_still_targets_are_drawn_with_equal_probability_per_area():
    # Radii squared are uniform: Kolmogorov-Smirnov on 2000 draws at 0.1 %, distance 0.044.
    one = ScenarioTargetArea(2000, (1000.0, 3000.0), (0.0, 1.0), 0.0)
    states = np.array(one.draw(np.random.default_rng(2), 100.0))
    square = (np.square(states[:, 0]) + np.square(states[:, 2]) - 1e6) / 8e6
    gap = np.abs(np.sort(square) - (np.arange(2000) + 0.5) / 2000).max()
    assert gap < 0.044


BOX = load_scenario("box")
MANY = 20_000


def clutter(law: ClutterStrength, n: int = MANY, seed: int = 1, position=None, time: float = 0.0):
    drawn = ScenarioStrengths(law, [], np.random.default_rng(seed))
    position = np.zeros((n, 2)) if position is None else position
    return drawn.draw(position, np.full(len(position), -1), time)


def echoes(target: TargetStrength, seed: int = 1):
    drawn = ScenarioStrengths(ClutterStrength(), [target], np.random.default_rng(seed))
    return drawn.draw(np.zeros((MANY, 2)), np.zeros(MANY, np.int64), 0.0)


def test_k_clutter_is_a_gamma_texture_times_an_exponential():
    found = clutter(ClutterStrength("k", 0.5))
    expected = np.random.default_rng(2).gamma(0.5, 2.0, MANY)
    expected = expected * np.random.default_rng(3).exponential(size=MANY)
    assert stats.ks_2samp(found, expected).pvalue > 0.01


@pytest.mark.parametrize(
    ("drawn", "law"),
    [
        (clutter(ClutterStrength()), stats.expon()),
        (echoes(TargetStrength(6.0)), stats.expon(scale=1.0 + 10.0**0.6)),
        # 2 |sqrt(P) + c|^2 is noncentral chi-square of two degrees of freedom.
        (2.0 * echoes(TargetStrength(10.0, "steady")), stats.ncx2(2, 2.0 * 10.0)),
    ],
    ids=["Rayleigh clutter", "Swerling 1", "steady: Rician"],
)
def test_strengths_have_the_law_of_their_kind(drawn, law):
    assert stats.kstest(drawn, law.cdf).pvalue > 0.01


def test_a_swerling_3_target_fluctuates_less_than_one_of_swerling_1():
    power = 10.0
    variance = {}
    for kind in ("swerling_1", "swerling_3", "steady"):
        found = echoes(TargetStrength(10.0, kind))
        assert found.mean() == pytest.approx(1.0 + power, rel=0.03)
        variance[kind] = found.var()
    # Var |A + c|^2 = Var P + 2 P + 1, with Var P = P^2, P^2 / 2 and 0.
    expected = {"swerling_1": power**2, "swerling_3": power**2 / 2.0, "steady": 0.0}
    for kind, of_power in expected.items():
        assert variance[kind] == pytest.approx(of_power + 2.0 * power + 1.0, rel=0.06)


@pytest.mark.parametrize(("apart", "later"), [(0.0, 0.0), (250.0, 0.0), (0.0, 90.0), (2000.0, 0.0)])
def test_texture_is_common_to_neighbours_and_fades(apart, later):
    law = ClutterStrength("log_normal", 1.0, texture_length=500.0, texture_time=180.0)
    pairs = []
    for seed in range(400):
        drawn = ScenarioStrengths(law, [], np.random.default_rng(seed))
        origin = np.array([-1])
        one = drawn.draw(np.zeros((1, 2)), origin, 0.0)[0]
        other = drawn.draw(np.array([[apart, 0.0]]), origin, later)[0]
        pairs.append((math.log(one), math.log(other)))
    found = np.corrcoef(np.array(pairs).T)[0, 1]
    expected = math.exp(-0.5 * (apart / 500.0) ** 2 - later / 180.0)
    assert found == pytest.approx(expected, abs=0.12)


def test_strengths_change_no_position_of_a_seed():
    strong = dataclasses.replace(
        BOX, clutter_strength=ClutterStrength("k", 0.5), target_strengths=(TargetStrength(6.0),)
    )
    for plain, other in zip(Simulator(BOX, 3), Simulator(strong, 3), strict=True):
        assert plain.scan.range.tobytes() == other.scan.range.tobytes()
        assert plain.scan.azimuth.tobytes() == other.scan.azimuth.tobytes()
        assert "intensity" not in plain.scan.features
        assert np.isfinite(other.scan.features["intensity"]).all()


def test_a_scenario_file_gives_strengths():
    scene = scenario_from(
        {
            "clutter_strength": {"law": "k", "shape": 0.5, "texture_length": 500},
            "targets": [
                {"state": [1, 0, 1, 0], "strength": {"ratio_db": 6, "fluctuation": "steady"}},
                {
                    "ranges": [100, 2000],
                    "azimuths": [0, 1],
                    "speed": 2.0,
                    "strength": {"ratio_db": 3.0},
                },
            ],
        }
    )
    assert scene.clutter_strength == ClutterStrength("k", 0.5, 500.0)
    assert scene.target_strengths == (TargetStrength(6.0, "steady"),)
    assert scene.areas[0].strength == TargetStrength(3.0)


def strong(**strength):
    target = {"state": [1, 0, 1, 0], "strength": strength}
    return {"clutter_strength": {}, "targets": [target]}


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ({"clutter_strength": {"law": "chi"}}, "clutter_strength: law must be one of rayleigh"),
        ({"clutter_strength": {"law": "k", "shape": 0.0}}, "shape must be from"),
        ({"clutter_strength": {"texture_length": -1.0}}, "texture_length must be"),
        ({"clutter_strength": 3}, "clutter_strength must be a mapping"),
        ({"targets": strong(ratio_db=6.0)["targets"]}, "clutter_strength must be given too"),
        (strong(fluctuation="steady"), "targets[0].strength"),
        (strong(ratio_db=900.0), "ratio_db must be from -100 to 100"),
        (strong(ratio_db=6, fluctuation="swerling_2"), "fluctuation must be one of"),
    ],
)
def test_a_wrong_strength_is_refused_by_its_name(content, said):
    with pytest.raises(ValueError, match=re.escape(said)):
        scenario_from(content)


def test_a_target_without_a_strength_has_none():
    scene = dataclasses.replace(BOX, clutter_strength=ClutterStrength(), target_strengths=(None,))
    for simulated in Simulator(scene, 1):
        missing = np.isnan(simulated.scan.features["intensity"])
        assert (missing == (simulated.origin == 0)).all()
