"""A sonar's driver, and a consumer of tracks, by somebody who has read the topic table only.

Nothing of the package is imported here: "publish sensor_msgs/PointCloud2 with the fields range and
azimuth (float32) on `detections`; subscribe to `tracks`".
"""

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

from support.ros_world import RELIABLE

START_NS = 1_700_000_000_123_456_789
"""A date whose nanoseconds no float64 holds."""

FORMATS = {
    PointField.INT8: "i1",
    PointField.UINT16: "u2",
    PointField.UINT32: "u4",
    PointField.FLOAT32: "f4",
    PointField.FLOAT64: "f8",
}


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
    kinds = {name: datatypes.get(name, datatype) for name in columns}
    layout = np.dtype([(name, "<" + FORMATS[kind]) for name, kind in kinds.items()])
    array = np.zeros(len(next(iter(columns.values()))), layout)
    for name, values in columns.items():
        array[name] = values
    message = PointCloud2(
        height=1,
        width=len(array),
        fields=[
            PointField(name=name, offset=layout.fields[name][1], datatype=kind, count=1)
            for name, kind in kinds.items()
        ],
        point_step=layout.itemsize,
        row_step=array.nbytes,
        is_dense=True,
        data=array.tobytes(),
    )
    message.header.frame_id = frame_id
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, 10**9)
    return message


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
    codes = dict(zip(FORMATS, ("<b", "<H", "<I", "<f", "<d"), strict=True))
    data = bytes(message.data)
    return [
        {
            field.name: struct.unpack_from(
                codes[field.datatype], data, index * message.point_step + field.offset
            )[0]
            for field in message.fields
        }
        for index in range(message.width * message.height)
    ]
