"""Bags through the nodes: played as recorded, and the same tracks as offline, bit for bit."""

import numpy as np
import pytest
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2
from support import foreign_messages
from support.bag_files import (
    GRID,
    ODOMETRY,
    PARAMETERS,
    POINTS,
    STORAGES,
    STORE,
    Entry,
    grid,
    serialized,
    simulated,
    write_bag,
)
from support.boat import named
from support.live_and_offline import FAST, assert_same_live_and_offline, listen_raw
from support.ros_world import World

from tsepm_ros.nodes.base_node import ParameterError
from tsepm_ros.nodes.track_initiator import TrackInitiator
from tsepm_ros.settings.parameter_files import parse_values
from tsepm_ros.tools.players.scan_player import ScanPlayer

BOTH = pytest.mark.parametrize("storage", STORAGES)


def play(world: World, path, subscribers: int = 1, **parameters) -> ScanPlayer:
    """Play a bag to its end."""
    given = {**FAST, "wait_for_subscribers": subscribers + 1, "recording": str(path)}
    player = world.make(ScanPlayer, {**given, **parameters})
    world.until_connected()
    world.listen(PointCloud2, "detections")  # the last subscriber
    world.until(player.finished.done, "the end")
    return player


def recorded(entries, kind: str, name: str = "") -> list[bytes]:
    return [
        serialized(entry)
        for entry in entries
        if entry.type_name == kind and entry.topic.endswith(name)
    ]


@BOTH
def test_messages_are_played_byte_for_byte_under_the_nodes_names(world, tmp_path, storage):
    entries = simulated(namespace="/boat/sonar")
    detections = listen_raw(world, PointCloud2, "detections")
    own_ship = listen_raw(world, Odometry, "own_ship/odometry")
    play(world, write_bag(tmp_path / "bag", entries, storage))
    world.until(lambda: len(own_ship) == len(recorded(entries, ODOMETRY)), "the own ship")
    world.until(lambda: len(detections) == 10, "the detections")
    assert detections == recorded(entries, POINTS)
    assert own_ship == recorded(entries, ODOMETRY)


@pytest.mark.parametrize(("storage", "method"), [*zip(STORAGES, ("score", "tsepm"), strict=True)])
def test_a_bag_gives_the_same_tracks_through_the_node_and_offline(world, tmp_path, storage, method):
    path = write_bag(tmp_path / "bag", simulated(), storage)
    offline = assert_same_live_and_offline(world, path, tmp_path, *PARAMETERS, f"method:={method}")
    widths = [STORE.deserialize_cdr(data, POINTS).width for data in offline["/tracks"]]
    assert len(widths) == 10
    assert sum(widths) >= 2
    assert world.dropped() == {}


def test_a_bag_is_played_in_a_loop_without_its_corrupt_messages_from_topics_that_are_named(
    world, tmp_path
):
    entries = simulated(namespace="/a") + simulated(seed=9, namespace="/b")
    entries.append(Entry(entries[-1].time + 0.1, "/b/detections", POINTS, b"\x00\x01\x00"))
    entries.sort(key=lambda entry: entry.time)
    heard = listen_raw(world, PointCloud2, "detections")
    path = write_bag(tmp_path / "bag", entries)
    given = {"detections_topic": "/b/detections", "odometry_topic": "/a/own_ship/odometry"}
    world.make(ScanPlayer, {**FAST, **given, "recording": str(path), "loop": True})
    world.until(lambda: len(heard) >= 20, "a second time")
    assert heard[:10] == heard[10:20] == recorded(entries, POINTS, "/b/detections")[:10]
    world.until_logged("left out (1 so far)", "/b/detections")


def test_a_start_offset_leaves_out_what_came_before(world, tmp_path):
    entries = simulated()
    path = write_bag(tmp_path / "bag", entries)
    detections = listen_raw(world, PointCloud2, "detections")
    clock = world.listen(Clock, "/clock")
    play(world, path, start_offset=15.0, publish_clock=True)
    begin = entries[0].time + 15.0
    expected = recorded([entry for entry in entries if entry.time >= begin], POINTS)
    world.until(lambda: len(detections) == len(expected), "the detections")
    assert detections == expected
    assert 0 < len(expected) < 10
    world.until(lambda: clock, "the clock")
    times = np.array([message.clock.sec + 1e-9 * message.clock.nanosec for message in clock])
    assert times.min() >= begin - 1e-6
    assert (np.diff(times) >= 0).all()


IMPOSSIBLE = [
    ({"detections_topic": "/other"}, "recording: the bag has no topic /other"),
    ({"start_offset": 1e6}, r"start_offset: 1e\+06 s is beyond the end of the bag of"),
    ({"start_stamp": 10.0}, "start_stamp: the messages of a bag are published with"),
    ({"recording": "bag.mcap"}, r"recording: .*is no bag, whatever its name says"),
]


def test_what_a_bag_cannot_do_is_refused_with_a_sentence(world, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_bag(tmp_path / "bag", simulated())
    (tmp_path / "bag.mcap").write_bytes(b"no bag")
    for parameters, sentence in IMPOSSIBLE:
        with pytest.raises(ParameterError, match=sentence):
            world.make(ScanPlayer, {**FAST, "recording": "bag", **parameters})


def test_a_type_whose_package_is_not_here_is_refused_with_its_topic(world, tmp_path, monkeypatch):
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    foreign_messages.remove(monkeypatch)
    store, name = get_typestore(Stores.ROS2_JAZZY), "radar_msgs/msg/RadarScan"
    store.register(get_types_from_msg("std_msgs/Header header\n", name))
    path = write_bag(tmp_path / "bag", [Entry(1.0, "/radar", name, b"")], store=store)
    with pytest.raises(ParameterError, match=f"/radar is of type {name}, whose package is not"):
        world.make(ScanPlayer, {**FAST, "recording": str(path)})


def test_a_chart_is_played_latched_and_from_the_start(world, tmp_path):
    occupied = np.ones((100, 100), bool)
    message = grid(999.0, "odom", occupied, 100.0, -5000.0, -5000.0)
    entries = [Entry(999.0, "/land", GRID, message), *simulated()]
    path = write_bag(tmp_path / "bag", entries)
    values = {**parse_values(PARAMETERS), "method": "score", "own_ship_source": "odometry"}
    world.make(TrackInitiator, named(values))
    tracks = world.listen(PointCloud2, "tracks")
    play(world, path, start_offset=5.0)
    world.until(lambda: len(tracks) >= 8, "the scans")
    assert sum(one.width for one in tracks) == 0
    figures = world.figures()  # of one moment: further scans may still be on their way
    assert int(figures["dropped.on_land"]) == int(figures["on_land"]) > 0
