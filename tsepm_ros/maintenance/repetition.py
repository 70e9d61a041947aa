"""Tracks that repeat an older track of the same target."""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.spatial import cKDTree

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from tsepm_ros.numerics.covariances import solve
from tsepm_ros.numerics.discs import ALL_PAIRS, squared_distances
from tsepm_ros.sensing.conversion import major_sigma
from tsepm_ros.stages.paths import NO_HIT

SAME_SCANS = 5
"""Scans in a row for which a track must agree with an older one to be the same target's."""
SAME_DISTANCE = 7.78
"""Squared distance of two states that agree: chi-square of four degrees of freedom at 0.9."""
LOCATED = 2.0
"""Position error, in those of a detection, up to which a track is located.

That states agree says little where a state is vague: a track that has been missed for some scans
agrees with every track near it, and is as likely another target's.
"""
NEAREST = 8
"""Nearest tracks among which older tracks are sought, the track itself included."""


def located(covariance: FloatArray, detection_sigma: FloatArray) -> BoolArray:
    """Which tracks are located: those of a position error of at most `LOCATED` detection errors.

    Parameters
    ----------
    covariance : (n, 4, 4) ndarray
    detection_sigma : (n,) ndarray
        Standard deviation of a detection's position there, along its major axis, m.

    Returns
    -------
    (n,) ndarray of bool
    """
    return np.asarray(major_sigma(covariance[:, 0::2, 0::2]) <= LOCATED * detection_sigma)


def agrees_with_older(
    state: FloatArray,
    covariance: FloatArray,
    plots: IntArray,
    known: BoolArray | None = None,
) -> BoolArray:
    """Which tracks agree with an older track.

    Two tracks agree where both are located, ``d' (P_i + P_j)^-1 d`` of their states is within the
    gate for four dimensions, and they do not each have a plot of their own.

    Parameters
    ----------
    state, covariance : (n, 4), (n, 4, 4) ndarray
        Oldest track first.
    plots : (n,) ndarray of int
        Detection that is each track's own, or NO_HIT.
    known : (n,) ndarray of bool, optional
        Which tracks are located; by default all.

    Returns
    -------
    (n,) ndarray of bool
    """
    n = len(state)
    agrees = np.zeros(n, bool)
    if n < 2 or (known is not None and np.count_nonzero(known) < 2):
        return agrees
    track, older = _pairs_with_older(state[:, 0::2], known)
    may = (plots[track] == plots[older]) | (plots[track] == NO_HIT) | (plots[older] == NO_HIT)
    if known is not None:
        may &= known[track] & known[older]
    # The distance is at least that of each single component, which is cheap to test.
    variances = np.diagonal(covariance, axis1=1, axis2=2)
    bound = SAME_DISTANCE * (1.0 + 1e-9) * (variances[track] + variances[older])
    may &= (np.square(state[track] - state[older]) <= bound).all(axis=1)
    track, older = track[may], older[may]
    if not len(track):
        return agrees
    difference = state[track] - state[older]
    scaled = solve(covariance[track] + covariance[older], difference)
    near = np.einsum("pi,pi->p", difference, scaled) <= SAME_DISTANCE
    agrees[track[near]] = True
    return agrees


@cache
def _all_pairs(n: int) -> tuple[IntArray, IntArray]:
    return np.tril_indices(n, -1)


def _pairs_with_older(positions: FloatArray, known: BoolArray | None) -> tuple[IntArray, IntArray]:
    """Rows of each known track and of an older track near it, (p,) and (p,), or of more tracks."""
    n = len(positions)
    if n <= NEAREST:  # all are
        return _all_pairs(n)
    rows = np.arange(n) if known is None else np.flatnonzero(known)
    if len(rows) * n <= ALL_PAIRS:
        distances = squared_distances(positions[rows], positions)
        nearest = np.argpartition(distances, NEAREST - 1, axis=1)[:, :NEAREST]
    else:
        _, nearest = cKDTree(positions).query(positions[rows], k=NEAREST)
    track, older = np.repeat(rows, NEAREST), nearest.ravel()
    is_older = older < track
    return track[is_older], older[is_older]
