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
"""Topics and services: nodes, page and SROS 2 policy agree; without its libraries none runs."""

import os
from importlib import import_module
from pathlib import Path
from xml.etree import ElementTree

import pytest
from rclpy.node import Node

from tsepm_ros.tools.players.sonar_simulator import SonarSimulator

PAGE = Path(__file__).parents[2] / "docs" / "topics.md"
OF_ROS = ("/rosout", "/parameter_events")
POLICY = Path(__file__).parents[2] / "config" / "sros2" / "tsepm_ros.policy.xml"
EVERYTHING = {
    "track_initiator": {
        "own_ship_source": "odometry",
        "publish_potential_tracks": True,
        "detections_type": "sensor_msgs/msg/PointCloud2",
        "detections_reliability": "reliable",
    },
    "sonar_detector": {},
    "sonar_simulator": {"publish_clock": True},
    "scan_player": {"publish_clock": True},
    "track_viewer": {"port": 0},
    "track_bridge": {"nmea_address": ""},
}
"""Parameters with which a node has all of its topics but `UNSEEN`."""
MODULES = {
    "track_initiator": ("tsepm_ros.nodes.track_initiator", "rclpy"),
    "sonar_detector": ("tsepm_ros.nodes.sonar_detector", "rclpy"),
    "sonar_simulator": ("tsepm_ros.tools.players.sonar_simulator", "rclpy"),
    "scan_player": ("tsepm_ros.tools.players.scan_player", "rclpy"),
    "track_viewer": ("tsepm_ros.tools.viewer.track_viewer", "tornado"),
    "track_bridge": ("tsepm_ros.tools.bridge.track_bridge", "pyproj"),
}
"""Where a node is, and what it needs."""
UNSEEN = {"/tf", "/tf_static", "/clock", "/tracks/objects", "/tracks/radar", "/image/plan"}
"""Topics of tf, of simulated time, of packages that are not installed, and of a browser's wish."""

pytestmark = pytest.mark.skipif(not POLICY.exists(), reason="only in the source tree")


def allowed(node: str) -> dict[str, set[str]]:
    """Fully qualified names that the policy allows a node, by what it does with them."""
    root = ElementTree.parse(POLICY).getroot()
    (profile,) = root.findall(f".//enclave[@path='/tsepm_ros/{node}']/profiles/profile")
    assert (profile.get("ns"), profile.get("node")) == ("/", node)
    names: dict[str, set[str]] = {
        what: set() for what in ("publish", "subscribe", "reply", "request")
    }
    for group in (*profile.findall("topics"), *profile.findall("services")):
        ((what, value),) = group.attrib.items()
        assert value == "ALLOW"
        names[what] |= {
            text.replace("~", f"/{node}") if text[0] in "~/" else f"/{text}"
            for text in (str(element.text) for element in group)
        }
    return names


def documented(node: str) -> set[tuple[str, str, str]]:
    """Rows of a node's table: full name, direction, type."""
    (section,) = (
        part
        for part in PAGE.read_text(encoding="utf-8").split("\n## ")
        if f"`{node}`" in part.partition("\n")[0]
    )
    table = section.split("\n| name | direction | type | content |\n", 1)[1].split("\n\n", 1)[0]
    rows = [[cell.strip(" `") for cell in line.split("|")[1:4]] for line in table.splitlines()[1:]]
    return {(full_name(node, name), direction, kind) for name, direction, kind in rows}


def full_name(node: str, name: str) -> str:
    return name if name.startswith("/") else f"/{name.replace('~', node)}"


def type_name(kind: type) -> str:
    package, group, _ = kind.__module__.split(".", 2)
    return f"{package}/{group}/{kind.__name__}"


def existing(node: Node) -> set[tuple[str, str, str]]:
    """What a node has beyond what every node has."""
    plain = Node("plain", context=node.context)
    services = {service.srv_type for service in plain.services}
    plain.destroy_node()
    found = {(one.topic_name, "out", type_name(one.msg_type)) for one in node.publishers}
    found |= {(one.topic_name, "in", type_name(one.msg_type)) for one in node.subscriptions}
    found |= {
        (one.service_name, "service", type_name(one.srv_type))
        for one in node.services
        if one.srv_type not in services
    }
    return {row for row in found if row[0] not in OF_ROS}


@pytest.mark.parametrize("name", EVERYTHING)
def test_the_policy_allows_a_node_exactly_its_topics_and_services_as_the_page_has_them(
    world, recording, name
):
    module, needed = MODULES[name]
    pytest.importorskip(needed)
    kind = getattr(import_module(module), name.title().replace("_", ""))
    more = {"recording": recording} if name == "scan_player" else {}
    if name != "sonar_simulator":
        world.make(SonarSimulator)
    node = world.make(kind, {**EVERYTHING[name], **more})
    if name in ("track_initiator", "sonar_simulator", "scan_player", "track_viewer"):
        assert existing(node) == documented(name)
    policy, of = allowed(name), world.observer
    looks = {
        "publish": of.get_publisher_names_and_types_by_node,
        "subscribe": of.get_subscriber_names_and_types_by_node,
        "reply": of.get_service_names_and_types_by_node,
        "request": of.get_client_names_and_types_by_node,
    }

    def complete() -> bool:
        found = {what: {one for one, _ in look(name, "/")} for what, look in looks.items()}
        assert all(found[what] <= policy[what] for what in policy)
        return all(policy[what] - UNSEEN <= found[what] for what in policy)

    world.until(complete, f"everything of {name} that the policy allows")


def test_security_that_cannot_be_had_ends_the_node_with_a_sentence(start, monkeypatch, tmp_path):
    monkeypatch.setitem(os.environ, "ROS_SECURITY_ENABLE", "true")
    monkeypatch.setitem(os.environ, "ROS_SECURITY_STRATEGY", "Enforce")
    monkeypatch.setitem(os.environ, "ROS_SECURITY_KEYSTORE", str(tmp_path))
    process = start("track_initiator", {})
    assert process.exit_code() == 2
    assert "Traceback" not in process.said
    (line,) = [line for line in process.said.splitlines() if line.startswith("refused:")]
    assert "secur" in line.lower()
