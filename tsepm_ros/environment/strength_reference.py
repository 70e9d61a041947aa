"""References of the strength of clutter: the detections of a ping, and whether two are alike."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import kolmogorov

from tsepm_ros.numerics.arrays import FloatArray, IntArray

SMALLEST_P_VALUE = 0.001
"""Probability (Kolmogorov-Smirnov) below which two references are not of one law."""


@dataclass
class ReferencePing:
    """References of one ping.

    Attributes
    ----------
    scan : int
    row, index : (n,) ndarray of int
        Place in the scan's detections, and their index in the scan, ascending.
    cells : tuple of (n,) ndarray of int
    raw : (n,) ndarray
        Logarithms less the level of the place.
    value : (n,) ndarray
        Less the level of the ping too.
    place : (n,) ndarray
        Bounded deviations, as the levels of places learned them.
    weight : (n,) ndarray
        Probability to be of clutter.
    position : (n, 2) ndarray
    strength : (n,) ndarray
        As measured.
    level : float
        Of the ping.
    """

    scan: int
    row: IntArray
    index: IntArray
    cells: tuple[IntArray, IntArray]
    raw: FloatArray
    value: FloatArray
    place: FloatArray
    weight: FloatArray
    position: FloatArray
    strength: FloatArray
    level: float

    def rows(self, part: IntArray) -> ReferencePing:
        """Some of the references."""
        return ReferencePing(
            self.scan,
            self.row[part],
            self.index[part],
            (self.cells[0][part], self.cells[1][part]),
            self.raw[part],
            self.value[part],
            self.place[part],
            self.weight[part],
            self.position[part],
            self.strength[part],
            self.level,
        )


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
