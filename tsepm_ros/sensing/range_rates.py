"""Range rates: how fast a target comes closer or goes away, measured by the Doppler shift.

A detection at the position p, received by a sensor at s that moves with w, measures
``c = u.(v - w)``, u the unit vector from s to p and v the target's velocity; positive where the
range grows. It is used where `sensor.range_rate_std` is above 0 and the detection has one, after
the position: as a scalar update of a filter, or as further rows of a fit (for its bias and its
gain over positions alone see Bar-Shalom, "Negative correlation and optimal tracking with Doppler
measurements", IEEE Trans. Aerosp. Electron. Syst. 37(3), 2001).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from tsepm_ros.numerics.arrays import BoolArray, FloatArray
from tsepm_ros.sensing.scan import LARGEST, Scan
from tsepm_ros.sensing.sensor import SensorModel

LEAST_DISTANCE = 1e-3
"""Distance from the sensor below which the line of sight is not turned any faster, m."""
PASSES = 2
"""Linearisations of a fit."""


def take(detections: NDArray[np.void], scan: Scan, sensor: SensorModel) -> None:
    """Note a scan's range rates with its detections, (n,), where they are used and usable."""
    detections["sensor_velocity"] = scan.sensor_velocity
    rate = scan.features.get("range_rate")
    if rate is None or not sensor.range_rate_std:
        return
    usable = np.abs(rate) <= LARGEST["range_rate"]  # and not nan
    detections["range_rate"][usable] = rate[usable]
    detections["range_rate_std"][usable] = sensor.range_rate_std


def measured(detections: NDArray[np.void]) -> BoolArray:
    """Which detections have a range rate that counts, (...)."""
    has: BoolArray = detections["range_rate_std"] > 0.0
    return has


def expected(
    detections: NDArray[np.void], position: FloatArray, velocity: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Range rates of targets, and their gradients.

    ``c = u.(v - w)``, ``dc/dp = (v - w - c u) / |p - s|``, ``dc/dv = u``

    Parameters
    ----------
    detections : (...) ndarray of DETECTION
        Whose sensors are at s and move with w.
    position, velocity : (..., 2) ndarray
        p and v, m and m/s.

    Returns
    -------
    rate : (...) ndarray
        m/s.
    by_position, by_velocity : (..., 2) ndarray
        1/s and 1.
    """
    sight, distance = _line_of_sight(detections, position)
    relative = velocity - detections["sensor_velocity"]
    rate = (sight * relative).sum(axis=-1)
    return rate, (relative - rate[..., None] * sight) / distance[..., None], sight


def _line_of_sight(
    detections: NDArray[np.void], position: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Unit vectors from the sensors to positions, (..., 2), and the distances, (...), m."""
    offset = position - detections["sensor_pose"][..., :2]
    distance = np.maximum(np.hypot(offset[..., 0], offset[..., 1]), LEAST_DISTANCE)
    return offset / distance[..., None], distance


def over_ground(detections: NDArray[np.void]) -> FloatArray:
    """Range rates without the sensor's own motion, ``c + u.w`` with u as measured, (...), m/s."""
    sight, _ = _line_of_sight(detections, detections["position"])
    own = (sight * detections["sensor_velocity"]).sum(axis=-1)
    return np.asarray(detections["range_rate"] + own)


def clutter_density(detections: NDArray[np.void], sensor: SensorModel) -> FloatArray:
    """Density of the detections' range rates among false ones, (n,), s/m; 1 without a range rate.

    A Cauchy density of the range rate over ground, ``a / (pi (a^2 + c^2))``: half of the false
    detections are within a = `sensor.clutter_range_rate`, which is reverberation's spread, and
    what is noise has tails that no target's gain can run away from.
    """
    half = sensor.clutter_range_rate
    density = half / (np.pi * (half**2 + np.square(over_ground(detections))))
    return np.where(measured(detections), density, 1.0)


def innovations(
    state: FloatArray, covariance: FloatArray, lag: FloatArray, detections: NDArray[np.void]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """How far range rates are from those of states that know the detections' positions already.

    Parameters
    ----------
    state : (n, 4) ndarray
    covariance : (n, 4, 4) ndarray
    lag : (n,) ndarray
        Time of each detection after its state's, s.
    detections : (n,) ndarray of DETECTION

    Returns
    -------
    innovation : (n,) ndarray
        m/s.
    spread : (n,) ndarray
        Its variance, m^2/s^2.
    cross : (n, 4) ndarray
        Its covariance with the state.
    """
    velocity = state[:, 1::2]
    position = state[:, 0::2] + lag[:, None] * velocity
    rate, by_position, sight = expected(detections, position, velocity)
    row = _rows(lag, by_position, sight)
    cross = (covariance @ row[..., None])[..., 0]
    shift, curvature = _curvature(
        covariance, lag[:, None], sight[:, None], _line_of_sight(detections, position)[1][:, None]
    )
    spread = (row * cross).sum(axis=1) + np.square(detections["range_rate_std"])
    return detections["range_rate"] - rate - shift[:, 0], spread + curvature[:, 0, 0], cross


def _curvature(
    covariance: FloatArray, tau: FloatArray, sight: FloatArray, distance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """What linear range rates leave out: their mean and covariance, to second order.

    Across the line of sight an error dp of the position turns u by ``dp / r``, which takes in the
    error dv of the velocity there: ``dp dv / r``. With the covariances A of the dp, B of the dv
    and C between them, at m times, the means are ``C_ii / r_i`` and the covariances
    ``(A_ij B_ij + C_ij C_ji) / (r_i r_j)`` (Bar-Shalom, Li, Kirubarajan 2001, section 10.3.2).

    Parameters
    ----------
    covariance : (n, 4, 4) ndarray
        Of the states.
    tau : (n, m) ndarray
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
    turning, moving = _rows(tau, across, 0.0 * across), _rows(0.0 * tau, 0.0 * across, across)
    to_position = turning @ covariance
    a = to_position @ np.swapaxes(turning, 1, 2)
    c = to_position @ np.swapaxes(moving, 1, 2)
    b = moving @ covariance @ np.swapaxes(moving, 1, 2)
    return np.diagonal(c, axis1=1, axis2=2), a * b + c * np.swapaxes(c, 1, 2)


def _rows(lag: FloatArray, by_position: FloatArray, by_velocity: FloatArray) -> FloatArray:
    """Gradients by states ``[x, vx, y, vy]`` a time (...) before, (..., 4)."""
    row = np.empty((*lag.shape, 4))
    row[..., 0::2] = by_position
    row[..., 1::2] = by_velocity + lag[..., None] * by_position
    return row


def update(
    state: FloatArray, covariance: FloatArray, lag: FloatArray, detections: NDArray[np.void]
) -> tuple[FloatArray, FloatArray]:
    """Update states with the range rates of detections whose positions they know already.

    ``x + k e / S``, ``P - k k' / S`` with k the covariance of state and innovation e. Arguments as
    in `innovations`; without a range rate nothing changes.

    Returns
    -------
    state : (n, 4) ndarray
    covariance : (n, 4, 4) ndarray
    """
    has = np.flatnonzero(measured(detections))
    if not len(has):
        return state, covariance
    innovation, spread, cross = innovations(state[has], covariance[has], lag[has], detections[has])
    state, covariance = state.copy(), covariance.copy()
    state[has] += cross * (innovation / spread)[:, None]
    covariance[has] -= cross[:, :, None] * cross[:, None, :] / spread[:, None, None]
    return state, covariance


def begun(
    state: FloatArray, covariance: FloatArray, detections: NDArray[np.void], sensor: SensorModel
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """States that begin with detections, updated with their range rates.

    Parameters
    ----------
    state : (n, 4) ndarray
        At the detections' times, with no velocity known.
    covariance : (n, 4, 4) ndarray
    detections : (n,) ndarray of DETECTION
    sensor : SensorModel

    Returns
    -------
    state : (n, 4) ndarray
    covariance : (n, 4, 4) ndarray
    gain : (n,) ndarray
        ``ln(N(e; 0, S) / p(c))`` of each range rate for a target against clutter; 0 without one.
    """
    gain = np.zeros(len(detections))
    has = np.flatnonzero(measured(detections))
    if not len(has):
        return state, covariance, gain
    now, found = np.zeros(len(has)), detections[has]
    innovation, spread, _ = innovations(state[has], covariance[has], now, found)
    gain[has] = log_density(innovation, spread) - np.log(clutter_density(found, sensor))
    return *update(state, covariance, np.zeros(len(detections)), detections), gain


def log_density(innovation: FloatArray, spread: FloatArray) -> FloatArray:
    """``ln N(e; 0, S)`` of innovations (n,) of variances (n,), ln of s/m."""
    density: FloatArray = -0.5 * (innovation**2 / spread + np.log(2.0 * np.pi * spread))
    return density


def gate_square(probability: float) -> float:
    """Squared distance that holds a position and a range rate with a probability.

    The quantile of chi-square with three degrees of freedom.
    """
    return float(chdtri(3.0, 1.0 - probability))


def fitted(
    state: FloatArray, covariance: FloatArray, tau: FloatArray, hits: NDArray[np.void]
) -> tuple[FloatArray, FloatArray]:
    """States fitted to positions, fitted to the hits' range rates too.

    What the positions say, X_0 with P_0, counts as one measurement, the range rates z with S as
    others. In passes they are linearised over the state's own uncertainty (posterior
    linearisation; Garcia-Fernandez et al., "Posterior linearization filter", IEEE Trans. Signal
    Process. 63(20), 2015), J the gradient at X, and what this leaves out, of mean m and covariance
    W (`_curvature`), is noise::

        K = P_0 J' (J P_0 J' + S + W)^-1
        X <- X_0 + K (z - h(X) - m - J (X_0 - X)),    P <- P_0 - K J P_0

    Without W this were Gauss-Newton, whose P is too small where range rates are good enough to
    tell the speed across the line of sight by how fast that turns.

    Parameters
    ----------
    state : (n, 4) ndarray
    covariance : (n, 4, 4) ndarray
    tau : (n, m) ndarray
        Time of each hit after the state's, s.
    hits : (n, m) ndarray of DETECTION

    Returns
    -------
    state : (n, 4) ndarray
    covariance : (n, 4, 4) ndarray
    """
    has = measured(hits)
    rows = np.flatnonzero(has.any(axis=1) & np.isfinite(covariance).all(axis=(1, 2)))
    if not len(rows):
        return state, covariance
    has, hits, tau = has[rows], hits[rows], tau[rows]
    first, before = state[rows], covariance[rows]
    # A hit without a range rate has a row of zeros, whose variance does not matter.
    noise = np.where(has, np.square(hits["range_rate_std"]), 1.0)[..., None] * np.eye(has.shape[1])
    both = has[:, :, None] & has[:, None, :]
    current, spread = first, before
    for _ in range(PASSES):
        velocity = np.broadcast_to(current[:, None, 1::2], (*tau.shape, 2))
        position = current[:, None, 0::2] + tau[..., None] * velocity
        rate, by_position, sight = expected(hits, position, velocity)
        mean, left_out = _curvature(spread, tau, sight, _line_of_sight(hits, position)[1])
        jacobian = _rows(tau, by_position, sight) * has[..., None]
        cross = before @ np.swapaxes(jacobian, 1, 2)
        gain = cross @ np.linalg.inv(jacobian @ cross + noise + left_out * both)
        misfit = np.where(has, hits["range_rate"] - rate - mean, 0.0)[..., None]
        misfit = misfit - jacobian @ (first - current)[..., None]
        current = first + (gain @ misfit)[..., 0]
        spread = before - gain @ np.swapaxes(cross, 1, 2)
        spread = 0.5 * (spread + np.swapaxes(spread, 1, 2))
    state, covariance = state.copy(), covariance.copy()
    state[rows] = current
    covariance[rows] = spread
    return state, covariance


def agree(
    first: NDArray[np.void],
    second: NDArray[np.void],
    max_speed: float,
    gate: float,
) -> BoolArray:
    """Whether pairs of detections can be one target's by their range rates; all without them.

    Over ground the two rates are the same but for their errors and the turn of the line of sight,
    and the way along it is their mean over the time t between: with errors that are independent of
    each other, and v_max^2 / 4 as the velocity's variance where the line of sight turns,
    ``(c_2 - c_1)^2 / V + (u.(z_2 - z_1) - t (c_1 + c_2) / 2)^2 / (t^2 V / 4 + u'(R_1 + R_2) u)``
    is of two degrees of freedom.

    Parameters
    ----------
    first, second : (p,) ndarray of DETECTION
    max_speed : float
        v_max, m/s.
    gate : float
        Squared distance within which they agree.

    Returns
    -------
    (p,) ndarray of bool
    """
    pair = (first, second)
    rates = [over_ground(one) for one in pair]
    sights = [_line_of_sight(one, one["position"])[0] for one in pair]
    spread = np.square(sights[1] - sights[0]).sum(axis=1) * (0.25 * max_speed**2)
    for one in pair:
        turned = np.square(one["sensor_velocity"]).sum(axis=1) * np.square(one["azimuth_std"])
        spread += np.square(one["range_rate_std"]) + turned
    elapsed = second["time"] - first["time"]
    sight = sights[0] + sights[1]
    sight /= np.maximum(np.hypot(sight[:, 0], sight[:, 1]), LEAST_DISTANCE)[:, None]
    way = (sight * (second["position"] - first["position"])).sum(axis=1)
    error = np.einsum("pi,pij,pj->p", sight, first["covariance"] + second["covariance"], sight)
    ahead = way - 0.5 * elapsed * (rates[0] + rates[1])
    distance = np.square(rates[1] - rates[0]) / np.maximum(spread, np.finfo(float).tiny)
    distance += ahead**2 / (0.25 * elapsed**2 * spread + error)
    return (distance <= gate) | ~(measured(first) & measured(second))
