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
"""The logic method: regions of the speeds and of the line, on scenes by hand."""

import numpy as np
import pytest
from scipy.stats import chi2
from support.builders import detections, scan_at

from tsepm_ros import SensorModel, make_initiator
from tsepm_ros.studies.logic import LogicPolynomials

SENSOR = SensorModel(range_std=20.0, range_std_fraction=0.0, azimuth_std=1e-3)


def run(scans, **options):
    made = make_initiator("logic", sensor=SENSOR, **options)
    return [t for k, where in enumerate(scans) for t in made.process(scan_at(12.0 * k, where))]


def along_x(*steps: float):
    """Scans of one detection each that moves by the steps, m; the range's error is along x."""
    return [[(3000.0 + x, 0.0)] for x in np.cumsum([0.0, *steps])]


GAMMA = np.sqrt(chi2.ppf(0.99, 2))


@pytest.mark.parametrize(
    ("steps", "reach"),
    [((), 120.0 + GAMMA * np.sqrt(2) * 20.0), ((60.0,), 60.0 + GAMMA * np.sqrt(6) * 20.0)],
    ids=["second hit", "third hit"],
)
@pytest.mark.parametrize("inside", [True, False])
def test_the_region_is_that_of_the_speeds_and_then_of_the_line(steps, reach, inside):
    # The straight line through z_1, z_2 predicts 2 z_2 - z_1: the variance is 4 + 1, and R_j.
    scans = along_x(*steps, reach + (-0.5 if inside else 0.5))
    hits = len(scans)
    assert len(run(scans, min_hits=hits, window=hits)) == inside


def test_a_parabola_is_followed_by_the_second_order_only():
    scans = along_x(*(10.0 + 40.0 * k for k in range(6)))
    options = {"min_hits": 7, "window": 7, "gate_probability": 0.9}
    assert len(run(scans, **options)) == 1
    assert run(scans, degree=1, **options) == []


def test_every_second_hit_is_tried_but_of_the_later_ones_the_nearest_to_the_prediction():
    made = make_initiator("logic", sensor=SENSOR)
    beside = [(3060.0, 0.0), (3100.0, 0.0)]
    for k, where in enumerate([[(3000.0, 0.0)], beside, [(3117.0, 0.0), (3125.0, 0.0)]]):
        made.process(scan_at(12.0 * k, where))
    hits = {track.hits for track in made.potential_tracks()}
    assert hits == {((0, 0), (1, 0), (2, 0)), ((0, 0), (1, 1), (2, 1))}


@pytest.mark.parametrize(("missed", "found"), [("waits", 1), ("ends", 0)])
def test_a_track_without_a_detection_in_its_region_waits_or_ends(missed, found):
    scans = along_x(60.0, 60.0, 60.0, 60.0)
    scans[2] = []
    assert len(run(scans, min_hits=4, window=5, missed=missed)) == found


def test_the_region_of_a_track_at_its_sensor_s_errors_is_left_by_neither_axis():
    """Beyond the reach along both axes D is the sum of what is beyond on each."""
    sensor = SensorModel(range_std=20.0, range_std_fraction=0.0, azimuth_std=20.0 / 3000.0)
    for beyond, found in ((0.9 * GAMMA * 20.0, 1), (1.1 * GAMMA * 20.0, 0)):
        made = make_initiator("logic", sensor=sensor, min_hits=2, window=2)
        made.process(scan_at(0.0, [(3000.0, 0.0)]))
        where = (3000.0 + 120.0 + beyond, 120.0 + beyond)
        assert len(made.process(scan_at(12.0, [where]))) == found


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_a_polynomial_is_that_of_numpy_with_its_covariance(degree):
    rng = np.random.default_rng(degree)
    times = np.array([100.0, 112.0, 130.0, 141.0, 155.0])
    hits = detections(rng.normal(0, 100, (3, 5, 2)), times)
    roots = rng.normal(0, 5, (3, 5, 2, 2))
    hits["covariance"] = roots @ np.swapaxes(roots, -1, -2)
    at = np.array([160.0, 170.0, 150.0])
    fitted = LogicPolynomials.fitted(hits, 165.0, degree)
    position, covariance = fitted.at(np.arange(3), at)
    for row, time in enumerate(at):
        unit = [np.polyval(np.polyfit(times - time, one, degree), 0.0) for one in np.eye(5)]
        np.testing.assert_allclose(position[row], unit @ hits["position"][row], atol=1e-8)
        expected = np.einsum("i,iuv->uv", np.square(unit), hits["covariance"][row])
        np.testing.assert_allclose(covariance[row], expected, atol=1e-8)
    drift, sigma = fitted.reach(15.0)
    apart = np.hypot(*(position - fitted.coefficients[:, 0]).T)
    assert (apart <= drift * (1 + 1e-9) + 1e-9).all()
    assert (np.sqrt(np.linalg.eigvalsh(covariance)[:, -1]) <= sigma * (1 + 1e-9)).all()
