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
"""Everything that is learned of a sensor's surroundings, and its use in a scan.

The models are independent of the method. In a scan they tell the clutter where its detections are,
as known before, and as learned from them.
"""

from __future__ import annotations

import math
import statistics
from collections import deque
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from tsepm_ros.numerics.arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    RecordArray,
    replaced,
    rows_of,
)
from tsepm_ros.tracker import range_rates
from tsepm_ros.tracker.clutter.amplitude import LAGS, ClutterAmplitudes
from tsepm_ros.tracker.clutter.amplitude_law import MIN_REFERENCES
from tsepm_ros.tracker.clutter.density import (
    EVERYWHERE,
    ClutterExtent,
    ClutterMap,
    SeenClutterExtent,
)
from tsepm_ros.tracker.clutter.excess import (
    ConfirmedTargets,
    DensityDoubt,
    Overdispersion,
    SecondaryEchoes,
)
from tsepm_ros.tracker.clutter.fixed_places import MIN_DENSITY_RATIO, FixedPlaces
from tsepm_ros.tracker.clutter.sensor_performance import (
    DetectionProbability,
    InnovationSamples,
)
from tsepm_ros.tracker.polar_grid import MEMORY_SCANS, Cells, ScanBatch
from tsepm_ros.tracker.sensor import SensorModel, SensorView

MAX_CLUTTER_RANGE_RATE, DRIFT_SHARE = 1e4, 0.7
"""Largest estimate of the median magnitude of clutter's range rates, m/s; share of it that a drift
leaves, at most."""
ERRORS = "range_std", "range_std_fraction", "azimuth_std"
"""Fields of a sensor that innovations are compared with."""
COVERAGE = "min_range", "max_range", "azimuth_min", "azimuth_max"
"""Fields of a sensor of which the cells of the clutter map are."""
MIN_SHARE = 1e-3
"""Share of the coverage that a scan looked at, at least."""


class ClutterRangeRates:
    """Estimates the drift and the width of clutter's range rates: most detections are clutter.

    Rain drifts with the wind, and reverberation with the current. The drift over ground is fitted
    by least squares with the weights of a Cauchy density, a step a scan. It counts where it makes
    the median magnitude much smaller.
    """

    def __init__(self) -> None:
        self._rates, self._drift = deque[FloatArray](maxlen=MEMORY_SCANS), np.zeros((2, 1))

    def estimate(self, detections: RecordArray, sensor: SensorModel) -> SensorModel:
        """The sensor with the median magnitude beside the drift as `clutter_range_rate`.

        With fewer than `MIN_REFERENCES` range rates, those of a scan's detections included, it is
        returned unchanged. The detections get the drift.
        """
        rated = rows_of(detections, range_rates.measured(detections))
        if len(rated):
            still, _, sight = range_rates.expected(rated, rated["position"], np.zeros(2))
            self._rates.append(np.column_stack([rated["range_rate"] - still, sight]))
        rates, sights = np.split(np.concatenate([np.zeros((0, 3)), *self._rates]), [1], axis=1)
        if len(rates) < MIN_REFERENCES:
            return sensor
        # Most rates may be 0: of a coarse scale, or as a driver fills them in.
        width = max(float(np.median(np.abs(rates))), 0.5 * sensor.range_rate_std)
        weighted = sights / ((rates - sights @ self._drift) ** 2 + width**2)
        self._drift = np.linalg.lstsq(weighted.T @ sights, weighted.T @ rates, MIN_SHARE)[0]
        beside = np.median(np.abs(rates - sights @ self._drift))
        if beside < DRIFT_SHARE * width:
            detections["clutter_velocity"], width = self._drift[:, 0], beside
        width = np.clip(width, 0.5 * sensor.range_rate_std, MAX_CLUTTER_RANGE_RATE)
        return replace(sensor, clutter_range_rate=float(width))


class ScanInterval:
    """Median of the last intervals: a lost ping or a pause does not change it.

    Attributes
    ----------
    median : float
        s; 0 while it is unknown.
    """

    def __init__(self) -> None:
        self._intervals: deque[float] = deque(maxlen=MEMORY_SCANS)
        self.median = 0.0

    def update(self, interval: float) -> None:
        """Take the time since the scan before, s; 0 for the first scan."""
        if interval > 0.0:
            self._intervals.append(interval)
            self.median = statistics.median(self._intervals)


class ClutterUse(NamedTuple):
    """What of the learned clutter counts.

    Attributes
    ----------
    given : float or None
        The density, 1/m^2, where it is given; None where it is estimated.
    echoes : bool
        Whether clutter behind targets, clutter that stays and its lumps count: where the density is
        estimated and confirmed tracks are targets.
    """

    given: float | None
    echoes: bool


@dataclass(frozen=True, eq=False)
class ScanClutter:
    """The clutter at the detections (d,) of a scan.

    Attributes
    ----------
    polar : tuple of ndarray
        Range and azimuth, m and rad.
    cells : Cells
        Of the clutter map.
    places : tuple of ndarray or None
        Positions in the fixed frame, and standard deviations, m; None where no place counts.
    staying : ndarray
        Density where clutter stays, 0 elsewhere, 1/m^2.
    density : ndarray
        Of the map before the scan; of all models after it, 1/m^2.
    weight : ndarray
        Probability that each detection is clutter; 0 before the scan was learned from.
    predictive : DensityDoubt or None
        What makes the density uncertain; None before the scan was learned from, and where the
        density is given.
    """

    polar: tuple[FloatArray, FloatArray]
    cells: Cells
    places: tuple[FloatArray, FloatArray] | None
    staying: FloatArray
    density: FloatArray
    weight: FloatArray
    predictive: DensityDoubt | None = None

    @property
    def is_fixed(self) -> BoolArray:
        """Whether each detection is where clutter stays and the map does not show it, (d,)."""
        return self.staying > (MIN_DENSITY_RATIO * self.density if self.staying.any() else 0.0)

    def raised(self, density: FloatArray) -> FloatArray:
        """Density (d,), raised where clutter stays."""
        return np.where(self.staying > MIN_DENSITY_RATIO * density, self.staying, density)


@dataclass(frozen=True)
class Surroundings:
    """Models learned from the scans so far; they survive a change of method.

    Attributes
    ----------
    clutter_map : ClutterMap
    overdispersion : Overdispersion
        How much lumpier clutter is than the map.
    seen_extent : SeenClutterExtent
        Where clutter is seen, in the coverage.
    amplitudes : ClutterAmplitudes
        Amplitudes of clutter.
    fixed_places : FixedPlaces
        Where clutter stays in the fixed frame.
    secondary_echoes : SecondaryEchoes
        Clutter behind targets, and behind other clutter of a scan.
    batch : ScanBatch
        Detections of the last scans that are not learned from yet.
    all_extent : SeenClutterExtent
        Where detections are, outside the coverage too, of scans that have such.
    scan_interval : ScanInterval
    clutter_range_rates : ClutterRangeRates
        Range rates of clutter.
    detection_probability : DetectionProbability
        Estimated from the confirmed tracks.
    errors : InnovationSamples
        Innovations of the confirmed tracks' detections.
    """

    clutter_map: ClutterMap
    overdispersion: Overdispersion
    seen_extent: SeenClutterExtent
    amplitudes: ClutterAmplitudes
    fixed_places: FixedPlaces
    secondary_echoes: SecondaryEchoes
    batch: ScanBatch
    all_extent: SeenClutterExtent = field(default_factory=lambda: SeenClutterExtent(EVERYWHERE))
    scan_interval: ScanInterval = field(default_factory=ScanInterval)
    clutter_range_rates: ClutterRangeRates = field(default_factory=ClutterRangeRates)
    detection_probability: DetectionProbability = field(default_factory=DetectionProbability)
    errors: InnovationSamples = field(default_factory=InnovationSamples)

    @classmethod
    def initial(cls, sensor: SensorModel) -> Surroundings:
        """Models before the first scan of a sensor."""
        clutter_map = ClutterMap(sensor)
        grid = clutter_map.grid
        return cls(
            clutter_map,
            Overdispersion(grid),
            SeenClutterExtent(ClutterExtent.of_sensor(sensor)),
            ClutterAmplitudes(grid),
            FixedPlaces(sensor),
            SecondaryEchoes(grid),
            ScanBatch(grid.shape[1]),
        )

    def under(self, sensor: SensorModel, before: SensorModel) -> Surroundings:
        """The models for a sensor in place of the one before.

        The clutter map is kept only for the same coverage and initial density, innovations only for
        the same errors.
        """

        def same(*names: str) -> bool:
            return all(getattr(sensor, name) == getattr(before, name) for name in names)

        kept = self if same(*ERRORS) else replace(self, errors=InnovationSamples())
        if same(*COVERAGE, "clutter_density"):
            return kept
        fresh = Surroundings.initial(sensor)
        return replace(
            kept,
            clutter_map=fresh.clutter_map,
            overdispersion=fresh.overdispersion,
            seen_extent=fresh.seen_extent,
            amplitudes=fresh.amplitudes,
            secondary_echoes=fresh.secondary_echoes,
            batch=fresh.batch,
        )

    def at(
        self,
        use: ClutterUse,
        polar: tuple[FloatArray, FloatArray],
        detections: RecordArray | None = None,
    ) -> ScanClutter:
        """The clutter at the places of a scan's detections, as it is known before the scan.

        Parameters
        ----------
        use : ClutterUse
        polar : tuple of (d,) ndarray
            Range and azimuth of the detections or clusters, m and rad.
        detections : (d,) ndarray of DETECTION, optional
            Converted; without them clutter that stays is left out.
        """
        places, staying, fixed = None, np.zeros(len(polar[0])), self.fixed_places
        if use.echoes and detections is not None:
            places = detections["position"], detections["major_sigma"]
            if fixed.known:
                staying = fixed.density(fixed.cells(*places))
        cells = self.clutter_map.grid.cells(*polar)
        density = self._of_map(use, cells)
        return ScanClutter(polar, cells, places, staying, density, np.zeros(len(density)))

    def before(
        self, use: ClutterUse, clutter: ScanClutter, targets: ConfirmedTargets
    ) -> FloatArray:
        """Density at each detection, (d,), 1/m^2, with confirmed targets as of the last scan."""
        density = clutter.density
        if use.echoes and self.secondary_echoes.rises:
            density = density * self.secondary_echoes.behind_targets(targets, clutter.cells)
        return clutter.raised(density)

    def learn(
        self,
        use: ClutterUse,
        clutter: ScanClutter,
        stamp: float,
        view: SensorView,
        weight: FloatArray,
        min_area: float,
        targets: ConfirmedTargets,
        moving: IntArray,
    ) -> ScanClutter:
        """Learn from a scan, and return the clutter at its detections after it.

        Parameters
        ----------
        use : ClutterUse
        clutter : ScanClutter
            As it was known before.
        stamp : float
            Of the scan, s.
        view : SensorView
            What the scan looked at.
        weight : (d,) ndarray
            Probability that each detection is clutter.
        min_area : float
            See `ClutterMap.update`.
        targets : ConfirmedTargets
            As of this scan.
        moving : (k,) ndarray of int
            Rows of detections that are probably of confirmed tracks that move.
        """
        clutter_map, batch, echoes = self.clutter_map, self.batch, self.secondary_echoes
        cells, predictive = clutter.cells, None
        looked = clutter_map.grid.looked(view.swept)
        batch.take(cells, clutter.polar, weight, looked)
        whole = batch.is_whole(stamp, self.scan_interval.median) or clutter_map.young
        if whole:
            scans, polar, weights = batch.joined
            self.seen_extent.update(*polar, weights)
            clutter_map.update(scans, weights, self.seen_extent, min_area, batch.looks)
        clutter_map.take_level(float(weight.sum()), max(float(looked.mean()), MIN_SHARE))
        density, area = self._of_map(use, cells), clutter_map.seen.counted
        batch.densities.append(density)  # whatever counts: the use may change within a batch
        if use.echoes:
            if whole:
                echoes.update(targets, batch, clutter_map.expected)
            if echoes.correlation.any():
                density *= echoes.among(cells, weight, clutter_map.expected)
            if echoes.rises:
                density *= echoes.behind_targets(targets, cells)
            if whole:
                self.overdispersion.update(batch, area)
            predictive = self.overdispersion.predictive(cells, density, area)
        if whole:
            batch.end(stamp)
        if clutter.places is not None:
            self.fixed_places.update(stamp, view, *clutter.places, moving)
        return replaced(
            clutter, density=clutter.raised(density), weight=weight, predictive=predictive
        )

    def learn_amplitudes(self, detections: RecordArray, weight: FloatArray, moved: float) -> None:
        """Learn the law of the amplitudes of clutter from the scan that was judged.

        Parameters
        ----------
        detections : (d,) ndarray of DETECTION
        weight : (d,) ndarray
            Probability that each detection is clutter.
        moved : float
            Distance that a target moves at most from scan to scan, m.
        """
        if not self.amplitudes.judged:
            return
        sigma = detections["major_sigma"]
        error = 3.0 * float(np.median(sigma)) if len(sigma) else 0.0
        reach = moved * np.arange(LAGS + 1.0) + math.sqrt(2.0) * error
        self.amplitudes.update(weight, (LAGS + 1.0) * moved + error, reach)

    def withdraw(self, clutter: ScanClutter, share: FloatArray) -> None:
        """Take back a share of each detection (d,) of the last scan: that of a target after all."""
        rows_of = clutter.weight * share
        if not self.batch.is_new:
            self.batch.withdraw(rows_of)
        else:  # learned from with its batch
            self.clutter_map.withdraw(clutter.cells, rows_of)
            if clutter.predictive is not None:
                self.overdispersion.withdraw(rows_of)

    def _of_map(self, use: ClutterUse, cells: Cells) -> FloatArray:
        """Density of the map, or that given, in cells (d,), 1/m^2."""
        if use.given is not None:
            return np.full(len(cells.row), use.given)
        return self.clutter_map.at(cells)
