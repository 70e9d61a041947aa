# Copyright 2026 tsepm_ros developers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""Scores of hypotheses: increments against sums, limits of time, the clutter statistic."""

import math
from dataclasses import fields, replace

import numpy as np
import pytest
from support.builders import observation_of
from support.score_scenes import NEVER, SONAR, score, sea

from tsepm_ros.numerics import gaussian
from tsepm_ros.numerics.gaussian import gate_factor
from tsepm_ros.tracker import evaluation, pruning, splitting
from tsepm_ros.tracker.clutter import amplitude_law
from tsepm_ros.tracker.clutter.amplitude_law import ScanAmplitudes
from tsepm_ros.tracker.evaluation import hit_increment, miss_increment
from tsepm_ros.tracker.hypotheses import ExpectedDetections, Hypotheses
from tsepm_ros.tracker.options import ScoreOptions


class Observed:
    """What the evaluation of amplitudes takes of a scan."""

    def __init__(self, normalised) -> None:
        self.detections = np.zeros(len(normalised))
        self.amplitudes = ScanAmplitudes.from_normalised(np.asarray(normalised, float), 250.0, 16)


def test_increments_of_a_path_add_up_to_the_ratio_of_all_its_hits():
    normalised = [2.0, 0.3, 5.0, np.nan, 4.0]
    row = count = np.zeros(1, np.int64)
    sums, score = np.zeros(1), 0.0
    for value in normalised:
        count, sums, grown = evaluation.path_amplitudes(Observed([value]), row, count, sums)
        score += grown[0]
    amplitudes = Observed(normalised).amplitudes
    total = amplitudes.scaled.sum()
    expected = amplitude_law.log_ratio(np.array(4.0), np.array(total), amplitudes.ratio.count)
    assert count[0] == 4
    assert score == pytest.approx(float(expected), abs=0.01)


SPREAD = np.array([[900.0, 300.0], [300.0, 400.0]])


@pytest.mark.parametrize(("p_d", "p_g"), [(0.9, 0.99), (0.6, 0.9), (0.3, 0.999)])
def test_the_mean_ratio_over_what_clutter_may_do_is_one(p_d, p_g):
    # A scan of clutter: each detection in the gate gives a child, and there is the missed branch.
    # Their expected sum, lambda times the integral over the gate and the miss, must be 1.
    clutter = 1e-5
    axis = np.linspace(-200.0, 200.0, 1601)
    x, y = np.meshgrid(axis, axis)
    points = np.stack([x.ravel(), y.ravel()], axis=1)
    density, distance = gaussian.log_density(points, np.broadcast_to(SPREAD, (len(points), 2, 2)))
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


def children(seed: int, most: float = math.inf, limit: int = 10**6) -> tuple[Hypotheses, int]:
    """The children of the fourth scan of clutter, and how many were not made or kept."""
    scans = sea(np.random.default_rng(seed), 4, [])
    initiator = score(false_tracks_per_hour=NEVER)
    for scan in scans[:3]:
        initiator.process(scan)
    before = initiator.method.hypotheses
    observed = observation_of(initiator, scans[3])
    predicted = splitting.predict(before, observed.interval, 0.001)
    expected = ExpectedDetections.from_hypotheses(
        predicted, observed.stamp, observed.detections, SONAR
    )
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


def test_increments_of_hits_and_misses_have_their_closed_forms():
    gained = evaluation.hit_increment(np.array([-8.0, 0.0]), np.array([0.5, 1.0]), np.full(2, 1e-4))
    np.testing.assert_allclose(gained, [np.log(0.5 / 1e-4) - 8.0, np.log(0.999 / 1e-4)])
    lost = evaluation.miss_increment(np.array([0.0, 0.5, 1.0]), 0.9)
    np.testing.assert_allclose(lost, np.log(1.0 - np.array([0.0, 0.5, 0.999]) * 0.9))


def test_fading_is_the_bayes_of_a_chain_of_two_states():
    share, factor = 8.0 / 33.0, evaluation.FADED_FACTOR
    faded = np.array([0.0, 0.2, share, 1.0])
    found = evaluation.fading_predicted(faded)
    np.testing.assert_allclose(found, faded * 7.0 / 8.0 + (1.0 - faded) / 25.0)
    assert found[2] == pytest.approx(share), "stationary"
    visible = faded * factor + (1.0 - faded)
    np.testing.assert_allclose(evaluation.visible_share(faded), visible)
    np.testing.assert_allclose(evaluation.fading_after_hit(faded), faded * factor / visible)
    seen, gate = 0.8, 0.9
    missed = faded * (1.0 - factor * seen * gate)
    np.testing.assert_allclose(
        evaluation.fading_after_miss(faded, seen * visible, gate),
        missed / (missed + (1.0 - faded) * (1.0 - seen * gate)),
    )
    np.testing.assert_allclose(
        evaluation.FADED_AT_START, share * factor / (share * factor + 1.0 - share)
    )


def test_scores_gain_by_a_prior_of_limited_speed_from_the_second_hit_on():
    hypotheses = replace(
        Hypotheses.none(3),
        hits=np.array([[1, -1, -1], [1, 2, -1], [1, 2, -1]]),
        hit_count=np.array([1, 2, 2]),
        state=np.zeros((3, 4)),
        covariance=np.broadcast_to(np.diag([1.0, 25.0, 1.0, 25.0]), (3, 4, 4)),
        score=np.array([1.0, 2.0, 3.0]),
    )
    found = evaluation.within_max_speed(hypotheses, np.array([True, True, False]), 5.0)
    # |v|^2 / 25 of two normal components is exponential of mean 2.
    gain = np.log(-np.expm1(-0.5)) - np.log(-np.expm1(-2.0))
    np.testing.assert_allclose(found.score, [1.0, 2.0 + gain, 3.0], rtol=1e-6)
