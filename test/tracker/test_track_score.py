"""Log-likelihood ratios of tracks: their increments and sums, and the chain of seen and faded."""

import itertools
import math

import numpy as np
import pytest
from scipy.special import logsumexp

from tsepm_ros.numerics.gaussian import gate_factor, log_density
from tsepm_ros.numerics.grouped import summed
from tsepm_ros.tracker import evaluation
from tsepm_ros.tracker.evaluation import hit_increment, miss_increment

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


def over_all_sequences(detected: tuple[bool, ...]) -> float:
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
    assert scores(detected) == pytest.approx(over_all_sequences(detected), abs=1e-12)


def test_it_costs_little_where_detections_are_as_told_and_helps_where_they_are_fewer():
    rng = np.random.default_rng(1)
    for true, least, most in ((0.9, -0.6, -0.3), (0.6, 3.5, 4.5)):
        detected = rng.random((400, 15)) < true
        told = np.where(detected, math.log(P_D), math.log(1.0 - P_D * P_G)).sum(axis=1)
        gain = np.mean([scores(tuple(row)) for row in detected]) - told.mean()
        assert least < gain < most


SPREAD = np.array([[900.0, 300.0], [300.0, 400.0]])


@pytest.mark.parametrize(("p_d", "p_g"), [(0.9, 0.99), (0.6, 0.9), (0.3, 0.999)])
def test_the_mean_ratio_over_what_clutter_may_do_is_one(p_d, p_g):
    # A scan of clutter: each detection in the gate gives a child, and there is the missed branch.
    # Their expected sum, lambda times the integral over the gate and the miss, must be 1.
    clutter = 1e-5
    axis = np.linspace(-200.0, 200.0, 1601)
    x, y = np.meshgrid(axis, axis)
    points = np.stack([x.ravel(), y.ravel()], axis=1)
    density, distance = log_density(points, np.broadcast_to(SPREAD, (len(points), 2, 2)))
    increment = hit_increment(density, p_d, np.full(len(points), clutter))
    inside = distance <= gate_factor(p_g) ** 2
    cell = (axis[1] - axis[0]) ** 2
    children = clutter * cell * np.exp(increment[inside]).sum()
    missed = math.exp(miss_increment(np.array([p_d]), p_g)[0])
    assert children + missed == pytest.approx(1.0, abs=1e-3)


def test_a_miss_of_a_sure_target_stays_possible():
    assert np.isfinite(miss_increment(np.array([1.0]), 1.0 - 1e-12)).all()


def test_no_clutter_at_all_does_not_make_a_detection_worth_everything():
    assert np.isfinite(hit_increment(np.array([-10.0]), 0.9, np.array([0.0]))).all()


def test_sums_are_of_the_ratios_not_of_their_logarithms():
    rng = np.random.default_rng(1)
    score = rng.uniform(-800.0, 800.0, 300)  # beyond what exp can hold
    group = rng.integers(0, 20, 300)
    group[group == 7] = 8
    expected = [logsumexp(score[group == k]) if (group == k).any() else -np.inf for k in range(20)]
    np.testing.assert_allclose(summed(score, group, 20), expected)
