"""How long tests wait before they give something up: the one place that says it.

A limit is there to end what hangs. It is ten times the time on a quiet machine, so that nothing is
given up on a busy one.
"""

from __future__ import annotations

PATIENCE = 10.0


def patient(seconds: float) -> float:
    """Longest wait for what takes so long on a quiet machine, s."""
    return PATIENCE * seconds


WAIT = patient(3.0)
"""For a node or a process to start, to answer or to end, s."""

TEST = patient(15.0)
"""For a test, s."""

STATISTICAL_TEST = patient(60.0)
"""For a test that is marked `statistical`, s."""
