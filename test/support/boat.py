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
"""A track initiator beside a sonar's driver, connected and ready."""

from collections.abc import Sequence
from typing import Any

from rclpy.qos import QoSProfile
from sensor_msgs.msg import PointCloud2

from support.ros_world import RELIABLE, World
from support.sonar_driver import Driver, Ping
from tsepm_ros.nodes.track_initiator import TrackInitiator

OFTEN = 0.05
"""Period of the diagnostics, so that nobody waits for them, s."""


class Boat:
    """The node under test, the driver, and what comes out on `tracks`."""

    def __init__(
        self, world: World, qos: QoSProfile = RELIABLE, **parameters: bool | int | float | str
    ) -> None:
        self.world = world
        self.driver = world.add(Driver(world.context, qos))
        self.node = world.make(TrackInitiator, named(parameters))
        self.tracks = world.listen(PointCloud2, "tracks")
        self.connect()

    def connect(self) -> None:
        """Wait until the node reads the driver, and everybody else is connected, too."""
        self.world.until(self.driver.publisher.get_subscription_count, "the node to subscribe")
        self.world.until_connected()

    def send(self, pings: Sequence[Ping], **more: Any) -> list[PointCloud2]:
        """Publish pings in a burst; returns the tracks that each gave."""
        seen = len(self.tracks)
        for ping in pings:
            self.driver.ping(ping, **more)
        return self.take(len(pings), seen)

    def take(self, number: int, seen: int) -> list[PointCloud2]:
        """Wait for a number of messages on `tracks` after those already seen."""
        self.world.until(lambda: len(self.tracks) >= seen + number, f"{number} messages on tracks")
        return self.tracks[seen:]


def named(parameters: dict[str, Any]) -> dict[str, Any]:
    """Parameters by their names in ROS, from keywords: ``tsepm__window`` is ``tsepm.window``."""
    given = {name.replace("__", "."): value for name, value in parameters.items()}
    return {"diagnostics_period": OFTEN, **given}
