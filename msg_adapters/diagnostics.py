"""A node's health on ``/diagnostics``."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from msg_adapters.stamps import make_header

if TYPE_CHECKING:
    from diagnostic_msgs.msg import DiagnosticArray

LEVELS = ("ok", "warn", "error", "stale")
"""Names of the levels, in the order of DiagnosticStatus."""


def diagnostics(
    stamp_ns: int, name: str, level: str, summary: str, values: Mapping[str, object]
) -> DiagnosticArray:
    """Build a message with one status.

    Parameters
    ----------
    stamp_ns : int
        ns.
    name : str
        ``node: what``, as rqt_robot_monitor and the aggregator expect.
    level : {"ok", "warn", "error", "stale"}
    summary : str
        One sentence.
    values : mapping of str to object
        Figures, in this order; floats are written with six digits.

    Returns
    -------
    diagnostic_msgs.msg.DiagnosticArray

    Raises
    ------
    ValueError
        If there is no such level.
    """
    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

    status = DiagnosticStatus(
        level=bytes([LEVELS.index(level)]),
        name=name,
        message=summary,
        hardware_id="",
        values=[KeyValue(key=key, value=_text(value)) for key, value in values.items()],
    )
    return DiagnosticArray(header=make_header(stamp_ns, ""), status=[status])


def _text(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
