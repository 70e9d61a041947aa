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
"""Range rates, measured by the Doppler shift.

A detection at the position p, received by a sensor at s that moves with w, measures
``c = u.(v - w)``, u the unit vector from s to p and v the target's velocity; positive where the
range grows. Where `sensor.range_rate_std` is above 0, the range rates of detections are used after
their positions: as a scalar update of a filter, or as further rows of a fit. For their bias and
their benefit over positions alone see Bar-Shalom, "Negative correlation and optimal tracking with
Doppler measurements", IEEE Trans. Aerosp. Electron. Syst. 37(3), 2001.
"""

from __future__ import annotations

import numpy as np
from scipy.special import chdtri

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, RecordArray, rows_of
from tsepm_ros.numerics.gaussian import inverse_covariance_or_nan
from tsepm_ros.tracker.scan import MAX_MAGNITUDE, Scan
from tsepm_ros.tracker.sensor import SensorModel

MIN_DISTANCE = 1e-3
"""Lower bound of the distance from the sensor in the line of sight's rate of turn, m."""


def take(detections: RecordArray, scan: Scan, sensor: SensorModel) -> None:
    """Store a scan's range rates in its detections (n,), if the sensor uses them."""
    detections["sensor_velocity"] = scan.sensor_velocity
    rate = scan.features.get("range_rate")
    if rate is None or not sensor.range_rate_std:
        return
    usable = np.abs(rate) <= MAX_MAGNITUDE["range_rate"]  # and not nan
    detections["range_rate"][usable] = rate[usable]
    detections["range_rate_std"][usable] = sensor.range_rate_std


def measured(detections: RecordArray) -> BoolArray:
    """Which detections have a range rate that is used, (...)."""
    return np.asarray(detections["range_rate_std"] > 0.0)


def expected(
    detections: RecordArray, position: FloatArray, velocity: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Expected range rates of targets, and their gradients.

    ``c = u.(v - w)``, ``dc/dp = (v - w - c u) / |p - s|``, ``dc/dv = u``

    Parameters
    ----------
    detections : (...) ndarray of DETECTION
        Their sensors are at s and move with w.
    position, velocity : (..., 2) ndarray
        p and v, m and m/s.

    Returns
    -------
    rate : (...) ndarray
        m/s.
    by_position, by_velocity : (..., 2) ndarray
        1/s and 1.
    """
    sight, distance = _sight(detections, position)
    relative = velocity - detections["sensor_velocity"]
    rate = (sight * relative).sum(axis=-1)
    return rate, (relative - rate[..., None] * sight) / distance[..., None], sight


def _sight(detections: RecordArray, position: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unit vectors from the sensors to positions, (..., 2), and the distances, (...), m."""
    offset = position - detections["sensor_pose"][..., :2]
    distance = np.maximum(np.hypot(offset[..., 0], offset[..., 1]), MIN_DISTANCE)
    return offset / distance[..., None], distance


def clutter_density(detections: RecordArray, sensor: SensorModel) -> FloatArray:
    """Density of the detections' range rates among false ones, (n,), s/m; 1 without a range rate.

    A Cauchy density of the range rate c beside that of the clutter's drift over ground,
    ``a / (pi (a^2 + c^2))``: half of the false detections are within a =
    `sensor.clutter_range_rate`, the width of reverberation. The heavy tails cover noise; they limit
    the score increment of any range rate.
    """
    rated, width = measured(detections), sensor.clutter_range_rate
    if not rated.any():
        return np.ones(len(detections))
    drift, _, _ = expected(detections, detections["position"], detections["clutter_velocity"])
    density = width / (np.pi * (width**2 + np.square(detections["range_rate"] - drift)))
    return np.where(rated, density, 1.0)


def innovations(
    state: FloatArray,
    covariance: FloatArray,
    time_after_state: FloatArray,
    detections: RecordArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Innovations of range rates, against states updated with the detections' positions.

    Parameters
    ----------
    state : (n, 4) ndarray
    covariance : (n, 4, 4) ndarray
    time_after_state : (n,) ndarray
        Time of each detection after its state's, s.
    detections : (n,) ndarray of DETECTION

    Returns
    -------
    innovation : (n,) ndarray
        m/s.
    innovation_variance : (n,) ndarray
        m^2/s^2.
    cross : (n, 4) ndarray
        Covariance of state and innovation.
    """
    velocity = state[:, 1::2]
    position = state[:, 0::2] + time_after_state[:, None] * velocity
    rate, by_position, sight = expected(detections, position, velocity)
    gradient = _gradients(time_after_state, by_position, sight)
    cross = (covariance @ gradient[..., None])[..., 0]
    bias, curvature = _curvature(
        covariance,
        time_after_state[:, None],
        sight[:, None],
        _sight(detections, position)[1][:, None],
    )
    variance = (gradient * cross).sum(axis=1) + np.square(detections["range_rate_std"])
    return detections["range_rate"] - rate - bias[:, 0], variance + curvature[:, 0, 0], cross


def _curvature(
    covariance: FloatArray, time_after_state: FloatArray, sight: FloatArray, distance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Mean and covariance of the linearisation errors of range rates, to second order.

    An error dp of the position across the line of sight turns u by ``dp / r``. With the error dv of
    the velocity in the same direction the range rate is wrong by ``dp dv / r``. With the
    covariances A of the dp, B of the dv and C between them, at m times, the means are
    ``C_ii / r_i`` and the covariances ``(A_ij B_ij + C_ij C_ji) / (r_i r_j)`` (Bar-Shalom, Li,
    Kirubarajan 2001, section 10.3.2).

    Parameters
    ----------
    covariance : (n, 4, 4) ndarray
        Covariance of each state.
    time_after_state : (n, m) ndarray
        Times after the states', s.
    sight : (n, m, 2) ndarray
        u.
    distance : (n, m) ndarray
        r, m.

    Returns
    -------
    mean : (n, m) ndarray
        m/s.
    covariance : (n, m, m) ndarray
        m^2/s^2.
    """
    across = np.stack([-sight[..., 1], sight[..., 0]], axis=-1) / np.sqrt(distance)[..., None]
    by_position = _gradients(time_after_state, across, 0.0 * across)
    by_velocity = _gradients(0.0 * time_after_state, 0.0 * across, across)
    cross = by_position @ covariance
    a = cross @ np.swapaxes(by_position, 1, 2)
    c = cross @ np.swapaxes(by_velocity, 1, 2)
    b = by_velocity @ covariance @ np.swapaxes(by_velocity, 1, 2)
    return np.diagonal(c, axis1=1, axis2=2), a * b + c * np.swapaxes(c, 1, 2)


def _gradients(
    time_after_state: FloatArray, by_position: FloatArray, by_velocity: FloatArray
) -> FloatArray:
    """Gradients by states ``[x, vx, y, vy]`` a time (...) before, (..., 4)."""
    gradient = np.empty((*time_after_state.shape, 4))
    gradient[..., 0::2] = by_position
    gradient[..., 1::2] = by_velocity + time_after_state[..., None] * by_position
    return gradient


def update(
    state: FloatArray,
    covariance: FloatArray,
    time_after_state: FloatArray,
    detections: RecordArray,
) -> tuple[FloatArray, FloatArray]:
    """Update states with the range rates of detections, after their positions.

    ``x + k e / S``, ``P - k k' / S`` with k the covariance of state and innovation e. Arguments as
    in `innovations`; a state without a range rate stays the same.

    Returns
    -------
    state : (n, 4) ndarray
    covariance : (n, 4, 4) ndarray
    """
    rows = measured(detections).nonzero()[0]
    if not len(rows):
        return state, covariance
    innovation, variance, cross = innovations(
        state[rows], covariance[rows], time_after_state[rows], rows_of(detections, rows)
    )
    state, covariance = state.copy(), covariance.copy()
    state[rows] += cross * (innovation / variance)[:, None]
    covariance[rows] -= cross[:, :, None] * cross[:, None, :] / variance[:, None, None]
    return state, covariance


def begun(
    state: FloatArray, covariance: FloatArray, detections: RecordArray, sensor: SensorModel
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Update initial states with the range rates of their first detections.

    Parameters
    ----------
    state : (n, 4) ndarray
        At the detections' times, with unknown velocity.
    covariance : (n, 4, 4) ndarray
    detections : (n,) ndarray of DETECTION
    sensor : SensorModel

    Returns
    -------
    state : (n, 4) ndarray
    covariance : (n, 4, 4) ndarray
    increment : (n,) ndarray
        ``ln(N(e; 0, S) / p(c))``, the score increment of each range rate; 0 without a range rate.
    """
    increment, now = np.zeros(len(detections)), np.zeros(len(detections))
    rows = measured(detections).nonzero()[0]
    if not len(rows):
        return state, covariance, increment
    rated = rows_of(detections, rows)
    innovation, variance, _ = innovations(state[rows], covariance[rows], now[rows], rated)
    increment[rows] = log_density(innovation, variance) - np.log(clutter_density(rated, sensor))
    return *update(state, covariance, now, detections), increment


def log_density(innovation: FloatArray, variance: FloatArray) -> FloatArray:
    """``ln N(e; 0, S)`` of innovations (n,) of variances (n,), ln of s/m."""
    return np.asarray(-0.5 * (innovation**2 / variance + np.log(2.0 * np.pi * variance)))


def gate_square(probability: float) -> float:
    """Squared distance that holds a position and a range rate with a probability.

    The quantile of chi-square with three degrees of freedom.
    """
    return float(chdtri(3.0, 1.0 - probability))


def fit(
    state: FloatArray, covariance: FloatArray, time_after_state: FloatArray, hits: RecordArray
) -> tuple[FloatArray, FloatArray]:
    """Fit states to the hits' range rates, after a fit to their positions.

    The fit to the positions, X_0 with P_0, counts as one measurement, the range rates z with S as
    further measurements. Each pass linearises them over the state's current covariance (posterior
    linearisation; Garcia-Fernandez et al., "Posterior linearization filter", IEEE Trans. Signal
    Process. 63(20), 2015). J is the gradient at X; the linearisation errors, of mean m and
    covariance W (`_curvature`), are noise::

        K = P_0 J' (J P_0 J' + S + W)^-1
        X <- X_0 + K (z - h(X) - m - J (X_0 - X)),    P <- P_0 - K J P_0

    Without W this is Gauss-Newton. Its P is too small where accurate range rates determine the
    speed across the line of sight by their change.

    Parameters
    ----------
    state : (n, 4) ndarray
    covariance : (n, 4, 4) ndarray
    time_after_state : (n, m) ndarray
        Time of each hit after the state's, s.
    hits : (n, m) ndarray of DETECTION

    Returns
    -------
    state : (n, 4) ndarray
    covariance : (n, 4, 4) ndarray
    """
    rated = measured(hits)
    rows = np.flatnonzero(rated.any(axis=1) & np.isfinite(covariance).all(axis=(1, 2)))
    if not len(rows):
        return state, covariance
    rated, hits, time_after_state = (
        rated[rows],
        rows_of(hits, rows),
        time_after_state[rows],
    )
    prior, prior_covariance = state[rows], covariance[rows]
    # A hit without a range rate has a row of zeros; its variance has no effect.
    noise = np.where(rated, np.square(hits["range_rate_std"]), 1.0)[..., None] * np.eye(
        rated.shape[1]
    )
    both = rated[:, :, None] & rated[:, None, :]
    current, current_covariance = prior, prior_covariance
    for _ in range(2):  # linearisations
        velocity = np.broadcast_to(current[:, None, 1::2], (*time_after_state.shape, 2))
        position = current[:, None, 0::2] + time_after_state[..., None] * velocity
        rate, by_position, sight = expected(hits, position, velocity)
        distance = _sight(hits, position)[1]
        bias, curvature = _curvature(current_covariance, time_after_state, sight, distance)
        jacobian = _gradients(time_after_state, by_position, sight) * rated[..., None]
        cross = prior_covariance @ np.swapaxes(jacobian, 1, 2)
        gain = cross @ inverse_covariance_or_nan(jacobian @ cross + noise + curvature * both)
        innovation = np.where(rated, hits["range_rate"] - rate - bias, 0.0)[..., None]
        innovation = innovation - jacobian @ (prior - current)[..., None]
        current = prior + (gain @ innovation)[..., 0]
        current_covariance = prior_covariance - gain @ np.swapaxes(cross, 1, 2)
        current_covariance = 0.5 * (current_covariance + np.swapaxes(current_covariance, 1, 2))
    state, covariance = state.copy(), covariance.copy()
    state[rows] = current
    covariance[rows] = current_covariance
    return state, covariance


def agree(
    first: RecordArray,
    second: RecordArray,
    max_speed: float,
    gate: float,
) -> BoolArray:
    """Whether the range rates of pairs of detections agree with one target; true without them.

    The two range rates over ground, ``c + u.w``, differ by their errors and the turn of the line of
    sight. The displacement along it is their mean times the time t between the detections. With
    independent errors, and v_max^2 / 4 as the velocity's variance where the line of sight turns,
    ``(c_2 - c_1)^2 / V + (u.(z_2 - z_1) - t (c_1 + c_2) / 2)^2 / (t^2 V / 4 + u'(R_1 + R_2) u)``
    has two degrees of freedom.

    Parameters
    ----------
    first, second : (p,) ndarray of DETECTION
    max_speed : float
        v_max, m/s.
    gate : float
        Largest squared distance of pairs that agree.

    Returns
    -------
    (p,) ndarray of bool
    """
    pair = (first, second)
    still, _, sights = zip(
        *(expected(one, one["position"], np.zeros(2)) for one in pair), strict=True
    )
    rates = [one["range_rate"] - rate for one, rate in zip(pair, still, strict=True)]
    variance = np.square(sights[1] - sights[0]).sum(axis=1) * (0.25 * max_speed**2)
    for detections in pair:
        square_speed = np.square(detections["sensor_velocity"]).sum(axis=1)
        by_azimuth = square_speed * np.square(detections["azimuth_std"])
        variance += np.square(detections["range_rate_std"]) + by_azimuth
    elapsed = second["time"] - first["time"]
    sight = sights[0] + sights[1]
    sight /= np.maximum(np.hypot(sight[:, 0], sight[:, 1]), MIN_DISTANCE)[:, None]
    displacement = (sight * (second["position"] - first["position"])).sum(axis=1)
    error = np.einsum("pi,pij,pj->p", sight, first["covariance"] + second["covariance"], sight)
    difference = displacement - 0.5 * elapsed * (rates[0] + rates[1])
    distance = np.square(rates[1] - rates[0]) / np.maximum(variance, np.finfo(float).tiny)
    distance += difference**2 / (0.25 * elapsed**2 * variance + error)
    return (distance <= gate) | ~(measured(first) & measured(second))
