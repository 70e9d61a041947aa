"""Simulator and player alike: when they publish, and that none of it is lost."""

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest
from rclpy.qos import ReliabilityPolicy
from support.boat import Boat
from support.patience import WAIT
from support.ros_world import World
from support.show import DETECTIONS, OWN_SHIP, SECOND, TARGET, Show, write_recording, write_scenario
from support.sonar_driver import stamp_ns

from tsepm_ros.tools.players.scan_player import ScanPlayer
from tsepm_ros.tools.players.sonar_simulator import SonarSimulator


@pytest.fixture
def scenario(tmp_path) -> str:
    return write_scenario(tmp_path)


@pytest.fixture
def record(tmp_path) -> Callable[..., str]:
    """Write a recording and return its folder."""
    return partial(write_recording, tmp_path)


def make(world: World, kind: type, scenario: str, record: Any, **parameters: Any) -> Show:
    if kind is SonarSimulator:
        return Show(world, kind, scenario=scenario, **parameters)
    recording = record(detections=DETECTIONS, own_ship=OWN_SHIP, target=TARGET)
    return Show(world, kind, recording=recording, **parameters)


BOTH = pytest.mark.parametrize("kind", [SonarSimulator, ScanPlayer])


@BOTH
def test_everything_is_offered_reliably(world, kind, scenario, record):
    make(world, kind, scenario, record)
    for topic in ("/detections", "/own_ship/odometry", "/ground_truth", "/ground_truth/markers"):
        [publisher] = world.observer.get_publishers_info_by_topic(topic)
        assert publisher.qos_profile.reliability == ReliabilityPolicy.RELIABLE
        assert publisher.qos_profile.depth == 0 or publisher.qos_profile.depth >= 10


@BOTH
def test_nothing_is_published_before_there_are_enough_subscribers(world, kind, scenario, record):
    show = make(world, kind, scenario, record)
    world.until_logged("waiting for 2 subscriber(s) of /detections")
    for _ in range(20):
        world.spin_once(0.01)
    assert list(map(len, show.topics)) == [0] * 5
    show.play()
    number = 5 if kind is SonarSimulator else 3
    assert len(show.detections) == number


@BOTH
def test_it_may_start_without_any_subscriber(world, kind, scenario, record):
    show = make(world, kind, scenario, record, wait_for_subscribers=0)
    world.until(show.node.finished.done, "the end")
    world.until_logged("finished")


@BOTH
def test_it_settles_before_the_first_message(world, kind, scenario, record):
    show = make(world, kind, scenario, record, settling_time=0.3)
    begin = time.monotonic()
    show.begin()
    world.until(lambda: show.detections, "the first scan")
    assert time.monotonic() - begin >= 0.3


@BOTH
def test_the_rate_factor_sets_the_pace(world, kind, scenario, record):
    show = make(world, kind, scenario, record, rate_factor=40.0)
    begin = time.monotonic()
    show.begin()
    number = 5 if kind is SonarSimulator else 3
    world.until(lambda: len(show.detections) == number, "the last scan")
    took = time.monotonic() - begin
    span = (stamp_ns(show.detections[-1]) - stamp_ns(show.detections[0])) / SECOND
    assert span / 40.0 <= took < span / 40.0 + WAIT


@BOTH
def test_a_loop_begins_again_with_the_same_messages(world, kind, scenario, record):
    show = make(world, kind, scenario, record, loop=True)
    show.begin()
    number = 5 if kind is SonarSimulator else 3
    world.until(lambda: len(show.detections) >= 2 * number + 1, "the third round")
    rounds = [show.detections[number * n : number * (n + 1)] for n in range(2)]
    assert rounds[0] == rounds[1]
    assert not show.node.finished.done()


@BOTH
def test_a_loop_makes_the_initiator_start_over(world, kind, scenario, record):
    boat = Boat(world, restart_jump=3.0)
    world.end(boat.driver)
    show = make(world, kind, scenario, record, loop=True, wait_for_subscribers=3)
    world.until(lambda: world.observer.count_subscribers("/detections") == 2, "the initiator")
    world.until_connected()
    show.begin()
    number = 5 if kind is SonarSimulator else 3
    world.until(lambda: len(boat.tracks) >= 2 * number + 1, "the third round")
    world.until_logged("state reset")
    assert world.dropped() == {}
