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
"""Multiple models: cells of velocities, and the output of a bank of plain filters."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal
from support.builders import FIXED_RANGE_ERROR, scan_at

from tsepm_ros import make_initiator
from tsepm_ros.studies.multiple_model import MAX_FILTERS, multiple_model_cells
from tsepm_ros.tracker.measurement import convert_measurements


@pytest.mark.parametrize(("speeds", "headings"), [(1, 3), (2, 8), (5, 36)])
def test_all_cells_together_are_a_uniform_speed_and_heading(speeds, headings):
    mean, covariance = multiple_model_cells(10.0, speeds, headings)
    assert len(mean) == speeds * headings
    np.testing.assert_allclose(mean.mean(axis=0), 0.0, atol=1e-12)
    total = covariance.mean(axis=0) + mean.T @ mean / len(mean)
    np.testing.assert_allclose(total, np.eye(2) * 10.0**2 / 6.0, atol=1e-12)


def test_a_cell_has_the_moments_of_its_velocities():
    rng = np.random.default_rng(1)
    mean, covariance = multiple_model_cells(10.0, 2, 4)
    speed = rng.uniform(5.0, 10.0, 200_000)
    heading = np.pi / 2 + rng.uniform(-np.pi / 4, np.pi / 4, 200_000)
    sample = np.stack([speed * np.cos(heading), speed * np.sin(heading)])
    np.testing.assert_allclose(mean[5], sample.mean(axis=1), atol=0.03)
    np.testing.assert_allclose(covariance[5], np.cov(sample), atol=0.08)


def plain_bank(hits, options, max_speed):
    """One bank over hits (scan by scan, 12 s apart), filter by filter."""
    mean, spread = multiple_model_cells(max_speed, options.speeds, options.headings)
    f = np.kron(np.eye(2), [[1.0, 12.0], [0.0, 1.0]])
    q = 12.0 * np.kron(np.eye(2), [[12.0**2 / 3, 6.0], [6.0, 1.0]]) * options.process_noise
    h = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]])
    states, covariances, weights = [], [], []
    for velocity, cell in zip(mean, spread, strict=True):
        x = h.T @ hits[0]["position"]
        x[1::2] = velocity
        p = h.T @ hits[0]["covariance"] @ h
        p[1::2, 1::2] = cell
        weight = 1.0
        for hit in hits[1:]:
            x, p = f @ x, f @ p @ f.T + q
            s = h @ p @ h.T + hit["covariance"]
            weight *= multivariate_normal.pdf(hit["position"], h @ x, s)
            gain = p @ h.T @ np.linalg.inv(s)
            x, p = x + gain @ (hit["position"] - h @ x), p - gain @ s @ gain.T
        states.append(x)
        covariances.append(p)
        weights.append(weight)
    weights = np.array(weights) / sum(weights)
    state = weights @ np.array(states)
    covariance = sum(
        w * (p + np.outer(x - state, x - state))
        for w, x, p in zip(weights, states, covariances, strict=True)
    )
    return state, covariance


@pytest.mark.parametrize("process_noise", [0.0, 0.01])
def test_the_output_is_that_of_plain_filters(process_noise):
    options = {"min_hits": 4, "window": 4, "process_noise": process_noise}
    made = make_initiator("multiple_model", sensor=FIXED_RANGE_ERROR, **options)
    rng = np.random.default_rng(2)
    places = [rng.normal((3000.0 + 60.0 * k, 40.0 * k), 20.0) for k in range(4)]
    scans = [scan_at(12.0 * k, [one]) for k, one in enumerate(places)]
    (track,) = [track for scan in scans for track in made.process(scan)]
    hits = [convert_measurements(scan, FIXED_RANGE_ERROR, 0)[0] for scan in scans]
    state, covariance = plain_bank(hits, made.options, 10.0)
    np.testing.assert_allclose(track.state, state, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(track.covariance, covariance, rtol=1e-7, atol=1e-9)


def test_time_offsets_change_the_times_and_nothing_else():
    # The same echoes, told as of their scans' stamps or as of an offset after earlier ones.
    def state(offset):
        made = make_initiator("multiple_model", sensor=FIXED_RANGE_ERROR, process_noise=0.0)
        tracks = []
        for k in range(5):
            where = [(3000.0 + 60.0 * k, 0.0)]
            tracks += made.process(scan_at(12.0 * k - offset, where, time_offset=[offset]))
        return tracks[0].predicted(60.0)

    np.testing.assert_allclose(state(4.0).state, state(0.0).state, atol=1e-6)
    np.testing.assert_allclose(state(4.0).covariance, state(0.0).covariance, atol=1e-6)


def test_a_scan_without_a_detection_is_waited_for():
    made = make_initiator("multiple_model", sensor=FIXED_RANGE_ERROR, min_hits=4, window=6)
    tracks = []
    for k, seen in enumerate("110101"):
        where = [(3000.0 + 60.0 * k, 0.0)] if seen == "1" else []
        tracks += made.process(scan_at(12.0 * k, where))
    assert [track.hits for track in tracks] == [((0, 0), (1, 0), (3, 0), (5, 0))]


def test_filters_are_bounded_and_the_tracks_beyond_are_counted():
    made = make_initiator("multiple_model", sensor=FIXED_RANGE_ERROR, speeds=20, headings=72)
    most = MAX_FILTERS // (20 * 72)
    made.process(scan_at(0.0, [(2000.0 + 15.0 * k, 0.0) for k in range(most + 5)]))
    assert made.statistics.potential_tracks == made.statistics.started == most
    assert made.statistics.cut_potential_tracks == 5
