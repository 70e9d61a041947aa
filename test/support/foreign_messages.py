"""Stand-ins for messages whose packages are not on PyPI, with exactly the fields of their files.

Like rclpy's, they have no other attributes, and their `float32[]` are arrays of that type.
"""

import array
import sys
from collections.abc import Callable
from types import ModuleType
from typing import Any

import pytest
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import (
    AccelWithCovariance,
    Point,
    Polygon,
    Pose,
    PoseWithCovariance,
    TwistWithCovariance,
    Vector3,
)
from std_msgs.msg import Header

FLOAT32_ARRAY = object()


def message_type(type_name: str, **fields: Callable[[], Any] | object) -> type:
    """Make a message class of fields and what makes their defaults."""

    def __init__(self: Any, **values: Any) -> None:  # noqa: N807
        for name, default in fields.items():
            value = [] if default is FLOAT32_ARRAY else default()  # type: ignore[operator]
            setattr(self, name, values.pop(name, value))
        assert not values, f"{type_name} has no fields {sorted(values)}"

    def __setattr__(self: Any, name: str, value: Any) -> None:  # noqa: N807
        if fields.get(name) is FLOAT32_ARRAY:
            value = array.array("f", value)
        object.__setattr__(self, name, value)

    package, name = type_name.split("/msg/")
    members = {
        "__slots__": tuple(fields),
        "__init__": __init__,
        "__setattr__": __setattr__,
        "__module__": f"{package}.msg._{name.lower()}",
    }
    return type(name, (), members)


PingInfo = message_type(
    "marine_acoustic_msgs/msg/PingInfo",
    frequency=float,
    sound_speed=float,
    tx_beamwidths=FLOAT32_ARRAY,
    rx_beamwidths=FLOAT32_ARRAY,
)
DetectionFlag = message_type("marine_acoustic_msgs/msg/DetectionFlag", flag=int)
SonarDetections = message_type(
    "marine_acoustic_msgs/msg/SonarDetections",
    header=Header,
    ping_info=PingInfo,
    flags=list,
    two_way_travel_times=FLOAT32_ARRAY,
    tx_delays=FLOAT32_ARRAY,
    intensities=FLOAT32_ARRAY,
    tx_angles=FLOAT32_ARRAY,
    rx_angles=FLOAT32_ARRAY,
)
SonarRanges = message_type(
    "marine_acoustic_msgs/msg/SonarRanges",
    header=Header,
    ping_info=PingInfo,
    flags=list,
    transmit_delays=FLOAT32_ARRAY,
    intensities=FLOAT32_ARRAY,
    beam_unit_vec=list,
    ranges=FLOAT32_ARRAY,
)
RadarReturn = message_type(
    "radar_msgs/msg/RadarReturn",
    range=float,
    azimuth=float,
    elevation=float,
    doppler_velocity=float,
    amplitude=float,
)
RadarScan = message_type("radar_msgs/msg/RadarScan", header=Header, returns=list)
ObjectHypothesis = message_type("vision_msgs/msg/ObjectHypothesis", class_id=str, score=float)
ObjectHypothesisWithPose = message_type(
    "vision_msgs/msg/ObjectHypothesisWithPose", hypothesis=ObjectHypothesis, pose=PoseWithCovariance
)
BoundingBox3D = message_type("vision_msgs/msg/BoundingBox3D", center=Pose, size=Vector3)
Detection3D = message_type(
    "vision_msgs/msg/Detection3D", header=Header, results=list, bbox=BoundingBox3D, id=str
)
Detection3DArray = message_type("vision_msgs/msg/Detection3DArray", header=Header, detections=list)


def six_zeros() -> list[float]:
    """Default of a field `float32[6]`."""
    return [0.0] * 6


UUID = message_type("unique_identifier_msgs/msg/UUID", uuid=lambda: [0] * 16)
RadarTrack = message_type(
    "radar_msgs/msg/RadarTrack",
    uuid=UUID,
    position=Point,
    velocity=Vector3,
    acceleration=Vector3,
    size=Vector3,
    classification=int,
    position_covariance=six_zeros,
    velocity_covariance=six_zeros,
    acceleration_covariance=six_zeros,
    size_covariance=six_zeros,
)
RadarTracks = message_type("radar_msgs/msg/RadarTracks", header=Header, tracks=list)
ObjectClassification = message_type(
    "autoware_perception_msgs/msg/ObjectClassification", label=int, probability=float
)
Shape = message_type(
    "autoware_perception_msgs/msg/Shape", type=int, footprint=Polygon, dimensions=Vector3
)
TrackedObjectKinematics = message_type(
    "autoware_perception_msgs/msg/TrackedObjectKinematics",
    pose_with_covariance=PoseWithCovariance,
    twist_with_covariance=TwistWithCovariance,
    acceleration_with_covariance=AccelWithCovariance,
    orientation_availability=int,
    is_stationary=bool,
)
TrackedObject = message_type(
    "autoware_perception_msgs/msg/TrackedObject",
    object_id=UUID,
    existence_probability=float,
    classification=list,
    kinematics=TrackedObjectKinematics,
    shape=Shape,
)
TrackedObjects = message_type(
    "autoware_perception_msgs/msg/TrackedObjects", header=Header, objects=list
)

SonarImageData = message_type(
    "marine_acoustic_msgs/msg/SonarImageData",
    is_bigendian=bool,
    dtype=int,
    beam_count=int,
    data=bytes,
)
ProjectedSonarImage = message_type(
    "marine_acoustic_msgs/msg/ProjectedSonarImage",
    header=Header,
    ping_info=PingInfo,
    beam_directions=list,
    ranges=FLOAT32_ARRAY,
    image=SonarImageData,
)
RawSonarImage = message_type(
    "marine_acoustic_msgs/msg/RawSonarImage",
    header=Header,
    ping_info=PingInfo,
    sample_rate=float,
    samples_per_beam=int,
    sample0=int,
    tx_delays=FLOAT32_ARRAY,
    tx_angles=FLOAT32_ARRAY,
    rx_angles=FLOAT32_ARRAY,
    image=SonarImageData,
)
RadarEcho = message_type("marine_sensor_msgs/msg/RadarEcho", echoes=FLOAT32_ARRAY)
RadarSector = message_type(
    "marine_sensor_msgs/msg/RadarSector",
    header=Header,
    angle_start=float,
    angle_increment=float,
    time_increment=Duration,
    scan_time=Duration,
    range_min=float,
    range_max=float,
    intensities=list,
)
SonarEcho = message_type(
    "ping360_sonar_msgs/msg/SonarEcho",
    header=Header,
    angle=float,
    gain=int,
    number_of_samples=int,
    transmit_frequency=int,
    speed_of_sound=int,
    range=int,
    intensities=bytes,
)

PACKAGES: dict[str, tuple[type, ...]] = {
    "marine_acoustic_msgs": (
        PingInfo,
        DetectionFlag,
        SonarDetections,
        SonarRanges,
        SonarImageData,
        ProjectedSonarImage,
        RawSonarImage,
    ),
    "autoware_perception_msgs": (
        ObjectClassification,
        Shape,
        TrackedObjectKinematics,
        TrackedObject,
        TrackedObjects,
    ),
    "marine_sensor_msgs": (RadarEcho, RadarSector),
    "ping360_sonar_msgs": (SonarEcho,),
    "radar_msgs": (RadarReturn, RadarScan, RadarTrack, RadarTracks),
    "vision_msgs": (
        ObjectHypothesis,
        ObjectHypothesisWithPose,
        BoundingBox3D,
        Detection3D,
        Detection3DArray,
    ),
}


def remove(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make the packages not importable for a test, whether they are there or not."""
    for package in PACKAGES:
        monkeypatch.setitem(sys.modules, package, None)
        monkeypatch.setitem(sys.modules, f"{package}.msg", None)


def install(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make the packages importable for a test."""
    for package, classes in PACKAGES.items():
        module = ModuleType(f"{package}.msg")
        for one in classes:
            setattr(module, one.__name__, one)
        monkeypatch.setitem(sys.modules, package, ModuleType(package))
        monkeypatch.setitem(sys.modules, f"{package}.msg", module)
