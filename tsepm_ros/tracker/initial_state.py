"""Paths of detections, and the state fitted to a path.

Paths through the tree of splits, as arrays.

Initial state and covariance from hits (TSEPM 2018, Section 3.3, Eqs. 12-20).

Least squares on the hits' positions, or maximum likelihood on their ranges and azimuths. The state
is ``[x, vx, y, vy]``; hit i at ``t_i`` seconds after the state's time is at ``H_i X``,
``H_i = [[1, t_i, 0, 0], [0, 0, 1, t_i]]`` (Eqs. 16-18). All functions take a batch of n tracks
with m hits each.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from tsepm_ros.numerics.arrays import FloatArray, IntArray, Rows, changed, taken
from tsepm_ros.numerics.gaussian import inverse_or_nan, squared_distance
from tsepm_ros.tracker import range_rates
from tsepm_ros.tracker.detection_window import DetectionWindow
from tsepm_ros.tracker.measurement import (
    covariance_at,
    major_sigma,
    measured_polar,
    pose_error_covariance,
    range_variance_at,
)
from tsepm_ros.tracker.scan import wrap
from tsepm_ros.tracker.sensor import SensorModel

NO_HIT = -1
MAX_ROWS_TOGETHER = 16_384
"""Paths processed together: bounds memory and fits into the processor's cache."""


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
        return self.hits[np.arange(len(self)), self.hit_count - 1]

    def extended(self, parent: IntArray, detection: IntArray) -> Self:
        """Children with a further detection each: row i extends path `parent[i]`."""
        children = self[parent]
        children.hits[np.arange(len(parent)), children.hit_count] = detection
        return changed(children, hit_count=children.hit_count + 1)

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


def starting(detection: IntArray, scan_index: int, max_hits: int) -> Paths:
    """New paths of a single hit, with space for `max_hits` hits (Step 8)."""
    hits = np.full((len(detection), max_hits), NO_HIT, np.int64)
    hits[:, 0] = detection
    count = np.ones(len(detection), np.int64)
    return Paths(hits, count, np.full(len(detection), scan_index, np.int64))


ESTIMATORS = ("unweighted", "weighted", "polar")
WEIGHTED_PASSES = 2
POLAR_PASSES = 10
POLAR_TOLERANCE = 1e-3
"""Largest correction of a converged polar fit, in standard deviations of each component."""
GOOD_FIT = 0.99
"""Probability up to which the squared distance of hits from their track is no misfit."""
MIN_SENSOR_DISTANCE = 3.0
"""Smallest distance of a hit from its sensor for a polar fit, in standard deviations of the fit."""


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
        Covariance of each hit's position in the fit, m^2; for a polar fit, evaluated at its state.
    """

    state: FloatArray
    covariance: FloatArray
    time_after_state: FloatArray
    hit_covariance: FloatArray


def fit(hits: NDArray[np.void], stamp: float, sensor: SensorModel, estimator: str) -> Fit:
    """Fit the state at `stamp` to the hits of each track.

    Parameters
    ----------
    hits : (n, m) ndarray of DETECTION
        The hits of n tracks, m >= 2 at different times.
    stamp : float
        Time of the state, s.
    sensor : SensorModel
        Range errors, for the weighted and the polar fit.
    estimator : {"unweighted", "weighted", "polar"}
        As published (Eqs. 19-20); weighted with R re-evaluated at the fit, in two passes; or
        maximum likelihood of ranges and azimuths, starting from the weighted fit (see `polar`).

    Returns
    -------
    Fit

    Notes
    -----
    Range rates are processed last, as further measurements after the fit to the positions
    (`range_rates.fitted`).

    R at a fit is rotated by the fit's own azimuth error. Where ``r s_a^2`` is not small compared
    with s_r, the covariance is therefore too small: for 5 hits at 5 km, 10 m and 2 (3) degrees the
    mean NEES is 4.3 (4.8) for the weighted fit and 4.3 (5.4) for the polar fit; it is 4.0 for the
    fit weighted with R at the true positions.
    """
    by_position = _fit_positions(hits, stamp, sensor, estimator)
    time_after_state = by_position.time_after_state
    state, covariance = range_rates.fitted(
        by_position.state, by_position.covariance, time_after_state, hits
    )
    return Fit(state, covariance, time_after_state, by_position.hit_covariance)


def fit_paths(
    paths: Paths, window: DetectionWindow, stamp: float, sensor: SensorModel, estimator: str
) -> tuple[FloatArray, FloatArray]:
    """Fit the states of paths with different numbers of hits, at least two each.

    Parameters
    ----------
    paths : Paths
    window : DetectionWindow
        Window that holds their hits.
    stamp, sensor, estimator
        As in `fit`.

    Returns
    -------
    state : (n, 4) ndarray
    covariance : (n, 4, 4) ndarray
    """
    state, covariance = np.zeros((len(paths), 4)), np.zeros((len(paths), 4, 4))
    for rows, hits in paths.of_equal_count():
        fitted = fit(window[hits], stamp, sensor, estimator)
        state[rows], covariance[rows] = fitted.state, fitted.covariance
    return state, covariance


def figures_of_hits(
    window: DetectionWindow,
    hits: Sequence[Sequence[tuple[int, int]]],
    stamp: FloatArray,
    state: FloatArray,
    position_sigma: FloatArray,
) -> tuple[FloatArray, tuple[FloatArray, FloatArray], FloatArray]:
    """Misfits, strengths and last errors of new tracks, by those of their hits in the window.

    Parameters
    ----------
    window : DetectionWindow
    hits : sequence of sequence of (int, int)
        Those of each of n tracks, as in `ConfirmedTrack.hits`.
    stamp, state, position_sigma : (n,), (n, 4), (n,) ndarray
        Of the tracks; the standard deviation of the position along its major axis, m.

    Returns
    -------
    misfit : (n,) ndarray
        Factors by which the covariances of the tracks are too small for their hits. The squared
        distance of h hits from their track has 2 h - 4 degrees of freedom. Where it is beyond
        their `GOOD_FIT`, it is divided by them (Birge's ratio); else the factor is 1.
    strengths : tuple of (n,) ndarray
        Number of hits with a strength, and the sum of their exponents.
    hit_sigma : (n,) ndarray
        Standard deviation of the last hit along its major axis, m; `position_sigma` where the hit
        is forgotten.
    """
    misfit, hit_sigma = np.ones(len(hits)), position_sigma.copy()
    strength_hits, strength_total = np.zeros((2, len(hits)))
    for track, ids in enumerate(map(window.find, hits)):
        if not len(ids):
            continue
        found = window[ids]
        strength = found["strength"][np.isfinite(found["strength"])]
        strength_hits[track], strength_total[track] = len(strength), strength.sum()
        hit_sigma[track] = major_sigma(found["covariance"][-1:])[0]
        freedom = 2 * len(ids) - 4
        if freedom > 0:
            elapsed = found["time"][:, None] - stamp[track]
            expected = state[track, 0::2] + elapsed * state[track, 1::2]
            square = squared_distance(found["position"] - expected, found["covariance"]).sum()
            if square > chdtri(freedom, 1.0 - GOOD_FIT):
                misfit[track] = square / freedom
    return misfit, (strength_hits, strength_total), hit_sigma


def _fit_positions(
    hits: NDArray[np.void], stamp: float, sensor: SensorModel, estimator: str
) -> Fit:
    """Fit to the positions alone."""
    time_after_state = hits["time"] - stamp
    measured = hits["covariance"]
    state, covariance = unweighted(time_after_state, hits["position"], measured)
    if estimator == "unweighted":
        return Fit(state, covariance, time_after_state, measured)
    at_fit = measured
    for _ in range(WEIGHTED_PASSES):
        at_fit = covariance_at(hits, positions_at(state, time_after_state), sensor)
        state, covariance = weighted(time_after_state, hits["position"], at_fit, state)
    fitted = Fit(state, covariance, time_after_state, at_fit)
    return polar(hits, fitted, sensor) if estimator == "polar" else fitted


def unweighted(
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


def weighted(
    time_after_state: FloatArray, positions: FloatArray, covariances: FloatArray, start: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Weighted least squares: ``P = (H'R^-1 H)^-1``, ``X = P H'R^-1 Z``.

    Parameters
    ----------
    time_after_state, positions, covariances
        As in `unweighted`.
    start : (n, 4) ndarray
        Any state near the solution. The fit solves for the correction to it, so that large map
        coordinates cost no digits.

    Returns
    -------
    state : (n, 4) ndarray
    covariance : (n, 4, 4) ndarray
    """
    information = inverse_or_nan(covariances)  # (n, m, 2, 2)
    residual = positions - positions_at(start, time_after_state)
    weighted_residual = (information @ residual[..., None])[..., 0]
    correction, covariance = _solve(time_after_state, information, weighted_residual)
    return start + correction, covariance


@np.errstate(invalid="ignore", divide="ignore")  # no fit: nan, never converged
def polar(hits: NDArray[np.void], start: Fit, sensor: SensorModel) -> Fit:
    """Maximum likelihood of the measured ranges and azimuths, by Fisher scoring.

    A hit measures ``y = (r, a)``, expected at ``h(X)`` with covariance ``S = diag(s_r^2, s_a^2)``
    plus the covariance of an uncertain sensor pose. dS contains only the growth of s_r with range.
    With ``e = y - h(X)``::

        l(X) = -1/2 sum (e' S^-1 e + ln det S)
        I    = sum (dh' S^-1 dh + 1/2 tr(S^-1 dS S^-1 dS))    (Kay 1993, Eq. 3.31)
        X   <- X + I^-1 dl/dX,   P = I^-1

    A track keeps its start if `POLAR_PASSES` corrections do not converge, or if range and azimuth
    are far from linear over its covariance, which makes P much too small: the track passes its
    sensor too closely, or the arc is deeper than the range error.

    Parameters
    ----------
    hits : (n, m) ndarray of DETECTION
        The hits of n tracks.
    start : Fit
        A fit near the solution: the weighted fit.
    sensor : SensorModel
        Range errors of hits without their own.

    Returns
    -------
    Fit
    """
    state, covariance = start.state.copy(), start.covariance.copy()
    hit_covariance = start.hit_covariance.copy()
    rows, current, current_covariance = np.arange(len(hits)), start.state, start.covariance
    for _ in range(POLAR_PASSES):
        linear = _nearly_linear(
            taken(hits, rows), start.time_after_state[rows], current, current_covariance, sensor
        )
        rows, current = rows[linear], current[linear]
        if not len(rows):
            break
        time_after_state = start.time_after_state[rows]
        correction, current_covariance = _solve(
            time_after_state,
            *_polar_information(taken(hits, rows), positions_at(current, time_after_state), sensor),
        )
        current = current + correction
        sigma = np.sqrt(np.diagonal(current_covariance, axis1=1, axis2=2))
        done = (np.abs(correction) <= POLAR_TOLERANCE * sigma).all(axis=1)
        converged = rows[done]
        state[converged], covariance[converged] = current[done], current_covariance[done]
        hit_covariance[converged] = covariance_at(
            taken(hits, converged), positions_at(current[done], time_after_state[done]), sensor
        )
        rows, current = rows[~done], current[~done]
        current_covariance = current_covariance[~done]
    return Fit(state, covariance, start.time_after_state, hit_covariance)


def _nearly_linear(
    hits: NDArray[np.void],
    time_after_state: FloatArray,
    state: FloatArray,
    covariance: FloatArray,
    sensor: SensorModel,
) -> NDArray[np.bool_]:
    """Which of n tracks have nearly linear ranges and azimuths in their states, (n,).

    Over a position's standard deviation s, at range r, the azimuth turns by up to s/r and the arc
    departs from its tangent by s^2 / 2r, which is compared with the range's standard deviation.
    """
    offset = positions_at(state, time_after_state) - hits["sensor_pose"][..., :2]
    range_ = np.hypot(offset[..., 0], offset[..., 1])
    sigma = major_sigma(position_covariances_at(covariance, time_after_state))
    depth = 0.5 * np.square(sigma)
    linear = range_ > MIN_SENSOR_DISTANCE * sigma
    linear &= depth < range_ * np.sqrt(range_variance_at(hits, range_, sensor))
    return linear.all(axis=1)


def _polar_information(
    hits: NDArray[np.void], positions: FloatArray, sensor: SensorModel
) -> tuple[FloatArray, FloatArray]:
    """Fisher information on each hit's position, and the gradient of its log-likelihood.

    Parameters
    ----------
    hits : (n, m) ndarray of DETECTION
    positions : (n, m, 2) ndarray
        Positions at which the likelihood is evaluated, m.
    sensor : SensorModel
        Range errors of hits without their own.

    Returns
    -------
    information : (n, m, 2, 2) ndarray
        1/m^2.
    gradient : (n, m, 2) ndarray
        1/m.
    """
    offset = positions - hits["sensor_pose"][..., :2]
    x, y = offset[..., 0], offset[..., 1]
    range_ = np.hypot(x, y)
    cosine, sine = x / range_, y / range_
    jacobian = np.stack([cosine, sine, -sine / range_, cosine / range_], axis=-1)
    jacobian = jacobian.reshape(*range_.shape, 2, 2)  # of range and azimuth by position
    across = np.swapaxes(jacobian, -1, -2)
    covariance = jacobian @ pose_error_covariance(offset, hits["sensor_pose_covariance"]) @ across
    along = range_variance_at(hits, range_, sensor)
    covariance[..., 0, 0] += along
    covariance[..., 1, 1] += np.maximum(
        np.square(hits["azimuth_std"]), hits["least_across"] * along / np.square(range_)
    )
    information = inverse_or_nan(covariance)
    measured_range, measured_azimuth = measured_polar(hits)
    error = np.stack([measured_range - range_, wrap(measured_azimuth - np.arctan2(y, x))], axis=-1)
    gradient = (information @ error[..., None])[..., 0]
    # Information in the size of a range error, where its standard deviation grows with range.
    slope = np.where(np.isnan(hits["range_std"]), sensor.range_variance_slope(range_), 0.0)
    of_range = information[..., 0, 0].copy()
    gradient[..., 0] += 0.5 * slope * (np.square(gradient[..., 0]) - of_range)
    information[..., 0, 0] += 0.5 * np.square(slope * of_range)
    return across @ information @ jacobian, (across @ gradient[..., None])[..., 0]


def _solve(
    time_after_state: FloatArray, information: FloatArray, gradient: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Correction to the states and its covariance, from the information of each hit.

    ``P = (sum H_i' J_i H_i)^-1``, ``dX = P sum H_i' g_i``

    Parameters
    ----------
    time_after_state : (n, m) ndarray
        s.
    information : (n, m, 2, 2) ndarray
        J_i, 1/m^2.
    gradient : (n, m, 2) ndarray
        g_i: J_i times the residual, or the gradient of a log-likelihood, 1/m.

    Returns
    -------
    correction : (n, 4) ndarray
    covariance : (n, 4, 4) ndarray
    """
    n = len(time_after_state)
    powers = np.stack(
        [np.ones_like(time_after_state), time_after_state, np.square(time_after_state)], axis=1
    )  # (n, 3, m)
    moments = np.einsum("nem,nmpq->nepq", powers, information)
    order = np.add.outer([0, 1], [0, 1])  # t^a t^b = t^(a + b)
    normal = moments[:, order].transpose(0, 3, 1, 4, 2).reshape(n, 4, 4)
    right = np.einsum("nam,nmp->npa", powers[:, :2], gradient).reshape(n, 4)
    covariance = inverse_or_nan(normal)
    covariance = 0.5 * (covariance + np.swapaxes(covariance, 1, 2))
    return (covariance @ right[..., None])[..., 0], covariance


def positions_at(state: FloatArray, time_after_state: FloatArray) -> FloatArray:
    """Position of each (n, 4) state at its m times, (n, m, 2), m."""
    return state[:, None, 0::2] + time_after_state[:, :, None] * state[:, None, 1::2]


def position_covariances_at(covariance: FloatArray, time_after_state: FloatArray) -> FloatArray:
    """Position covariance H_k P_k H_k' of each (n, 4, 4) at its m times, (n, m, 2, 2), m^2."""
    t = time_after_state[:, :, None, None]
    cross = covariance[:, None, 0::2, 1::2]
    return (
        covariance[:, None, 0::2, 0::2]
        + t * (cross + np.swapaxes(cross, -1, -2))
        + t * t * covariance[:, None, 1::2, 1::2]
    )
