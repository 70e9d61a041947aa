"""Association of detections with confirmed tracks, against the equations in plain loops."""

import math

import numpy as np
import pytest
from support.builders import FIXED_RANGE_ERROR, detections

from tsepm_ros.tracker.maintenance import data_association
from tsepm_ros.tracker.maintenance.data_association import (
    GatedDetections,
    associate,
    gate,
    over_modes,
    updated_existence,
    updated_states,
)
from tsepm_ros.tracker.motion import position_after, update


def plain(r, b, likelihood, row, number):
    """Shares beta_ij, competing ratios and confirmed density, for one kind: lists of lists by
    track."""

    def factor(i, j, values):
        rest = b[i] + sum(values[i][k] for k in range(len(row[i])) if k != j)
        return math.log1p(r[i] * likelihood[i][j] / (1.0 - r[i] + r[i] * rest))

    tracks = range(len(row))
    alone = [[factor(i, j, likelihood) for j in range(len(row[i]))] for i in tracks]
    by_detection = [
        sum(alone[i][j] for i in tracks for j in range(len(row[i])) if row[i][j] == z)
        for z in range(number)
    ]
    competing = [
        [
            likelihood[i][j] * math.exp(alone[i][j] - by_detection[row[i][j]])
            for j in range(len(row[i]))
        ]
        for i in tracks
    ]
    beta = [[one / (b[i] + sum(competing[i])) for one in competing[i]] for i in tracks]
    confirmed = [0.0] * number
    for i in tracks:
        for j in range(len(row[i])):
            confirmed[row[i][j]] += factor(i, j, competing)
    return beta, [math.expm1(one) for one in confirmed]


@pytest.mark.parametrize("seed", range(4))
def test_targets_compete_for_detections_as_in_plain_loops(seed):
    rng = np.random.default_rng(seed)
    n, k, number = 4, 3, 5
    existence, empty = rng.uniform(0.2, 0.99, n), rng.uniform(0.1, 0.9, n)
    modes = rng.dirichlet((1.0, 1.0), n)
    ratios = rng.exponential(3.0, (n, 3, k))
    row = np.array([[rng.permutation(number)[:k] for _ in range(2)] for _ in range(n)])
    clutter = rng.uniform(0.5, 2.0, number)
    ratio, probability, confirmed = associate(existence, empty, modes, ratios, row, clutter)
    of_filter = (modes[:, :, None] * ratios[:, :2]).sum(axis=1)
    for kind, likelihood in enumerate((of_filter, ratios[:, 2])):
        beta, density = plain(existence, empty, likelihood, row[:, kind], number)
        np.testing.assert_allclose(probability[:, kind], beta)
        if kind == 0:
            np.testing.assert_allclose(confirmed, clutter * density)
    left = ratio / ratios
    np.testing.assert_allclose(left[:, 0], left[:, 1], err_msg="both modes are the filter's")
    assert (left <= 1.0 + 1e-12).all()
    np.testing.assert_allclose(over_modes(modes, ratios)[:, 0], of_filter)
    np.testing.assert_array_equal(over_modes(modes, ratios)[:, 1], ratios[:, 2])


def test_a_target_alone_has_its_detections_by_bayes():
    ratios = np.full((1, 3, 1), 9.0)
    _, probability, confirmed = associate(
        np.array([0.8]),
        np.array([0.1]),
        np.array([[0.5, 0.5]]),
        ratios,
        np.zeros((1, 2, 1), np.int64),
        np.array([2.0]),
    )
    np.testing.assert_allclose(probability, 9.0 / 9.1)
    np.testing.assert_allclose(confirmed, 2.0 * 0.8 * 9.0 / (0.2 + 0.8 * 0.1))


def test_existence_falls_and_rises_by_the_likelihood_ratio_of_the_scan():
    found = updated_existence(np.array([0.5, 0.5, 0.9, 1.0]), np.array([1.0, 3.0, 0.1, 0.1]))
    np.testing.assert_allclose(found, [0.5, 0.75, 0.09 / 0.19, 1.0])


def tracks_at(places, speed=2.0):
    """Three modes of each track: state, covariance, means of filter and fit."""
    n = len(places)
    state = np.zeros((n, 3, 4))
    state[..., 0::2] = np.asarray(places, float)[:, None]
    state[..., 1] = speed * np.arange(1.0, 4.0)
    covariance = np.diag([40.0, 1.0, 60.0, 2.0]) * np.arange(1.0, 4.0)[:, None, None]
    covariance = np.broadcast_to(covariance, (n, 3, 4, 4)).copy()
    return state, covariance, np.stack([state[:, :2].mean(axis=1), state[:, 2]], axis=1)


@pytest.mark.parametrize("many", [16_000, 1], ids=["all distances", "by a tree"])
def test_the_gate_has_the_likelihoods_of_the_nearest_detections(monkeypatch, many):
    monkeypatch.setattr(data_association, "MANY", many)
    rng = np.random.default_rng(5)
    places = np.array([[3000.0, 0.0], [0.0, 4000.0]])
    around = places[:, None] + rng.normal(0.0, 60.0, (2, 9, 2))
    found = detections(around.reshape(-1, 2), 104.0)
    found["azimuth_std"], found["range_std"] = 0.01, 20.0
    state, covariance, mean = tracks_at(places)
    gated = gate(state, covariance, mean, 100.0, found, FIXED_RANGE_ERROR)
    inside = 0
    for track in range(2):
        for mode in range(3):
            rows = gated.row[track, mode // 2]
            centre = position_after(mean[track, mode // 2], 4.0)
            distance = np.hypot(*(found["position"] - centre).T)
            assert rows.tolist() == np.argsort(distance)[: len(rows)].tolist()
            x, p = state[track, mode], covariance[track, mode]
            h = np.kron(np.eye(2), [1.0, 4.0])
            expected = h @ x
            sight = expected / np.hypot(*expected)
            across = np.array([-sight[1], sight[0]])
            far = np.hypot(*expected)
            r = 20.0**2 * np.outer(sight, sight) + (far * 0.01) ** 2 * np.outer(across, across)
            s = h @ p @ h.T + r
            for place, row in enumerate(rows):
                d = found["position"][row] - expected
                square = d @ np.linalg.solve(s, d)
                density = math.exp(-0.5 * square) / (2 * math.pi * math.sqrt(np.linalg.det(s)))
                likelihood = gated.likelihood[track, mode, place]
                if abs(square - 9.21) > 0.1:
                    assert (likelihood > 0.0) == (square < 9.21)
                if likelihood:
                    assert likelihood == pytest.approx(density, rel=0.02)
                    inside += 1
    assert inside == len(gated.pairs[0]) > 5
    track, mode, place = gated.pairs
    row = gated.row[track, mode // 2, place]
    pairs, after = (track, mode), np.full(len(track), 4.0)
    innovation = found["position"][row] - position_after(state[pairs], after)
    nearest = gated.row[track, mode // 2, 0]
    assert len(nearest)
    moved, _ = gated.updated
    gain = update(state[pairs], covariance[pairs], after, innovation, np.eye(2) * 1e9)[0]
    towards = np.einsum("qi,qi->q", moved - state[pairs], gain - state[pairs])
    assert (towards > 0.0).all(), "each goes towards its own detection"


def test_without_detections_the_gate_is_empty():
    state, covariance, mean = tracks_at([[3000.0, 0.0]])
    none = detections(np.zeros((0, 2)), 0.0)
    gated = gate(state, covariance, mean, 100.0, none, FIXED_RANGE_ERROR)
    assert (gated.row.shape, gated.likelihood.shape) == ((1, 2, 0), (1, 3, 0))
    assert [len(one) for one in gated.pairs] == [0, 0, 0]


def test_a_state_becomes_the_mixture_of_what_its_detections_make_of_it():
    rng = np.random.default_rng(7)
    state = rng.normal(size=(2, 3, 4))
    covariance = np.broadcast_to(np.diag([9.0, 4.0, 8.0, 3.0]), (2, 3, 4, 4)).copy()
    pairs = tuple(np.array(one) for one in ([0, 0, 0, 1], [0, 0, 2, 1], [0, 1, 0, 1]))
    moved = state[pairs[:2]] + rng.normal(size=(4, 4))
    smaller = covariance[pairs[:2]] * np.array([0.5, 0.4, 0.6, 0.3])[:, None, None]
    probability = np.zeros((2, 3, 2))
    probability[pairs] = [0.5, 0.2, 0.9, 0.4]
    gated = GatedDetections(np.zeros((2, 2, 2), np.int64), probability, pairs, (moved, smaller))
    found, spread = updated_states(state, covariance, gated, probability)
    for track in range(2):
        for mode in range(3):
            own = np.flatnonzero((pairs[0] == track) & (pairs[1] == mode))
            weights = [*probability[track, mode][pairs[2][own]]]
            means = [*moved[own], state[track, mode]]
            covariances = [*smaller[own], covariance[track, mode]]
            weights.append(1.0 - sum(weights))
            mean = sum(w * x for w, x in zip(weights, means, strict=True))
            total = sum(
                w * (p + np.outer(x - mean, x - mean))
                for w, p, x in zip(weights, covariances, means, strict=True)
            )
            np.testing.assert_allclose(found[track, mode], mean)
            np.testing.assert_allclose(spread[track, mode], total, atol=1e-10)
