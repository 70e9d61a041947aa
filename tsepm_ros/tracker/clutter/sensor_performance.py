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
assumed.

Of the squares the median is taken, which a manoeuvre, or a detection of another origin, moves
little. Beside it stands the 0.95 quantile, over chi-square's, of tracks that move: a sensor that
rounds its ranges to cells, and echoes that wander over a target from time to time, leave most
squares near 0 and the errors in the few others. That the errors are smaller than assumed must be
shown by both. That they are larger is shown by the median alone, as manoeuvres raise the quantile.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

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
"""Time constant, in scans of a target, with which older scans fade."""
MIN_PROBABILITY, MAX_PROBABILITY = 0.05, 0.999
"""Bounds of the estimate: both a detection and a miss stay possible."""

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
MIN_DEVIATIONS_SAID = 5.0
"""Standard deviations of a mean from which on it is said: errors of a track are alike for a while.
"""
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
        return min(max(estimate, MIN_PROBABILITY), MAX_PROBABILITY)


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
        sight = position[third - 1] - detections["sensor_pose"][third, :2] @ (1.0, 1j)
        distance = np.abs(sight)
        shorter, longer = np.minimum(before, after), np.maximum(before, after)
        use = (shorter > 0.0) & (longer <= MAX_SPACING * shorter) & (distance > 0.0)
        share, distance, third = after[use] / (before[use] + after[use]), distance[use], third[use]
        spread = np.sqrt(1.0 + share**2 + (1.0 - share) ** 2)
        line = share * position[third - 2] + (1.0 - share) * position[third]
        turned = (position[third - 1] - line) / spread * sight[use].conj() / distance
        columns = (
            distance,
            turned.real**2,
            (turned.imag / distance) ** 2,
            variance[third],
            detections["azimuth_std"][third] ** 2,
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


class Alignment:
    """Signed distances of a sensor's detections from tracks that another sensor sees, too.

    Where two sensors update a track in turns, with the innovations e and the residuals r after the
    update, ``d = (e_1 + r_1) / 2 - (e_2 + r_2) / 2`` is the distance between their errors, whatever
    the gains: each update moves the track by e - r, and the moves cancel.

    Attributes
    ----------
    number : float
        Of the distances, fading.
    """

    def __init__(self) -> None:
        # Sums of the distances, their squares, these over the variances, the velocities, their
        # squares, and their products with the distances.
        self.number, self._sums = 0.0, np.zeros((6, 2))

    def update(
        self,
        distances: FloatArray,
        variances: FloatArray,
        steps: float = 1.0,
        velocity: FloatArray | float = 0.0,
    ) -> None:
        """Update with distances (2, k) in range, m, and azimuth, rad: ``(e + r) / 2`` of each.

        `variances` (2, k) are those of the sensor as given, m^2 and rad^2, `velocity` (2, k) those
        of the targets beside the sensor's, m/s and rad/s. Those of fast scans count for less than
        one each, their `steps`: they are alike for a while.
        """
        number, squares = steps * distances.shape[1], distances**2
        keep, speed = math.exp(-number / DETECTION_MEMORY), velocity + 0.0 * distances
        self.number = keep * self.number + number
        each = distances, squares, squares / variances, speed, speed**2, distances * speed
        self._sums = keep * self._sums + steps * np.array([one.sum(axis=1) for one in each])

    @property
    def least_steps(self) -> IntArray:
        """Least steps of the factors of range and azimuth errors that the distances allow, (2,).

        An echo of another part of a body, or a wrong mounting, stays for a while: only the tracks
        of others show it, and without them smaller errors are not shown. Until a mounting is
        mended its error counts as one of each detection: a target has one track. The mean of ``((e
        + r) / 2)^2`` is ``(1 - K / 2)^2 / (1 - K)`` times the variance, with the gain K: no less.
        """
        ratio = np.maximum(self._sums[2] / max(self.number, 1.0), 1e-9)
        wanted = 0.5 * self.known * np.log2(ratio) / FACTOR_STEP
        return np.rint(np.clip(wanted, -MAX_STEPS, MAX_STEPS)).astype(np.int64)

    @property
    def known(self) -> bool:
        """Whether there are enough distances for a mean."""
        return self.number >= MIN_SAMPLES

    @property
    def fit(self) -> FloatArray:
        """Means in range, m, azimuth, rad, and time, s, and their standard deviations, (3, 2).

        What moves lies behind where stamps are late: by the time and its velocity.
        """
        number, (sums, squares, _, speed, speeds, products) = max(self.number, 1.0), self._sums
        variance = np.maximum(squares / number - (sums / number) ** 2, 1e-18)
        normal = np.diag([*number / variance, 1.0 + (speeds / variance).sum()])  # 0 +- 1 s before
        normal[2, :2] = normal[:2, 2] = -speed / variance
        inverse = np.linalg.inv(normal)
        mean = inverse @ [*sums / variance, -(products / variance).sum()]
        return np.stack([mean, np.sqrt(np.diag(inverse))], axis=1)


class Misalignment(NamedTuple):
    """By how much a sensor's detections lie beside those of the others, of the same targets.

    Attributes
    ----------
    range, range_error : float
        Mean and its standard deviation, m; above 0 where its ranges are longer.
    azimuth, azimuth_error : float
        The same, rad; above 0 counter-clockwise.
    time, time_error : float
        The same, s; above 0 where its stamps are later.
    """

    range: float
    range_error: float
    azimuth: float
    azimuth_error: float
    time: float
    time_error: float

    @property
    def away(self) -> float:
        """The largest of the three, in its standard deviations."""
        return float((np.abs(self[::2]) / np.maximum(self[1::2], 1e-12)).max())

    def __str__(self) -> str:
        figure = "{:+.2f} +- {:.2f}"
        form = f"{figure} degrees, {figure} m and {figure} s beside the others"
        return form.format(*np.degrees(self[2:4]), *self[:2], *self[4:])

    def sentence(self, name: str, yaw: float | None = None) -> str:
        """What is significant of it, in words, with the remedy; empty if nothing is.

        Parameters
        ----------
        name : str
            Of the sensor.
        yaw : float, optional
            Its `mounting.yaw` as it is, rad, where this turns its detections.
        """
        turn, turn_error = math.degrees(self.azimuth), math.degrees(self.azimuth_error)
        remedy = (
            f"turn its sensor_pose, its frame of tf, or its bearings by {-turn:+.2f} degrees"
            if yaw is None
            else f"set mounting.yaw to {yaw - self.azimuth:.4f} (now {yaw:.4f})"
        )
        said = [
            f"sees targets {abs(turn):.2f} +- {turn_error:.2f} degrees "
            f"{'left' if turn > 0.0 else 'right'} of where the other sensors see them: {remedy}, "
            "if the others are right"
        ] * (abs(turn) > MIN_DEVIATIONS_SAID * turn_error)
        said += [
            f"measures ranges {abs(self.range):.2f} +- {self.range_error:.2f} m "
            f"{'longer' if self.range > 0.0 else 'shorter'} than the other sensors"
        ] * (abs(self.range) > MIN_DEVIATIONS_SAID * self.range_error)
        said += [
            f"has stamps {abs(self.time):.2f} +- {self.time_error:.2f} s "
            f"{'later' if self.time > 0.0 else 'earlier'} than the other sensors, by what moves: "
            "compare their clocks, and what time of a ping each driver stamps"
        ] * (abs(self.time) > MIN_DEVIATIONS_SAID * self.time_error)
        return f"{name} {'; and it '.join(said)}" if said else ""


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
    ranges = np.median(distance[far]) / np.median(distance[~far])
    return bool(growth > ranges)
