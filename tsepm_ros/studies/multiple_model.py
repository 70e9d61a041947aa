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
"""The parameterised multiple-model start: a filter for each cell of speed and heading.

Mallick, Bar-Shalom, Kirubarajan, Moreland, "An improved single-point track initiation using GMTI
measurements", IEEE Trans. AES 51(4), 2015, as TSEPM 2018 describes it (Sections 1 and 5), in words
only: "without a prior knowledge of target motion status, the parameterized multiple model
method divides the possible speed interval [v_min, v_max] and heading interval into several
subintervals. Then it establishes a filter for every subinterval. All the filters run concurrently,
and the estimate output is the weighted output of all the filters." There is no splitting.

Each filter begins at a track's first detection: position z, covariance R, and the mean and
covariance of a velocity that is uniform over its cell of speed, mean v and width d, and of heading,
middle a and width 2 h. With ``q = v^2 + d^2 / 12``, along and across the heading a::

    mean   = v sin(h) / h
    along  = q (1 + sin(2 h) / (2 h)) / 2 - mean^2
    across = q (1 - sin(2 h) / (2 h)) / 2

A detection in the gate of the weighted prediction updates all of them, and their weights by its
likelihood, ``w_i <- w_i N(z; H x_i, S_i)``. The output is the mixture's mean and covariance.

Readings
--------
- v_min is 0, the headings go all round, and the first weights are equal: nothing is known.
- The gate is the chi-square region of the mixture's moments; the nearest pair of all in normalised
  distance is matched first, and a matched detection is removed.
- M hits within N scans confirm, as with the other methods of the paper's comparison.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Self

import numpy as np

from tsepm_ros.numerics import gaussian
from tsepm_ros.numerics.arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    RecordArray,
    replaced,
    rows_of,
)
from tsepm_ros.parameters import parameter
from tsepm_ros.studies.assignment import (
    AssignmentPairs,
    assignment_within,
    nearest_first_assignment,
)
from tsepm_ros.studies.path_following import PathFollower
from tsepm_ros.tracker import motion, splitting
from tsepm_ros.tracker.initial_state import Fit, Paths, new_paths
from tsepm_ros.tracker.measurement import major_sigma, rotated_covariance
from tsepm_ros.tracker.observation import Observation
from tsepm_ros.tracker.options import CommonOptions, MnOptions
from tsepm_ros.tracker.sensor import SensorModel

MAX_FILTERS = 500_000
"""Filters kept at most: bounds memory."""


@dataclass(frozen=True, kw_only=True)
class FilterOptions(MnOptions):
    """Options of an M/N method whose potential tracks have filters."""

    gate_probability: float = parameter(
        0.99,
        "Probability that a detected target falls into the gate",
        positive=True,
        maximum=0.999999,
    )
    process_noise: float = parameter(
        0.001,
        "Spectral density of a target's acceleration",
        unit="m^2/s^3",
        minimum=0.0,
        maximum=100.0,
    )


@dataclass(frozen=True, kw_only=True)
class MultipleModelOptions(FilterOptions):
    """Options of the multiple-model start."""

    speeds: int = parameter(2, "Cells of the speed, from 0 to v_max", minimum=1, maximum=20)
    headings: int = parameter(8, "Cells of the heading", minimum=3, maximum=72)


def multiple_model_beyond_one(covariance: FloatArray) -> BoolArray:
    """Which matrices (n, d, d) have a variance or a correlation that no covariance has, (n,).

    This is a cheap test for many matrices; `proper_covariance` tests all of their eigenvalues.
    """
    variance = np.diagonal(covariance, axis1=-2, axis2=-1)
    square = variance[..., :, None] * variance[..., None, :]
    size = covariance.shape[-1]
    beyond = np.square(covariance) >= square * (1.0 - gaussian.MIN_EIGENVALUE)
    beyond[..., range(size), range(size)] = variance <= 0.0
    return np.asarray(beyond.any(axis=(-2, -1)))


@dataclass(frozen=True)
class FilterTracks(Paths):
    """Potential tracks with a filter each.

    Attributes
    ----------
    hits, hit_count, first_scan
        As in `Paths`.
    state, covariance : (n, 4), (n, 4, 4) ndarray
        At the last scan's stamp.
    """

    state: FloatArray
    covariance: FloatArray

    def predicted(self, elapsed: FloatArray | float, noise: float) -> Self:
        """The tracks after times, s, with a process noise, m^2/s^3."""
        state, covariance = motion.predict(self.state, self.covariance, elapsed, noise)
        return replaced(self, state=state, covariance=covariance)

    def output(self) -> tuple[FloatArray, FloatArray]:
        """State (n, 4) and covariance (n, 4, 4) of each track."""
        return self.state, self.covariance


@dataclass(frozen=True)
class MultipleModelBanks(FilterTracks):
    """Potential tracks with a bank of f filters each.

    Attributes
    ----------
    hits, hit_count, first_scan
        As in `Paths`.
    state, covariance : (n, f, 4), (n, f, 4, 4) ndarray
        At the last scan's stamp.
    weight : (n, f) ndarray
        Probability of each filter.
    """

    weight: FloatArray

    def updated(self, stamp: float, detections: RecordArray) -> MultipleModelBanks:
        """The banks at a stamp, s, after an update by a detection each (n,)."""
        innovation = filter_innovations(self.state, self.covariance, stamp, detections[:, None])
        density, _ = gaussian.log_density(*innovation[1:])
        state, covariance = motion.update(self.state, self.covariance, *innovation)
        # P - K S K' loses its definiteness to rounding where the detection is far more accurate
        # than the prediction; the error would grow from scan to scan.
        lost = multiple_model_beyond_one(covariance)
        if lost.any():
            covariance[lost] = gaussian.proper_covariance(covariance[lost])
        likelihood = np.exp(density - density.max(axis=1, keepdims=True, initial=-np.inf))
        # A floor, so that no filter is lost to rounding.
        weight = np.maximum(self.weight * likelihood, 1e-300)
        weight = weight / weight.sum(axis=1, keepdims=True)
        return replaced(self, state=state, covariance=covariance, weight=weight)

    def output(self) -> tuple[FloatArray, FloatArray]:
        """Weighted mean (n, 4) and covariance (n, 4, 4)."""
        return gaussian.mixture(
            self.weight.T, np.swapaxes(self.state, 0, 1), np.swapaxes(self.covariance, 0, 1)
        )


def filter_innovations(
    state: FloatArray, covariance: FloatArray, stamp: float, detections: RecordArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Times after a stamp (s) of detections, their innovations d and covariances S.

    Parameters
    ----------
    state, covariance : (..., 4), (..., 4, 4) ndarray
        At the stamp.
    stamp : float
    detections : ndarray of DETECTION
        Of a shape that broadcasts.
    """
    after = detections["time"] - stamp
    spread = motion.position_covariance_after(covariance, after) + detections["covariance"]
    return after, detections["position"] - motion.position_after(state, after), spread


def gated_by_filters(
    state: FloatArray,
    covariance: FloatArray,
    detections: RecordArray,
    stamp: float,
    gate_probability: float,
    most_pairs: float,
) -> tuple[AssignmentPairs, int]:
    """Pairs of predictions and the detections in their gates, by normalised distance.

    Parameters
    ----------
    state, covariance : (n, 4), (n, 4, 4) ndarray
        Predicted to the scan.
    detections : (d,) ndarray of DETECTION
    stamp : float
        The scan's, s.
    gate_probability, most_pairs : float

    Returns
    -------
    pairs : AssignmentPairs
    cut : int
        Pairs that a limit left out.
    """
    if not len(detections):
        return AssignmentPairs.none(), 0
    factor = gaussian.gate_factor(gate_probability)
    longest = np.abs(detections["time"] - stamp).max()
    sigma = major_sigma(covariance[:, 0::2, 0::2])
    sigma = sigma + longest * major_sigma(covariance[:, 1::2, 1::2])
    radius = factor * np.hypot(sigma, detections["major_sigma"].max())
    radius += longest * np.hypot(state[:, 1], state[:, 3])
    positions = np.ascontiguousarray(detections["position"])
    centres = np.ascontiguousarray(state[:, 0::2])
    parent, row, cut = splitting.neighbours(positions, centres, radius, most_pairs)

    def distance(parent: IntArray, row: IntArray) -> FloatArray:
        of_track, found = (state[parent], covariance[parent]), rows_of(detections, row)
        return gaussian.squared_mahalanobis_distance(
            *filter_innovations(*of_track, stamp, found)[1:]
        )

    return assignment_within(parent, row, distance, factor**2), cut


class FilterFollower(PathFollower):
    """A path follower whose potential tracks have filters."""

    def fit(self, hits: RecordArray, paths: Paths) -> Fit:
        """The output of the filters."""
        assert isinstance(paths, FilterTracks)
        return Fit(*paths.output(), hits["time"] - self.stamp, hits["covariance"])


class MultipleModel(FilterFollower):
    """The multiple-model start: a filter for each cell of speed and heading, no splitting."""

    Options = MultipleModelOptions
    options: MultipleModelOptions
    operating_points = MappingProxyType(
        {
            f"{min_hits}/{window}": {"min_hits": min_hits, "window": window}
            for min_hits, window in ((8, 10), (7, 8), (6, 8), (5, 6), (5, 8), (4, 6), (3, 5))
        }
    )
    potential: MultipleModelBanks

    def configure(self, sensor: SensorModel, common: CommonOptions, options: Any) -> bool:
        """Change the options; other cells start over, as does another number of hits.

        See `Method.configure`.
        """
        before = self.options.speeds, self.options.headings
        kept = super().configure(sensor, common, options)
        if (options.speeds, options.headings) == before:
            return kept
        self.forget()
        return False

    def begin(self, observed: Observation) -> IntArray:
        """Predict the banks to the scan, and see `PathHitCounter.begin`."""
        self.potential = self.potential.predicted(observed.interval, self.options.process_noise)
        return super().begin(observed)

    def pairs(self, detections: RecordArray) -> tuple[AssignmentPairs, int]:
        """The detections in the gate of each weighted prediction, by normalised distance."""
        state, covariance = self.potential.output()
        return gated_by_filters(
            state,
            covariance,
            detections,
            self.stamp,
            self.options.gate_probability,
            self.most_pairs,
        )

    def choose(self, pairs: AssignmentPairs) -> AssignmentPairs:
        """Each track and each detection is matched once, the nearest first."""
        return nearest_first_assignment(pairs)

    def extended(
        self, parent: IntArray, ids: IntArray, detections: RecordArray
    ) -> MultipleModelBanks:
        """See `PathFollower.extended`."""
        return self.potential.extended(parent, ids).updated(self.stamp, detections)

    def started(self, ids: IntArray, detections: RecordArray) -> MultipleModelBanks:
        """A bank for each detection, carried from its time to the scan's stamp."""
        mean, velocity_covariance = multiple_model_cells(
            self.common.max_speed, self.options.speeds, self.options.headings
        )
        n, number = len(ids), len(mean)
        path = new_paths(ids, self.scan_index, self.options.min_hits)
        state, covariance = np.zeros((n, number, 4)), np.zeros((n, number, 4, 4))
        state[..., 0::2], state[..., 1::2] = detections["position"][:, None], mean
        covariance[..., 0::2, 0::2] = detections["covariance"][:, None]
        covariance[..., 1::2, 1::2] = velocity_covariance
        weight = np.full((n, number), 1.0 / number)
        tracks = MultipleModelBanks(
            path.hits, path.hit_count, path.first_scan, state, covariance, weight
        )
        elapsed = (self.stamp - detections["time"])[:, None]
        return tracks.predicted(elapsed, self.options.process_noise)

    @property
    def max_tracks(self) -> int:
        """Potential tracks kept at most: no more filters than `MAX_FILTERS`."""
        most = max(MAX_FILTERS // (self.options.speeds * self.options.headings), 1)
        return min(self.common.max_potential_tracks, most)


def multiple_model_cells(
    max_speed: float, speeds: int, headings: int
) -> tuple[FloatArray, FloatArray]:
    """Mean and covariance of the velocity in each cell of speed and heading.

    Parameters
    ----------
    max_speed : float
        m/s.
    speeds, headings : int
        Numbers of cells.

    Returns
    -------
    mean : (f, 2) ndarray
        m/s.
    covariance : (f, 2, 2) ndarray
        m^2/s^2.
    """
    width, half = max_speed / speeds, math.pi / headings
    speed = np.repeat(width * (np.arange(speeds) + 0.5), headings)
    heading = np.tile(2.0 * half * np.arange(headings), speeds)
    square = speed**2 + width**2 / 12.0
    mean = speed * math.sin(half) / half
    share = math.sin(2.0 * half) / (2.0 * half)
    along = 0.5 * square * (1.0 + share) - mean**2
    across = 0.5 * square * (1.0 - share)
    direction = np.stack([np.cos(heading), np.sin(heading)], axis=1)
    return mean[:, None] * direction, rotated_covariance(
        along, across, np.cos(heading), np.sin(heading)
    )
