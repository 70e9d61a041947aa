"""Batches of random scenes: some tested always, the others among the long tests."""

import pytest


def batches(scenes: int, always: int, size: int = 1) -> list:
    """First scenes of batches of a size, of which only so many scenes are tested always."""
    return [
        pytest.param(first, marks=() if first < always else pytest.mark.long)
        for first in range(0, scenes, size)
    ]
