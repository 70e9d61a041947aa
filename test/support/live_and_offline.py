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
"""A bag through the nodes and offline."""

from pathlib import Path

from sensor_msgs.msg import PointCloud2

from support.bag_files import POINTS, STORE
from support.boat import named
from support.ros_world import RELIABLE, World
from tsepm_ros.nodes.track_initiator import TrackInitiator
from tsepm_ros.settings.parameter_files import parse_parameter_file_values
from tsepm_ros.tools.commands.cli import main
from tsepm_ros.tools.players.scan_player import ScanPlayer
from tsepm_ros.tools.replay.bag import Bag

FAST = {"rate_factor": 1e5, "settling_time": 0.0}
TOPICS = ("/tracks", "/tracks/current", "/fixed_echoes")


def listen_raw(world: World, kind: type, topic: str) -> list[bytes]:
    """The serialised messages of a topic, as they arrive."""
    heard: list[bytes] = []
    world.observer.create_subscription(kind, topic, heard.append, RELIABLE, raw=True)
    return heard


def canonical(data: bytes) -> bytes:
    """The same message with zeros between its fields, where the middleware leaves anything."""
    return bytes(STORE.serialize_cdr(STORE.deserialize_cdr(data, POINTS), POINTS))


def assert_same_live_and_offline(
    world: World, path: Path, folder: Path, *given: str
) -> dict[str, list[bytes]]:
    """Check that both give the same messages, bit for bit; returns them by topic."""
    arguments = [part for one in given for part in ("-p", one)]
    assert main(["run", str(path), "--out", str(folder / "out"), *arguments]) == 0
    with Bag(folder / "out" / "tracks.mcap") as bag:
        offline = {topic: [one.data for one in bag.messages([topic])] for topic in TOPICS}
    live = {topic: listen_raw(world, PointCloud2, topic) for topic in TOPICS}
    own_ship = {"own_ship_source": "odometry"} if count_poses(path) else {}
    values = {
        "method": "score",
        "max_scan_time": 3600.0,
        **own_ship,
        **parse_parameter_file_values(given),
    }
    world.make(TrackInitiator, named(values))
    player = world.make(ScanPlayer, {"recording": str(path), "wait_for_subscribers": 2, **FAST})
    world.until(lambda: world.observer.count_subscribers("/detections") == 1, "the initiator")
    world.until_connected()
    world.listen(PointCloud2, "detections")  # the second subscriber
    world.until(player.finished.done, "the end")
    for topic, messages in offline.items():
        heard = live[topic]
        world.until(lambda one=heard, all_=messages: len(one) == len(all_), f"all of {topic}")
        assert [canonical(data) for data in heard] == messages
    return offline


def count_poses(path: Path) -> int:
    """Messages of the own ship in a bag."""
    with Bag(path) as bag:
        topic = "/own_ship/odometry"
        return bag.count(topic) if topic in bag.topics else 0
