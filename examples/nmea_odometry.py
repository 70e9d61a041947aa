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
"""Odometry of a boat from the NMEA 0183 sentences of its GPS compass, received by UDP.

    .venv/bin/python examples/nmea_odometry.py --port 10110

GGA gives the position, HDT or THS the true heading. Each position is published on
`own_ship/odometry`, in m east and north of the first; with the heading of the last second, else
with a yaw that is not known.
"""

import argparse
import math
import socket
import sys
import time
from contextlib import suppress

POSITION_STD, HEADING_STD = 1.5, math.radians(0.5)
"""Errors of a common receiver, m and rad."""
UNKNOWN = 100.0
"""Variance of a yaw that is not known, rad^2."""


def sentence_fields(line):
    """Fields of a sentence whose checksum, where it has one, is right, with its type first."""
    body, _, told = line.strip().lstrip("$").partition("*")
    checksum = 0
    for character in body:
        checksum ^= ord(character)
    if told and told[:2].upper() != f"{checksum:02X}":
        return [""]
    talker, *fields = body.split(",")
    return [talker[2:], *fields]


def degrees(text, hemisphere):
    """A latitude or longitude such as 5939.0000 and N, in degrees."""
    whole, minutes = divmod(float(text), 100.0)
    return (whole + minutes / 60.0) * (-1.0 if hemisphere in "SW" else 1.0)


class GpsCompass:
    """Positions and headings of sentences, in m east and north of the first position, and rad."""

    def __init__(self):
        self._origin, self._heading = None, (-math.inf, math.nan)

    def read(self, line, now):
        """East, north and yaw (nan: not known) of a sentence with a position, else None."""
        kind, *fields = sentence_fields(line)
        try:
            if kind == "HDT" or (kind == "THS" and fields[1:2] == ["A"]):
                self._heading = now, math.radians(90.0 - float(fields[0]))
            if kind != "GGA" or int(fields[5]) == 0:  # no fix
                return None
            latitude, longitude = degrees(*fields[1:3]), degrees(*fields[3:5])
        except (ValueError, IndexError):
            return None  # an empty or cut sentence
        self._origin = self._origin or (latitude, longitude)
        angle = math.radians(self._origin[0])
        root = 1.0 - 0.00669438 * math.sin(angle) ** 2  # WGS 84
        across = 6378137.0 / math.sqrt(root)
        turned = (longitude - self._origin[1] + 180.0) % 360.0 - 180.0
        east = math.radians(turned) * across * math.cos(angle)
        north = math.radians(latitude - self._origin[0]) * across * 0.99330562 / root
        stamp, yaw = self._heading
        return east, north, yaw if now - stamp <= 1.0 else math.nan


def main():
    """Publish until Ctrl-C."""
    import rclpy
    from nav_msgs.msg import Odometry
    from rclpy.utilities import remove_ros_args

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--port", type=int, default=10110)
    port = parser.parse_args(remove_ros_args(sys.argv)[1:]).port
    compass, sentences = GpsCompass(), socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sentences.bind(("", port))
    rclpy.init()
    node = rclpy.create_node("nmea_odometry")
    publisher = node.create_publisher(Odometry, "own_ship/odometry", 10)
    with suppress(KeyboardInterrupt):
        while rclpy.ok():
            for line in sentences.recv(4096).decode("ascii", "replace").splitlines():
                if (place := compass.read(line, time.monotonic())) is None:
                    continue
                east, north, yaw = place
                odometry, known = Odometry(), not math.isnan(yaw)
                odometry.header.stamp = node.get_clock().now().to_msg()
                odometry.header.frame_id, odometry.child_frame_id = "map", "base_link"
                pose = odometry.pose.pose
                pose.position.x, pose.position.y = east, north
                pose.orientation.z = math.sin(yaw / 2.0) if known else 0.0
                pose.orientation.w = math.cos(yaw / 2.0) if known else 1.0
                odometry.pose.covariance[0] = odometry.pose.covariance[7] = POSITION_STD**2
                odometry.pose.covariance[35] = HEADING_STD**2 if known else UNKNOWN
                publisher.publish(odometry)


if __name__ == "__main__":
    main()
