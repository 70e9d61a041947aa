"""The tree of hypotheses: a scan's detections extend it, and unlikely hypotheses are pruned.

With lambda the clutter density, N(z; H x, S) the density of a detection z under hypothesis i, P_G
the gate's probability and s_i the score of the hypothesis::

    predicted     x <- F x,  P <- F P F' + Q
    child         s_i + ln(P_D N(z; H x, S) / lambda), for each z with d' S^-1 d <= gamma
                  with lambda predictive where it is learned, see `environment.clutter_clumps`
    missed        s_i + ln(1 - P_D P_G);  P_D of a chain of seen and faded, see `fading`
    started       s = 0, by every detection; its velocity has variance v_max^2 / 4 on each axis
    evidence      E = ln sum_i exp(s_i), over i with the same newest detection
    pruned        s_i < ln(miss_probability), 1e-4 of the best with the same newest detection, not
                  among the `max_per_detection` best of them, or `window` scans old
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from tsepm_ros.methods.score import fading, path_strength, track_score
from tsepm_ros.methods.score.hypotheses import Grown, Hypotheses
from tsepm_ros.methods.score.score_options import ScoreOptions
from tsepm_ros.methods.score.track_score import ExpectedDetections
from tsepm_ros.numerics import grouped
from tsepm_ros.numerics.arrays import FloatArray, IntArray, changed, keep_best
from tsepm_ros.tracker import motion, pruning, range_rates
from tsepm_ros.tracker.method import Observation
from tsepm_ros.tracker.path_fit import starting
from tsepm_ros.tracker.sensor import MIN_CLUTTER_DENSITY, SensorModel

MAX_PAIRS_TOGETHER = 50_000
"""Pairs of hypotheses and detections that are scored together: bounds memory."""
RELATIVE_PRUNING = math.log(1e-4)
"""Log of the fraction of the best likelihood ratio with the same last hit; below, deleted."""
NEARING_SHARE = 0.2
"""Share of a time limit after which only the nearest detections of a hypothesis are sought."""


def predict(hypotheses: Hypotheses, interval: float, process_noise: float) -> Hypotheses:
    """The hypotheses after a time interval, s, with nearly constant velocity; see `fading` too."""
    state, covariance = motion.predict(
        hypotheses.state, hypotheses.covariance, interval, process_noise
    )
    faded = fading.predicted(hypotheses.faded)
    return changed(hypotheses, state=state, covariance=covariance, faded=faded)


def grow(
    hypotheses: Hypotheses,
    observed: Observation,
    ids: IntArray,
    sensor: SensorModel,
    options: ScoreOptions,
    *,
    max_speed: float,
    max_children: int,
) -> tuple[Grown, int]:
    """Grow the tree by a scan: predict, split, start and miss.

    Parameters
    ----------
    hypotheses : Hypotheses
        As of the scan before.
    max_speed : float
        v_max, m/s.
    observed, ids, sensor, options, max_children
        See `split`.

    Returns
    -------
    grown : Grown
    cut : int
    """
    predicted = predict(hypotheses, observed.interval, options.process_noise)
    detection_probability = observed.detection_probability(predicted.state[:, 0::2])
    detection_probability = detection_probability * fading.visible_share(predicted.faded)
    children, cut = split(
        predicted, detection_probability, observed, ids, sensor, options, max_children=max_children
    )
    started = start(observed, ids, max_speed, options.window)
    missed = miss(predicted, detection_probability, options.gate_probability)
    return Grown(Hypotheses.joined(*children, started), missed, ids), cut


def held_penalty(observed: Observation, row: IntArray, strength: FloatArray) -> FloatArray:
    """``ln((lambda + held density) / lambda)``, (p,): a hit's loss by held tracks.

    Where the strength speaks for a target, by `strength` (p,), it speaks for the held one as well.
    """
    ratio = observed.held_density / np.maximum(observed.clutter_density, MIN_CLUTTER_DENSITY)
    return np.log1p(ratio[row] * np.exp(np.maximum(strength, 0.0)))


def start(observed: Observation, ids: IntArray, max_speed: float, window: int) -> Hypotheses:
    """Start a hypothesis from every detection.

    The velocity is unknown up to v_max: uniform over the disc, of variance v_max^2 / 4 on each
    axis. The first range rate, if measured, updates it along the line of sight and contributes to
    the score.

    Parameters
    ----------
    observed : Observation
        The scan.
    ids : (d,) ndarray of int
        Ids of its detections.
    max_speed : float
        v_max, m/s.
    window : int
        Hits that a hypothesis may have.

    Returns
    -------
    Hypotheses
        Of one hit each.
    """
    detections = observed.detections
    path = starting(ids, observed.scan_index, window)
    state, covariance = np.zeros((len(path), 4)), np.zeros((len(path), 4, 4))
    state[:, 0::2] = detections["position"]
    covariance[:, 0::2, 0::2] = detections["covariance"]
    covariance[:, [1, 3], [1, 3]] = max_speed**2 / 4.0
    state, covariance, score = range_rates.begun(
        state, covariance, detections, observed.clutter_sensor
    )
    # An echo is of a time after the stamp; a hypothesis' state is at the stamp.
    elapsed = observed.stamp - detections["time"]
    if elapsed.any():
        state, covariance = motion.predict(state, covariance, elapsed)
    strength = path_strength.begun(observed)
    score = score + strength.score
    given_held = score - held_penalty(observed, np.arange(len(path)), strength.score)
    return Hypotheses(
        path.hits,
        path.hit_count,
        path.first_scan,
        state,
        covariance,
        score,
        given_held,
        np.full(len(path), fading.FADED_AT_START),
        *strength,
    )


def miss(
    predicted: Hypotheses, detection_probability: FloatArray, gate_probability: float
) -> Hypotheses:
    """The branches of all hypotheses that leave the scan out.

    Parameters
    ----------
    predicted : Hypotheses
    detection_probability : (n,) ndarray
        P_D where each expects its target.
    gate_probability : float
        P_G.
    """
    increment = track_score.miss_increment(detection_probability, gate_probability)
    return changed(
        predicted,
        score=predicted.score + increment,
        score_given_held=predicted.score_given_held + increment,
        faded=fading.after_miss(predicted.faded, detection_probability, gate_probability),
    )


def split(
    predicted: Hypotheses,
    detection_probability: FloatArray,
    observed: Observation,
    ids: IntArray,
    sensor: SensorModel,
    options: ScoreOptions,
    *,
    max_children: int,
    block: int = MAX_PAIRS_TOGETHER,
) -> tuple[list[Hypotheses], int]:
    """Extend every hypothesis by each detection in its gate, ``d' S^-1 d <= gamma``.

    Hypotheses predicted outside the coverage are not extended: their misses cost nothing, so that
    hits there would make the evidence of clutter grow. Given the held tracks, a hit adds less by
    `held_penalty`, the log of how much denser detections are with those of held tracks.

    Parameters
    ----------
    predicted : Hypotheses
    detection_probability : (n,) ndarray
        P_D where each expects its target.
    observed : Observation
        The scan. From half of its time limit on no further block is looked at; the best hypotheses
        come first.
    ids : (d,) ndarray of int
        Ids of its detections.
    sensor : SensorModel
    options : ScoreOptions
    max_children : int
        The best are kept.
    block : int
        Pairs of hypotheses and detections looked at together: bounds memory.

    Returns
    -------
    children : list of Hypotheses
        Those that are not deleted at once, in blocks.
    cut : int
        Pairs that a limit left out.
    """
    limit = observed.time_limit
    expected = ExpectedDetections.of(predicted, observed.stamp, observed.detections, sensor)
    late = partial(limit.used, NEARING_SHARE) if limit.finite else None
    parent, row, cut = expected.near(options.gate_probability, late)
    order = np.arange(len(parent))
    if limit.finite and len(parent) > block:
        order = np.argsort(-predicted.score[parent], kind="stable")
    score = np.full(len(parent), -np.inf)
    for first in range(0, len(parent), block):
        if first and limit.left < 0.5 * limit.seconds:
            cut += len(parent) - first
            break
        part = order[first : first + block]
        score[part] = child_score(
            expected,
            detection_probability,
            parent[part],
            observed,
            row[part],
            options.gate_probability,
        )
    kept = np.flatnonzero(score > options.deletion_threshold)
    kept = kept[grouped.among_best(row[kept], score[kept], options.max_per_detection)]
    best = keep_best(-score[kept], max_children)
    cut += len(kept) - len(best)
    kept = kept[best]
    parts = [kept[first : first + block] for first in range(0, max(len(kept), 1), block)]
    children = [
        updated(expected, parent[part], observed, row[part], ids, score[part]) for part in parts
    ]
    return children, cut


def child_score(
    expected: ExpectedDetections,
    detection_probability: FloatArray,
    parent: IntArray,
    observed: Observation,
    row: IntArray,
    gate_probability: float,
) -> FloatArray:
    """Score of each child (p,) of a hypothesis and a detection.

    Parameters
    ----------
    expected : ExpectedDetections
    detection_probability : (n,) ndarray
        P_D where each expects its target.
    parent, row : (p,) ndarray of int
        Hypothesis and detection of each child.
    observed : Observation
    gate_probability : float
        P_G.

    Returns
    -------
    (p,) ndarray
        -inf outside the gate, or where P_D is 0.
    """
    density = expected.log_likelihood(parent, row, gate_probability)
    increment = track_score.hit_increment(
        density, detection_probability[parent], observed.clutter_density[row]
    )
    hypotheses = expected.hypotheses
    score: FloatArray = hypotheses.score[parent] + increment
    if observed.predictive is not None:
        score += observed.predictive.increment(hypotheses.hit_count, parent, row)
    if observed.strengths is not None:
        score += path_strength.extended(hypotheses, parent, observed, row).increment
    return score


def updated(
    expected: ExpectedDetections,
    parent: IntArray,
    observed: Observation,
    row: IntArray,
    ids: IntArray,
    score: FloatArray,
) -> Hypotheses:
    """The children of hypotheses and detections, with their scores (p,); see `child_score`."""
    hypotheses = expected.hypotheses
    hits = hypotheses.hits.take(parent, axis=0)
    count = hypotheses.hit_count[parent]
    hits[np.arange(len(parent)), count] = ids[row]
    strength = path_strength.extended(hypotheses, parent, observed, row)
    given_held = hypotheses.score_given_held[parent] + score - hypotheses.score[parent]
    given_held -= held_penalty(observed, row, strength.increment)
    state, covariance = expected.updated(parent, row)
    return Hypotheses(
        hits,
        count + 1,
        hypotheses.first_scan[parent],
        state,
        covariance,
        score,
        given_held,
        fading.after_hit(hypotheses.faded[parent]),
        strength.hits,
        strength.total,
        hypotheses.strength_score[parent] + strength.increment,
    )


def prune(grown: Grown, scan_index: int, options: ScoreOptions) -> Hypotheses:
    """Delete the hypotheses that are too old or too unlikely.

    A hypothesis is unlikely where its score is below the deletion threshold, or far below the best
    with the same last detection, or where `max_per_detection` with that detection are better.

    Parameters
    ----------
    grown : Grown
    scan_index : int
        Of the last scan.
    options : ScoreOptions
    """
    # No hypothesis of one part has the last detection of one of the other.
    parts = grown.ended, grown.missed
    return Hypotheses.chosen(parts, [_kept(part, scan_index, options) for part in parts])


def _kept(hypotheses: Hypotheses, scan_index: int, options: ScoreOptions) -> IntArray:
    """Rows of the hypotheses that are not deleted."""
    kept = hypotheses.score > options.deletion_threshold
    kept &= ~pruning.expired(scan_index + 1 - hypotheses.first_scan, options.window)
    rows = np.flatnonzero(kept)
    score = hypotheses.score[rows]
    last = hypotheses.last_hit[rows]
    # Detections are numbered from the start on: their groups from the oldest that is left.
    group = last - (last.min() if len(last) else 0)
    best = grouped.largest_of(score, group, int(group.max(initial=-1)) + 1)[group]
    kept = grouped.among_best(group, score, options.max_per_detection)
    return rows[kept & (score > best + RELATIVE_PRUNING)]


def strongest(hypotheses: Hypotheses, limit: int) -> Hypotheses:
    """The hypotheses of the best scores, up to a limit."""
    if len(hypotheses) <= limit:
        return hypotheses
    return hypotheses[keep_best(-hypotheses.score, limit)]
