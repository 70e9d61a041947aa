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
"""The example tracker beside the simulator and the initiator: it follows and feeds back."""

from __future__ import annotations

import ast
from pathlib import Path

import numpy as np
import pytest
from kalman_tracker import KalmanTracker
from sensor_msgs.msg import PointCloud2
from support.expectation import COVARIANCE, STATE
from support.ros_world import LATCHED, World
from support.sonar_driver import points, stamp_ns

from tsepm_ros.nodes.track_initiator import TrackInitiator
from tsepm_ros.tools.players.sonar_simulator import SonarSimulator

EXAMPLES = Path(__file__).parents[2] / "examples"
NUMBERS = (*STATE, *COVARIANCE)
SCANS, PERIOD = 24, 12.0
TARGETS = ((3000.0, 4.0, 1500.0, -2.0), (-2500.0, 0.0, 2500.0, 4.0), (500.0, -3.0, -4000.0, 3.0))
SCENARIO = f"""
scans: {SCANS}
period: {PERIOD}
sound_speed: 1500.0
sensor: {{detection_probability: 0.95, clutter_density: 1.0e-7}}
own_ship: {{x: 100.0, y: -50.0, yaw_deg: 40.0, speed: 3.0, turn_rate_deg: 0.2}}
targets: [{", ".join(f"{{state: {list(target)}}}" for target in TARGETS)}]
"""
NEAR = 250.0
"""Of a target: 3 sigma of the bearing error at the farthest, m. They are 4 km apart."""


class Play:
    """A simulated sea, the initiator, and the tracker; everything that they say."""

    def __init__(self, world: World, scenario: Path, **initiator: float) -> None:
        self.world = world
        scenario.write_text(SCENARIO)
        self.tracks = world.listen(PointCloud2, "tracks")
        self.current = world.listen(PointCloud2, "tracks/current", LATCHED)
        self.tracked = world.listen(PointCloud2, "tracked")
        given = {
            "method": "score",
            "own_ship_source": "odometry",
            "sensor.clutter_density": 1e-7,
            "sensor.detection_probability": 0.95,
            "own_ship_timeout": 20.0,  # of the wall's clock, which runs ahead on a busy machine
            "diagnostics_period": 0.05,
        }
        world.make(TrackInitiator, {**given, **initiator})
        self.start_tracker()
        world.until_connected()
        simulated = {
            "scenario": str(scenario),
            "seed": 3,
            "rate_factor": 50.0,  # a quarter of a second for the answer to each ping
            "own_ship_rate": 0.25,
            "settling_time": 0.1,
        }
        world.make(SonarSimulator, simulated)

    def start_tracker(self) -> None:
        self.tracker = self.world.make(KalmanTracker)

    def until(self, scan: int) -> Play:
        """Play until the initiator has processed a number of scans, and the tracker, if any."""
        self.world.until(lambda: len(self.current) >= scan, f"scan {scan}")
        return self

    def answered(self) -> Play:
        """Wait until the tracker has answered the newest scan."""
        newest = stamp_ns(self.current[-1])
        self.world.until(
            lambda: self.tracked and stamp_ns(self.tracked[-1]) >= newest, "the tracker's answer"
        )
        return self


def near(message: PointCloud2) -> list[list[int]]:
    """Ids of the tracks of a message near each target."""
    time = stamp_ns(message) * 1e-9
    states = np.array([[one[name] for name in STATE] for one in points(message)]).reshape(-1, 4)
    ids = np.array([one["track_id"] for one in points(message)], int)
    found = []
    for x, vx, y, vy in TARGETS:
        distance = np.hypot(states[:, 0] - x - vx * time, states[:, 2] - y - vy * time)
        found.append(ids[distance <= NEAR].tolist())
    return found


def ids(message: PointCloud2) -> set[int]:
    return {int(one["track_id"]) for one in points(message)}


@pytest.fixture
def scenario(tmp_path) -> Path:
    return tmp_path / "scene.yaml"


def test_targets_are_started_once_and_followed_to_the_end(world, scenario):
    play = Play(world, scenario).until(SCANS).answered()
    assert [stamp_ns(one) for one in play.tracked] == [stamp_ns(one) for one in play.tracks]
    started = [[one for message in play.tracks for one in near(message)[k]] for k in range(3)]
    assert [len(one) for one in started] == [1, 1, 1], "each target is started once"
    assert near(play.tracked[-1]) == started, "and followed under the id of its start"
    assert world.figures()["tracker"] == "alive"
    assert world.dropped() == {}
    for start, said in zip(play.tracks, play.tracked, strict=True):
        told = {one["track_id"]: one for one in points(said)}
        for one in points(start):  # goes back unchanged at its own ping, with its covariance
            assert [told[one["track_id"]][name] for name in NUMBERS] == [one[n] for n in NUMBERS]
    for said, held, new in zip(play.tracked[:-1], play.current[1:], play.tracks[1:], strict=True):
        assert ids(held) == ids(said) | ids(new), "the initiator holds what was said before"


def test_tracks_of_a_tracker_that_dies_are_held_until_it_is_started_again(world, scenario):
    play = Play(world, scenario, tracked_timeout=30.0).until(SCANS - 12).answered()
    followed = near(play.tracked[-1])
    assert [len(one) for one in followed] == [1, 1, 1]
    world.end(play.tracker)
    before = len(play.tracked)
    play.until(SCANS - 6)
    assert world.figures()["tracker"] == "silent"
    assert near(play.current[-1]) == followed
    play.start_tracker()
    play.until(SCANS).answered()
    assert len(play.tracked) > before
    assert all(near(one) == followed for one in play.tracked[before:])
    assert sum(len(one) for message in play.tracks for one in near(message)) == len(TARGETS)


def test_an_interrupt_ends_it_cleanly(start):
    process = start("kalman_tracker", script=EXAMPLES / "kalman_tracker.py")
    process.until_said("waiting for tracks/current")
    process.interrupt()
    assert process.exit_code() == 0
    assert "Traceback" not in process.said


@pytest.mark.parametrize("name", ["kalman_tracker", "nearest_neighbour"])
def test_the_example_imports_of_the_package_only_what_is_public(name):
    tree = ast.parse((EXAMPLES / f"{name}.py").read_text(encoding="utf-8"))
    named = [one.module or "" for one in ast.walk(tree) if isinstance(one, ast.ImportFrom)]
    ours = {one for one in named if one.partition(".")[0] in ("tsepm_ros", "msg_adapters")}
    assert ours and ours <= {"tsepm_ros", "msg_adapters"}
