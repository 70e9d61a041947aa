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
"""Good streams of messages: what a driver, an own ship, a tracker and a chart send."""

import copy
import functools
import math
from dataclasses import dataclass
from typing import Any

import campaign  # noqa: F401 - makes `support` importable
import numpy as np
from builtin_interfaces.msg import Time
from nav_msgs.msg import OccupancyGrid, Odometry
from std_msgs.msg import Header
from support.driver_messages import MAKERS, echoes_of

from msg_adapters import ns_to_time, track_cloud
from tsepm_ros.tracker.tracks import ConfirmedTrack, TrackArrays

KINDS = tuple(MAKERS)
PINGS = 14
PERIOD = 12.0
START = 1000
"""Stamp of the first ping, s."""
CLUTTER = 4
FRAME = "sonar"


@dataclass(frozen=True)
class GoodPing:
    """A ping's messages: those of the own ship come first."""

    detections: Any
    poses: list[Any]


@dataclass(frozen=True)
class Stream:
    """Messages of one detections' type, and a chart."""

    pings: list[GoodPing]
    land: Any

    def between(self, index: int, rng: np.random.Generator) -> Any:
        """Detections of a ping, stamped between it and the ping before."""
        message = copy.deepcopy(self.pings[index].detections)
        early = float(rng.choice([0.0, 1.0, 6.0, 11.999]))
        message.header.stamp = stamp_of(START + PERIOD * index - early)
        return message

    def tracked(self, index: int) -> Any:
        """A tracker's report."""
        return tracker_message(START + PERIOD * index)


def stamp_of(seconds: float) -> Time:
    return ns_to_time(round(seconds * 1e9))


def header(seconds: float, frame_id: str = FRAME) -> Header:
    return Header(stamp=stamp_of(seconds), frame_id=frame_id)


def pose_message(seconds: float) -> Odometry:
    """Odometry of a slow ship that goes straight on."""
    yaw = 0.1
    message = Odometry(header=header(seconds, "odom"), child_frame_id=FRAME)
    message.pose.pose.position.x = seconds - START
    message.pose.pose.orientation.z = math.sin(yaw / 2)
    message.pose.pose.orientation.w = math.cos(yaw / 2)
    covariance = np.zeros(36)
    covariance[[0, 7, 35]] = 1.0, 1.0, 1e-4
    message.pose.covariance = covariance
    message.twist.twist.linear.x = 1.0
    return message


def tracker_message(seconds: float) -> Any:
    """A report of one target."""
    track = ConfirmedTrack(
        7, seconds, np.array([8000.0, 1.0, 3000.0, 1.0]), np.diag([25.0, 1.0, 25.0, 1.0]), (), 0.0
    )
    return track_cloud(header(seconds, "odom"), TrackArrays.from_tracks([track]))


def land_message() -> Any:
    """A chart with land far off."""
    message = OccupancyGrid(header=header(START, "odom"))
    message.info.resolution, message.info.width, message.info.height = 100.0, 8, 8
    message.info.origin.position.x = message.info.origin.position.y = -8000.0
    message.info.origin.orientation.w = 1.0
    message.data = [100] * 32 + [-1] * 32
    return message


@functools.cache
def good_stream(kind: str) -> Stream:
    """The stream of a type of detections."""
    pings = []
    for index in range(PINGS):
        seconds = START + PERIOD * index
        detections, _ = MAKERS[kind](header(seconds), echoes_of(index, clutter=CLUTTER))
        # A pose before the ping, and one after its last echo.
        poses = [pose_message(seconds - 0.5), pose_message(seconds + 11.0)]
        pings.append(GoodPing(detections, poses))
    return Stream(pings, land_message())
