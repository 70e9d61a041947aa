"""Pruning: which hypotheses are kept."""

import math

import numpy as np

from tsepm_ros.tracker import pruning


def test_of_each_newest_detection_the_likely_hypotheses_are_kept_and_no_more_than_the_most():
    scores = np.array([-5.0, 9.0, 10.0, 0.5, 0.8, 3.0, -1.0])
    newest = np.array([7, 9, 7, 7, 7, 9, 8])
    kept, cut = pruning.prune(scores, newest, math.log(0.02), 2, 10)
    assert kept.tolist() == [2, 4, 6, 1, 5], "below e^-9.2 of the best, or third"
    assert cut == 0
    kept, cut = pruning.prune(scores, newest, math.log(0.02), 2, 3)
    assert (kept.tolist(), cut) == ([2, 1, 5], 2)
    assert pruning.prune(scores[:0], newest[:0], 0.0, 2, 3)[0].tolist() == []
