"""How long messages waited in the middleware's queue, and which of them are skipped."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

MAX_BACKLOG = 2.0
"""Time in the queue from which on the newest message is taken, s."""
BACKLOG_INTERVALS = 5.0
"""The same in scan intervals: a burst of a slow sonar is processed whole."""
LONGEST = 600.0
"""Time in the queue above which the clocks of publisher and subscriber differ, s."""


def seconds_in_queue(information: Any, now_ns: int | None = None) -> float:
    """Time that a message waited in the middleware, s, by the information that came with it.

    From its arrival here, where the middleware notes that, else from its publication. 0 where
    neither is known, or where the clocks of the two computers differ.

    Parameters
    ----------
    information : mapping or rmw_message_info_t
        `received_timestamp` and `source_timestamp`, ns of the system clock.
    now_ns : int, optional
        Time on that clock.
    """
    stamp = information["received_timestamp"] or information["source_timestamp"]
    if stamp <= 0:
        return 0.0
    waited = 1e-9 * ((time.time_ns() if now_ns is None else now_ns) - stamp)
    return waited if 0.0 <= waited <= LONGEST else 0.0


def newest(
    message: Any,
    information: Any,
    interval: float,
    take_waiting: Callable[[], list[tuple[Any, Any]]],
) -> tuple[Any, float, int]:
    """The message to be processed: the newest, where it waited too long in the queue.

    Parameters
    ----------
    message, information
        The oldest in the queue.
    interval : float
        Between scans, s; 0 while it is unknown.
    take_waiting : callable
        Takes all others from the queue, oldest first.

    Returns
    -------
    message : Any
    waited : float
        s.
    skipped : int
        Older messages that are not processed.
    """
    waited = seconds_in_queue(information)
    if not interval or waited <= max(MAX_BACKLOG, BACKLOG_INTERVALS * interval):
        return message, waited, 0
    others = take_waiting()
    if not others:
        return message, waited, 0
    message, information = others[-1]
    return message, seconds_in_queue(information), len(others)
