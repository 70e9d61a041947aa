"""Merging: of one target there is one track, under one id.

Of TSEPM 2018 (Section 3.6, Eqs. 27-33, Step 7): tracks confirmed in one scan are one target's where
they share more than half of their hits and their states are close; `groups`, `moments`.

Of the likelihood-ratio method, by the hits and the states::

    starts of a scan      the strongest first; of the others the score given the tracks that started
                          is reduced by the share of hits due to these (`hypotheses.given_starts`)
    with a confirmed one  a start with more than half of its published hits (`published_owners`),
                          or 2 of its own detections (`own_starts`), is that track
    with a lost track     r_i N(x_new - x_i; 0, P_new + P_i) / births > 1: it goes on (`continued`)

Confirmed tracks that agree for some scans are one (`agrees_with_older`), and at once where it turns
out that targets have several detections (`extended_targets.may_be_older_extended_target`).
"""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from tsepm_ros.numerics.arrays import (
    BoolArray,
    FloatArray,
    IntArray,
)
from tsepm_ros.numerics.discs import ALL_PAIRS, squared_distances_of_discs
from tsepm_ros.numerics.gaussian import gaussian_gate_factor, solve
from tsepm_ros.tracker.measurement import major_sigma
from tsepm_ros.tracker.tracks import TrackArrays

MERGINGS = ("moments", "refit")

FEW_TRACKS = 16
"""Tracks up to which all pairs are compared: that takes less time than the search."""
PAIR_BLOCK = 200_000
"""Pairs processed together: bounds the memory of the search, not its result."""
MAX_SUBSETS = 70
"""Largest number of subsets of a track's hits in the search for overlapping tracks."""
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
"""Hits of a start that were probably a confirmed track's own, from which on it is that track."""


def merging_threshold(probability: float) -> float:
    """Threshold gamma_TM^2 of Eq. 30, with gamma_TM from Eq. 5 as published.

    Eq. 30's distance has four degrees of freedom, Eq. 5 is the quantile for two. The quantile for
    four at P is reached with probability ``1 - exp(-chi2(4).ppf(P) / 2)``, 0.980 for P = 0.9.
    """
    return gaussian_gate_factor(probability) ** 2


def groups(
    hits: IntArray,
    states: FloatArray,
    covariances: FloatArray,
    probability: float,
) -> IntArray:
    """Group the tracks of one scan that meet the merging conditions.

    Two tracks merge where more than half of their hits are shared (condition b) and their states
    are close (condition c, Eq. 30). Groups are the connected components of these pairs.

    Two tracks that share more than half of their hits share a subset of that size: only tracks with
    a common subset are candidates. Pairs already connected by other pairs are skipped.

    Parameters
    ----------
    hits : (n, m) ndarray of int
        Detection ids of each track's hits, ascending in each row.
    states : (n, 4) ndarray
        States at the same time.
    covariances : (n, 4, 4) ndarray
        Their covariances.
    probability : float
        P_TM.

    Returns
    -------
    (n,) ndarray of int
        Label of each track's group.
    """
    n = len(hits)
    labels = np.arange(n)
    if n < 2:
        return labels
    threshold = merging_threshold(probability)

    def connect(first: IntArray, second: IntArray) -> IntArray:
        unconnected = labels[first] != labels[second]
        first, second = first[unconnected], second[unconnected]
        overlapping = overlap(hits, first, second)
        first, second = first[overlapping], second[overlapping]
        near = close(states, covariances, first, second, threshold)
        return _connected(labels, first[near], second[near])

    if n <= FEW_TRACKS:
        return connect(*np.triu_indices(n, 1))
    sharing = tracks_by_shared_hits(hits)
    for first, second in sharing.consecutive_pairs(PAIR_BLOCK):
        labels = connect(first, second)
    for first, second in sharing.pairs(labels, PAIR_BLOCK):
        labels = connect(first, second)
    return labels


def _connected(labels: IntArray, first: IntArray, second: IntArray) -> IntArray:
    """Labels after connecting the given pairs of tracks."""
    if not len(first):
        return labels
    number = int(labels.max()) + 1
    edges = np.ones(len(first), bool), (labels[first], labels[second])
    _, merged = connected_components(coo_matrix(edges, shape=(number, number)), directed=False)
    return merged[labels].astype(np.int64)


@dataclass(frozen=True)
class Sharing:
    """Tracks with a common subset of hits, as compressed rows.

    Attributes
    ----------
    start : (g + 1,) ndarray of int
        Subset i belongs to the tracks ``track[start[i]:start[i + 1]]``.
    track : (p,) ndarray of int
        Rows of the tracks, ascending within a subset.
    """

    start: IntArray
    track: IntArray

    def consecutive_pairs(self, block: int) -> Iterator[tuple[IntArray, IntArray]]:
        """Pairs of consecutive tracks in a subset, `block` at a time.

        They connect most tracks at the least cost.
        """
        same = np.ones(max(len(self.track) - 1, 0), bool)
        same[self.start[1:-1] - 1] = False
        rows = np.flatnonzero(same)
        for begin in range(0, len(rows), block):
            row = rows[begin : begin + block]
            yield self.track[row], self.track[row + 1]

    def pairs(self, labels: IntArray, block: int) -> Iterator[tuple[IntArray, IntArray]]:
        """All pairs of tracks that share a subset, about `block` at a time.

        Subsets are left out whose tracks have one label. A pair occurs once for every common
        subset.
        """
        label, begin, counts = labels[self.track], self.start[:-1], np.diff(self.start)
        mixed = np.minimum.reduceat(label, begin) != np.maximum.reduceat(label, begin)
        track, counts = self.track[np.repeat(mixed, counts)], counts[mixed]
        # Entry p is paired with the later entries of its subset.
        later = np.repeat(np.cumsum(counts), counts) - np.arange(len(track)) - 1
        work = np.cumsum(later)
        total = int(work[-1]) if len(work) else 0
        borders = np.unique(np.searchsorted(work, np.arange(0, total, block), side="right"))
        for begin, end in itertools.pairwise([*borders, len(later)]):
            entry = np.repeat(np.arange(begin, end), later[begin:end])
            first_pair = np.cumsum(later[begin:end]) - later[begin:end]
            offset = np.arange(len(entry)) - first_pair[entry - begin]
            yield track[entry], track[entry + 1 + offset]


def tracks_by_shared_hits(hits: IntArray) -> Sharing:
    """Find the tracks with common subsets of hits.

    Parameters
    ----------
    hits : (n, m) ndarray of int
        Detection ids, ascending in each row.

    Returns
    -------
    Sharing
        Subsets of the smallest size above m/2, so that every overlapping pair shares a subset; of
        fewer hits if a track would have more than `MAX_SUBSETS` subsets. Subsets of a single track
        are left out.
    """
    n, m = hits.shape
    size = m // 2 + 1
    while math.comb(m, size) > MAX_SUBSETS:
        size -= 1
    # The sum of a random number per hit identifies a subset. Two subsets with the same sum would
    # add a candidate, not change the result.
    ids, column = np.unique(hits, return_inverse=True)
    number = np.random.default_rng(0).integers(2**63, size=len(ids))[column.reshape(n, m)]
    key = np.concatenate(
        [number[:, subset].sum(axis=1) for subset in itertools.combinations(range(m), size)]
    )
    order = np.argsort(key, kind="stable")
    key = key[order]
    border = np.flatnonzero(np.diff(key, prepend=key[0] - 1, append=key[-1] + 1))
    counts = np.diff(border)
    shared = counts > 1
    start = np.zeros(np.count_nonzero(shared) + 1, np.int64)
    np.cumsum(counts[shared], out=start[1:])
    return Sharing(start, (order % n)[np.repeat(shared, counts)])


def overlap(hits: IntArray, first: IntArray, second: IntArray) -> NDArray[np.bool_]:
    """Test whether the tracks of each pair share more than half of their hits (condition b)."""
    same = hits[first][:, :, None] == hits[second][:, None, :]
    return 2 * np.count_nonzero(same, axis=(1, 2)) > hits.shape[1]


def close(
    states: FloatArray, covariances: FloatArray, first: IntArray, second: IntArray, threshold: float
) -> NDArray[np.bool_]:
    """Test whether the states of each pair are close (condition c).

    ``(X1 - X2)' (P1 + P2)^-1 (X1 - X2) <= gamma_TM^2`` (Eqs. 28-30). As published, the two
    estimates count as independent although they share hits.
    """
    difference = states[first] - states[second]
    # The distance is at least that of each single component, which is cheap to test.
    variances = covariances[:, range(4), range(4)]
    bound = threshold * (1.0 + 1e-9) * (variances[first] + variances[second])
    near = np.asarray((np.square(difference) <= bound).all(axis=1))
    rows = np.flatnonzero(near)
    total = covariances[first[rows]] + covariances[second[rows]]
    solved = solve(total, difference[rows])
    near[rows] = (difference[rows] * solved).sum(axis=1) <= threshold
    return near


def moments(
    states: FloatArray, covariances: FloatArray, distances: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Merge one group by its weighted moments.

    ``p_i = f_1(i) / sum f_1`` (Eq. 31), ``X = sum p_i X_i`` (Eq. 32), ``P = sum p_i P_i`` (Eq. 33).
    As published, the worse fit has the larger weight, and the spread of the means is left out.

    Parameters
    ----------
    states : (g, 4) ndarray
    covariances : (g, 4, 4) ndarray
    distances : (g,) ndarray
        f_1 of each track. Where all are 0 (two hits fit any line) the weights are equal.

    Returns
    -------
    state : (4,) ndarray
    covariance : (4, 4) ndarray
    """
    total = distances.sum()
    weights = distances / total if total > 0 else np.full(len(distances), 1.0 / len(distances))
    return weights @ states, np.tensordot(weights, covariances, axes=1)


def published_owners(starts: TrackArrays, confirmed: TrackArrays) -> IntArray:
    """Ids of the confirmed tracks of which starts (n,) have most published hits; or -1.

    Such a track has lost its target, and is corrected.
    """
    ids = np.full(len(starts), -1)
    for row, hits in enumerate(map(set, starts.hits)):
        common = np.array(
            [len(hits.intersection(published)) for published in confirmed.hits], np.int64
        )
        owners = confirmed.track_id[2 * common > confirmed.hit_count]
        if len(owners):
            ids[row] = owners[0]
    return ids


def own_starts(
    starts: TrackArrays, owned: dict[tuple[int, int], int], busy: frozenset[int]
) -> IntArray:
    """Rows' ids of the confirmed tracks that starts (n,) are of by their hits; -1 for none.

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
        others = {track for hit, track in owned.items() if hit[0] >= first and hit not in own}
        ratio[np.isin(lost.track_id[near], list(others))] = -np.inf
        best = int(np.argmax(ratio))
        if ratio[best] > 0.0:
            ids[row], free[near[best]] = lost.track_id[near[best]], False
    return ids


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
    known: BoolArray,
    explained: FloatArray,
) -> BoolArray:
    """Which tracks agree with an older track.

    Two tracks agree where both are located, ``d' (P_i + P_j)^-1 d`` of their states is within the
    gate for four dimensions, and together they explain at most `MAX_EXPLAINED` detections.

    Parameters
    ----------
    state, covariance : (n, 4), (n, 4, 4) ndarray
        Oldest track first.
    known : (n,) ndarray of bool
        Which tracks are located.
    explained : (n,) ndarray
        Sum of each track's association probabilities in this scan.

    Returns
    -------
    (n,) ndarray of bool
    """
    agrees = np.zeros(len(state), bool)
    if np.count_nonzero(known) < 2:
        return agrees
    track, older = _pairs_with_older(state[:, 0::2], known)
    may = known[track] & known[older] & (explained[track] + explained[older] <= MAX_EXPLAINED)
    track, older = track[may], older[may]
    agrees[track[close(state, covariance, track, older, SAME_DISTANCE)]] = True
    return agrees


@cache
def _all_pairs(n: int) -> tuple[IntArray, IntArray]:
    return np.tril_indices(n, -1)


def _pairs_with_older(positions: FloatArray, known: BoolArray) -> tuple[IntArray, IntArray]:
    """Rows of each known track and of an older track near it, (p,) and (p,), or of more tracks."""
    n = len(positions)
    if n <= NEAREST:  # all are
        return _all_pairs(n)
    rows = np.flatnonzero(known)
    if len(rows) * n <= ALL_PAIRS:
        distances = squared_distances_of_discs(positions[rows], positions)
        nearest = np.argpartition(distances, NEAREST - 1, axis=1)[:, :NEAREST]
    else:
        _, nearest = cKDTree(positions).query(positions[rows], k=NEAREST)
    track, older = np.repeat(rows, NEAREST), nearest.ravel()
    is_older = older < track
    return track[is_older], older[is_older]
