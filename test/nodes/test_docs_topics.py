"""The page of topics says what the nodes have."""

from pathlib import Path

import pytest
from rclpy.node import Node

from tsepm_ros.nodes.track_initiator import TrackInitiator
from tsepm_ros.tools.players.scan_player import ScanPlayer
from tsepm_ros.tools.players.sonar_simulator import SonarSimulator
from tsepm_ros.tools.viewer.track_viewer import TrackViewer

PAGE = Path(__file__).parents[2] / "docs" / "topics.md"
POINT_CLOUD = "sensor_msgs/msg/PointCloud2"
SUBSCRIBED = {
    "own_ship_source": "odometry",
    "detections_type": POINT_CLOUD,
    "detections_reliability": "reliable",
}
OF_ROS = ("/rosout", "/parameter_events")

pytestmark = pytest.mark.skipif(not PAGE.exists(), reason="only in the source tree")


def documented(node: str) -> set[tuple[str, str, str]]:
    """Rows of a node's table: full name, direction, type."""
    (section,) = (
        part
        for part in PAGE.read_text(encoding="utf-8").split("\n## ")
        if part.startswith(f"`{node}`\n")
    )
    table = section.split("\n| name | direction | type | what |\n", 1)[1].split("\n\n", 1)[0]
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


@pytest.mark.parametrize(
    ("kind", "parameters"),
    [
        (TrackInitiator, SUBSCRIBED),
        (SonarSimulator, {"publish_clock": True}),
        (ScanPlayer, {"publish_clock": True}),
        (TrackViewer, {"port": 0}),
    ],
)
def test_the_page_has_every_topic_and_service_of_the_node(world, recording, kind, parameters):
    if kind is ScanPlayer:
        parameters = parameters | {"recording": recording}
    node = world.make(kind, parameters)
    assert existing(node) == documented(node.get_name())
