"""The tracker: scans in, newly confirmed tracks out, by a method of choice.

For each scan: measure its detections, in the coverage and in the fixed frame; associate them with
the confirmed tracks, which are updated; learn the clutter from the rest; let the method split,
evaluate, prune and merge its hypotheses; hold the tracks that it confirms.
"""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray, TimeLimit, changed, taken
from tsepm_ros.tracker import motion, range_rates
from tsepm_ros.tracker.clustering import chosen
from tsepm_ros.tracker.clutter.land import LandMask, afloat
from tsepm_ros.tracker.clutter.learned import Learned
from tsepm_ros.tracker.clutter.scan_clutter import ScanClutter
from tsepm_ros.tracker.clutter.secondary_echoes import HeldTargets
from tsepm_ros.tracker.maintenance import ipda
from tsepm_ros.tracker.maintenance.features import Environment
from tsepm_ros.tracker.maintenance.gated_detections import GATE_PROBABILITY, HeldAssociation
from tsepm_ros.tracker.maintenance.shape import Hulls, further_plots
from tsepm_ros.tracker.maintenance.stationary import SpeedPrior
from tsepm_ros.tracker.maintenance.track_maintenance import TrackMaintenance
from tsepm_ros.tracker.measurement import LEAST_ACROSS, convert, measured_polar
from tsepm_ros.tracker.method import Method, Observation, ScanStatistics, Step
from tsepm_ros.tracker.plot_extraction import PlotExtraction
from tsepm_ros.tracker.recent_hits import RecentHits
from tsepm_ros.tracker.scan import Scan, check_scan
from tsepm_ros.tracker.sensor import (
    EchoPoses,
    PosesByRange,
    SensorModel,
    View,
    echo_poses_of,
    inside,
    looked_at,
)
from tsepm_ros.tracker.tracks import ConfirmedTrack, TrackArrays

NEW_TRACK_EXISTENCE = 0.99
"""Probability that a confirmed track's target exists, where the method estimates none: a choice."""
TRACK_IDS = 2**32
"""Number of track ids: they start again from 0, since messages have 32 bits for them."""
WHOLE_SHARE = 0.75
"""Share of the sector from which on a scan looked at the whole coverage."""
REACH_SCANS = 16
"""Scans within which the detections of one target count as near each other."""


@dataclass(frozen=True, eq=False)
class UsableDetections:
    """The detections of a scan that are used.

    Attributes
    ----------
    scan : Scan
        Of these alone.
    rows : (n,) ndarray of int
        Their rows of the whole scan.
    outside_coverage, on_land : int
        Number of the detections that are not used, because they are outside the coverage, and in
        the coverage on land.
    """

    scan: Scan
    rows: IntArray
    outside_coverage: int
    on_land: int

    @classmethod
    def of(cls, scan: Scan, sensor: SensorModel, land: LandMask | None) -> UsableDetections:
        """Those of a scan of a sensor."""
        used = inside(scan, sensor)
        in_coverage = int(np.count_nonzero(used))
        if land is not None:
            used &= afloat(scan, land)
        rows = np.flatnonzero(used)
        part = scan if len(rows) == len(scan) else chosen(scan, rows)
        return cls(part, rows, len(scan) - in_coverage, in_coverage - len(rows))


class Tracker:
    """Observes scans, lets a method confirm tracks, and maintains these.

    Parameters
    ----------
    method : Method

    Attributes
    ----------
    method : Method
    sensor : SensorModel
        As given.
    common : CommonOptions
        Options that all methods share.
    options : Options
        The method's own.
    maintenance : TrackMaintenance
        The confirmed tracks, carried to the last scan's stamp.
    learned : Learned
        Models of the surroundings, learned from the scans so far.
    plots : PlotExtraction
        Makes plots of the detections.
    land : LandMask or None
        Land of the fixed frame: detections on it are left out. It stays through resets.
    revised : TrackArrays
        Held tracks whose starts the last scan corrected, as they are now: each with the hits that
        are its own after all, and its number of revisions.
    statistics, totals : ScanStatistics
        Counts of the last scan, and sums since the start or the last reset.
    stamp : float or None
        Stamp of the last scan, s.
    scan_index : int
        Number of the last scan, from 0; -1 before the first.
    next_track_id : int
        Id of the next confirmed track; goes on through resets.
    max_scan_time : float
        Time that a scan may take, s, as a last resort behind the limits on counts; infinite, so
        that results are reproducible, unless set.
    """

    def __init__(self, method: Method) -> None:
        self.max_scan_time = math.inf
        self.next_track_id = 0
        self.land: LandMask | None = None
        self.maintenance = TrackMaintenance()
        self._use(method)
        self.reset()

    def __repr__(self) -> str:
        return (
            f"Tracker({type(self.method).__name__}, {self.totals.scans} scans, "
            f"{self.totals.confirmed} tracks confirmed, {len(self.current)} held)"
        )

    def reset(self) -> None:
        """Forget everything but the next track id, none is used twice, and the land."""
        self.stamp: float | None = None
        self.scan_index = -1
        self.statistics = self.totals = ScanStatistics()
        self.revised = TrackArrays.of([])
        self.learned = Learned.initial(self.sensor)
        self.plots = PlotExtraction(self.sensor, self.common)
        self._hulls = Hulls()
        self._hits = RecentHits()
        self._judged: tuple[Scan, UsableDetections] | None = None
        self._poses: EchoPoses = PosesByRange(np.zeros(1), np.zeros((1, 3)))
        self._scan = Scan(0.0, np.zeros(0), np.zeros(0))
        self._clutter = self._clutter_at(np.zeros(0), np.zeros(0))
        self.forget_potential_tracks()
        self.maintenance.clear()

    def forget_potential_tracks(self) -> None:
        """Forget the potential tracks, but not the tracks held, what was learned, nor counts."""
        self._observed: Observation | None = None
        self._recent: list[Scan] = []
        self.method.forget()

    def with_settings(self, method: Method) -> tuple[Tracker, bool]:
        """The tracker as it goes on by another method, or other options, from the next scan.

        Tracks, ids, counts and what was learned and still holds stay. This one does not change,
        and is not to be used after the other has taken a scan.

        Parameters
        ----------
        method : Method
            Fresh; only its kind, sensor and options count where it is of the kind in use.

        Returns
        -------
        tracker : Tracker
        kept : bool
            Whether the potential tracks were kept: not by another method.
        """
        other, kept = copy.copy(self), type(method) is type(self.method)
        if kept:
            same_kind = copy.copy(self.method)
            kept = same_kind.configure(method.sensor, method.common, method.options)
            method = same_kind
        other.learned = self.learned.under(method.sensor, self.sensor)
        other.plots = self.plots.under(method.sensor, method.common)
        other.maintenance = copy.copy(self.maintenance)
        other._judged = None
        other._use(method)
        if not kept:
            other._observed = None
        return other, kept

    def _use(self, method: Method) -> None:
        """Take a method with its sensor and options."""
        self.method, self.sensor, self.options = method, method.sensor, method.options
        self.common = common = method.common
        self.maintenance.hold_time = common.hold_time
        self.maintenance.tracked_timeout = common.tracked_timeout
        self.maintenance.speed_prior = SpeedPrior(common.min_speed, common.max_speed)
        self.maintenance.target_extent = common.target_extent

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
        limit, ids = TimeLimit(self.max_scan_time), []
        again = self._scans_to_repeat(scan)  # with plots from now on; as a rule none
        for one in (*again, scan):
            observed = self.observe(one, limit)  # measure, associate, learn
            room = ipda.room_for(limit, len(self.maintenance.held))
            step = self.method.step(observed)  # split, evaluate, prune, merge, confirm
            new, counts = self._hold(observed, step, room)
            ids.append(new.track_id)
            if one is not scan:
                self.maintenance.keep_ended()
        if again:
            new = self.maintenance.current
            new = new.where(np.isin(new.track_id, np.concatenate(ids)))
            counts = changed(counts, confirmed=len(new))
        used = self._usable(scan)
        self.statistics = changed(
            counts,
            detections=len(used.rows),
            plots=counts.detections,
            outside_coverage=used.outside_coverage,
            on_land=used.on_land,
        )
        self.totals = self.totals + self.statistics
        return new

    def _scans_to_repeat(self, scan: Scan) -> list[Scan]:
        """Learn from the next scan how closely its detections lie together.

        Where that shows that targets have several, the scans before it are observed again, with
        plots: what was learned from them is forgotten, and held tracks that are one target's become
        one. These scans are returned, oldest first.

        Raises
        ------
        ValueError
            As `process` does. Nothing has changed then.
        """
        check_scan(scan, self.stamp, self.common.max_detections)
        window = self.options.window
        recent, self._recent = self._recent, [*self._recent, scan][-window:]
        if self.common.plots == "off":
            return []
        seen, held = self.learned.clutter_map.seen, self.maintenance.held
        if not self.plots.learn(self._usable(scan).scan, seen, held, self._stays):
            return []
        again = recent[max(len(recent) - window + 1, 0) :]
        for one in [*again, scan]:
            self.plots.observe(self._usable(one).scan)
        before = recent[: len(recent) - len(again)]
        self.stamp = before[-1].stamp if before else None
        self.scan_index -= len(again)
        self._hits = RecentHits()
        self.learned = self.learned.anew(self.sensor)
        self.maintenance.merge(self.plots.extent, self._poses.middle[:2])
        if again:
            self.method.forget()
        return again

    def observe(self, scan: Scan, time_limit: TimeLimit) -> Observation:
        """Measure a scan, associate its detections with the held tracks, and learn from it.

        The held tracks take their detections at the density that was known before.
        """
        interval = self._count_in(scan)
        detections = self._detections(scan)
        strengths = self._clutter.judge_strengths(detections, self.scan_index, self.options.window)
        in_zone, environment = self._zones(detections)
        clutter_sensor, of_rates = self._clutter_rates(detections)
        before = self._clutter.before(self._held_targets) * of_rates
        held_density, held_association = self._carry_held(scan, detections, before, environment)
        self._learn_from_held(detections, held_density < before)
        detections["clutter_density"] = self._learn_clutter(before, held_density)
        self._clutter.learn_strengths(detections, self._reach)
        self._hits.append(self.scan_index, detections, self.options.window)
        return Observation(
            stamp=scan.stamp,
            scan_index=self.scan_index,
            interval=interval,
            median_interval=self.learned.scan_interval.median,
            detections=detections,
            clutter_density_before=before,
            clutter_density=detections["clutter_density"] * of_rates,
            held_density=held_density,
            held_association=held_association,
            held=self.maintenance.held.tracks,
            probable_detections=self.maintenance.probable_detections,
            in_clutter_zone=in_zone,
            clutter_sensor=clutter_sensor,
            seen_extent=self.learned.clutter_map.seen.extent,
            sensor_position=self._poses.middle[:2],
            detection_probability=self.detection_probability_at,
            detection_probability_in_use=self.detection_probability,
            time_limit=time_limit,
            strengths=strengths,
            predictive=self._clutter.predictive,
        )

    def _count_in(self, scan: Scan) -> float:
        """Count a scan in; returns the time since the one before, s."""
        interval = 0.0 if self.stamp is None else scan.stamp - self.stamp
        self.learned.scan_interval.update(interval)
        self.stamp = scan.stamp
        self.scan_index += 1
        self._poses = echo_poses_of(scan) or self._poses
        self._scan = scan
        return interval

    def _zones(self, detections: NDArray[np.void]) -> tuple[BoolArray, Environment | None]:
        """Which detections (d,) are in a clutter zone, and where features count, if they do."""
        if not self.common.plot_features:
            return np.zeros(len(detections), bool), None
        in_zone = self._clutter.in_zone
        return in_zone, self.learned.features.at(in_zone, self.common.encounter_time)

    def _clutter_rates(self, detections: NDArray[np.void]) -> tuple[SensorModel, FloatArray]:
        """The sensor with its clutter's range rates, and the density of the detections' own."""
        self.learned.clutter_range_rates.update(detections)
        sensor = self.sensor
        if self.common.clutter_density == "estimated":
            sensor = self.learned.clutter_range_rates.estimate(sensor)
        return sensor, range_rates.clutter_density(detections, sensor)

    def _carry_held(
        self,
        scan: Scan,
        detections: NDArray[np.void],
        clutter: FloatArray,
        environment: Environment | None,
    ) -> tuple[FloatArray, HeldAssociation]:
        """Carry the held tracks to a scan; returns the density of their detections (d,), and whose.

        With plots, a target may have others beside its own.
        """
        width = self.sensor.sector_width
        share = 1.0 if scan.swept is None else min(max(scan.swept[1] / width, 1e-3), 1.0)
        density = self.maintenance.step(
            scan.stamp,
            detections,
            clutter,
            self.detection_probability_at,
            self.sensor_in_use,
            self.common.max_speed,
            self.learned.scan_interval.median / share,
            environment,
            whole=share > WHOLE_SHARE,
        )
        association = self.maintenance.held_association
        if self.plots.active:
            position, origin = detections["position"], self._poses.middle[:2]
            further = further_plots(self.maintenance.held, position, self.plots.extent, origin)
            density = density + further
            association = association.joined(further, clutter)
        return density, association

    def _learn_from_held(self, detections: NDArray[np.void], is_clutter: BoolArray) -> None:
        """Learn from the held tracks' detections: how many there are, their errors and features."""
        learned = self.learned
        learned.detection_probability.update(*self.maintenance.covered, GATE_PROBABILITY)
        if not self.plots.active:
            self._learn_errors(detections)
        if self.common.plot_features:
            learned.features.observe(
                self.scan_index, detections["index"], detections["features"], is_clutter
            )

    def _learn_errors(self, detections: NDArray[np.void]) -> None:
        """Learn the sensor's errors from held tracks' detections, if these have its errors."""
        track_id, row = self.maintenance.own_detections
        rows = np.isnan(detections["range_std"][row])
        own = taken(detections, row[rows])
        variance = self.sensor.range_variance(measured_polar(own)[0])
        held = self.maintenance.held
        ids, moves = held.tracks.track_id, held.fits.moves
        self.learned.errors.update(track_id[rows], own, variance, ids, moves)

    def _learn_clutter(self, clutter: FloatArray, held: FloatArray) -> FloatArray:
        """Learn from what is probably clutter; returns the density at each detection, (d,)."""
        weight = (
            clutter / (clutter + held) if self.method.most_tracks_true else np.ones(len(clutter))
        )
        # In an area within the reach of one target while a hypothesis of it lives.
        reach = self._reach * REACH_SCANS
        area = math.pi * reach**2
        targets, moving = self._held_targets, self.maintenance.detections_of_moving
        return self._clutter.learn(self._scan.stamp, self._view, weight, area, targets, moving)

    def _view(self) -> View:
        """What the scan looked at."""
        return View.of(self._scan, self.sensor, self._poses.middle)

    def _held_targets(self) -> HeldTargets:
        """The held tracks in the sensor's frame."""
        held = self.maintenance.held
        range_, azimuth = self._poses.polar(held.tracks.state[:, 0::2])
        return HeldTargets(held.tracks.track_id, range_, azimuth, held.existence)

    @property
    def _reach(self) -> float:
        """Distance that a target moves at most from scan to scan, m."""
        return self.common.max_speed * self.learned.scan_interval.median

    def _usable(self, scan: Scan) -> UsableDetections:
        """The detections in the coverage and not on land; of one scan they are chosen once."""
        if self._judged is None or self._judged[0] is not scan:
            self._judged = scan, UsableDetections.of(scan, self.sensor, self.land)
        return self._judged[1]

    def _detections(self, scan: Scan) -> NDArray[np.void]:
        """The detections in the coverage in the fixed frame, or their plots."""
        usable = self._usable(scan)
        found, rows = usable.scan, usable.rows
        if usable.outside_coverage:
            self.learned.all_extent.update(scan.range, scan.azimuth, np.ones(len(scan)))
        made = self.plots.plots_of(found, self._joined if self.plots.hulls else None)
        measured = found if made is None else made.scan
        as_stated = found.azimuth_std is not None or not self.method.most_tracks_true
        own = np.zeros(len(measured), bool) if made is None else made.own_range_std
        least = np.where(own | as_stated, 0.0, LEAST_ACROSS)
        detections = convert(measured, self.sensor, self.scan_index, least)
        self._clutter = self._clutter_at(measured.range, measured.azimuth, detections)
        detections["index"] = rows if made is None else rows[made.strongest]
        if made is not None and scan.range_std is None:
            detections["range_std"][~made.own_range_std] = np.nan
        return detections

    def _clutter_at(
        self, range: FloatArray, azimuth: FloatArray, detections: NDArray[np.void] | None = None
    ) -> ScanClutter:
        """Clutter at positions (n,); behind targets, where the held tracks are targets."""
        held_are_true = self.method.most_tracks_true
        return ScanClutter(
            self.learned, self.common, self.sensor, held_are_true, range, azimuth, detections
        )

    def _stays(self, scan: Scan) -> BoolArray:
        """Which detections (n,) of a scan are where clutter stays."""
        if not self.learned.persistent.found:
            return np.zeros(len(scan), bool)
        detections = convert(scan, self.sensor, self.scan_index)
        return self._clutter_at(scan.range, scan.azimuth, detections).is_persistent

    def _joined(self, scan: Scan, label: IntArray) -> tuple[IntArray, FloatArray]:
        """The groups of a scan, those of a hull as one; the hulls are learned first."""
        tracks = self.maintenance.held.tracks.predicted(scan.stamp)
        clutter = self._clutter_at(scan.range, scan.azimuth).density()
        around = self._clutter_at(*self._poses.polar(tracks.state[:, 0::2])).known_density()
        extent, std = self.plots.extent, self.sensor.azimuth_std
        self._hulls.learn(scan, label, clutter, tracks, around, extent, std)
        return self._hulls.joined(scan, label, tracks)

    def _waiting(self, tracks: TrackArrays) -> BoolArray:
        """Which newly confirmed tracks (n,) wait until it is clear that they are no older one's."""
        extent, held = self.plots.waiting_extent, self.maintenance.held.tracks
        if extent is None or not len(tracks):
            return np.zeros(len(tracks), bool)
        range_ = np.hypot(*(tracks.state[:, 0::2] - self._poses.middle[:2]).T)
        reach = max(extent.along, float(extent.across_at(range_).max()))
        interval = self.learned.scan_interval.median
        return self._hulls.waiting(tracks, held, reach, interval)

    def detection_probability_at(self, positions: FloatArray) -> FloatArray:
        """Probability that a target at each position (n, 2) is detected in this scan."""
        covered = looked_at(self._scan, self.sensor, self._poses, positions)
        return np.where(covered, self.detection_probability, 0.0)

    def _hold(
        self, observed: Observation, step: Step, room: int
    ) -> tuple[TrackArrays, ScanStatistics]:
        """Hold the tracks that a step confirms, and those of them that are published."""
        self.revised = self.maintenance.revise(self._proper(step.revised), step.replaced)
        step = changed(step, tracks=self._proper(step.tracks))
        confirmed = len(step.tracks)
        existence = step.existence
        if existence is None:
            existence = np.full(confirmed, NEW_TRACK_EXISTENCE)
        step, existence = self._recognised(step, existence)
        waiting = self._waiting(step.tracks)
        if waiting.any():
            step = changed(step, tracks=step.tracks.where(~waiting))
            existence = existence[~waiting]
        cut = max(len(step.tracks) - room, 0)
        if cut:
            best = ipda.best_held(existence, step.tracks.evaluation, room)
            step, existence = changed(step, tracks=step.tracks.where(best)), existence[best]
        new = self._add(step, existence)
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
        ids = self.maintenance.recognised(step.tracks, self.covered_area)
        again = ids >= 0
        if not again.any():
            return step, existence
        found = step.tracks.where(again).numbered(ids[again])
        revised = self.maintenance.revise(found, (), existence[again])
        self.revised = self.revised.joined(revised)
        return changed(step, tracks=step.tracks.where(~again)), existence[~again]

    def _proper(self, tracks: TrackArrays) -> TrackArrays:
        """The tracks with proper covariances and, if so set, a speed of at most `max_speed`."""
        tracks = tracks.proper()  # what follows inverts the covariances
        if self.common.limit_speed == "off" or not len(tracks):
            return tracks
        state, covariance = motion.limited(tracks.state, tracks.covariance, self.common.max_speed)
        if state is tracks.state:
            return tracks
        return changed(tracks, state=state, covariance=covariance).proper()

    def _add(self, step: Step, existence: FloatArray) -> TrackArrays:
        """Hold a method's newly confirmed tracks, and take back what is theirs from the clutter.

        Those that are published at once are returned.
        """
        tracks = step.tracks.numbered(self._take_track_ids(len(step.tracks)))
        if step.target_probability is not None:
            self._clutter.withdraw(step.target_probability)
        if step.target_hits is not None:
            self.learned.strengths.discount(*step.target_hits)
        histories = self.learned.features.histories(tracks) if self.common.plot_features else None
        return self.maintenance.add(tracks, existence, histories, *self._hits.of(tracks))

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

    @property
    def estimated_detection_probability(self) -> float:
        """Detection probability estimated from the held tracks, whether it is used or not."""
        return self.learned.detection_probability.estimate(self.sensor.detection_probability)

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
        return self.learned.clutter_map.mean

    @property
    def covered_area(self) -> float:
        """Area to which that density refers, m^2: the coverage, or where clutter is seen."""
        if self.common.clutter_density == "given":
            return self.sensor.coverage_area
        return self.learned.clutter_map.area

    @property
    def sensor_in_use(self) -> SensorModel:
        """The sensor with the detection probability in use."""
        if self.common.detection_probability == "given":
            return self.sensor
        return self.sensor.with_detection_probability(self.detection_probability)

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


def _confirmed_at(scan_index: int, tracks: TrackArrays) -> TrackArrays:
    """Tracks that were held back, with the scans that it took to confirm them."""
    first = np.array([hits[0][0] for hits in tracks.hits], np.int64)
    return changed(tracks, scan_count=scan_index + 1 - first)
