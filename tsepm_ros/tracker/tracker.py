"""The initiator: scans in, newly confirmed tracks out, by a method of choice."""

from __future__ import annotations

import copy
import math
from typing import Any

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray, IntArray, TimeLimit, changed
from tsepm_ros.tracker import motion
from tsepm_ros.tracker.clutter.land import LandMask
from tsepm_ros.tracker.clutter.learned import Learned
from tsepm_ros.tracker.front_end import FrontEnd
from tsepm_ros.tracker.maintenance import ipda
from tsepm_ros.tracker.maintenance.stationary import SpeedPrior
from tsepm_ros.tracker.maintenance.track_maintenance import TrackMaintenance
from tsepm_ros.tracker.method import Method, Observation, ScanStatistics, Step
from tsepm_ros.tracker.options import CommonOptions
from tsepm_ros.tracker.plot_extraction import PlotExtraction
from tsepm_ros.tracker.scan import Scan
from tsepm_ros.tracker.sensor import SensorModel
from tsepm_ros.tracker.tracks import ConfirmedTrack, TrackArrays

NEW_TRACK_EXISTENCE = 0.99
"""Probability that a confirmed track's target exists, where the method estimates none: a choice."""
TRACK_IDS = 2**32
"""Number of track ids: they start again from 0, since messages have 32 bits for them."""


class Initiator:
    """Observes scans, lets a method confirm tracks, and maintains these.

    Parameters
    ----------
    method : Method

    Attributes
    ----------
    method : Method
        With the sensor and all options.
    revised : TrackArrays
        Held tracks whose starts the last scan corrected, as they are now: each with the hits that
        are its own after all, and its number of revisions.
    statistics : ScanStatistics
        Counts of the last scan.
    totals : ScanStatistics
        Sums since the start or the last reset.
    next_track_id : int
        Id of the next confirmed track; goes on through resets.
    maintenance : TrackMaintenance
        The confirmed tracks, carried to the last scan's stamp.
    max_scan_time : float
        Time that a scan may take, s, as a last resort behind the limits on counts; infinite, so
        that results are reproducible, unless set.
    """

    def __init__(self, method: Method) -> None:
        self.method = method
        self.statistics = self.totals = ScanStatistics()
        self.next_track_id = 0
        self.revised = TrackArrays.of([])
        self._observed: Observation | None = None
        self.max_scan_time = math.inf
        self.maintenance = TrackMaintenance()
        self._set_maintenance(method.common)
        self.front_end = FrontEnd(
            method.sensor, method.common, self.maintenance, method.most_tracks_true
        )
        self.reset()

    def __repr__(self) -> str:
        return (
            f"Initiator({type(self.method).__name__}, {self.totals.scans} scans, "
            f"{self.totals.confirmed} tracks confirmed, {len(self.current)} held)"
        )

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
            If it is no `Scan`, the stamp is not later than the last one, or the scan has more than
            `max_detections` detections. The scan is then not taken and nothing has changed.
        """
        limit = TimeLimit(self.max_scan_time)
        again = self.front_end.begin(scan, self.method.options.window)
        if not again:
            new, statistics = self._read(scan, limit)
        else:
            new, statistics = self._read_again(again, scan, limit)
        self.statistics = changed(
            statistics,
            detections=len(self.front_end.usable.rows),
            plots=statistics.detections,
            outside_coverage=self.front_end.usable.outside_coverage,
            on_land=self.front_end.usable.on_land,
        )
        self.totals = self.totals + self.statistics
        return new

    def _read(self, scan: Scan, limit: TimeLimit) -> tuple[TrackArrays, ScanStatistics]:
        """Observe a scan, let the method step on it, and hold the new tracks, with their ids."""
        observed = self.front_end.observe(scan, limit)
        room = ipda.room_for(limit, len(self.maintenance.held))
        step = self.method.step(observed)
        revised = self._usable(step.revised)
        self.revised = self.maintenance.revise(revised, step.replaced)
        tracks = self._usable(step.tracks)
        step = changed(step, tracks=tracks)
        confirmed = len(tracks)
        existence = step.existence
        if existence is None:
            existence = np.full(confirmed, NEW_TRACK_EXISTENCE)
        step, existence = self._recognised(step, existence)
        waiting = self.front_end.waiting(step.tracks)
        if waiting.any():
            step = changed(step, tracks=step.tracks.where(~waiting))
            existence = existence[~waiting]
        cut = max(len(step.tracks) - room, 0)
        if cut:
            best = ipda.best_held(existence, step.tracks.evaluation, room)
            step, existence = changed(step, tracks=step.tracks.where(best)), existence[best]
        ids = self._take_track_ids(len(step.tracks))
        new = self.front_end.finish(step, existence, ids)
        if len(self.maintenance.released):
            new = _confirmed_at(observed.scan_index, self.maintenance.released).joined(new)
        self._observed = observed
        withheld = confirmed - len(new)
        return new, changed(
            step.statistics,
            confirmed=step.statistics.confirmed - withheld,
            cut_confirmations=step.statistics.cut_confirmations + cut,
        )

    def _recognised(self, step: Step, existence: FloatArray) -> tuple[Step, FloatArray]:
        """The step without the starts that are of held tracks, which go on from them."""
        if not self.method.most_tracks_true:
            return step, existence
        ids = self.maintenance.recognised(step.tracks, self.front_end.covered_area)
        again = ids >= 0
        if not again.any():
            return step, existence
        found = step.tracks.where(again).numbered(ids[again])
        revised = self.maintenance.revise(found, (), existence[again])
        self.revised = self.revised.joined(revised)
        return changed(step, tracks=step.tracks.where(~again)), existence[~again]

    def _usable(self, tracks: TrackArrays) -> TrackArrays:
        """The tracks with proper covariances and, if so set, a speed of at most `max_speed`."""
        tracks = tracks.proper()  # what follows inverts the covariances
        if not self.common.limit_speed or not len(tracks):
            return tracks
        state, covariance = motion.limited(tracks.state, tracks.covariance, self.common.max_speed)
        if state is tracks.state:
            return tracks
        return changed(tracks, state=state, covariance=covariance).proper()

    def _read_again(
        self, again: list[Scan], scan: Scan, limit: TimeLimit
    ) -> tuple[TrackArrays, ScanStatistics]:
        """Start over with scans that were read before; new tracks are those held in the end."""
        self.method.forget()
        ids = []
        for one in again:
            ids.append(self._read(one, limit)[0].track_id)
            self.maintenance.keep_ended()
        new, statistics = self._read(scan, limit)
        current = self.maintenance.current
        new = current.where(np.isin(current.track_id, np.concatenate([*ids, new.track_id])))
        return new, changed(statistics, confirmed=len(new))

    def _take_track_ids(self, number: int) -> IntArray:
        """The next ids, (number,); passing over those in use, which a tracker may have given."""
        if not number:
            return np.zeros(0, np.int64)
        in_use = self.maintenance.held.tracks.track_id
        following = (self.next_track_id + np.arange(number + len(in_use))) % TRACK_IDS
        taken = following[~np.isin(following, in_use)][:number]
        self.next_track_id = int(taken[-1] + 1) % TRACK_IDS
        return taken

    @property
    def current(self) -> TrackArrays:
        """Every published track held, at the last scan's stamp."""
        return self.maintenance.current.proper()

    @property
    def fixed_echoes(self) -> TrackArrays:
        """Fixed echoes, with `min_speed`: their places, and the time `since` when."""
        return self.maintenance.fixed_echoes.proper()

    def potential_tracks(self) -> TrackArrays:
        """Hypotheses with at least two hits that may yet be confirmed, at the last scan's stamp.

        Their `track_id` is their place in the list.
        """
        if self._observed is None:
            return TrackArrays.of([])
        return self.method.potential_tracks(self._observed).proper()

    def reason(self, track: ConfirmedTrack) -> str:
        """Why a track was confirmed, in a sentence, as the method's options are now."""
        return self.method.reason(track)

    def reset(self) -> None:
        """Forget everything but the next track id: none is used twice."""
        self.statistics = ScanStatistics()
        self.totals = ScanStatistics()
        self.revised = TrackArrays.of([])
        self.front_end.reset()
        self.forget_potential_tracks()
        self.maintenance.clear()

    def forget_potential_tracks(self) -> None:
        """Forget the potential tracks, but not the tracks held, what was learned, nor counts."""
        self._observed = None
        self.front_end.forget_recent()
        self.method.forget()

    def configure(self, method: Method) -> bool:
        """Take another method, or other options, before the next scan.

        Where that raises, nothing has changed. The tracks held, the ids, the counts and what has
        been learned stay.

        Parameters
        ----------
        method : Method
            Fresh; only its kind, sensor and options count where it is of the kind in use.

        Returns
        -------
        bool
            Whether the potential tracks were kept: not by another method.
        """
        self.method, self.front_end, kept = self._configured(method)
        self._set_maintenance(method.common)
        if not kept:
            self._observed = None
        return kept

    def _set_maintenance(self, common: CommonOptions) -> None:
        self.maintenance.hold_time = common.hold_time
        self.maintenance.tracked_timeout = common.tracked_timeout
        self.maintenance.speed_prior = SpeedPrior(common.min_speed, common.max_speed)
        self.maintenance.target_extent = common.target_extent

    def rehearse(self, method: Method) -> None:
        """Raise what `configure` would; nothing changes."""
        self._configured(method)

    def _configured(self, method: Method) -> tuple[Method, FrontEnd, bool]:
        """The method and the front end that `configure` takes, and what it returns."""
        sensor, common = method.sensor, method.common
        front_end = copy.copy(self.front_end)
        front_end.configure(sensor, common, method.most_tracks_true)
        if type(method) is not type(self.method):
            return method, front_end, False
        same_kind = copy.copy(self.method)
        return same_kind, front_end, same_kind.configure(sensor, common, method.options)

    @property
    def sensor(self) -> SensorModel:
        """The sensor as given."""
        return self.method.sensor

    @property
    def common(self) -> CommonOptions:
        """Options that all methods share."""
        return self.method.common

    @property
    def options(self) -> Any:
        """The method's own options."""
        return self.method.options

    @property
    def stamp(self) -> float | None:
        """Stamp of the last scan, s."""
        return self.front_end.stamp

    @property
    def scan_index(self) -> int:
        """Number of the last scan, from 0; -1 before the first."""
        return self.front_end.scan_index

    @property
    def learned(self) -> Learned:
        """Models of the surroundings, learned from the scans so far."""
        return self.front_end.learned

    def remember(self, learned: Learned) -> None:
        """Begin with what was learned before, such as before a restart."""
        self.front_end.learned = learned

    @property
    def land(self) -> LandMask | None:
        """Land of the fixed frame: detections on it are left out, from the next scan on."""
        return self.front_end.land

    @land.setter
    def land(self, land: LandMask | None) -> None:
        self.front_end.land = land

    @property
    def plots(self) -> PlotExtraction:
        """What makes plots of the detections."""
        return self.front_end.plots

    @property
    def detection_probability(self) -> float:
        """Detection probability in use: given or estimated."""
        return self.front_end.detection_probability

    @property
    def estimated_detection_probability(self) -> float:
        """Detection probability estimated from the held tracks, whether it is used or not."""
        return self.front_end.estimated_detection_probability

    @property
    def clutter_density(self) -> float:
        """Clutter density in use, 1/m^2: given, or the mean of the estimate over the coverage."""
        return self.front_end.clutter_density

    @property
    def uses_intensity(self) -> bool:
        """Whether the strengths of the last scan counted."""
        return self.intensity.startswith("used")

    @property
    def intensity(self) -> str:
        """Whether the strengths of the last scan counted, and why not, in words."""
        if self.common.intensity == "off" or not self.method.most_tracks_true:
            return "not used: off" if self.common.intensity == "off" else "not used by the method"
        return self.learned.strengths.use

    @property
    def covered_area(self) -> float:
        """Area to which that density refers, m^2: the coverage, or where clutter is seen."""
        return self.front_end.covered_area

    @property
    def sensor_in_use(self) -> SensorModel:
        """The sensor with the detection probability in use."""
        return self.front_end.sensor_in_use


def _confirmed_at(scan_index: int, tracks: TrackArrays) -> TrackArrays:
    """Tracks that were held back, with the scans that it took to confirm them."""
    first = np.array([hits[0][0] for hits in tracks.hits], np.int64)
    return changed(tracks, scan_count=scan_index + 1 - first)
