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


DEFINITIONS = {
    "radar_msgs/msg/RadarTrack": """unique_identifier_msgs/UUID uuid
geometry_msgs/Point position
geometry_msgs/Vector3 velocity
geometry_msgs/Vector3 acceleration
geometry_msgs/Vector3 size
uint16 classification
float32[6] position_covariance
float32[6] velocity_covariance
float32[6] acceleration_covariance
float32[6] size_covariance
""",
    "radar_msgs/msg/RadarTracks": "std_msgs/Header header\nradar_msgs/RadarTrack[] tracks\n",
    "autoware_perception_msgs/msg/ObjectClassification": "uint8 label\nfloat32 probability\n",
    "autoware_perception_msgs/msg/Shape": """uint8 type
geometry_msgs/Polygon footprint
geometry_msgs/Vector3 dimensions
""",
    "autoware_perception_msgs/msg/TrackedObjectKinematics": """
geometry_msgs/PoseWithCovariance pose_with_covariance
geometry_msgs/TwistWithCovariance twist_with_covariance
geometry_msgs/AccelWithCovariance acceleration_with_covariance
uint8 orientation_availability
bool is_stationary
""",
    "autoware_perception_msgs/msg/TrackedObject": """unique_identifier_msgs/UUID object_id
float32 existence_probability
ObjectClassification[] classification
TrackedObjectKinematics kinematics
Shape shape
""",
    "autoware_perception_msgs/msg/TrackedObjects": """std_msgs/Header header
TrackedObject[] objects
""",
}
"""The fields of the packages' message files."""


def of_definition(store, value, name):
    """A message as one of the types that rosbags makes of the definitions."""
    fields = store.fielddefs[name][1]
    made = {}
    for field, (kind, described) in fields:
        given = getattr(value, field)
        if kind.name == "NAME":
            made[field] = of_definition(store, given, described)
        elif kind.name == "BASE":
            made[field] = given
        elif described[0][0].name == "NAME":
            made[field] = [of_definition(store, one, described[0][1]) for one in given]
        else:
            made[field] = np.asarray(given, described[0][1][0])
    return store.types[name](**made)


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (radar_tracks, "radar_msgs/msg/RadarTracks"),
        (tracked_objects, "autoware_perception_msgs/msg/TrackedObjects"),
    ],
)
def test_a_message_is_read_again_by_its_definition(make, name):
    rosbags = pytest.importorskip("rosbags.typesys", reason="rosbags makes types of definitions")
    store = rosbags.get_typestore(rosbags.Stores.ROS2_JAZZY)
    types = {}
    for one, text in DEFINITIONS.items():
        types.update(rosbags.get_types_from_msg(text, one))
    store.register(types)
    message = make(HEADER, tracks(existence_probability=0.75), INSTANCE)
    read = store.deserialize_cdr(
        store.serialize_cdr(of_definition(store, message, name), name), name
    )
    assert read.header.frame_id == "odom"
    (one,) = read.tracks if make is radar_tracks else read.objects
    if make is radar_tracks:
        np.testing.assert_allclose(one.velocity_covariance[[0, 1, 3]], [0.3, 0.05, 0.2], rtol=1e-6)
        assert bytes(one.uuid.uuid) == track_uuid(INSTANCE, 5).bytes
    else:
        assert one.existence_probability == 0.75
        assert one.kinematics.twist_with_covariance.twist.linear.x == 5.0
        assert one.kinematics.pose_with_covariance.covariance[7] == 9.0
        assert bytes(one.object_id.uuid) == track_uuid(INSTANCE, 5).bytes
