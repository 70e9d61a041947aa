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
"""Every parameter of every node has a use: something reads its value while the node works."""

from __future__ import annotations

import itertools
import math
import sys
from dataclasses import dataclass
from types import FrameType

import numpy as np
import pytest
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Image, PointCloud2
from support.bag_files import simulated, write_bag
from support.boat import Boat
from support.foreign_messages import SonarEcho
from support.ros_world import BEST_EFFORT, LATCHED
from support.sessions import NotedSession, arrived
from support.sessions import simulated as scans_of_the_box
from support.show import Show, write_scenario
from support.sonar_driver import START_NS, pings

from msg_adapters import make_header, odometry_message, track_cloud
from msg_adapters.image_messages import read_image
from tsepm_ros.methods.registry import METHODS
from tsepm_ros.nodes.sonar_detector import SonarDetector
from tsepm_ros.own_ship.pose_history import PoseSample
from tsepm_ros.parameters import ParameterGroup, parameter, parameter_table
from tsepm_ros.settings.node_options import ImageLayout
from tsepm_ros.settings.settings import NODES, make_groups, settings_from, settings_with_method
from tsepm_ros.tools.players.scan_player import ScanPlayer
from tsepm_ros.tools.players.sonar_simulator import SonarSimulator
from tsepm_ros.tracker.sensor import Coverage
from tsepm_ros.tracker.tracks import ConfirmedTrack

NO_USE = ("__post_init__", "_check_combination", "check", "asdict", "_asdict_inner", "replace")
"""Functions that read values only to check or to copy them."""
DEPTH = 4
"""Frames of a read that are looked at: a property of the group may be between."""


class Reads(set):
    """Names of the parameters of a node whose values are read for a use."""

    def __init__(self, monkeypatch, node, method="score"):
        self.groups = settings_with_method(NODES[node], method)
        for prefix, kind in self.groups:
            monkeypatch.setattr(kind, "__getattribute__", self._noting(prefix, kind))

    def _noting(self, prefix, kind):
        names = {row.name for row in parameter_table(kind)}

        def read(options, name):
            if name in names and type(options) is kind and is_use(sys._getframe(1)):
                self.add(prefix + name)
            return object.__getattribute__(options, name)

        return read

    def unread(self, *but):
        """Names without a use, but those that begin as given."""
        rows = [prefix + row.name for prefix, kind in self.groups for row in parameter_table(kind)]
        return [name for name in rows if name not in self and not name.startswith(but)]


def is_use(frame: FrameType | None) -> bool:
    for _ in range(DEPTH):
        if frame is None:
            break
        code = frame.f_code
        if code.co_name in NO_USE or code.co_filename == "<string>":  # what dataclasses make
            return False
        frame = frame.f_back
    return True


ALSO_WITH = {"tsepm": [{"tsepm.evaluation": "clutter_statistic"}]}
"""Values with which a method uses other options than with the defaults."""


@pytest.mark.parametrize("method", METHODS)
def test_a_method_uses_each_of_its_options(monkeypatch, method):
    reads = Reads(monkeypatch, "track_initiator", method)
    for given in ({}, *ALSO_WITH.get(method, [])):
        values = {"method": method, **given}
        session = NotedSession(settings_from(make_groups(reads.groups, values)))
        for scan in scans_of_the_box():
            session.add_scan(arrived(scan), 0.0)
            list(session.process(math.inf))
    assert [name for name in reads.unread() if name.startswith(f"{method}.")] == []


def test_the_track_initiator_uses_each_of_its_parameters(world, monkeypatch, tmp_path):
    reads = Reads(monkeypatch, "track_initiator")
    given = {"own_ship_source": "odometry", "target_extent": 3.0}
    given |= {"sensor.range_rate_std": 0.3, "learned_file": str(tmp_path / "learned")}
    boat = Boat(world, publish_potential_tracks=True, **{"method": "score", **given})
    for k in range(-2, 16):
        boat.driver.pose(START_NS + k * 12 * 10**9, 2.0 * k, 0.0, 0.3)
    fields = ("range_rate", "intensity", "range_width", "azimuth_width")
    boat.send(pings(12), **dict.fromkeys(fields, [1.0] * 11))
    # The methods' own are the subject of the test before; of one sensor no scan waits for another.
    assert reads.unread("max_wait", *(f"{name}." for name in METHODS)) == []


def test_the_detector_uses_each_of_its_parameters(world, monkeypatch):
    reads = Reads(monkeypatch, "sonar_detector")
    heard = world.listen(PointCloud2, "detections")
    publisher = world.observer.create_publisher(Image, "image", BEST_EFFORT)
    boat = world.observer.create_publisher(Odometry, "own_ship/odometry", 10)
    node = world.make(SonarDetector, {"sensor.max_range": 40.0, "own_ship_source": "odometry"})
    world.until_logged("subscribed to /image")
    world.until_connected()
    pose = odometry_message(PoseSample(START_NS * 1e-9, 0.0, 0.0, 0.0))
    world.until(lambda: len(node._input.own_ship.poses), "a pose", lambda: boat.publish(pose))
    picture = np.random.default_rng(1).integers(0, 250, (40, 40)).astype(np.uint8)
    shape = {"height": 40, "width": 40, "step": 40, "encoding": "mono8"}
    message = Image(header=make_header(START_NS, "sonar"), data=picture.tobytes(), **shape)
    world.until(lambda: heard, "detections", lambda: publisher.publish(message))
    assert reads.unread() == ["image.clockwise"]
    echo = SonarEcho(range=10, intensities=[1, 2, 3])
    assert read_image(echo, ImageLayout(), Coverage()).is_part
    assert reads.unread() == []


def test_simulator_and_player_use_each_of_their_parameters(world, monkeypatch, tmp_path, recording):
    reads = Reads(monkeypatch, "sonar_simulator")
    Show(world, SonarSimulator, scenario=write_scenario(tmp_path)).play()
    assert reads.unread() == []
    reads = Reads(monkeypatch, "scan_player")
    for given in (recording, write_bag(tmp_path / "bag", simulated(), "mcap")):
        fast = {"rate_factor": 1e5, "settling_time": 0.0}  # `Show` has subscribed
        player = world.make(ScanPlayer, {"recording": str(given), **fast})
        world.until(player.finished.done, "the end")
        world.end(player)
    assert reads.unread() == []


def test_viewer_and_bridge_use_each_of_their_parameters(world, monkeypatch):
    track_viewer = pytest.importorskip("tsepm_ros.tools.viewer.track_viewer")
    track_bridge = pytest.importorskip("tsepm_ros.tools.bridge.track_bridge")
    reads = Reads(monkeypatch, "track_viewer")
    world.make(track_viewer.TrackViewer, {"port": 0})
    assert reads.unread() == []
    reads = Reads(monkeypatch, "track_bridge")
    tracks = world.observer.create_publisher(PointCloud2, "tracks/current", LATCHED)
    odometry = world.observer.create_publisher(Odometry, "own_ship/odometry", BEST_EFFORT)
    world.make(track_bridge.TrackBridge, {"nmea_address": "127.0.0.1:9"})
    world.until_connected()
    track = ConfirmedTrack(3, 1e9, np.array([50.0, 1.0, 60.0, 1.0]), np.eye(4), (), 0.0)

    stamps = itertools.count(10**9)

    def send():
        stamp = float(next(stamps))
        sample = PoseSample(stamp, 0.0, 0.0, 0.3, rates=(1.0, 0.0, 0.0), frame_id="odom")
        odometry.publish(odometry_message(sample))
        tracks.publish(track_cloud(make_header(round(stamp * 1e9), "odom"), [track]))

    world.until(lambda: not reads.unread(), "every parameter to be read", send)


@dataclass(frozen=True, kw_only=True)
class Idle(ParameterGroup):
    """Two parameters: one is copied and compared only, the other is used."""

    idle: float = parameter(1.0, "Of no use")
    used: float = parameter(1.0, "Used")


def test_what_is_only_checked_and_copied_is_found(monkeypatch):
    monkeypatch.setitem(NODES, "track_viewer", (("one.", Idle),))
    reads = Reads(monkeypatch, "track_viewer")
    options = make_groups(NODES["track_viewer"], {"one.idle": 2.0})[Idle]
    assert options != Idle() and options.used == 1.0
    assert reads.unread() == ["one.idle"]
