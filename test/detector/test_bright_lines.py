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
"""Lines that are bright in every image are left out and named."""

import numpy as np
import pytest

from tsepm_ros import SonarImage, make_detector
from tsepm_ros.detector.bright_lines import LOOKS, BrightLines

B, M = 60, 200
RANGE, AZIMUTH = np.linspace(1.0, 20.0, M), np.linspace(-1.0, 1.0, B)


def speckle(number=12):
    return np.random.default_rng(4).rayleigh(20.0, (number, B, M)).clip(0, 255).astype(np.uint8)


def looked_at(images):
    lines, said = BrightLines(B, M), []
    for image in images:
        said += lines.add(image, AZIMUTH, RANGE)
    return lines, said


def test_bright_bearings_and_ranges_are_left_out_and_named_once():
    lines, said = looked_at(speckle())
    assert said == [] and not lines.bearings.any() and not lines.ranges.any()
    images = speckle(24)
    images[:, 7] = 255
    images[:, :, 90] = 255
    images[0, 12] = 255  # another sonar's streak, once
    lines, said = looked_at(images)
    assert np.flatnonzero(lines.bearings).tolist() == [7]
    assert np.flatnonzero(lines.ranges).tolist() == [90]
    bearings, ranges = said
    assert bearings.startswith("1 of 60 bearings are left out") and "7 (-43.7)" in bearings
    assert ranges.startswith("1 of 200 ranges are left out") and "9.593 m" in ranges


def test_a_wide_band_of_ranges_is_named_and_not_left_out():
    images = speckle()
    images[:, :, :9] = 250
    lines, [said] = looked_at(images)
    assert not lines.ranges.any()
    assert "from 1 to 1.764 m" in said and "sensor.min_range" in said


def test_a_line_that_is_bright_no_more_is_used_again():
    images = speckle(3 * LOOKS)
    images[: LOOKS + 3, 7] = 255
    assert not looked_at(images)[0].bearings.any()


@pytest.mark.parametrize(("first", "cause"), [(1, "ring of the transmission"), (60, "A wall")])
def test_bright_ranges_all_round_are_a_ring_only_if_they_are_the_nearest(first, cause):
    lines, words = BrightLines(B, M), list[str]()
    for image in speckle(LOOKS):
        image[:, first : first + 8] = 200
        words += lines.add(image, AZIMUTH, RANGE)
    assert [cause in sentence for sentence in words] == [True]


def test_nothing_is_detected_on_a_line_of_a_display():
    detector, near = make_detector(false_detections_per_ping=20.0), 0
    for k, image in enumerate(speckle(20)):
        image[30] = np.arange(M) % 256
        scan = detector.process(SonarImage(float(k), RANGE, AZIMUTH, image))
        near += int((np.abs(scan.azimuth - AZIMUTH[30]) < 0.01).sum())
    assert near <= 4
    assert sum("bearings are left out" in note for note in detector.notes) == 1
