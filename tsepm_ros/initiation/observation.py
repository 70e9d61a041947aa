"""A scan as the input of a method, and the method's output."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.environment.clutter_clumps import PredictiveDensity
from tsepm_ros.environment.seen_extent import Extent
from tsepm_ros.environment.target_strength import ScanStrengths
from tsepm_ros.initiation.statistics import ScanStatistics
from tsepm_ros.kinematics.track import NO_TRACKS, TrackArrays
from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from tsepm_ros.numerics.limits import TimeLimit
from tsepm_ros.sensing.sensor import SensorModel


@dataclass(frozen=True)
class Observation:
    """A scan's detections in the coverage, with clutter densities and held association.

    Attributes
    ----------
    stamp : float
        The scan's stamp, s.
    scan_index : int
        Number of the scan since the start or the last reset, from 0.
    interval : float
        Time since the scan before, s; 0 for the first.
    median_interval : float
        Median of the last intervals, s; 0 while it is unknown.
    detections : (d,) ndarray of DETECTION
        Converted to the fixed frame; `clutter_density` is that after learning.
    clutter_density_before, clutter_density : (d,) ndarray
        Clutter density at each detection before and after this scan was learned from, 1/m^2,
        times the density of its range rate, s/m, where it has one.
    held_density : (d,) ndarray
        Density at each detection due to held tracks, to be added to the clutter density.
    held_association : tuple of (p,) ndarray
        Rows of detections that may be a held track's, and the probability of each that the track's
        target exists and caused the detection.
    held : TrackArrays
        The held tracks, with the hits of their starts.
    probable_detections : tuple of (k,) ndarray of int
        Ids of held tracks, and the detection of each that is more probably the track's than not.
    in_clutter_zone : (d,) ndarray of bool
        With `plot_features`; else all False.
    clutter_sensor : SensorModel
        The sensor with the range rates of its clutter as given or learned.
    seen_extent : Extent
        Ranges and sector in which clutter is seen.
    sensor_position : (2,) ndarray
        Where the sensor was, in the fixed frame, m.
    detection_probability : callable
        P_D in this scan of targets at positions (n, 2); 0 outside the coverage.
    detection_probability_in_use : float
        P_D in the coverage, given or estimated.
    time_limit : TimeLimit
        Time that the scan may take.
    strengths : ScanStrengths or None
        What the strengths of the detections say; None where they do not count.
    predictive : PredictiveDensity or None
        What makes the clutter density uncertain; None where it is given.
    """

    stamp: float
    scan_index: int
    interval: float
    median_interval: float
    detections: NDArray[np.void]
    clutter_density_before: FloatArray
    clutter_density: FloatArray
    held_density: FloatArray
    held_association: tuple[IntArray, FloatArray]
    held: TrackArrays
    probable_detections: tuple[IntArray, IntArray]
    in_clutter_zone: BoolArray
    clutter_sensor: SensorModel
    seen_extent: Extent
    sensor_position: FloatArray
    detection_probability: Callable[[FloatArray], FloatArray]
    detection_probability_in_use: float
    time_limit: TimeLimit
    strengths: ScanStrengths | None = None
    predictive: PredictiveDensity | None = None


class TargetHits(NamedTuple):
    """Detections of the last scans that are probably targets', held or not.

    Attributes
    ----------
    scan, detection : (k,) ndarray of int
        Scan of each, and its index there.
    probability : (k,) ndarray
        By the positions alone.
    """

    scan: IntArray
    detection: IntArray
    probability: FloatArray


@dataclass(frozen=True)
class Step:
    """Output of a method for a scan.

    Attributes
    ----------
    tracks : TrackArrays
        Newly confirmed tracks at the scan's stamp; their ids are not set yet.
    statistics : ScanStatistics
    existence : (n,) ndarray, optional
        Probability that each new track's target exists; `NEW_TRACK_EXISTENCE` if not given.
    target_probability : (d,) ndarray, optional
        Probability that each detection is of a target that is not confirmed yet; this part of it
        does not count as clutter.
    revised : TrackArrays
        Held tracks, by their ids, whose starts are corrected.
    replaced : tuple of int
        Ids of held tracks in whose place new ones are held: they end.
    target_hits : TargetHits, optional
        Detections that are probably targets', by their positions alone.
    """

    tracks: TrackArrays = NO_TRACKS
    statistics: ScanStatistics = field(default_factory=lambda: ScanStatistics(scans=1))
    existence: FloatArray | None = None
    target_probability: FloatArray | None = None
    revised: TrackArrays = NO_TRACKS
    replaced: tuple[int, ...] = ()
    target_hits: TargetHits | None = None
