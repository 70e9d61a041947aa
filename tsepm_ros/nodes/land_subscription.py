"""Subscription to the chart, which its publisher sends once."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nav_msgs.msg import OccupancyGrid
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from tsepm_ros.nodes.qos_watch import QosWatch

TOPIC = "land"


class LandSubscription:
    """A reliable, transient local subscription to `land`.

    Parameters
    ----------
    node : rclpy.node.Node
    callback : callable
        Called with each message.
    watch : QosWatch
        Counts publishers whose quality of service is incompatible.
    """

    def __init__(self, node: Node, callback: Callable[[Any], None], watch: QosWatch) -> None:
        self._node = node
        self._watch = watch
        self._subscription = node.create_subscription(
            OccupancyGrid,
            TOPIC,
            callback,
            QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL),
            event_callbacks=SubscriptionEventCallbacks(incompatible_qos=self._incompatible),
        )

    def _incompatible(self, event: Any) -> None:
        name = str(self._subscription.topic_name)
        self._watch.heard[name] += 1
        self._node.get_logger().error(
            f"a publisher of {name} does not offer reliable, transient local delivery, so its "
            "chart is not received"
        )
