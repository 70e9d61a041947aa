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
"""Whether and how the detections of a scan become clusters.

Targets have several detections a ping where detections, and those of confirmed tracks, have more
beside them than clutter explains. In boxes of several sizes along and across the line of sight, N
detections are counted where the clutter explains E: its mean density times the area, or as many as
lie in two strips of the box's area beside it, and before and behind it. Clutter that is dense in
some place, on an arc or on a ray fills a strip, too; the echoes of one target do not. Both counts
fade. The logarithm of the likelihood ratio of Poisson counts is::

    L = N ln(N / (MAX_CLUTTER_RATIO E)) - (N - MAX_CLUTTER_RATIO E)        N > MAX_CLUTTER_RATIO E

Targets have several detections once L is at least `LOG_RATIO` in some box, until it falls below
`END_LOG_RATIO` in all of them. Where detections tell whether they stand, L of those that do not
must be `LOG_RATIO_OF_MOVING` at the beginning: fixed things lie side by side, and the density is
without them. At the end it must be small, too: things that stand all round hide a target that has
several. L is of the sum of two counts:

- beside the detections of confirmed tracks: one a ping may be a second target's and does not
  count, unless they lie now on one side and now on the other. With m the mean offset over n pings,
  a the half width of the box and R the variance of the offset of two detections::

    on one side   n m' R^-1 m > UNLIKELY_SQUARE
    resolved      n a^2 / R >= RESOLVED_SQUARE  and  a^2 / R >= MIN_HALF_WIDTH_SQUARE,
                  along and across

  What is resolved and not on one side counts whole. The detections of tracks that differ from
  every older one, in place or motion, do not count;
- beyond the largest box around these, beside every detection: of m detections in a box m - 2
  count, each member's part being (m - 2) / m. Two detections may be two targets.

The extent is that of the box of the largest L, with pairs that count (m - 1) / m of each member of
a group, and a ratio of at most `MAX_COUNT_RATIO`: a box that is too small misses some, one that is
too large has more clutter.

The scatter of confirmed tracks' clusters over the pings tells the variance v of where on a target
its detections arise. With y the innovation of a cluster, S its covariance, both over two axes, and
q the cluster's part of v, see `grouping`, v is the ratio of sums over the clusters, which fade::

    v = sum (y' y - tr S) / 2 + q v  /  sum q        from e^2 / 12 at the start, for an extent e

It lies between the values of a line of half the extent, in which others were seen, and of a target
whose clusters are pieces of it.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence

import numpy as np

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from tsepm_ros.numerics.discs import pairs_within_disc
from tsepm_ros.numerics.gaussian import UNLIKELY_SQUARE
from tsepm_ros.tracker import merging
from tsepm_ros.tracker.clusters import grouping
from tsepm_ros.tracker.clutter.excess import Excess
from tsepm_ros.tracker.maintenance.confirmed_tracks import ConfirmedTracks
from tsepm_ros.tracker.maintenance.data_association import OwnDetections
from tsepm_ros.tracker.options import CommonOptions
from tsepm_ros.tracker.polar_grid import BATCH_DETECTIONS, MEMORY_SCANS
from tsepm_ros.tracker.scan import MIN_STANDING, Scan, in_sensor_frame, scan_of_rows, wrap
from tsepm_ros.tracker.sensor import SensorModel, error_variances

SHORT_RANGE = 100.0
"""Range below which every length here is as much shorter, m: a tank or a room is no sea."""
EXTENTS = (1.0, 2.0, 4.0, 8.0, 16.0)
"""Half widths of the boxes, m."""
BEAMS = (0.0, 0.03, 0.06)
"""What the boxes have across the line of sight beside, rad."""
COUNT_DECAY = 1.0 - 1.0 / 100.0
"""Part of the counts that is kept from scan to scan."""
MAX_CLUTTER_RATIO = 1.5
"""Factor within which clutter around a track may be denser than it is known: a choice."""
STRIP_PRIOR_COUNT = 0.1
"""Detections in the strips beside those that are counted."""
LOG_RATIO, END_LOG_RATIO = math.log(1e6), math.log(5.0)
"""Logarithms of the likelihood ratio of several detections a target at which clusters are made, and
below which they are made no longer."""
LOG_RATIO_OF_MOVING = math.log(20.0)
"""The part of it that detections must show that do not stand: a choice."""
MIN_EXPECTED_PAIRS = 1e-3
"""Pairs of clutter that are expected at least."""
MAX_COUNT_RATIO = 20.0
"""Ratio of counts to clutter beyond which smaller boxes are no better: a choice."""
RESOLVED_SQUARE = 20.0
"""Squared distance at which a target at the border of a box would have shown."""
MIN_HALF_WIDTH_SQUARE = 4.0
"""Squared half width of a box, in variances of an offset, from which on two detections count."""
MOST_CENTRES, MOST_PAIRS = 300, 150_000
"""Detections of a ping beside which others are counted, neighbours in azimuth, and pairs of these
and others: bounds time and memory."""
SCATTER_PRIOR = 3.0
"""Clusters of a single detection for which v = extent^2 / 12 counts before anything is seen."""
SCATTER_LIMITS = 1.0 / 48.0, 1.0
"""Least and largest v over the square of the extent: a target half as long, and pieces of one."""
LONGEST_RUN = 30.0
"""Extent, m, in which neighbouring rays are one cluster where none is given: a shore is no target.
"""
CLUSTER_OVER_BOX = 2.0
"""Extent of a cluster over the half width of the boxes in which its detections were seen."""


def boxes_of(sensor: SensorModel) -> FloatArray:
    """The fields of `Extent` of each box, (4, e, 1), with the resolution of a sensor."""
    unit, cell, beam = (
        min(sensor.max_range / SHORT_RANGE, 1.0),
        sensor.range_resolution,
        sensor.azimuth_resolution,
    )
    beams = ((beam, math.inf),) if beam else tuple((size, unit * EXTENTS[-1]) for size in BEAMS)
    boxes = [(unit * size + cell, unit * size, *width) for size in EXTENTS for width in beams]
    return np.transpose(boxes)[..., None]


class NeighbourCounts:
    """Detections in boxes around those (n,) of some pings, each ping by itself, by size of box e.

    Attributes
    ----------
    area : (e, n) ndarray
        Of the box, m^2; 0 where it reaches the sensor.
    along, across : (e, 1) and (e, n) ndarray
        Half widths, m.
    row, other : (p,) ndarray of int
        Pairs of a centre and a detection near it, by centres.
    boxed : (p,) ndarray of bool
        Which of these are within the largest box.
    centre : (c,) ndarray of int
        Those with a detection near, ascending.
    """

    def __init__(
        self,
        range: FloatArray,
        azimuth: FloatArray,
        ping: IntArray,
        centre: IntArray,
        extents: FloatArray,
    ) -> None:
        self.across, self.along = grouping.Extent(*extents).across_at(range), extents[0]
        # A distance is at most that along and that across; pings are moved away from each other.
        reach = 3.0 * float(self.along.max() + self.across.max(initial=0.0))
        places = in_sensor_frame(range, azimuth)
        places[:, 0] += (2.0 * range.max(initial=0.0) + 2.0 * reach) * ping
        row, other = pairs_within_disc(places[centre], places, reach)
        row = centre[row]
        far = range[other] - range[row]
        aside = range[row] * wrap(azimuth[other] - azimuth[row])
        near = (
            (np.abs(far) <= 3.0 * self.along.max())
            & (np.abs(aside) <= 3.0 * self.across.max(axis=0)[row])
            & (other != row)
        )
        self.row, self.other, far, aside = row[near], other[near], far[near], aside[near]
        depth = np.abs(far) / self.along
        width = np.abs(aside) / self.across.take(self.row, axis=1)
        inside = (depth <= 1.0) & (width <= 1.0)
        beside = (depth <= 1.0) & (width > 2.0) & (width <= 3.0)
        behind = (width <= 1.0) & (depth > 2.0) & (depth <= 3.0)
        self.boxed = inside[-1]
        self._parts = np.stack([inside, beside, behind, inside * far, inside * aside])
        self._first = np.flatnonzero(np.diff(self.row, prepend=-1))
        self.centre = self.row[self._first]
        self.area = np.where(
            np.maximum(self.along, self.across) < range, 4.0 * self.along * self.across, 0.0
        )

    def counted(self, counts: BoolArray, kinds: int = 1) -> FloatArray:
        """What counts (n,) beside each of `centre`, (kinds, e, c).

        Number in the box; numbers in the strips of the same area beside it, and before and behind
        it; sum of the offsets of the others in the box along and across, m.
        """
        parts = self._parts[:kinds] * counts[self.other]
        return np.asarray(np.add.reduceat(parts, self._first, axis=-1))


def log_ratio_of(
    counted: FloatArray | float, expected: FloatArray | float, largest: float = math.inf
) -> FloatArray:
    """L of counts, (e,), for an excess of at most a largest ratio."""
    mean = MAX_CLUTTER_RATIO * expected
    excess = np.clip(counted / mean, 1.0, largest)
    return np.asarray(counted * np.log(excess) - mean * (excess - 1.0))


class SeveralEchoesTest:
    """Counts the detections beside others, and beside those of confirmed tracks.

    Parameters
    ----------
    sensor : SensorModel
        Its accuracy, resolution and range.
    """

    def __init__(self, sensor: SensorModel) -> None:
        self._sensor = sensor
        self.extents = boxes_of(sensor)
        sizes = self.extents.shape[1]
        self._pairs = Excess(*np.zeros((2, sizes)))
        # Expected by the area, and in the strips of both kinds: the largest counts.
        self._more = Excess(np.zeros(sizes), np.zeros((3, sizes)))
        # What lay beside the detections of each track, by box: pings with others, and sums of the
        # mean offsets of these along and across, m.
        parts = ("pings", float, (sizes,)), ("offset", float, (2, sizes))
        self._tracks = np.zeros(0, [("track_id", np.int64), *parts])

    @property
    def log_ratio(self) -> float:
        """The largest L."""
        more, prior = self._more, np.array([[0.0], [STRIP_PRIOR_COUNT], [STRIP_PRIOR_COUNT]])
        ratios = log_ratio_of(more.counted, (more.expected + prior).max(axis=0))
        return float(ratios.max())

    @property
    def extent(self) -> grouping.Extent:
        """Extent of a cluster by the box for which most speaks, by the areas alone."""
        ratios = log_ratio_of(
            self._pairs.counted, self._pairs.expected + MIN_EXPECTED_PAIRS, MAX_COUNT_RATIO
        )
        return grouping.Extent(*(CLUSTER_OVER_BOX * self.extents[:, np.argmax(ratios), 0]).tolist())

    def update(
        self,
        scans: Sequence[Scan],
        density: float,
        own: Sequence[OwnDetections],
        confirmed: IntArray,
        apart: BoolArray,
    ) -> None:
        """Count the detections of pings beside each other, and those beside tracks' detections.

        What a track apart from the others explains is no part of these. Beyond the largest box
        around tracks' detections, detections count beside each other.

        Parameters
        ----------
        scans : sequence of Scan
            n detections of some pings in a row.
        density : float
            Mean clutter density, 1/m^2.
        own : sequence of OwnDetections
            Tracks and the detection of each, for each ping.
        confirmed : (h,) ndarray of int
            Ids of all confirmed tracks; detections of others count as none's.
        apart : (h,) ndarray of bool
            Which differ from every older track.
        """
        lengths = np.array([len(scan.range) for scan in scans])
        ping, first = np.arange(len(scans)).repeat(lengths), np.cumsum(lengths) - lengths
        range_ = np.concatenate([scan.range for scan in scans])
        azimuth = np.concatenate([scan.azimuth for scan in scans])
        ids = np.concatenate([track_id for track_id, _ in own])
        rows = np.concatenate([row + start for (_, row), start in zip(own, first, strict=True)])
        pair, track = (ids[:, None] == confirmed).nonzero()
        own_rows = rows[pair]
        # Others are counted beside all detections, or beside those in some sector.
        in_sector, owned, counts = np.array([[True], [False], [True]]).repeat(len(range_), axis=1)
        most = min(MOST_CENTRES, MOST_PAIRS // max(len(range_), 1)) * len(scans)
        if len(range_) > most:
            start = int(7919 * scans[-1].stamp) % (len(range_) - most + 1)
            order = np.argsort(azimuth, kind="stable")
            in_sector[np.append(order[:start], order[start + most :])] = False
        owned[own_rows] = True
        beside = NeighbourCounts(
            range_, azimuth, ping, np.flatnonzero(in_sector | owned), self.extents
        )
        area = beside.area[:, beside.centre]
        used = in_sector[beside.centre] & (area > 0.0)
        (number,) = beside.counted(counts)
        group = used & (number[-1] > 1.0)
        some = (group * number / (number + 1.0)).sum(axis=1)
        keep = COUNT_DECAY ** len(scans)
        expected = 0.5 * density * (group * area).sum(axis=1)
        self._pairs = self._pairs.faded(keep, some, expected)
        counts[own_rows[apart[track]]] = False
        # Tracks without a detection near theirs add to what is expected, and nothing else.
        has_near, place = (own_rows[:, None] == beside.centre).nonzero()
        number, *strips, along, across = beside.counted(counts, 5)[..., place]
        near = beside.other[beside.boxed & owned[beside.row] & counts[beside.other]]
        counts[own_rows] = counts[near] = False
        variances = np.concatenate([error_variances(scan, self._sensor) for scan in scans], axis=1)
        variances[1] *= range_**2
        own = beside.centre[place]
        extra = self._beside_tracks(
            confirmed,
            track[has_near],
            number,
            np.stack([along, across]) / np.maximum(number, 1.0),
            2.0 * variances[:, own],
            (beside.along, beside.across[:, own]),
        )
        whole = area[:, place] > 0.0
        # Detections of groups beyond two, in each box and in its strips, and those of clutter.
        # Each member of a group has its part, from the number beside it.
        groups, number = used & counts[beside.centre], beside.counted(counts, 3)
        beyond_two = (groups * np.maximum(number - 1.0, 0.0) / (number + 1.0)).sum(axis=2)
        mean = density * beside.area[:, in_sector & counts]
        of_clutter = density * beside.area[:, own_rows].sum(axis=1) + (
            (mean + np.expm1(-mean)).sum(axis=1) / 3.0
        )
        self._more = self._more.faded(
            keep,
            (whole * extra).sum(axis=1) + beyond_two[0],
            np.stack([of_clutter, *((whole * strips).sum(axis=2) + beyond_two[1:])]),
        )

    def _beside_tracks(
        self,
        confirmed: IntArray,
        track: IntArray,
        number: FloatArray,
        offset: FloatArray,
        variance: FloatArray,
        widths: tuple[FloatArray, FloatArray],
    ) -> FloatArray:
        """Detections beside tracks' own (k,) that count as these targets', (e, k)."""
        tracks = np.zeros(len(confirmed), self._tracks.dtype)
        new, old = (confirmed[:, None] == self._tracks["track_id"]).nonzero()
        tracks[new] = self._tracks[old]
        tracks["track_id"], self._tracks = confirmed, tracks
        np.add.at(tracks["pings"], track, number.T > 0.0)
        np.add.at(tracks["offset"], track, offset.transpose(2, 0, 1))
        pings, mean = tracks["pings"][track].T, tracks["offset"][track].transpose(1, 2, 0)
        least = np.minimum(*(width**2 / one for width, one in zip(widths, variance, strict=True)))
        one_side = (mean**2 / variance[:, None]).sum(axis=0) / np.maximum(
            pings, 1.0
        ) > UNLIKELY_SQUARE
        resolved = (pings * least >= RESOLVED_SQUARE) & (least >= MIN_HALF_WIDTH_SQUARE)
        # As long as these may be a second target's, one a ping does not count.
        return np.maximum(number - ~(resolved & ~one_side), 0.0)


class ExtendedTargets:
    """Makes clusters, where that is asked for, or where the detections ask for it.

    Parameters
    ----------
    sensor : SensorModel
    common : CommonOptions

    Attributes
    ----------
    seen : bool
        Whether the detections have shown that targets have several a ping.
    test : SeveralEchoesTest
        For several detections a target against clutter.
    test_of_moving : SeveralEchoesTest
        The same without the detections that stand.
    """

    def __init__(self, sensor: SensorModel, common: CommonOptions) -> None:
        self.sensor = sensor
        self.common = common
        self.reset()

    def reset(self) -> None:
        """Forget what was seen."""
        self.seen = False
        self.test, self.test_of_moving = (SeveralEchoesTest(self.sensor) for _ in range(2))
        self._scatter, self._share = np.zeros(2), np.zeros(0)
        self._row = np.zeros(0, np.int64)
        self._last: tuple[Scan, BoolArray] = Scan(0.0, np.zeros(0), np.zeros(0)), np.zeros(0, bool)
        self._taken: list[tuple[Scan, BoolArray, OwnDetections]] = []

    def under(self, sensor: SensorModel, common: CommonOptions) -> ExtendedTargets:
        """The same under other options; it starts over where they concern it."""
        other = copy.copy(self)
        other.sensor, other.common = sensor, common
        if _options_of(sensor, common) != _options_of(self.sensor, self.common):
            other.reset()
        else:
            other.test, other.test_of_moving = copy.deepcopy((self.test, self.test_of_moving))
        return other

    @property
    def active(self) -> bool:
        """Whether clusters are made."""
        return self.seen or self.common.target_extent > 0.0

    @property
    def extent(self) -> grouping.Extent:
        """Within which detections become one: as given, or as seen."""
        sensor, given = self.sensor, self.common.target_extent
        if self.seen and not given:
            return self.test.extent
        return grouping.Extent(given + sensor.range_resolution, given, sensor.azimuth_resolution)

    def clusters_of(self, scan: Scan, stays: BoolArray) -> grouping.Clusters | None:
        """The clusters of a scan's detections; None where none is asked for.

        Parameters
        ----------
        scan : Scan
            n detections, or clusters of `runs_of`.
        stays : (n,) ndarray of bool
            Which are where clutter is known to stay: they do not count as a target's.
        """
        self._row, self._last, extent = np.arange(len(stays)), (scan, ~stays), self.extent
        if not self.active or not len(stays):
            return None
        label = grouping.group_detections(scan.range, scan.azimuth, extent)
        clusters = grouping.clusters_of_groups(scan, label, self.extent_variance, self.sensor)
        self._row, self._share = clusters.strongest, clusters.share
        return clusters

    @property
    def extent_variance(self) -> float:
        """Variance v of where on a target its detections arise, on each axis, m^2."""
        square = self.extent.along**2
        excess, shares = self._scatter + SCATTER_PRIOR * np.array([square / 12.0, 1.0])
        least, largest = SCATTER_LIMITS
        return float(min(max(excess / shares, least * square), largest * square))

    def learn_scatter(self, innovation: FloatArray, covariance: FloatArray, row: IntArray) -> None:
        """Learn v from the innovations of clusters that are confirmed tracks'.

        Parameters
        ----------
        innovation, covariance : (k, 2), (k, 2, 2) ndarray
            m, m^2.
        row : (k,) ndarray of int
            The cluster of each in the last scan.
        """
        share = self._share[row]
        excess = 0.5 * ((innovation**2).sum(axis=1) - covariance.trace(axis1=1, axis2=2))
        self._scatter = (1.0 - 1.0 / MEMORY_SCANS) ** len(row) * self._scatter
        self._scatter += (excess + self.extent_variance * share).sum(), share.sum()

    def learn(
        self, own: OwnDetections, confirmed: ConfirmedTracks, density: float, whole: bool
    ) -> None:
        """Learn from the scans of a batch, the last one included, once it is whole, or large.

        Parameters
        ----------
        own : OwnDetections
            Those in the last scan's clusters that are confirmed tracks'.
        confirmed : ConfirmedTracks
            At the last scan.
        density : float
            Mean clutter density, 1/m^2.
        whole : bool
            Whether the last scan is the last of its batch.
        """
        scan, (track_id, rows) = self._last[0], own
        if not self.common.target_extent and len(self._row):
            self._taken.append((*self._last, (track_id, self._row[rows])))
            whole |= sum(len(one) for one, *_ in self._taken) >= BATCH_DETECTIONS
        if not whole or not self._taken:
            return
        taken, self._taken = self._taken, []
        tracks, told = confirmed.tracks, "standing" in scan.features
        apart = ~merging.on_older_extent(tracks, np.zeros(len(tracks)))
        for test in (self.test, self.test_of_moving)[: 1 + told]:
            scans, owned = [], []
            for scan, counts, (track_id, row) in taken:
                if test is self.test_of_moving:
                    stands = scan.features.get("standing", np.zeros(len(scan))) >= MIN_STANDING
                    counts = counts & ~stands
                scans.append(scan if counts.all() else scan_of_rows(scan, np.flatnonzero(counts)))
                still = counts[row]
                owned.append((track_id[still], np.cumsum(counts)[row[still]] - 1))
            test.update(scans, density, owned, tracks.track_id, apart)
        ratio, of_moving = (
            self.test.log_ratio,
            self.test_of_moving.log_ratio if told else -math.inf,
        )
        self.seen = (
            max(ratio, of_moving) >= END_LOG_RATIO
            if self.seen
            else ratio >= LOG_RATIO and (not told or of_moving >= LOG_RATIO_OF_MOVING)
        )

    def runs_of(self, scan: Scan) -> grouping.Clusters | None:
        """Clusters of the groups that a scan comes with; None without."""
        if scan.group is None:
            return None
        longest = self.common.target_extent or LONGEST_RUN
        label = grouping.group_runs(scan, grouping.Extent(longest, longest))
        return grouping.clusters_of_groups(scan, label, 0.0, self.sensor)

    @property
    def sentence(self) -> str:
        """What was seen, for the user."""
        extent = self.extent
        beam = f" (and {np.degrees(extent.beam):.2g} degrees)" if extent.beam else ""
        return (
            "targets give several detections per ping: detections within "
            f"{extent.along:.3g} m{beam} of each other are combined into one "
            "cluster"
        )


def density_of_further(
    confirmed: ConfirmedTracks,
    positions: FloatArray,
    extent: grouping.Extent,
    sensor_position: FloatArray,
) -> FloatArray:
    """Density of clusters that targets of an extent may have beside their own.

    One of each target that exists, uniform within the extent of where it is: a choice.

    Parameters
    ----------
    confirmed : ConfirmedTracks
    positions : (d,) ndarray
        m.
    extent : Extent
    sensor_position : (2,) ndarray
        m.

    Returns
    -------
    (d,) ndarray
        1/m^2.
    """
    centre = confirmed.tracks.state[:, 0::2] - sensor_position
    range_ = np.hypot(*centre.T)
    sight = centre @ (1.0, -1j) / np.maximum(range_, 1e-9)
    across = extent.across_at(range_)
    area = 4.0 * np.maximum(extent.along, 1e-9) * np.maximum(across, 1e-9)
    reach = math.hypot(extent.along, across.max(initial=0.0))
    track, row = pairs_within_disc(centre, positions - sensor_position, reach)
    # Along the line of sight, and i times across.
    apart = (positions[row] - sensor_position - centre[track]) @ (1.0, 1j) * sight[track]
    inside = (np.abs(apart.real) <= extent.along) & (np.abs(apart.imag) <= across[track])
    density = inside * (confirmed.existence / area)[track]
    return np.asarray(np.bincount(row, density, minlength=len(positions)), float)


def _options_of(sensor: SensorModel, common: CommonOptions) -> tuple[object, ...]:
    """Options that a change of starts over for."""
    return (
        *(sensor.min_range, sensor.max_range, sensor.azimuth_min, sensor.azimuth_max),
        *(sensor.range_resolution, sensor.azimuth_resolution),
        common.target_extent,
    )
