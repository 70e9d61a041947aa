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
"""The RViz configuration and the Foxglove layout name what the nodes of the demo publish."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml
from rclpy.qos import DurabilityPolicy
from support.boat import named
from support.ros_domains import own_domain
from support.ros_world import World

from tsepm_ros.nodes.track_initiator import TrackInitiator
from tsepm_ros.settings.node_options import SimulatorNodeOptions
from tsepm_ros.tools.players.sonar_simulator import SonarSimulator

ROOT = Path(__file__).parents[2]
RVIZ_FILE = ROOT / "config/rviz/track_initiator.rviz"
RVIZ = yaml.safe_load(RVIZ_FILE.read_text())["Visualization Manager"]
FOXGLOVE = json.loads((ROOT / "config/foxglove/track_initiator.json").read_text())
TYPES = {
    "PointCloud2": "sensor_msgs/msg/PointCloud2",
    "MarkerArray": "visualization_msgs/msg/MarkerArray",
    "Odometry": "nav_msgs/msg/Odometry",
}
"""What RViz's displays take."""
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"


@pytest.fixture(scope="module")
def published() -> Iterator[dict[str, tuple[str, DurabilityPolicy]]]:
    """Types and durabilities by topic, of a simulator and a track initiator."""
    with own_domain() as domain, World(domain) as world:
        yield of_both(world)


def of_both(world: World) -> dict[str, tuple[str, DurabilityPolicy]]:
    world.make(TrackInitiator, named({"own_ship_source": "odometry"}))
    world.make(SonarSimulator)
    world.until_connected()
    look, found = world.observer, {}
    for node in ("track_initiator", "sonar_simulator"):
        for topic, _ in look.get_publisher_names_and_types_by_node(node, "/"):
            for end in look.get_publishers_info_by_topic(topic):
                found[topic] = end.topic_type, end.qos_profile.durability
    return found


def test_rviz_shows_topics_that_exist_with_types_and_qualities_that_fit(published):
    displays = [display for display in RVIZ["Displays"] if "Topic" in display]
    assert len(displays) >= 6
    for display in displays:
        topic = display["Topic"]
        kind, durability = published[topic["Value"]]
        assert kind == TYPES[display["Class"].removeprefix("rviz_default_plugins/")]
        # Best effort shows reliable publishers too; navigation is often best effort.
        navigation = topic["Value"] == "/own_ship/odometry"
        assert topic["Reliability Policy"] == ("Best Effort" if navigation else "Reliable")
        # With less than is offered a viewer that joins late would see nothing for a ping.
        latched = durability == DurabilityPolicy.TRANSIENT_LOCAL
        assert topic["Durability Policy"] == ("Transient Local" if latched else "Volatile")


def test_foxglove_shows_topics_that_exist_with_types_that_fit(published):
    panels = FOXGLOVE["configById"]
    paths = [path["value"] for panel in panels.values() for path in panel.get("paths", ())]
    rendered = {panel["topicToRender"] for panel in panels.values() if "topicToRender" in panel}
    assert paths and rendered == {"/diagnostics"}
    in_three_d = {published[topic][0] for topic in panels["3D!tracks"]["topics"]}
    assert in_three_d and in_three_d <= set(TYPES.values())
    in_paths = {published[re.match(r"[\w/]+", path)[0]][0] for path in paths}
    assert in_paths <= {TYPES["PointCloud2"], DIAGNOSTICS}
    assert published["/diagnostics"][0] == DIAGNOSTICS


def test_foxglove_names_statuses_that_exist(world):
    world.make(TrackInitiator, named({}))
    world.statuses()
    there = {status.name for status in world.diagnostics[-1].status}
    panels = FOXGLOVE["configById"]
    paths = [path["value"] for path in panels["Plot!levels"]["paths"]]
    named_there = {re.search(r'name=="(.*)"', path)[1] for path in paths}
    assert named_there == there
    assert panels["DiagnosticStatusPanel!latency"]["selectedName"] in there


def test_the_launch_file_starts_rviz_with_a_file_that_exists():
    launch = ElementTree.parse(ROOT / "launch/tsepm.launch.xml").getroot()
    [rviz] = [node for node in launch.iter("node") if node.get("pkg") == "rviz2"]
    assert rviz.get("if") == "$(var shows)"
    [path] = re.findall(r"\$\(find-pkg-share tsepm_ros\)/(\S+)", rviz.get("args"))
    assert (ROOT / "config" / path).is_file()  # config/ is left out where it is installed


def test_both_look_at_the_frame_of_the_simulator_and_every_panel_is_described():
    frame = SimulatorNodeOptions().fixed_frame
    assert RVIZ["Global Options"]["Fixed Frame"] == frame
    assert FOXGLOVE["configById"]["3D!tracks"]["followTf"] == frame

    def panels(part):
        return [part] if isinstance(part, str) else panels(part["first"]) + panels(part["second"])

    assert sorted(panels(FOXGLOVE["layout"])) == sorted(FOXGLOVE["configById"])
