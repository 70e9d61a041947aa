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
"""Paths of hits, and initial states with covariances (TSEPM 2018, Section 3.3, Eqs. 12-20).

Least squares on the hits' positions. The state is ``[x, vx, y, vy]``; hit i at ``t_i`` seconds
after the state's time is at ``H_i X``, ``H_i = [[1, t_i, 0, 0], [0, 0, 1, t_i]]`` (Eqs. 16-18).
All functions take a batch of n tracks with m hits each.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from tsepm_ros.numerics.arrays import FloatArray, IntArray, RecordArray, Rows, replaced
from tsepm_ros.numerics.gaussian import inverse_covariance_or_nan, squared_mahalanobis_distance
from tsepm_ros.tracker import motion, range_rates
from tsepm_ros.tracker.measurement import MeasurementWindow, covariance_at, major_sigma
from tsepm_ros.tracker.options import GATE_PROBABILITY
from tsepm_ros.tracker.sensor import RangeErrors, SensorModel

NO_HIT = -1
MAX_ROWS_TOGETHER = 16_384
"""Paths processed together: bounds memory and fits into the processor's cache."""
ESTIMATORS = ("unweighted", "weighted")
WEIGHTED_PASSES = 2


@dataclass(frozen=True)
class Paths(Rows):
    """Sequences of detections of possible targets, at most one per scan: a row each.

    Attributes
    ----------
    hits : (n, max_hits) ndarray of int
        Detection ids of the hits, oldest first, then NO_HIT.
    hit_count : (n,) ndarray of int
        N_v.
    first_scan : (n,) ndarray of int
        Scan index of the first hit; N_a follows from it.
    """

    hits: IntArray
    hit_count: IntArray
    first_scan: IntArray

    @property
    def last_hit(self) -> IntArray:
        """Detection id of each path's last hit, (n,)."""
        return self.hits[np.arange(len(self.hits)), self.hit_count - 1]

    def extended(self, parent: IntArray, detection: IntArray) -> Self:
        """Children with a further detection each: row i extends path `parent[i]`."""
        children = self[parent]
        children.hits[np.arange(len(parent)), children.hit_count] = detection
        return replaced(children, hit_count=children.hit_count + 1)

    def of_equal_count(self) -> Iterator[tuple[IntArray, IntArray]]:
        """Iterate over blocks of paths with the same number of hits.

        Yields
        ------
        rows : (r,) ndarray of int
            Paths, at most `MAX_ROWS_TOGETHER`.
        hits : (r, m) ndarray of int
            Detection ids of their hits, without NO_HIT.
        """
        for count in np.unique(self.hit_count):
            rows = np.flatnonzero(self.hit_count == count)
            for first in range(0, len(rows), MAX_ROWS_TOGETHER):
                block = rows[first : first + MAX_ROWS_TOGETHER]
                yield block, self.hits[block, :count]


def new_paths(detection: IntArray, scan_index: int, max_hits: int) -> Paths:
    """New paths of a single hit, with space for `max_hits` hits (Step 8)."""
    hits = np.full((len(detection), max_hits), NO_HIT, np.int64)
    hits[:, 0] = detection
    count = np.ones(len(detection), np.int64)
    return Paths(hits, count, np.full(len(detection), scan_index, np.int64))


def first_states(detections: RecordArray, max_speed: float) -> tuple[FloatArray, FloatArray]:
    """States (n, 4) and covariances (n, 4, 4) by a detection each.

    The velocity is unknown up to v_max (m/s): uniform over the disc, of variance v_max^2 / 4 on
    each axis.
    """
    state, covariance = np.zeros((len(detections), 4)), np.zeros((len(detections), 4, 4))
    state[:, 0::2], covariance[:, 0::2, 0::2] = detections["position"], detections["covariance"]
    covariance[:, [1, 3], [1, 3]] = max_speed**2 / 4.0
    return state, covariance


@dataclass(frozen=True)
class Fit:
    """States fitted to a batch of tracks.

    Attributes
    ----------
    state : (n, 4) ndarray
        m, m/s.
    covariance : (n, 4, 4) ndarray
        Covariance of the state.
    time_after_state : (n, m) ndarray
        Time of each hit after the state's time, s.
    hit_covariance : (n, m, 2, 2) ndarray
        Covariance of each hit's position in the fit, m^2.
    """

    state: FloatArray
    covariance: FloatArray
    time_after_state: FloatArray
    hit_covariance: FloatArray


def fit_states(
    hits: RecordArray, stamp: float, sensor: SensorModel | RangeErrors, estimator: str
) -> Fit:
    """Fit the state at `stamp` to the hits of each track.

    Parameters
    ----------
    hits : (n, m) ndarray of DETECTION
        The hits of n tracks, m >= 2 at different times.
    stamp : float
        Time of the state, s.
    sensor : SensorModel or RangeErrors
        Range errors, for the weighted fit.
    estimator : {"unweighted", "weighted"}
        As published (Eqs. 19-20), or weighted with R re-evaluated at the fit, in two passes.

    Returns
    -------
    Fit

    Notes
    -----
    Range rates are processed last, as further measurements after the fit to the positions
    (`range_rates.fit`).

    R at a fit is rotated by the fit's own azimuth error. Where ``r s_a^2`` is not small compared
    with s_r, the covariance is therefore too small: for 5 hits at 5 km, 10 m and 2 (3) degrees the
    mean NEES is 4.3 (4.8) for the weighted fit, and 4.0 for the fit weighted with R at the true
    positions.
    """
    time_after_state, at_fit = hits["time"] - stamp, hits["covariance"]
    state, covariance = unweighted_fit(time_after_state, hits["position"], at_fit)
    for _ in range(WEIGHTED_PASSES if estimator == "weighted" else 0):
        positions = motion.position_after(state[:, None], time_after_state)
        at_fit = covariance_at(hits, positions, sensor)
        state, covariance = weighted_fit(time_after_state, hits["position"], at_fit, state)
    state, covariance = range_rates.fit(state, covariance, time_after_state, hits)
    return Fit(state, covariance, time_after_state, at_fit)


def fit_paths(
    paths: Paths,
    window: MeasurementWindow,
    stamp: float,
    sensor: SensorModel | RangeErrors,
    process_noise: float = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """Weighted fits of the states of paths with different numbers of hits, at least two each.

    The fit is that of a straight motion. An acceleration of a spectral density q moves hits i and
    k, s_i <= s_k before the state, off it with the covariance ``c_ik = q s_i^2 (3 s_k - s_i) / 6``.
    That of the state is larger by ``sum_ik A_i c_ik A_k'``, with the gains ``A_i = P H_i' R_i^-1``.

    Parameters
    ----------
    paths : Paths
    window : MeasurementWindow
        Window that holds their hits.
    stamp, sensor
        As in `fit_states`.
    process_noise : float, optional
        q, m^2/s^3.

    Returns
    -------
    state : (n, 4) ndarray
    covariance : (n, 4, 4) ndarray
    """
    state, covariance = np.zeros((len(paths), 4)), np.zeros((len(paths), 4, 4))
    for rows, hits in paths.of_equal_count():
        fitted = fit_states(window[hits], stamp, sensor, "weighted")
        state[rows], covariance[rows] = fitted.state, fitted.covariance
        if process_noise:
            after, of_hits = fitted.time_after_state, fitted.covariance[:, None]
            gain = of_hits[..., 0::2] + after[..., None, None] * of_hits[..., 1::2]
            gain = gain @ inverse_covariance_or_nan(fitted.hit_covariance)
            near, far = (
                np.maximum(of_pair(-after[:, :, None], -after[:, None]), 0.0)
                for of_pair in (np.minimum, np.maximum)
            )
            moved = process_noise * near**2 * (3.0 * far - near) / 6.0
            covariance[rows] += np.einsum("niap,nik,nkbp->nab", gain, moved, gain)
    return state, covariance


def figures_of_hits(
    window: MeasurementWindow,
    hits: NDArray[np.object_],
    stamp: FloatArray,
    state: FloatArray,
    position_sigma: FloatArray,
) -> tuple[FloatArray, tuple[FloatArray, FloatArray], FloatArray]:
    """Misfits, amplitudes and last errors of new tracks, by those of their hits in the window.

    Parameters
    ----------
    window : MeasurementWindow
    hits : sequence of sequence of (int, int)
        Those of each of n tracks, as in `ConfirmedTrack.hits`.
    stamp, state, position_sigma : (n,), (n, 4), (n,) ndarray
        Of the tracks; the standard deviation of the position along its major axis, m.

    Returns
    -------
    misfit : (n,) ndarray
        Factors by which the covariances of the tracks are too small for their hits. The squared
        distance of h hits from their track has 2 h - 4 degrees of freedom. Where it is beyond
        their `GATE_PROBABILITY`, it is divided by them (Birge's ratio); else the factor is 1.
    amplitudes : tuple of (n,) ndarray
        Number of hits with an amplitude, and the sum of their normalised amplitudes.
    hit_sigma : (n,) ndarray
        Standard deviation of the last hit along its major axis, m; `position_sigma` where the hit
        is forgotten.
    """
    n = len(hits)
    track, ids = window.find(hits)
    in_window, hit_sigma = window[ids], position_sigma.copy()
    hit_sigma[track] = major_sigma(in_window["covariance"])  # the last of each track stays
    known = np.isfinite(in_window["amplitude"])
    number, total = (
        np.asarray(np.bincount(track, values, n), float)
        for values in (known, np.where(known, in_window["amplitude"], 0.0))
    )
    elapsed = in_window["time"] - stamp[track]
    residual = in_window["position"] - motion.position_after(state[track], elapsed)
    square = np.bincount(
        track, squared_mahalanobis_distance(residual, in_window["covariance"]), n
    ).astype(float)
    freedom = 2.0 * np.bincount(track, minlength=n) - 4.0
    bad = (freedom > 0.0) & (square > chdtri(np.maximum(freedom, 1.0), 1.0 - GATE_PROBABILITY))
    return np.where(bad, square / np.maximum(freedom, 1.0), 1.0), (number, total), hit_sigma


def unweighted_fit(
    time_after_state: FloatArray, positions: FloatArray, covariances: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Unweighted least squares with the sandwich covariance.

    ``X = (H'H)^-1 H'Z`` (Eq. 19), ``P = (H'H)^-1 H'RH (H'H)^-1`` (Eq. 20). The axes share the
    times, so both reduce to the straight-line weights of position and velocity.

    Parameters
    ----------
    time_after_state : (n, m) ndarray
        s.
    positions : (n, m, 2) ndarray
        m.
    covariances : (n, m, 2, 2) ndarray
        R_i, m^2.

    Returns
    -------
    state : (n, 4) ndarray
    covariance : (n, 4, 4) ndarray
    """
    n, m = time_after_state.shape
    mean = time_after_state.mean(axis=1, keepdims=True)
    centred = time_after_state - mean
    with np.errstate(invalid="ignore", divide="ignore"):  # equal times: no fit, nan
        slope = centred / np.square(centred).sum(axis=1, keepdims=True)
    weights = np.stack([1.0 / m - mean * slope, slope], axis=1)  # (n, 2, m): position, velocity
    state = np.swapaxes(weights @ positions, 1, 2).reshape(n, 4)
    products = (weights[:, :, None] * weights[:, None, :]).reshape(n, 4, m)
    blocks = (products @ covariances.reshape(n, m, 4)).reshape(n, 2, 2, 2, 2)  # a, b, p, q
    return state, blocks.transpose(0, 3, 1, 4, 2).reshape(n, 4, 4)


def weighted_fit(
    time_after_state: FloatArray, positions: FloatArray, covariances: FloatArray, start: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Weighted least squares: ``P = (H'R^-1 H)^-1``, ``X = P H'R^-1 Z``.

    Parameters
    ----------
    time_after_state, positions, covariances
        As in `unweighted_fit`.
    start : (n, 4) ndarray
        Any state near the solution. The fit solves for the correction to it, so that large map
        coordinates cost no digits.

    Returns
    -------
    state : (n, 4) ndarray
    covariance : (n, 4, 4) ndarray
    """
    information = inverse_covariance_or_nan(covariances)  # (n, m, 2, 2)
    residual = positions - motion.position_after(start[:, None], time_after_state)
    weighted_residual = (information @ residual[..., None])[..., 0]
    n = len(time_after_state)
    powers = np.stack(
        [np.ones_like(time_after_state), time_after_state, np.square(time_after_state)], axis=1
    )  # (n, 3, m)
    moments = np.einsum("nem,nmpq->nepq", powers, information)
    order = np.add.outer([0, 1], [0, 1])  # t^a t^b = t^(a + b)
    normal = moments[:, order].transpose(0, 3, 1, 4, 2).reshape(n, 4, 4)
    right = np.einsum("nam,nmp->npa", powers[:, :2], weighted_residual).reshape(n, 4)
    covariance = inverse_covariance_or_nan(normal)
    covariance = 0.5 * (covariance + np.swapaxes(covariance, 1, 2))
    return start + (covariance @ right[..., None])[..., 0], covariance
