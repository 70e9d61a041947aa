"""Warnings that are logged at a limited rate."""

from __future__ import annotations

import time

from rclpy.node import Node

WARNING_PERIOD = 10.0
"""Minimum time between warnings with the same reason, s."""


class ThrottledWarnings:
    """Logs warnings with the same reason at most once per `WARNING_PERIOD`.

    Parameters
    ----------
    node : rclpy.node.Node
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._warned: dict[str, float] = {}

    def warn(self, reason: str, sentence: str, total: int) -> None:
        """Log a fault and the number of its occurrences, unless it was logged just before.

        Nothing is logged while the node ends.
        """
        if not self._node.context.ok():
            return
        now = time.monotonic()
        if now - self._warned.get(reason, -WARNING_PERIOD) < WARNING_PERIOD:
            return
        self._warned[reason] = now
        counted = f"{sentence} ({total} so far: {reason})" if total else sentence
        self._node.get_logger().warning(counted)
