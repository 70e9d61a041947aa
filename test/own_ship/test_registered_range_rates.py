"""Range rates of registered scans: against the sensor's velocity, and along the horizontal."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.registered import place, places, sail, session
from support.sessions import NotedSession

from tsepm_ros import Scan, SensorModel
from tsepm_ros.own_ship.pose_history import PoseSample
from tsepm_ros.own_ship.registration import Mounting, SensorScan
from tsepm_ros.settings.settings import Settings

N = 200


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
