"""Tracks as Odometry."""

from __future__ import annotations

import numpy as np
import pytest

from msg_adapters import track_odometry


@pytest.fixture
def message(header, make_track, over_the_wire):
    return over_the_wire(track_odometry(header, make_track()))


def test_header_and_child_frame_name_fixed_frame_and_track(message, header):
    assert message.header == header
    assert message.child_frame_id == "track_7"


def test_state_is_in_pose_and_twist(message):
    position, velocity = message.pose.pose.position, message.twist.twist.linear
    assert (position.x, position.y, position.z) == (3000.25, 4000.5, 0.0)
    assert (velocity.x, velocity.y, velocity.z) == (-4.5, 2.25, 0.0)


def test_twist_axes_are_those_of_the_fixed_frame(message):
    turn = message.pose.pose.orientation
    assert (turn.x, turn.y, turn.z, turn.w) == (0.0, 0.0, 0.0, 1.0)


@pytest.mark.parametrize(
    ("part", "block"),
    [
        pytest.param("pose", [[9000.0, 2000.0], [2000.0, 5000.0]], id="position"),
        pytest.param("twist", [[4.0, 0.5], [0.5, 3.0]], id="velocity"),
    ],
)
def test_covariance_has_its_block_and_a_large_variance_for_the_rest(message, part, block):
    covariance = np.reshape(getattr(message, part).covariance, (6, 6))
    expected = np.diag([0.0, 0.0, 1e6, 1e6, 1e6, 1e6])
    expected[:2, :2] = block
    np.testing.assert_array_equal(covariance, expected)
    assert (np.diag(covariance) > 0).all()
