# Copyright 2026 tsepm_ros developers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""What the detections of confirmed tracks show of the sensor: its detection probability and errors.

A missed target was present if it is detected again. Therefore the scans from each detection of a
confirmed target to its next detection count as one detection in their number: a target that has
left is not counted as missed, however long its track is held. A track counts as far as the scans
after its start prove that its target exists: the detections of false tracks are not those of
targets.

The sensor's errors are compared with those given. Of three detections of one target in a row, the
middle one is compared with the straight line between the other two. With ``a = (t_3 - t_2) / (t_3 -
t_1)`` the innovation ``e = z_2 - a z_1 - (1 - a) z_3`` of a target of constant velocity has the
variance ``(1 + a^2 + (1 - a)^2) s^2`` along and across the line of sight, whatever errors were
assumed. Where the line of sight turns between the detections, errors across it of the others are
partly along that of the middle one; and errors of azimuth move detections on arcs, which leave the
line. Squares along the line of sight are less by the share that the assumed azimuth error explains.

Of the squares the median is taken, which a manoeuvre, or a detection of another origin, moves
little. Beside it stands the 0.95 quantile, over chi-square's, of tracks that move: a sensor that
rounds its ranges to cells, and echoes that wander over a target from time to time, leave most
squares near 0 and the errors in the few others. That the errors are smaller than assumed must be
shown by both. That they are larger is shown by the median alone, as manoeuvres raise the quantile.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tsepm_ros.numerics.arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    RecordArray,
    appended,
    rows_of,
)
from tsepm_ros.tracker.measurement import DETECTION

DATA_SHEET_SCANS = 5.0
"""Weight of the data sheet's probability, as a number of scans of a target."""
DETECTION_MEMORY = 200.0
"""Scans of targets, or detections, over which is averaged what they show: time constant."""
MIN_DETECTION_PROBABILITY, MAX_DETECTION_PROBABILITY = 0.05, 0.999
"""Bounds of the estimate, and of P_D given: both a detection and a miss stay possible."""
MAX_GAP = 100.0
"""Scans from a detection to the next one that outlive a restart, on average at most."""
CHI_SQUARE_MEDIAN, CHI_SQUARE_TAIL = 0.4549, 3.841
"""Median of a squared standard normal variable, and its 0.95 quantile."""
MIN_SQUARE_SHARE = 1e-4
"""Squared innovation over its assumed variance below which it shows a rounding."""
MAX_SAMPLES = 1000
MIN_SAMPLES = 60
"""Innovations from which on a judgement is made: a standard deviation of it is a sixth."""
MIN_FOLLOWED_SAMPLES, STATED_SAMPLES = 5, 6.0
"""Innovations from which on larger errors are followed, and those that the stated errors are
worth."""
MAX_SQUARE_VARIANCES = 16.0
"""Most variances that a square of a few counts for."""
FACTOR_STEP = 0.25
"""Step of the factor of errors that are followed, as a power of two: thresholds are computed for
each."""
CHANCE_STEPS = 1.5, 0.75
"""Steps by which a factor differs by chance, before enough innovations are known, and later."""
MAX_STEPS = 8
"""Steps of the factor at most, up and down: 4 and 1/4."""
MAX_SPACING = 4.0
"""Ratio of the two intervals up to which three detections count."""


class DetectionProbability:
    """Estimates P_D from D detections in C scans of covered targets, both fading.

    ``P_D = (w p_0 + D / P_G) / (w + C)`` with the data sheet's p_0 worth w scans, and the
    probability P_G that a detection falls into the gate: the mean of a beta distribution.
    """

    def __init__(self) -> None:
        self._detected = 0.0
        self._covered = 0.0

    def update(self, detected: FloatArray, scans: FloatArray, gate_probability: float) -> None:
        """Update the estimate with the tracks covered by a scan.

        Parameters
        ----------
        detected : (n,) ndarray
            Probability that each track's target exists, by the scans since its start alone, and was
            detected.
        scans : (n,) ndarray
            Scans that covered the target since its previous detection, the present scan included.
        gate_probability : float
            P_G.
        """
        covered = float(detected @ scans)
        keep = math.exp(-covered / DETECTION_MEMORY)
        self._detected = keep * self._detected + float(detected.sum()) / gate_probability
        self._covered = keep * self._covered + covered

    @property
    def memory(self) -> tuple[float, float]:
        """D / P_G and C, both fading; C as of gaps of at most `MAX_GAP`."""
        return self._detected, min(self._covered, MAX_GAP * self._detected)

    def remember(self, detected: float, covered: float) -> None:
        """Begin with the memory of another estimate."""
        self._detected, self._covered = detected, covered

    def estimate(self, given: float) -> float:
        """The estimate of P_D, with `given` as the data sheet's."""
        weight = DATA_SHEET_SCANS
        estimate = (weight * given + self._detected) / (weight + self._covered)
        return min(max(estimate, MIN_DETECTION_PROBABILITY), MAX_DETECTION_PROBABILITY)


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


class InnovationSamples:
    """Collects the innovations of confirmed tracks' detections.

    Attributes
    ----------
    samples : (6, n) ndarray
        Of the last ones range, m, squared innovations in range and azimuth, m^2 and rad^2, and the
        variances that were assumed; and whether the track moved.
    """

    def __init__(self) -> None:
        # The last two detections of each track, the oldest first: its id, range variance, and they.
        self._last = np.zeros(0, np.int64), np.zeros(0), np.zeros(0, DETECTION)
        self.samples = np.zeros((6, 0))

    def update(
        self,
        track_id: IntArray,
        detections: RecordArray,
        range_variance: FloatArray,
        confirmed: IntArray,
        moves: BoolArray,
    ) -> None:
        """Update with the detections (k,) of some scans that are confirmed tracks' own, in order.

        Parameters
        ----------
        track_id : (k,) ndarray of int
        detections : (k,) ndarray of DETECTION
        range_variance : (k,) ndarray
            Assumed, m^2.
        confirmed : (n,) ndarray of int
            Ids of all confirmed tracks; others are forgotten.
        moves : (n,) ndarray of bool
            Whether each moves.
        """
        ids = np.append(self._last[0], track_id)
        own = np.flatnonzero((ids[:, None] == confirmed).any(axis=1))
        own = own[np.argsort(ids[own], kind="stable")]
        ids, variance = ids[own], np.append(self._last[1], range_variance)[own]
        detections = rows_of(appended(self._last[2], detections), own)
        older = np.append(ids[2:] == ids[:-2], np.zeros(min(len(ids), 2), bool))
        self._last = ids[~older], variance[~older], detections[~older]
        third = np.flatnonzero(older) + 2
        time, position = detections["time"], detections["position"] @ (1.0, 1j)
        before, after = (time[third - k] - time[third - k - 1] for k in (1, 0))
        sights = position - detections["sensor_pose"][:, :2] @ (1.0, 1j)
        distance = np.abs(sights[third - 1])
        shorter, longer = np.minimum(before, after), np.maximum(before, after)
        use = (shorter > 0.0) & (longer <= MAX_SPACING * shorter) & (distance > 0.0)
        share, distance, third = after[use] / (before[use] + after[use]), distance[use], third[use]
        spread = np.sqrt(1.0 + share**2 + (1.0 - share) ** 2)
        line = share * position[third - 2] + (1.0 - share) * position[third]
        along = sights[third - 1].conj() / (distance * spread)
        turned, angle = (position[third - 1] - line) * along, detections["azimuth_std"][third]
        # What the azimuth errors of the other two, and arcs, add along the line of sight.
        others = np.array([share * sights[third - 2], (1.0 - share) * sights[third]]) * along
        across = angle**2 * (np.square(others.imag).sum(axis=0) + 0.25 * (distance * angle) ** 2)
        columns = (
            distance,
            turned.real**2 / (1.0 + across / variance[third]),
            (turned.imag / distance) ** 2,
            variance[third],
            angle**2,
            moves[(ids[third, None] == confirmed).nonzero()[1]],
        )
        self.samples = np.append(self.samples, columns, axis=1)[:, -MAX_SAMPLES:]

    @property
    def young(self) -> bool:
        """Whether there are too few innovations for a judgement."""
        return self.samples.shape[1] < MIN_SAMPLES

    def followed(self, steps: IntArray) -> IntArray:
        """Steps of the factors of range and azimuth errors in use, (2,), after those before.

        Larger errors are followed early, as tracks are lost and doubled by them, smaller ones with
        certainty. A factor changes where it is nearer to another one by more than chance.
        """
        columns, young = self.samples, self.young
        moves, number = columns[5] > 0.0, columns.shape[1]
        if number < MIN_FOLLOWED_SAMPLES:
            return np.zeros(2, np.int64)
        ratio = columns[1:3] / columns[3:5]
        if young:  # the mean varies less than the median
            variance = np.minimum(ratio, MAX_SQUARE_VARIANCES).mean(axis=1)
        else:
            variance = _robust_variances(moves, ratio, np.ones(2))
        wanted = 0.5 * np.log2(np.maximum(variance, 1e-9)) / FACTOR_STEP
        wanted *= number / (number + STATED_SAMPLES)
        lowest, chance = (0, CHANCE_STEPS[0]) if young else (-MAX_STEPS, CHANCE_STEPS[1])
        wanted = np.clip(wanted, lowest, MAX_STEPS)
        changes = np.abs(wanted - steps) > chance
        return np.where(changes, np.rint(wanted), steps).astype(np.int64)

    @property
    def fitted(self) -> FittedErrors | None:
        """The errors that fit; None before enough innovations."""
        if self.young:
            return None
        distance, along, turn, range_variance, azimuth_variance, moves = self.samples
        # Squares of nearly 0, of rounded ranges, leave it as it was assumed.
        grows = _grow_with_range(np.maximum(along, MIN_SQUARE_SHARE * range_variance), distance)
        scale = distance ** (2.0 * grows)
        assumed = np.median([range_variance / scale, azimuth_variance], axis=1)
        squares = np.array([along / scale, turn, along / range_variance, turn / azimuth_variance])
        stds = _robust_variances(moves > 0.0, squares, np.append(assumed, [1.0, 1.0])) ** 0.5
        range_std, azimuth_std, range_factor, azimuth_factor = stds.tolist()
        return FittedErrors(
            range_std=0.0 if grows else range_std,
            range_std_fraction=range_std if grows else 0.0,
            azimuth_std=azimuth_std,
            range_factor=range_factor,
            azimuth_factor=azimuth_factor,
            median_range=float(np.median(distance)),
        )


def _robust_variances(moves: BoolArray, square: FloatArray, assumed: FloatArray) -> FloatArray:
    """Variances (k,) of normal innovations by their squares (k, n), and those assumed (k,).

    By the median, or the tail up to `assumed`. The tail counts from as many innovations of tracks
    that move as a judgement needs.
    """
    by_median = np.median(square, axis=1) / CHI_SQUARE_MEDIAN
    if np.count_nonzero(moves) < MIN_SAMPLES:
        return np.asarray(by_median)
    by_tail = np.quantile(square[:, moves], 0.95, axis=1) / CHI_SQUARE_TAIL
    return np.maximum(by_median, np.minimum(by_tail, assumed))


def _grow_with_range(square: FloatArray, distance: FloatArray) -> bool:
    """Whether squared errors grow with the range rather like its square than not at all."""
    far = distance > np.median(distance)
    if far.all() or not far.any():
        return False
    growth = np.median(square[far]) / max(np.median(square[~far]), 1e-300)
    return bool(growth > np.median(distance[far]) / np.median(distance[~far]))
