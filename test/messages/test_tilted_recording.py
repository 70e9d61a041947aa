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
"""A recording of a vessel that rolls and pitches gives what its messages give."""

import math

import numpy as np
import pytest
from nav_msgs.msg import Odometry
from scipy.spatial.transform import Rotation

from msg_adapters import detections_cloud, make_header
from msg_adapters.message_input import MessageInput
from tsepm_ros.session.session import Session
from tsepm_ros.settings.node_options import InitiatorNodeOptions
from tsepm_ros.settings.settings import TRACK_INITIATOR, make_groups, settings_from
from tsepm_ros.tools.replay.offline import process_recording
from tsepm_ros.tools.replay.recording import read_recording
from tsepm_ros.tracker.scan import Scan

SCANS, DETECTIONS = 3, 40
UNITS = {"range": "m", "azimuth": "rad", "elevation": "rad", "range_rate": "mps"}
UNITS["two_way_travel_time"] = "s"
VALUES = {"own_ship_source": "odometry", "sensor.range_rate_std": 0.1}


def at_sea(time: float) -> tuple[float, float, float]:
    """Heading (clockwise from north), roll (port up) and pitch (bow down), rad."""
    return 0.3 + 0.02 * time, 0.3 * math.sin(0.9 * time), 0.15 * math.sin(1.1 * time + 1.0)


@pytest.fixture
def columns() -> dict[str, np.ndarray]:
    """Detections of all scans, by the names of fields."""
    rng = np.random.default_rng(11)
    number = SCANS * DETECTIONS
    slant = rng.uniform(200.0, 3000.0, number)
    return {
        "range": slant,
        "azimuth": rng.uniform(-3.0, 3.0, number),
        "elevation": rng.uniform(-0.6, 0.2, number),
        "two_way_travel_time": 2.0 * slant / 1500.0,
        "range_rate": rng.normal(0.0, 3.0, number),
    }


def recorded(folder, columns, times, *, without: tuple[str, ...] = ()) -> list[Scan]:
    """What a folder of CSV files with these detections gives, without some of the columns."""
    stamps = np.repeat(12.0 * np.arange(SCANS), DETECTIONS)
    found = {f"{name}_{UNITS[name]}": values for name, values in columns.items()}
    write(folder / "detections.csv", {"time_s": stamps, **found}, without)
    heading, roll, pitch = np.array([at_sea(time) for time in times]).T
    ship = {"time_s": times, "east_m": 3.0 * times, "north_m": 2.0 * times}
    ship |= {"heading_rad": heading, "roll_rad": roll, "pitch_rad": pitch}
    write(folder / "own_ship.csv", ship, without)
    settings = settings_from(make_groups(TRACK_INITIATOR, VALUES))
    results, dropped = process_recording(read_recording(folder), settings, "bow")
    assert dropped == {}
    return [result.scan for result in results]


def write(path, columns, without) -> None:
    columns = {name: values for name, values in columns.items() if name not in without}
    rows = zip(*(map(repr, values.tolist()) for values in columns.values()), strict=True)
    path.write_text("\n".join(",".join(row) for row in (columns, *rows)) + "\n")


def odometry(time: float) -> Odometry:
    heading, roll, pitch = at_sea(time)
    message = Odometry(header=make_header(round(time * 1e9), "odom"), child_frame_id="sonar")
    pose = message.pose.pose
    pose.position.x, pose.position.y = 3.0 * time, 2.0 * time
    attitude = Rotation.from_euler("ZYX", [math.pi / 2 - heading, pitch, roll])
    for name, value in zip("xyzw", attitude.as_quat().tolist(), strict=True):
        setattr(pose.orientation, name, value)
    return message


def from_messages(columns, times) -> list[Scan]:
    made = make_groups(TRACK_INITIATOR, VALUES)
    session = Session(settings_from(made))
    given = MessageInput(session, made[InitiatorNodeOptions])
    for time in times.tolist():
        given.take_own_ship(odometry(time))
    for index in range(SCANS):
        rows = slice(index * DETECTIONS, (index + 1) * DETECTIONS)
        fields = {name: values[rows] for name, values in columns.items()}
        header = make_header(12 * index * 10**9, "sonar")
        given.take_detections(detections_cloud(header, **fields), 0.0)
    assert session.dropped == {}
    return [result.scan for result in session.process()]


def test_a_recording_with_elevation_roll_and_pitch_gives_what_the_messages_give(tmp_path, columns):
    times = np.arange(-1.0, 40.0, 0.25)
    offline, live = recorded(tmp_path, columns, times), from_messages(columns, times)
    assert len(offline) == len(live) == SCANS
    for one, other in zip(offline, live, strict=True):
        assert len(one) == DETECTIONS
        for name in ("range", "azimuth", "time_offset", "sensor_pose"):
            values = getattr(one, name), getattr(other, name)
            np.testing.assert_allclose(*values, rtol=1e-11, atol=1e-11, err_msg=name)
        rates = one.features["range_rate"], other.features["range_rate"]
        np.testing.assert_allclose(*rates, rtol=1e-9)
        assert 0 < np.isfinite(rates[0]).sum() < DETECTIONS, "some are too steep"
