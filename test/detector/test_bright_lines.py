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


def looked_at(images, covered=RANGE > 0.0):
    lines, said = BrightLines(B, M), []
    for image in images:
        said += lines.add(image, AZIMUTH, RANGE, covered)
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
    images = speckle(LOOKS)
    images[:, :, first : first + 8] = 200
    _, words = looked_at(images)
    assert [cause in sentence for sentence in words] == [True]


def test_a_ring_that_is_not_used_is_not_named():
    images = speckle(LOOKS)
    images[:, :, :8] = 200
    assert looked_at(images, RANGE[7] < RANGE)[1] == []
    [said] = looked_at(images, RANGE[3] < RANGE)[1]
    assert said.startswith("4 of 200 ranges") and "sensor.min_range" in said


@pytest.mark.parametrize("half", [1.0, np.pi])
def test_the_detector_names_no_ring_below_its_nearest_range(half):
    """Of a sector, and all round, where the coverage has no limits of azimuth."""
    noted = []
    for near in (0.0, RANGE[9]):
        detector = make_detector(min_range=near)
        for k, image in enumerate(speckle()):
            image[:, :8] = 200
            azimuth = np.linspace(-half, half, B, endpoint=False)
            detector.process(SonarImage(float(k), RANGE, azimuth, image))
        noted.append(sum("ring of the transmission" in note for note in detector.notes))
    assert noted == [1, 0]


def test_nothing_is_detected_on_a_line_of_a_display():
    detector, near = make_detector(false_detections_per_ping=20.0), 0
    for k, image in enumerate(speckle(20)):
        image[30] = np.arange(M) % 256
        scan = detector.process(SonarImage(float(k), RANGE, AZIMUTH, image))
        near += int((np.abs(scan.azimuth - AZIMUTH[30]) < 0.01).sum())
    assert near <= 4
    assert sum("bearings are left out" in note for note in detector.notes) == 1
