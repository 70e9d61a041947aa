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
"""Sweeps in parts through the node: the same tracks as of whole turns, and as offline."""

from itertools import pairwise

from sensor_msgs.msg import PointCloud2
from support.bag_files import (
    PARAMETERS,
    POINTS,
    STORE,
    Entry,
    detections,
    small_scenario,
    write_bag,
)
from support.live_and_offline import assert_same_live_and_offline
from support.sonar_driver import points, stamp_ns

from tsepm_ros.tools.players.sonar_simulator import SonarSimulator
from tsepm_ros.tools.simulation import Simulator


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
