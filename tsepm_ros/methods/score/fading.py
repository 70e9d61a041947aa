"""Targets whose detection probability is not a constant: a chain of seen and faded, in the tree.

A target is seen with the P_D in use, or it has faded to half of it: by aspect, shadow or weather,
or because the data sheet flatters. It is in either state for a while (the Markov chain of Musicki,
Evans, Stankovic, IEEE Trans. Autom. Control 39(6), 1994, with P_D above 0 in both), so that a miss
makes further misses cheaper. With f the probability that it has faded, over a time t::

    predicted     f <- F + (f - F) exp(-t / FADING_TIME),   F = FADED_SHARE
    P_D           P_D (1 - f / 2)
    hit           f <- (f / 2) / (1 - f / 2)
    miss          f <- f (1 - P_D P_G / 2) / (1 - P_D (1 - f / 2) P_G)

The score stays the likelihood ratio of a target drawn from this model. Where P_D is as told, it
loses 0.006 per scan; at 0.6 told as 0.9 it gains 0.16 per scan.
"""

from __future__ import annotations

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray

FADED_SHARE = 0.1
"""Share of the time for which a target has faded: a choice."""
FADED_FACTOR = 0.5
"""Detection probability of a faded target, in that of a seen one."""
FADING_TIME = 120.0
"""Time constant of the chain, s."""
FADED_AT_START = FADED_SHARE * FADED_FACTOR / (1.0 - FADED_SHARE * (1.0 - FADED_FACTOR))
"""Probability that a target has faded, given its first detection."""


def predicted(faded: FloatArray, interval: float) -> FloatArray:
    """Probability that targets have faded (n,) after a time, s."""
    kept = float(np.exp(-abs(interval) / FADING_TIME))
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
