"""Encounters of targets: when two are closest (Environment 2018, Section 2.2, Eqs. 1-9).

Shen Y., "The target tracking algorithm based on environment technology", ICOI 2018.

With the relative position r and velocity v of two targets on straight courses, the time until they
are closest, and their distance then, are ::

    T_cpa = -r.v / |v|^2,    d_cpa = |r + v T_cpa|

Readings
--------
- Eq. 9 gives the same time with absolute bars, ``R |cos(phi_r - theta)| / v_r``, which can never be
  negative; Fig. 4 and its text say that it is below 0 once the targets separate. So it is here.
- Eq. 2 prints the two products of its numerator without the minus between them, and its fraction
  upside down: as printed phi_r is against the x axis, in the text and beside Eq. 8 against y.
- At no relative velocity any time is that of the least distance: it is 0, now.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from tsepm_ros.kinematics import kalman
from tsepm_ros.numerics.arrays import FloatArray, IntArray
from tsepm_ros.sensing.conversion import major_sigma


def closest_approach(one: FloatArray, two: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Time until two targets are closest and their distance then (Eqs. 1-9).

    Parameters
    ----------
    one, two : (..., 4) ndarray
        States ``[x, vx, y, vy]`` at one time.

    Returns
    -------
    time : (...) ndarray
        T_cpa, s; below 0 where they separate.
    distance : (...) ndarray
        m.
    """
    apart = two - one
    position, velocity = apart[..., 0::2], apart[..., 1::2]
    square = np.square(velocity).sum(axis=-1)
    towards = -(position * velocity).sum(axis=-1)
    time = np.divide(towards, square, out=np.zeros_like(square), where=square > 0.0)
    return time, distance_at(one, two, time)


def distance_at(one: FloatArray, two: FloatArray, time: FloatArray) -> FloatArray:
    """Distance of two targets (..., 4) after a time (...), s, on straight courses (Eq. 7); m."""
    apart = two - one
    later = apart[..., 0::2] + time[..., None] * apart[..., 1::2]
    return np.asarray(np.hypot(later[..., 0], later[..., 1]))


def meeting(
    state: FloatArray,
    covariance: FloatArray,
    error: FloatArray,
    gate: float,
    within: float,
) -> tuple[IntArray, IntArray]:
    """Pairs of targets whose gates overlap at some time not far from now, before or after.

    The time looked at is that of their closest approach, or the nearest to it of those allowed, and
    a gate reaches as far as the larger axis of the predicted detection's error does.

    Parameters
    ----------
    state, covariance : (n, 4), (n, 4, 4) ndarray
        At one time.
    error : (n,) ndarray
        Standard deviation of a detection of each, along the larger axis, m.
    gate : float
        Standard deviations that a gate reaches.
    within : float
        Time from now, s.

    Returns
    -------
    one, two : (p,) ndarray of int
        Rows, the first below the second.
    """
    if len(state) < 2:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    # No pair farther apart can meet in time: far fewer are left than all.
    deviation = major_sigma(covariance[:, 0::2, 0::2])
    deviation = deviation + within * major_sigma(covariance[:, 1::2, 1::2])
    farthest = gate * np.hypot(deviation, error) + within * np.hypot(state[:, 1], state[:, 3])
    near = cKDTree(state[:, 0::2]).query_pairs(2.0 * farthest.max(), output_type="ndarray")
    one, two = near[np.lexsort((near[:, 1], near[:, 0]))].T
    time, _ = closest_approach(state[one], state[two])
    time = np.clip(time, -within, within)

    def reach(rows: IntArray) -> FloatArray:
        spread = kalman.position_covariance_after(covariance[rows], time)
        return gate * np.hypot(major_sigma(spread), error[rows])

    met = distance_at(state[one], state[two], time) <= reach(one) + reach(two)
    return one[met], two[met]
