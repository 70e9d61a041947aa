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
"""The simulator: what it publishes, and the scenarios that it refuses."""

import math
import time

import numpy as np
import pytest
from sensor_msgs.msg import PointCloud2, PointField
from support.boat import named
from support.expectation import STATE
from support.ros_world import World
from support.show import SECOND, Show, fields, heading, write_scenario
from support.sonar_driver import points, stamp_ns

from msg_adapters import track_cloud
from tsepm_ros.nodes.track_initiator import TrackInitiator
from tsepm_ros.tools.players.sonar_simulator import SonarSimulator


@pytest.fixture
def scenario(tmp_path) -> str:
    return write_scenario(tmp_path)


def test_the_simulator_publishes_what_a_driver_would_and_the_truth(world, scenario):
    show = Show(world, SonarSimulator, scenario=scenario, own_ship_rate=2.0).play()
    assert show.clock == []
    assert world.observer.count_publishers("/clock") == 0
    assert len(show.detections) == len(show.truth) == 5
    for index, (scan, truth) in enumerate(zip(show.detections, show.truth, strict=True)):
        assert stamp_ns(scan) == stamp_ns(truth) == index * 4 * SECOND
        assert (scan.header.frame_id, truth.header.frame_id) == ("sonar", "odom")
        assert truth.fields == track_cloud(truth.header, ()).fields, "the layout of tracks"
        kinds = fields(scan)
        assert list(kinds)[:3] == ["x", "y", "z"]
        assert {kinds[name] for name in "xyz"} == {PointField.FLOAT32}
        assert {"range", "azimuth", "time_offset"} <= kinds.keys()
        for point in points(scan):
            x, y = (point["range"] * turn(point["azimuth"]) for turn in (math.cos, math.sin))
            assert (point["x"], point["y"]) == pytest.approx((x, y), rel=1e-5)
            assert point["time_offset"] == pytest.approx(point["range"] / 1500.0)
        states = [[point[name] for name in STATE] for point in points(truth)]
        time_s = 4.0 * index
        assert states == [
            [1500.0 + 4 * time_s, 4.0, 700.0 - 3 * time_s, -3.0],
            [-900.0, 0.0, 1200.0 + 5 * time_s, 5.0],
        ]
    stamps = [stamp_ns(message) for message in show.own_ship]
    assert np.diff(stamps).tolist() == [SECOND // 2] * (len(stamps) - 1)
    assert stamps[0] == 0
    assert stamps[-1] >= end_of_last_scan(show), "it is known for all of each scan"
    first, _, second, *_ = show.own_ship
    assert (first.header.frame_id, first.child_frame_id) == ("odom", "sonar")
    assert (first.pose.pose.position.x, first.pose.pose.position.y) == (100.0, -50.0)
    assert heading(first) == pytest.approx(math.radians(40.0))
    assert first.twist.twist.linear.x == pytest.approx(5.0, rel=1e-3), "in the ship's own axes"
    assert first.twist.twist.angular.z == pytest.approx(math.radians(2.0))
    assert heading(second) == pytest.approx(math.radians(42.0))


def end_of_last_scan(show: Show) -> float:
    """Of what was played, ns."""
    last = max(2 * point["time_offset"] for point in points(show.detections[-1]))
    return stamp_ns(show.detections[-1]) + last * SECOND


def test_frames_may_be_given_and_the_simulated_clock_goes_with_the_messages(world, scenario):
    given = {"fixed_frame": "map", "sensor_frame": "head", "publish_clock": True}
    show = Show(world, SonarSimulator, scenario=scenario, **given).play()
    assert {message.header.frame_id for message in show.detections} == {"head"}
    assert {message.header.frame_id for message in show.truth} == {"map"}
    assert {(m.header.frame_id, m.child_frame_id) for m in show.own_ship} == {("map", "head")}
    markers = [marker for array in show.markers for marker in array.markers]
    assert {marker.header.frame_id for marker in markers} == {"map"}
    times = show.times()
    assert times == sorted(times)
    assert {stamp_ns(message) for message in show.own_ship} <= set(times)
    assert times[-1] >= end_of_last_scan(show)


def test_the_shipped_scenario_is_the_default(world):
    show = Show(world, SonarSimulator).play()
    assert len(show.detections) == 16
    assert {message.width for message in show.truth} == {4}


PIER = """
sensors: [sonar, mast]
scans: 12
sensor: {range_std: 5.0, range_std_fraction: 0.0, azimuth_std: 0.005,
         detection_probability: 1.0, clutter_density: 1.0e-9}
sonar: {period: 2.0, sound_speed: 1500.0, mounting: {x: 5.0}, sensor: {max_range: 2000.0}}
mast: {period: 4.0, sensor: {max_range: 4000.0}}
targets: [{state: [1500.0, 1.0, 0.0, 0.0]}, {state: [0.0, 0.0, 3000.0, 2.0]}]
"""


def test_each_of_several_sensors_has_a_topic_and_the_initiator_makes_one_picture(world, tmp_path):
    (tmp_path / "pier.yaml").write_text(PIER)
    given = {"sensors": ["sonar", "mast"], "own_ship_source": "odometry", "use_sim_time": True}
    errors = {"sensor.range_std": 5.0, "sensor.range_std_fraction": 0.0, "sonar.mounting.x": 5.0}
    limits = {"sonar.sensor.max_range": 2000.0, "mast.sensor.max_range": 4000.0}
    world.make(TrackInitiator, named({**given, **errors, **limits}))
    heard = {name: world.listen(PointCloud2, f"{name}/detections") for name in given["sensors"]}
    tracks = world.listen(PointCloud2, "tracks")
    node = world.make(
        SonarSimulator,
        {
            "scenario": str(tmp_path / "pier.yaml"),
            **{"rate_factor": 1e4, "settling_time": 0.0, "wait_for_subscribers": 2},
            "publish_clock": True,
        },
    )
    world.until_connected()
    world.until(node.finished.done, "the end")
    world.until(lambda: sum(len(points(one)) for one in tracks) >= 2, "both targets")
    stamps = {name: [stamp_ns(one) // SECOND for one in clouds] for name, clouds in heard.items()}
    assert stamps == {"sonar": [*range(0, 24, 2)], "mast": [*range(0, 24, 4)]}
    [near], [far, other] = (points(clouds[1]) for clouds in heard.values())
    assert near["range"] == pytest.approx(1497.0, abs=25.0), "5 m ahead of the vessel's origin"
    assert near["time_offset"] == pytest.approx(near["range"] / 1500.0)
    assert far["time_offset"] == 0.0, "echoes of the mast are at the stamp"
    assert max(far["range"], other["range"]) == pytest.approx(3008.0, abs=25.0)
    found = sorted((p["y"], p["seen_by"]) for cloud in tracks for p in points(cloud))
    assert [seen for _, seen in found] == [3, 2]
    assert [y for y, _ in found] == [pytest.approx(0.0, abs=60.0), pytest.approx(3e3, abs=60.0)]
    assert world.dropped() == {}


def test_the_simulators_start_may_be_given_or_the_clocks_time(world, scenario):
    with World(world.domain) as own:
        show = Show(own, SonarSimulator, scenario=scenario, start_stamp=1.7e9).play()
        assert stamp_ns(show.detections[0]) == 1_700_000_000 * SECOND
        assert stamp_ns(show.own_ship[0]) == 1_700_000_000 * SECOND
    before = time.time_ns()
    show = Show(world, SonarSimulator, scenario=scenario, start_stamp=-1.0).play()
    assert before - SECOND < stamp_ns(show.detections[0]) < time.time_ns() + SECOND


def test_the_simulator_and_the_initiator_work_together_in_simulated_time(world, scenario):
    tracks = world.listen(PointCloud2, "tracks")
    given = {"own_ship_source": "odometry", "use_sim_time": True, "tsepm.min_hits": 4}
    world.make(TrackInitiator, named({**given, "sensor.range_std": 5.0}))
    show = Show(
        world, SonarSimulator, scenario=scenario, publish_clock=True, wait_for_subscribers=3
    )
    world.until(lambda: world.observer.count_subscribers("/detections") == 2, "the initiator")
    world.until_connected()
    show.play()
    world.until(lambda: len(tracks) == 5, "tracks")
    assert {message.header.frame_id for message in tracks} == {"odom"}
    for target in points(show.truth[-1]):
        found = [
            math.hypot(p["x"] - target["x"], p["y"] - target["y"])
            for m in tracks[3:]
            for p in points(m)
        ]
        assert min(found) < 100.0
    assert world.dropped() == {}
