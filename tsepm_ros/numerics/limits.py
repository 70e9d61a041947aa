"""Limits of number and time: the rows of least cost, and the time of a scan."""

from __future__ import annotations

import math
import time

import numpy as np
from numpy.typing import NDArray


def keep_best(cost: NDArray[np.float64], limit: int) -> NDArray[np.int64]:
    """Rows of the `limit` smallest costs, in ascending order of rows.

    Ties are kept in the order of their rows: the choice is the same on every machine.

    Parameters
    ----------
    cost : (n,) ndarray
        Smaller is better.
    limit : int
        Number to keep, at least 1.
    """
    if len(cost) <= limit:
        return np.arange(len(cost))
    largest_kept = np.partition(cost, limit - 1)[limit - 1]
    kept = cost < largest_kept
    ties = np.flatnonzero(cost == largest_kept)
    kept[ties[: limit - np.count_nonzero(kept)]] = True
    return np.flatnonzero(kept)


class TimeLimit:
    """Limit of the processing time of a scan.

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
        """Whether the time is limited."""
        return self.seconds < math.inf

    @property
    def elapsed(self) -> float:
        """Time used so far, s."""
        return time.perf_counter() - self._begin

    def used(self, share: float) -> bool:
        """Whether a share of the time is over; never without a limit."""
        return self.elapsed > share * self.seconds

    @property
    def left(self) -> float:
        """Time left, s; negative once the limit is exceeded."""
        return self.seconds - self.elapsed
