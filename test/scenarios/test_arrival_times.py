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
"""Data in the order in which it arrives: odometry that is late, restarts and clocks that jump."""

import dataclasses
import math
from collections import Counter

import numpy as np
import pytest
from support.builders import FIXED_RANGE_ERROR, assert_same_tracks, scan_at
from support.sessions import NotedSession

from tsepm_ros import Scan
from tsepm_ros.methods.tsepm import TsepmOptions
from tsepm_ros.own_ship.pose_history import PoseSample
from tsepm_ros.own_ship.registration import UnregisteredScan
from tsepm_ros.session.inputs import Arrival
from tsepm_ros.session.session import Session
from tsepm_ros.settings.node_options import SessionOptions
from tsepm_ros.settings.settings import Settings
from tsepm_ros.tools.simulation import Simulator, load_scenario
from tsepm_ros.tools.simulation.scenario import ScenarioOwnShipMotion

SHIP = ScenarioOwnShipMotion(20.0, -30.0, 0.4, speed=4.0, turn_rate=math.radians(2.0))
SEA = dataclasses.replace(
    load_scenario("four_targets", {"scans": 8, "sensor.clutter_density": 1e-7}), own_ship=SHIP
)
RATE = 5.0


def odometry(ship: ScenarioOwnShipMotion, first: float, last: float, rate: float = RATE):
    """Samples at a rate, from `first` to `last` (s)."""
    times = np.arange(round(first * rate), round(last * rate) + 1) / rate
    frames = {"frame_id": "odom", "child_frame_id": "sonar"}
    return [PoseSample(float(time), *ship.pose(float(time)), **frames) for time in times]


def moving(**options) -> NotedSession:
    settings = Settings(
        session=SessionOptions(method="tsepm", own_ship_source="odometry", **options),
        sensor=FIXED_RANGE_ERROR,
        methods={"tsepm": TsepmOptions(min_hits=3, window=4)},
    )
    return NotedSession(settings)


def play(one: Session, events):
    """Results of samples and scans that arrive at their times; what waits is looked at often."""
    results = []
    for now, event in sorted(events, key=lambda event: event[0]):
        if isinstance(event, Scan):
            one.add_scan(UnregisteredScan(event, "sonar"), now)
        elif isinstance(event, PoseSample):
            one.add_own_ship(event)
        results += one.process(now)
    return results


@pytest.mark.parametrize("ahead", [0.0, 0.15], ids=["when complete", "before its last echo"])
def test_odometry_at_5_hz_and_200_ms_late_loses_nothing_and_changes_nothing(ahead):
    scans = [(s.complete - ahead, s.scan) for s in Simulator(SEA, 1)]
    assert len(scans) == SEA.scans
    poses = odometry(SHIP, -1.0, scans[-1][0] + 1.0)
    sessions = moving(), moving()
    late, in_time = (
        play(one, [*((sample.stamp + delay, sample) for sample in poses), *scans])
        for one, delay in zip(sessions, (0.2, -1.0), strict=True)
    )
    assert [one.dropped for one in sessions] == [Counter(), Counter()]
    assert [result.stamp for result in late] == [scan.stamp for _, scan in scans]
    assert sum(len(result.new) for result in late) >= 4
    for a, b in zip(late, in_time, strict=True):
        np.testing.assert_array_equal(a.scan.sensor_pose, b.scan.sensor_pose)
        assert_same_tracks(a.new, b.new)
        assert_same_tracks(a.current, b.current)


def ping(stamp: float) -> Scan:
    return scan_at(stamp, [(3000.0, 0.0)])


EAST = ScenarioOwnShipMotion(speed=2.0)
NORTH = ScenarioOwnShipMotion(7000.0, 5000.0, math.pi / 2, speed=3.0)


@pytest.mark.long
@pytest.mark.parametrize("period", [0.1, 0.5, 4.0, 12.0])
@pytest.mark.parametrize("rate", [1.0, 5.0, 50.0])
def test_after_a_short_restart_no_scan_is_placed_by_the_poses_before_it(rate, period):
    # A run, then another: shorter than the jump that is a restart at once.
    one = moving(own_ship_timeout=2.0)
    events, duration = [], 10.0 if period < 1.0 else 30.0
    for start, ship in ((0.0, EAST), (100.0, NORTH)):
        events += [(start + s.stamp + 0.05, s) for s in odometry(ship, 0.0, duration, rate)]
        events += [(start + t, ping(float(t))) for t in np.arange(1.0, duration - 1.0, period)]
    results = play(one, events)
    (restart,) = [k for k, result in enumerate(results) if result.arrival is Arrival.RESTART]
    for ship, found in ((EAST, results[:restart]), (NORTH, results[restart:])):
        for result in found:
            np.testing.assert_allclose(result.scan.sensor_pose, ship.pose(result.stamp), atol=1e-6)
    # Two scans show the restart; more are lost only until the odometry's next ones are there.
    lost = 2 + math.ceil(2.0 / rate / period)
    assert len(results) - restart >= restart - lost
    assert one.heard.count("restart") == 1


def test_odometry_that_starts_over_alone_is_believed_after_the_timeout():
    one = moving(own_ship_timeout=2.0)
    first = [(s.stamp, s) for s in odometry(EAST, 0.0, 30.0)]
    again = [(s.stamp + 20.0, s) for s in odometry(NORTH, 11.0, 40.0)]
    (*_, result) = play(one, [*first, *again, (50.0, ping(29.0))])
    np.testing.assert_allclose(result.scan.sensor_pose, NORTH.pose(29.0), atol=1e-6)
    assert one.heard.count("own_ship_restart") == 1
    assert one.dropped == {"own_ship_late": 12}, "of 2.2 s"


def test_a_second_source_of_odometry_that_is_late_is_not_a_restart():
    one = moving(own_ship_timeout=2.0)
    good = [(s.stamp, s) for s in odometry(EAST, 0.0, 60.0, 0.5)]
    late = [(s.stamp + 2.5, s) for s in odometry(NORTH, 0.0, 57.0, 20.0)]
    (result,) = play(one, [*good, *late, (50.5, ping(44.0))])
    np.testing.assert_allclose(result.scan.sensor_pose, EAST.pose(44.0), atol=1e-6)
    assert set(one.heard) == {"own_ship_late"}


def test_a_stamp_far_ahead_without_own_ship_data_leaves_no_trace():
    stamps = [0.0, 4.0, 8.0, 12.0, 16.0, 20.0]
    poses = [(s.stamp, s) for s in odometry(EAST, 0.0, 30.0)]
    clean, disturbed = moving(own_ship_timeout=2.0), moving(own_ship_timeout=2.0)
    expected = play(clean, [*poses, *((stamp, ping(stamp)) for stamp in stamps)])
    glitch = (9.0, ping(1e5))
    found = play(disturbed, [*poses, glitch, *((stamp, ping(stamp)) for stamp in stamps)])
    assert disturbed.dropped == {"own_ship_stale": 1}
    assert [result.arrival for result in found] == [Arrival.NEXT] * 6
    for a, b in zip(found, expected, strict=True):
        assert_same_tracks(a.new, b.new)
        assert a.statistics == b.statistics
    assert sum(len(result.new) for result in found) >= 1


def test_clocks_that_jump_ahead_together_cost_what_was_under_way_and_no_scan():
    one = moving(max_gap=60.0)
    events = []
    for ahead in (0.0, 5000.0):
        events += [(s.stamp, s) for s in odometry(EAST, ahead, ahead + 30.0)]
        events += [(ahead + t + 1.0, ping(ahead + t)) for t in (0.0, 12.0, 24.0)]
    results = play(one, events)
    assert [result.arrival for result in results] == [Arrival.NEXT] * 3 + [Arrival.GAP] + [
        Arrival.NEXT
    ] * 2
    assert one.dropped == Counter()
    assert [len(result.new) for result in results] == [0, 0, 1, 0, 0, 1]
