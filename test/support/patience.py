"""Time limits of tests.

A limit ends a test that hangs. It is ten times the time on a quiet machine, so that tests pass on a
busy machine.
"""

PATIENCE = 10.0


def patient(seconds: float) -> float:
    """Time limit for an action of a duration on a quiet machine, s."""
    return PATIENCE * seconds


WAIT = patient(3.0)
"""For a node or a process to start, to answer or to end, s."""

TEST = patient(15.0)
"""For a test, s."""

LONG_TEST = patient(60.0)
"""For a test that is marked `long`, s."""
