"""Track scores and the tree of hypotheses against plain loops; limits; claims of held tracks."""

import math
from dataclasses import fields

import numpy as np
import pytest
from scipy.special import logsumexp
from support.batches import batches
from support.builders import AS_GIVEN, detections
from support.scenes import random_scene
from support.score_scenes import NEVER, SONAR, in_plain_loops, score, sea

from tsepm_ros.numerics.arrays import summed
from tsepm_ros.numerics.gaussian import gate_factor, log_density
from tsepm_ros.tracker import evaluation, pruning, splitting
from tsepm_ros.tracker.evaluation import hit_increment, miss_increment
from tsepm_ros.tracker.hypotheses import ExpectedDetections, Hypotheses
from tsepm_ros.tracker.measurement import DetectionWindow
from tsepm_ros.tracker.options import ScoreOptions

P_D, P_G = 0.9, 0.99


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


@pytest.mark.parametrize("seed", batches(24, 8))
def test_hypotheses_and_scores_are_those_of_plain_loops(seed):
    scene = random_scene(seed)
    plain_scans, sensor, options = in_plain_loops(scene, seed)
    initiator = score(sensor, false_tracks_per_hour=NEVER, **AS_GIVEN, **options)
    compared = 0
    for scan, grown in zip(scene.as_scans(), plain_scans, strict=False):
        expected = grown.kept
        assert len(initiator.process(scan)) == 0
        assert initiator.statistics.potential_tracks == len(expected)
        plain = {one.keys: one for one in expected}
        assert len(plain) == len(expected)
        found = initiator.potential_tracks()
        assert {track.hits for track in found} == {keys for keys in plain if len(keys) > 1}
        for row, hits in enumerate(found.hits):
            np.testing.assert_allclose(found.score[row], plain[hits].score, rtol=1e-7, atol=1e-7)
        inside = initiator.method.hypotheses
        inside = inside[(inside.hit_count > 1) & (inside.score > -np.inf)]
        for row, hits in enumerate(found.hits):
            np.testing.assert_allclose(inside.state[row], plain[hits].state, rtol=1e-6, atol=1e-5)
            scale = np.linalg.norm(plain[hits].covariance)
            np.testing.assert_allclose(
                inside.covariance[row], plain[hits].covariance, rtol=0, atol=1e-7 * scale
            )
        compared += len(found)
    assert compared > 0


def children(seed: int, most: float = math.inf, limit: int = 10**6) -> tuple[Hypotheses, int]:
    """The children of the fourth scan of clutter, and how many were not made or kept."""
    scans = sea(np.random.default_rng(seed), 4, [])
    initiator = score(false_tracks_per_hour=NEVER)
    for scan in scans[:3]:
        initiator.process(scan)
    before = initiator.method.hypotheses
    observed = initiator.observe(scans[3])
    predicted = splitting.predict(before, observed.interval, 0.001)
    expected = ExpectedDetections.of(predicted, observed.stamp, observed.detections, SONAR)
    pairs = parent, row, unmade = splitting.split(expected, 0.99, most)
    missed, scores = evaluation.evaluate(expected, parent, row, observed, 0.99)
    deletion = ScoreOptions().deletion_threshold
    kept, cut = pruning.prune(scores, observed.ids[row], deletion, 100, limit)
    started = splitting.start(observed, 10.0, 16)
    parts = missed, scores, started
    tree = splitting.expand(expected, parts, pairs[:2], kept + len(missed), observed)
    return tree.hypotheses, unmade + cut


@pytest.mark.parametrize("most", [math.inf, 1e6], ids=["no limit", "a limit not reached"])
def test_blocks_do_not_change_the_children(monkeypatch, most):
    expected, _ = children(5)
    monkeypatch.setattr(evaluation, "MAX_PAIRS_TOGETHER", 7)
    monkeypatch.setattr(splitting, "MAX_PAIRS_TOGETHER", 7)
    found, cut = children(5, most)
    assert len(found) > 100
    assert cut == 0
    for field in fields(Hypotheses):
        np.testing.assert_array_equal(getattr(found, field.name), getattr(expected, field.name))


def test_a_limit_on_pairs_keeps_the_nearest_child_of_each_hypothesis_and_counts_the_others():
    every, _ = children(5)
    found, cut = children(5, 1.0)
    assert 0 < len(found) < len(every)
    assert len(found) + cut >= len(every)


def test_of_each_newest_detection_the_likely_hypotheses_are_kept_and_no_more_than_the_most():
    scores = np.array([-5.0, 9.0, 10.0, 0.5, 0.8, 3.0, -1.0])
    newest = np.array([7, 9, 7, 7, 7, 9, 8])
    kept, cut = pruning.prune(scores, newest, math.log(0.02), 2, 10)
    assert kept.tolist() == [2, 4, 6, 1, 5], "below e^-9.2 of the best, or third"
    assert cut == 0
    kept, cut = pruning.prune(scores, newest, math.log(0.02), 2, 3)
    assert (kept.tolist(), cut) == ([2, 1, 5], 2)
    assert pruning.prune(scores[:0], newest[:0], 0.0, 2, 3)[0].tolist() == []


def scan_of(n: int, scan: int) -> np.ndarray:
    found = detections(np.zeros((n, 2)), float(scan))
    found["scan"], found["index"] = scan, np.arange(n)
    return found


@pytest.fixture
def window() -> DetectionWindow:
    window = DetectionWindow()
    for scan, n in enumerate([3, 0, 2, 4]):
        window.append(scan_of(n, scan))
    return window


def test_what_several_tracks_claim_is_one_of_theirs(window):
    window.note_held(np.array([4, 6, 6]), np.array([0.5, 0.5, 0.2]))
    window.note_held(np.array([4]), np.array([0.5]))
    np.testing.assert_allclose(
        window.held_probability(np.array([[3, 4], [5, 6]])), [[0.0, 0.75], [0, 0.6]]
    )


def test_a_certain_claim_that_is_rounded_up_is_certain(window):
    window.note_held(np.array([3]), np.array([1.0 + 1e-15]))
    assert window.held_probability(np.array([3])) == [1.0]


def test_claims_stay_with_their_detections(window):
    window.note_held(np.array([2, 8]), np.array([0.25, 0.75]))
    window.forget(2)
    assert window.held_probability(np.array([8])) == [0.75]
    added = window.append(scan_of(2, 4))
    assert window.held_probability(added).tolist() == [0.0, 0.0]
