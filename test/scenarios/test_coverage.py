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
"""Coverage in whole scenes: sectors that turn with the ship, whole turns, what is outside."""

import dataclasses
import functools
import math

import numpy as np
import pytest

from tsepm_ros import Scan, SensorModel, make_initiator
from tsepm_ros.methods.registry import available_methods
from tsepm_ros.own_ship.pose_history import PoseSample
from tsepm_ros.own_ship.registration import UnregisteredScan
from tsepm_ros.session.session import Session
from tsepm_ros.settings.node_options import SessionOptions
from tsepm_ros.settings.settings import Settings
from tsepm_ros.tools.simulation import Simulator
from tsepm_ros.tools.simulation.scenario import Scenario, ScenarioOwnShipMotion
from tsepm_ros.tracker.options import CommonOptions, ScoreOptions

SECTOR = SensorModel(
    max_range=4000.0,
    azimuth_min=-math.pi / 3,
    azimuth_max=math.pi / 3,
    detection_probability=0.8,
    clutter_density=2e-6,
)

WEST = ScenarioOwnShipMotion(yaw=math.pi, speed=4.0, turn_rate=math.radians(0.5))

AHEAD = np.array([-2500.0, -3.0, 300.0, 1.0])


def scenario(**more) -> Scenario:
    given = {"scans": 30, "period": 6.0, "sensor": SECTOR, "sound_speed": 1500.0}
    return Scenario("sector", **{**given, "targets": (AHEAD,), "own_ship": WEST, **more})


def session(scene: Scenario, source: str = "odometry", **more) -> Session:
    settings = Settings(
        SessionOptions(own_ship_source=source, own_ship_max_gap=60.0, fixed_frame="map"),
        sensor=scene.sensor,
        common=CommonOptions(max_speed=8.0, **more),
        methods={"score": ScoreOptions(false_tracks_per_hour=30.0)},
    )
    return Session(settings)


def sailing(scene: Scenario, covariance: np.ndarray | None = None, **more) -> Session:
    """A session that knows the own-ship motion."""
    one = session(scene, **more)
    for time in np.arange(-1.0, scene.scans * scene.period + 20.0, 0.5):
        one.add_own_ship(PoseSample(time, *scene.own_ship.pose(time), covariance, frame_id="map"))
    return one


def from_north(scan: Scan, scene: Scenario) -> UnregisteredScan:
    """The scan with azimuths that count from the fixed frame's x axis."""
    delay = np.zeros(len(scan)) if scan.time_offset is None else scan.time_offset
    yaw = [scene.own_ship.pose(time)[2] for time in scan.stamp + 2.0 * delay]
    turned = dataclasses.replace(scan, azimuth=scan.azimuth + np.array(yaw))
    return UnregisteredScan(turned, "sonar", north_referenced=True)


def by_bow(scan: Scan, scene: Scenario) -> UnregisteredScan:
    return UnregisteredScan(scan, "sonar")


def run(scene: Scenario, arriving, seed: int, **more) -> list:
    one = sailing(scene, **more)
    for simulated in Simulator(scene, seed):
        one.add_scan(arriving(simulated.scan, scene), 0.0)
    return list(one.process())


@pytest.mark.parametrize("density", ["given", "estimated"])
def test_bearings_from_north_give_the_same_tracks_as_those_from_the_bow(density):
    scene = scenario()
    bow, north = (run(scene, how, 1, clutter_density=density) for how in (by_bow, from_north))
    assert sum(len(result.new) for result in bow) > 0
    for one, other in zip(bow, north, strict=True):
        assert [track.hits for track in one.new] == [track.hits for track in other.new]
        np.testing.assert_allclose(one.current.state, other.current.state, rtol=1e-6, atol=1e-6)
        pose, expected = (result.scan.sensor_pose for result in (other, one))
        np.testing.assert_allclose(pose, expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize(("sensor", "dropped"), [(SECTOR, 1), (SensorModel(), 0)])
@pytest.mark.parametrize("source", ["none", "odometry"])
def test_a_sector_of_bearings_from_north_needs_a_heading(sensor, dropped, source):
    scene = scenario(sensor=sensor)
    unknown = np.diag([1.0, 1.0, 1e6])
    one = session(scene, source) if source == "none" else sailing(scene, unknown)
    scan = Scan(5.0, [1000.0, 2000.0], [0.0, 1.0])
    one.add_scan(UnregisteredScan(scan, "sonar", north_referenced=True), 0.0)
    found = list(one.process())
    assert len(found) == 1 - dropped
    assert one.dropped["heading_unknown"] == dropped
    for result in found:
        np.testing.assert_array_equal(result.scan.azimuth, scan.azimuth)


def test_an_empty_scan_without_a_pose_keeps_that_of_the_scan_before():
    initiator = make_initiator("score", sensor=SECTOR)
    initiator.process(Scan(0.0, [1000.0], [0.0], sensor_pose=[[500.0, 0.0, 1.0]]))
    initiator.process(Scan(6.0, [], [], sensor_pose=np.zeros((0, 3))))
    assert initiator.sensor.detection_probability_at(
        np.array([[600.0, 200.0], [500.0, -900.0]])
    ).tolist() == [0.8, 0.0]


DISC = SensorModel(max_range=4000.0, clutter_density=2e-6)

EDGE = SensorModel(
    range_std=10.0,
    range_std_fraction=0.0,
    azimuth_std=0.01,
    min_range=500.0,
    max_range=1000.0,
    azimuth_min=-1.0,
    azimuth_max=1.0,
)


def clutter(seed: int, scans: int):
    """Scans of clutter over the whole of DISC."""
    rng = np.random.default_rng(seed)
    for k in range(scans):
        n = rng.poisson(DISC.clutter_density * DISC.coverage_area)
        range_ = DISC.max_range * np.sqrt(rng.uniform(1e-6, 1.0, n))
        yield Scan(6.0 * k, range_, rng.uniform(-math.pi, math.pi, n))


@pytest.mark.long
@pytest.mark.parametrize(
    "given",
    [
        pytest.param({}, id="right"),
        pytest.param({"max_range": 3500.0}, id="3500 m"),
        pytest.param({"max_range": 2800.0}, id="2800 m"),
        pytest.param({"azimuth_min": -1.0, "azimuth_max": 1.0}, id="sector"),
    ],
)
def test_a_coverage_given_too_small_does_not_flood_false_tracks(given):
    sensor = dataclasses.replace(DISC, **given)
    initiator = make_initiator("score", sensor=sensor, false_tracks_per_hour=20.0)
    found = sum(len(initiator.process(scan)) for scan in clutter(3, 600))
    assert found <= 35, "20 wished for in an hour: Poisson, 99.9 %"


@pytest.mark.parametrize("method", available_methods())
def test_no_method_starts_a_track_on_detections_outside_the_coverage(method):
    initiator = make_initiator(method, sensor=EDGE)
    hits = []
    for k in range(12):
        here = 700.0 + 4.0 * k
        scan = Scan(4.0 * k, [here + 1000.0, here, here], [0.0, 0.0, 2.0])
        hits += [hit for track in initiator.process(scan) for hit in track.hits]
        assert initiator.statistics.detections == 1
        assert initiator.statistics.outside_coverage == 2
    assert hits
    assert {row for _, row in hits} == {1}, "rows are those of the scan as sent"
    assert initiator.totals.outside_coverage == 24


def test_a_hypothesis_beyond_the_edge_pays_for_no_miss_and_gains_by_no_hit():
    initiator = make_initiator("score", sensor=EDGE)
    for k in range(4):
        initiator.process(Scan(4.0 * k, [1020.0], [0.0]))
    assert initiator.statistics.potential_tracks == 4, "each detection's own start, and no pair"
    np.testing.assert_array_equal(initiator.method.hypotheses.score, 0.0)


def test_detections_outside_the_coverage_are_counted_and_said():
    said = []
    settings = Settings(SessionOptions(), sensor=EDGE)
    one = Session(settings, lambda reason, sentence: said.append((reason, sentence)))
    one.add_scan(UnregisteredScan(Scan(0.0, [700.0, 1100.0, 700.0], [0.0, 0.0, 2.0]), "sonar"), 0.0)
    one.add_scan(UnregisteredScan(Scan(4.0, [700.0], [0.0]), "sonar"), 0.0)
    first, _ = one.process()
    assert len(first.scan) == 3
    assert one.dropped == {"outside_coverage": 2}
    ((reason, sentence),) = said
    assert reason == "outside_coverage"
    assert sentence.startswith("2 of 3 detections dropped")


def turned_scans(seed: int, turn: float = 0.0) -> list[Scan]:
    """Two targets, one of which crosses the azimuth pi, a quay and false detections, turned."""
    rng, made = np.random.default_rng(seed), []
    for stamp in np.arange(0.0, 40.0, 0.5):
        targets = np.array([[-150.0, 40.0 - 2.0 * stamp], [120.0 - 1.5 * stamp, 60.0 + stamp]])
        along = rng.uniform(-100.0, 100.0, 6)
        quay = np.stack([140.0 + 0.3 * along, 0.95 * along], axis=1)
        false = rng.uniform(-290.0, 290.0, (rng.poisson(6), 2))
        echoes = np.concatenate([targets[rng.random(2) < 0.9], quay, false])
        range_ = np.hypot(*echoes.T) + rng.standard_normal(len(echoes))
        azimuth = np.arctan2(echoes[:, 1], echoes[:, 0]) + 0.01 * rng.standard_normal(len(echoes))
        made.append(Scan(stamp, range_, np.remainder(azimuth + turn + math.pi, math.tau) - math.pi))
    return made


@functools.cache
def followed(low: float, high: float, seed: int, turn: float = 0.0):
    """The initiator after the scans, with density and P_D learned; its current tracks."""
    sensor = SensorModel(
        range_std=1.0,
        range_std_fraction=0.0,
        azimuth_std=0.01,
        max_range=300.0,
        azimuth_min=low + turn,
        azimuth_max=high + turn,
    )
    initiator = make_initiator("score", sensor=sensor, max_speed=10.0, min_speed=0.5)
    current = []
    for scan in turned_scans(seed, turn):
        initiator.process(scan)
        current.append(initiator.current)
    return initiator, current


@pytest.mark.parametrize(
    ("low", "high"),
    [
        (-3.1415, 3.1415),
        *(pytest.param(*ends, marks=pytest.mark.long) for ends in ((-3.14, 3.14), (0.0, 6.283))),
    ],
)
def test_a_full_turn_in_other_numbers_is_the_same_to_the_bit(low, high):
    _, expected = followed(-math.pi, math.pi, seed=3)
    _, found = followed(low, high, seed=3)
    assert sum(map(len, expected)) > 50
    for one, other in zip(found, expected, strict=True):
        assert one.track_id.tolist() == other.track_id.tolist()
        np.testing.assert_array_equal(one.state, other.state)
        np.testing.assert_array_equal(one.covariance, other.covariance)
        np.testing.assert_array_equal(one.existence_probability, other.existence_probability)


@pytest.mark.parametrize("turn", [0.7, pytest.param(2.5, marks=pytest.mark.long), -3.0])
def test_data_and_sector_turned_together_give_the_tracks_turned(turn):
    first, expected = followed(-1.5, 2.6, seed=1)
    second, found = followed(-1.5, 2.6, seed=1, turn=turn)
    assert first.sensor.learned.fixed_places.known, "the quay"
    assert second.sensor.learned.fixed_places.known
    cos, sin = math.cos(turn), math.sin(turn)
    axes = np.kron(np.array([[cos, -sin], [sin, cos]]), np.eye(2))
    assert sum(map(len, expected)) > 50
    for one, other in zip(found, expected, strict=True):
        assert one.track_id.tolist() == other.track_id.tolist()
        np.testing.assert_allclose(one.state, other.state @ axes.T, rtol=0, atol=1e-9 * 300.0)
        turned = axes @ other.covariance @ axes.T
        np.testing.assert_allclose(
            one.covariance, turned, rtol=0, atol=1e-9 * np.abs(turned).max(initial=0)
        )
        np.testing.assert_allclose(
            one.existence_probability, other.existence_probability, rtol=1e-9
        )


def test_parts_of_a_turn_that_look_elsewhere_end_no_track():
    # 16 parts a turn; the target is missed in four looks at it, which are 64 scans.
    parts, rng = 16, np.random.default_rng(3)
    sensor = SensorModel(range_std=0.5, range_std_fraction=0.0, azimuth_std=0.005, max_range=100.0)
    initiator = make_initiator("score", sensor=sensor, max_speed=2.0, window=64)
    ended = {}
    for number in range(parts * 24):
        turn, part = divmod(number, parts)
        here = int(part == 8 and turn not in range(14, 18))
        range_ = 50.0 + 0.5 * rng.standard_normal(here)
        azimuth = math.pi / parts + 0.005 * rng.standard_normal(here)
        width = 2.0 * math.pi / parts
        swept = ((part - 8) * width, width)
        initiator.process(Scan(number / 20.0, range_, azimuth, swept=swept))
        ended |= initiator.maintenance.ended
    assert not ended
    assert initiator.current.track_id.tolist() == [0]
