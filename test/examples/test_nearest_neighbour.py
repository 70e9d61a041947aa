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
"""The filter of the example tracker, against the package's own and against the truth."""

import numpy as np
import pytest
from nearest_neighbour import GATE, NearestNeighbourTracker, Target
from scipy.stats import chi2
from support.builders import scan_at

from tsepm_ros import ConfirmedTrack, Scan, SensorModel
from tsepm_ros.tracker import motion
from tsepm_ros.tracker.measurement import convert_measurements

SENSOR = SensorModel(range_std=30.0, range_std_fraction=0.0)
STATE = np.array([3000.0, 4.0, 1500.0, -2.0])
A = np.random.default_rng(5).standard_normal((4, 4)) * [[60.0], [1.0], [60.0], [1.0]]
COVARIANCE = A @ A.T
"""Full: everything is correlated with everything."""
Seen = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Positions (n, 2), their covariances (n, 2, 2) and lags (n,)."""
NONE: Seen = np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros(0)


def track(name: int = 7, state: np.ndarray = STATE, stamp: float = 0.0) -> ConfirmedTrack:
    return ConfirmedTrack(name, stamp, state, COVARIANCE, (), np.nan)


def measured(scan: Scan) -> Seen:
    found = convert_measurements(scan, SENSOR, 0)
    return found["position"], found["covariance"], found["time"] - scan.stamp


def seen(stamp: float, *positions: tuple[float, float], delay: float = 0.0) -> Seen:
    return measured(scan_at(stamp, positions, time_offset=np.full(len(positions), delay)))


def started(*tracks: ConfirmedTrack, **options: float) -> NearestNeighbourTracker:
    tracker = NearestNeighbourTracker(**options)
    tracker.step(0.0, *NONE)
    tracker.start(tracks)
    return tracker


def test_a_filter_begins_with_a_track_and_predicts_by_nearly_constant_velocity():
    tracker = started(track(), noise=0.3)
    [told] = tracker.tracks()
    assert (told.track_id, told.stamp) == (7, 0.0)
    np.testing.assert_array_equal(told.state, STATE)
    np.testing.assert_array_equal(told.covariance, COVARIANCE)
    tracker.step(12.0, *NONE)
    [told] = tracker.tracks()
    state, covariance = motion.predict(STATE[None], COVARIANCE[None], 12.0, 0.3)
    np.testing.assert_allclose(told.state, state[0], rtol=1e-12)
    np.testing.assert_allclose(told.covariance, covariance[0], rtol=1e-12)


def test_an_update_is_that_of_a_kalman_filter_at_the_echo_s_own_time():
    tracker, delay = started(track(), noise=0.0), 2.5
    position, R, lag = seen(12.0, (3080.0, 1490.0), delay=delay)
    assert tracker.step(12.0, position, R, lag) == {7: 0}
    state, covariance = motion.predict(STATE[None], COVARIANCE[None], 12.0)
    step = np.array([delay])
    expected = state[:, 0::2] + delay * state[:, 1::2]
    spread = motion.position_covariance_after(covariance, step) + R
    state, covariance = motion.update(state, covariance, step, position - expected, spread)
    [told] = tracker.tracks()
    np.testing.assert_allclose(told.state, state[0], rtol=1e-9)
    np.testing.assert_allclose(told.covariance, covariance[0], rtol=1e-9, atol=1e-9)


def test_targets_get_what_fits_best_together_and_what_is_outside_the_gate_is_nobody_s():
    # Alone each would take the detection in the middle; together the first takes the other.
    beside = STATE + np.array([200.0, 0.0, 0.0, 0.0])
    x, y = STATE[0::2]
    detections = seen(0.0, (x + 90.0, y), (x - 100.0, y))
    assert started(track(1)).step(0.0, *detections) == {1: 0}
    assert started(track(2, beside)).step(0.0, *detections) == {2: 0}
    assert started(track(1), track(2, beside)).step(0.0, *detections) == {1: 1, 2: 0}
    target = Target(STATE, COVARIANCE)
    inside, outside = (STATE[0] + sign * 1e4 for sign in (0, 1))
    detections = seen(0.0, (outside, STATE[2]))
    innovation, S = target.innovations(*detections)
    assert innovation[0] @ np.linalg.solve(S[0], innovation[0]) > GATE
    assert started(track()).step(0.0, *detections) == {}
    assert started(track()).step(0.0, *seen(0.0, (inside, STATE[2]))) == {7: 0}


def test_a_target_ends_after_too_many_misses_and_what_is_cleared_is_forgotten():
    tracker = started(track(), max_misses=2)
    tracker.step(12.0, *NONE)
    tracker.step(24.0, *NONE)
    at = tracker.tracks()[0].position
    tracker.step(24.0, *seen(24.0, tuple(at)))  # counts anew
    for stamp in (36.0, 48.0):
        tracker.step(stamp, *NONE)
        assert [one.track_id for one in tracker.tracks()] == [7]
    tracker.step(60.0, *NONE)
    assert tracker.tracks() == []
    tracker = started(track())
    tracker.clear()
    tracker.step(-100.0, *NONE)
    tracker.start([track(8, stamp=-100.0)])
    assert [(one.track_id, one.stamp) for one in tracker.tracks()] == [(8, -100.0)]


def test_filters_that_start_honestly_stay_so():
    """Mean NEES of 300 filters after 6 pings, within its 99.9 % interval of 4."""
    rng = np.random.default_rng(8)
    root, found = np.linalg.cholesky(COVARIANCE), []
    for _ in range(300):
        truth = STATE + root @ rng.standard_normal(4)
        tracker = started(track(), noise=0.0)
        for stamp in 12.0 * np.arange(1, 7):
            x, y = truth[0::2] + stamp * truth[1::2]
            scan = Scan(
                stamp=stamp,
                range=[np.hypot(x, y) + 30.0 * rng.standard_normal()],
                azimuth=[np.arctan2(y, x) + SENSOR.azimuth_std * rng.standard_normal()],
            )
            target = tracker.targets[7]
            target.predict(12.0, 0.0)
            innovation, S = target.innovations(*measured(scan))
            target.update(innovation[0], S[0], 0.0)
        error = target.state - truth - 72.0 * np.array([truth[1], 0.0, truth[3], 0.0])
        found.append(error @ np.linalg.solve(target.covariance, error))
    low, high = chi2.ppf([0.0005, 0.9995], 4 * len(found)) / len(found)
    assert low < np.mean(found) < high


@pytest.mark.parametrize("number", [0, 1, 5])
def test_any_number_of_detections_and_targets_can_be_taken(number):
    detections = seen(12.0, *((3000.0 + 500.0 * k, 1500.0) for k in range(number)))
    assert NearestNeighbourTracker().step(12.0, *detections) == {}
    assert len(started(track(1), track(2)).step(12.0, *detections)) <= number
