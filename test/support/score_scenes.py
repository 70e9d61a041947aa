"""Scenes for the likelihood-ratio method: a sea of clutter with targets in it."""

import math

import numpy as np

from support.plain_score import Grown, Rule, plain_hypotheses
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
        process_noise=(0.0, 0.01)[seed % 2],
        deletion=ScoreOptions().deletion_threshold,
        window=3 if seed % 3 == 0 else 16,
        max_range=3700.0,
    )
    sensor = SensorModel(
        **scene.sensor, detection_probability=rule.detection_probability, max_range=rule.max_range
    )
    options = {
        "window": rule.window,
        "process_noise": rule.process_noise,
    }
    plain = plain_hypotheses(scene.scans[: 5 if seed % 2 else 4], rule)
    return plain, sensor, options
