"""The end of the velocity prior at v_max: evidence of hypotheses whose velocity is in the disc.

The tree's filters have a Gaussian prior of the velocity, of variance v_max^2 / 4 on each axis. The
prior that is meant ends at v_max. Of the Gaussian truncated there, the likelihood ratio of a
hypothesis with the posterior N(x, P) is exactly ::

    s <- s + ln P(|v| <= v_max | N(x, P)) - ln P_0,    P_0 = 1 - exp(-2) of the prior

That is 0.15 more where the velocity is surely inside, and much less where it is surely outside. It
is a likelihood ratio of mean 1 under clutter as before: the bound on false confirmations holds.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from tsepm_ros.kinematics import speed_limit
from tsepm_ros.methods.score.grown import Grown
from tsepm_ros.methods.score.hypotheses import Hypotheses
from tsepm_ros.methods.score.score_options import MIN_HITS
from tsepm_ros.methods.score.tree import RELATIVE_PRUNING
from tsepm_ros.numerics import grouped
from tsepm_ros.numerics.arrays import BoolArray
from tsepm_ros.numerics.rows import changed
from tsepm_ros.stages.paths import NO_HIT

LOG_GAIN = -math.log(-math.expm1(-2.0))
"""-ln P_0: what the evidence gains where the velocity is surely inside."""


def ended_at(grown: Grown, threshold: float, max_speed: float) -> Grown:
    """The tree with the evidence under the prior that ends at v_max.

    Only hypotheses that count where evidence may reach the threshold are changed.

    Parameters
    ----------
    grown : Grown
    threshold : float
        Of the evidence.
    max_speed : float
        v_max, m/s.
    """
    return with_rivals(grown, decided(grown, threshold, max_speed), threshold, max_speed)


def decided(grown: Grown, threshold: float, max_speed: float) -> Grown:
    """As `ended_at`, for the evidence alone: rivals in other detections are as they were."""
    strong = _strong(grown, threshold)
    if not strong.any():
        return grown
    return replace(grown, ended=_ended_at(grown.ended, strong[grown.newest], max_speed))


def with_rivals(grown: Grown, decided: Grown, threshold: float, max_speed: float) -> Grown:
    """As `ended_at`, of the tree and what `decided` made of it."""
    strong, passed = _strong(grown, threshold), decided.evidence >= threshold
    if not strong.any() or not passed.any():
        return decided  # no start, and no rival of any
    # Of other detections, those that may be rivals of a start: they share a hit with it.
    hits = np.unique(grown.ended.hits[passed[grown.newest]])
    hits = hits[hits != NO_HIT]
    least = threshold + RELATIVE_PRUNING - LOG_GAIN

    def rival(hypotheses: Hypotheses) -> BoolArray:
        likely = hypotheses.score >= least
        likely[likely] = np.isin(hypotheses.hits[likely], hits).any(axis=1)
        return likely

    return replace(
        grown,
        ended=_ended_at(grown.ended, strong[grown.newest] | rival(grown.ended), max_speed),
        missed=_ended_at(grown.missed, rival(grown.missed), max_speed),
    )


def _strong(grown: Grown, threshold: float) -> BoolArray:
    """Which detections (d,) may reach the threshold."""
    strong: BoolArray = grown.evidence + LOG_GAIN >= threshold
    hits = grown.ended.hit_count.astype(float)
    strong &= grouped.largest_of(hits, grown.newest, len(grown.ids)) >= MIN_HITS
    return strong


def _ended_at(hypotheses: Hypotheses, counts: BoolArray, max_speed: float) -> Hypotheses:
    """The hypotheses; those that count (n,) with their scores under the prior that ends at v_max.

    That of a single hit is as before: its posterior is the prior.
    """
    rows = np.flatnonzero(counts & (hypotheses.hit_count >= 2))
    gain = np.zeros(len(hypotheses))
    gain[rows] = LOG_GAIN + speed_limit.log_probability(
        hypotheses.state[rows], hypotheses.covariance[rows], max_speed
    )
    return changed(
        hypotheses,
        score=hypotheses.score + gain,
        score_given_held=hypotheses.score_given_held + gain,
    )
