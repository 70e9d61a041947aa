"""Whether and how the detections of a scan become clusters.

At which pings of a fast sonar the spacing of detections is looked at.

Whether and how the detections of a scan become plots.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from tsepm_ros.numerics.discs import squared_distances
from tsepm_ros.tracker import clustering
from tsepm_ros.tracker.clustering import EchoErrors, PlotExtent, Plots
from tsepm_ros.tracker.clutter.seen_extent import Region
from tsepm_ros.tracker.maintenance.confirmed_tracks import HeldTracks
from tsepm_ros.tracker.maintenance.stationary import StraightFits
from tsepm_ros.tracker.multi_detection import DetectionSpacing, EchoScatter, unit_of
from tsepm_ros.tracker.options import CommonOptions
from tsepm_ros.tracker.scan import Scan
from tsepm_ros.tracker.sensor import SensorModel
from tsepm_ros.tracker.tracks import TrackArrays

LOOK_INTERVAL = 0.2
"""Mean time between looks, s: targets stay as close together for longer. A choice."""
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
"""Step of the share of `INTERVAL`: times between looks never fall into step with the pings."""


@dataclass(frozen=True)
class Looks:
    """Looks `INTERVAL` apart on average, between half of it and one and a half.

    Pings less than half of `INTERVAL` apart are not all looked at; pings more than one and a half
    apart are.

    Attributes
    ----------
    last : float or None
        Stamp of the last look, s; None before the first.
    number : int
        Looks so far.
    """

    last: float | None = None
    number: int = 0

    def is_due(self, stamp: float) -> bool:
        """Whether a ping at a stamp, s, is to be looked at."""
        share = (self.number * GOLDEN) % 1.0
        return self.last is None or stamp >= self.last + LOOK_INTERVAL * (0.5 + share)

    def elapsed(self, stamp: float) -> float:
        """Time since the last look, s; 0 before the first."""
        return 0.0 if self.last is None else stamp - self.last

    def after(self, stamp: float) -> Looks:
        """With a look at a stamp, s."""
        return Looks(stamp, self.number + 1)


LIKELIHOOD_RATIO = 1e6
"""Likelihood ratio of several detections a target at which plots are made: a choice."""
LONGEST_RUN = 30.0
"""Extent, m, in which neighbouring rays are one plot where none is given: a shore is no target."""
SUSPICION = 10.0
"""Likelihood ratio from which on a second start beside a new track waits: a choice."""
LOOK_RATIO = 10.0
"""Likelihood ratio of a look from which on the next ping is looked at, however soon: a choice."""
LOOK_STREAK = 2
"""Looks in a row with detections close together at a place from which on it is: a choice."""
BESIDE = 64.0
"""Distance of tracks from older ones beside them, m: the widest box in which a target is sought.

It is shorter for a short range, as the boxes are (`detection_spacing.unit_of`).
"""
DEVIATIONS = 4.0
"""Standard deviations within which a detection is a track's."""
MOST_TRACKS = 200
"""Held tracks that are compared, the first confirmed: bounds the time."""
WHOLE = 2.0
"""Extent of a plot over the half width of the boxes in which its detections were seen."""

Join = Callable[[Scan, IntArray], tuple[IntArray, FloatArray]]
"""From a scan and the group of each detection: the groups joined, and what `plots_of` adds."""


class PlotExtraction:
    """Makes plots, where that is asked for, or where the detections ask for it.

    Parameters
    ----------
    sensor : SensorModel
    common : CommonOptions

    Attributes
    ----------
    seen : bool
        Whether the spacing of the detections has shown that targets have several a ping.
    scatter : EchoScatter
        Of the detections about their plots.
    """

    def __init__(self, sensor: SensorModel, common: CommonOptions) -> None:
        self.sensor = sensor
        self.common = common
        self.reset()

    def reset(self) -> None:
        """Forget what was seen."""
        self.seen = False
        self.scatter = EchoScatter.nothing()
        self._spacing = DetectionSpacing(self.sensor, self.common.target_extent)
        self._looks = Looks()
        self._grouped: tuple[Scan, PlotExtent, IntArray] | None = None

    def under(self, sensor: SensorModel, common: CommonOptions) -> PlotExtraction:
        """The same under other options; it starts over where they concern it."""
        changed = copy.copy(self)
        changed.sensor, changed.common = sensor, common
        if _concerning(sensor, common) != _concerning(self.sensor, self.common):
            changed.reset()
        else:
            changed._spacing = copy.deepcopy(self._spacing)
        return changed

    @property
    def active(self) -> bool:
        """Whether plots are made."""
        return self.common.plots == "on" or (self.seen and self.common.plots == "auto")

    @property
    def hulls(self) -> bool:
        """Whether targets may be longer than a plot: highlights along hulls."""
        return self.active and self.seen and not self.common.target_extent

    @property
    def waiting_extent(self) -> PlotExtent | None:
        """Within which a second start beside a new track waits; None where none does.

        It does while it is not sure that targets have several detections, and where they have them
        along a hull.
        """
        suspected = self.common.plots == "auto" and self.log_ratio >= math.log(SUSPICION)
        if not (self.hulls or (suspected and not self.seen)):
            return None
        longest = self._spacing.hull_extent
        if longest is None:
            longest = PlotExtent(0.0, 0.0) if self.seen else self._spacing.extent
        return longest.scaled(WHOLE)

    @property
    def log_ratio(self) -> float:
        """Logarithm of the likelihood ratio of several detections a target against clutter."""
        return self._spacing.log_ratio

    @property
    def _suspects(self) -> bool:
        """Whether the last look leaves open that targets have several detections a ping."""
        spacing = self._spacing
        likely = spacing.last_log_ratio >= math.log(LOOK_RATIO)
        return not self.seen and (likely or spacing.longest_streak >= LOOK_STREAK)

    @property
    def extent(self) -> PlotExtent:
        """Within which detections become one: as given, or as seen."""
        sensor, given = self.sensor, self.common.target_extent
        if given or not self.seen:
            cell, beam = sensor.range_resolution, sensor.azimuth_resolution
            return PlotExtent(given + cell, given, beam)
        return self._spacing.extent.scaled(WHOLE)

    def learn(
        self,
        scan: Scan,
        seen: Region,
        held: HeldTracks,
        stays: Callable[[Scan], BoolArray],
    ) -> bool:
        """Learn from a scan's detections; returns whether plots look different from now on.

        Of a fast sonar not every scan is looked at: see `Looks`. Which are depends on the scans
        before alone, so that the bound of `DetectionSpacing` holds for those that are. A scan of
        a part of the coverage (`swept`) always is.

        Parameters
        ----------
        scan : Scan
        seen : Region
            Where clutter was seen before.
        held : HeldTracks
            In the order of their confirmation, at the scan before.
        stays : callable
            Which detections of a scan are where clutter is known to stay: they do not count.
        """
        if self.common.plots == "off":
            return False
        if not (self._looks.is_due(scan.stamp) or self._suspects or scan.swept is not None):
            return False
        scan = self._without_runs(scan)
        reach = self.common.max_speed * self._looks.elapsed(scan.stamp)
        self._looks = self._looks.after(scan.stamp)
        place, tracks = clustering.placed(scan), held.tracks.predicted(scan.stamp)
        left_out = of_neighbours(scan, place, tracks, held.fits, self.sensor) | stays(scan)
        rows = np.flatnonzero(~left_out)
        self._spacing.observe(scan.range[rows], scan.azimuth[rows], place[rows], reach, seen)
        before = self.seen
        self.seen = before or self.log_ratio >= math.log(LIKELIHOOD_RATIO)
        if before and self.active:
            self.observe(scan)
        grouped_already = self.common.plots == "on" and self.common.target_extent > 0.0
        return self.seen and not before and not grouped_already

    def observe(self, scan: Scan) -> None:
        """Learn from a scan how detections scatter about their plots."""
        scan = self._without_runs(scan)
        self.scatter = self.scatter.after(scan, self._group(scan, self.extent), self.sensor)

    def _group(self, scan: Scan, extent: PlotExtent) -> IntArray:
        """The group of each detection; that of the same scan and extent is not sought again."""
        if self._grouped is None or self._grouped[0] is not scan or self._grouped[1] != extent:
            self._grouped = scan, extent, clustering.grouped(scan.range, scan.azimuth, extent)
        return self._grouped[2]

    def plots_of(self, scan: Scan, joined: Join | None = None) -> Plots | None:
        """The plots of a scan's detections; None where none has more than one, or is asked for.

        Parameters
        ----------
        scan : Scan
        joined : callable, optional
            Joins groups that are one hull's.
        """
        runs = self._runs(scan)
        if not self.active or not len(scan):
            return runs
        scan = scan if runs is None else runs.scan
        extent = self.extent
        label, wander = self._group(scan, extent), None
        if joined is not None:
            label, wander = joined(scan, label)
        found = clustering.plots_of(scan, label, self.scatter.errors(extent), self.sensor, wander)
        return found if runs is None else found.of(runs)

    def _runs(self, scan: Scan) -> Plots | None:
        """Plots of the groups that a scan comes with; None where it has none, or plots are off."""
        if scan.group is None or self.common.plots == "off":
            return None
        longest = self.common.target_extent or LONGEST_RUN
        label = clustering.runs(scan, PlotExtent(longest, longest))
        return clustering.plots_of(scan, label, EchoErrors(), self.sensor)

    def _without_runs(self, scan: Scan) -> Scan:
        """The scan with its groups as one detection each."""
        runs = self._runs(scan)
        return scan if runs is None else runs.scan

    @property
    def sentence(self) -> str:
        """What was seen, for the user."""
        extent = self.extent
        beam = f" (and {np.degrees(extent.beam):.2g} degrees)" if extent.beam else ""
        size = self.scatter.mean_size
        average = f", {size:.2g} on average" if size > 1.0 else ""  # 1 before any is measured
        return (
            "targets give several detections per ping: detections within "
            f"{extent.along:.3g} m{beam} of each other are combined into one "
            f"plot{average}"
        )


def of_neighbours(
    scan: Scan, place: FloatArray, tracks: TrackArrays, fits: StraightFits, sensor: SensorModel
) -> BoolArray:
    """Which detections (n,) are those of tracks that move apart from an older one beside them.

    Targets side by side, each with one detection, are close together from ping to ping. That does
    not show that a target has several detections. Tracks that move together may be of one target,
    and their detections count. The selection uses the present ping, so that the bound of the test
    for several detections holds approximately.

    Parameters
    ----------
    scan : Scan
        n detections.
    place : (n, 2) ndarray
        In the fixed frame, m.
    tracks : TrackArrays
        Held, in the order of their confirmation, at the scan's stamp.
    fits : StraightFits
        Of these: they hardly forget, so that slow motion shows.
    sensor : SensorModel
        Errors where the scan gives none of its own.
    """
    found = np.zeros(len(scan), bool)
    number = min(len(tracks), MOST_TRACKS)
    if not len(scan) or number < 2:
        return found
    state, covariance = tracks.state[:number], tracks.covariance[:number]
    near = squared_distances(state[:, 0::2], state[:, 0::2]) <= (BESIDE * unit_of(sensor)) ** 2
    younger, older = np.nonzero(np.tril(near, -1))
    beside = np.unique(younger[fits.move_apart(younger, older)])
    if not len(beside):
        return found
    away, row = cKDTree(place).query(state[beside, 0::2])
    range_ = scan.range[row]
    along = sensor.range_variance(range_) if scan.range_std is None else scan.range_std[row] ** 2
    angle = sensor.azimuth_std if scan.azimuth_std is None else scan.azimuth_std[row]
    error = along + (angle * range_) ** 2 + covariance[beside, 0, 0] + covariance[beside, 2, 2]
    found[row[away <= DEVIATIONS * np.sqrt(error)]] = True
    return found


def _concerning(sensor: SensorModel, common: CommonOptions) -> tuple[object, ...]:
    """Options that a change of starts over for."""
    coverage = sensor.min_range, sensor.max_range, sensor.azimuth_min, sensor.azimuth_max
    resolution = sensor.range_resolution, sensor.azimuth_resolution
    return coverage, resolution, common.plots, common.target_extent
