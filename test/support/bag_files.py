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
"""Bags for tests: simulated messages, written with the library rosbags and without ROS."""

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from tsepm_ros import Scan
from tsepm_ros.tools.simulation import Simulator
from tsepm_ros.tools.simulation.scenario import Scenario, scenario_from

pytest.importorskip("rosbags", reason="bags need the library rosbags")

from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

STORE = get_typestore(Stores.ROS2_JAZZY)
POINTS, ODOMETRY = "sensor_msgs/msg/PointCloud2", "nav_msgs/msg/Odometry"
STORAGES = ("sqlite3", "mcap")
LATENCY = 0.4
"""From a stamp of the own ship until the message is recorded, s."""

SCENE: dict[str, Any] = {
    "scans": 10,
    "period": 4.0,
    "sound_speed": 1500.0,
    "sensor": {
        "range_std": 5.0,
        "range_std_fraction": 0.0,
        "azimuth_std": 0.005,
        "max_range": 3000.0,
        "detection_probability": 0.95,
        "clutter_density": 1.0e-6,
    },
    "own_ship": {"x": 100.0, "y": -50.0, "yaw_deg": 40.0, "speed": 5.0, "turn_rate_deg": 2.0},
    "targets": [{"state": [1500.0, 4.0, 700.0, -3.0]}, {"state": [-900.0, 0.0, 1200.0, 5.0]}],
}
PARAMETERS = ("sensor.range_std:=5.0", "sensor.range_std_fraction:=0.0", "max_speed:=10.0")
PARAMETERS += ("sensor.azimuth_std:=0.005", "sensor.max_range:=3000.0")


class Entry(NamedTuple):
    """A message and when it was recorded, s; bytes are written as they are."""

    time: float
    topic: str
    type_name: str
    message: Any


def small_scenario(**changes: Any) -> Scenario:
    return scenario_from({**SCENE, **changes}, "small")


def header(stamp: float, frame_id: str) -> Any:
    whole, fraction = divmod(round(stamp * 1e9), 10**9)
    time = STORE.types["builtin_interfaces/msg/Time"](sec=whole, nanosec=fraction)
    return STORE.types["std_msgs/msg/Header"](stamp=time, frame_id=frame_id)


def cloud(stamp: float, frame_id: str, **fields: Any) -> Any:
    """A cloud of float64 fields."""
    columns = np.stack([np.asarray(values, "<f8") for values in fields.values()], axis=1)
    point_field = STORE.types["sensor_msgs/msg/PointField"]
    return STORE.types[POINTS](
        header=header(stamp, frame_id),
        height=1,
        width=len(columns),
        fields=[
            point_field(name=name, offset=8 * index, datatype=8, count=1)
            for index, name in enumerate(fields)
        ],
        is_bigendian=False,
        point_step=8 * len(fields),
        row_step=columns.nbytes,
        data=np.frombuffer(columns.tobytes(), np.uint8),
        is_dense=True,
    )


def geometry(name: str, **values: Any) -> Any:
    return STORE.types[f"geometry_msgs/msg/{name}"](**values)


def pose(x: float, y: float, yaw: float) -> Any:
    turned = geometry("Quaternion", x=0.0, y=0.0, z=math.sin(yaw / 2), w=math.cos(yaw / 2))
    return geometry("Pose", position=geometry("Point", x=x, y=y, z=0.0), orientation=turned)


def odometry(stamp: float, x: float, y: float, yaw: float) -> Any:
    zero = geometry("Vector3", x=0.0, y=0.0, z=0.0)
    twist = geometry("Twist", linear=zero, angular=zero)
    return STORE.types[ODOMETRY](
        header=header(stamp, "odom"),
        child_frame_id="sonar",
        pose=geometry("PoseWithCovariance", pose=pose(x, y, yaw), covariance=np.zeros(36)),
        twist=geometry("TwistWithCovariance", twist=twist, covariance=np.zeros(36)),
    )


def detections(scan: Scan) -> Any:
    """The cloud of a simulated scan."""
    names = ("range", "azimuth", "time_offset")
    return cloud(scan.stamp, "sonar", **{name: getattr(scan, name) for name in names})


def simulated(
    scenario: Scenario | None = None, seed: int = 5, start: float = 1000.0, namespace: str = ""
) -> list[Entry]:
    """What a recorder hears of a sonar and its own ship; scans come before the last poses."""
    scenario = scenario or small_scenario()
    entries, last = [], start
    for one in Simulator(scenario, seed, start):
        message = detections(one.scan)
        entries.append(Entry(one.complete, f"{namespace}/detections", POINTS, message))
        last = one.complete
    for index in range(math.ceil(last - start) + 1):
        stamp, topic = start + index, f"{namespace}/own_ship/odometry"
        message = odometry(stamp, *scenario.own_ship.pose(float(index)).tolist())
        entries.append(Entry(stamp + LATENCY, topic, ODOMETRY, message))
    return sorted(entries, key=lambda entry: entry.time)


def of_definition(store: Any, value: Any, name: str) -> Any:
    """A message of ROS, or of a stand-in, as one of the types that rosbags makes of definitions."""
    made = {}
    for field, (kind, described) in store.fielddefs[name][1]:
        given = getattr(value, field)
        if kind.name == "NAME":
            made[field] = of_definition(store, given, described)
        elif kind.name == "BASE":
            made[field] = given
        elif described[0][0].name == "NAME":
            made[field] = [of_definition(store, one, described[0][1]) for one in given]
        else:
            made[field] = np.asarray(given, described[0][1][0])
    return store.types[name](**made)


def serialized(entry: Entry) -> bytes:
    if isinstance(entry.message, bytes):
        return entry.message
    return bytes(STORE.serialize_cdr(entry.message, entry.type_name))


def write_bag(path: Path, entries: Iterable[Entry], storage: str = "mcap", store=STORE) -> Path:
    """Write a bag; returns its folder."""
    plugin = StoragePlugin[storage.upper()]
    with Writer(path, version=9, storage_plugin=plugin) as writer:
        topics: dict[str, Any] = {}
        for entry in entries:
            if entry.topic not in topics:
                topics[entry.topic] = writer.add_connection(
                    entry.topic, entry.type_name, typestore=store
                )
            writer.write(topics[entry.topic], round(entry.time * 1e9), serialized(entry))
    return path


def storage_file(folder: Path) -> Path:
    """The file with the messages of a bag."""
    [path] = [path for path in folder.iterdir() if path.suffix in (".mcap", ".db3")]
    return path


GRID = "nav_msgs/msg/OccupancyGrid"


def grid(stamp: float, frame_id: str, occupied: np.ndarray, resolution: float, x: float, y: float):
    """A chart, (rows, columns) of bool."""
    head = header(stamp, frame_id)
    height, width = occupied.shape
    return STORE.types[GRID](
        header=head,
        info=STORE.types["nav_msgs/msg/MapMetaData"](
            map_load_time=head.stamp,
            resolution=resolution,
            width=width,
            height=height,
            origin=pose(x, y, 0.0),
        ),
        data=np.where(occupied, 100, -1).astype(np.int8).ravel(),
    )
