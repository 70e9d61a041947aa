"""Time limits of tests that hang: ten times what a quiet machine takes."""

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
