"""A method: an observed scan in, tracks and counts out.

Counts of a scan, and their sums.

A scan as the input of a method, and the method's output.

Base class of the track initiation methods: options, and the step on an observed scan.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray, TimeLimit, changed
from tsepm_ros.tracker.clutter.amplitude_law import ScanAmplitudes
from tsepm_ros.tracker.clutter.density import Extent
from tsepm_ros.tracker.clutter.excess import PredictiveDensity
from tsepm_ros.tracker.measurement import DetectionWindow
from tsepm_ros.tracker.options import CommonOptions
from tsepm_ros.tracker.sensor import SensorModel
from tsepm_ros.tracker.tracks import NO_TRACKS, ConfirmedTrack, TrackArrays

NEW_TRACK_EXISTENCE = 0.99
"""Probability that a confirmed track's target exists, where the method estimates none: a choice."""


@dataclass(frozen=True)
class ScanStatistics:
    """Counts of one scan, or summed over scans.

    Attributes
    ----------
    scans : int
        Scans counted.
    detections : int
        Detections in the sensor's coverage.
    potential_tracks : int
        Potential tracks held after the scan (in a sum: the most held at once).
    started : int
        Potential tracks started.
    split : int
        Potential tracks that the scan's detections made: started, and children of others.
    evaluated : int
        Potential tracks that were evaluated.
    terminated : int
        Potential tracks ended by the method's rule on their scans, or by a hit that is another's.
    raw_confirmations : int
        Tracks that reached confirmation, before pruning and merging.
    pruned : int
        Removed by their evaluation: of these; by `score`, which evaluates all in each scan, of all
        potential tracks.
    merged : int
        Of these, removed by merging into another, or into a confirmed track.
    confirmed : int
        Confirmed tracks that were published.
    cut_potential_tracks, cut_confirmations : int
        Removed because a limit was reached. Potential tracks count once, when they are cut, as does
        a pair of gate and detection that was left out.
    outside_coverage : int
        Detections received outside the coverage; they are not used.
    plots : int
        Plots made of the detections in the coverage: fewer where several detections of one target
        became one plot.
    on_land : int
        Detections in the coverage that are on land; they are not used.
    """

    scans: int = 0
    detections: int = 0
    potential_tracks: int = 0
    started: int = 0
    split: int = 0
    evaluated: int = 0
    terminated: int = 0
    raw_confirmations: int = 0
    pruned: int = 0
    merged: int = 0
    confirmed: int = 0
    cut_potential_tracks: int = 0
    cut_confirmations: int = 0
    outside_coverage: int = 0
    plots: int = 0
    on_land: int = 0

    def __add__(self, other: ScanStatistics) -> ScanStatistics:
        """Sum of the counts; of the potential tracks held the larger."""
        one, two = vars(self), vars(other)
        values = {name: one[name] + two[name] for name in one}
        values["potential_tracks"] = max(self.potential_tracks, other.potential_tracks)
        return changed(self, **values)


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
    window : DetectionWindow
        The detections of the last scans, these included.
    ids : (d,) ndarray of int
        Their ids in the window.
    clutter_density : (d,) ndarray
        Clutter density at each detection after this scan was learned from, 1/m^2, times the
        density of its range rate, s/m, where it has one.
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
    strengths : ScanAmplitudes or None
        What the strengths of the detections say; None where they do not count.
    predictive : PredictiveDensity or None
        What makes the clutter density uncertain; None where it is given.
    """

    stamp: float
    scan_index: int
    interval: float
    median_interval: float
    detections: NDArray[np.void]
    window: DetectionWindow
    ids: IntArray
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
    strengths: ScanAmplitudes | None = None
    predictive: PredictiveDensity | None = None


TargetHits = tuple[IntArray, IntArray, FloatArray]
"""Detections of the last scans that are probably targets', held or not: scan and index there of
each, (k,), and its probability by the positions alone."""


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

    @property
    def existences(self) -> FloatArray:
        """Probability that each new track's target exists, (n,), given or not."""
        if self.existence is None:
            return np.full(len(self.tracks), NEW_TRACK_EXISTENCE)
        return self.existence

    def where(self, rows: NDArray[np.generic]) -> Step:
        """The step with the new tracks in the given rows only (indices or a mask)."""
        existence = None if self.existence is None else self.existence[rows]
        return changed(self, tracks=self.tracks.where(rows), existence=existence)


class Method(ABC):
    """A track initiation method: an observed scan in, newly confirmed tracks out.

    Parameters
    ----------
    sensor : SensorModel
    common : CommonOptions
        Options that all methods share.
    options : Options
        The method's own options.
    """

    Options: ClassVar[type[Any]]
    """Frozen dataclass of the method's own parameters."""

    operating_points: ClassVar[Mapping[str, Mapping[str, Any]]] = {"default": {}}
    """Options by a short label, from few to many false tracks; an evaluation sweeps them."""

    most_tracks_true: ClassVar[bool] = False
    """Whether most confirmed tracks are true, so that their detections are a sample of targets'.

    The clutter map then leaves them out, and the detection probability is estimated from them by
    default. To leave out the detections of false tracks would bias the density low and create more
    false tracks.
    """

    def __init__(self, sensor: SensorModel, common: CommonOptions, options: Any) -> None:
        Method.configure(self, sensor, common, options)
        self.forget()

    @abstractmethod
    def step(self, observed: Observation) -> Step:
        """Take one observed scan and return the tracks that it newly confirms."""

    @abstractmethod
    def forget(self) -> None:
        """Forget the scans so far and the potential tracks."""

    def potential_tracks(self, observed: Observation) -> TrackArrays:
        """Hypotheses with at least two hits that may yet be confirmed, after the last scan.

        Their `track_id` is their place in the list.
        """
        return TrackArrays.of([])

    def reason(self, track: ConfirmedTrack) -> str:
        """The reason for which a track was confirmed, with the present options."""
        return f"{len(track.hits)} hits in {track.scan_count} pings"

    def configure(self, sensor: SensorModel, common: CommonOptions, options: Any) -> bool:
        """Change the options; returns whether the potential tracks are kept.

        A method that cannot continue them under the new options overrides this and starts over. It
        replaces its arrays and never changes them in place: a copy may share them.
        """
        self.sensor = sensor
        self.common = common.resolved(self.most_tracks_true)
        self.options = options
        return True
