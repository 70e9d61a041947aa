"""One bag again and again: offline, and live through player and initiator, for all methods.

Every track message is compared to the bit with those of the first time.
"""

import functools
import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

import campaign
import numpy as np
from campaign import Tried
from invariants import require
from sensor_msgs.msg import PointCloud2
from support.bag_files import PARAMETERS, POINTS, STORAGES, STORE, simulated, write_bag
from support.ros_domains import own_domain
from support.ros_world import RELIABLE, World

from tsepm_ros import available_methods
from tsepm_ros.nodes.track_initiator import TrackInitiator
from tsepm_ros.settings.parameter_files import parse_values
from tsepm_ros.tools.commands.cli import main
from tsepm_ros.tools.players.scan_player import ScanPlayer
from tsepm_ros.tools.replay.bag import Bag

METHODS = available_methods()
TOPICS = ("/tracks", "/tracks/current", "/fixed_echoes")
WAIT = 60.0


@functools.cache
def bags() -> Path:
    """The folder of the two bags."""
    folder = Path(tempfile.mkdtemp(prefix="tsepm_replays_"))
    for storage in STORAGES:
        write_bag(folder / storage, simulated(), storage)
    return folder


def offline(storage: str, method: str) -> dict[str, list[bytes]]:
    """Messages of a run without ROS."""
    arguments = [part for one in (*PARAMETERS, f"method:={method}") for part in ("-p", one)]
    with tempfile.TemporaryDirectory(prefix="tsepm_replay_") as name:
        out = Path(name) / "out"
        code = main(["run", str(bags() / storage), "--out", str(out), *arguments])
        require(code == 0, f"tsepm run ends with {code}")
        with Bag(out / "tracks.mcap") as bag:
            return {
                topic: [canonical(message.data) for message in bag.messages([topic])]
                for topic in TOPICS
            }


def live(storage: str, method: str) -> dict[str, list[bytes]]:
    """Messages of the nodes."""
    with own_domain() as domain, World(domain, WAIT) as world:
        heard: dict[str, list[bytes]] = {topic: [] for topic in TOPICS}
        for topic, messages in heard.items():
            world.observer.create_subscription(
                PointCloud2, topic, messages.append, RELIABLE, raw=True
            )
        values: dict[str, Any] = {**parse_values(PARAMETERS), "method": method}
        more = {"own_ship_source": "odometry", "max_scan_time": 3600.0}
        world.make(TrackInitiator, {**values, **more})
        played = {"recording": str(bags() / storage), "rate_factor": 1e5, "settling_time": 0.0}
        player = world.make(ScanPlayer, {**played, "wait_for_subscribers": 2})
        world.until(lambda: world.observer.count_subscribers("/detections") == 1, "the initiator")
        world.until_connected()
        world.listen(PointCloud2, "detections")  # the second subscriber: the player begins
        world.until(player.finished.done, "the end")
        world.until(lambda: {*map(len, heard.values())} == {10}, "an answer to every scan")
        require(not world.dropped(), f"drops: {world.dropped()}")
        return {topic: [canonical(data) for data in messages] for topic, messages in heard.items()}


def canonical(data: bytes) -> bytes:
    """The same message with zeros between its fields, where the middleware leaves anything."""
    return bytes(STORE.serialize_cdr(STORE.deserialize_cdr(data, POINTS), POINTS))


@functools.cache
def first(method: str) -> dict[str, list[bytes]]:
    """What every later run must equal."""
    return offline(STORAGES[0], method)


def case(number: int, rng: np.random.Generator) -> Tried:
    """A replay."""
    method = METHODS[number % len(METHODS)]
    storage = STORAGES[number // len(METHODS) % len(STORAGES)]
    is_live = number % 4 == 3
    found = live(storage, method) if is_live else offline(storage, method)
    require(found == first(method), f"{method}, {storage}, live {is_live}: not as the first time")
    clouds = [STORE.deserialize_cdr(data, POINTS) for data in found["/tracks"]]
    tracks = sum(cloud.width for cloud in clouds)
    how = "live" if is_live else "offline"
    return Counter({f"replays {how}": 1, f"tracks of {method}": tracks, "replays": 1})


if __name__ == "__main__":
    sys.exit(campaign.main("replays", __doc__, case))
