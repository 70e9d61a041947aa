"""Warnings that may come with every message, said now and then only."""

from __future__ import annotations

import time

from rclpy.node import Node

WARNING_PERIOD = 10.0
"""Least time between warnings of the same kind, s."""


class ThrottledWarnings:
    """Warns of each kind of fault not more often than `WARNING_PERIOD`.

    Parameters
    ----------
    node : rclpy.node.Node
    """

    def __init__(self, node: Node) -> None:
        self._logger = node.get_logger()
        self._warned: dict[str, float] = {}

    def warn(self, reason: str, sentence: str, total: int) -> None:
        """Warn of a fault of which there were so many in all, unless it was just warned of."""
        now = time.monotonic()
        if now - self._warned.get(reason, -WARNING_PERIOD) < WARNING_PERIOD:
            return
        self._warned[reason] = now
        self._logger.warning(f"{sentence} ({total} so far: {reason})" if total else sentence)
