"""What every track initiation method shares."""

from __future__ import annotations

import copy
import dataclasses
import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.environment import clutter_range_rates
from tsepm_ros.environment.clutter_map import ClutterMap
from tsepm_ros.environment.feature_association import Surroundings
from tsepm_ros.initiation.common_options import CommonOptions
from tsepm_ros.initiation.statistics import ScanStatistics
from tsepm_ros.kinematics.track import ConfirmedTrack, TrackArrays
from tsepm_ros.maintenance.held_tracks import TrackHold
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.numerics.limits import TimeLimit
from tsepm_ros.sensing import range_rates
from tsepm_ros.sensing.conversion import convert
from tsepm_ros.sensing.coverage import PosesByRange, inside
from tsepm_ros.sensing.scan import Scan
from tsepm_ros.sensing.sensor import SensorModel

NEW_TRACK_EXISTENCE = 0.99
"""Probability that a confirmed track's target exists, as the hold begins, at the most: a choice."""
TRACK_IDS = 2**32
"""Track ids count from 0 up to this, then start again: messages hold 32 bits."""


class Initiator(ABC):
    """A track initiation method: scans in, newly confirmed tracks out.

    A method is a subclass with its own `Options` and `process`.

    Parameters
    ----------
    sensor : SensorModel
        The sensor.
    common : CommonOptions
        Options that all methods share.
    options : Options
        The method's own options.

    Attributes
    ----------
    statistics : ScanStatistics
        Counts of the last scan.
    totals : ScanStatistics
        Sums since the start or the last reset.
    next_track_id : int
        Id of the next confirmed track; goes on through resets.
    hold : TrackHold
        The confirmed tracks, carried to the last scan's stamp.
    max_scan_time : float
        Time that a scan may take, s, as a last resort behind the limits on counts; infinite, so
        that results are reproducible, unless set.
    """

    Options: ClassVar[type[Any]]
    """Frozen dataclass of the method's own parameters."""

    operating_points: ClassVar[Mapping[str, Mapping[str, Any]]] = {"default": {}}
    """Options by a short label, from few to many false tracks: what an evaluation sweeps."""

    def __init__(self, sensor: SensorModel, common: CommonOptions, options: Any) -> None:
        self.sensor = sensor
        self.common = common
        self.options = options
        self.next_track_id = 0
        self.max_scan_time = math.inf
        self.hold = TrackHold(common.hold_time, common.tracked_timeout)
        self.reset()

    @abstractmethod
    def process(self, scan: Scan) -> TrackArrays:
        """Take one scan and return the tracks that it newly confirms.

        Parameters
        ----------
        scan : Scan
            The next scan, later than the one before.

        Returns
        -------
        TrackArrays
            Newly confirmed tracks only, their states at the scan's stamp: a sequence of
            `ConfirmedTrack`, or arrays.

        Raises
        ------
        ValueError
            If the stamp is not later than the last one, or the scan has more than
            `max_detections` detections. The scan is then not taken and nothing has changed.
        """

    @abstractmethod
    def potential_tracks(self) -> TrackArrays:
        """Hypotheses with at least two hits that may yet be confirmed, at the last scan's stamp.

        Their `track_id` is their place in the list.
        """

    def reason(self, track: ConfirmedTrack) -> str:
        """Why a track was confirmed, in a sentence, as the method's options are now."""
        return f"{len(track.hits)} hits within {track.scan_count} scans"

    @property
    def estimated_detection_probability(self) -> float:
        """Detection probability as the tracks held tell it, whether it is used or not."""
        return self.hold.detection_probability.estimate(self.sensor.detection_probability)

    @property
    def detection_probability(self) -> float:
        """Detection probability in use: given or estimated."""
        if self.common.detection_probability == "given":
            return self.sensor.detection_probability
        return self.estimated_detection_probability

    @property
    def clutter_density(self) -> float:
        """Clutter density in use, 1/m^2: given, or the mean of the estimate over the coverage."""
        if self.common.clutter_density == "given":
            return self.sensor.clutter_density
        return self._clutter_map.mean

    @property
    def sensor_in_use(self) -> SensorModel:
        """The sensor with the detection probability in use."""
        if self.common.detection_probability == "given":
            return self.sensor
        return dataclasses.replace(self.sensor, detection_probability=self.detection_probability)

    def configure(self, sensor: SensorModel, common: CommonOptions, options: Any) -> bool:
        """Change the options before the next scan; where that raises, nothing has changed.

        Returns
        -------
        bool
            Whether the potential tracks were kept.
        """
        changed, kept = self.configured(sensor, common, options)
        vars(self).update(vars(changed))
        self.hold.hold_time = common.hold_time
        self.hold.tracked_timeout = common.tracked_timeout
        return kept

    def configured(
        self, sensor: SensorModel, common: CommonOptions, options: Any
    ) -> tuple[Self, bool]:
        """What `configure` makes of it, and what it returns; this one stays as it is."""
        changed = copy.copy(self)
        return changed, changed._configure(sensor, common, options)

    def _configure(self, sensor: SensorModel, common: CommonOptions, options: Any) -> bool:
        """Change the options; returns whether the potential tracks are kept.

        A method that cannot continue them under the new options overrides this and starts over. It
        replaces what it holds, and changes none of it: another initiator may hold it, too.
        """
        if sensor != self.sensor:
            self._clutter_map = ClutterMap(sensor)
        self.sensor = sensor
        self.common = common
        self.options = options
        return True

    def reset(self) -> None:
        """Forget everything but the next track id: none is used twice."""
        self.stamp: float | None = None
        self.scan_index = -1
        self.statistics = ScanStatistics()
        self.totals = ScanStatistics()
        self._poses = PosesByRange(np.zeros(1), np.zeros((1, 3)))
        self._polar = np.zeros(0), np.zeros(0)
        self._outside_coverage = 0
        self._explained = np.zeros(0)
        self._clutter_map = ClutterMap(self.sensor)
        self._clutter_rates = clutter_range_rates.ClutterRates()
        self._clutter_share = np.zeros(0)
        self._surroundings = Surroundings()
        self._in_zone = np.zeros(0, bool)
        self._time = TimeLimit()
        self.forget_potential_tracks()
        self.hold.clear()

    @abstractmethod
    def forget_potential_tracks(self) -> None:
        """Forget the scans so far and the potential tracks, but not the tracks held nor counts."""

    def _receive(self, scan: Scan) -> NDArray[np.void]:
        """Count a scan in and convert its detections in the coverage (Step 1)."""
        if self.stamp is not None and scan.stamp <= self.stamp:
            raise ValueError(
                f"stamp must be later than the last scan's; got {scan.stamp!r} after {self.stamp!r}"
            )
        if len(scan) > self.common.max_detections:
            raise ValueError(
                f"range has {len(scan)} detections, more than max_detections = "
                f"{self.common.max_detections}"
            )
        self._time = TimeLimit(self.max_scan_time)
        self.stamp = scan.stamp
        self.scan_index += 1
        self._poses = PosesByRange.of(scan) or self._poses
        covered = inside(scan, self.sensor)
        self._outside_coverage = len(scan) - int(np.count_nonzero(covered))
        detections = convert(scan, self.sensor, self.scan_index)[covered]
        self._polar = scan.range[covered], scan.azimuth[covered]
        environment = None
        if self.common.plot_features:
            self._in_zone = self._clutter_map.in_zone(*self._polar)
            environment = self._surroundings.at(self._in_zone, self.common.encounter_time)
        self._clutter_rates.update(detections)
        clutter = self._clutter_density(detections)
        self._explained = self.hold.step(
            scan.stamp,
            detections,
            clutter,
            self._detectable,
            self.sensor_in_use,
            self.common.max_speed,
            environment,
        )
        if self.common.plot_features:
            self._surroundings.observe(
                self.scan_index,
                detections["index"],
                detections["features"],
                self._explained < clutter,
            )
        self._clutter_share = self._probably_clutter(clutter)
        self._clutter_map.update(*self._polar, self._clutter_share)
        detections["clutter_density"] = self._local_density(len(detections))
        return detections

    def _detectable(self, positions: FloatArray) -> FloatArray:
        """Probability that a target at each position (n, 2) is detected in this scan."""
        covered = self.sensor.covers(*self._poses.polar(positions))
        return np.where(covered, self.detection_probability, 0.0)

    def _clutter_density(self, detections: NDArray[np.void]) -> FloatArray:
        """Clutter density at each detection, 1/m^2; times that of its range rate, s/m."""
        rates = range_rates.clutter_density(detections, self._sensor_of_clutter)
        return self._local_density(len(detections)) * rates

    @property
    def _sensor_of_clutter(self) -> SensorModel:
        """The sensor, with the range rates of its clutter as given or estimated."""
        if self.common.clutter_density == "given":
            return self.sensor
        return self._clutter_rates.estimate(self.sensor)

    def _probably_clutter(self, clutter: FloatArray) -> FloatArray:
        """Weight of each detection in the clutter map, where the density was as given, (n,).

        All count, a held target's too: where tracks are false, not counting what they explain would
        make the density too low, and that more tracks false.
        """
        return np.ones(len(clutter))

    def _local_density(self, number: int) -> FloatArray:
        """Clutter density where each of the scan's detections is, (number,), 1/m^2."""
        if self.common.clutter_density == "given":
            return np.full(number, self.sensor.clutter_density)
        return self._clutter_map.at(*self._polar)

    def _existence(self, tracks: TrackArrays) -> FloatArray:
        """Probability that the target of each newly confirmed track exists, (n,)."""
        return np.full(len(tracks), NEW_TRACK_EXISTENCE)

    @property
    def _now(self) -> float:
        """Stamp of the scan at hand, s."""
        assert self.stamp is not None
        return self.stamp

    def _take_track_ids(self, number: int) -> NDArray[np.int64]:
        """The next ids, (number,); passing over those in use, which a tracker may have given."""
        in_use = self.hold.current.track_id
        following = (self.next_track_id + np.arange(number + len(in_use))) % TRACK_IDS
        taken = following[~np.isin(following, in_use)][:number]
        if number:
            self.next_track_id = int(taken[-1] + 1) % TRACK_IDS
        return taken

    def _deliver(self, tracks: TrackArrays, statistics: ScanStatistics) -> TrackArrays:
        """Hold the newly confirmed tracks and count the scan; returns the tracks."""
        histories = self._surroundings.histories(tracks) if self.common.plot_features else None
        self.hold.add(tracks, self._existence(tracks), histories)
        self.statistics = dataclasses.replace(statistics, outside_coverage=self._outside_coverage)
        self.totals = self.totals + self.statistics
        return tracks
