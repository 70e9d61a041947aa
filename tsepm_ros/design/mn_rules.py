"""Probabilities of the M/N rule, in closed form and by Markov chains: detection and false starts.

The scans of a start count from its first hit, which is one of the M hits and the first of the N
scans.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from tsepm_ros.numerics.arrays import FloatArray


def rule_detection_probability(
    min_hits: int, window: int, detection_probability: float, gate_probability: float
) -> float:
    """P_D of TSEPM 2018, Table 1: a target confirmed by a start in the first scan.

    ``P_D = p_d P(Binomial(N - 1, P p_d) >= M - 1)``

    Parameters
    ----------
    min_hits, window : int
        M and N.
    detection_probability, gate_probability : float
        p_d, and P that a detected target falls into the gate.
    """
    hit = gate_probability * detection_probability
    trials = window - 1
    return detection_probability * sum(
        math.comb(trials, hits) * hit**hits * (1.0 - hit) ** (trials - hits)
        for hits in range(min_hits - 1, trials + 1)
    )


def gate_areas(max_speed: float, interval: float, margin: ArrayLike, window: int) -> FloatArray:
    """Area of the gate k scans after the last hit, ``pi (v_max k T + g)^2``, k = 1 to N, m^2.

    Parameters
    ----------
    max_speed, interval : float
        v_max, m/s, and T, s.
    margin : (...) array_like
        g, m: ``alpha sigma_Rmax`` in Eq. 4.
    window : int
        N.

    Returns
    -------
    (..., N) ndarray
    """
    reach = max_speed * interval * np.arange(1, window + 1)
    return np.pi * np.square(reach + np.asarray(margin, float)[..., None])


def false_start_probability(
    min_hits: int, window: int, clutter_density: float, areas: FloatArray
) -> float:
    """P_F(1) of TSEPM 2018, Table 1: a start from clutter reaches M hits within N scans.

    A first-passage chain over the number of hits and the scans k since the last hit. A gate has a
    hit with probability ``p_k = 1 - exp(-lambda a_k)``; tracks do not split.

    Parameters
    ----------
    min_hits, window : int
        M and N.
    clutter_density : float
        lambda, 1/m^2.
    areas : (N,) ndarray
        a_k, see `gate_areas`, m^2.
    """
    hit = -np.expm1(-clutter_density * areas[:window])
    state = np.zeros((min_hits, window))  # hits - 1, k - 1
    state[0, 0] = 1.0
    confirmed = 0.0
    for _ in range(window - 1):
        hits = state @ hit
        confirmed += hits[min_hits - 2]
        missed = state * (1.0 - hit)
        state = np.zeros_like(state)
        state[:, 1:] = missed[:, :-1]
        state[1:, 0] = hits[:-1]
        state[min_hits - 1] = 0.0
    return float(confirmed)


def confirmed_by(
    min_hits: int,
    window: int,
    detection_probability: float,
    gate_probability: float,
    scans: int,
    pass_share: float = 1.0,
) -> FloatArray:
    """Probability that a target present from the first scan on is confirmed by each scan.

    A chain over the scans and hits of the target's start. While a start lives, the
    target's hits extend it. It ends after N scans without M hits or when its evaluation fails; then
    the next detection starts a new track.

    Parameters
    ----------
    min_hits, window : int
        M and N.
    detection_probability, gate_probability : float
        p_d and P.
    scans : int
        Number of scans.
    pass_share : float, optional
        Share of a target's tracks that pass the evaluation.

    Returns
    -------
    (scans,) ndarray
        Without clutter, which can only delay a target's start or add hits to it.
    """
    hit = gate_probability * detection_probability
    alive = np.zeros((window, min_hits))  # scans - 1, hits - 1
    idle, confirmed = 1.0, 0.0
    by_scan = np.zeros(scans)
    for scan in range(scans):
        moved = np.zeros_like(alive)
        moved[1:] += alive[:-1] * (1.0 - hit)
        moved[1:, 1:] += alive[:-1, :-1] * hit
        reached = moved[:, min_hits - 1].sum()
        moved[:, min_hits - 1] = 0.0
        confirmed += reached * pass_share
        ended = reached * (1.0 - pass_share) + moved[window - 1].sum()
        moved[window - 1] = 0.0
        moved[0, 0] = idle * detection_probability
        idle = idle * (1.0 - detection_probability) + ended
        alive = moved
        by_scan[scan] = confirmed
    return by_scan
