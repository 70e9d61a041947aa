"""Warnings that are logged at a limited rate."""

from __future__ import annotations

import time

from rclpy.node import Node

from tsepm_ros.session.drop_reasons import reason_of

WARNING_PERIOD = 10.0
"""Minimum time between warnings with the same reason, s."""
MORE_DETECTIONS = 10
"""Factor between the numbers of dropped detections of two warnings: many pings have some."""
FACTS = ("intensity", "plots", "land", "sweep", "tracker_back", "own_ship_restart")
"""Reasons that are no fault."""


class ThrottledWarnings:
    """Logs warnings with the same reason at most once per `WARNING_PERIOD`, and facts as INFO.

    Drops of single detections are logged again once they are `MORE_DETECTIONS` times as many.

    Parameters
    ----------
    node : rclpy.node.Node
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._warned: dict[str, float] = {}
        self._said: dict[str, int] = {}

    def warn(self, reason: str, sentence: str, total: int) -> None:
        """Log a fault and the number of its occurrences, unless it was logged just before.

        Nothing is logged while the node ends.
        """
        if not self._node.context.ok():
            return
        now = time.monotonic()
        if now - self._warned.get(reason, -WARNING_PERIOD) < WARNING_PERIOD:
            return
        if total and reason_of(reason).lost == "detection":
            if total < MORE_DETECTIONS * self._said.get(reason, 0):
                return
            self._said[reason] = total
        self._warned[reason] = now
        counted = f"{sentence} ({total} so far: {reason})" if total else sentence
        logger = self._node.get_logger()
        if reason in FACTS:  # a line of its own: rclpy refuses two severities of one line
            logger.info(counted)
        else:
            logger.warning(counted)
