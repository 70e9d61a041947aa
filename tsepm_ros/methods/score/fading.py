"""Targets whose detection probability is not a constant: a chain of seen and faded, in the tree.

A target is seen with the P_D in use, or it has faded to less: by aspect, shadow or weather, or
because the data sheet flatters. It is in either state for a while (the Markov chain of Musicki,
Evans, Stankovic, IEEE Trans. Autom. Control 39(6), 1994, with P_D above 0 in both), so that a miss
makes further misses cheaper. With f the probability that it has faded, from scan to scan::

    predicted     f <- F + (f - F) exp(-1 / FADING_SCANS),   F = FADED_SHARE
    P_D           P_D v,   v = 1 - (1 - b) f,   b = FADED_FACTOR
    hit           f <- b f / v
    miss          f <- f (1 - b P_D P_G) / (1 - P_D v P_G)

The score stays the likelihood ratio of a target drawn from this model. Over 15 scans of 12 s after
the first detection it loses 0.5 where P_D is 0.9 as told. Where P_D is 0.6 and told as 0.9, it
loses 0.7 instead of 4.7.
"""

from __future__ import annotations

import math

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray

FADED_SHARE = 0.4
"""Share of the time for which a target has faded: a choice.

Data sheets overstate: a target far away, or seen from ahead, is detected less often. Where P_D is
smaller than assumed, misses speak too much against the target, and targets are lost; where it is as
told, starts are slightly later. docs/score.md has the figures.
"""
FADED_FACTOR = 0.6
"""Detection probability of a faded target, in that of a seen one: a choice."""
FADING_SCANS = 10.0
"""Time constant of the chain, in scans: a choice."""
FADED_AT_START = FADED_SHARE * FADED_FACTOR / (1.0 - FADED_SHARE * (1.0 - FADED_FACTOR))
"""Probability that a target has faded, given its first detection."""


def predicted(faded: FloatArray) -> FloatArray:
    """Probability that targets have faded (n,) at the next scan."""
    kept = math.exp(-1.0 / FADING_SCANS)
    return np.asarray(FADED_SHARE + kept * (faded - FADED_SHARE))


def visible_share(faded: FloatArray) -> FloatArray:
    """Mean detection probability of targets (n,), in that of a seen one."""
    return np.asarray(1.0 - (1.0 - FADED_FACTOR) * faded)


def after_hit(faded: FloatArray) -> FloatArray:
    """Probability that targets have faded (n,) after a detection."""
    return np.asarray(FADED_FACTOR * faded / visible_share(faded))


def after_miss(
    faded: FloatArray, detection_probability: FloatArray, gate_probability: float
) -> FloatArray:
    """Probability that targets have faded (n,) after a miss.

    Parameters
    ----------
    faded : (n,) ndarray
        Before it.
    detection_probability : (n,) ndarray
        Mean P_D of each: that of a seen target times `visible_share`.
    gate_probability : float
        P_G.
    """
    seen = detection_probability / visible_share(faded)
    missed = 1.0 - detection_probability * gate_probability
    return np.asarray(faded * (1.0 - FADED_FACTOR * seen * gate_probability) / missed)
