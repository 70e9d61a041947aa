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
"""Statistics of an image's clutter: background, pooled peaks, and cells that were not measured."""

import numpy as np
import pytest
from scipy import ndimage

from tsepm_ros import SonarImage, make_detector
from tsepm_ros.detector import cfar
from tsepm_ros.detector.cfar import CfarThreshold, Peaks

B, M = 64, 200

RANGE, AZIMUTH = 1.0 + 0.1 * np.arange(M), np.linspace(-1.0, 1.0, B)

POINT = {"azimuth_extent": 1e-3, "range_extent": 1e-3}


def noise(rng, gain=1.0):
    """Rayleigh amplitudes of mean power 1."""
    white = rng.standard_normal((2, B, M)) * np.sqrt(0.5)
    return gain * np.hypot(*white)


def images(count, make):
    for k in range(count):
        yield SonarImage(float(k), RANGE, AZIMUTH, make(k))


def test_nothing_is_detected_where_nothing_was_measured():
    rng = np.random.default_rng(10)

    def picture(k):
        image = noise(rng)
        image[:, :80] = np.nan
        return image

    detector = make_detector()
    for image in images(5, picture):
        scan = detector.process(image)
        assert len(scan)
        assert scan.range.min() > RANGE[78]


def test_cells_that_tremble_are_the_same_cells():
    rng = np.random.default_rng(16)
    detector = make_detector(**POINT, false_detections_per_ping=5)
    counts = set()
    for k in range(12):
        distance = RANGE * (1.0 + 1e-4 * rng.standard_normal())
        counts.add(len(detector.process(SonarImage(float(k), distance, AZIMUTH, noise(rng)))))
    assert len(counts) > 1  # of a single image exactly the stated number is taken


BOX = (2, 3)


def test_the_highest_cells_of_a_box_are_found_from_the_highest_on():
    z = np.zeros((20, 30), np.float32)
    z[4, 5], z[5, 6], z[12, 20] = 5.0, 4.0, 9.0
    peaks, cell = cfar.peaks(z, np.ones(z.shape, bool), BOX, wraps=False, most=10)
    assert cell.tolist() == [[12, 20], [4, 5]], "the second lies in the box of the first"
    assert peaks.height.tolist() == [9.0, 5.0]
    assert cfar.peaks(z, np.ones(z.shape, bool), BOX, wraps=False, most=1)[1].tolist() == [[12, 20]]
    hidden = z < 9.0
    assert cfar.peaks(z, hidden, BOX, wraps=False, most=10)[1].tolist() == [[4, 5]]


def test_a_peak_is_measured_at_its_centroid_also_across_the_seam():
    y = np.zeros((20, 30), np.float32)
    y[0, 10:12] = y[19, 10:12] = 2.0
    echoes = cfar.echoes(y, np.array([[0, 10]]), BOX, wraps=True)
    np.testing.assert_allclose(np.mod(echoes.cell, (20, 30)), [[19.5, 10.5]])
    np.testing.assert_allclose(echoes.width, [[2.0, 2.0]])


@pytest.mark.parametrize("row", [0, 1, 2, 3, 10, 18, 19])
@pytest.mark.parametrize("column", [1, 15, 28])
def test_an_echo_near_an_edge_is_not_drawn_to_it(row, column):
    bearing, cell = np.ogrid[:20, :30]
    y = 9.0 * np.exp(-0.5 * ((bearing - row) / 1.5) ** 2 - 0.5 * ((cell - column) / 1.5) ** 2)
    echoes = cfar.echoes(y.astype(np.float32), np.array([[row, column]]), (5, 7), wraps=False)
    np.testing.assert_allclose(echoes.cell, [[row, column]], atol=1e-6)


def test_the_threshold_leaves_the_stated_number_of_peaks_a_ping():
    rng, threshold, above = np.random.default_rng(3), CfarThreshold(4.0), []
    for ping in range(60):
        height = np.sort(rng.exponential(1.0, 200))[::-1]
        place = rng.uniform(0.0, 1000.0, (200, 2))
        peaks = Peaks(height, place, 1e6, float(np.median(height)), 0.1, 200)
        limit, _ = threshold.update(peaks, float(ping), np.ones(200))
        above += [np.count_nonzero(height > limit)] if ping >= 20 else []
    assert np.mean(above) == pytest.approx(4.0, abs=0.8)


@pytest.mark.parametrize("rate", [0.1, 1.0, 10.0])
@pytest.mark.parametrize(
    ("speed", "stands"), [(0.0, True), (0.7, True), (1.5, False), (20.0, False)]
)
def test_an_echo_stands_if_it_stays_for_the_time_of_the_slowest_target_at_any_rate(
    rate, speed, stands
):
    """Speeds are those of the slowest target, which leaves the place in 6 s; five images count."""
    threshold, told = CfarThreshold(1.0), []
    leaves = np.full(1, 6.0)
    window = max(12.0, 5.0 / rate)
    for k in range(round(2.5 * window * rate) + 1):
        place = np.array([[0.0, speed * k / rate / (0.5 * window)]])
        peaks = Peaks(np.full(1, 9.0), place, 1e6, 1.0, 0.1, 200)
        told.append(threshold.update(peaks, k / rate, leaves)[1][0])
    known = np.isfinite(told)
    assert (told[-1] >= 0.5) == stands
    first = max(6.0, 5.0 / rate)
    assert np.flatnonzero(known)[0] / rate == pytest.approx(first, abs=1.0 / rate), "nan before"
    assert known[np.flatnonzero(known)[0] :].all()


def test_the_looks_that_are_kept_of_a_long_time_are_few():
    threshold, leaves = CfarThreshold(1.0), np.full(1, 60.0)
    for k in range(4000):
        peaks = Peaks(np.full(1, 9.0), np.zeros((1, 2)), 1e6, 1.0, 0.1, 200)
        standing = threshold.update(peaks, k / 40.0, leaves)[1]
    assert standing[0] == pytest.approx(100.0 / 120.0, abs=0.01), "of 100 s of two minutes"
    assert len(threshold._times) < 130


def test_the_threshold_of_an_edge_leaves_the_number_of_its_part():
    rng, pool, above = np.random.default_rng(6), [], []
    for _ in range(400):
        part = rng.uniform(0.02, 0.2)
        height = rng.lognormal(0.0, 1.0, rng.poisson(600 * part))
        pool = [*pool[-39:], (height, part)]
        above.append([np.count_nonzero(height > cfar.edge_threshold(pool, 5.0)), 5.0 * part])
    found, stated = np.mean(above, axis=0)
    assert found == pytest.approx(stated, rel=0.2)
    assert cfar.edge_threshold([(np.array([3.0]), 1.0)], 5.0) == 0.0, "fewer than are wanted: all"


def test_a_peak_that_stays_stands_and_peaks_here_and_there_do_not():
    rng, threshold = np.random.default_rng(4), CfarThreshold(4.0)
    for ping in range(20):
        height = np.sort(rng.exponential(1.0, 200))[::-1]
        height[0] = 20.0
        place = rng.uniform(0.0, 1000.0, (200, 2))
        place[0] = 500.0 + rng.uniform(-0.4, 0.4, 2)
        peaks = Peaks(height, place, 1e6, float(np.median(height)), 0.1, 200)
        _, standing = threshold.update(peaks, float(ping), np.full(200, 5.0))
    assert standing[0] == pytest.approx(1.0)
    assert standing[1:].max() < 0.2
    assert threshold.evidence[0] == threshold.evidence.max() > 0.9


@pytest.mark.parametrize(("rise", "flagged"), [(0.7, True), (0.9, False)])
def test_what_is_weak_beside_what_stands_is_of_it(rise, flagged):
    past, cell = np.zeros((40, 90), np.float32), np.array([[20, 40], [20, 70]])
    past[18:23, 44:48] = 10.0  # a rock, 8 over a box, within a box of the first echo alone
    x = np.zeros_like(past)
    for row, column in cell:
        x[row - 1 : row + 2, column - 2 : column + 3] += rise * 5.0
    assert cfar.beside_structure(x, past, cell, (3, 5), wraps=False).tolist() == [flagged, False]


@pytest.mark.parametrize("wraps", [False, True])
@pytest.mark.parametrize("box", [(1, 1), (2, 3), (3, 6), (7, 11)])
def test_an_image_is_smoothed_over_a_box_and_its_peaks_are_the_highest_around(box, wraps):
    y = np.random.default_rng(4).uniform(-1.0, 1.0, (9, 40)).astype(np.float32)
    mode = ("wrap" if wraps else "constant", "constant")
    smoothed = cfar.smoothed(y, box, wraps) - cfar.smoothed(np.zeros_like(y), box, wraps)
    np.testing.assert_allclose(smoothed, ndimage.uniform_filter(y, box, mode=mode), atol=1e-6)
    around = ndimage.maximum_filter(y, [2 * length + 1 for length in box], mode=mode)
    cell = cfar.peaks(y, np.ones(y.shape, bool), box, wraps, most=400)[1]
    assert sorted(map(tuple, cell)) == [*map(tuple, np.argwhere((y == around) & (y > 0.001)))]


def ring_statistics(x, wraps):
    """Mean and deviation of the ring around each block of four ranges, for an echo of 3 x 5."""
    (b, m), statistics = x.shape, np.zeros((2, *x.shape))
    for row in range(b):
        for block in range(m // 4 + 1):
            bearings = [k for k in range(row - 12, row + 13) if wraps or 0 <= k < b]
            values = [
                x[bearing % b, column]
                for bearing in bearings
                for near in range(max(block - 7, 0), block + 8)
                if abs(bearing - row) > 3 or abs(near - block) > 2
                for column in range(4 * near, min(4 * near + 4, m))
            ]
            statistics[:, row, 4 * block : 4 * block + 4] = [[np.mean(values)], [np.std(values)]]
    return statistics


@pytest.mark.parametrize("wraps", [False, True])
def test_an_image_is_normalised_by_the_ring_around_each_cell(wraps):
    x = np.random.default_rng(5).exponential(1.0, (9, 62)).astype(np.float32)
    mean, deviation = ring_statistics(x, wraps)
    limited = np.minimum(x, mean + 2.5 * deviation)
    assert (limited < x).any()
    mean, deviation = ring_statistics(limited, wraps)
    y, ring = cfar.normalised(x, np.ones(x.shape, bool), np.False_, (3, 5), wraps)
    np.testing.assert_allclose(ring, mean, rtol=1e-5)
    np.testing.assert_allclose(y, (x - mean) / deviation, rtol=1e-4, atol=1e-5)


def test_what_stands_beyond_the_seam_is_beside_an_echo_of_a_full_turn():
    past, x = np.zeros((40, 90), np.float32), np.zeros((40, 90), np.float32)
    past[37:40, 40:45], x[0:3, 40:45] = 10.0, 1.0
    cell = np.array([[1, 42]])
    assert cfar.beside_structure(x, past, cell, (3, 5), wraps=True).tolist() == [True]
    assert cfar.beside_structure(x, past, cell, (3, 5), wraps=False).tolist() == [False]
