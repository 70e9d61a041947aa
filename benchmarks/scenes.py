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
"""The scenes of the peer timing: clutter over a whole disc and one target."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from contenders import Hits, RawScan, Sea
from numpy.typing import NDArray

from tsepm_ros.tools.simulation import Scenario, Simulator
from tsepm_ros.tools.simulation.scenario import ScenarioTargetArea

DENSITIES = (2.5e-7, 5e-7, 1e-6, 2e-6, 3e-6, 5e-6, 1e-5)
"""Clutter densities, per scan and m^2."""
CALM_DETECTIONS = 10.0
"""Mean number of detections per scan of a calm sea, the target's included."""
MIN_TARGET_RANGE = 1000.0  # m
ALL_AZIMUTHS = (-math.pi, math.pi)


@dataclass(frozen=True, eq=False)
class Scene:
    """Scans for all contenders, and the target of each detection, negative for clutter."""

    sea: Sea
    scans: list[RawScan]
    origins: list[NDArray[np.int64]]

    def is_target(self, hits: Hits) -> bool:
        """Whether more than half of a track's hits are echoes of the target."""
        echoes = sum(bool(self.origins[scan][row] >= 0) for scan, row in hits)
        return 2 * echoes > len(hits)


def calm_density() -> float:
    """Clutter density of the calm sea."""
    sea = Sea(clutter_density=0.0)
    return (CALM_DETECTIONS - sea.detection_probability) / sea.area


def make_scene(clutter_density: float, scans: int, seed: int) -> Scene:
    """Draw a scene: clutter of a density over the whole disc, and one target."""
    sea = Sea(clutter_density=clutter_density)
    scenario = Scenario(
        name="disc",
        scans=scans,
        period=sea.period,
        sensor=sea.sensor(),
        areas=(
            ScenarioTargetArea(
                1, (MIN_TARGET_RANGE, sea.max_range), ALL_AZIMUTHS, sea.target_speed
            ),
        ),
    )
    drawn = list(Simulator(scenario, seed))
    scans = [RawScan(item.scan.stamp, item.scan.range, item.scan.azimuth) for item in drawn]
    return Scene(sea, scans, [item.origin for item in drawn])
