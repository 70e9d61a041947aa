"""Tracks in messages of other stacks, on stand-ins with the fields of their files."""

import math
import uuid

import numpy as np
import pytest
from support import foreign_messages

from msg_adapters import make_header
from msg_adapters.nav_messages import UNOBSERVED_VARIANCE
from msg_adapters.track_objects import radar_tracks, track_uuid, tracked_objects
from tsepm_ros.tracker.tracks import ConfirmedTrack, TrackArrays

INSTANCE = uuid.UUID(int=7)
HEADER = make_header(1_700_000_000_000_000_000, "odom")
SPREAD = np.array(
    [[4.0, 0.5, 1.0, 0.1], [0.5, 0.3, 0.2, 0.05], [1.0, 0.2, 9.0, 0.6], [0.1, 0.05, 0.6, 0.2]]
)


@pytest.fixture(autouse=True)
def _packages(monkeypatch):
    foreign_messages.install(monkeypatch)


def tracks(**more):
    state = np.array([100.0, 3.0, -50.0, 4.0])
    return TrackArrays.of([ConfirmedTrack(5, 1.7e9, state, SPREAD, (), 0.0, **more)])


def test_a_radar_track_has_state_covariances_and_its_uuid():
    message = radar_tracks(HEADER, tracks(), INSTANCE)
    (one,) = message.tracks
    assert message.header is HEADER
    assert (one.position.x, one.position.y) == (100.0, -50.0)
    assert (one.velocity.x, one.velocity.y) == (3.0, 4.0)
    assert one.position_covariance == [4.0, 1.0, 0.0, 9.0, 0.0, UNOBSERVED_VARIANCE]
    assert one.velocity_covariance == [0.3, 0.05, 0.0, 0.2, 0.0, UNOBSERVED_VARIANCE]
    assert bytes(one.uuid.uuid) == track_uuid(INSTANCE, 5).bytes


@pytest.mark.parametrize(("probability", "kind"), [(math.nan, 0), (0.5, 0), (0.95, 1), (0.02, 2)])
def test_a_radar_track_is_static_or_dynamic_where_that_is_known(probability, kind):
    (one,) = radar_tracks(HEADER, tracks(stationary_probability=probability), INSTANCE).tracks
    assert one.classification == kind


def test_a_tracked_object_moves_along_its_own_x_axis():
    message = tracked_objects(HEADER, tracks(existence_probability=0.75), INSTANCE)
    (one,) = message.objects
    pose = one.kinematics.pose_with_covariance.pose
    course = 2.0 * math.atan2(pose.orientation.z, pose.orientation.w)
    twist = one.kinematics.twist_with_covariance
    speed = twist.twist.linear.x
    assert (pose.position.x, pose.position.y) == (100.0, -50.0)
    assert (speed * math.cos(course), speed * math.sin(course)) == pytest.approx((3.0, 4.0))
    assert one.existence_probability == 0.75
    turned = np.reshape(twist.covariance, (6, 6))[:2, :2]
    axes = np.array([[0.6, -0.8], [0.8, 0.6]])
    np.testing.assert_allclose(axes @ turned @ axes.T, SPREAD[1::2, 1::2], atol=1e-12)
    position = np.reshape(one.kinematics.pose_with_covariance.covariance, (6, 6))[:2, :2]
    np.testing.assert_array_equal(position, SPREAD[0::2, 0::2])


def test_the_uuid_of_a_track_is_another_in_another_run():
    assert track_uuid(INSTANCE, 5) == track_uuid(INSTANCE, 5)
    assert track_uuid(INSTANCE, 5) != track_uuid(INSTANCE, 6)
    assert track_uuid(INSTANCE, 5) != track_uuid(uuid.UUID(int=8), 5)
