"""A subscription with the reliability that the publishers offer."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSPolicyKind, QoSProfile, ReliabilityPolicy

from tsepm_ros.nodes.qos_watch import QosWatch


class OfferedSubscription:
    """Subscribes reliably, and as best effort once a publisher offers best effort only.

    Parameters
    ----------
    node : rclpy.node.Node
    message_type : type
    topic : str
    depth : int
        Messages that may queue up.
    callback : callable
        Called with each message, and with its information if it has two parameters.
    watch : QosWatch
        Counts the mismatches.
    reliability : rclpy.qos.ReliabilityPolicy, optional
        Initial reliability.
    fixed : bool, optional
        Keep the reliability; a mismatch is only logged.
    durability : rclpy.qos.DurabilityPolicy, optional
        Initial durability; volatile once a publisher offers no other.
    """

    def __init__(
        self,
        node: Node,
        message_type: type[Any],
        topic: str,
        depth: int,
        callback: Callable[..., None],
        watch: QosWatch,
        *,
        reliability: ReliabilityPolicy = ReliabilityPolicy.RELIABLE,
        fixed: bool = False,
        durability: DurabilityPolicy = DurabilityPolicy.VOLATILE,
    ) -> None:
        self._node = node
        self._message_type = message_type
        self._topic = topic
        self._depth = depth
        self._callback = callback
        self._watch = watch
        self._fixed = fixed
        self._durability = durability
        self._subscribe(reliability)

    @property
    def topic_name(self) -> str:
        """Full name of the topic."""
        return str(self._subscription.topic_name)

    def take_waiting(self) -> list[tuple[Any, Any]]:
        """Take all messages that wait in the middleware, oldest first, with their information."""
        taken: list[tuple[Any, Any]] = []
        while len(taken) < self._depth and (entry := self.take()) is not None:
            taken.append(entry)
        return taken

    def take(self) -> tuple[Any, Any] | None:
        """Take the oldest message that waits in the middleware with its information, or None."""
        subscription = self._subscription
        with subscription.handle:
            entry: tuple[Any, Any] | None = subscription.handle.take_message(
                subscription.msg_type, subscription.raw
            )
        return entry

    def _subscribe(self, reliability: ReliabilityPolicy) -> None:
        self._subscription = self._node.create_subscription(
            self._message_type,
            self._topic,
            self._callback,
            QoSProfile(depth=self._depth, reliability=reliability, durability=self._durability),
            event_callbacks=SubscriptionEventCallbacks(incompatible_qos=self._incompatible),
        )

    def _incompatible(self, event: Any) -> None:
        self._watch.heard[self.topic_name] += 1
        if event.last_policy_kind == QoSPolicyKind.DURABILITY:
            self._durability = DurabilityPolicy.VOLATILE
            self._node.destroy_subscription(self._subscription)
            self._subscribe(ReliabilityPolicy.RELIABLE)
            return
        if self._fixed:
            self._node.get_logger().error(
                f"a publisher of {self.topic_name} does not offer reliable delivery, so its "
                "messages are not received; set detections_reliability to auto or best_effort"
            )
            return
        self._node.get_logger().warning(
            f"a publisher of {self.topic_name} offers best effort only: subscribing as best effort"
        )
        self._node.destroy_subscription(self._subscription)
        self._subscribe(ReliabilityPolicy.BEST_EFFORT)
