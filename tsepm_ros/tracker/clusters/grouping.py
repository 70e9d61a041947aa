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
"""Clusters of detections: several detections of one target in a ping, as one.

A target that is larger than the sensor's resolution, or whose echo spills over several cells, gives
several detections a ping. Complete linkage (Defays, "An efficient algorithm for a complete link
method", Comput. J. 20(4), 1977) joins detections as long as every two of a group lie within the
target's extent and the sensor's resolution of each other: no chain of them grows beyond.

Errors
------
Detection i of a target at p lies at ``z_i = p + o_i + c`` on each axis, along and across the line
of sight: o_i where on the target it arose, of variance v (extent^2 / 12 of a line); c the
measurement error, of the sensor's variance s^2, which counts as common to the ping. With weights
w_i that add up to 1 the centroid's error then has the variance::

    s^2 + v q,    q = sum_i w_i^2, 1 / m for m equal weights

v follows from the scatter of the centroids of tracks over the pings
(`tsepm_ros.tracker.clusters.extended_targets`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from tsepm_ros.numerics.arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    complete_linkage,
    largest_of_groups,
)
from tsepm_ros.tracker.scan import (
    MAX_MAGNITUDE,
    MIN_MAGNITUDE,
    Scan,
    in_sensor_frame,
    scan_of_rows,
    wrap,
)
from tsepm_ros.tracker.sensor import SensorModel

MAX_PAIRS = 500_000
"""Pairs of detections that are looked at, at most; see `group_detections`."""


@dataclass(frozen=True)
class Extent:
    """How far apart two detections of one target and ping may be.

    Attributes
    ----------
    along : float
        In range, m.
    across : float
        Across the line of sight, m.
    beam : float
        In azimuth, added to `across`, rad.
    widest : float
        Limit of what `beam` adds, m.
    """

    along: float
    across: float
    beam: float = 0.0
    widest: float = math.inf

    def across_at(self, range: FloatArray) -> FloatArray:
        """Distance across the line of sight at ranges (...), m."""
        return self.across + np.minimum(range * self.beam, self.widest)


@dataclass(frozen=True)
class Clusters:
    """The clusters of a scan.

    Attributes
    ----------
    scan : Scan
        A detection for each cluster: its centroid, and what else its strongest member has.
    strongest : (p,) ndarray of int
        The strongest member of each cluster, a detection of the scan that the clusters are of.
    own_range_std : (p,) ndarray of bool
        Whether a cluster's range error differs from what the scan or the sensor model has.
    share : (p,) ndarray
        q of each, the part of the extent's variance that its error has.
    """

    scan: Scan
    strongest: IntArray
    own_range_std: BoolArray
    share: FloatArray

    def traced_through(self, before: Clusters) -> Clusters:
        """The same, with members in the scan that the clusters `before` were made of."""
        return replace(
            self,
            strongest=before.strongest[self.strongest],
            own_range_std=self.own_range_std | before.own_range_std[self.strongest],
        )


def pairs(
    range: FloatArray, azimuth: FloatArray, extent: Extent
) -> tuple[IntArray, IntArray, FloatArray]:
    """Pairs of detections within an extent of each other.

    Parameters
    ----------
    range, azimuth : (n,) ndarray
        m, rad.
    extent : Extent

    Returns
    -------
    first, second : (p,) ndarray of int
        first < second.
    distance : (p,) ndarray
        ``max(|dr| / along, r |da| / across(r))`` with the pair's mean range r, at most 1.
    """
    places, reach = _positions(range, azimuth, extent)
    first, second = cKDTree(places).query_pairs(reach, output_type="ndarray").T
    middle = 0.5 * (range[first] + range[second])
    turn = np.abs(wrap(azimuth[first] - azimuth[second]))
    distance = np.maximum(
        _distance_ratio(np.abs(range[first] - range[second]), extent.along),
        _distance_ratio(middle * turn, extent.across_at(middle)),
    )
    near = distance <= 1.0
    return first[near], second[near], distance[near]


def _positions(range: FloatArray, azimuth: FloatArray, extent: Extent) -> tuple[FloatArray, float]:
    """The detections' positions, and how far apart a pair may be at the most, m."""
    return (
        in_sensor_frame(range, azimuth),
        math.hypot(extent.along, float(extent.across_at(range.max(initial=0.0)))) * (1.0 + 1e-9),
    )


def _distance_ratio(distance: FloatArray, limit: FloatArray | float) -> FloatArray:
    """Distance over its limit; a limit of 0 is kept by a distance of 0 only."""
    return np.asarray(distance / np.maximum(limit, 1e-9))


def is_crowded(range: FloatArray, azimuth: FloatArray, extent: Extent, most: int) -> bool:
    """Whether more than a number of pairs of detections (n,) may be within an extent."""
    n = len(range)
    if n * n <= 2 * most:
        return False
    places, reach = _positions(range, azimuth, extent)
    tree = cKDTree(places)
    return bool(tree.count_neighbors(tree, reach) - n > 2 * most)


def group_detections(range: FloatArray, azimuth: FloatArray, extent: Extent) -> IntArray:
    """The group of each detection, (n,): the first detection of it; see `complete_linkage`.

    Where there are more than `MAX_PAIRS` pairs, those in one cell of a grid are a group.
    """
    if is_crowded(range, azimuth, extent, MAX_PAIRS):
        return group_cells(np.zeros(len(range), np.int64), range, azimuth, extent)
    # Detections of one place are joined first, whatever lies beside them.
    _, first, index = np.unique(range + 1j * azimuth, return_index=True, return_inverse=True)
    order = np.argsort(first)
    first, rank = first[order], np.argsort(order)
    label = complete_linkage(len(first), *pairs(range[first], azimuth[first], extent))
    return np.asarray(first[label][rank[index]], np.int64)


def group_runs(scan: Scan, extent: Extent) -> IntArray:
    """The groups that a scan comes with, cut in pieces within an extent; see `group_cells`."""
    n = len(scan)
    group = np.arange(n) if scan.group is None else scan.group
    alone = group.max(initial=0) + 1 + np.arange(n)
    return group_cells(np.where(group < 0, alone, group), scan.range, scan.azimuth, extent)


def group_cells(
    group: IntArray, range: FloatArray, azimuth: FloatArray, extent: Extent
) -> IntArray:
    """Groups cut in pieces no longer than an extent, by a grid from their nearest, rightmost place.

    Parameters
    ----------
    group : (n,) ndarray of int
        Group of each detection.
    range, azimuth : (n,) ndarray
        m, rad.
    extent : Extent

    Returns
    -------
    (n,) ndarray of int
        The first detection of each one's piece.
    """
    _, first, group = np.unique(group, return_index=True, return_inverse=True)
    turn = wrap(azimuth - azimuth[first][group])
    turn = turn + largest_of_groups(-turn, group, len(first))[group]
    along = range + largest_of_groups(-range, group, len(first))[group]
    row = np.floor(_distance_ratio(along, extent.along))
    far = range - along + (row + 1.0) * extent.along
    column = np.floor(_distance_ratio(far * turn, extent.across_at(far)))
    pieces = np.stack([group, column, row], axis=1)
    _, first, piece = np.unique(pieces, axis=0, return_index=True, return_inverse=True)
    return np.asarray(first[piece.ravel()], np.int64)


def clusters_of_groups(
    scan: Scan,
    label: IntArray,
    extent_variance: float,
    sensor: SensorModel,
) -> Clusters:
    """Make a cluster of each group of a scan's detections.

    The centroid is weighted by intensity where every member has one above 0. The strongest member,
    or, where intensities are missing, that nearest to the centroid, lends the cluster its
    intensity, time offset, range rate, pose and index. The widths reach over all members.

    Parameters
    ----------
    scan : Scan
        n detections.
    label : (n,) ndarray of int
        Group of each.
    extent_variance : float
        v, m^2.
    sensor : SensorModel
        Errors where the scan gives none of its own.

    Returns
    -------
    Clusters
        In the order of their first members.
    """
    _, first, group = np.unique(label, return_index=True, return_inverse=True)
    order = np.argsort(np.argsort(first))
    group, first = order[group], np.sort(first)
    n = len(first)
    size = np.bincount(group, minlength=n)
    weight, by_amplitude = _weights(scan, group, n)
    turn = wrap(scan.azimuth - scan.azimuth[first][group])

    def mean(values: FloatArray) -> FloatArray:
        return np.asarray(np.bincount(group, weight * values, minlength=n), float)

    range_ = np.where(size > 1, mean(scan.range), scan.range[first])
    turned = mean(turn)
    off = np.hypot(scan.range - range_[group], scan.range * (turn - turned[group]))
    rank = np.where(by_amplitude[group], -weight, off)
    best = np.lexsort((rank, group))[np.cumsum(size) - size]
    share = np.bincount(group, weight**2, minlength=n)
    own = sensor.range_variance(range_) if scan.range_std is None else mean(scan.range_std**2)
    given = scan.azimuth_std
    angle = np.full(n, sensor.azimuth_std**2) if given is None else mean(given**2)
    spread = share * extent_variance
    own_errors = (size > 1) | (spread > 0.0)
    return Clusters(
        scan=scan_of_rows(scan, best).replaced(
            range=range_,
            azimuth=np.where(size > 1, scan.azimuth[first] + turned, scan.azimuth[first]),
            range_std=_bounded_std("range_std", np.where(own_errors, own + spread, own)),
            azimuth_std=_bounded_std("azimuth_std", angle + spread / range_**2),
            group=None,
        ),
        strongest=best,
        own_range_std=own_errors,
        share=np.asarray(share, float),
    )


def _weights(scan: Scan, group: IntArray, n: int) -> tuple[FloatArray, BoolArray]:
    """Weight of each detection in its group, adding up to 1; which groups go by amplitude."""
    amplitude = scan.features.get("intensity", np.full(len(scan), np.nan))
    with np.errstate(invalid="ignore"):
        usable = (amplitude > 0.0) & (amplitude < 1e100)
    by_amplitude = np.bincount(group, ~usable, minlength=n) == 0
    weight = np.where(by_amplitude[group], amplitude, 1.0)
    weight = weight / largest_of_groups(weight, group, n)[group]
    return weight / np.bincount(group, weight, minlength=n)[group], by_amplitude


def _bounded_std(name: str, variance: FloatArray) -> FloatArray:
    """Standard deviations within the bounds of a scan: an echo at the sensor has any azimuth."""
    return np.clip(np.sqrt(variance), MIN_MAGNITUDE[name], MAX_MAGNITUDE[name])
