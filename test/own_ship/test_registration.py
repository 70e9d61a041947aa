"""Placing scans of a sensor that rolls, pitches and is mounted somewhere on its vessel."""

import dataclasses
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2
from support.registered import place, places, rolling, sail, session

from tsepm_ros import Scan, SensorModel
from tsepm_ros.methods.tsepm import TsepmOptions
from tsepm_ros.own_ship.pose_history import PoseSample
from tsepm_ros.own_ship.registration import Mounting, SensorScan
from tsepm_ros.session.session import Session
from tsepm_ros.settings.node_options import SessionOptions
from tsepm_ros.settings.settings import TRACK_INITIATOR, Settings, make_groups, settings_from
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


def test_true_bearings_are_in_the_horizontal_plane_already():
    one = session()
    sail(one)
    scan = Scan(3.0, [4000.0], [1.0], time_offset=[2.0])
    found = place(one, scan, height=np.array([300.0]), north_referenced=True)
    assert (found.range[0], found.azimuth[0]) == (4000.0, 1.0)


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


def test_a_mounting_carries_the_heading_s_error_to_the_sensor():
    one = session(Mounting(x=100.0))
    covariance = np.diag([4.0, 9.0, 0.01])
    for time in (0.0, 10.0):
        pose = PoseSample(time, 0.0, 0.0, math.pi / 2, covariance)
        one.add_own_ship(dataclasses.replace(pose, frame_id="odom"))
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
    for time in (0.0, 10.0):
        one.add_own_ship(PoseSample(time, 0.0, 0.0, 0.0, np.diag([1.0, 1.0, 1e6]), frame_id="odom"))
    one.add_scan(SensorScan(Scan(5.0, [1000.0], [0.0]), "sonar", north_referenced=True), 0.0)
    assert len(list(one.process())) == 1 - dropped
    assert one.dropped["heading_unknown"] == dropped


def test_without_a_mounting_a_vessel_s_frame_is_said_to_be_taken_for_the_sensor_s():
    one = session()
    for time in (0.0, 10.0):
        one.add_own_ship(
            PoseSample(time, 0.0, 0.0, 0.0, frame_id="odom", child_frame_id="base_link")
        )
    assert one.figures().mounting == "unknown"
    for time in (4.0, 5.0):
        place(one, Scan(time, [1000.0], [0.0]))
        assert one.figures().mounting == "assumed"
    assert one.heard == ["mounting"], "once"
    one.reset()
    for time in (0.0, 10.0):
        one.add_own_ship(PoseSample(time, 0.0, 0.0, 0.0, frame_id="odom", child_frame_id="hull"))
    place(one, Scan(6.0, [1000.0], [0.0]))
    assert one.heard == ["mounting"] * 2, "once for each pair of frames"


def test_the_mounting_is_given_or_not_needed():
    assert session(Mounting(x=1.0)).figures().mounting == "given"
    assert session(own_ship_source="none").figures().mounting == "not needed"
    one = session()
    one.add_own_ship(PoseSample(5.0, 0.0, 0.0, 0.0, frame_id="odom", child_frame_id="sonar"))
    place(one, Scan(5.0, [1000.0], [0.0]))
    assert (one.figures().mounting, one.heard) == ("not needed", [])


@pytest.mark.parametrize("source", ["none", "tf"])
@pytest.mark.parametrize("name", ["x", "y", "yaw"])
def test_a_mounting_without_odometry_is_refused(source, name):
    values = {"own_ship_source": source, "fixed_frame": "map", f"mounting.{name}": 0.5}
    with pytest.raises(ValueError, match=f"mounting.x, .* must be 0 if .* is {source}"):
        make_groups(TRACK_INITIATOR, values)
    values["own_ship_source"] = "odometry"
    settings = settings_from(make_groups(TRACK_INITIATOR, values))
    assert getattr(settings.mounting, name) == 0.5


RUNS = 300
HEADING_STD, POSITION_STD = math.radians(1.0), 20.0
NARROW = SensorModel(
    range_std=30.0, range_std_fraction=0.0, azimuth_std=math.radians(0.3), max_range=9000.0
)
WIDE_OPEN = {"gate_probability": 0.9999, "pruning_probability": 0.99999}


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
        one.add_scan(SensorScan(Scan(stamp, [range_], [azimuth]), "sonar"), 0.0)
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
