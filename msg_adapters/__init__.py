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
"""ROS messages to detections and own-ship samples, and tracks to ROS messages.

All message layouts are here, one module per message family; no module needs rclpy. Message classes
are imported only to build a message, so reading needs no ROS.
"""

from msg_adapters.detections import (
    message_class,
    read_detections,
    supported_types,
    write_detections,
)
from msg_adapters.nav_messages import odometry_message, read_land, read_own_ship, track_odometry
from msg_adapters.ping import Ping
from msg_adapters.point_cloud import (
    PlacedDetections,
    detections_cloud,
    placed_detections_cloud,
    read_fields,
    read_placed_detections,
    write_cloud,
)
from msg_adapters.stamps import (
    MessageError,
    diagnostics,
    make_header,
    ns_to_seconds,
    ns_to_time,
    seconds_to_ns,
    time_to_ns,
)
from msg_adapters.track_messages import (
    TRACK_DTYPE,
    clear_markers,
    fixed_echo_markers,
    potential_track_markers,
    read_track_cloud,
    track_cloud,
    track_covariances,
    track_markers,
    track_states,
    tracker_report,
    truth_markers,
    truth_tracks,
)

__all__ = [
    "TRACK_DTYPE",
    "MessageError",
    "Ping",
    "PlacedDetections",
    "clear_markers",
    "detections_cloud",
    "diagnostics",
    "fixed_echo_markers",
    "make_header",
    "message_class",
    "ns_to_seconds",
    "ns_to_time",
    "odometry_message",
    "placed_detections_cloud",
    "potential_track_markers",
    "read_detections",
    "read_fields",
    "read_land",
    "read_own_ship",
    "read_placed_detections",
    "read_track_cloud",
    "seconds_to_ns",
    "supported_types",
    "time_to_ns",
    "track_cloud",
    "track_covariances",
    "track_markers",
    "track_odometry",
    "track_states",
    "tracker_report",
    "truth_markers",
    "truth_tracks",
    "write_cloud",
    "write_detections",
]
