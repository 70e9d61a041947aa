"""Sweeps in parts through the node: the same tracks as of whole turns, and as offline."""

from itertools import pairwise

import pytest
from rclpy.node import Node
from sensor_msgs.msg import LaserScan, PointCloud2
from std_srvs.srv import Trigger
from support.bag_files import PARAMETERS, POINTS, STORE, Entry, cloud, small_scenario, write_bag
from support.boat import named
from support.ros_world import RELIABLE, World
from support.sonar_driver import points, stamp_ns
from support.sweeps import BEAMS, RADAR, TURN, in_parts, played, settings, turns, whole

from tsepm_ros.nodes.track_initiator import TrackInitiator
from tsepm_ros.session.session import Session
from tsepm_ros.settings.parameter_files import parse_values
from tsepm_ros.tools.commands.cli import main
from tsepm_ros.tools.players.scan_player import ScanPlayer
from tsepm_ros.tools.players.sonar_simulator import SonarSimulator
from tsepm_ros.tools.replay.bag import Bag
from tsepm_ros.tools.simulation import Simulator

SENSOR = {
    "sensor.range_std": RADAR.range_std,
    "sensor.range_std_fraction": 0.0,
    "sensor.azimuth_std": RADAR.azimuth_std,
    "sensor.max_range": RADAR.max_range,
    "method": "score",
}


def message(one) -> LaserScan:
    """A real message of a stand-in."""
    made = LaserScan(
        angle_min=one.angle_min,
        angle_max=one.angle_max,
        angle_increment=one.angle_increment,
        time_increment=one.time_increment,
        range_min=one.range_min,
        range_max=one.range_max,
        ranges=one.ranges,
    )
    made.header.frame_id = one.header.frame_id
    made.header.stamp.sec = one.header.stamp.sec
    made.header.stamp.nanosec = one.header.stamp.nanosec
    return made


class Radar:
    """A node under test beside a radar that publishes parts of turns."""

    def __init__(self, world: World, **parameters) -> None:
        self.world = world
        driver = world.add(Node("radar", context=world.context))
        self.publisher = driver.create_publisher(LaserScan, "detections", RELIABLE)
        world.make(TrackInitiator, named({**SENSOR, **parameters}))
        self.tracks = world.listen(PointCloud2, "tracks")
        world.until(self.publisher.get_subscription_count, "the node to subscribe")
        self.heard = world.listen(LaserScan, "detections")
        world.until_connected()

    def send(self, messages, number: int) -> list[PointCloud2]:
        seen = len(self.tracks)
        for one in messages:
            heard = len(self.heard)
            self.publisher.publish(message(one))
            # One by one: the queues are shorter than a turn, and on a busy machine messages that
            # wait for seconds are skipped.
            self.world.until(lambda heard=heard: len(self.heard) > heard, "the message")
        self.world.until(lambda: len(self.tracks) >= seen + number, f"{number} scans")
        return self.tracks[seen:]


@pytest.mark.parametrize(("sweep", "size"), [(TURN, 1), (f"{TURN}", 6)])
def test_a_turn_in_parts_gives_the_tracks_of_the_turn_in_one_message(world, sweep, size):
    ranges = turns(5)
    expected = played(Session(settings("off")), whole(ranges))[:4]
    received = Radar(world, sweep=sweep).send(in_parts(ranges, size), 4)[:4]
    assert [stamp_ns(one) for one in received] == [one.stamp_ns for one in expected]
    assert sum(len(one.new) for one in expected) == 2
    for one, other in zip(received, expected, strict=True):
        states = [[p[f"state_{name}"] for name in ("x", "vx", "y", "vy")] for p in points(one)]
        assert states == [track.state.tolist() for track in other.new]
        assert [p["hit_count"] for p in points(one)] == [len(track.hits) for track in other.new]
    assert world.dropped() == {}


def test_auto_learns_the_sweep(world):
    radar = Radar(world, sweep="auto")
    alone = BEAMS // 6  # messages of the first turn, each a scan
    received = radar.send(in_parts(turns(6), 6), alone + 4)
    world.until_logged("messages are parts of a sweep of 3.14 s")
    assert sum(one.width for one in received) == 2


def test_when_messages_stop_the_open_scan_ends_and_a_reset_discards_one(world):
    radar = Radar(world, sweep=1.0)
    received = radar.send(in_parts(turns(1), 6)[:10], 1)
    assert len(received) == 1
    radar.send(in_parts(turns(1), 6)[10:20], 0)
    for _ in range(20):  # they arrive
        world.spin_once()
    world.call(Trigger, "/track_initiator/reset", Trigger.Request())
    radar.send(in_parts(turns(1), 6)[:10], 1)
    assert len(radar.tracks) == 2
    assert world.dropped() == {}


def test_a_bag_of_parts_gives_the_same_tracks_through_the_node_and_offline(world, tmp_path):
    scenario = small_scenario(period=1.0, own_ship={"x": 100.0, "y": -50.0})
    entries = []
    for one in Simulator(scenario, 5, 1000.0).parts(12):
        scan = one.scan
        values = {"range": scan.range, "azimuth": scan.azimuth, "time_offset": scan.time_offset}
        entries.append(
            Entry(scan.stamp, "/detections", POINTS, cloud(scan.stamp, "sonar", **values))
        )
    path = write_bag(tmp_path / "bag", entries)
    given = (*PARAMETERS, "sweep:=1.0")
    arguments = [part for one in given for part in ("-p", one)]
    assert main(["run", str(path), "--out", str(tmp_path / "out"), *arguments]) == 0
    with Bag(tmp_path / "out" / "tracks.mcap") as bag:
        offline = [message.data for message in bag.messages(["/tracks/current"])]
    live: list[bytes] = []
    world.observer.create_subscription(
        PointCloud2, "tracks/current", live.append, RELIABLE, raw=True
    )
    world.make(TrackInitiator, named({**parse_values(given), "method": "score"}))
    player = world.make(
        ScanPlayer,
        {
            "recording": str(path),
            "wait_for_subscribers": 2,
            "rate_factor": 1e5,
            "settling_time": 0.0,
        },
    )
    world.until(lambda: world.observer.count_subscribers("/detections") == 1, "the initiator")
    world.until_connected()
    world.listen(PointCloud2, "detections")
    world.until(player.finished.done, "the end")
    world.until(lambda: len(live) == len(offline), "the last scan, after a silence")
    assert 10 <= len(offline) <= 11

    def canonical(data: bytes) -> bytes:
        return bytes(STORE.serialize_cdr(STORE.deserialize_cdr(data, POINTS), POINTS))

    assert [canonical(data) for data in live] == offline
    assert STORE.deserialize_cdr(offline[-1], POINTS).width == 2


def test_the_simulator_plays_sweeps(world):
    clouds = world.listen(PointCloud2, "detections")
    truth = world.listen(PointCloud2, "ground_truth")
    world.make(
        SonarSimulator,
        {"scenario": "box", "messages_per_scan": 24, "rate_factor": 1e5, "settling_time": 0.0},
    )
    world.until(lambda: len(clouds) == 16 * 24 and len(truth) == 16, "all sectors")
    stamps = [stamp_ns(one) for one in clouds]
    assert {b - a for a, b in pairwise(stamps)} == {500_000_000}
    for place, one in enumerate(clouds[:48]):
        for point in points(one):
            sector = (point["azimuth"] + 3.1415927) / (2 * 3.1415927) * 24
            assert abs((sector - (place % 24 + 0.5) + 12) % 24 - 12) < 1.0
