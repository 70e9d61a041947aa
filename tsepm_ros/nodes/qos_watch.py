"""Topics on which the quality of service of publisher and subscriber is incompatible."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any

from rclpy.event_handler import PublisherEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSCompatibility, qos_check_compatible
from rclpy.topic_endpoint_info import TopicEndpointInfo


class QosWatch:
    """Counts the middleware's events of incompatibility, and checks which still exist.

    Parameters
    ----------
    node : rclpy.node.Node

    Attributes
    ----------
    heard : Counter
        Number of events by topic.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self.heard: Counter[str] = Counter()

    def publisher_events(
        self, topic: str, matched: Callable[[Any], None] | None = None
    ) -> PublisherEventCallbacks:
        """Event callbacks for a publisher; `matched` is called when subscribers come and go."""

        def incompatible(_: Any) -> None:
            name = self._node.resolve_topic_name(topic)
            self.heard[name] += 1
            self._node.get_logger().warning(
                f"a subscriber of {name} requests a reliability or durability that is not offered: "
                "it receives no messages"
            )

        return PublisherEventCallbacks(incompatible_qos=incompatible, matched=matched)

    def standing(self) -> list[str]:
        """Topics with events on which an endpoint is incompatible with this node's now."""
        return [topic for topic in sorted(self.heard) if self._is_mismatched(topic)]

    def _is_mismatched(self, topic: str) -> bool:
        publishers = self._node.get_publishers_info_by_topic(topic)
        subscriptions = self._node.get_subscriptions_info_by_topic(topic)
        return any(
            qos_check_compatible(offer.qos_profile, request.qos_profile)[0]
            == QoSCompatibility.ERROR
            for offer in publishers
            for request in subscriptions
            if self._is_own(offer) or self._is_own(request)
        )

    def _is_own(self, endpoint: TopicEndpointInfo) -> bool:
        own = self._node.get_name(), self._node.get_namespace()
        return (endpoint.node_name, endpoint.node_namespace) == own
