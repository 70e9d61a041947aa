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
"""Places on the earth by the geodesic from a reference."""

from __future__ import annotations

import numpy as np
import pytest
from pyproj import Geod

from tsepm_ros.tools.bridge.geographic import GeographicReference


def test_a_position_is_found_by_the_geodesic_from_the_reference_also_across_180_degrees():
    reference = GeographicReference(59.65, 10.63, east=500.0, north=-200.0)
    (latitude, longitude), *_ = reference.geographic(np.array([[500.0, 1800.0]])).tolist()
    azimuth, _, distance = Geod(ellps="WGS84").inv(10.63, 59.65, longitude, latitude)
    assert (azimuth, distance) == pytest.approx((0.0, 2000.0), abs=1e-6)
    east = GeographicReference(10.0, 179.999).geographic(np.array([[1000.0, 0.0]]))[0, 1]
    assert -180.0 <= east < -179.98
