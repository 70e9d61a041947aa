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
"""Simulator and player alike: when they publish, and that none of it is lost."""

import time
from collections.abc import Callable
from functools import partial

import pytest
from rclpy.qos import ReliabilityPolicy
from support.boat import Boat
from support.patience import WAIT
from support.show import DETECTIONS, OWN_SHIP, SECOND, TARGET, Show, write_recording, write_scenario
from support.sonar_driver import stamp_ns

from tsepm_ros.tools.players.scan_player import ScanPlayer
from tsepm_ros.tools.players.sonar_simulator import SonarSimulator


@pytest.fixture(params=[SonarSimulator, ScanPlayer])
def source(request, world, tmp_path) -> tuple[Callable[..., Show], int]:
    """Makes a simulator or a player; and how many scans it has."""
    if request.param is SonarSimulator:
        return partial(Show, world, SonarSimulator, scenario=write_scenario(tmp_path)), 5
    files = {"detections": DETECTIONS, "own_ship": OWN_SHIP, "target": TARGET}
    return partial(Show, world, ScanPlayer, recording=write_recording(tmp_path, **files)), 3


def test_all_is_offered_reliably_and_nothing_before_there_are_enough_subscribers(world, source):
    make, number = source
    show = make(settling_time=0.3)
    for topic in ("/detections", "/own_ship/odometry", "/ground_truth", "/ground_truth/markers"):
        [publisher] = world.observer.get_publishers_info_by_topic(topic)
        assert publisher.qos_profile.reliability == ReliabilityPolicy.RELIABLE
        assert publisher.qos_profile.depth == 0 or publisher.qos_profile.depth >= 10
    world.until_logged("waiting for 2 subscriber(s) of /detections")
    for _ in range(20):
        world.spin_once(0.01)
    assert list(map(len, show.topics)) == [0] * 5
    begin = time.monotonic()
    show.begin()
    world.until(lambda: show.detections, "the first scan")
    assert time.monotonic() - begin >= 0.3, "it settles before the first message"
    show.play()
    assert len(show.detections) == number


def test_it_may_start_without_any_subscriber_and_the_rate_factor_sets_the_pace(world, source):
    make, number = source
    begin = time.monotonic()
    show = make(wait_for_subscribers=0, rate_factor=40.0)
    world.until(show.node.finished.done, "the end")
    took = time.monotonic() - begin
    world.until_logged("finished")
    world.until(lambda: len(show.detections) == number, "the last scan")
    span = (stamp_ns(show.detections[-1]) - stamp_ns(show.detections[0])) / SECOND
    assert span / 40.0 <= took < span / 40.0 + WAIT


def test_a_loop_begins_again_and_makes_the_initiator_start_over(world, source):
    make, number = source
    boat = Boat(world, restart_jump=3.0)
    world.end(boat.driver)
    show = make(loop=True, wait_for_subscribers=3)
    world.until(lambda: world.observer.count_subscribers("/detections") == 2, "the initiator")
    world.until_connected()
    show.begin()
    world.until(lambda: len(boat.tracks) >= 2 * number + 1, "the third round")
    rounds = [show.detections[number * n : number * (n + 1)] for n in range(2)]
    assert rounds[0] == rounds[1]
    assert not show.node.finished.done()
    world.until_logged("state reset")
    assert world.dropped() == {}
