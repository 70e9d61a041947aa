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
"""Options: what is refused, and what `auto` stands for."""

import math

import pytest

from tsepm_ros.tracker.options import CommonOptions, MnOptions, ScoreOptions


def test_min_speed_must_be_below_max_speed():
    with pytest.raises(ValueError, match="min_speed must be below max_speed"):
        CommonOptions(min_speed=5.0, max_speed=5.0)
    with pytest.raises(ValueError, match="min_speed"):
        CommonOptions(min_speed=-1.0)


def test_auto_stands_for_what_suits_a_method_whose_tracks_are_mostly_true_or_not():
    options = CommonOptions()
    for true, probability, speed in [(True, "estimated", "on"), (False, "given", "off")]:
        found = options.resolved(true)
        assert (found.detection_probability, found.limit_speed) == (probability, speed)
    assert CommonOptions(limit_speed="on").resolved(False).limit_speed == "on"


def test_a_window_holds_the_hits_that_confirm():
    assert MnOptions(min_hits=5, window=5).window == 5
    with pytest.raises(ValueError, match="window must be at least min_hits; got 4 and 5"):
        MnOptions(min_hits=5, window=4)


def test_a_speed_equal_to_the_least_is_refused():
    with pytest.raises(ValueError, match="min_speed must be below max_speed"):
        CommonOptions(min_speed=3.0, max_speed=3.0)


def test_the_deletion_threshold_is_the_log_of_the_miss_probability():
    assert ScoreOptions(miss_probability=0.1).deletion_threshold == math.log(0.1)
