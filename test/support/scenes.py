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
"""Random scenes for comparing implementations: every feature of a scan, switched at random."""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tsepm_ros import Scan

MAX_RANGE = 4000.0
MAX_SPEED = 10.0
RULES = ((3, 4), (3, 5), (4, 6), (4, 7), (5, 8))


@dataclass
class Scene:
    """Scans as plain dictionaries, and the options of the run."""

    scans: list[dict[str, Any]] = field(default_factory=list)
    sensor: dict[str, float] = field(default_factory=dict)
    options: dict[str, Any] = field(default_factory=dict)

    def as_scans(self) -> list[Scan]:
        return [Scan(**scan) for scan in self.scans]


def random_scene(seed: int) -> Scene:
    rng = np.random.default_rng([2018, seed])
    min_hits, window = RULES[seed % len(RULES)]
    scene = Scene(
        sensor={
            "range_std": float(rng.choice([0.0, 20.0])),
            "range_std_fraction": float(rng.choice([0.005, 0.015])),
            "azimuth_std": math.radians(float(rng.choice([0.5, 1.0, 2.0]))),
            "clutter_density": float(rng.choice([2e-7, 5e-7, 1e-6])),
        },
        options={
            "max_speed": MAX_SPEED,
            "min_hits": min_hits,
            "window": window,
            "gate_probability": float(rng.choice([0.9, 0.99])),
            "evaluation": str(rng.choice(["normalized_distance", "clutter_statistic"])),
            "pruning_reading": str(rng.choice(["literal", "squared"])),
            "pruning_probability": 0.99,
            "clutter_test_size": float(rng.choice([0.05, 0.5])),
            "merging": str(rng.choice(["moments", "refit"])),
            "merging_probability": float(rng.choice([0.9, 0.98])),
            "estimator": str(rng.choice(["unweighted", "weighted"])),
        },
    )
    p_d = float(rng.choice([0.6, 0.9, 1.0]))
    moving, pose_errors, offsets, own_errors = rng.random(4) < 0.4
    varying, missing = rng.random(2) < 0.5
    targets = [
        (rng.uniform(-0.7, 0.7, 2) * MAX_RANGE, rng.uniform(-6, 6, 2))
        for _ in range(rng.integers(1, 4))
    ]
    stamp = float(rng.uniform(0, 1e6))
    for _ in range(window + int(rng.integers(2, 6))):
        stamp += float(rng.uniform(6, 18)) if varying else 12.0
        if missing and rng.random() < 0.15:
            continue
        pose = np.array([3.0, -2.0, 0.002]) * (stamp % 1000.0) if moving else np.zeros(3)
        scene.scans.append(
            _scan(rng, scene.sensor, targets, stamp, pose, p_d, pose_errors, offsets, own_errors)
        )
    return scene


def crowded_scene(seed: int) -> Scene:
    """A target with false detections about it in each scan: which are its own is hard to tell."""
    rng = np.random.default_rng([2026, seed])
    sensor = {
        "range_std": 0.0,
        "range_std_fraction": 0.015,
        "azimuth_std": math.radians(1.0),
        "clutter_density": 1e-6,
    }
    scene = Scene(sensor=sensor)
    velocity = rng.uniform(-6.0, 6.0, 2)
    for index in range(5):
        place = np.array([2500.0, 1500.0]) + 12.0 * index * velocity
        points = place + rng.uniform(-300.0, 300.0, (3, 2))
        if rng.random() < 0.9:
            points = np.vstack([points, place + 40.0 * rng.standard_normal(2)])
        scene.scans.append(
            {
                "stamp": 12.0 * index,
                "range": np.hypot(*points.T).tolist(),
                "azimuth": np.arctan2(points[:, 1], points[:, 0]).tolist(),
            }
        )
    return scene


def _scan(rng, sensor, targets, stamp, pose, p_d, pose_errors, offsets, own_errors):
    area = math.pi * MAX_RANGE**2
    n_clutter = 0 if rng.random() < 0.05 else rng.poisson(sensor["clutter_density"] * area)
    range_ = list(MAX_RANGE * np.sqrt(rng.uniform(1e-4, 1, n_clutter)))
    azimuth = list(rng.uniform(-math.pi, math.pi, n_clutter))
    elapsed = stamp % 1000.0
    for position, velocity in targets:
        if rng.random() < p_d:
            x, y = position + velocity * elapsed * 0.3 - pose[:2]
            distance = math.hypot(x, y)
            sigma = math.hypot(sensor["range_std"], sensor["range_std_fraction"] * distance)
            range_.append(abs(distance + sigma * rng.standard_normal()) + 1.0)
            angle = math.atan2(y, x) - pose[2] + sensor["azimuth_std"] * rng.standard_normal()
            azimuth.append(angle)
    n = len(range_)
    scan: dict[str, Any] = {"stamp": stamp, "range": range_, "azimuth": azimuth}
    if pose_errors:
        scan["sensor_pose_covariance"] = np.diag([25.0, 16.0, 1e-4]).tolist()
    if offsets:
        scan["time_offset"] = (np.array(range_) / 1500.0).tolist()
        displacement = np.array(scan["time_offset"])[:, None] * np.array([3.0, -2.0, 0.002])
        scan["sensor_pose"] = (pose + displacement).tolist()
    else:
        scan["sensor_pose"] = pose.tolist()
    if own_errors:
        scan["range_std"] = rng.uniform(10, 60, n).tolist()
        scan["azimuth_std"] = rng.uniform(0.005, 0.03, n).tolist()
    return scan
