"""Which paths are kept where a limit cuts: those least like clutter."""

from __future__ import annotations

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.sensing.detection_window import DetectionWindow
from tsepm_ros.stages import evaluation
from tsepm_ros.stages.paths import Paths


def cost(paths: Paths, detections: DetectionWindow) -> FloatArray:
    """Clutter statistic per degree of freedom, (n,): small is target-like, 1 a track of clutter.

    A path of one hit has none yet and counts as clutter.
    """
    several = paths.hit_count > 1
    freedom = 2.0 * paths.hit_count - 2.0
    values = np.ones(len(paths))
    return np.divide(clutter_statistic(paths, detections), freedom, out=values, where=several)


def clutter_statistic(paths: Paths, detections: DetectionWindow) -> FloatArray:
    """f_2 (TSEPM 2018, Eq. 25) of the hits so far, (n,); 0 of one hit."""
    statistic = np.zeros(len(paths))
    for rows, hits in paths.of_equal_count():
        statistic[rows] = evaluation.clutter_statistic(
            detections.positions(hits), detections.clutter_densities(hits)
        )
    return statistic
