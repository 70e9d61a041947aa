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
"""Placing scans and their range rates: a sensor that rolls, pitches and is mounted somewhere."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2
from support.registered import place, places, rolling, sail, session
from support.sessions import NotedSession, arrived

from msg_adapters.ping import ReadingOptions
from msg_adapters.point_cloud import detections_of_fields
from tsepm_ros import Scan, SensorModel
from tsepm_ros.methods.tsepm import TsepmOptions
from tsepm_ros.own_ship.pose_history import PoseHistory, PoseSample
from tsepm_ros.own_ship.registration import (
    Mounting,
    UnregisteredScan,
    levelled_for_registration,
    register_in_fixed_frame,
)
from tsepm_ros.session.session import Session
from tsepm_ros.settings.node_options import SessionOptions
from tsepm_ros.settings.settings import TRACK_INITIATOR, Settings, make_groups, settings_from
from tsepm_ros.tools.replay.offline import process_recording
from tsepm_ros.tools.replay.recording import RecordedScan, Recording
from tsepm_ros.tracker.options import CommonOptions


def measured(slant, azimuth, elevation):
    """Range in the sensor's plane, azimuth and height."""
    return slant * np.cos(elevation), azimuth, slant * np.sin(elevation)


N = 200
MOUNTINGS = pytest.mark.parametrize(
    "mounting", [Mounting(), Mounting(x=12.0, y=-3.0, yaw=2.0)], ids=["none", "mounted"]
)


@MOUNTINGS
@pytest.mark.parametrize("with_offsets", [True, False], ids=["time_offset", "at_once"])
def test_detections_are_where_the_attitude_at_reception_puts_them(mounting, with_offsets):
    rng = np.random.default_rng(1)
    slant, azimuth = rng.uniform(100.0, 7000.0, N), rng.uniform(-math.pi, math.pi, N)
    elevation = rng.uniform(-0.5, 0.5, N)
    range_, azimuth, height = measured(slant, azimuth, elevation)
    offset = slant / 1500.0 if with_offsets else None
    one = session(mounting)
    sail(one)
    found = place(one, Scan(3.0, range_, azimuth, time_offset=offset), height=height)
    received = np.full(N, 3.0) if offset is None else 3.0 + 2.0 * offset
    attitude = Rotation.from_euler("ZYX", np.stack(rolling(received), axis=1))
    level = np.cos(elevation)
    direction = np.stack(
        [level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=1
    )
    on_board = [mounting.x, mounting.y, 0.0] + slant[:, None] * Rotation.from_euler(
        "z", mounting.yaw
    ).apply(direction)
    expected = [100.0, 200.0] + attitude.apply(on_board)[:, :2]
    # The lever arm moves while an echo is under way, of which its place takes up the half: 12 m
    # turning by 0.2 rad. The poses are interpolated over 0.05 s.
    tolerance = 1.5 if mounting.given and with_offsets else 0.5
    assert np.hypot(*(places(found) - expected).T).max() < tolerance


def test_what_is_straight_above_a_tilted_sensor_at_rest_is_counted():
    one = NotedSession(Settings(mounting=Mounting(roll=math.pi / 2)))
    one.add_scan(arrived(Scan(3.0, [500.0, 600.0], [0.0, math.pi / 2])), 0.0)
    (result,) = one.process()
    assert result.scan.range == pytest.approx([500.0])
    assert one.dropped == {"no_horizontal_range": 1}


def test_what_is_straight_above_a_tilted_sensor_is_dropped_and_the_others_keep_their_values():
    one = session()
    for time in (0.0, 20.0):
        one.add_own_ship(PoseSample(time, 0.0, 0.0, 0.0, roll=math.pi / 2, frame_id="odom"))
    values = np.array([1.0, 2.0, 3.0])
    scan = Scan(
        3.0,
        range=[500.0, 600.0, 700.0],
        azimuth=[0.0, math.pi / 2, 0.0],  # on its side, port is straight up
        range_std=values,
        azimuth_std=values / 10.0,
        time_offset=values,
        features={"intensity": values},
    )
    found = place(one, scan, height=np.array([0.0, 0.0, 1e300]), transmit_offset=values / 2.0)
    assert one.dropped == {"no_horizontal_range": 2}
    assert one.heard == ["no_horizontal_range"]
    assert len(found) == 1
    assert found.range[0] == pytest.approx(500.0)
    assert (found.range_std[0], found.azimuth_std[0], found.time_offset[0]) == (1.0, 0.1, 1.0)
    assert found.features["intensity"].tolist() == [1.0]


def test_the_end_of_the_lever_arm_is_extrapolated_round_the_turning_vessel():
    rate, yaw, arm = 0.3, 0.4, 50.0
    one = session(Mounting(x=arm), own_ship_max_extrapolation=1.0)
    for time in (0.0, 1.0):
        rates = (2.0, 1.0, rate)
        one.add_own_ship(
            PoseSample(time, 2 * time, time, yaw + rate * time, rates=rates, frame_id="odom")
        )
    found = place(one, Scan(2.0, [1000.0], [0.0]))
    turned = yaw + 2.0 * rate
    expected = [4.0 + arm * math.cos(turned), 2.0 + arm * math.sin(turned), turned]
    np.testing.assert_allclose(found.sensor_pose, expected, rtol=1e-12)


def stand(one, *args, **pose):
    """Odometry of a vessel that does not move from its place."""
    for time in (0.0, 10.0):
        one.add_own_ship(PoseSample(time, 0.0, 0.0, *args, frame_id="odom", **pose))


def test_a_mounting_carries_the_heading_s_error_to_the_sensor():
    one = session(Mounting(x=100.0))
    stand(one, math.pi / 2, np.diag([4.0, 9.0, 0.01]))
    found = place(one, Scan(5.0, [1000.0], [0.0]))
    expected = [[4.0 + 100.0, 0.0, -1.0], [0.0, 9.0, 0.0], [-1.0, 0.0, 0.01]]
    np.testing.assert_allclose(found.sensor_pose_covariance, expected, atol=1e-12)
    found = place(one, Scan(6.0, [1000.0], [0.0]), north_referenced=True)
    expected = np.diag([104.0, 9.0, 0.0])
    np.testing.assert_allclose(found.sensor_pose_covariance, expected, atol=1e-12)


@pytest.mark.parametrize(
    ("mounting", "dropped"),
    [(Mounting(x=5.0), 1), (Mounting(yaw=1.0), 0), (Mounting(), 0)],
    ids=["lever arm", "yaw alone", "none"],
)
def test_a_lever_arm_needs_a_heading_even_for_true_bearings(mounting, dropped):
    one = session(mounting)
    stand(one, 0.0, np.diag([1.0, 1.0, 1e6]))
    one.add_scan(UnregisteredScan(Scan(5.0, [1000.0], [0.0]), "sonar", north_referenced=True), 0.0)
    assert len(list(one.process())) == 1 - dropped
    assert one.dropped["heading_unknown"] == dropped


def test_a_mounting_is_given_not_needed_or_said_to_be_assumed_once_for_each_pair_of_frames():
    assert session(Mounting(x=1.0)).figures().mounting == "given"
    assert session(own_ship_source="none").figures().mounting == "not needed"
    one = session()
    stand(one, 0.0, child_frame_id="sonar")
    place(one, Scan(5.0, [1000.0], [0.0]))
    assert (one.figures().mounting, one.heard) == ("not needed", [])
    one = session()
    stand(one, 0.0, child_frame_id="base_link")
    assert one.figures().mounting == "unknown"
    for time in (4.0, 5.0):
        place(one, Scan(time, [1000.0], [0.0]))
        assert one.figures().mounting == "assumed"
    assert one.heard == ["mounting"]
    one.reset()
    stand(one, 0.0, child_frame_id="hull")
    place(one, Scan(6.0, [1000.0], [0.0]))
    assert one.heard == ["mounting"] * 2


@pytest.mark.parametrize("name", ["x", "y", "yaw"])
def test_a_mounting_beside_that_of_tf_is_refused(name):
    values = {"own_ship_source": "tf", "fixed_frame": "map", f"mounting.{name}": 0.5}
    with pytest.raises(ValueError, match=r"mounting.x, .* must be 0 if .* is tf"):
        make_groups(TRACK_INITIATOR, values)
    values["own_ship_source"] = "odometry"
    settings = settings_from(make_groups(TRACK_INITIATOR, values))
    assert getattr(settings.mounting, name) == 0.5


@pytest.mark.parametrize(("fixed", "ahead"), [("pier", 0.0), ("pier_ned", math.pi / 2)])
def test_a_sensor_at_rest_is_where_it_is_mounted(fixed, ahead):
    """Ahead of a platform at rest is the x axis, or the north of a frame with z down."""
    upside_down = Mounting(x=10.0, y=-4.0, yaw=0.3, roll=math.pi)
    one = session(upside_down, own_ship_source="none", fixed_frame=fixed)
    found = places(place(one, Scan(5.0, [80.0], [0.5]), frame_id="left_sonar")) @ (1.0, 1j)
    np.testing.assert_allclose(
        found, np.exp(1j * ahead) * (10.0 - 4.0j + 80.0 * np.exp(1j * (0.3 - 0.5)))
    )


RUNS = 300
HEADING_STD, POSITION_STD = math.radians(1.0), 20.0
NARROW = SensorModel(
    range_std=30.0, range_std_fraction=0.0, azimuth_std=math.radians(0.3), max_range=9000.0
)
WIDE_OPEN = {"gate_probability": 0.9999, "pruning_probability": 0.99999}


@pytest.mark.parametrize("by_pose", [True, False], ids=["tf", "mounting"])
def test_images_of_a_sensor_upside_down_see_a_mirrored_ground(by_pose):
    """The place of an echo, as registered, is that of its image's cell mirrored."""
    mounting = Mounting(x=0.0 if by_pose else 2.0, yaw=0.3, roll=0.0 if by_pose else math.pi)
    vessel = np.array([[4.0, -3.0, 0.7, math.pi if by_pose else 0.0, 0.0]])
    seen = Scan(stamp=0.0, range=[20.0], azimuth=[0.4])
    ((x, y, yaw),) = mounting.image_poses(vessel)
    ((east, north, heading),) = mounting.sensor_poses(vessel)
    cell = x + 20.0 * math.cos(yaw + 0.4), -y - 20.0 * math.sin(yaw + 0.4)
    azimuth = heading - seen.azimuth[0]
    expected = east + 20.0 * math.cos(azimuth), north + 20.0 * math.sin(azimuth)
    np.testing.assert_allclose(cell, expected)
    level = vessel * (1.0, 1.0, 1.0, 0.0, 1.0)
    upright = Mounting(x=mounting.x, yaw=0.3, roll=0.1)
    assert np.array_equal(upright.image_poses(level), upright.sensor_poses(level))


def nees(seed: int, estimator: str, *, known: bool) -> float | None:
    """Of the track of one target, seen from a ship whose pose is off anew at every scan."""
    rng = np.random.default_rng([7, seed])
    options = SessionOptions(method="tsepm", own_ship_source="odometry")
    rule = TsepmOptions(min_hits=5, window=5, estimator=estimator, **WIDE_OPEN)
    common = CommonOptions(max_speed=30.0)
    mounting = Mounting(x=40.0, y=5.0, yaw=0.7)
    one = Session(Settings(options, NARROW, common, {"tsepm": rule}, mounting))
    covariance = np.diag([POSITION_STD**2, POSITION_STD**2, HEADING_STD**2])
    ship, ship_velocity = rng.uniform(-500.0, 500.0, 2), rng.normal(0.0, 4.0, 2)
    direction, heading = rng.uniform(-math.pi, math.pi, 2)
    target = ship + 4000.0 * np.array([math.cos(direction), math.sin(direction)])
    velocity = rng.normal(0.0, 4.0, 2)
    for stamp in 12.0 * np.arange(5):
        true = np.array([[*(ship + ship_velocity * stamp), heading + 0.02 * stamp, 0.0, 0.0]])
        x, y, yaw = true[0, :3] + rng.multivariate_normal(np.zeros(3), covariance)
        one.add_own_ship(
            PoseSample(stamp, x, y, yaw, covariance if known else None, frame_id="odom")
        )
        ((x, y, yaw),) = mounting.sensor_poses(true)
        ahead, across = target + velocity * stamp - (x, y)
        range_ = math.hypot(ahead, across) + NARROW.range_std * rng.standard_normal()
        azimuth = math.atan2(across, ahead) - yaw + NARROW.azimuth_std * rng.standard_normal()
        one.add_scan(UnregisteredScan(Scan(stamp, [range_], [azimuth]), "sonar"), 0.0)
        for result in one.process():
            for track in result.new:
                position = target + velocity * track.stamp
                error = track.state - np.stack([position, velocity], axis=1).ravel()
                return float(error @ np.linalg.solve(track.covariance, error))
    return None


@pytest.mark.long
@pytest.mark.parametrize("estimator", ["unweighted", "weighted"])
def test_a_heading_that_errs_from_scan_to_scan_is_in_the_track_s_covariance(estimator):
    # 1 degree at 4 km is 70 m, over three times what the sonar's own azimuth errs by.
    found = [nees(seed, estimator, known=True) for seed in range(RUNS)]
    good = [value for value in found if value is not None]
    assert len(good) > 0.9 * RUNS
    low, high = chi2.ppf([0.005, 0.995], 4 * len(good)) / len(good)  # 99 %
    assert low < np.mean(good) < high


def test_range_rates_are_taken_against_the_velocity_of_the_sensor_not_of_the_vessel():
    # It turns on the spot at 0.1 rad/s with the sensor 20 m ahead and 5 m to starboard.
    one = session(Mounting(x=20.0, y=-5.0))
    for stamp in np.arange(0.0, 20.0, 0.1):
        one.add_own_ship(PoseSample(stamp, 0.0, 0.0, 0.1 * stamp, frame_id="odom"))
    scan = place(
        one, Scan(10.0, [1500.0], [0.0], time_offset=[1.0], features={"range_rate": [0.0]})
    )
    at = 0.1 * 11.0
    arm = Rotation.from_euler("z", at).apply([20.0, -5.0, 0.0])
    np.testing.assert_allclose(
        scan.sensor_velocity, [np.cross([0.0, 0.0, 0.1], arm)[:2]], atol=0.01
    )


RATED = {"range": [300.0, 6000.0], "azimuth": [0.0, 0.0], "features": {"range_rate": [1.0, 2.0]}}


@pytest.mark.parametrize("delay", [0.0, 1.0, 100.0])
def test_the_velocity_of_the_sensor_does_not_depend_on_when_odometry_arrives(delay):
    # White errors of 1 m in the positions: any other samples would give another velocity.
    x, y = noise = np.random.default_rng(9).normal(0.0, 1.0, (2, 1200))
    one, found = session(), []
    one.add_scan(UnregisteredScan(Scan(5.03, time_offset=[0.2, 0.4], **RATED), "sonar"), 0.0)
    for k, (east, north) in enumerate(noise.T.tolist()):
        one.add_own_ship(PoseSample(0.1 * k, east, north, 0.0, frame_id="odom"))
        if 0.1 * k >= 5.83 + delay:
            found += [result.scan.sensor_velocity for result in one.process(0.0)]
    # The last echo came at 5.83 s: of what the samples say up to 5.9 s.
    expected = [(x[59] - x[39]) / 2.0, (y[59] - y[39]) / 2.0]
    np.testing.assert_allclose(found, [[expected, expected]], rtol=1e-9)


def test_range_rates_are_not_used_where_the_sensor_s_velocity_is_unknown_or_impossible():
    poses = PoseHistory()
    for stamp in np.arange(0.0, 20.0, 0.1):
        poses.add(PoseSample(stamp, 0.0 if stamp < 9.0 else 1e8, 0.0, 0.0))
    arrived = UnregisteredScan(Scan(5.0, time_offset=[0.2, 4.0], **RATED), "sonar")
    found = register_in_fixed_frame(arrived, poses, Mounting())
    np.testing.assert_array_equal(found.features["range_rate"], [1.0, np.nan])
    np.testing.assert_allclose(found.sensor_velocity, np.zeros((2, 2)), atol=1e-12)
    assert len(found) == 2
    one = session()
    one.add_own_ship(PoseSample(5.0, 1.0, 2.0, 0.0, frame_id="odom"))
    found = place(one, Scan(5.0, **RATED))
    assert np.isnan(found.features["range_rate"]).all()
    assert found.sensor_velocity.tolist() == [0.0, 0.0]


SENSOR_VELOCITY = np.array([3.0, -2.0, 0.0])


def slant_rates(rng, number):
    """Places of targets against the sensor and their slant and horizontal range rates.

    The rates are differences of distances over a short time in which sensor and targets move
    horizontally: those places are (n, 3), m; the rates (n,), m/s.
    """
    angle, distance = rng.uniform(-math.pi, math.pi, number), rng.uniform(500.0, 3000.0, number)
    height = distance * np.tan(rng.uniform(-0.35, 0.35, number))  # 20 degrees
    place = np.stack([distance * np.cos(angle), distance * np.sin(angle), height], axis=1)
    velocity = np.column_stack([rng.normal(0.0, 5.0, (number, 2)), np.zeros(number)])
    step = 1e-3 * (velocity - SENSOR_VELOCITY)
    after, before = place + step, place - step

    def rate(axes: int) -> np.ndarray:
        lengths = (np.linalg.norm(one[:, :axes], axis=1) for one in (after, before))
        return np.subtract(*lengths) / 2e-3

    return place, rate(3), rate(2)


@pytest.mark.parametrize(
    ("source", "roll", "pitch"),
    [("none", 0.0, 0.0), ("odometry", 0.0, 0.0), ("odometry", 0.2, -0.1)],
    ids=["at rest", "level", "tilted"],
)
def test_range_rates_along_a_slant_line_of_sight_become_those_of_the_horizontal_range(
    source, roll, pitch
):
    place_, slant_rate, expected = slant_rates(np.random.default_rng(5), N)
    one = session(own_ship_source=source)
    if source == "odometry":
        for time in (0.0, 10.0):
            one.add_own_ship(
                PoseSample(time, 0.0, 0.0, 0.4, roll=roll, pitch=pitch, frame_id="odom")
            )
    yaw = 0.4 if source == "odometry" else 0.0
    seen = Rotation.from_euler("ZYX", [yaw, pitch, roll]).inv().apply(place_)
    in_plane, azimuth = np.hypot(*seen[:, :2].T), np.arctan2(seen[:, 1], seen[:, 0])
    scan = Scan(3.0, in_plane, azimuth, features={"range_rate": slant_rate, "intensity": azimuth})
    found = place(one, scan, height=seen[:, 2])
    np.testing.assert_allclose(places(found), place_[:, :2], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.features["range_rate"], expected, atol=1e-6)
    np.testing.assert_array_equal(found.features["intensity"], azimuth)
    assert np.abs(slant_rate - expected).max() > 0.2, "untouched they would be wrong"


def test_true_bearings_are_horizontal_already_and_their_range_rates_are_made_so():
    one = session()
    sail(one)
    scan = Scan(3.0, [4000.0], [1.0], time_offset=[2.0], features={"range_rate": [4.0]})
    found = place(one, scan, height=np.array([1000.0]), north_referenced=True)
    assert (found.range[0], found.azimuth[0]) == (4000.0, 1.0)
    assert found.features["range_rate"][0] == pytest.approx(4.0 * math.hypot(4000.0, 1000.0) / 4e3)


def test_range_rates_without_a_height_stay_to_the_bit_on_a_level_sensor():
    rates = np.random.default_rng(6).normal(0.0, 5.0, N)
    one = session(own_ship_source="none")
    found = place(
        one, Scan(3.0, np.linspace(1.0, 9e3, N), np.zeros(N), features={"range_rate": rates})
    )
    np.testing.assert_array_equal(found.features["range_rate"], rates)


@pytest.mark.parametrize("used", [True, False], ids=["rates used", "rates not used"])
def test_range_rates_measured_steeply_are_left_out_and_that_is_said_where_they_count(used):
    settings = Settings(sensor=SensorModel(range_rate_std=0.5 if used else 0.0))
    one = NotedSession(settings)
    height = 1000.0 * np.tan(np.radians([0.0, 24.0, 25.0, -25.0]))
    scan = Scan(
        3.0, np.full(4, 1000.0), np.arange(4.0), features={"range_rate": [1.0, 1.0, 1.0, np.nan]}
    )
    rates = place(one, scan, height=height).features["range_rate"]
    np.testing.assert_array_equal(np.isfinite(rates), [True, True, False, False])
    assert one.heard == (["range_rate_unused"] if used else [])
    assert one.dropped == {}


MANY = 500


@pytest.mark.parametrize("zero", [0.0, -0.0])
def test_what_is_received_level_is_in_the_horizontal_plane_to_the_bit(zero):
    rng = np.random.default_rng(2)
    range_, azimuth, height = rng.uniform(-9e3, 9e3, (3, MANY))  # any angle, not wrapped
    level = np.full(MANY, zero)
    for kwargs in ({}, {"mounting_yaw": 0.3}):
        found = levelled_for_registration(range_, azimuth, height, level, level, **kwargs)
        np.testing.assert_array_equal(found, (range_, azimuth))
    tilted = np.where(np.arange(MANY) % 2, 0.1, zero)  # beside others that are not
    found = np.array(levelled_for_registration(range_, azimuth, None, tilted, level))
    assert ((found == (range_, azimuth)).all(axis=0) == (tilted == 0.0)).all()


@pytest.mark.filterwarnings("error")
def test_a_range_may_vanish_and_a_height_be_absurd():
    quarter = np.full(2, math.pi / 2)
    found, _ = levelled_for_registration(
        np.array([100.0, 1.0]), quarter, np.array([0.0, 1e308]), quarter, np.zeros(2)
    )
    assert found[0] < 1e-10
    assert found[1] > 1e300


MOVING = Settings(session=SessionOptions(own_ship_source="odometry"))


def pose(stamp: float) -> PoseSample:
    return PoseSample(stamp, 0.0, 0.0, 0.0, frame_id="odom", child_frame_id="sonar")


def ping(stamp: float, offsets: list[float]):
    values = {
        "range": np.full(len(offsets), 900.0),
        "azimuth": np.linspace(-1.0, 1.0, len(offsets)),
        "time_offset": np.array(offsets),
    }
    read = detections_of_fields(round(1e9 * stamp), "sonar", values, ReadingOptions())
    return read.sensor_scan


@pytest.mark.parametrize(
    ("offsets", "used"),
    [
        *(([0.6, wrong, 0.5], [0.6, 0.5]) for wrong in (60.0, 61.0, 1e3, 1e6, -60.0, -1e6)),
        ([100.0, 200.0], []),
    ],
)
def test_the_other_echoes_of_the_ping_are_used_at_once(offsets, used):
    session = Session(MOVING)
    for stamp in np.arange(0.0, 30.0, 0.5):
        session.add_own_ship(pose(stamp))
    session.add_scan(ping(10.0, offsets), now=0.0)
    [result] = session.process(now=0.0)
    assert result.scan.time_offset.tolist() == used
    assert session.dropped == {"echo_too_late": len(offsets) - len(used)}


def test_a_sensor_at_rest_keeps_such_echoes():
    session = Session(Settings())
    session.add_scan(ping(10.0, [0.6, 100.0]), now=0.0)
    [result] = session.process(now=0.0)
    assert len(result.scan) == 2
    assert not session.dropped


@pytest.mark.long
def test_offline_the_poses_of_later_pings_are_still_there():
    """The poses up to the last echo are read before a ping: none must be read for a wrong one."""
    times = np.arange(0.0, 2000.0, 1.0)
    scans = [
        RecordedScan(
            float(stamp),
            {
                "range": np.full(3, 900.0),
                "azimuth": np.array([0.0, 0.1, 0.2]),
                "time_offset": np.array([0.5, 1e5 if stamp == 20.0 else 0.6, 0.7]),
            },
        )
        for stamp in np.arange(20.0, 1900.0, 20.0)
    ]
    own_ship = [PoseSample(float(stamp), 0.0, 0.0, 0.0) for stamp in times]
    results, dropped = process_recording(Recording(scans, own_ship), MOVING, "bow")
    assert len(results) == len(scans)
    assert dropped == {"echo_too_late": 1}
