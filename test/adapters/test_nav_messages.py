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
"""Navigation messages: the own ship's odometry in and out, and charts."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from nav_msgs.msg import Odometry
from scipy.spatial.transform import Rotation

from msg_adapters import MessageError, odometry_message, read_land, read_own_ship
from tsepm_ros.own_ship.pose_history import PoseHistory, PoseSample
from tsepm_ros.session.inputs import MAX_YAW_VARIANCE
from tsepm_ros.tracker.scan import Scan


def _message(rotation=None, *, linear=(0.0, 0.0, 0.0), angular=(0.0, 0.0, 0.0)):
    message = Odometry(child_frame_id="base_link")
    message.header.frame_id = "odom"
    message.header.stamp.sec, message.header.stamp.nanosec = 1_700_000_000, 123_456_789
    pose, twist = message.pose.pose, message.twist.twist
    pose.position.x, pose.position.y, pose.position.z = 100.5, -200.25, -3.0
    turn = (rotation or Rotation.identity()).as_quat()
    for name, value in zip("xyzw", turn, strict=True):
        setattr(pose.orientation, name, float(value))
    for name, value in zip("xyz", linear, strict=True):
        setattr(twist.linear, name, value)
    for name, value in zip("xyz", angular, strict=True):
        setattr(twist.angular, name, value)
    return message


def test_the_attitude_turns_the_twist_and_the_yaw_rate_is_the_derivative_of_the_yaw():
    yaw, pitch, roll = 2.0, -0.25, 0.4
    rotation = Rotation.from_euler("ZYX", [yaw, pitch, roll])
    linear = (5.0, 1.0, -2.0)
    sample = read_own_ship(_message(rotation, linear=linear))
    assert (sample.yaw, sample.pitch, sample.roll) == pytest.approx((yaw, pitch, roll), rel=1e-14)
    np.testing.assert_allclose(sample.rates[:2], rotation.apply(linear)[:2], rtol=1e-14)
    rotation = Rotation.from_euler("ZYX", [1.0, 0.3, -0.5])
    angular, step = np.array([0.1, -0.2, 0.3]), 1e-5
    yaw = [
        read_own_ship(_message(rotation * Rotation.from_rotvec(angular * time))).yaw
        for time in (-step, step)
    ]
    rate = read_own_ship(_message(rotation, angular=angular)).rates[2]
    assert rate == pytest.approx((yaw[1] - yaw[0]) / (2 * step), rel=1e-6)


TURN = math.radians(3.0)

SPEED = 5.0


def _carried(linear, angular, *, turn=TURN, speed=SPEED):
    """Pose half a second after the newest of two messages at 10 Hz, heading east at first."""
    history = PoseHistory(max_extrapolation=0.5)
    for time in (-0.1, 0.0):
        message = _message(Rotation.from_euler("z", turn * time), linear=linear, angular=angular)
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(
            round((100.0 + time) * 1e9), 10**9
        )
        message.pose.pose.position.x = speed * time
        history.add(read_own_ship(message))
    x, _, yaw, *_ = history.poses(np.array([100.5]))[0]
    return x, yaw


@pytest.mark.parametrize("speed", [0.0, 4.0], ids=["speed-not-given", "speed-given"])
@pytest.mark.parametrize("turn", [0.0, 0.04], ids=["turn-not-given", "turn-given"])
def test_a_twist_left_at_zero_does_not_hold_the_ship(speed, turn):
    found = _carried((speed, 0.0, 0.0), (0.0, 0.0, turn))
    assert found == pytest.approx((0.5 * (speed or SPEED), 0.5 * (turn or TURN)), rel=1e-6)


@pytest.mark.parametrize("length", [1e-3, 0.5, 2.0, 1e3])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_quaternion_need_not_be_of_unit_length(length, sign):
    message = _message(Rotation.from_euler("z", 0.75), linear=(4.0, 0.0, 0.0))
    for name in "xyzw":
        value = getattr(message.pose.pose.orientation, name)
        setattr(message.pose.pose.orientation, name, sign * length * value)
    sample = read_own_ship(message)
    assert sample.yaw == pytest.approx(0.75)
    assert math.hypot(*sample.rates[:2]) == pytest.approx(4.0)


def _set(message, path, value):
    *parents, name = path.split(".")
    for parent in parents:
        message = getattr(message, parent)
    setattr(message, name, value)


USED = [
    *(f"pose.pose.position.{name}" for name in "xy"),
    *(f"pose.pose.orientation.{name}" for name in "xyzw"),
    *(f"twist.twist.linear.{name}" for name in "xyz"),
    *(f"twist.twist.angular.{name}" for name in "xyz"),
]


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("path", USED)
def test_a_value_that_is_not_finite_is_refused_by_its_name(path, value):
    message = _message()
    _set(message, path, value)
    field = path.removeprefix("pose.").removeprefix("twist.")
    with pytest.raises(MessageError, match=f"^{field} must be finite") as error:
        read_own_ship(message)
    assert error.value.reason == "not_finite"


@pytest.mark.filterwarnings("error")
def test_a_speed_whose_components_overflow_is_refused_without_a_warning():
    message = _message()
    largest = np.finfo(float).max
    message.pose.pose.orientation.z = message.pose.pose.orientation.w
    message.twist.twist.linear.x = message.twist.twist.linear.y = -largest
    message.twist.twist.linear.z = largest
    with pytest.raises(ValueError, match="rates must be at most"):
        read_own_ship(message).check()


@pytest.mark.parametrize("w", [0.0, 1e-9], ids=["zero", "next-to-zero"])
def test_a_quaternion_without_direction_is_refused(w):
    message = _message()
    message.pose.pose.orientation.w = w
    with pytest.raises(MessageError, match=r"pose\.orientation must not be zero") as error:
        read_own_ship(message)
    assert error.value.reason == "zero_quaternion"


@pytest.mark.parametrize("pitch", [90.0, -90.0])
def test_a_vessel_on_end_has_no_heading(pitch):
    with pytest.raises(MessageError, match="no heading") as error:
        read_own_ship(_message(Rotation.from_euler("y", pitch, degrees=True)))
    assert error.value.reason == "undefined_heading"


POSE_COVARIANCE = np.array([[4.0, 0.5, 0.01], [0.5, 9.0, 0.02], [0.01, 0.02, 0.001]])


def _with_covariance(block):
    message = _message()
    full = np.diag([0.0, 0.0, 7.0, 8.0, 9.0, 0.0])
    full[np.ix_([0, 1, 5], [0, 1, 5])] = block
    message.pose.covariance = full.ravel()
    return message


def test_a_covariance_that_rounding_left_uneven_is_made_symmetric():
    uneven = POSE_COVARIANCE.copy()
    uneven[0, 1] += 1e-3
    found = read_own_ship(_with_covariance(uneven)).covariance
    np.testing.assert_array_equal(found, found.T)
    assert found[0, 1] == pytest.approx(0.5005)


UNKNOWN = [math.nan, -1.0, math.inf]


@pytest.mark.parametrize("value", UNKNOWN)
def test_a_variance_of_no_number_is_unknown_and_leaves_the_rest(value):
    block = np.array([[4.0, value, 0.5], [value, value, value], [0.5, value, 1.0]])
    found = read_own_ship(_with_covariance(block)).covariance
    np.testing.assert_array_equal(found, [[4.0, 0.0, 0.5], [0.0, 0.0, 0.0], [0.5, 0.0, 1.0]])


@pytest.mark.parametrize("value", UNKNOWN)
def test_a_covariance_of_no_numbers_is_unknown_as_zeros_are(value):
    message = _message()
    message.pose.covariance = np.full(36, value)
    assert read_own_ship(message).covariance is None
    message.pose.covariance = np.array([value, *np.zeros(35)])  # as in sensor_msgs/Imu
    assert read_own_ship(message).covariance is None


@pytest.mark.parametrize(
    ("block", "said"),
    [
        (
            [[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            "must be symmetric and positive semi-definite",
        ),
        (
            [[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1e308]],
            "of x and y must be positive semi-definite",
        ),
        ([[1.0, 1.7e308, 0.0], [1.7e308, 1.0, 0.0], [0.0, 0.0, 1.0]], "must be at most 1e"),
    ],
    ids=["correlation above 1", "beside an unknown heading", "huge beside small variances"],
)
def test_an_impossible_covariance_cannot_place_a_scan(block, said):
    with pytest.raises(ValueError, match=f"covariance {said}"):
        read_own_ship(_with_covariance(block)).check()


HUGE = [1e13, 1e152, 1e300, np.finfo(float).max]


@pytest.mark.parametrize("huge", HUGE)
def test_a_huge_variance_is_read_as_no_position_and_leaves_the_rest(huge):
    block = np.diag([4.0, huge, 0.25])
    block[0, 1] = block[1, 0] = math.sqrt(huge)
    found = read_own_ship(_with_covariance(block)).covariance
    np.testing.assert_allclose(found, [[4.0, 1e6, 0.0], [1e6, 1e12, 0.0], [0.0, 0.0, 0.25]])


@pytest.mark.parametrize("huge", [*HUGE, math.inf])
def test_a_huge_variance_of_the_yaw_is_no_heading(huge):
    found = read_own_ship(_with_covariance(np.diag([4.0, 9.0, huge]))).covariance
    np.testing.assert_allclose(found, np.diag([4.0, 9.0, 1e12]))
    assert found[2, 2] > MAX_YAW_VARIANCE


@pytest.mark.parametrize("huge", HUGE)
def test_a_covariance_that_is_huge_all_over_can_place_a_scan(huge):
    sample = read_own_ship(_with_covariance(huge * np.ones((3, 3))))
    sample.check()
    Scan(0.0, [1000.0], [0.5], sensor_pose_covariance=sample.covariance)


@pytest.mark.parametrize("yaw", [0.0, 1.5, 3.0, -2.5])
@pytest.mark.parametrize(
    "covariance", [None, POSE_COVARIANCE], ids=["covariance-unknown", "covariance"]
)
def test_a_written_sample_is_read_back(over_the_wire, yaw, covariance):
    sample = PoseSample(
        stamp=1_700_000_000.123_456_789,
        x=10.0,
        y=-20.0,
        yaw=yaw,
        covariance=covariance,
        rates=(3.0, -1.0, 0.03),
        roll=0.2,
        pitch=-0.1,
        frame_id="odom",
        child_frame_id="base_link",
    )
    found = read_own_ship(over_the_wire(odometry_message(sample)))
    for name in ("stamp", "frame_id", "child_frame_id", "x", "y"):
        assert getattr(found, name) == getattr(sample, name), name
    for name in ("yaw", "roll", "pitch", "rates"):
        assert getattr(found, name) == pytest.approx(getattr(sample, name), rel=1e-12), name
    if covariance is None:
        assert found.covariance is None
    else:
        np.testing.assert_array_equal(found.covariance, covariance)


def _sample(**values):
    frames = {"frame_id": "odom", "child_frame_id": "base_link"}
    return PoseSample(0.0, 1.0, 2.0, **frames, **{"yaw": math.pi / 2, **values})


def test_written_covariance_is_large_where_a_sample_says_nothing():
    message = odometry_message(_sample(covariance=POSE_COVARIANCE))
    covariance = np.reshape(message.pose.covariance, (6, 6))
    expected = np.diag([0.0, 0.0, 1e6, 1e6, 1e6, 0.0])
    expected[np.ix_([0, 1, 5], [0, 1, 5])] = POSE_COVARIANCE
    np.testing.assert_array_equal(covariance, expected)


@pytest.mark.parametrize("rates", [None, (math.nan, math.nan, math.nan)])
def test_rates_that_are_not_known_are_written_as_zeros_and_read_back_as_not_known(rates):
    message = odometry_message(_sample(rates=rates))
    twist = message.twist.twist
    parts = [getattr(vector, name) for vector in (twist.linear, twist.angular) for name in "xyz"]
    assert parts == [0.0] * 6
    assert np.isnan(read_own_ship(message).rates).all()


def grid(width=3, height=2, data=(0, 100, -1, 49, 50, 7), x=10.0, y=20.0, q=(0, 0, 0, 1), **more):
    """A grid with the fields of the message."""
    origin = SimpleNamespace(
        position=SimpleNamespace(x=x, y=y, z=0.0),
        orientation=SimpleNamespace(**dict(zip("xyzw", q, strict=True))),
    )
    info = {"resolution": more.get("resolution", 2.0), "width": width, "height": height}
    return SimpleNamespace(
        header=SimpleNamespace(frame_id=more.get("frame", "odom")),
        info=SimpleNamespace(origin=origin, **info),
        data=np.array(data, np.int8),
    )


def test_rows_go_along_x_and_unknown_is_no_land():
    mask = read_land(grid())
    centres = np.array([[11 + 2 * column, 21 + 2 * row] for row in range(2) for column in range(3)])
    assert mask.covers(centres).tolist() == [False, True, False, False, True, False]
    assert mask.cells == 2


QUARTER_TURN = (0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5))


def test_the_origin_may_be_turned():
    mask = read_land(grid(q=QUARTER_TURN))
    assert mask.origin == pytest.approx((10.0, 20.0, math.pi / 2))
    covered = mask.covers(np.array([[9.0, 23.0], [7.0, 23.0], [9.0, 21.0]]))
    assert covered.tolist() == [True, True, False]


@pytest.mark.parametrize(("turn", "centre"), [({}, (13.0, 25.0)), ({"q": QUARTER_TURN}, (15, 17))])
def test_land_of_a_ned_frame_has_rows_along_north(turn, centre):
    mask = read_land(grid(data=(0, 0, 0, 0, 0, 100), x=20.0, y=10.0, frame="map_ned", **turn))
    assert mask.cells == 1 and mask.covers(np.array([centre])).all()


@pytest.mark.parametrize(("width", "height"), [(0, 0), (0, 5), (5, 0)])
def test_a_grid_without_cells_is_no_chart(width, height):
    assert read_land(grid(width, height, (), resolution=0.0)) is None


NAN, INF = math.nan, math.inf


@pytest.mark.parametrize(
    "bad",
    [
        {"width": 4},
        {"width": 2**32 - 1, "height": 2**32 - 1},
        {"data": ()},
        {"resolution": 0.0},
        {"resolution": NAN},
        {"resolution": INF},
        {"resolution": -2.0},
        {"resolution": 1e30},
        {"x": NAN},
        {"y": INF},
        {"x": 1e300},
        {"q": (0.0, 0.0, 0.0, 0.0)},
        {"q": (NAN, 0.0, 0.0, 1.0)},
        {"q": (0.3, 0.0, 0.0, 1.0)},
        {"q": (0.0, math.sqrt(0.5), 0.0, math.sqrt(0.5))},
        {"q": (1.0, 0.0, 0.0, 0.0)},
    ],
    ids=str,
)
def test_a_grid_that_is_not_usable_is_refused(bad):
    with pytest.raises(MessageError) as refusal:
        read_land(grid(**bad))
    assert refusal.value.reason == "land_invalid"
    assert str(refusal.value)
