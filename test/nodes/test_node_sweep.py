"""Sweeps in parts through the node: the same tracks as of whole turns, and as offline."""

from itertools import pairwise

from rclpy.node import Node
from sensor_msgs.msg import LaserScan, PointCloud2
from support.bag_files import (
    PARAMETERS,
    POINTS,
    STORE,
    Entry,
    detections,
    small_scenario,
    write_bag,
)
from support.boat import named
from support.live_and_offline import assert_same_live_and_offline
from support.ros_world import RELIABLE, World
from support.sonar_driver import points, stamp_ns
from support.sweeps import BEAMS, RADAR, in_parts, turns

from msg_adapters import make_header
from tsepm_ros.nodes.track_initiator import TrackInitiator
from tsepm_ros.tools.players.sonar_simulator import SonarSimulator
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
    values = {name: value for name, value in vars(one).items() if name != "header"}
    return LaserScan(header=make_header(stamp_ns(one), one.header.frame_id), **values)


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
    world.reset()
    radar.send(in_parts(turns(1), 6)[:10], 1)
    assert len(radar.tracks) == 2
    assert world.dropped() == {}


def test_a_bag_of_parts_gives_the_same_tracks_through_the_node_and_offline(world, tmp_path):
    scenario = small_scenario(period=1.0, own_ship={"x": 100.0, "y": -50.0})
    entries = [
        Entry(one.scan.stamp, "/detections", POINTS, detections(one.scan))
        for one in Simulator(scenario, 5, 1000.0).parts(12)
    ]
    path = write_bag(tmp_path / "bag", entries)
    offline = assert_same_live_and_offline(world, path, tmp_path, *PARAMETERS, "sweep:=1.0")
    current = offline["/tracks/current"]  # the last scan comes after a silence
    assert 10 <= len(current) <= 11
    assert STORE.deserialize_cdr(current[-1], POINTS).width == 2


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
