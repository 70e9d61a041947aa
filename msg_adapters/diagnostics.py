"""A node's health on ``/diagnostics``."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from msg_adapters.stamps import make_header

if TYPE_CHECKING:
    from diagnostic_msgs.msg import DiagnosticArray

    from tsepm_ros.diagnostics.health_figures import Status


def diagnostics(stamp_ns: int, node_name: str, statuses: Iterable[Status]) -> DiagnosticArray:
    """Build a message of some statuses.

    Parameters
    ----------
    stamp_ns : int
        ns.
    node_name : str
        Fully qualified: two boats have nodes of one name. The name of a status is ``node: task``,
        as rqt_robot_monitor and the aggregator expect; the hardware is named after the node, too.
    statuses : iterable of Status
        Their values are written in their order, floats with six digits.

    Returns
    -------
    diagnostic_msgs.msg.DiagnosticArray
    """
    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

    return DiagnosticArray(
        header=make_header(stamp_ns, ""),
        status=[
            DiagnosticStatus(
                level=bytes([status.level]),
                name=f"{node_name}: {status.task}",
                message=status.message,
                hardware_id=node_name,
                values=[
                    KeyValue(key=key, value=_text(value)) for key, value in status.values.items()
                ],
            )
            for status in statuses
        ],
    )


def _text(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
