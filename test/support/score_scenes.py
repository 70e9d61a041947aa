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
"""Scenes for the likelihood-ratio method: a sea of clutter with targets in it."""

import math
from typing import Any
from unittest.mock import patch

import numpy as np

from support.plain_score import Grown, Key, Rule, plain_hypotheses
from support.plain_tsepm import Parameters
from support.scenes import Scene
from tsepm_ros import Scan, SensorModel, make_initiator
from tsepm_ros.tracker.options import ScoreOptions
from tsepm_ros.tracker.tracker import Tracker

NEVER = 1e-30
"""A rate of so few false tracks that nothing is confirmed."""
SONAR = SensorModel()
DISC = SONAR.coverage_area


def score(sensor: SensorModel = SONAR, **options) -> Tracker:
    return make_initiator("score", sensor=sensor, **options)


def clutter(rng: np.random.Generator, density: float = 1e-6) -> tuple[np.ndarray, np.ndarray]:
    """Range and azimuth of clutter over the whole disc."""
    n = rng.poisson(density * DISC)
    return 9000.0 * np.sqrt(rng.uniform(1e-6, 1.0, n)), rng.uniform(-math.pi, math.pi, n)


def sea(
    rng: np.random.Generator,
    scans: int,
    targets: list[tuple[float, float, float, float]],
    density: float = 1e-6,
    detected: float = 0.9,
) -> list[Scan]:
    """Scans of clutter and of targets [x, vx, y, vy]; the targets' detections come last."""
    sea_scans = []
    for index in range(scans):
        range_, azimuth = clutter(rng, density)
        for x, vx, y, vy in targets:
            if rng.random() < detected:
                place = x + 12.0 * index * vx, y + 12.0 * index * vy
                distance = math.hypot(*place)
                range_ = np.append(range_, distance * (1 + 0.015 * rng.standard_normal()))
                angle = math.atan2(place[1], place[0])
                azimuth = np.append(azimuth, angle + SONAR.azimuth_std * rng.standard_normal())
        sea_scans.append(Scan(12.0 * index, range_, azimuth))
    return sea_scans


def in_plain_loops(scene: Scene, seed: int) -> tuple[list[Grown], SensorModel, dict[str, float]]:
    """Hypotheses of a scene under a rule that the seed chooses; sensor and options of the same."""
    rule = Rule(
        Parameters(**scene.sensor, max_speed=10.0, min_hits=3, window=16, across_as_along=True),
        detection_probability=(0.6, 0.9, 0.999)[seed % 3],
        gate_probability=0.99,
        target_manoeuvre=(0.0, 0.03)[seed % 2],
        deletion=ScoreOptions().deletion_threshold,
        window=3 if seed % 3 == 0 else 16,
        max_range=3700.0,
    )
    sensor = SensorModel(
        **scene.sensor, detection_probability=rule.detection_probability, max_range=rule.max_range
    )
    options = {"window": rule.window, "target_manoeuvre": rule.target_manoeuvre}
    scans = scene.scans[: 5 if seed % 2 else 4]
    return plain_hypotheses(scans, rule, partly_confirmed(scene)), sensor, options


def partly_confirmed(scene: Scene) -> dict[Key, float]:
    """How probably detections are confirmed tracks': every third of a scan, in part or surely."""
    return {
        (index, row): (0.5, 0.999)[index % 2]
        for index, scan in enumerate(scene.scans)
        for row in range(1, len(scan["range"]), 3)
    }


def given_confirmed(initiator: Tracker, scene: Scene) -> Any:
    """Context in which the initiator's confirmed tracks claim detections as `partly_confirmed`."""
    confirmed = partly_confirmed(scene)

    def step(_: float, detections: np.ndarray, *others: Any, **more: Any) -> np.ndarray:
        keys = zip(detections["scan"].tolist(), detections["index"].tolist(), strict=True)
        return np.array([confirmed.get(key, 0.0) for key in keys])

    return patch.object(initiator.maintenance, "step", step)
