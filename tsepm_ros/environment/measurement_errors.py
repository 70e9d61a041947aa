"""Whether a sensor's errors are as given, judged by the detections of held tracks.

Of three detections of one target in a row, the middle one is compared with the straight line
between the other two. With ``a = (t_3 - t_2) / (t_3 - t_1)`` the innovation
``e = z_2 - a z_1 - (1 - a) z_3`` of a target of constant velocity has the variance
``(1 + a^2 + (1 - a)^2) s^2`` along and across the line of sight, whatever errors were assumed. The
medians are taken, which a manoeuvre, or a detection of another origin, moves little.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.numerics.arrays import FloatArray, IntArray

CHI_SQUARE_MEDIAN = 0.4549
"""Median of a squared standard normal variable."""
MAX_SAMPLES = 1000
MIN_SAMPLES = 60
"""Innovations from which on a judgement is made: a standard deviation of it is a sixth."""
MAX_SPACING = 4.0
"""Ratio of the two intervals up to which three detections count."""


@dataclass(frozen=True)
class FittedErrors:
    """Errors that fit the innovations.

    Attributes
    ----------
    range_std, range_std_fraction, azimuth_std : float
        As in `SensorModel`; of the first two one is 0.
    range_factor, azimuth_factor : float
        The errors over those that were assumed.
    median_range : float
        Of the detections, m.
    """

    range_std: float
    range_std_fraction: float
    azimuth_std: float
    range_factor: float
    azimuth_factor: float
    median_range: float


class MeasurementErrors:
    """Collects the innovations of held tracks' detections."""

    def __init__(self) -> None:
        self._last: dict[int, deque[tuple[float, complex]]] = {}
        self._samples: deque[tuple[float, float, float, float, float]] = deque(maxlen=MAX_SAMPLES)

    def update(
        self,
        track_id: IntArray,
        detections: NDArray[np.void],
        range_variance: FloatArray,
        held: IntArray,
    ) -> None:
        """Update with the detections (k,) that are held tracks' own.

        Parameters
        ----------
        track_id : (k,) ndarray of int
        detections : (k,) ndarray of DETECTION
        range_variance : (k,) ndarray
            Assumed, m^2.
        held : (n,) ndarray of int
            Ids of all held tracks; others are forgotten.
        """
        known = set(held.tolist())
        self._last = {track: last for track, last in self._last.items() if track in known}
        names = "time", "position", "sensor_pose", "azimuth_std"
        columns = (detections[name].tolist() for name in names)
        given = zip(track_id.tolist(), *columns, range_variance.tolist(), strict=True)
        for track, time, (x, y), pose, azimuth_std, variance in given:
            last = self._last.setdefault(track, deque(maxlen=3))
            last.append((time, complex(x, y)))
            if len(last) == 3:
                self._add(list(last), complex(*pose[:2]), azimuth_std, variance)

    def _add(
        self,
        last: list[tuple[float, complex]],
        sensor: complex,
        azimuth_std: float,
        range_variance: float,
    ) -> None:
        """Add the innovation of the last three positions, ``x + iy``, from a sensor's."""
        (t1, z1), (t2, z2), (t3, z3) = last
        before, after = t2 - t1, t3 - t2
        if min(before, after) <= 0.0 or max(before, after) > MAX_SPACING * min(before, after):
            return
        share = after / (t3 - t1)
        innovation = (z2 - share * z1 - (1.0 - share) * z3) / math.sqrt(
            1.0 + share**2 + (1.0 - share) ** 2
        )
        sight = z2 - sensor
        distance = abs(sight)
        if distance <= 0.0:
            return
        turned = innovation * sight.conjugate() / distance
        turn = turned.imag / distance
        self._samples.append((distance, turned.real**2, turn**2, range_variance, azimuth_std**2))

    @property
    def fitted(self) -> FittedErrors | None:
        """The errors that fit; None before enough innovations."""
        if len(self._samples) < MIN_SAMPLES:
            return None
        distance, along, turn, range_variance, azimuth_variance = np.array(self._samples).T
        constant = _variance(along)
        fraction = _variance(along / distance**2)
        grows = _grows(along, distance)
        return FittedErrors(
            range_std=0.0 if grows else float(np.sqrt(constant)),
            range_std_fraction=float(np.sqrt(fraction)) if grows else 0.0,
            azimuth_std=float(np.sqrt(_variance(turn))),
            range_factor=float(np.sqrt(_variance(along / range_variance))),
            azimuth_factor=float(np.sqrt(_variance(turn / azimuth_variance))),
            median_range=float(np.median(distance)),
        )


def _variance(square: FloatArray) -> float:
    """Variance of normal innovations from the median of their squares."""
    return float(np.median(square)) / CHI_SQUARE_MEDIAN


def _grows(square: FloatArray, distance: FloatArray) -> bool:
    """Whether squared errors grow with the range rather like its square than not at all."""
    far = distance > np.median(distance)
    if far.all() or not far.any():
        return False
    growth = np.median(square[far]) / max(np.median(square[~far]), 1e-300)
    ranges = np.median(distance[far]) / np.median(distance[~far])
    return bool(growth > ranges)
