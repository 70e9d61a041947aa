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
"""Markers as a viewer takes them."""

from visualization_msgs.msg import Marker, MarkerArray

from support.ros_world import LATCHED


def shown_markers(world):
    """The markers from now on: those that greet a viewer have come."""
    markers = world.listen(MarkerArray, "tracks/markers", LATCHED)
    world.until(lambda: markers, "what greets a viewer")
    markers.clear()
    world.until_connected()
    return markers


def drawn(messages):
    """Ids of the tracks that a viewer of these messages shows."""
    shown = set()
    for marker in [marker for message in messages for marker in message.markers]:
        key = (marker.ns, marker.id)
        if marker.action == Marker.DELETEALL:
            shown.clear()
        elif marker.action == Marker.DELETE:
            shown.discard(key)
        else:
            shown.add(key)
    return {track_id for _, track_id in shown}
