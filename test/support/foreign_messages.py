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
KINDS: dict[str, Callable[[], Any] | object] = {
    **{kind.__name__: kind for kind in (float, int, bool, str, bytes, list)},
    **{kind.__name__: kind for kind in (Duration, Header, Point, Polygon, Pose, Vector3)},
    **{one.__name__: one for one in (AccelWithCovariance, PoseWithCovariance, TwistWithCovariance)},
    "float32[]": FLOAT32_ARRAY,
    "float32[6]": lambda: [0.0] * 6,
    "uint8[16]": lambda: [0] * 16,
}
"""What makes the default of a field, by its type."""
PACKAGES: dict[str, list[type]] = {}


def message_type(package: str, name: str, fields: dict[str, Callable[[], Any] | object]) -> type:
    """Make a message class of fields and what makes their defaults."""

    def __init__(self: Any, **values: Any) -> None:  # noqa: N807
        for field, default in fields.items():
            value = [] if default is FLOAT32_ARRAY else default()  # type: ignore[operator]
            setattr(self, field, values.pop(field, value))
        assert not values, f"{name} has no fields {sorted(values)}"

    def __setattr__(self: Any, field: str, value: Any) -> None:  # noqa: N807
        if fields.get(field) is FLOAT32_ARRAY:
            value = array.array("f", value)
        object.__setattr__(self, field, value)

    members = {
        "__slots__": tuple(fields),
        "__init__": __init__,
        "__setattr__": __setattr__,
        "__module__": f"{package}.msg._{name.lower()}",
    }
    return type(name, (), members)


def messages(package: str, *definitions: str) -> list[type]:
    """Make messages of a package by a name, and types each with the fields of it in their order."""
    for definition in definitions:
        name, _, content = definition.partition(": ")
        fields = {}
        for kind, *names in map(str.split, content.split(",")):
            fields |= dict.fromkeys(names, KINDS[kind])
        KINDS[name] = message_type(package, name, fields)
        PACKAGES.setdefault(package, []).append(KINDS[name])
    return PACKAGES[package]


PingInfo, DetectionFlag, SonarDetections, SonarRanges, *_ = messages(
    "marine_acoustic_msgs",
    "PingInfo: float frequency sound_speed, float32[] tx_beamwidths rx_beamwidths",
    "DetectionFlag: int flag",
    "SonarDetections: Header header, PingInfo ping_info, list flags, float32[] "
    "two_way_travel_times tx_delays intensities tx_angles rx_angles",
    "SonarRanges: Header header, PingInfo ping_info, list flags, "
    "float32[] transmit_delays intensities, list beam_unit_vec, float32[] ranges",
)
*_, SonarImageData, ProjectedSonarImage, RawSonarImage = messages(
    "marine_acoustic_msgs",
    "SonarImageData: bool is_bigendian, int dtype beam_count, bytes data",
    "ProjectedSonarImage: Header header, PingInfo ping_info, list beam_directions, "
    "float32[] ranges, SonarImageData image",
    "RawSonarImage: Header header, PingInfo ping_info, float sample_rate, int samples_per_beam "
    "sample0, float32[] tx_delays tx_angles rx_angles, SonarImageData image",
)
(UUID,) = messages("unique_identifier_msgs", "UUID: uint8[16] uuid")
RadarReturn, RadarScan, RadarTrack, RadarTracks = messages(
    "radar_msgs",
    "RadarReturn: float range azimuth elevation doppler_velocity amplitude",
    "RadarScan: Header header, list returns",
    "RadarTrack: UUID uuid, Point position, Vector3 velocity acceleration size, int classification"
    ", float32[6] position_covariance velocity_covariance acceleration_covariance size_covariance",
    "RadarTracks: Header header, list tracks",
)
ObjectHypothesis, ObjectHypothesisWithPose, BoundingBox3D, Detection3D, Detection3DArray = messages(
    "vision_msgs",
    "ObjectHypothesis: str class_id, float score",
    "ObjectHypothesisWithPose: ObjectHypothesis hypothesis, PoseWithCovariance pose",
    "BoundingBox3D: Pose center, Vector3 size",
    "Detection3D: Header header, list results, BoundingBox3D bbox, str id",
    "Detection3DArray: Header header, list detections",
)
ObjectClassification, Shape, TrackedObjectKinematics, TrackedObject, TrackedObjects = messages(
    "autoware_perception_msgs",
    "ObjectClassification: int label, float probability",
    "Shape: int type, Polygon footprint, Vector3 dimensions",
    "TrackedObjectKinematics: PoseWithCovariance pose_with_covariance, TwistWithCovariance "
    "twist_with_covariance, AccelWithCovariance acceleration_with_covariance, "
    "int orientation_availability, bool is_stationary",
    "TrackedObject: UUID object_id, float existence_probability, list classification, "
    "TrackedObjectKinematics kinematics, Shape shape",
    "TrackedObjects: Header header, list objects",
)
RadarEcho, RadarSector = messages(
    "marine_sensor_msgs",
    "RadarEcho: float32[] echoes",
    "RadarSector: Header header, float angle_start angle_increment, Duration time_increment "
    "scan_time, float range_min range_max, list intensities",
)
(SonarEcho,) = messages(
    "ping360_sonar_msgs",
    "SonarEcho: Header header, float angle, int gain number_of_samples transmit_frequency "
    "speed_of_sound range, bytes intensities",
)
del PACKAGES["unique_identifier_msgs"]  # comes with ROS


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
