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
"""The contenders of the comparison: small modules with the same interface.

A contender converts raw scans to its own input within the measured time.
"""

from __future__ import annotations

import importlib
from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from tsepm_ros import SensorModel
from tsepm_ros.numerics.arrays import FloatArray

Hits = tuple[tuple[int, int], ...]
"""(scan index, detection index) of each hit of a track, oldest first."""


@dataclass(frozen=True, eq=False)
class RawScan:
    """A scan as from a driver: stamp, s, range, m, and azimuth, rad counter-clockwise from x."""

    stamp: float
    range: FloatArray
    azimuth: FloatArray

    def __len__(self) -> int:
        """Number of detections."""
        return len(self.range)


@dataclass(frozen=True, kw_only=True)
class Sea:
    """Parameters of the scene for all contenders; the defaults are the paper's sonar."""

    clutter_density: float  # false detections per scan and m^2
    period: float = 12.0  # s
    max_range: float = 9000.0  # m
    range_std_fraction: float = 0.015
    azimuth_std: float = float(np.deg2rad(1.0))
    detection_probability: float = 0.9
    gate_probability: float = 0.9
    max_speed: float = 10.0  # m/s
    target_speed: float = 5.0

    def sensor(self) -> SensorModel:
        """The same parameters as the package's sensor model."""
        return SensorModel(
            range_std_fraction=self.range_std_fraction,
            azimuth_std=self.azimuth_std,
            max_range=self.max_range,
            detection_probability=self.detection_probability,
            clutter_density=self.clutter_density,
        )

    @property
    def area(self) -> float:
        """Area of the disc, m^2."""
        return float(np.pi * self.max_range**2)

    @property
    def gate_sigmas(self) -> float:
        """Radius of the two-dimensional gate of the gate probability, standard deviations."""
        return float(np.sqrt(-2.0 * np.log1p(-self.gate_probability)))

    @property
    def typical_range(self) -> float:
        """Root mean square range of the disc's points, m."""
        return self.max_range / float(np.sqrt(2.0))


class Contender(ABC):
    """A track initiator for a scene's parameters and an M/N rule.

    A contender without M/N rules approximates the rule by its options.
    """

    def __init__(self, sea: Sea, min_hits: int, window: int) -> None:
        self.sea = sea
        self.min_hits = min_hits
        self.window = window

    @abstractmethod
    def process(self, scan: RawScan) -> int:
        """Process one scan and return the number of new tracks. Timed."""

    @abstractmethod
    def hits(self) -> list[Hits]:
        """Hits of the last scan's new tracks. Not timed."""

    def states(self) -> FloatArray | None:
        """States of the last scan's new tracks, (n, 4), at its time; None if unknown. Not timed."""
        return None

    def covariances(self) -> FloatArray | None:
        """Covariances of these states, (n, 4, 4); None if unknown. Not timed."""
        return None

    @abstractmethod
    def counts(self) -> dict[str, int]:
        """Counts of the last scan: `potential` and others. Not timed."""


@dataclass(frozen=True)
class Entry:
    """Module and class of a contender, and its rule."""

    module: str
    kind: str
    min_hits: int
    window: int


CONTENDERS = {
    "tsepm-3/4": Entry("tsepm", "TsepmContender", 3, 4),
    "tsepm-5/8": Entry("tsepm", "TsepmContender", 5, 8),
    "tsepm-8/12": Entry("tsepm", "TsepmContender", 8, 12),
    "tsepm-default-5/8": Entry("tsepm", "DefaultTsepmContender", 5, 8),
    "oracle-5/8": Entry("oracle", "OracleContender", 5, 8),
    "stonesoup-5/8": Entry("stone_soup", "StoneSoupContender", 5, 8),
    "stonesoup-tuned-5/8": Entry("stone_soup", "TunedStoneSoupContender", 5, 8),
    "stonesoup-xy-5/8": Entry("stone_soup", "ConvertedStoneSoupContender", 5, 8),
    "norfair-5": Entry("norfair_tracker", "NorfairContender", 5, 8),
}
"""Every contender. A new one is a module here and a row in this table."""


def make_contender(name: str, sea: Sea) -> Contender:
    """Make a contender by its name; an ImportError if its package is not installed."""
    entry = CONTENDERS[name]
    module = importlib.import_module(f"contenders.{entry.module}")
    contender: Contender = getattr(module, entry.kind)(sea, entry.min_hits, entry.window)
    return contender
