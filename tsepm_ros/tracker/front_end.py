"""Measurement processing before every method.

Which detections of a scan are used: those in the coverage that are not on land.

Before every method: coverage, plots, conversion, clutter, and what held tracks explain.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray, TimeLimit
from tsepm_ros.tracker import learning, range_rates
from tsepm_ros.tracker.clustering import chosen
from tsepm_ros.tracker.clutter.land import LandMask, afloat
from tsepm_ros.tracker.clutter.learned import Learned
from tsepm_ros.tracker.clutter.scan_clutter import ScanClutter
from tsepm_ros.tracker.clutter.secondary_echoes import HeldTargets
from tsepm_ros.tracker.learning import RecentHits
from tsepm_ros.tracker.maintenance.features import Environment
from tsepm_ros.tracker.maintenance.gated_detections import GATE_PROBABILITY, HeldAssociation
from tsepm_ros.tracker.maintenance.shape import Hulls, further_plots
from tsepm_ros.tracker.maintenance.track_maintenance import TrackMaintenance
from tsepm_ros.tracker.measurement import convert
from tsepm_ros.tracker.method import Observation, Step
from tsepm_ros.tracker.options import CommonOptions
from tsepm_ros.tracker.plot_extraction import PlotExtraction
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
from tsepm_ros.tracker.tracks import TrackArrays


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


WHOLE_SHARE = 0.75
"""Share of the sector from which on a scan looked at the whole coverage."""
REACH_SCANS = 16
"""Scans within which the detections of one target count as near each other."""


class FrontEnd:
    """Observes scans, learns from them, and carries the held tracks through them.

    Parameters
    ----------
    sensor : SensorModel
    common : CommonOptions
    maintenance : TrackMaintenance
        The confirmed tracks.
    most_tracks_true : bool
        Whether the clutter map leaves out the detections of held tracks; see `Method`.

    Attributes
    ----------
    stamp : float or None
        Stamp of the last scan, s.
    scan_index : int
        Number of the last scan, from 0; -1 before the first.
    usable : UsableDetections
        Of the last scan.
    land : LandMask or None
        Stays through resets.
    plots : PlotExtraction
        Makes plots of the detections.
    """

    def __init__(
        self,
        sensor: SensorModel,
        common: CommonOptions,
        maintenance: TrackMaintenance,
        most_tracks_true: bool,
    ) -> None:
        self.sensor = sensor
        self.common = common
        self.maintenance = maintenance
        self.most_tracks_true = most_tracks_true
        self.land: LandMask | None = None
        self.reset()

    def reset(self) -> None:
        """Forget the scans so far and what was learned from them."""
        self.stamp: float | None = None
        self.scan_index = -1
        self.plots = PlotExtraction(self.sensor, self.common)
        self._hulls = Hulls()
        self._judged: tuple[Scan, UsableDetections] | None = None
        self._recent: list[Scan] = []
        self._hits, self._window = RecentHits(), 1
        self.learned = Learned.initial(self.sensor)
        self._poses: EchoPoses = PosesByRange(np.zeros(1), np.zeros((1, 3)))
        self._scan = Scan(0.0, np.zeros(0), np.zeros(0))
        self.usable = UsableDetections.of(self._scan, self.sensor, None)
        self._clutter = self._clutter_at(np.zeros(0), np.zeros(0))

    def configure(self, sensor: SensorModel, common: CommonOptions, most_tracks_true: bool) -> None:
        """Change the options before the next scan; what was learned and still holds is kept."""
        self.learned = self.learned.under(sensor, self.sensor)
        self.plots = self.plots.under(sensor, common)
        self.sensor = sensor
        self.common = common
        self.most_tracks_true = most_tracks_true
        self._judged = None

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

    def begin(self, scan: Scan, window: int) -> list[Scan]:
        """Learn from the next scan how closely its detections lie together.

        Where that shows that targets have several, the scans before it are to be observed again,
        with plots: what was learned from them is forgotten, and held tracks that are one target's
        become one.

        Parameters
        ----------
        scan : Scan
            The next to be observed.
        window : int
            Scans to keep, this one included.

        Returns
        -------
        list of Scan
            Those to be observed before it, oldest first; as a rule none.

        Raises
        ------
        ValueError
            As `observe` does. Nothing has changed then.
        """
        check_scan(scan, self.stamp, self.common.max_detections)
        self._window = window
        recent, self._recent = self._recent, [*self._recent, scan][-window:]
        if self.common.plots == "off":
            return []
        seen = self.learned.clutter_map.seen
        held, usable = self.maintenance.held, self._usable(scan).scan
        if not self.plots.learn(usable, seen, held, self._stays):
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
        return again

    def forget_recent(self) -> None:
        """Forget the scans that might be observed again."""
        self._recent = []

    def observe(self, scan: Scan, time_limit: TimeLimit) -> Observation:
        """Count a scan in and convert its detections in the coverage (Step 1).

        The held tracks take their detections at the density that was known before, and then the
        scan is learned from.

        Raises
        ------
        ValueError
            If the stamp is not later than the last one, or the scan has more than
            `max_detections` detections. Nothing has changed then.
        """
        check_scan(scan, self.stamp, self.common.max_detections)
        interval = self._count_in(scan)
        detections = self._detections(scan)
        strengths = learning.judge_strengths(
            self._clutter, detections, self.scan_index, self._window
        )
        in_zone, environment = self._zones(detections)
        clutter_sensor, of_rates = self._clutter_rates(detections)
        before = self._clutter.before(self._held_targets) * of_rates
        held_density, held_association = self._carry_held(scan, detections, before, environment)
        self._learn_from_held(detections, held_density < before)
        detections["clutter_density"] = self._learn_clutter(before, held_density)
        learning.learn_strengths(self._clutter, detections, self._reach)
        self._hits.append(self.scan_index, detections, self._window)
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
        density = self.maintenance.step(
            scan.stamp,
            detections,
            clutter,
            self.detection_probability_at,
            self.sensor_in_use,
            self.common.max_speed,
            self.learned.scan_interval.median,
            environment,
            whole=scan.swept is None or scan.swept[1] > WHOLE_SHARE * self.sensor.sector_width,
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
            learning.learn_errors(learned.errors, self.maintenance, self.sensor, detections)
        if self.common.plot_features:
            learned.features.observe(
                self.scan_index, detections["index"], detections["features"], is_clutter
            )

    def _learn_clutter(self, clutter: FloatArray, held: FloatArray) -> FloatArray:
        """Learn from what is probably clutter; returns the density at each detection, (d,)."""
        weight = clutter / (clutter + held) if self.most_tracks_true else np.ones(len(clutter))
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
        return learning.held_targets(self.maintenance.held, self._poses)

    @property
    def _reach(self) -> float:
        """Distance that a target moves at most from scan to scan, m."""
        return self.common.max_speed * self.learned.scan_interval.median

    def finish(self, step: Step, existence: FloatArray, ids: IntArray) -> TrackArrays:
        """Hold a method's newly confirmed tracks, and take back what is theirs from the clutter.

        Those that are published at once are returned.
        """
        tracks = step.tracks.numbered(ids)
        if step.target_probability is not None:
            self._clutter.withdraw(step.target_probability)
        if step.target_hits is not None:
            self.learned.strengths.discount(*step.target_hits)
        histories = self.learned.features.histories(tracks) if self.common.plot_features else None
        return self.maintenance.add(tracks, existence, histories, *self._hits.of(tracks))

    def _usable(self, scan: Scan) -> UsableDetections:
        """The detections in the coverage and not on land; of one scan they are chosen once."""
        if self._judged is None or self._judged[0] is not scan:
            self._judged = scan, UsableDetections.of(scan, self.sensor, self.land)
        return self._judged[1]

    def _detections(self, scan: Scan) -> NDArray[np.void]:
        """The detections in the coverage in the fixed frame, or their plots."""
        self.usable = self._usable(scan)
        found, rows = self.usable.scan, self.usable.rows
        if self.usable.outside_coverage:
            self.learned.all_extent.update(scan.range, scan.azimuth, np.ones(len(scan)))
        made = self.plots.plots_of(found, self._joined if self.plots.hulls else None)
        measured = found if made is None else made.scan
        detections = convert(measured, self.sensor, self.scan_index)
        self._clutter = self._clutter_at(measured.range, measured.azimuth, detections)
        detections["index"] = rows if made is None else rows[made.strongest]
        if made is not None and scan.range_std is None:
            detections["range_std"][~made.own_range_std] = np.nan
        return detections

    def _clutter_at(
        self, range: FloatArray, azimuth: FloatArray, detections: NDArray[np.void] | None = None
    ) -> ScanClutter:
        """Clutter at positions (n,); behind targets, where the held tracks are targets."""
        held_are_true = self.most_tracks_true
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

    def waiting(self, tracks: TrackArrays) -> BoolArray:
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
