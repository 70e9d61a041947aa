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
"""How the sensors of a picture lie beside each other, by the tracks that several of them see.

What is found is said and corrects no measurement: the pose that a sensor's scans have is applied.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray, Rows
from tsepm_ros.numerics.gaussian import UNLIKELY_SQUARE
from tsepm_ros.tracker.clutter.sensor_performance import (
    DETECTION_MEMORY,
    FACTOR_STEP,
    MAX_STEPS,
    MIN_SAMPLES,
)
from tsepm_ros.tracker.tracks import TrackArrays

MIN_DEVIATIONS_SAID = 5.0
"""Standard deviations of a mean from which on it is said: errors of a track are alike for a while.
"""
MAX_TRACK_ANGLE, MAX_RANGE_DEVIATIONS, MAX_TURN_DEVIATIONS, TURN_SHARE = 0.2, 6.0, 2.0, 0.2
"""Angle between the two tracks of a target that a wrong mounting doubles, at most, rad; deviations
of range by which they differ, at most; deviations of azimuth by which the angles of two such pairs
differ, at most; share of a detection in what is known of the angle."""


@dataclass(frozen=True, eq=False)
class Sightings(Rows):
    """A sensor's own detections of confirmed tracks, (k,).

    Attributes
    ----------
    track : (k,) ndarray of int
        Row of the track of each.
    position : (k, 2) ndarray
        m.
    sight : (k,) ndarray of complex
        Line from the sensor to it, m: x, and y as the imaginary part.
    beside : (k, 2) ndarray
        ``(e + r) / 2`` with the innovation e and the residual r after the update, m.
    """

    track: IntArray
    position: FloatArray
    sight: NDArray[np.complex128]
    beside: FloatArray

    def in_sight(self, vectors: FloatArray) -> FloatArray:
        """Vectors (k, 2) along the lines of sight, and across these as an angle, rad: (2, k)."""
        distance = np.abs(self.sight)
        turned = vectors @ (1.0, 1j) * self.sight.conj() / distance
        return np.array([turned.real, turned.imag / distance])

    def beside_tracks(
        self, tracks: TrackArrays, others: IntArray, range_deviation: FloatArray
    ) -> tuple[BoolArray, FloatArray]:
        """Which other tracks (o,) may be of the target of each detection, and the turn to it, rad.

        They move alike and are as far away, within the standard deviation (k,) of ranges, but in
        another direction. Both are (k, o).
        """
        state = tracks.state
        away = (self.position[:, None] - state[others, 0::2]) @ (1.0, 1j)
        turned = away * (self.sight.conj() / np.abs(self.sight) ** 2)[:, None]
        between = np.square(state[self.track, None, 1::2] - state[others, 1::2]).sum(axis=-1)
        spread = np.trace(tracks.covariance[:, 1::2, 1::2], axis1=1, axis2=2)
        alike = between <= UNLIKELY_SQUARE * (spread[self.track, None] + spread[others])
        error = range_deviation / np.abs(self.sight)
        alike &= np.abs(turned.imag) <= MAX_TRACK_ANGLE
        alike &= np.abs(turned.real) <= MAX_RANGE_DEVIATIONS * error[:, None]
        return alike, turned.imag


class DoubledTargets:
    """Pairs of tracks that may be of one target, which a wrong mounting doubles.

    Things that only one sensor sees each may lie as far away, and move alike: a pair counts where
    it is turned as the sensor is known to be, or as another pair is.
    """

    def __init__(self) -> None:
        self._turned: dict[tuple[int, int], float] = {}

    def agree(
        self,
        pairs: IntArray,
        track_id: IntArray,
        turned: FloatArray,
        deviation: float,
        known: float = math.nan,
    ) -> BoolArray:
        """Take the turns (n,) of pairs of tracks, rad, and return which count, (n,).

        Parameters
        ----------
        pairs : (2, n) ndarray of int
            Ids.
        track_id : (m,) ndarray of int
            Ids of all tracks; pairs of others are forgotten.
        turned : (n,) ndarray
        deviation : float
            Standard deviation of the sensor's azimuths, rad.
        known : float, optional
            Turn of the sensor, rad; nan where it is not known.
        """
        ids = set(track_id.tolist())
        before = {key: turn for key, turn in self._turned.items() if ids.issuperset(key)}
        keys = list(zip(*pairs.tolist(), strict=True))
        self._turned = before | {
            key: (1.0 - TURN_SHARE) * before.get(key, turn) + TURN_SHARE * turn
            for key, turn in zip(keys, turned.tolist(), strict=True)
        }
        return np.array(
            [self._agrees(key, known, MAX_TURN_DEVIATIONS * deviation) for key in keys], bool
        )

    def _agrees(self, pair: tuple[int, int], known: float, most: float) -> bool:
        turns = [turn for key, turn in self._turned.items() if not {*pair} & {*key}]
        return any(abs(self._turned[pair] - turn) <= most for turn in [known, *turns])


class Alignment:
    """Signed distances of a sensor's detections from tracks that another sensor sees, too.

    Where two sensors update a track in turns, with the innovations e and the residuals r after the
    update, ``d = (e_1 + r_1) / 2 - (e_2 + r_2) / 2`` is the distance between their errors, whatever
    the gains: each update moves the track by e - r, and the moves cancel.

    Attributes
    ----------
    number : float
        Of the distances, fading.
    doubled : DoubledTargets
    """

    def __init__(self) -> None:
        # Sums of the distances, their squares, these over the variances, the velocities, their
        # squares, and their products with the distances.
        self.number, self._sums = 0.0, np.zeros((6, 2))
        self.doubled = DoubledTargets()

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


def misalignments(alignments: dict[str, Alignment]) -> dict[str, Misalignment]:
    """How each sensor's detections lie beside those of the others, by name, where it is known.

    The farthest is first, in its errors: another one lies beside it only.
    """
    found = {}
    fits = {name: one.fit for name, one in alignments.items() if one.known}
    for name, own in fits.items() if len(fits) > 1 else ():
        others = np.array([fit for other, fit in fits.items() if other != name])
        mean = own[:, 0] - others[:, :, 0].mean(axis=0)
        spread = np.square(others[:, :, 1]).mean(axis=0) / len(others)
        error = np.sqrt(own[:, 1] ** 2 + spread)
        found[name] = Misalignment(*np.stack([mean, error], axis=1).ravel().tolist())
    return dict(sorted(found.items(), key=lambda one: -round(one[1].away, 3)))
