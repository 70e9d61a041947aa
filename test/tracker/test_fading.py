"""The chain of seen and faded: against a sum over all sequences of states."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from tsepm_ros.tracker import evaluation

P_D, P_G = 0.9, 0.99


def scores(detected: tuple[bool, ...]) -> float:
    """Log-likelihood of detections after the first, by the recursion."""
    faded, total = np.array([evaluation.FADED_AT_START]), 0.0
    for hit in detected:
        faded = evaluation.fading_predicted(faded)
        probability = P_D * evaluation.visible_share(faded)
        if hit:
            total += math.log(probability[0])
            faded = evaluation.fading_after_hit(faded)
        else:
            total += math.log(1.0 - probability[0] * P_G)
            faded = evaluation.fading_after_miss(faded, probability, P_G)
    return total


def summed(detected: tuple[bool, ...]) -> float:
    """The same from all sequences of states: seen 0, faded 1; the first scan had a detection."""
    stays = math.exp(-1.0 / 10.0)
    share, p_d = (0.6, 0.4), (P_D, 0.6 * P_D)
    first = [share[k] * p_d[k] for k in (0, 1)]
    total = 0.0
    for states in itertools.product((0, 1), repeat=len(detected) + 1):
        weight = first[states[0]] / sum(first)
        for (before, after), hit in zip(itertools.pairwise(states), detected, strict=True):
            weight *= stays * (before == after) + (1.0 - stays) * share[after]
            weight *= p_d[after] if hit else 1.0 - p_d[after] * P_G
        total += weight
    return math.log(total)


@pytest.mark.parametrize("detected", list(itertools.product((True, False), repeat=5)))
def test_the_recursion_is_the_sum_over_all_sequences_of_states(detected):
    assert scores(detected) == pytest.approx(summed(detected), abs=1e-12)


def test_it_costs_little_where_detections_are_as_told_and_helps_where_they_are_fewer():
    rng = np.random.default_rng(1)
    for true, least, most in ((0.9, -0.6, -0.3), (0.6, 3.5, 4.5)):
        detected = rng.random((400, 15)) < true
        told = np.where(detected, math.log(P_D), math.log(1.0 - P_D * P_G)).sum(axis=1)
        gain = np.mean([scores(tuple(row)) for row in detected]) - told.mean()
        assert least < gain < most
