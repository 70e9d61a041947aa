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
"""The improved sequential method on scenes by hand, and its three estimators."""

import numpy as np
import pytest
from scipy.linalg import block_diag
from support.builders import FIXED_RANGE_ERROR, detections, fit_matrix, scan_at, whitened

from tsepm_ros import SensorModel, make_initiator
from tsepm_ros.studies.sequential import (
    ESTIMATORS,
    sequential_estimate,
    sequential_kalman,
    sequential_line,
)
from tsepm_ros.tracker.measurement import convert_measurements

TIMES = np.array([-60.0, -48.0, -24.0, -12.0, -5.0])

VELOCITY = np.array([3.0, -4.0])

COVARIANCES = np.array([np.array([[4.0, c], [c, 2.0]]) for c in (0.5, -1.0, 0.0, 1.0, 0.2)])


def truth(times=TIMES):
    return np.array([1000.0, 2000.0]) + times[:, None] * VELOCITY


@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_the_filter_is_generalised_least_squares_with_the_process_noise(noise):
    """A position differs by the integral of (s - t_i) dW(s) from that of the last velocity."""
    tau, positions = TIMES[None], truth() + np.random.default_rng(1).normal(0, 2, (1, 5, 2))
    one, other = np.meshgrid(TIMES, TIMES)
    begin = np.maximum(one, other)
    integral = -(begin**3 / 3.0 - (one + other) * begin**2 / 2.0 + one * other * begin)
    weight = np.linalg.inv(block_diag(*COVARIANCES) + noise * np.kron(integral, np.eye(2)))
    design = fit_matrix(TIMES)
    expected = np.linalg.inv(design.T @ weight @ design)
    state, covariance = sequential_kalman(tau, positions, COVARIANCES[None], noise)
    np.testing.assert_allclose(
        state[0], expected @ design.T @ weight @ positions.ravel(), rtol=1e-8
    )
    np.testing.assert_allclose(covariance[0], expected, rtol=1e-8, atol=1e-10)


def test_the_covariance_of_a_line_is_that_of_the_errors():
    rng = np.random.default_rng(2)
    n = 20_000
    roots = np.linalg.cholesky(COVARIANCES)
    errors = (roots @ rng.standard_normal((n, 5, 2, 1)))[..., 0]
    states, _ = sequential_line(
        np.tile(TIMES, (n, 1)), truth() + errors, np.tile(COVARIANCES, (n, 1, 1, 1))
    )
    covariance = sequential_line(TIMES[None], truth()[None], COVARIANCES[None])[1][0]
    np.testing.assert_allclose(whitened(states, covariance), np.eye(4), atol=0.06)


def test_a_line_may_run_along_either_axis():
    for direction in ([1.0, 0.0], [0.0, 1.0], [0.0, -1.0], [-1.0, 1.0]):
        positions = 5.0 * TIMES[:, None] * np.array(direction)
        state, covariance = sequential_line(TIMES[None], positions[None], COVARIANCES[None])
        np.testing.assert_allclose(state[0, 1::2], 5.0 * np.array(direction), atol=1e-12)
        assert (np.linalg.eigvalsh(covariance[0]) > 0).all()


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_hits_at_one_place_stand_still(estimator):
    found = sequential_estimate(
        detections(np.ones((1, 5, 2)), TIMES), 0.0, SensorModel(), estimator, 0.0
    )
    np.testing.assert_allclose(found.state, [[1.0, 0.0, 1.0, 0.0]], atol=1e-12)
    assert (np.linalg.eigvalsh(found.covariance) > 0).all()


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_hits_at_one_time_have_no_fit(estimator):
    found = sequential_estimate(detections(truth()[None], 7.0), 0.0, SensorModel(), estimator, 0.0)
    assert not np.isfinite(found.state).all()


def test_as_in_table_1_least_squares_is_best_and_the_line_loses_speed():
    # The article's scene: 6 hits of 10, 6 km, 1.5 % and 1 degree, 5 m/s, 12 s.
    rng = np.random.default_rng(3)
    n, times = 4000, -12.0 * np.arange(6)[::-1]
    covariance = np.diag([90.0**2, 104.7**2])
    sent = np.array([6000.0, 0.0]) + times[:, None] * np.array([3.0, 4.0])
    hits = detections(sent + rng.normal(0, 1, (n, 6, 2)) * [90.0, 104.7], times)
    hits["covariance"] = covariance
    error = {}
    for estimator in ESTIMATORS:
        state = sequential_estimate(hits, 0.0, SensorModel(), estimator, 0.001).state
        error[estimator] = (
            np.median(np.hypot(*(state[:, 0::2] - sent[-1]).T)),
            np.median(np.abs(np.hypot(*state[:, 1::2].T) - 5.0)),
        )
    assert error["least_squares"][0] < error["linear_fitting"][0]
    assert error["least_squares"][0] < error["kalman_filter"][0] * 1.05


def initiator(**options):
    return make_initiator("sequential", sensor=FIXED_RANGE_ERROR, **options)


def confirmed_at(seen: str, **options) -> list[int]:
    """Scans, from 1 on, that confirm a target seen where `seen` has a 1."""
    made = initiator(**options)
    found = []
    for k, one in enumerate(seen):
        where = [(3000.0, 5.0 * 12.0 * k)] if one == "1" else []
        found += [k + 1] * len(made.process(scan_at(12.0 * k, where)))
    return found


@pytest.mark.parametrize(
    ("seen", "confirmed"),
    [("1111011", [7]), ("1110010101", [10]), ("1010010101", []), ("10100101011", [])],
    ids=["figure 3", "figure 4", "figure 5", "a sixth hit too late"],
)
def test_six_of_ten_as_in_the_figures(seen, confirmed):
    assert confirmed_at(seen) == confirmed


@pytest.mark.parametrize(
    ("ranges", "hits"),
    [
        ([3000, 3000, 3000, 3000, 3200, 3150, 3150], [1, 2, 3, 4, 6, 7]),
        ([3000, 3000, 3000, 3200, 3310, 3250, 3450, 3400, 3600, 3550], [1, 2, 3, 6, 8, 10]),
    ],
    ids=["figure 3", "figure 4"],
)
def test_points_outside_the_gate_leave_the_track_its_later_ones(ranges, hits):
    found = {}
    for matching in ("oldest", "nearest"):
        made = initiator(matching=matching)
        tracks = []
        for k, x in enumerate(ranges):
            tracks += made.process(scan_at(12.0 * k, [(float(x), 0.0)]))
        found[matching] = [[scan + 1 for scan, _ in track.hits] for track in tracks]
    assert found["oldest"] == [hits]
    assert hits not in found["nearest"], "the points outside must contend for the later ones"


@pytest.mark.parametrize("gap", [1, 2, 3, 5])
@pytest.mark.parametrize("inside", [True, False])
@pytest.mark.parametrize("gate_error", ["range", "major_axis"])
def test_the_gate_is_that_of_equation_7(gap, inside, gate_error):
    # Hits along the line of sight: distances are differences of the unbiased ranges.
    made = initiator(min_hits=2, gate_error=gate_error)
    first = scan_at(0.0, [(3000.0, 0.0)])
    made.process(first)
    for k in range(1, gap):
        made.process(scan_at(12.0 * k, []))
    major = convert_measurements(first, FIXED_RANGE_ERROR, 0)["major_sigma"][0]
    reach = 10.0 * gap * 12.0 + 2.0 * (30.0 if gate_error == "range" else major)
    unbiased = np.exp(0.5 * FIXED_RANGE_ERROR.azimuth_std**2)
    step = (reach + (-0.01 if inside else 0.01)) / unbiased
    assert len(made.process(scan_at(12.0 * gap, [(3000.0 + step, 0.0)]))) == inside


@pytest.mark.parametrize(
    ("matching", "first_scans"), [("oldest", {0}), ("nearest", {1}), ("shared", {0, 1})]
)
def test_of_two_tracks_in_whose_gates_a_detection_lies_the_reading_chooses(matching, first_scans):
    scans = [scan_at(12.0 * k, [(x, 0.0)]) for k, x in enumerate((3000.0, 3450.0, 3290.0))]
    made = initiator(matching=matching)
    for scan in scans:
        made.process(scan)
    assert {track.hits for track in made.potential_tracks()} == {
        ((first, 0), (2, 0)) for first in first_scans
    }
    made = initiator(matching=matching, min_hits=2, window=3)
    (track,) = [track for scan in scans for track in made.process(scan)]
    assert track.hits[0][0] in first_scans, "of those that share a hit one is published"
