"""Confirmation: which hypotheses become tracks, with which hits, and which confirmed ones err.

With the evidence E of the hypotheses that end in one detection, under the velocity prior that ends
at v_max (`evaluation.within_max_speed`), and the threshold A::

    confirmed     E >= A, by at least 3 hits, at most half of them due to confirmed tracks, more
                  than half of them the target's with a probability of at least 0.9, or by 8
                  hits (a lower probability at target rates above 3000 per hour); of a second target
                  E >= A + ln 1000, with the density due to confirmed tracks added to lambda

With i over the hypotheses that end in one detection and their rivals, which are of the same target
and end in another detection, or in none::

    P(hit)        sum of w_i over i with the hit,  w_i ~ exp(s_i)
    hits          the detections of a probability of at least 0.9, or, where these are fewer than
                  3, the 3 most probable, each more probable than not
    resolved      sum of w_i over i with more than half of the hits is at least 0.9, with the
                  hypotheses of a single hit among all i (by 8 hits, whose probabilities may be
                  smaller: more than half; a smaller sum at high target rates)
    state         x = sum_i w_i x_i over these i,  P = sum_i w_i (P_i + (x_i - x)(x_i - x)')

x_i and P_i are fitted to the hits of hypothesis i alone.

Track correction: the tree goes on after a start, and later hits decide between the hypotheses that
were rivals at the start, and others. With i over the rivals of the hypotheses that end in a
confirmed track's probable detection, and the n hits that the track was published with::

    right         P = sum of w_i over i with more than n / 2 of these hits,  w_i ~ exp(s_i)
    wrong         P <= 0.1, as soon as other hits are resolved with a probability of 0.9

Where the right hits are partly those that were published, the start is corrected. Where none is,
the track was of no target or of another, and the target is a new one, which replaces it. Hits that
are all later than the published ones contradict none: the target may have turned since. That is
decided while all published hits are in the window of the hypotheses. Tracks within the reach
``v_max a`` of another, of age a, are left as they are: of two targets side by side the hits are
exchanged by turns, and the targets are held.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy.special import softmax

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray, array_sums_over_hits
from tsepm_ros.numerics.gaussian import gaussian_mixture
from tsepm_ros.tracker.evaluation import LOG_GAIN, within_max_speed
from tsepm_ros.tracker.hypotheses import Hypotheses, Start, Tree, given_starts
from tsepm_ros.tracker.initial_state import NO_HIT
from tsepm_ros.tracker.measurement import MeasurementWindow
from tsepm_ros.tracker.observation import Observation
from tsepm_ros.tracker.options import MIN_HITS
from tsepm_ros.tracker.pruning import RELATIVE_PRUNING
from tsepm_ros.tracker.tracks import MIN_EXISTENCE, NEW_TRACK_EXISTENCE, PROBABLE

MIN_HIT_PROBABILITY = 0.5
"""Posterior probability that every hit of a confirmed track exceeds, but of those by 8 hits."""
SURE_HIT_PROBABILITY = 0.9
"""Posterior probability from which a detection is a hit in any case: a choice.

Less probable hits are published only where these are fewer than `MIN_HITS`: each further doubtful
hit would make it more probable that most of the hits are wrong.
"""
MIN_PURITY_PROBABILITY = 0.9
"""Minimum posterior probability that more than half of a new track's hits are its target's.

A less certain start waits: a track with half of its hits wrong is useless, and hides its target. A
choice; docs/score.md compares other values. Where false tracks are many by choice, it is lower, see
`min_purity_probability`.
"""
MAX_UNRESOLVED_HITS = 8
"""Hits of the best hypothesis from which a start waits no longer: a choice.

The hits may stay ambiguous where a target has several detections a ping.
"""
MIN_COMMON_SHARE = 0.3
"""Share of common hits above which two hypotheses are of the same target."""
MIN_RELATIVE_WEIGHT = 0.01
"""Part of the best weight below which a hypothesis does not count in the state."""
HitFit = Callable[[Hypotheses], tuple[FloatArray, FloatArray]]
"""States (n, 4) and covariances (n, 4, 4) of hypotheses, from their hits alone."""
MAX_RATE_OF_PURE_STARTS = 3000.0
"""Target false-track rate, per hour, above which a start need not be as pure: a choice."""
MAX_CONFIRMED_SHARE = 0.5
"""Share of the hits due to confirmed tracks above which a hypothesis is of a confirmed target: a
choice.

A false confirmed track takes part of the detections of a target that comes near it. A smaller share
lets it hide the target; a larger share makes redundant tracks. docs/score.md compares values.
"""
SECOND_TARGET_MARGIN = math.log(1e3)
"""Evidence above the threshold, given confirmed tracks, that a second target needs: a choice.

A second track competes for the confirmed track's detections, and a start with wrong hits briefly
looks like two targets.
"""
TARGET_BIRTH_RATE = 500.0
"""Assumed target births per hour; sets the existence probability of new tracks: a choice.

The existence probability weights the association of detections with a new track. The rate is high:
the weight falls clearly below 1 only at useless false-track rates.
"""


def confirm(
    tree: Tree,
    window: MeasurementWindow,
    threshold: float,
    false_tracks_per_hour: float,
    *,
    min_time: float,
    max_speed: float,
    fit: HitFit,
) -> tuple[list[Start], int]:
    """Start a track where the evidence of a detection reaches the threshold, ``E >= A``.

    The strongest detection comes first; the others are tested given its start, so that one target
    has one. A start waits until its target's hits are resolved. Where more than
    `MAX_CONFIRMED_SHARE` of these are due to confirmed tracks, or the detection probably is, the
    evidence given the confirmed tracks must exceed the threshold by `SECOND_TARGET_MARGIN`.

    Parameters
    ----------
    tree : Tree
        After the scan.
    window : DetectionWindow
        The detections, with the probability that confirmed tracks caused each; new tracks are
        added.
    threshold : float
        A; infinite where no evidence can reach it.
    false_tracks_per_hour : float
        The target rate.
    min_time : float
        Time from the first hit to the last that a velocity needs, s.
    max_speed : float
        v_max, m/s, at which the velocity prior ends.
    fit : callable
        States and covariances of hypotheses, from their hits alone.

    Returns
    -------
    starts : list of Start
    merged : int
        Detections of enough evidence that are of a target which has a start already.
    """
    if math.isinf(threshold) or attainable(tree, window).max(initial=-math.inf) < threshold:
        return [], 0
    decided = decided_by_speed(tree, threshold, max_speed)
    new = _strong(decided, window, threshold)
    if not new:
        return [], 0
    rivals = with_rivals(tree, decided, threshold, max_speed)
    purity = min_purity_probability(false_tracks_per_hour)
    starts: list[Start] = []
    merged = 0
    for end in sorted(new, key=lambda end: -decided.evidence[end]):
        members, start = decided.ending_in(end), None
        is_confirmed = window.confirmed_probability(tree.ids[[end]])[0] > PROBABLE
        if new[end] and not is_confirmed:
            start = resolved(members, rivals, window, MAX_CONFIRMED_SHARE, min_time, fit, purity)
        if start is None:
            members = given_starts(members, starts).scored_given_confirmed()
            if np.logaddexp.reduce(members.score) >= threshold + SECOND_TARGET_MARGIN:
                left = given_starts(rivals.hypotheses, starts).scored_given_confirmed()
                rest = replace(rivals, hypotheses=left)
                start = resolved(members, rest, window, 1.0, min_time, fit, purity)
        if start is None:
            merged += bool(new[end] and is_confirmed)
            continue
        starts.append(start)
        exists = existence(np.array([start.evidence - threshold]), false_tracks_per_hour)
        window.note_confirmed(start.detections, start.probability * exists)
    return starts, merged


def _strong(tree: Tree, window: MeasurementWindow, threshold: float) -> dict[int, bool]:
    """Detections whose evidence may start a track, and whether that may be without a margin."""
    strong = (tree.evidence >= threshold) & _has_hits(tree)
    confirmed = window.confirmed_probability(tree.ids) > PROBABLE
    strong_ends = {}
    for end in np.flatnonzero(strong).tolist():
        members = tree.ending_in(end)
        new = not confirmed[end] and confirmed_share(members, window) <= MAX_CONFIRMED_SHARE
        second = np.logaddexp.reduce(members.score_given_confirmed)
        if new or second >= threshold + SECOND_TARGET_MARGIN:
            strong_ends[end] = new
    return strong_ends


def _has_hits(tree: Tree) -> BoolArray:
    """Which detections (d,) end a hypothesis of enough hits."""
    return tree.largest(tree.hypotheses.hit_count.astype(float)) >= MIN_HITS


def attainable(tree: Tree, window: MeasurementWindow) -> FloatArray:
    """Upper bound of the evidence by which each detection may start a track, (d,).

    Less than its evidence where it is a confirmed track's: what is left given these, without the
    margin that a second target needs. -inf where every hypothesis has too few hits.
    """
    evidence, enough = tree.evidence + LOG_GAIN, _has_hits(tree)
    confirmed = enough & (window.confirmed_probability(tree.ids) > PROBABLE)
    if confirmed.any():
        second = (
            tree.summed(tree.hypotheses.score_given_confirmed) + LOG_GAIN - SECOND_TARGET_MARGIN
        )
        evidence = np.where(confirmed, np.minimum(evidence, second), evidence)
    return np.where(enough, evidence, -np.inf)


def decided_by_speed(tree: Tree, threshold: float, max_speed: float) -> Tree:
    """The tree with the evidence under the prior that ends at v_max, where it may be enough.

    Rivals in other detections are as they were.
    """
    counts = _may_pass(tree, threshold)
    return replace(tree, hypotheses=within_max_speed(tree.hypotheses, counts, max_speed))


def with_rivals(tree: Tree, decided: Tree, threshold: float, max_speed: float) -> Tree:
    """As `decided_by_speed`, of the tree and what that made of it, and of the rivals of starts."""
    passed = decided.evidence >= threshold
    # Of other detections, those that may be rivals of a start: they share a hit with it.
    hypotheses = tree.hypotheses
    hits = np.unique(hypotheses.hits[tree.missed :][passed[tree.newest]])
    hits = hits[hits != NO_HIT]
    rival = hypotheses.score >= threshold + RELATIVE_PRUNING - LOG_GAIN
    rival[rival] = np.isin(hypotheses.hits[rival], hits).any(axis=1)
    counts = _may_pass(tree, threshold) | rival
    return replace(tree, hypotheses=within_max_speed(hypotheses, counts, max_speed))


def _may_pass(tree: Tree, threshold: float) -> BoolArray:
    """Which hypotheses (n,) end in a detection whose evidence may reach the threshold."""
    strong = (tree.evidence + LOG_GAIN >= threshold) & _has_hits(tree)
    return np.append(np.zeros(tree.missed, bool), strong[tree.newest])


def resolved(
    members: Hypotheses,
    tree: Tree,
    window: MeasurementWindow,
    max_confirmed_share: float,
    min_time: float,
    fit: HitFit,
    min_purity: float = MIN_PURITY_PROBABILITY,
) -> Start | None:
    """The track of hypotheses with one newest detection.

    None while the target's hits are not resolved, up to `MAX_UNRESOLVED_HITS` hits, and
    where more than `max_confirmed_share` of them are due to confirmed tracks. They are resolved
    where more than half of the hits are right with a probability of `min_purity`.

    The newest detection is as uncertain as the others: hypotheses of the same target that end in
    another detection, or miss the scan, are rivals.
    """
    evidence = float(np.logaddexp.reduce(members.score))
    rivals = rivals_of(members, tree, evidence)
    begun = rivals[rivals.hit_count == 1]
    rivals = rivals[spans_time(rivals, 2, window, min_time)]
    long = spans_time(rivals, MIN_HITS, window, min_time)
    if not long.any():
        return None
    if confirmed_share(rivals, window) > max_confirmed_share:
        return None
    detections, probability = hit_probabilities(rivals)
    best = np.argmax(np.where(long, rivals.score, -np.inf))
    waits = rivals.hit_count[best] < MAX_UNRESOLVED_HITS
    if waits and (probability > MIN_HIT_PROBABILITY).sum() < MIN_HITS:
        return None
    hits = hit_posterior(detections, probability, rivals.hits[best])
    common = np.isin(rivals.hits, hits).sum(axis=1)
    right = common > 0.5 * len(hits)
    # A strong echo may as well be the first of its target, and the hits before it clutter.
    share = softmax(np.append(rivals.score, begun.score))[: len(rivals)]
    least = min_purity if waits else MIN_HIT_PROBABILITY
    if share[right].sum() < least:
        return None
    state, covariance = mixed(rivals[right], fit)
    return Start(hits, detections, probability, state, covariance, evidence)


def confirmed_share(hypotheses: Hypotheses, window: MeasurementWindow) -> float:
    """Share of the hits of hypotheses that are a confirmed track's.

    ``sum_i w_i c_i / sum_i w_i n_i`` with c_i of the n_i hits of hypothesis i due to confirmed
    tracks.
    """
    weight = np.exp(hypotheses.score - hypotheses.score.max())
    return float(weight @ confirmed_hits(hypotheses, window) / (weight @ hypotheses.hit_count))


def confirmed_hits(hypotheses: Hypotheses, window: MeasurementWindow) -> FloatArray:
    """Mean number of the hits of each hypothesis that are a confirmed track's, (n,)."""
    hit = hypotheses.hits != NO_HIT
    confirmed = np.zeros(hypotheses.hits.shape)
    confirmed[hit] = window.confirmed_probability(hypotheses.hits[hit])
    return np.asarray(confirmed.sum(axis=1))


def rivals_of(members: Hypotheses, tree: Tree, evidence: float) -> Hypotheses:
    """Hypotheses of the same target as `members`, whatever detection they end in.

    A single hit is a hypothesis of its own where it has an amplitude.
    """
    likely, probability = hit_probabilities(members)
    hypotheses = tree.hypotheses
    pool = (hypotheses.score > evidence + RELATIVE_PRUNING) & (
        hypotheses.hit_count + hypotheses.amplitude_count >= 2
    )
    rivals = hypotheses[pool]
    common = array_sums_over_hits(rivals.hits, likely, probability)
    least = np.minimum(rivals.hit_count, probability.sum())
    return rivals[common > MIN_COMMON_SHARE * least]


def hit_probabilities(members: Hypotheses) -> tuple[IntArray, FloatArray]:
    """Detections of hypotheses of one target, (h,), and the probability of each."""
    share = softmax(members.score)
    detections, index = np.unique(members.hits, return_inverse=True)
    mass = np.bincount(index.ravel(), np.repeat(share, members.hits.shape[1]))
    hit = detections != NO_HIT
    return detections[hit], mass[hit]


def hit_posterior(detections: IntArray, probability: FloatArray, best: IntArray) -> IntArray:
    """The detections (c,), ascending, that are credible as hits.

    Those that are sure; where these are too few, the most probable of all that are more probable
    than not; where these are too few, the most probable of the `best` hypothesis.
    """
    sure = detections[probability >= SURE_HIT_PROBABILITY]
    if len(sure) >= MIN_HITS:
        return sure
    if (probability > MIN_HIT_PROBABILITY).sum() >= MIN_HITS:
        return np.sort(detections[np.argsort(-probability, kind="stable")[:MIN_HITS]])
    path = best[best != NO_HIT]
    of_path = probability[np.searchsorted(detections, path)]
    return np.sort(path[np.argsort(-of_path, kind="stable")[:MIN_HITS]])


def spans_time(
    hypotheses: Hypotheses, min_hits: int, window: MeasurementWindow, min_time: float
) -> BoolArray:
    """Which hypotheses have enough hits over more than a minimum time (s), (n,)."""
    enough = hypotheses.hit_count >= min_hits
    if not enough.any():
        return enough
    newest = window[hypotheses.last_hit]["time"]
    oldest = window[hypotheses.hits[:, 0]]["time"]
    return enough & (np.abs(newest - oldest) > min_time)


def mixed(members: Hypotheses, fit: HitFit) -> tuple[FloatArray, FloatArray]:
    """State and covariance over the hypotheses of one track, each fitted to its hits alone."""
    share = softmax(members.score)
    counted = share >= MIN_RELATIVE_WEIGHT * share.max()
    states, covariances = fit(members[counted])
    return gaussian_mixture(share[counted] / share[counted].sum(), states, covariances)


def existence(evaluation: FloatArray, false_tracks_per_hour: float) -> FloatArray:
    """Posterior probability that targets exist, (n,), from the evidence above the threshold, (n,).

    The prior is `TARGET_BIRTH_RATE`: at the threshold, the odds are this rate over the target
    false-track rate.
    """
    false = false_tracks_per_hour * np.exp(-evaluation)
    return np.clip(
        TARGET_BIRTH_RATE / (TARGET_BIRTH_RATE + false), 2.0 * MIN_EXISTENCE, NEW_TRACK_EXISTENCE
    )


def min_purity_probability(false_tracks_per_hour: float) -> float:
    """Minimum probability that more than half of a start's hits are its target's, 0.5 to 0.9.

    It falls as the inverse of the target rate (per hour) above `MAX_RATE_OF_PURE_STARTS`: such
    rates are those of published methods, for comparison. A start with wrong hits is then a false
    track among many, whose low existence probability leaves the target's detections free.
    """
    excess = max(false_tracks_per_hour / MAX_RATE_OF_PURE_STARTS, 1.0)
    return max(MIN_PURITY_PROBABILITY / excess, MIN_HIT_PROBABILITY)


Doubtful = tuple[int, int, IntArray]
"""A confirmed track whose start may be wrong: its id, the row of its detection in the scan, and its
published hits, (h,)."""


def corrections(
    tree: Tree,
    observed: Observation,
    wrong: Sequence[Doubtful],
    threshold: float,
    starts: Sequence[Start],
    *,
    min_time: float,
    max_speed: float,
    fit: HitFit,
) -> tuple[list[tuple[int, Start]], list[tuple[int, Start]]]:
    """Corrections of the confirmed tracks' starts, while their hits are in the window.

    Parameters
    ----------
    tree : Tree
        After the scan.
    observed : Observation
        With the confirmed tracks and their detections.
    wrong : sequence of Doubtful
        See `doubtful`, before the starts.
    threshold : float
        Of the evidence.
    starts : sequence of Start
        Those of the scan.
    min_time, max_speed, fit
        See `confirm`.

    Returns
    -------
    corrected : list of (int, Start)
        Id of a track, and its start as it should have been.
    replaced : list of (int, Start)
        Id of a track of which no hit was the target's, and the target's start.
    """
    corrected: list[tuple[int, Start]] = []
    replaced: list[tuple[int, Start]] = []
    tested, window = None, observed.window
    for track_id, row, hits in wrong:
        if tree.evidence[row] + LOG_GAIN < threshold:
            continue
        if any(tree.ids[row] in start.detections for start in starts):
            continue
        if tested is None:
            decided = decided_by_speed(tree, threshold, max_speed)
            tested = with_rivals(tree, decided, threshold, max_speed)
        start = _instead(hits, tested, row, window, threshold, min_time, fit)
        if start is None:
            continue
        if np.isin(start.detections[start.probability > MIN_HIT_PROBABILITY], hits).any():
            corrected.append((track_id, start))
        elif window[start.hits]["scan"].min() <= window[hits]["scan"].max():
            replaced.append((track_id, start))
    return corrected, replaced


def doubtful(tree: Tree, observed: Observation, max_speed: float) -> list[Doubtful]:
    """Confirmed tracks whose best hypothesis lacks half of their published hits or more.

    They have no other confirmed track in reach, and all their hits in the window: hypotheses with
    older hits have been deleted, whether they were right or not. A track from a downstream tracker
    has no hits to doubt.
    """
    doubts: list[Doubtful] = []
    confirmed = observed.confirmed
    ids, rows = observed.probable_detections
    # A track that has ended in this scan is in no row.
    which, row_of_track = np.nonzero(ids[:, None] == confirmed.track_id)
    apart = confirmed.state[row_of_track, None, 0::2] - confirmed.state[:, 0::2]
    near = np.hypot(apart[..., 0], apart[..., 1]) <= max_speed * confirmed.age[row_of_track, None]
    alone = np.count_nonzero(near, axis=1) <= 1
    for track_id, row, track in zip(
        ids[which[alone]], rows[which[alone]], row_of_track[alone], strict=True
    ):
        published = confirmed.hits[track]
        hits = observed.window.find(published)
        if 0 < len(hits) == len(published) and not _best_has_most_of(hits, tree, row):
            doubts.append((int(track_id), int(row), hits))
    return doubts


def _best_has_most_of(hits: IntArray, tree: Tree, row: int) -> bool:
    """Whether the best hypothesis that ends in a detection has more than half of the hits."""
    members = tree.ending_in(row)
    if not len(members):
        return True  # all were deleted: there is no other
    best = np.argmax(members.score)
    return bool(2 * np.isin(hits, members.hits[best]).sum() > len(hits))


def _instead(
    hits: IntArray,
    tree: Tree,
    row: int,
    window: MeasurementWindow,
    threshold: float,
    min_time: float,
    fit: HitFit,
) -> Start | None:
    """The start instead of one with these hits; None where these may be right."""
    members = tree.ending_in(row)
    evidence = float(np.logaddexp.reduce(members.score))
    if evidence < threshold:
        return None
    rivals = rivals_of(members, tree, evidence)
    most = 2 * np.isin(rivals.hits, hits).sum(axis=1) > len(hits)
    if softmax(rivals.score)[most].sum() > 1.0 - MIN_PURITY_PROBABILITY:
        return None
    start = resolved(members, tree, window, 1.0, min_time, fit)
    if start is None or 2 * np.isin(start.hits, hits).sum() > len(hits):
        return None
    return start
