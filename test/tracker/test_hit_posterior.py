"""Which hits of a target's hypotheses are credible, and whose they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tsepm_ros.tracker.confirmation import held_share, hit_posterior
from tsepm_ros.tracker.detection_window import DetectionWindow
from tsepm_ros.tracker.hypotheses import Hypotheses
from tsepm_ros.tracker.initial_state import NO_HIT
from tsepm_ros.tracker.measurement import DETECTION


def test_the_held_share_is_over_all_hits_weighted_by_likelihood():
    window = DetectionWindow()
    ids = window.append(np.zeros(4, DETECTION))
    window.note_held(ids[:2], np.array([1.0, 0.5]))
    of = Hypotheses.none(3)
    hypotheses = replace(
        of,
        hits=np.array([[0, 1, NO_HIT], [1, 2, 3], [2, 3, NO_HIT]]),
        hit_count=np.array([2, 3, 2]),
        score=np.log([1.0, 3.0, 5.0]),
    )
    share = [held_share(hypotheses[rows], window) for rows in (slice(0, 2), slice(2, 3))]
    np.testing.assert_allclose(share, [(1.5 + 3 * 0.5) / (2 + 3 * 3), 0.0])


def test_hits_are_the_credible_detections_or_the_likeliest_of_the_best_hypothesis():
    detections, best = np.arange(5), np.array([0, 2, 3, 4, NO_HIT])
    probability = np.array([0.95, 0.2, 0.92, 0.99, 0.5])
    assert hit_posterior(detections, probability, best).tolist() == [0, 2, 3]
    probability[0] = 0.85
    assert hit_posterior(detections, probability, best).tolist() == [0, 2, 3]
    probability[0] = 0.4
    assert hit_posterior(detections, probability, best).tolist() == [2, 3, 4]
