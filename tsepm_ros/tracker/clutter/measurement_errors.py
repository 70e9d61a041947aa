"""Whether a sensor's errors are as given, judged by the detections of held tracks.

Of three detections of one target in a row, the middle one is compared with the straight line
between the other two. With ``a = (t_3 - t_2) / (t_3 - t_1)`` the innovation
``e = z_2 - a z_1 - (1 - a) z_3`` of a target of constant velocity has the variance
``(1 + a^2 + (1 - a)^2) s^2`` along and across the line of sight, whatever errors were assumed.

Of the squares the median is taken, which a manoeuvre, or a detection of another origin, moves
little. Beside it stands the 0.95 quantile, over chi-square's, of tracks that move: a sensor that
rounds its ranges to cells, and echoes that wander over a target from time to time, leave most
squares near 0 and the errors in the few others. That the errors are smaller than assumed must be
shown by both. That they are larger is shown by the median alone, as manoeuvres raise the quantile.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray, taken

CHI_SQUARE_MEDIAN = 0.4549
"""Median of a squared standard normal variable."""
CHI_SQUARE_TAIL = 3.841
"""Its 0.95 quantile."""
NEARLY_ZERO = 1e-4
"""Squared innovation over its assumed variance below which it shows a rounding."""
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
    """Collects the innovations of held tracks' detections.

    Attributes
    ----------
    samples : deque of tuple of float
        Range, m, squared innovations in range and azimuth, m^2 and rad^2, and the variances that
        were assumed, the last ones; and whether the track moved.
    """

    def __init__(self) -> None:
        self._track_id = np.zeros(0, np.int64)
        # Of the last three detections of each track, the oldest first; NaN before the first.
        self._time = np.zeros((0, 3))
        self._place = np.zeros((0, 3), complex)  # x + iy
        self.samples: deque[tuple[float, ...]] = deque(maxlen=MAX_SAMPLES)

    def update(
        self,
        track_id: IntArray,
        detections: NDArray[np.void],
        range_variance: FloatArray,
        held: IntArray,
        moves: BoolArray,
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
        moves : (n,) ndarray of bool
            Whether each moves.
        """
        self._follow(held)
        order = np.argsort(self._track_id)
        ids = self._track_id[order]
        place = np.searchsorted(ids, track_id)
        own = np.flatnonzero(np.searchsorted(ids, track_id, "right") > place)
        row, detections = order[place[own]], taken(detections, own)
        position, sensor = detections["position"], detections["sensor_pose"]
        for last, newest in (
            (self._time, detections["time"]),
            (self._place, position[:, 0] + 1j * position[:, 1]),
        ):
            last[row, :2] = last[row, 1:]
            last[row, 2] = newest
        self._add(
            self._time[row],
            self._place[row],
            sensor[:, 0] + 1j * sensor[:, 1],
            range_variance[own],
            detections["azimuth_std"] ** 2,
            moves[row],
        )

    def _follow(self, held: IntArray) -> None:
        """Begin with the tracks that are new, and forget those that are held no more."""
        if np.array_equal(held, self._track_id):
            return
        _, new, old = np.intersect1d(held, self._track_id, return_indices=True)
        time = np.full((len(held), 3), np.nan)
        place = np.full((len(held), 3), complex(np.nan, np.nan))
        time[new], place[new] = self._time[old], self._place[old]
        self._track_id, self._time, self._place = held, time, place

    def _add(
        self,
        time: FloatArray,
        place: NDArray[np.complex128],
        sensor: NDArray[np.complex128],
        range_variance: FloatArray,
        azimuth_variance: FloatArray,
        moves: BoolArray,
    ) -> None:
        """Add the innovations of the last three places (k, 3), ``x + iy``, from sensors' (k,)."""
        before, after = time[:, 1] - time[:, 0], time[:, 2] - time[:, 1]
        sight = place[:, 1] - sensor
        distance = np.abs(sight)
        shorter, longer = np.minimum(before, after), np.maximum(before, after)
        use = (shorter > 0.0) & (longer <= MAX_SPACING * shorter) & (distance > 0.0)
        if not use.any():
            return
        share = after[use] / (before[use] + after[use])
        z1, z2, z3 = place[use].T
        expected = share * z1 + (1.0 - share) * z3
        spread = np.sqrt(1.0 + share**2 + (1.0 - share) ** 2)
        distance = distance[use]
        turned = (z2 - expected) / spread * sight[use].conj() / distance
        along, turn = turned.real**2, (turned.imag / distance) ** 2
        columns = distance, along, turn, range_variance[use], azimuth_variance[use], moves[use]
        self.samples.extend(zip(*(column.tolist() for column in columns), strict=True))

    @property
    def fitted(self) -> FittedErrors | None:
        """The errors that fit; None before enough innovations."""
        if len(self.samples) < MIN_SAMPLES:
            return None
        columns = np.array(self.samples).T
        distance, along, turn, range_variance, azimuth_variance = columns[:5]
        variance = partial(_variance, columns[5] > 0.0)
        square, one = distance**2, np.ones(1)
        # Squares of nearly 0, of rounded ranges, leave it as it was assumed.
        grows = _grows(np.maximum(along, NEARLY_ZERO * range_variance), distance)
        return FittedErrors(
            range_std=0.0 if grows else variance(along, range_variance) ** 0.5,
            range_std_fraction=variance(along / square, range_variance / square) ** 0.5
            if grows
            else 0.0,
            azimuth_std=variance(turn, azimuth_variance) ** 0.5,
            range_factor=variance(along / range_variance, one) ** 0.5,
            azimuth_factor=variance(turn / azimuth_variance, one) ** 0.5,
            median_range=float(np.median(distance)),
        )


def _variance(moves: BoolArray, square: FloatArray, assumed: FloatArray) -> float:
    """Variance of normal innovations by their squares: by the median, or the tail up to `assumed`.

    The tail counts from as many innovations of tracks that move as a judgement needs.
    """
    by_median = float(np.median(square)) / CHI_SQUARE_MEDIAN
    if np.count_nonzero(moves) < MIN_SAMPLES:
        return by_median
    by_tail = float(np.quantile(square[moves], 0.95)) / CHI_SQUARE_TAIL
    return max(by_median, min(by_tail, float(np.median(assumed))))


def _grows(square: FloatArray, distance: FloatArray) -> bool:
    """Whether squared errors grow with the range rather like its square than not at all."""
    far = distance > np.median(distance)
    if far.all() or not far.any():
        return False
    growth = np.median(square[far]) / max(np.median(square[~far]), 1e-300)
    ranges = np.median(distance[far]) / np.median(distance[~far])
    return bool(growth > ranges)
