"""References of the strength of clutter: detections of the last pings, and whether they are alike.

They are rows of one array, so that a ping costs a few operations, whatever the number of pings.
"""

from __future__ import annotations

from collections import deque
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.special import kolmogorov

from tsepm_ros.numerics.arrays import FloatArray, IntArray

SMALLEST_P_VALUE = 0.001
"""Probability (Kolmogorov-Smirnov) below which two references are not of one law."""
MAX_PINGS = 64
"""Pings in the reference, at most ..."""
MAX_PER_PING = 64
"""... and detections of each."""
INDEX_BITS = 32
"""Bits of a reference's key below those of its scan."""

REFERENCE = np.dtype(
    [
        ("key", np.int64),  # of its scan and index there, see `keys_of`
        ("at", np.int64),  # place in the levels of places
        ("raw", np.float64),  # logarithm less the level of the place
        ("value", np.float64),  # less the level of the ping too
        ("by_range", np.float64),  # level of the range, part of that of the place
        ("place", np.float64),  # as the levels of places learned it, or nan
        ("weight", np.float64),  # probability to be of clutter
        ("position", np.complex128),  # x + i y, m
        ("strength", np.float64),  # as measured
    ]
)


def keys_of(scan: IntArray | int, index: IntArray) -> IntArray:
    """Keys of detections (n,), which ascend with the scan and with the index in it."""
    return np.asarray((np.asarray(scan, np.int64) << INDEX_BITS) + index)


class References:
    """The detections of the last pings, at most `MAX_PINGS`, as rows in one array.

    Attributes
    ----------
    levels : deque of float
        Level of each ping.
    """

    def __init__(self) -> None:
        self._buffer = np.zeros(2 * MAX_PINGS * MAX_PER_PING, REFERENCE)
        self._ends: deque[int] = deque([0])
        self.levels: deque[float] = deque()

    def __len__(self) -> int:
        """Number of pings."""
        return len(self.levels)

    @property
    def rows(self) -> NDArray[np.void]:
        """All references, by ping and index, (n,) of REFERENCE; changes of them are kept."""
        return self._buffer[self._ends[0] : self._ends[-1]]

    def last(self, pings: int) -> NDArray[np.void]:
        """References of the last pings, as `rows`."""
        return self._buffer[self._ends[-1 - min(pings, len(self))] : self._ends[-1]]

    def begins(self, pings: int) -> list[int]:
        """Places among `last` at which each of the last pings begins, in order."""
        ends = self._ends
        first = len(ends) - 1 - min(pings, len(self))
        return [ends[ping] - ends[first] for ping in range(first, len(ends) - 1)]

    def ages(self, places: IntArray) -> IntArray:
        """Pings after that of references at places among `rows`, (n,)."""
        ends = np.array(self._ends) - self._ends[0]
        return np.asarray(len(self) - np.searchsorted(ends, places, side="right"))

    def append(self, rows: NDArray[np.void], level: float) -> None:
        """Add a ping's references, of ascending keys; the oldest ping goes if there are too many.

        Parameters
        ----------
        rows : (n,) ndarray of REFERENCE
            From 1 to `MAX_PER_PING`.
        level : float
            Level of the ping.
        """
        if len(self) == MAX_PINGS:
            self.drop(1)
        if self._ends[-1] + len(rows) > len(self._buffer):
            first, kept = self._ends[0], self.rows.copy()
            self._buffer[: len(kept)] = kept
            self._ends = deque(end - first for end in self._ends)
        end = self._ends[-1] + len(rows)
        self._buffer[self._ends[-1] : end] = rows
        self._ends.append(end)
        self.levels.append(level)

    def drop(self, pings: int) -> None:
        """Drop the oldest pings."""
        for _ in range(pings):
            self._ends.popleft()
            self.levels.popleft()

    def relevel(self, before: float, level: float) -> None:
        """Give another level to the pings that have the level `before`."""
        for ping, (begin, end) in enumerate(pairwise(self._ends)):
            if self.levels[ping] == before:
                self.levels[ping] = level
                part = self._buffer[begin:end]
                part["value"] = part["raw"] - level


def of_one_law(one: FloatArray, other: FloatArray) -> bool:
    """Whether two samples may be of one law, by the test of Kolmogorov and Smirnov (asymptotic)."""
    both = np.concatenate([one, other])
    shares = [
        np.searchsorted(np.sort(sample), both, side="right") / len(sample)
        for sample in (one, other)
    ]
    distance = np.abs(shares[0] - shares[1]).max()
    size = len(one) * len(other) / len(both)
    return bool(kolmogorov(np.sqrt(size) * distance) >= SMALLEST_P_VALUE)


def of_one_shape(one: FloatArray, other: FloatArray) -> bool:
    """Whether two samples may be of one law but for their levels."""
    return of_one_law(one - np.median(one), other - np.median(other))
