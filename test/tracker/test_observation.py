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
"""An observed scan, as the tracker makes it for a method."""

import numpy as np
from support.builders import FIXED_RANGE_ERROR, observation_of, scan_at

from tsepm_ros import make_initiator


def test_an_observation_has_the_scan_s_detections_and_their_ids_in_the_window():
    made = make_initiator("tsepm", sensor=FIXED_RANGE_ERROR, min_hits=3, window=4)
    first = observation_of(made, scan_at(10.0, [(3000.0, 0.0)]))
    assert (first.interval, first.scan_index, first.median_interval) == (0.0, 0, 0.0)
    again = observation_of(made, scan_at(22.0, [(3000.0, 0.0), (0.0, 4000.0)]))
    assert (again.interval, again.scan_index, again.median_interval) == (12.0, 1, 12.0)
    assert again.ids.tolist() == [1, 2]
    assert again.window[again.ids]["scan"].tolist() == [1, 1]
    np.testing.assert_allclose(again.detections["position"], [[3000, 0], [0, 4000]], atol=1.0)
    covered = again.detection_probability(np.array([[3000.0, 0.0], [2e4, 0.0]]))
    assert covered.tolist() == [0.9, 0.0]
    assert again.confirmed_probability.tolist() == [0.0, 0.0]
    assert (len(again.tracks), again.detected.tolist()) == (0, [])
