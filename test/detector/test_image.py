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
"""Checks of a sonar image."""

import numpy as np
import pytest

from tsepm_ros import SensorModel, SonarImage
from tsepm_ros.detector.image import ImageCoverage
from tsepm_ros.tracker.sensor import Coverage

RANGE, AZIMUTH = np.linspace(1.0, 10.0, 30), np.linspace(-1.0, 1.0, 20)


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({"intensity": np.zeros((30, 20))}, r"intensity must have the shape .*: transpose"),
        ({"intensity": np.zeros((20, 29))}, r"intensity must have the shape .*; got \(20, 29\)$"),
        ({"intensity": np.zeros((20, 30), complex)}, "intensity must be real"),
        ({"intensity": np.full((20, 30), np.inf)}, "intensity must not be infinite"),
        ({"range": RANGE[::-1]}, "range must ascend"),
        ({"range": RANGE - 1.0}, "range must be from"),
        ({"range": [5.0]}, "range must have at least 2"),
        ({"azimuth": np.where(AZIMUTH > 0, -AZIMUTH, AZIMUTH)}, "azimuth must ascend or descend"),
        ({"azimuth": np.degrees(AZIMUTH)}, "azimuth must span at most a turn"),
        ({"azimuth": AZIMUTH * np.nan}, "azimuth must be finite"),
        ({"stamp": np.nan}, "stamp must be finite"),
        ({"stamp": 1.7e18}, "stamp must be finite, in s, below 2"),
        ({"time_offset": [0.1]}, "time_offset must have the shape"),
        ({"sensor_pose": np.zeros((4, 3))}, "sensor_pose must be finite"),
    ],
)
def test_what_is_no_image_is_refused_with_a_sentence(changed, sentence):
    fields = {"stamp": 0.0, "range": RANGE, "azimuth": AZIMUTH, "intensity": np.zeros((20, 30))}
    with pytest.raises(ValueError, match=f"^{sentence}"):
        SonarImage(**{**fields, **changed})


@pytest.mark.parametrize(
    ("azimuth", "sector"),
    [
        ([0.2], (-0.3, 0.7)),
        (np.linspace(6.0, 6.6, 31), (5.99 - 2.0 * np.pi, 6.61 - 2.0 * np.pi)),
        (np.linspace(-6.5, -7.1, 31), (2.0 * np.pi - 7.11, 2.0 * np.pi - 6.49)),
        (np.linspace(18.0, 18.6, 31), (17.99 - 4.0 * np.pi, 18.61 - 4.0 * np.pi)),
        (np.linspace(3.0, 5.0, 101), (2.99, 5.01)),
    ],
)
def test_the_coverage_of_any_image_is_one_of_a_sensor(azimuth, sector):
    values = ImageCoverage(RANGE, np.asarray(azimuth), Coverage()).values
    model = SensorModel(**values)
    assert (model.azimuth_min, model.azimuth_max) == pytest.approx(sector)


def test_bearings_may_descend_and_be_unevenly_spaced():
    azimuth = np.sort(np.random.default_rng(1).uniform(-1, 1, 20))[::-1]
    assert SonarImage(0.0, RANGE, azimuth, np.zeros((20, 30), np.uint8)).intensity.shape == (20, 30)
