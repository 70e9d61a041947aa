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
"""Simulated images: law of the clutter, targets, walls, streaks, single bearings."""

import numpy as np
import pytest

from tsepm_ros import SensorModel
from tsepm_ros.tools.simulation import Scenario
from tsepm_ros.tools.simulation.images import ImageModel, ImageSimulator
from tsepm_ros.tools.simulation.scenario import (
    ClutterStrength,
    ScenarioOwnShipMotion,
    TargetStrength,
)

SENSOR = SensorModel(
    range_std=0.1, min_range=1.0, max_range=21.0, azimuth_min=-1.0, azimuth_max=1.0
)


def drawn(model=None, scans=1, **fields):
    scene = Scenario(name="images", scans=scans, period=1.0, sensor=SENSOR, **fields)
    return ImageSimulator(scene, model or ImageModel(cells=(64, 200)), 1)


def amplitude(model=None, **fields):
    return next(iter(drawn(model, **fields)))[0].intensity


def test_clutter_is_rayleigh_or_heavier_and_the_beam_correlates_bearings():
    square = amplitude() ** 2
    assert square.mean() == pytest.approx(1.0, rel=0.05)
    assert (square**2).mean() / square.mean() ** 2 == pytest.approx(2.0, rel=0.1)
    k = amplitude(clutter_strength=ClutterStrength("k", 0.5)) ** 2
    assert (k**2).mean() / k.mean() ** 2 == pytest.approx(6.0, rel=0.4)
    log = amplitude(clutter_strength=ClutterStrength("log_normal", 0.5)) ** 2
    assert (log**2).mean() / log.mean() ** 2 == pytest.approx(2.0 * np.exp(0.25), rel=0.15)
    model = ImageModel(cells=(64, 200), blur=(2.0, 0.0))
    square = amplitude(model) ** 2
    assert square.mean() == pytest.approx(1.0, rel=0.2)
    assert np.corrcoef(square[1:].ravel(), square[:-1].ravel())[0, 1] > 0.7
    assert abs(np.corrcoef(square[:, 1:].ravel(), square[:, :-1].ravel())[0, 1]) < 0.1


@pytest.mark.parametrize("size", [(0.0, 0.0), (3.0, 7.0)])
def test_a_target_has_its_strength_where_it_is(size):
    model = ImageModel(cells=(64, 200), target_size=size)
    target = np.array([10.05, 0.0, 10.05 * np.tan(1.0 / 64), 0.0])
    simulator = drawn(
        model, 40, targets=(target,), target_strengths=(TargetStrength(20.0, "swerling_1"),)
    )
    power = [image.intensity[32, 90] ** 2 for image, truth in simulator]
    assert 10 * np.log10(np.mean(power)) == pytest.approx(20.0, abs=2.5)


def test_reverberation_falls_walls_stand_and_streaks_come():
    model = ImageModel(cells=(64, 200), fall_db=40.0)
    image = amplitude(model)
    assert image[:, -20:].mean() / image[:, :20].mean() == pytest.approx(0.012, rel=0.3)
    wall = amplitude(ImageModel(cells=(64, 200), walls=((10.0, -5.0, 10.0, 5.0, 20.0),)))
    assert wall[24:40, 85:95].max() > 4.0
    streaks = amplitude(ImageModel(cells=(64, 200), streaks=3.0))
    assert np.sort(np.median(streaks, axis=1))[-1] > 5.0


def test_each_bearing_of_an_image_has_its_time_and_pose():
    model = ImageModel(cells=(8, 50), sweep_time=0.7)
    [(image, _)] = drawn(model, own_ship=ScenarioOwnShipMotion(speed=2.0))
    assert image.time_offset == pytest.approx(np.linspace(0.0, 0.7, 8))
    assert image.sensor_pose[-1] == pytest.approx([1.4, 0.0, 0.0])
