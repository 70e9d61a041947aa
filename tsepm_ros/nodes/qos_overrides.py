"""Overrides of the quality of service by parameters ``qos_overrides.<topic>.<entity>.<policy>``."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSPolicyKind
from rclpy.qos_overriding_options import QoSOverridingOptions

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
