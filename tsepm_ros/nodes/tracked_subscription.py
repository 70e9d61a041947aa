"""Subscribing to what a downstream tracker says that it tracks."""

from __future__ import annotations

from rclpy.node import Node
from sensor_msgs.msg import PointCloud2

from msg_adapters import MessageError, tracker_report
from tsepm_ros.nodes.offered_subscription import OfferedSubscription
from tsepm_ros.nodes.qos_watch import QosWatch
from tsepm_ros.session import Session

TOPIC = "tracked"
DEPTH = 10


def subscribe_tracked(node: Node, session: Session, watch: QosWatch) -> OfferedSubscription:
    """Give a session every message on `tracked`; one of another layout is dropped."""

    def take(cloud: PointCloud2) -> None:
        try:
            session.add_tracked(tracker_report(cloud))
        except MessageError as error:
            session.drop(f"tracked_{error.reason}", f"tracked targets dropped: {error}")

    return OfferedSubscription(node, PointCloud2, TOPIC, DEPTH, take, watch)
