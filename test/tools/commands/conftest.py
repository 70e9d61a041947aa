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
"""A recording and a scenario for the commands."""

import numpy as np
import pytest

SMALL = """
scans: 8
period: 12.0
sensor: {range_std: 5.0, range_std_fraction: 0.0, azimuth_std: 0.005, max_range: 3000.0,
         detection_probability: 1.0, clutter_density: 1.0e-7}
targets:
  - {state: [1500.0, 4.0, 700.0, -3.0]}
"""


@pytest.fixture
def recording(tmp_path):
    """A target at 5 m/s along x, 3 km north, seen 8 times by a sensor at rest."""
    rows = ["time_s,range_m,azimuth_rad"]
    for k in range(8):
        x, y = 5.0 * 12.0 * k, 3000.0
        rows.append(f"{12.0 * k},{np.hypot(x, y)},{np.arctan2(y, x)}")
    (tmp_path / "detections.csv").write_text("\n".join(rows))
    return str(tmp_path)


@pytest.fixture
def scenario(tmp_path):
    path = tmp_path / "small.yaml"
    path.write_text(SMALL)
    return str(path)
