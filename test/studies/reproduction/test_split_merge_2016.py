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
"""Split-merge 2016: the tracks of Table I and who merges."""

import numpy as np

from tsepm_ros.studies.reproduction import (
    split_merge_2016,
)


def test_tracks_of_table_i_merge_by_sets():
    """Conditions (i) and (iii) by Python's sets, groups by walks from pair to pair."""
    tracks = {index: set(hits) for index, hits in split_merge_2016.TABLE_I.items()}
    assert all(len(hits) == 5 for hits in tracks.values())
    pairs = [
        [max(one)[0] == max(two)[0] and len(one & two) > 2.5 for two in tracks.values()]
        for one in tracks.values()
    ]
    reached = np.linalg.matrix_power(np.array(pairs, float), len(pairs)) > 0.0
    expected = {frozenset(np.array(list(tracks))[row].tolist()) for row in reached}
    assert {frozenset(group) for group in split_merge_2016.table_i_groups()} == expected
    assert len(expected) == 5


def test_the_text_s_pairs_meet_the_conditions_and_leave_eight():
    assert all(split_merge_2016.may_merge(*pair) for pair in split_merge_2016.SAID_TO_MERGE)
    assert not any(split_merge_2016.may_merge(*pair) for pair in split_merge_2016.SAID_NOT_TO_MERGE)
    left = split_merge_2016.AFTER_SPLITTING - len(split_merge_2016.disjoint_pairs())
    assert left == split_merge_2016.AFTER_MERGING
    assert split_merge_2016.chained() == 7
