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
"""A radar that turns past targets; steps are powers of 2, so turns and beams agree to the bit."""

import math
from collections.abc import Iterator
from types import SimpleNamespace

import numpy as np

from msg_adapters import read_detections
from tsepm_ros import Scan, SensorModel
from tsepm_ros.own_ship.pose_history import PoseSample
from tsepm_ros.own_ship.registration import UnregisteredScan
from tsepm_ros.session.session import ScanResult, Session
from tsepm_ros.settings.node_options import SessionOptions
from tsepm_ros.settings.settings import Settings
from tsepm_ros.tracker.scan import ScanArc

BEAMS, STEP = 402, 2.0**-6
"""A turn but for 0.1 degrees."""
FIRST = -201 * STEP
BEAM_NS = 7_812_500
TURN = BEAMS * BEAM_NS * 1e-9
START_NS = 1_700_000_000 * 10**9
RADAR = SensorModel(range_std=1.0, range_std_fraction=0.0, azimuth_std=0.01, max_range=1000.0)
TARGETS = ((300.0, 3.0, 200.0, -2.0), (-400.0, -2.0, 300.0, 3.0))
"""x, vx, y, vy."""


class LaserScan(SimpleNamespace):
    """Stands in for sensor_msgs/LaserScan, so that no ROS is needed."""

    __msgtype__ = "sensor_msgs/msg/LaserScan"


def still(time: float) -> tuple[float, float, float]:
    """A ship at rest."""
    return 0.0, 0.0, 0.0


def circling(time: float) -> tuple[float, float, float]:
    """A ship at 6 m/s that turns by 5 degrees a second."""
    rate = math.radians(5.0)
    yaw = rate * time
    return 6.0 / rate * math.sin(yaw), 6.0 / rate * (1.0 - math.cos(yaw)), yaw


def turns(number: int, pose=still, targets=TARGETS, *, seed: int = 1, clutter: int = 8, width=1.5):
    """Ranges of every beam, (turns, BEAMS); inf without an echo. A target spans `width` steps."""
    rng = np.random.default_rng(seed)
    ranges = np.full((number, BEAMS), np.inf, np.float32)
    for turn, beam in np.ndindex(ranges.shape):
        time = (turn * BEAMS + beam) * BEAM_NS * 1e-9
        x, y, yaw = pose(time)
        for at_x, vx, at_y, vy in targets:
            east, north = at_x + vx * time - x, at_y + vy * time - y
            off = math.remainder(math.atan2(north, east) - yaw - (FIRST + beam * STEP), 2 * math.pi)
            if abs(off) < width * STEP:
                ranges[turn, beam] = math.hypot(east, north) + 0.5 * rng.standard_normal()
    for turn in range(number):
        ranges[turn, rng.integers(20, BEAMS - 20, clutter)] = rng.uniform(20.0, 900.0, clutter)
    return ranges


def fan(stamp_ns: int, first: float, ranges, *, time_increment: float = 0.0) -> LaserScan:
    """A message of some beams."""
    seconds, nanoseconds = divmod(stamp_ns, 10**9)
    return LaserScan(
        header=SimpleNamespace(
            stamp=SimpleNamespace(sec=seconds, nanosec=nanoseconds), frame_id="radar"
        ),
        angle_min=first,
        angle_max=first + STEP * (len(ranges) - 1),
        angle_increment=STEP,
        time_increment=time_increment,
        range_min=0.0,
        range_max=1e5,
        ranges=np.asarray(ranges),
        intensities=[],
    )


def whole(ranges) -> list[LaserScan]:
    """A message per turn."""
    return [
        fan(START_NS + turn * BEAMS * BEAM_NS, FIRST, one, time_increment=BEAM_NS * 1e-9)
        for turn, one in enumerate(ranges)
    ]


def in_parts(ranges, size: int = 1) -> list[LaserScan]:
    """A message per `size` beams."""
    return [
        fan(
            START_NS + (turn * BEAMS + beam) * BEAM_NS,
            FIRST + beam * STEP,
            one[beam : beam + size],
            time_increment=BEAM_NS * 1e-9 if size > 1 else 0.0,
        )
        for turn, one in enumerate(ranges)
        for beam in range(0, BEAMS, size)
    ]


def read(message: LaserScan) -> UnregisteredScan:
    return read_detections(message).sensor_scan


def settings(sweep: object, *, sensor: SensorModel = RADAR, **options) -> Settings:
    return Settings(session=SessionOptions(sweep=sweep, **options), sensor=sensor)


def poses(pose, until: float, period: float = 0.0625) -> Iterator[PoseSample]:
    for time in np.arange(-1.0, until, period).tolist():
        yield PoseSample(START_NS * 1e-9 + time, *pose(time), frame_id="odom")


def played(session: Session, messages, pose=None) -> list[ScanResult]:
    """Results of messages, each processed as it comes; of a moving ship with its poses."""
    if pose is not None:
        stamp = messages[-1].header.stamp
        for sample in poses(pose, stamp.sec + 1e-9 * stamp.nanosec - 1e-9 * START_NS + 2.0 * TURN):
            session.add_own_ship(sample)
    results = []
    for message in messages:
        session.add_scan(message if isinstance(message, UnregisteredScan) else read(message), 0.0)
        results += session.process()
    return results + list(session.process(last=True))


def beam(
    stamp: float, azimuth: float | None, *range: float, whole: bool = True
) -> UnregisteredScan:
    """A message of one beam with some echoes; without an azimuth, it shows none."""
    scan = Scan(stamp, range, np.full(len(range), azimuth or 0.0))
    return UnregisteredScan(
        scan, "radar", beams=None if azimuth is None else ScanArc(azimuth, 0.0, whole)
    )


def contents(scans) -> list[list[float]]:
    """Ranges of each scan."""
    return [scan.scan.range.tolist() for scan in scans]
