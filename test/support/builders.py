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
"""Small inputs for the tests: detections, scans and comparisons."""

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from tsepm_ros import ConfirmedTrack, Scan, SensorModel
from tsepm_ros.tracker.measurement import DETECTION
from tsepm_ros.tracker.method import MethodResult
from tsepm_ros.tracker.observation import Observation
from tsepm_ros.tracker.tracker import Tracker

FIXED_RANGE_ERROR = SensorModel(range_std=30.0, range_std_fraction=0.0)
"""A sensor whose range error does not grow."""


def detections(positions: Any, times: Any, variance: float = 1.0) -> np.ndarray:
    """Converted detections at (..., 2) positions with circular errors."""
    positions = np.asarray(positions, float)
    rows = np.zeros(positions.shape[:-1], DETECTION)
    rows["position"] = positions
    rows["time"] = times
    rows["covariance"] = variance * np.eye(2)
    rows["major_sigma"] = math.sqrt(variance)
    rows["range_std"] = np.nan
    return rows


def scan_at(stamp: float, positions: Iterable[Sequence[float]], **more: Any) -> Scan:
    """A scan that sees the positions without error, from the origin."""
    points = np.array(list(positions), float).reshape(-1, 2)
    return Scan(
        stamp=stamp,
        range=np.hypot(points[:, 0], points[:, 1]),
        azimuth=np.arctan2(points[:, 1], points[:, 0]),
        **more,
    )


def assert_same_tracks(one: Sequence[ConfirmedTrack], other: Sequence[ConfirmedTrack]) -> None:
    """The same tracks to the last bit, whatever their ids."""
    assert [track.hits for track in one] == [track.hits for track in other]
    for a, b in zip(one, other, strict=True):
        assert a.stamp == b.stamp
        np.testing.assert_array_equal(a.state, b.state)
        np.testing.assert_array_equal(a.covariance, b.covariance)
        assert (a.evaluation, a.scan_count, a.age) == (b.evaluation, b.scan_count, b.age)


def whitened(sample: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Sample covariance in the units of an expected one: the identity where they agree."""
    inverse = np.linalg.inv(np.linalg.cholesky(covariance))
    return inverse @ np.cov(sample, rowvar=False) @ inverse.T


def fit_matrix(elapsed: np.ndarray) -> np.ndarray:
    """The stacked H of Eq. 15 for hits at times after the state."""
    return np.vstack([np.kron(np.eye(2), [1.0, t]) for t in elapsed])


AS_GIVEN = {"clutter_density": "given", "detection_probability": "given"}
"""Options with which nothing is learned."""


def reconfigured(initiator: Tracker, sensor: SensorModel, common: Any, options: Any) -> bool:
    """Change an initiator's options, its method staying the same; see `with_settings`."""
    other, kept = initiator.with_settings(type(initiator.method)(sensor, common, options))
    vars(initiator).update(vars(other))
    return kept


def observation_of(made: Tracker, scan: Scan) -> Observation:
    """What the method is given of a scan, which it does not take."""
    given = []

    def step(observation: Observation) -> MethodResult:
        given.append(observation)
        return MethodResult()

    made.method.step = step
    made.process(scan)
    del made.method.step
    return given[0]
