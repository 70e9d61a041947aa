"""Keeping the best where there are too many to keep, or too little time."""

from __future__ import annotations

import math
import time

import numpy as np
from numpy.typing import NDArray


def keep_best(cost: NDArray[np.float64], limit: int) -> NDArray[np.int64]:
    """Rows of the `limit` smallest costs, in ascending order of rows.

    Ties are kept in the order of their rows, so that the choice is the same on every machine.

    Parameters
    ----------
    cost : (n,) ndarray
        Smaller is better.
    limit : int
        Number to keep, at least 1.
    """
    if len(cost) <= limit:
        return np.arange(len(cost))
    largest = np.partition(cost, limit - 1)[limit - 1]
    kept = cost < largest
    ties = np.flatnonzero(cost == largest)
    kept[ties[: limit - np.count_nonzero(kept)]] = True
    return np.flatnonzero(kept)


class TimeLimit:
    """The time that a scan may take.

    Parameters
    ----------
    seconds : float
        Time from now on, s; infinite: no limit.
    """

    def __init__(self, seconds: float = math.inf) -> None:
        self.seconds = seconds
        self._begin = time.perf_counter()

    @property
    def finite(self) -> bool:
        """Whether there is a limit at all."""
        return self.seconds < math.inf

    @property
    def elapsed(self) -> float:
        """Time used so far, s."""
        return time.perf_counter() - self._begin

    @property
    def left(self) -> float:
        """Time left, s; below 0 when it is over."""
        return self.seconds - self.elapsed
