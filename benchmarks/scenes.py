"""The scenes of the race: clutter over a whole disc and one target."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from contenders import Hits, RawScan, Sea
from numpy.typing import NDArray

from tsepm_ros import SensorModel
from tsepm_ros.simulation import Scenario, Simulator
from tsepm_ros.simulation.scenario import TargetArea

DENSITIES = (2.5e-7, 5e-7, 1e-6, 2e-6, 3e-6, 5e-6, 1e-5)
"""Clutter densities, per scan and m^2."""
CALM_DETECTIONS = 10.0
"""Mean number of detections per scan of a calm sea, the target's included."""
NEAREST_TARGET = 1000.0  # m


@dataclass(frozen=True, eq=False)
class Scene:
    """Scans that every contender gets, with their truth.

    Attributes
    ----------
    sea : Sea
    scans : list of RawScan
    origins : list of (n,) ndarray of int
        Per scan the target index of each detection, negative for clutter.
    """

    sea: Sea
    scans: list[RawScan]
    origins: list[NDArray[np.int64]]

    def is_target(self, hits: Hits) -> bool:
        """Tell whether more than half of a track's hits are echoes of the target."""
        echoes = sum(bool(self.origins[scan][row] >= 0) for scan, row in hits)
        return 2 * echoes > len(hits)


def calm_density() -> float:
    """Clutter density of the calm sea."""
    sea = Sea(clutter_density=0.0)
    return (CALM_DETECTIONS - sea.detection_probability) / sea.area


def make_scene(clutter_density: float, scans: int, seed: int) -> Scene:
    """Draw a scene: clutter of a density over the whole disc, one target in it."""
    sea = Sea(clutter_density=clutter_density)
    scenario = Scenario(
        name="disc",
        scans=scans,
        period=sea.period,
        sensor=SensorModel(
            range_std_fraction=sea.range_std_fraction,
            azimuth_std=sea.azimuth_std,
            max_range=sea.max_range,
            detection_probability=sea.detection_probability,
            clutter_density=clutter_density,
        ),
        areas=(
            TargetArea(1, (NEAREST_TARGET, sea.max_range), (-math.pi, math.pi), sea.target_speed),
        ),
    )
    drawn = list(Simulator(scenario, seed))
    return Scene(
        sea=sea,
        scans=[RawScan(item.scan.stamp, item.scan.range, item.scan.azimuth) for item in drawn],
        origins=[item.origin for item in drawn],
    )
