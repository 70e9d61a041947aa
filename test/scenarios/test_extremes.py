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
"""At the ends of all ranges covariances stay positive definite; months later it means the same."""

import numpy as np
import pytest
from support.builders import scan_at

from tsepm_ros import Scan, SensorModel, available_methods, make_initiator
from tsepm_ros.tracker.initial_state import ESTIMATORS
from tsepm_ros.tracker.measurement import MeasurementWindow
from tsepm_ros.tracker.merging import close
from tsepm_ros.tracker.tracks import ConfirmedTrack

CASES = {
    "azimuth_1e-9": ({"azimuth_std": 1e-9}, 12.0, None),
    "tiny": ({"range_std": 1e-5, "range_std_fraction": 0.0, "azimuth_std": 1e-9}, 12.0, None),
    "tiny_of_detections": ({}, 12.0, (1e-6, 1e-9)),
    "long_and_thin": ({}, 12.0, (100.0, 1e-9)),
    "stamps_1e-9": ({}, 1e-9, None),
    "huge": ({}, 12.0, (1e5, 3.14)),
}


def assert_proper(covariance: np.ndarray, what: str) -> None:
    if not len(covariance):
        return
    assert np.isfinite(covariance).all(), what
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    correlation = covariance / sigma[:, :, None] / sigma[:, None, :]
    assert np.abs(correlation - np.swapaxes(correlation, 1, 2)).max() < 1e-9, what
    assert (np.abs(correlation) < 1.0 + 1e-9).all(), what
    np.linalg.cholesky(covariance)


MADE = [(method, {}) for method in available_methods()]
MADE += [("tsepm", {"estimator": name}) for name in ESTIMATORS]


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize(("method", "options"), MADE, ids=str)
def test_tracks_confirmed_tracks_and_potential_tracks(method, options, case):
    given, period, deviations = CASES[case]
    rng = np.random.default_rng(2)
    options = {"clutter_density": "given", **options}
    initiator = make_initiator(method, sensor=SensorModel(**given), **options)
    for index in range(10):
        range_ = np.append(3000.0 + 5.0 * index, 9000.0 * np.sqrt(rng.uniform(0.01, 1.0, 6)))
        azimuth = np.append(0.5, rng.uniform(-3.1, 3.1, 6))
        if not deviations:
            azimuth[0] += initiator.sensor.model.azimuth_std * rng.standard_normal()
        errors = {}
        if deviations:
            shape = np.full(len(range_), 1.0)
            errors = {"range_std": shape * deviations[0], "azimuth_std": shape * deviations[1]}
        new = initiator.process(Scan(100.0 + period * index, range_, azimuth, **errors))
        for tracks, name in (
            (new, "new"),
            (initiator.current, "held"),
            (initiator.potential_tracks(), "potential"),
        ):
            assert_proper(tracks.covariance, f"{name} at {index}")


def test_tracks_of_singular_covariances_can_be_compared_for_merging():
    covariances = np.stack([np.zeros((4, 4)), np.zeros((4, 4))])
    covariances[:, 0, 0] = 1e-30
    states = np.zeros((2, 4))
    one, other = np.array([0]), np.array([1])
    assert close(states, covariances, one, other, 9.0).tolist() == [True]


LATE = 10**13
"""Scans and detections before; an array with an element for each does not fit into memory."""


SENSOR = SensorModel(range_std=5.0, range_std_fraction=0.0, azimuth_std=0.002)


def scans() -> list[Scan]:
    """A target that moves, among false detections."""
    rng = np.random.default_rng(5)
    made = []
    for k in range(24):
        target = np.array([1000.0, 300.0]) + 10.0 * k * np.array([3.0, -2.0]) + rng.normal(0, 3, 2)
        made.append(scan_at(10.0 * k, [target, *rng.uniform(-3000.0, 3000.0, (6, 2))]))
    return made


def tracks_of(method: str, first_scan: int) -> list[ConfirmedTrack]:
    """The tracks where the first scan has this number."""
    made = make_initiator(method, sensor=SENSOR, max_speed=6.0, hold_time=60.0)
    made.scan_index = first_scan - 1
    found = [track for scan in scans() for track in made.process(scan)]
    made.potential_tracks()
    return found + list(made.current)


@pytest.mark.long
@pytest.mark.parametrize("method", available_methods())
def test_numbers_of_scans_and_detections_may_be_large(method, monkeypatch):
    soon = tracks_of(method, 0)
    assert soon

    def begin_late(window: MeasurementWindow) -> None:
        begin(window)
        window.first_id = LATE

    begin = MeasurementWindow.__init__
    monkeypatch.setattr(MeasurementWindow, "__init__", begin_late)
    late = tracks_of(method, LATE)
    assert len(late) == len(soon)
    for before, after in zip(soon, late, strict=True):
        np.testing.assert_array_equal(after.state, before.state)
        np.testing.assert_array_equal(after.covariance, before.covariance)
        assert after.hits == tuple((LATE + scan, row) for scan, row in before.hits)
