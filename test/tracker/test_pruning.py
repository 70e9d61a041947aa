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


def test_a_score_at_the_threshold_is_deleted_and_the_best_of_a_detection_may_be_alone():
    scores, newest = np.array([-2.0, -1.0, 5.0, 5.0 + pruning.RELATIVE_PRUNING]), np.arange(4) // 2
    kept, cut = pruning.prune(scores, newest, -2.0, 5, 10)
    assert (kept.tolist(), cut) == ([1, 2], 0)
    kept, cut = pruning.prune(np.array([3.0, 2.0, 1.0]), np.zeros(3, np.int64), 0.0, 3, 3)
    assert (kept.tolist(), cut) == ([0, 1, 2], 0)
