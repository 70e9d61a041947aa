"""How many tracks can be held where the time of a scan is limited."""

from __future__ import annotations

import sys

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray, IntArray
from tsepm_ros.numerics.limits import TimeLimit, keep_best

HOLDING_SHARE = 0.3
"""Share of the time of a scan for which held tracks may be carried through it."""
SECONDS_PER_TRACK = 5e-5
"""Time to carry a track through a scan, at least: measured where thousands are held."""
MANY = 1000
"""Held tracks from which on the time that they took is measured."""
LEAST_ROOM = 10
"""Tracks that a scan may start in any case."""


def room(limit: TimeLimit, held: int) -> int:
    """Tracks that may be added to those held, so that all can be carried in time.

    Parameters
    ----------
    limit : TimeLimit
        Of the scan, through which the held tracks were just carried.
    held : int
        Their number.
    """
    if not limit.finite:
        return sys.maxsize
    each = max(limit.elapsed / held if held >= MANY else 0.0, SECONDS_PER_TRACK)
    return max(int(HOLDING_SHARE * limit.seconds / each) - held, LEAST_ROOM)


def best(existence: FloatArray, evaluation: FloatArray, number: int) -> IntArray:
    """Rows of the new tracks (n,) that are kept, ascending.

    Those that exist most probably, and of equal ones those of the smallest evaluation.
    """
    rank = np.empty(len(existence))
    rank[np.lexsort((evaluation, -existence))] = np.arange(len(existence))
    return keep_best(rank, number)
