"""Placing scans of a sensor that rolls, pitches and is mounted somewhere on its vessel."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2
from support.sessions import NotedSession

from tsepm_ros import Scan, SensorModel
from tsepm_ros.initiation.common_options import CommonOptions
from tsepm_ros.methods.tsepm.tsepm_options import TsepmOptions
from tsepm_ros.own_ship.mounting import Mounting
from tsepm_ros.own_ship.pose_sample import PoseSample
from tsepm_ros.own_ship.registration import SensorScan
from tsepm_ros.session.session import Session
from tsepm_ros.settings.session_options import SessionOptions
from tsepm_ros.settings.settings import Settings
from tsepm_ros.settings.tables import TRACK_INITIATOR, make_groups, settings_from


def session(mounting: Mounting | None = None, **options) -> NotedSession:
    options = {"own_ship_source": "odometry", "own_ship_max_gap": 60.0, **options}
    settings = Settings(SessionOptions(**options), mounting=mounting or Mounting())
    return NotedSession(settings)


def place(one: Session, scan: Scan, frame_id: str = "sonar", **more) -> Scan:
    """The scan as it is processed."""
    one.add_scan(SensorScan(scan, frame_id, **more), 0.0)
    (result,) = one.process()
    return result.scan


def places(scan: Scan) -> np.ndarray:
    """Where the detections are in the fixed frame, (n, 2)."""
    pose = np.broadcast_to(scan.sensor_pose, (len(scan), 3))
    angle = scan.azimuth + pose[:, 2]
    return pose[:, :2] + scan.range[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def rolling(time):
    """Yaw, pitch and roll of a boat in a seaway, rad."""
    return (
        0.4 + 0.02 * time,
        0.08 * np.sin(1.1 * time),
        0.15 * np.sin(0.9 * time + 1.0),
    )


def sail(one: Session, *, first: float = 0.0, last: float = 30.0, step: float = 0.05) -> None:
    """Poses of the boat, which does not leave (100, 200)."""
    for time in np.arange(first, last + step / 2, step).tolist():
        yaw, pitch, roll = rolling(time)
        one.add_own_ship(
            PoseSample(time, 100.0, 200.0, yaw, roll=roll, pitch=pitch, frame_id="odom")
        )


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


def test_a_tilt_ignored_would_be_hundreds_of_metres_off():
    one, level = session(), session()
    sail(one)
    for time in (0.0, 30.0):
        level.add_own_ship(PoseSample(time, 100.0, 200.0, rolling(time)[0], frame_id="odom"))
    scan = Scan(3.0, *(np.full(1, value) for value in (5000.0, math.pi / 2)))
    height = np.array([-1500.0])
    moved = places(place(one, scan, height=height)) - places(place(level, scan, height=height))
    assert np.hypot(*moved.T)[0] > 100.0


@pytest.mark.parametrize("source", ["none", "odometry"])
def test_level_scans_stay_to_the_bit_whatever_the_height(source):
    rng = np.random.default_rng(2)
    scan = Scan(3.0, rng.uniform(1.0, 9e3, N), rng.uniform(-3.0, 3.0, N))
    one = session(own_ship_source=source)
    if source == "odometry":
        for time in (0.0, 10.0):
            one.add_own_ship(PoseSample(time, 100.0, 200.0, 0.3 * time, frame_id="odom"))
    found = place(one, scan, height=rng.uniform(-1e6, 1e6, N))
    np.testing.assert_array_equal(found.range, scan.range)
    np.testing.assert_array_equal(found.azimuth, scan.azimuth)


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


def test_an_empty_scan_of_a_tilted_sensor_is_good():
    one = session(Mounting(x=1.0))
    sail(one)
    assert len(place(one, Scan(3.0, [], [], time_offset=[]), height=np.zeros(0))) == 0


HEADINGS = {"east": (1, 0), "north": (0, 1), "west": (-1, 0), "south": (0, -1)}


@pytest.mark.parametrize("heading", HEADINGS)
def test_a_sonar_that_looks_to_port_from_the_bow(heading):
    east, north = HEADINGS[heading]
    one = session(Mounting(x=20.0, y=-5.0, yaw=math.pi / 2))
    for time in (0.0, 10.0):
        yaw = math.atan2(north, east)
        one.add_own_ship(
            PoseSample(time, 100.0, 200.0, yaw, frame_id="odom", child_frame_id="base_link")
        )
    found = place(one, Scan(5.0, [1000.0], [0.0]))
    ahead, port = np.array([east, north]), np.array([-north, east])
    expected = [100.0, 200.0] + 20.0 * ahead - 5.0 * port + 1000.0 * port
    np.testing.assert_allclose(places(found)[0], expected, atol=1e-9)
    assert one.heard == [], "the mounting says where the sensor is"
    assert found.azimuth[0] == 0.0, "the sensor's coverage counts from its own x axis"


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


def test_a_mounting_may_be_corrected_while_running():
    one = session(Mounting(yaw=1.0))
    for time in (0.0, 10.0):
        one.add_own_ship(PoseSample(time, 0.0, 0.0, 0.0, frame_id="odom"))
    assert place(one, Scan(5.0, [1000.0], [0.0])).sensor_pose[2] == 1.0
    one.configure(dataclasses.replace(one.settings, mounting=Mounting(yaw=1.1)))
    assert place(one, Scan(6.0, [1000.0], [0.0])).sensor_pose[2] == 1.1


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


@pytest.mark.statistical
@pytest.mark.parametrize("estimator", ["unweighted", "weighted"])
def test_a_heading_that_errs_from_scan_to_scan_is_in_the_track_s_covariance(estimator):
    # 1 degree at 4 km is 70 m, over three times what the sonar's own azimuth errs by.
    found = [nees(seed, estimator, known=True) for seed in range(RUNS)]
    good = [value for value in found if value is not None]
    assert len(good) > 0.9 * RUNS
    low, high = chi2.ppf([0.005, 0.995], 4 * len(good)) / len(good)  # 99 %
    assert low < np.mean(good) < high


def test_without_the_own_ship_s_covariance_the_track_s_is_far_too_small():
    found = [nees(seed, "unweighted", known=False) for seed in range(100)]
    good = [value for value in found if value is not None]
    assert len(good) < 50, "nor do the hits lie on a line by the errors that are known"
    assert np.mean(good) > 15.0


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
    one.add_scan(SensorScan(Scan(5.03, time_offset=[0.2, 0.4], **RATED), "sonar"), 0.0)
    for k, (east, north) in enumerate(noise.T.tolist()):
        one.add_own_ship(PoseSample(0.1 * k, east, north, 0.0, frame_id="odom"))
        if 0.1 * k >= 5.83 + delay:
            found += [result.scan.sensor_velocity for result in one.process(0.0)]
    # The last echo came at 5.83 s: of what the samples say up to 5.9 s.
    expected = [(x[59] - x[39]) / 2.0, (y[59] - y[39]) / 2.0]
    np.testing.assert_allclose(found, [[expected, expected]], rtol=1e-9)


def test_a_velocity_that_the_odometry_gives_is_the_sensor_s():
    rng = np.random.default_rng(10)
    one = session()
    for stamp, error in enumerate(rng.normal(0.0, 1.0, 20).tolist()):
        rates = (4.0 + 0.1 * stamp, -1.0, 0.0)
        one.add_own_ship(
            PoseSample(float(stamp), 4.0 * stamp + error, 0.0, 0.0, rates=rates, frame_id="o")
        )
    found = place(one, Scan(5.0, time_offset=[0.2, 4.0], **RATED)).sensor_velocity
    np.testing.assert_allclose(found, [[4.52, -1.0], [4.9, -1.0]])


def test_range_rates_are_not_used_where_poses_jump_impossibly():
    one = session()
    for stamp in np.arange(0.0, 20.0, 0.1):
        x = 0.0 if stamp < 9.0 else 1e8
        one.add_own_ship(PoseSample(stamp, x, 0.0, 0.0, frame_id="odom"))
    found = place(one, Scan(5.0, time_offset=[0.2, 4.0], **RATED))
    np.testing.assert_array_equal(found.features["range_rate"], [1.0, np.nan])
    np.testing.assert_allclose(found.sensor_velocity, np.zeros((2, 2)), atol=1e-12)
    assert len(found) == 2


def test_range_rates_are_not_used_where_the_sensor_s_velocity_is_unknown():
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


def test_true_bearings_have_their_range_rates_made_horizontal_too():
    one = session()
    sail(one)
    scan = Scan(3.0, [4000.0], [1.0], features={"range_rate": [4.0]})
    found = place(one, scan, height=np.array([1000.0]), north_referenced=True)
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
        3.0, np.full(4, 1000.0), np.zeros(4), features={"range_rate": [1.0, 1.0, 1.0, np.nan]}
    )
    rates = place(one, scan, height=height).features["range_rate"]
    np.testing.assert_array_equal(np.isfinite(rates), [True, True, False, False])
    assert one.heard == (["range_rate_unused"] if used else [])
    assert one.dropped == {}
