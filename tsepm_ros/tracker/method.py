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
"""A method: an observed scan in, tracks and counts out."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.numerics.arrays import FloatArray, IntArray, replaced
from tsepm_ros.tracker.maintenance.track_maintenance import TrackMaintenance
from tsepm_ros.tracker.observation import Observation
from tsepm_ros.tracker.options import CommonOptions
from tsepm_ros.tracker.sensor import SensorModel
from tsepm_ros.tracker.tracks import NEW_TRACK_EXISTENCE, NO_TRACKS, ConfirmedTrack, TrackArrays


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
        Potential tracks kept after the scan (in a sum: the most kept at once).
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
        Clusters made of the detections in the coverage: fewer where several detections of one
        target became one cluster.
    on_land : int
        Detections in the coverage that are on land; they are not used.
    standing : int
        Detections that stand, and so start no track.
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
    standing: int = 0

    def __add__(self, other: ScanStatistics) -> ScanStatistics:
        """Sum of the counts; of the potential tracks kept the larger."""
        mine, two = vars(self), vars(other)
        values = {name: mine[name] + two[name] for name in mine}
        values["potential_tracks"] = max(self.potential_tracks, other.potential_tracks)
        return replaced(self, **values)


@dataclass(frozen=True)
class MethodResult:
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
    paths : tuple of (h,) ndarray of int
        Hits of the best hypothesis of each new track, as `hit_keys`; none of a method that starts a
        target's track anew.
    """

    tracks: TrackArrays = NO_TRACKS
    statistics: ScanStatistics = field(default_factory=lambda: ScanStatistics(scans=1))
    existence: FloatArray | None = None
    target_probability: FloatArray | None = None
    paths: tuple[IntArray, ...] = ()

    @property
    def existences(self) -> FloatArray:
        """Probability that each new track's target exists, (n,), given or not."""
        if self.existence is None:
            return np.full(len(self.tracks), NEW_TRACK_EXISTENCE)
        return self.existence

    def where(self, rows: NDArray[np.generic]) -> MethodResult:
        """The step with the new tracks in the given rows only (indices or a mask)."""
        existence = None if self.existence is None else self.existence[rows]
        places = np.arange(len(self.paths))
        paths = tuple(self.paths[place] for place in places[rows]) if self.paths else ()
        return replaced(self, tracks=self.tracks.where(rows), existence=existence, paths=paths)


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

    learns_from_confirmed: ClassVar[bool] = False
    """Whether most confirmed tracks are true, so that their detections are a sample of targets'.

    The clutter map then leaves them out, and the detection probability is estimated from them by
    default. To leave out the detections of false tracks would bias the density low and create more
    false tracks.
    """

    several_sensors: ClassVar[bool] = False
    """Whether scans of several sensors may make one picture."""

    sensors: int = 1
    """Number of sensors of the picture."""

    def __init__(self, sensor: SensorModel, common: CommonOptions, options: Any) -> None:
        Method.configure(self, sensor, common, options)
        self.reset()

    def maintain(self, maintenance: TrackMaintenance, *scan: Any, **more: Any) -> FloatArray:
        """Carry the confirmed tracks to a scan, before `step`; see `TrackMaintenance.step`.

        A method that maintains its tracks itself overrides this.
        """
        return maintenance.step(*scan, **more)

    @abstractmethod
    def step(self, observed: Observation) -> MethodResult:
        """Take one observed scan and return the tracks that it newly confirms."""

    @abstractmethod
    def forget(self) -> None:
        """Forget the potential tracks."""

    def reset(self) -> None:
        """Forget the scans so far: the potential tracks, and what was learned of scans."""
        self.forget()

    def potential_tracks(self, observed: Observation) -> TrackArrays:
        """Hypotheses with at least two hits that may yet be confirmed, after the last scan.

        Their `track_id` is their place in the list.
        """
        return TrackArrays.from_tracks([])

    def reason(self, track: ConfirmedTrack) -> str:
        """The reason for which a track was confirmed, with the present options."""
        return f"{len(track.hits)} hits in {track.scan_count} pings"

    def configure(self, sensor: SensorModel, common: CommonOptions, options: Any) -> bool:
        """Change the options; returns whether the potential tracks are kept.

        A method that cannot continue them under the new options overrides this and starts over. It
        replaces its arrays and never changes them in place: a copy may share them.
        """
        self.sensor = sensor
        self.common = common.resolved(self.learns_from_confirmed)
        self.options = options
        return True
