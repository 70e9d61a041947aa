"""Whether and how the detections of a scan become clusters."""

from __future__ import annotations

import copy
import math

import numpy as np
from scipy.spatial import cKDTree

from tsepm_ros.numerics.arrays import BoolArray, FloatArray
from tsepm_ros.numerics.discs import squared_distances
from tsepm_ros.numerics.gaussian import is_significant
from tsepm_ros.tracker.clusters import grouping
from tsepm_ros.tracker.clusters.grouping import ClusterErrors, ClusterExtent, Clusters, placed
from tsepm_ros.tracker.clusters.multi_detection import (
    LOG_RATIO,
    PRIOR,
    RESOLVED,
    SUSPICION,
    ClusterDispersion,
    MultiDetectionTest,
    log_ratio,
    unit_of,
)
from tsepm_ros.tracker.confirmation import MAX_UNRESOLVED_HITS
from tsepm_ros.tracker.maintenance.confirmed_tracks import ConfirmedTracks
from tsepm_ros.tracker.maintenance.data_association import OwnDetections
from tsepm_ros.tracker.maintenance.stationary import STANDS_STILL
from tsepm_ros.tracker.measurement import major_sigma
from tsepm_ros.tracker.merging import may_repeat_older
from tsepm_ros.tracker.options import CommonOptions
from tsepm_ros.tracker.scan import Scan
from tsepm_ros.tracker.sensor import SensorModel
from tsepm_ros.tracker.tracks import TrackArrays

LONGEST_RUN = 30.0
"""Extent, m, in which neighbouring rays are one plot where none is given: a shore is no target."""
WHOLE = 2.0
"""Extent of a plot over the half width of the boxes in which its detections were seen."""


FURTHER_PLOTS = 1.0
"""Mean number of plots, beside its own, of a target with several detections a ping: a choice."""
BESIDE = 32.0
"""Distance from a track within which a second start waits, m: shorter for a short range."""


LONGEST_WAY = 48.0
"""Distance from a track within which a start may be of the same hull, m: as `BESIDE`."""
ONE_HULL = math.log(1e3)
"""L from which on a held track is of the hull of an older one: a choice."""
RECENT = 8
"""Pings whose detections between two tracks count."""


class ExtendedTargets:
    """Makes plots, where that is asked for, or where the detections ask for it.

    Parameters
    ----------
    sensor : SensorModel
    common : CommonOptions

    Attributes
    ----------
    seen : bool
        Whether the detections have shown that targets have several a ping.
    since : float
        Time of the scan that showed it, s.
    scatter : ClusterDispersion
        Of the detections about their plots.
    """

    def __init__(self, sensor: SensorModel, common: CommonOptions) -> None:
        self.sensor = sensor
        self.common = common
        self.reset()

    def reset(self) -> None:
        """Forget what was seen."""
        self.seen, self.since = False, 0.0
        self.scatter = ClusterDispersion.nothing()
        self._excess = MultiDetectionTest(self.sensor)
        self._part, self._row = Scan(0.0, np.zeros(0), np.zeros(0)), np.zeros(0, np.int64)
        self._counts = np.zeros(0, bool)
        self._recent: list[tuple[float, FloatArray, float]] = []

    def under(self, sensor: SensorModel, common: CommonOptions) -> ExtendedTargets:
        """The same under other options; it starts over where they concern it."""
        changed = copy.copy(self)
        changed.sensor, changed.common = sensor, common
        if _concerning(sensor, common) != _concerning(self.sensor, self.common):
            changed.reset()
        else:
            changed._excess = copy.deepcopy(self._excess)
        return changed

    @property
    def active(self) -> bool:
        """Whether plots are made."""
        return self.common.plots == "on" or (self.seen and self.common.plots == "auto")

    @property
    def _learns(self) -> bool:
        """Whether the extent of targets is learned."""
        return self.common.plots != "off" and not self.common.target_extent

    @property
    def log_ratio(self) -> float:
        """Logarithm of the likelihood ratio of several detections a target against clutter."""
        return self._excess.log_ratio

    @property
    def extent(self) -> ClusterExtent:
        """Within which detections become one: as given, or as seen."""
        sensor, given = self.sensor, self.common.target_extent
        if given or not self.seen:
            cell, beam = sensor.range_resolution, sensor.azimuth_resolution
            return ClusterExtent(given + cell, given, beam)
        return self._excess.extent.scaled(WHOLE)

    def clusters_of(self, scan: Scan, density: float, stays: BoolArray) -> Clusters | None:
        """The plots of a scan's detections; None where none is asked for.

        Parameters
        ----------
        scan : Scan
            n detections, or plots of `runs_of`.
        density : float
            Mean clutter density, 1/m^2.
        stays : (n,) ndarray of bool
            Which are where clutter is known to stay: they do not count as a target's.
        """
        number = len(scan)
        self._row, self._counts = np.arange(number), ~stays
        if self._learns and number:
            self._part = part = grouping.chosen(scan, np.flatnonzero(self._counts))
            self._excess.update(part, density)
            self._recent = [*self._recent[1 - RECENT :], (scan.stamp, placed(part), density)]
            self._judge(scan.stamp)
        if not self.active or not number:
            return None
        extent = self.extent
        label = grouping.grouped(scan.range, scan.azimuth, extent)
        self.scatter = self.scatter.after(scan, label, self.sensor)
        found = grouping.clusters_of(scan, label, self.scatter.errors(extent), self.sensor)
        self._row = found.strongest
        return found

    def learn(self, own: OwnDetections, held: ConfirmedTracks, density: float) -> None:
        """Learn from what lies beside held tracks' detections in the scan of `clusters_of`.

        Parameters
        ----------
        own : OwnDetections
        held : ConfirmedTracks
            At that scan.
        density : float
            Mean clutter density, 1/m^2.
        """
        if not self._learns or not len(self._row):
            return
        track_id, row = own[0], self._row[own[1]]
        ids, rows = held.tracks.track_id, np.flatnonzero(self._counts)
        still = np.isin(track_id, ids) & self._counts[row]
        place = np.searchsorted(rows, row[still])
        self._excess.update_tracks(self._part, density, track_id[still], place, ids)
        self._judge(self._part.stamp)

    def _judge(self, stamp: float) -> None:
        """Whether targets have several detections, from now on."""
        if not self.seen and self.log_ratio >= LOG_RATIO:
            self.seen, self.since = True, stamp

    def waits(self, new: TrackArrays, held: TrackArrays, origin: FloatArray) -> BoolArray:
        """Which newly confirmed tracks (n,) wait, or are of the target of an older track.

        Parameters
        ----------
        new, held : TrackArrays
            At one stamp.
        origin : (2,) ndarray
            The sensor's position, m.
        """
        number, nothing = len(held), np.zeros(len(new), bool)
        if not self._learns or not len(new):
            return nothing
        both = held.joined(new)
        filled = self._fill(both, number, SUSPICION)
        if self.seen:
            before = new.stamp - new.age < self.since
            return filled | (before & may_repeat_older(both, self.extent, origin)[number:])
        reach = BESIDE * unit_of(self.sensor)
        near = squared_distances(both.state[number:, 0::2], both.state[:, 0::2]) <= reach**2
        near &= np.tri(len(new), number + len(new), number - 1, dtype=bool)
        waits = self._excess.waits(held.track_id)
        if self._excess.crowded:
            # Echoes in a row that stand still, a quay, look for some hits like a target along it.
            still = held.stationary_probability > STANDS_STILL
            moves = is_significant(new.state[:, 1::2], new.covariance[:, 1::2, 1::2])
            moves &= new.hit_count >= MAX_UNRESOLVED_HITS
            near[:, :number] &= waits | (still & ~moves[:, None])
        else:
            near = near[:, :number] & waits
        return np.asarray(filled | near.any(axis=1))

    def of_one_hull(self, held: TrackArrays) -> BoolArray:
        """Which held tracks (n,) are of an older one's target, since plots are made."""
        return self._fill(held, 0, ONE_HULL)

    def _fill(self, tracks: TrackArrays, first: int, least: float) -> BoolArray:
        """Whether detections fill the way from each track from a first one on to an older one.

        To the nearest, as on a hull, with L at least as given. Targets of their own have none in
        the middle third of it, where that is longer than their errors. Both ends move as the older
        track.
        """
        place, velocity = (tracks.state[:, :2] + 1j * tracks.state[:, 2:]).T
        filled = np.zeros(len(tracks), bool)
        for row in range(max(first, 1), len(tracks)):
            apart, now = np.abs(place - place[row]), tracks.stamp[row]
            apart[row] = np.inf
            older = int(np.argmin(apart))
            shorter = major_sigma(tracks.covariance[row, 0::2, 0::2]) * RESOLVED**0.5
            if older < row and shorter < apart[older] <= LONGEST_WAY * unit_of(self.sensor):
                way = place[older] - place[row]
                seen = [at @ (1.0, 1j) + velocity[older] * (now - t) for t, at, _ in self._recent]
                off = (np.concatenate(seen) - place[row]) / way - 0.5
                inside = np.maximum(np.abs(off.real), np.abs(off.imag)) <= 1.0 / 6.0
                expected = PRIOR + sum(one for *_, one in self._recent) * abs(way) ** 2 / 9.0
                filled[row] = log_ratio(float(inside.sum()), expected) >= least
        return filled[first:]

    def runs_of(self, scan: Scan) -> Clusters | None:
        """Plots of the groups that a scan comes with; None where it has none, or plots are off."""
        if scan.group is None or self.common.plots == "off":
            return None
        longest = self.common.target_extent or LONGEST_RUN
        label = grouping.runs(scan, ClusterExtent(longest, longest))
        return grouping.clusters_of(scan, label, ClusterErrors(), self.sensor)

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


def further_plots(
    held: ConfirmedTracks, positions: FloatArray, extent: ClusterExtent, sensor_position: FloatArray
) -> FloatArray:
    """Density of plots that targets of an extent may have beside their own.

    `FURTHER_PLOTS` of each target that exists, uniform within the extent of where it is.

    Parameters
    ----------
    held : ConfirmedTracks
    positions : (d,) ndarray
        m.
    extent : ClusterExtent
    sensor_position : (2,) ndarray
        m.

    Returns
    -------
    (d,) ndarray
        1/m^2.
    """
    density = np.zeros(len(positions))
    if not len(positions) or not len(held):
        return density
    centre = held.tracks.state[:, 0::2] - sensor_position
    range_ = np.hypot(*centre.T)
    sight = centre / np.maximum(range_, 1e-9)[:, None]
    across = extent.across_at(range_)
    area = 4.0 * np.maximum(extent.along, 1e-9) * np.maximum(across, 1e-9)
    found = cKDTree(positions).query_ball_point(
        centre + sensor_position, np.hypot(extent.along, across)
    )
    for track, rows in enumerate(found):
        apart = positions[rows] - sensor_position - centre[track]
        east, north = sight[track]
        inside = np.abs(apart @ sight[track]) <= extent.along
        inside &= np.abs(apart @ np.array([-north, east])) <= across[track]
        density[rows] += inside * FURTHER_PLOTS * held.existence[track] / area[track]
    return density


def _concerning(sensor: SensorModel, common: CommonOptions) -> tuple[object, ...]:
    """Options that a change of starts over for."""
    coverage = sensor.min_range, sensor.max_range, sensor.azimuth_min, sensor.azimuth_max
    resolution = sensor.range_resolution, sensor.azimuth_resolution
    return coverage, resolution, common.plots, common.target_extent
