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
"""Messages of every supported type, rounded as it rounds, and what a `Scan` of them must hold."""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from geometry_msgs.msg import Point, Pose, Vector3
from sensor_msgs.msg import LaserScan, PointCloud2, PointField
from std_msgs.msg import Header

from support.foreign_messages import (
    BoundingBox3D,
    Detection3D,
    Detection3DArray,
    DetectionFlag,
    PingInfo,
    RadarReturn,
    RadarScan,
    SonarDetections,
    SonarRanges,
)

SOUND = 1500.0
RAYS = 7200


class Echo(NamedTuple):
    """An echo: m in the horizontal plane, rad from ahead to port, rad above the plane."""

    range: float
    azimuth: float
    elevation: float = 0.0


Numbers = dict[str, list[float]]
Maker = Callable[[Header, Sequence[Echo]], tuple[Any, Numbers]]


def rounded(value: float) -> float:
    """The nearest float32."""
    return float(np.float32(value))


def _direction(echo: Echo) -> tuple[float, float, float]:
    """Ahead, to port and up, of length 1."""
    level = math.cos(echo.elevation)
    ahead, port = level * math.cos(echo.azimuth), level * math.sin(echo.azimuth)
    return ahead, port, math.sin(echo.elevation)


def _place(echo: Echo) -> tuple[float, float, float]:
    ahead, port, up = _direction(echo)
    slant = echo.range / math.cos(echo.elevation)
    return slant * ahead, slant * port, slant * up


def point_cloud(header: Header, echoes: Sequence[Echo]) -> tuple[PointCloud2, Numbers]:
    """As simulators publish it: x, y, z and intensity, float32."""
    rows = [(*_place(echo), 7.0) for echo in echoes]
    data = np.array(rows, np.float32).reshape(-1, 4)
    fields = [
        PointField(name=name, offset=4 * index, datatype=PointField.FLOAT32, count=1)
        for index, name in enumerate(("x", "y", "z", "intensity"))
    ]
    sizes = {"height": 1, "width": len(rows), "point_step": 16, "row_step": data.nbytes}
    cloud = PointCloud2(header=header, fields=fields, data=data.tobytes(), **sizes)
    places = [(rounded(x), rounded(y)) for x, y, _, _ in rows]
    return cloud, {
        "range": [math.hypot(x, y) for x, y in places],
        "azimuth": [math.atan2(y, x) for x, y in places],
    }


def laser_scan(header: Header, echoes: Sequence[Echo]) -> tuple[LaserScan, Numbers]:
    """A full turn of rays, the nearer of two echoes on one ray, +inf where there is none."""
    start, step = rounded(-math.pi), rounded(2 * math.pi / RAYS)
    ranges = np.full(RAYS, np.inf, np.float32)
    for echo in echoes:
        ray = min(round((echo.azimuth - start) / step), RAYS - 1)
        ranges[ray] = min(ranges[ray], np.float32(echo.range))
    scan = LaserScan(
        header=header,
        angle_min=start,
        angle_max=-start,
        angle_increment=step,
        range_min=1.0,
        range_max=20_000.0,
        ranges=ranges,
    )
    hit = np.flatnonzero(np.isfinite(ranges)).tolist()
    return scan, {
        "range": [float(ranges[ray]) for ray in hit],
        "azimuth": [start + ray * step for ray in hit],
    }


def sonar_detections(header: Header, echoes: Sequence[Echo]) -> tuple[SonarDetections, Numbers]:
    """Travel times and angles; x is up, y to starboard, z ahead."""
    travel = [rounded(2 * echo.range / math.cos(echo.elevation) / SOUND) for echo in echoes]
    tx = [rounded(echo.elevation) for echo in echoes]
    rx = [rounded(math.asin(-_direction(echo)[1])) for echo in echoes]
    delay = [rounded(0.001 * index) for index in range(len(echoes))]
    message = SonarDetections(
        header=header,
        ping_info=PingInfo(frequency=2e5, sound_speed=SOUND),
        flags=[DetectionFlag() for _ in echoes],
        two_way_travel_times=travel,
        tx_delays=delay,
        tx_angles=tx,
        rx_angles=rx,
    )
    numbers: Numbers = {"range": [], "azimuth": [], "time_offset": []}
    for time, up, starboard, late in zip(travel, tx, rx, delay, strict=True):
        y, z = math.sin(starboard), math.sqrt(1 - math.sin(up) ** 2 - math.sin(starboard) ** 2)
        numbers["range"].append(0.5 * SOUND * time * math.hypot(y, z))
        numbers["azimuth"].append(math.atan2(-y, z))
        numbers["time_offset"].append(late + 0.5 * time)
    return message, numbers


def sonar_ranges(header: Header, echoes: Sequence[Echo]) -> tuple[SonarRanges, Numbers]:
    """Ranges along vectors; x is up, y to starboard, z ahead."""
    slant = [rounded(echo.range / math.cos(echo.elevation)) for echo in echoes]
    directions = [_direction(echo) for echo in echoes]
    message = SonarRanges(
        header=header,
        ping_info=PingInfo(frequency=2e5, sound_speed=SOUND),
        ranges=slant,
        beam_unit_vec=[Vector3(x=up, y=-port, z=ahead) for ahead, port, up in directions],
    )
    return message, {
        "range": [
            r * math.hypot(ahead, port)
            for r, (ahead, port, _) in zip(slant, directions, strict=True)
        ],
        "azimuth": [math.atan2(port, ahead) for ahead, port, _ in directions],
        "time_offset": [r / SOUND for r in slant],
    }


def radar_scan(header: Header, echoes: Sequence[Echo]) -> tuple[RadarScan, Numbers]:
    """Returns with their elevation."""
    slants = [echo.range / math.cos(echo.elevation) for echo in echoes]
    rows = [
        (rounded(slant), rounded(echo.azimuth), rounded(echo.elevation))
        for slant, echo in zip(slants, echoes, strict=True)
    ]
    returns = [RadarReturn(range=r, azimuth=a, elevation=e) for r, a, e in rows]
    return RadarScan(header=header, returns=returns), {
        "range": [r * math.cos(e) for r, _, e in rows],
        "azimuth": [a for _, a, _ in rows],
    }


def detection_array(header: Header, echoes: Sequence[Echo]) -> tuple[Detection3DArray, Numbers]:
    """Boxes; their coordinates are float64."""
    places = [_place(echo) for echo in echoes]
    boxes = [
        BoundingBox3D(center=Pose(position=Point(x=x, y=y, z=z)), size=Vector3(x=1.0, y=1.0, z=1.0))
        for x, y, z in places
    ]
    detections = [Detection3D(header=header, bbox=box) for box in boxes]
    return Detection3DArray(header=header, detections=detections), {
        "range": [math.hypot(x, y) for x, y, _ in places],
        "azimuth": [math.atan2(y, x) for x, y, _ in places],
    }


MAKERS: dict[str, Maker] = {
    "sensor_msgs/msg/PointCloud2": point_cloud,
    "sensor_msgs/msg/LaserScan": laser_scan,
    "marine_acoustic_msgs/msg/SonarDetections": sonar_detections,
    "marine_acoustic_msgs/msg/SonarRanges": sonar_ranges,
    "radar_msgs/msg/RadarScan": radar_scan,
    "vision_msgs/msg/Detection3DArray": detection_array,
}


def echoes_of(index: int, *, period: float = 12.0, clutter: int = 10) -> list[Echo]:
    """Echoes of ping number `index`: two targets that sail past, ahead, and clutter."""
    rng = np.random.default_rng(index)
    echoes = []
    for x, vx, y, vy in ((3000.0, 4.0, 1500.0, -2.0), (5000.0, -6.0, -1000.0, 1.0)):
        at, across = x + vx * period * index, y + vy * period * index
        error = rng.normal(0.0, (0.005, 0.005))
        range_, azimuth = math.hypot(at, across) * (1 + error[0]), math.atan2(across, at) + error[1]
        echoes.append(Echo(range_, azimuth, math.radians(-4.0)))
    drawn = rng.uniform((0.01, -1.3, -0.1), (1.0, 1.3, 0.1), (clutter, 3)).tolist()
    echoes += [Echo(9000.0 * math.sqrt(square), *angles) for square, *angles in drawn]
    return echoes
