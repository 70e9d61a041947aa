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
"""Classes of ROS messages, each imported when it is first used: reading needs no ROS."""

from __future__ import annotations

import importlib
from typing import Any

PACKAGES = {
    "ObjectClassification": "autoware_perception_msgs",
    "TrackedObject": "autoware_perception_msgs",
    "TrackedObjects": "autoware_perception_msgs",
    "Time": "builtin_interfaces",
    "DiagnosticArray": "diagnostic_msgs",
    "DiagnosticStatus": "diagnostic_msgs",
    "KeyValue": "diagnostic_msgs",
    "Point": "geometry_msgs",
    "Vector3": "geometry_msgs",
    "SonarDetections": "marine_acoustic_msgs",
    "SonarRanges": "marine_acoustic_msgs",
    "OccupancyGrid": "nav_msgs",
    "Odometry": "nav_msgs",
    "RadarReturn": "radar_msgs",
    "RadarScan": "radar_msgs",
    "RadarTrack": "radar_msgs",
    "RadarTracks": "radar_msgs",
    "Image": "sensor_msgs",
    "LaserScan": "sensor_msgs",
    "NavSatFix": "sensor_msgs",
    "PointCloud2": "sensor_msgs",
    "PointField": "sensor_msgs",
    "ColorRGBA": "std_msgs",
    "Header": "std_msgs",
    "Detection3D": "vision_msgs",
    "Detection3DArray": "vision_msgs",
    "Marker": "visualization_msgs",
    "MarkerArray": "visualization_msgs",
}
"""Package of each class."""


def __getattr__(name: str) -> Any:
    """Import the class of a message, once."""
    if name not in PACKAGES:
        raise AttributeError(f"there is no class {name!r} in {__name__}")
    return globals().setdefault(
        name, getattr(importlib.import_module(f"{PACKAGES[name]}.msg"), name)
    )
