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
"""An observed scan: what a method is given of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray, RecordArray
from tsepm_ros.tracker.clutter.amplitude_law import ScanAmplitudes
from tsepm_ros.tracker.clutter.density import ClutterExtent
from tsepm_ros.tracker.clutter.excess import DensityDoubt
from tsepm_ros.tracker.measurement import MeasurementWindow
from tsepm_ros.tracker.sensor import Picture, RangeErrors, SensorModel
from tsepm_ros.tracker.tracks import TrackArrays


@dataclass(frozen=True)
class Observation:
    """A scan's detections in the coverage, with clutter densities and confirmed association.

    Attributes
    ----------
    stamp : float
        The scan's stamp, s.
    scan_index : int
        Number of the scan since the start or the last reset, from 0.
    interval : float
        Time since the scan before, s; 0 for the first.
    detections : (d,) ndarray of DETECTION
        Converted to the fixed frame; `clutter_density` is that after learning.
    window : MeasurementWindow
        The detections of the last scans, these included.
    ids : (d,) ndarray of int
        Their ids in the window.
    clutter_density : (d,) ndarray
        Clutter density at each detection after this scan was learned from, 1/m^2, times the
        density of its range rate, s/m, where it has one.
    confirmed_probability : (d,) ndarray
        Probability that each detection is a confirmed track's, below 1.
    may_start : (d,) ndarray of bool
        Which detections may be the last hit of a start.
    tracks : TrackArrays
        The confirmed tracks.
    detected : (n,) ndarray of bool
        Which of these were detected in this scan.
    clutter_sensor : SensorModel
        The sensor with the range rates of its clutter as given or learned.
    seen_extent : ClutterExtent
        Ranges and sector in which clutter is seen.
    sensor_position : (2,) ndarray
        Where the sensor was, in the fixed frame, m.
    detection_probability : callable
        P_D in this scan of targets at positions (n, 2); 0 outside the coverage.
    detection_probability_in_use : float
        P_D in the coverage, given or estimated.
    process_noise : float
        Spectral density q of the acceleration of targets, m^2/s^3.
    most_pairs : float
        Pairs of potential tracks and detections that the scan may have.
    picture : Picture
        The sensor that looked, among those of the picture.
    begun : (k,) ndarray of int or None
        Scans, ascending, with which hypotheses began that live on: those in the window of their
        sensor, without its first. None: the window of a single sensor counts.
    errors : RangeErrors or None
        Errors in use of all sensors; None for a single one.
    amplitudes : ScanAmplitudes or None
        What the amplitudes of the detections say; None where they do not count.
    predictive : DensityDoubt or None
        What makes the clutter density uncertain; None where it is given.
    """

    stamp: float
    scan_index: int
    interval: float
    detections: RecordArray
    window: MeasurementWindow
    ids: IntArray
    clutter_density: FloatArray
    confirmed_probability: FloatArray
    may_start: BoolArray
    tracks: TrackArrays
    detected: BoolArray
    clutter_sensor: SensorModel
    seen_extent: ClutterExtent
    sensor_position: FloatArray
    detection_probability: Callable[[FloatArray], FloatArray]
    detection_probability_in_use: float
    process_noise: float
    most_pairs: float
    picture: Picture
    begun: IntArray | None = None
    errors: RangeErrors | None = None
    amplitudes: ScanAmplitudes | None = None
    predictive: DensityDoubt | None = None

    @property
    def median_interval(self) -> float:
        """Median of the last intervals of the sensor, s; 0 while it is unknown."""
        return self.picture.own

    def expired(self, first_scan: IntArray, window: int) -> BoolArray:
        """Whether hypotheses (n,) that began with these scans are a window of scans old."""
        if self.begun is None:
            return np.asarray(self.scan_index + 1 - first_scan >= window)
        return ~np.isin(first_scan, self.begun)
