"""Strengths along the paths of the tree: what each hit adds to the score.

The score of a path has ``ln L(n, V)`` of its hits' strengths, see `environment.target_strength`; a
hit adds ``ln L(n + 1, V + v) - ln L(n, V)``. Without strengths it adds 0.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tsepm_ros.methods.score.hypotheses import Hypotheses
from tsepm_ros.numerics.arrays import FloatArray, IntArray
from tsepm_ros.tracker.detection_window import DetectionWindow
from tsepm_ros.tracker.method import Observation, TargetHits
from tsepm_ros.tracker.path_fit import NO_HIT

PRIOR_TARGET_ODDS = 0.2
"""Prior odds, for the law of clutter, that a path is a target's: positions do not bias it."""
MIN_PROBABILITY = 0.25
"""Probability of a target from which a detection's weight in that law is changed."""


class Begun(NamedTuple):
    """Strengths of paths of one hit; see `Hypotheses`."""

    hits: IntArray
    total: FloatArray
    score: FloatArray


class Extended(NamedTuple):
    """Strengths of paths with a further hit, and what that adds to the score, (p,) each."""

    hits: IntArray
    total: FloatArray
    increment: FloatArray


def begun(observed: Observation) -> Begun:
    """Strengths of the paths that start with each of a scan's detections, (d,)."""
    strengths, n = observed.strengths, len(observed.detections)
    if strengths is None:
        return Begun(np.zeros(n, np.int64), np.zeros(n), np.zeros(n))
    count = strengths.told.astype(np.int64)
    return Begun(count, strengths.scaled, strengths.ratio.at(count, strengths.scaled))


def extended(paths: Hypotheses, parent: IntArray, observed: Observation, row: IntArray) -> Extended:
    """Strengths of the children of paths and detections.

    Parameters
    ----------
    paths : Hypotheses
    parent, row : (p,) ndarray of int
        Path and detection of each child.
    observed : Observation
    """
    before, total_before = paths.strength_count[parent], paths.strength_total[parent]
    strengths, n = observed.strengths, len(row)
    if strengths is None or not n:
        return Extended(before, total_before, np.zeros(n))
    count, total = before + strengths.told[row], total_before + strengths.scaled[row]
    both = strengths.ratio.at(
        np.concatenate([before, count]), np.concatenate([total_before, total])
    )
    return Extended(count, total, both[n:] - both[:n])


def target_hits(paths: Hypotheses, window: DetectionWindow) -> TargetHits:
    """Hits of paths that are probably targets' by their positions."""
    log_odds = paths.score - paths.strength_score + math.log(PRIOR_TARGET_ODDS)
    likely = np.flatnonzero(log_odds > math.log(MIN_PROBABILITY / (1.0 - MIN_PROBABILITY)))
    hits = paths.hits[likely]
    path, place = np.nonzero(hits != NO_HIT)
    detection = hits[path, place]
    if not len(detection):
        none = np.zeros(0, np.int64)
        return TargetHits(none, none, np.zeros(0))
    first = detection.min()
    best = np.full(detection.max() + 1 - first, -np.inf)
    np.maximum.at(best, detection - first, log_odds[likely][path])
    hit = np.flatnonzero(best > -np.inf)
    of = window[hit + first]
    return TargetHits(of["scan"], of["index"], 1.0 / (1.0 + np.exp(-best[hit])))
