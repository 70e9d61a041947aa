"""Encounters of targets: the closest approach of two (Environment 2018, Section 2.2, Eqs. 1-9).

Shen Y., "The target tracking algorithm based on environment technology", ICOI 2018.

With the relative position r and velocity v of two targets on straight courses, the time until they
are closest, and their distance then, are ::

    T_cpa = -r.v / |v|^2,    d_cpa = |r + v T_cpa|

Readings
--------
- Eq. 9 gives the same time with absolute bars, ``R |cos(phi_r - theta)| / v_r``, which can never be
  negative. Here it is negative once the targets separate, as in Fig. 4 and its text.
- Eq. 2 prints the two products of its numerator without the minus between them, and its fraction
  upside down: as printed, phi_r is measured from the x axis; in the text and beside Eq. 8, from y.
- Without relative velocity the distance is constant; the time is then 0.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from tsepm_ros.kinematics import kalman
from tsepm_ros.numerics.arrays import FloatArray, IntArray
from tsepm_ros.sensing.conversion import major_sigma


def closest_approach(first: FloatArray, second: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Time until two targets are closest and their distance then (Eqs. 1-9).

    Parameters
    ----------
    first, second : (..., 4) ndarray
        States ``[x, vx, y, vy]`` at a common time.

    Returns
    -------
    time : (...) ndarray
        T_cpa, s; below 0 where they separate.
    distance : (...) ndarray
        m.
    """
    relative = second - first
    position, velocity = relative[..., 0::2], relative[..., 1::2]
    square = np.square(velocity).sum(axis=-1)
    approach = -(position * velocity).sum(axis=-1)
    time = np.divide(approach, square, out=np.zeros_like(square), where=square > 0.0)
    return time, distance_at(first, second, time)


def distance_at(first: FloatArray, second: FloatArray, time: FloatArray) -> FloatArray:
    """Distance of two targets (..., 4) after a time (...), s, on straight courses (Eq. 7); m."""
    relative = second - first
    position = relative[..., 0::2] + time[..., None] * relative[..., 1::2]
    return np.asarray(np.hypot(position[..., 0], position[..., 1]))


def meeting(
    state: FloatArray,
    covariance: FloatArray,
    error: FloatArray,
    gate: float,
    max_time: float,
) -> tuple[IntArray, IntArray]:
    """Pairs of targets whose gates overlap at some time within `max_time` of now.

    The gates are compared at the time of the closest approach, limited to `max_time` before and
    after now. The radius of a gate is along the major axis of the predicted detection's error.

    Parameters
    ----------
    state, covariance : (n, 4), (n, 4, 4) ndarray
        At a common time, now.
    error : (n,) ndarray
        Standard deviation of a detection of each target, along the major axis, m.
    gate : float
        Radius of a gate in standard deviations.
    max_time : float
        Largest time before or after now, s.

    Returns
    -------
    first, second : (p,) ndarray of int
        Rows of the targets, the first below the second.
    """
    if len(state) < 2:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    # Pairs farther apart cannot meet within the time; few pairs remain.
    deviation = major_sigma(covariance[:, 0::2, 0::2])
    deviation = deviation + max_time * major_sigma(covariance[:, 1::2, 1::2])
    farthest = gate * np.hypot(deviation, error) + max_time * np.hypot(state[:, 1], state[:, 3])
    near = cKDTree(state[:, 0::2]).query_pairs(2.0 * farthest.max(), output_type="ndarray")
    first, second = near[np.lexsort((near[:, 1], near[:, 0]))].T
    time, _ = closest_approach(state[first], state[second])
    time = np.clip(time, -max_time, max_time)

    def reach(rows: IntArray) -> FloatArray:
        position_covariance = kalman.position_covariance_after(covariance[rows], time)
        return gate * np.hypot(major_sigma(position_covariance), error[rows])

    met = distance_at(state[first], state[second], time) <= reach(first) + reach(second)
    return first[met], second[met]
