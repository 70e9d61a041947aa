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
"""Scans registered by a session, on a boat that rolls, pitches and turns."""

import numpy as np

from support.sessions import NotedSession
from tsepm_ros import Scan
from tsepm_ros.own_ship.pose_history import PoseSample
from tsepm_ros.own_ship.registration import Mounting, UnregisteredScan
from tsepm_ros.session.session import Session
from tsepm_ros.settings.node_options import SessionOptions
from tsepm_ros.settings.settings import Settings


def session(mounting: Mounting | None = None, **options) -> NotedSession:
    options = {"own_ship_source": "odometry", "own_ship_max_gap": 60.0, **options}
    settings = Settings(SessionOptions(**options), mounting=mounting or Mounting())
    return NotedSession(settings)


def place(one: Session, scan: Scan, frame_id: str = "sonar", **more) -> Scan:
    """The scan as it is processed."""
    one.add_scan(UnregisteredScan(scan, frame_id, **more), 0.0)
    (result,) = one.process()
    return result.scan


def places(scan: Scan) -> np.ndarray:
    """Where the detections are in the fixed frame, (n, 2)."""
    pose = np.broadcast_to(scan.sensor_pose, (len(scan), 3))
    angle = scan.azimuth + pose[:, 2]
    return pose[:, :2] + scan.range[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def rolling(time):
    """Yaw, pitch and roll of a boat in a seaway, rad."""
    return (0.4 + 0.02 * time, 0.08 * np.sin(1.1 * time), 0.15 * np.sin(0.9 * time + 1.0))


def sail(one: Session, *, first: float = 0.0, last: float = 30.0, step: float = 0.05) -> None:
    """Poses of the boat, which does not leave (100, 200)."""
    for time in np.arange(first, last + step / 2, step).tolist():
        yaw, pitch, roll = rolling(time)
        one.add_own_ship(
            PoseSample(time, 100.0, 200.0, yaw, roll=roll, pitch=pitch, frame_id="odom")
        )
