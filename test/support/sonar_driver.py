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
"""A sonar's driver and a consumer of tracks, from the topic table alone: no import of ours."""

import math
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from sensor_msgs.msg import PointCloud2, PointField

from support.raw_cloud import DATATYPES, raw_cloud
from support.ros_world import RELIABLE

START_NS = 1_700_000_000_123_456_789
"""A date whose nanoseconds no float64 holds."""

CODES = {kind: code for code, kind in DATATYPES.items()}


@dataclass
class Ping:
    """One ping: numbers as the driver has them."""

    stamp_ns: int
    range: Sequence[float]
    azimuth: Sequence[float]


def pings(
    number: int = 12,
    *,
    seed: int = 1,
    targets: Sequence[tuple[float, float, float, float]] = ((3000.0, 4.0, 1500.0, -2.0),),
    clutter: int = 10,
    period: float = 12.0,
    start_ns: int = START_NS,
) -> list[Ping]:
    """Pings from the origin, with every target (x, vx, y, vy) in each, as float32."""
    rng = np.random.default_rng(seed)
    sequence = []
    for index in range(number):
        time = index * period
        x = np.array([target[0] + target[1] * time for target in targets])
        y = np.array([target[2] + target[3] * time for target in targets])
        distance, angle = np.hypot(x, y), np.arctan2(y, x)
        distance *= 1 + 0.01 * rng.standard_normal(len(x))
        angle += math.radians(0.7) * rng.standard_normal(len(x))
        distance = np.append(distance, 9000 * np.sqrt(rng.uniform(0.01, 1, clutter)))
        angle = np.append(angle, rng.uniform(-math.pi, math.pi, clutter))
        sequence.append(
            Ping(
                start_ns + index * round(period * 1e9),
                distance.astype(np.float32),
                angle.astype(np.float32),
            )
        )
    return sequence


def cloud(
    stamp_ns: int,
    columns: Mapping[str, Sequence[float]],
    *,
    frame_id: str = "sonar",
    datatype: int = PointField.FLOAT32,
    datatypes: Mapping[str, int] = MappingProxyType({}),
) -> PointCloud2:
    """Pack a cloud of one row, all fields of one datatype but those that have their own."""
    codes = {name: CODES[datatypes.get(name, datatype)] for name in columns}
    values = [np.asarray(columns[name]).astype(code).tolist() for name, code in codes.items()]
    rows = list(zip(*values, strict=True))
    return raw_cloud(codes.items(), rows, stamp=divmod(stamp_ns, 10**9), frame_id=frame_id)


class Driver(Node):
    """Publishes the pings of a sonar, and perhaps the ship's odometry."""

    publisher: Publisher

    def __init__(
        self,
        context: Any,
        qos: QoSProfile = RELIABLE,
        odometry_qos: QoSProfile = RELIABLE,
        **options: Any,
    ) -> None:
        super().__init__("driver", context=context, **options)
        self.publisher = self.create_publisher(PointCloud2, "detections", qos)
        self.odometry = self.create_publisher(Odometry, "own_ship/odometry", odometry_qos)

    def ping(self, ping: Ping, frame_id: str = "sonar", **more: Sequence[float]) -> None:
        columns = {"range": ping.range, "azimuth": ping.azimuth, **more}
        self.publisher.publish(cloud(ping.stamp_ns, columns, frame_id=frame_id))

    def pose(self, stamp_ns: int, x: float, y: float, yaw: float, frame_id: str = "odom") -> None:
        message = Odometry(child_frame_id="sonar")
        message.header.frame_id = frame_id
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, 10**9)
        message.pose.pose.position.x, message.pose.pose.position.y = float(x), float(y)
        message.pose.pose.orientation.z = math.sin(yaw / 2)
        message.pose.pose.orientation.w = math.cos(yaw / 2)
        self.odometry.publish(message)


def stamp_ns(message: Any) -> int:
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def points(message: PointCloud2) -> list[dict[str, float]]:
    """The points of a little-endian cloud, read value by value with struct."""
    data = bytes(message.data)
    return [
        {
            field.name: struct.unpack_from(
                "<" + CODES[field.datatype], data, index * message.point_step + field.offset
            )[0]
            for field in message.fields
        }
        for index in range(message.width * message.height)
    ]
