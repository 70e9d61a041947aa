"""Quality of service: overrides by parameters, and incompatible partners.

Overrides of the quality of service by parameters ``qos_overrides.<topic>.<entity>.<policy>``.

Topics on which the quality of service of publisher and subscriber is incompatible.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection
from typing import Any

from rclpy.event_handler import PublisherEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSCompatibility, QoSPolicyKind, qos_check_compatible
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.topic_endpoint_info import TopicEndpointInfo

from tsepm_ros.parameters import shown

PREFIX = "qos_overrides."
PUBLISHER = QoSOverridingOptions(
    (
        QoSPolicyKind.HISTORY,
        QoSPolicyKind.DEPTH,
        QoSPolicyKind.RELIABILITY,
        QoSPolicyKind.DURABILITY,
    )
)
"""Policies of every publisher that may be overridden. Those of subscriptions may not: reliability
follows the publisher, and the depth has a parameter."""

_VALUES = {
    "history": ("keep_last", "keep_all"),
    "reliability": ("reliable", "best_effort"),
    "durability": ("volatile", "transient_local"),
}


def fault(name: str, value: Any, publishers: Collection[str] | None = None) -> str:
    """Why an override cannot be used; empty if it can.

    Parameters
    ----------
    name : str
        Full name of the parameter.
    value : object
    publishers : collection of str, optional
        Full names of the topics that the node publishes; not known yet if not given.
    """
    topic, _, rest = name.removeprefix(PREFIX).rpartition(".publisher.")
    if not topic:
        return (
            f"{name} cannot be used: only publishers take overrides; the reliability of a "
            "subscription follows its publisher (detections_reliability and detections_depth are "
            "parameters)"
        )
    if publishers is not None and topic not in publishers:
        return f"{name} cannot be used: the node publishes {', '.join(sorted(publishers))}"
    if rest == "depth":
        sentence = f"{name} must be an integer of at least 1, below 2**31; got {shown(value)}"
        return "" if type(value) is int and 1 <= value < 2**31 else sentence
    if rest not in _VALUES:
        return f"{name} cannot be used: the policy must be depth, {', '.join(_VALUES)}"
    if value not in _VALUES[rest]:
        return f"{name} must be {' or '.join(_VALUES[rest])}; got {shown(value)}"
    return ""


def faults(node: Node) -> list[str]:
    """Why overrides of a node with all its publishers cannot be used, a sentence each."""
    publishers = {publisher.topic_name for publisher in node.publishers}
    given = node.get_parameters_by_prefix(PREFIX.removesuffix("."))
    found = (fault(f"{PREFIX}{name}", one.value, publishers) for name, one in sorted(given.items()))
    return [sentence for sentence in found if sentence]


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
