"""What makes several tracks one: of one target there is one track, under one id.

Held tracks that agree for some scans are one (`agrees_with_older`), and at once where it turns out
that targets have several detections (`may_repeat_older`). A start by a held track's own detections
is that track (`own_starts`). A start where a lost track may be is its continuation rather than a
new target's, if that is more probable (`continued`).
"""

from __future__ import annotations

import math
from collections import Counter
from functools import cache

import numpy as np
from scipy.spatial import cKDTree

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from tsepm_ros.numerics.discs import ALL_PAIRS, squared_distances
from tsepm_ros.numerics.gaussian import solve
from tsepm_ros.tracker.clustering import PlotExtent
from tsepm_ros.tracker.measurement import major_sigma
from tsepm_ros.tracker.path_fit import NO_HIT
from tsepm_ros.tracker.tracks import TrackArrays

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
MAX_EXPLAINED = 1.5
"""Detections that two tracks together explain, above which they are of two targets."""
ROUNDING = 1e-6
MIN_OWN_HITS = 2
"""Hits of a start that were probably a held track's own, from which on it is that track."""


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
    explained: FloatArray | None = None,
) -> BoolArray:
    """Which tracks agree with an older track.

    Two tracks agree where both are located, ``d' (P_i + P_j)^-1 d`` of their states is within the
    gate for four dimensions, they do not each have a plot of their own, and together they explain
    at most `MAX_EXPLAINED` detections.

    Parameters
    ----------
    state, covariance : (n, 4), (n, 4, 4) ndarray
        Oldest track first.
    plots : (n,) ndarray of int
        Detection that is each track's own, or NO_HIT.
    known : (n,) ndarray of bool, optional
        Which tracks are located; by default all.
    explained : (n,) ndarray, optional
        Sum of each track's association probabilities in this scan.

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
    if explained is not None:
        may &= explained[track] + explained[older] <= MAX_EXPLAINED
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


def may_repeat_older(
    tracks: TrackArrays, extent: PlotExtent, sensor_position: FloatArray
) -> BoolArray:
    """Which tracks may be of an older one's target, whose detections differed by an extent.

    Parameters
    ----------
    tracks : TrackArrays
        n, oldest first.
    extent : PlotExtent
        Deviation by which positions may differ, and velocities over a track's age.
    sensor_position : (2,) ndarray
        m.

    Returns
    -------
    (n,) ndarray of bool
    """
    range_ = np.hypot(*(tracks.state[:, 0::2] - sensor_position).T)
    size = np.maximum(extent.along, extent.across_at(range_)) ** 2 / 6.0
    covariance = tracks.covariance.copy()
    covariance[:, [0, 2], [0, 2]] += size[:, None]
    covariance[:, [1, 3], [1, 3]] += (size / np.maximum(tracks.age, 1e-3) ** 2)[:, None]
    unknown = np.full(len(tracks), NO_HIT)
    return agrees_with_older(tracks.state, covariance, unknown)


def own_starts(
    starts: TrackArrays, owned: dict[tuple[int, int], int], busy: frozenset[int]
) -> IntArray:
    """Rows' ids of the held tracks that starts (n,) are of by their hits; -1 for none.

    Parameters
    ----------
    starts : TrackArrays
    owned : dict
        Id of the track whose own a detection probably was, by its scan and index.
    busy : frozenset of int
        Ids of the tracks that have another detection in this scan.

    Returns
    -------
    (n,) ndarray of int
        `MIN_OWN_HITS` at least are the track's; each track once.
    """
    ids, taken = np.full(len(starts), -1), set(busy)
    for row, hits in enumerate(starts.hits):
        number = Counter(owned[hit] for hit in hits if hit in owned)
        for track_id, own in number.most_common(1):
            if own >= MIN_OWN_HITS and track_id not in taken:
                ids[row] = track_id
                taken.add(track_id)
    return ids


def continued(
    starts: TrackArrays,
    lost: TrackArrays,
    existence: FloatArray,
    owned: dict[tuple[int, int], int],
    births: float,
) -> IntArray:
    """Ids of the lost tracks that starts (n,) continue; -1 for none.

    A track whose target has not been detected since before the start's first hit, but for the
    start's own hits, goes on with the largest ratio above 1 of its density to that of new targets;
    each track once::

        r_i N(x_new - x_i; 0, P_new + P_i) / births

    Parameters
    ----------
    starts, lost : TrackArrays
        At the same time.
    existence : (m,) ndarray
        r_i.
    owned : dict
        As in `own_starts`.
    births : float
        Density of new targets within the mean length of fading, 1/(m^2 (m/s)^2).

    Returns
    -------
    (n,) ndarray of int
    """
    ids, free = np.full(len(starts), -1), np.ones(len(lost), bool)
    odds = np.log(existence) - math.log(births)
    variances = np.diagonal(lost.covariance, axis1=1, axis2=2)
    for row in range(len(starts) if len(lost) else 0):
        apart, covariance = starts.state[row] - lost.state, starts.covariance[row]
        # The ratio is at most that of the distance of a single component and of P_new alone.
        most = 2.0 * odds - np.linalg.slogdet(2.0 * np.pi * covariance)[1] + ROUNDING
        squares = apart**2 / (variances + np.diagonal(covariance))
        near = np.flatnonzero(free & (squares.max(axis=1) < most))
        if not len(near):
            continue
        apart, spread = apart[near], covariance + lost.covariance[near]
        square = np.einsum("ti,ti->t", apart, solve(spread, apart))
        density = -0.5 * square - 0.5 * np.linalg.slogdet(2.0 * np.pi * spread)[1]
        ratio = odds[near] + density
        hits = starts.hits[row]
        first, own = hits[0][0], set(hits)
        found = {track for hit, track in owned.items() if hit[0] >= first and hit not in own}
        ratio[np.isin(lost.track_id[near], list(found))] = -np.inf
        best = int(np.argmax(ratio))
        if ratio[best] > 0.0:
            ids[row], free[near[best]] = lost.track_id[near[best]], False
    return ids
