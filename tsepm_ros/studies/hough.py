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
"""The Hough transform, and its modification for hits in time.

Lines through the detections of a window of scans: Smith, Winter, "Feature space transform for
multitarget detection", IEEE CDC 1980, and Carlson, Evans, Wilson, "Search radar detection and track
with the Hough transform", IEEE Trans. AES 30(1), 1994, as Sequential 2014, Sections 1 and 3.3
describes it.

The scans of the window are one image. A detection at (x, y) is the curve ::

    rho(theta) = x cos(theta) + y sin(theta)

in a plane of cells of theta and rho, and a line is a cell that many curves go through. The method
"only determines if there is a line": the state is the least-squares fit to the line's detections.

Readings
--------
- The detections of one scan in a cell are one vote, since a target is detected once; M votes of N
  scans are a line. Of these detections the one nearest to the middle of the cell is the hit. The
  other reading counts detections, which in clutter counts little else.
- The image is of the last N scans, and moves on by one (Section 1). Only lines with a detection in
  the newest scan are evaluated: the others were evaluated before.
- rho counts from the sensor's last position.
- Of lines that share a detection the one of the most votes, and of these the best fit (f_1 of TSEPM
  2018, Eq. 23), is published, and its detections leave the image.
- Time plays no part in a line. A fit faster than v_max is refused: that limit holds in all methods.

Lines through hits that follow each other in time, the modified transform: Lo, Leung, Bridgewater,
Litva, "Multitarget track initiation using a modified Hough transform", AGARD CP-539, 1994, and
Leung, Hu, Blanchette, "Evaluation of multiple target track initiation techniques in real radar
tracking environments", IEE Proc. RSN 143(4), 1996: the references of Sequential 2014, which names
the method without printing it.

A detection at (x, y) is the curve ``rho(theta) = x cos(theta) + y sin(theta)``. The curves of two
detections cross where their difference passes through zero, at the theta of the line through
both, and the difference's slope there is in size their distance and in sign the direction from
the one to the other. Detections of consecutive scans are a track if

- zero crossings that follow each other lie within an angle sigma_theta: one line,
- the slopes have one sign: in the order of the scans,
- the slopes lie within the limits of the speed: ``v_min T <= |slope| <= v_max T``.

By the first two, the directions of two displacements, over the full circle, differ by sigma_theta
at most, and this is how it is computed here: no accumulator, and so no cells, are needed, since
displacements that follow each other share a point and a common theta makes rho common.

Readings
--------
- T is the time between the detections, M of N scans are enough, and a track with a detection that
  satisfies the rules keeps no branch without it.
- Every detection that satisfies them makes a potential track; every detection may be a first one.
- `gate_sigmas` widens the limit of the speed by the last hit's error; 0 as in the literature.
- Of confirmed tracks that share a detection the best fit (f_1 of TSEPM 2018, Eq. 23) is published.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tsepm_ros.methods.tsepm import Estimates
from tsepm_ros.numerics.arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    RecordArray,
    rows_of_least_cost,
)
from tsepm_ros.parameters import parameter
from tsepm_ros.studies.assignment import AssignmentPairs
from tsepm_ros.studies.path_following import (
    PathFollower,
    PathHitCounter,
    StepLimitOptions,
    labelled_operating_points,
)
from tsepm_ros.tracker.initial_state import NO_HIT, Paths, new_paths
from tsepm_ros.tracker.method import Method, MethodResult, ScanStatistics
from tsepm_ros.tracker.observation import Observation
from tsepm_ros.tracker.options import MnOptions, hits_option, window_option
from tsepm_ros.tracker.tracks import TrackArrays

MAX_VOTES = 5_000_000
"""Curves times angles of an image, at most: bounds time and memory."""


@dataclass(frozen=True, kw_only=True)
class HoughOptions(MnOptions):
    """Options of the Hough transform."""

    min_hits: int = hits_option(6, meaning="Scans with a detection on a line that confirm it (M)")
    window: int = window_option(8, meaning="Scans of the image (N)")
    angles: int = parameter(45, "Cells of theta, over half a turn", minimum=2, maximum=1000)
    cell: float = parameter(300.0, "Size of a cell of rho", unit="m", minimum=0.1, maximum=1e6)


class Hough(PathHitCounter):
    """The Hough transform: straight lines in the image of the last scans."""

    Options = HoughOptions
    options: HoughOptions
    operating_points = labelled_operating_points(
        "{}/{}, {:g} m",
        ("min_hits", "window", "cell"),
        (
            (9, 10, 300.0),
            (8, 10, 300.0),
            (7, 8, 300.0),
            (6, 8, 300.0),
            (6, 8, 150.0),
            (5, 8, 300.0),
            (4, 6, 300.0),
        ),
    )

    def forget(self) -> None:
        """See `Method.forget`."""
        super().forget()
        self._image = np.zeros(0, np.int64)  # ids of the detections in the image, ascending

    configure = Method.configure  # the image stays

    def step(self, observed: Observation) -> MethodResult:
        """Move the image on by a scan and confirm its lines.

        See `Method.step`.
        """
        ids = self.begin(observed)
        image = np.concatenate([self._image, ids])
        ended = image < self.detections.first_id  # older than N scans
        limit = min(self.common.max_potential_tracks, MAX_VOTES // self.options.angles)
        beyond = max(int(np.count_nonzero(~ended)) - limit, 0)
        image = image[~ended][-limit:]
        lines = self._lines(image, self.options.min_hits, observed.sensor_position)
        votes = -lines.hit_count.astype(float)
        kept = lines[rows_of_least_cost(votes, self.common.max_potential_tracks)]
        tracks, hits, refused = self.confirm(kept)
        self._image = image[~np.isin(image, hits)]
        return MethodResult(
            tracks,
            ScanStatistics(
                scans=1,
                detections=len(ids),
                potential_tracks=len(self._image),
                started=len(ids),
                split=len(ids),
                evaluated=len(kept),
                terminated=int(np.count_nonzero(ended)),
                raw_confirmations=len(lines),
                pruned=refused,
                merged=len(kept) - refused - len(tracks),
                confirmed=len(tracks),
                cut_potential_tracks=beyond,
                cut_confirmations=len(lines) - len(kept),
            ),
        )

    def potential_tracks(self, observed: Observation) -> TrackArrays:
        """Lines of fewer votes through the last scan that share no detection.

        See `Method.potential_tracks`.
        """
        lines = self._lines(self._image, 2, observed.sensor_position)
        lines = lines[
            rows_of_least_cost(-lines.hit_count.astype(float), self.common.max_potential_tracks)
        ]
        return self.confirm(lines)[0]

    def _lines(self, image: IntArray, votes: int, sensor: FloatArray) -> Paths:
        """Lines through a detection of the last scan that have at least so many votes.

        Parameters
        ----------
        image : (d,) ndarray of int
            Ids of the detections of the image.
        votes : int
        sensor : (2,) ndarray
            Position of the sensor, m.
        """
        detections = self.detections[image]
        cell, from_middle = self._cells(detections["position"] - sensor)
        scan = detections["scan"]
        cells = np.unique(cell[scan == self.scan_index])
        if not len(cells):
            return new_paths(cells, self.scan_index, 2)
        line = np.minimum(np.searchsorted(cells, cell), len(cells) - 1)
        detection, angle = np.nonzero(cells[line] == cell)
        line, from_middle = line[detection, angle], from_middle[detection, angle]
        order = np.lexsort((from_middle, scan[detection], line))
        line, detection = line[order], detection[order]
        new = np.diff(line, prepend=-1) != 0
        new |= np.diff(scan[detection], prepend=-1) != 0
        line, detection = line[new], detection[new]
        counts = np.bincount(line, minlength=len(cells))
        number = np.arange(len(line)) - (np.cumsum(counts) - counts)[line]
        hits = np.full((len(cells), int(counts.max(initial=2))), NO_HIT, np.int64)
        hits[line, number] = image[detection]
        first = np.zeros(len(cells), np.int64)
        first[line[number == 0]] = scan[detection[number == 0]]
        return Paths(hits, counts, first)[counts >= votes]

    def _cells(self, offset: FloatArray) -> tuple[IntArray, FloatArray]:
        """Cells that the curves go through, and how far from their middles.

        Parameters
        ----------
        offset : (d, 2) ndarray
            Detections relative to the sensor, m.

        Returns
        -------
        cell : (d, angles) ndarray of int
            A number for each cell of theta and rho.
        from_middle : (d, angles) ndarray
            m.
        """
        number, size = self.options.angles, self.options.cell
        theta = math.pi / number * np.arange(number)
        rho = offset @ np.stack([np.cos(theta), np.sin(theta)])
        cell = np.floor(rho / size)
        return cell.astype(np.int64) * number + np.arange(number), np.abs(rho - (cell + 0.5) * size)

    def accept(self, estimates: Estimates) -> BoolArray:
        """Which tracks have a state, and are no faster than v_max, (n,)."""
        speed = np.hypot(estimates.state[:, 1], estimates.state[:, 3])
        return super().accept(estimates) & (speed <= self.common.max_speed)

    def preference(self, estimates: Estimates) -> FloatArray:
        """More votes first, then the better fit."""
        hits = (estimates.hits != NO_HIT).sum(axis=1)
        rank = np.empty(len(hits))
        rank[np.lexsort((estimates.evaluation, -hits))] = np.arange(len(hits))
        return rank


@dataclass(frozen=True, kw_only=True)
class ModifiedHoughOptions(StepLimitOptions):
    """Options of the modified Hough transform."""

    min_hits: int = hits_option(4, minimum=3)
    window: int = window_option(5, minimum=3)
    max_turn: float = parameter(
        0.5,
        "Maximum angle between consecutive zero crossings (sigma_theta)",
        unit="rad",
        positive=True,
        maximum=math.pi / 2,
    )


class ModifiedHough(PathFollower):
    """The modified Hough transform: one line, in the order of the scans, at a possible speed."""

    Options = ModifiedHoughOptions
    options: ModifiedHoughOptions
    operating_points = labelled_operating_points(
        "{}/{}, {:g} rad, {:g} sigma",
        ("min_hits", "window", "max_turn", "gate_sigmas"),
        (
            (4, 5, 0.5, 0.0),
            (3, 4, 0.5, 0.0),
            (4, 5, 0.5, 2.0),
            (4, 5, 1.0, 2.0),
            (3, 4, 0.5, 2.0),
            (3, 4, 1.0, 2.0),
        ),
    )
    every_detection_starts = True

    def pairs(self, detections: RecordArray) -> tuple[AssignmentPairs, int]:
        """The detections that satisfy the rules after each track's last hits, by the turn."""
        options = self.options
        parent, row, displacements, first, cut = self.displacements(detections, options.gate_sigmas)
        turn = np.where(first, 0.0, displacements.turn)
        kept = displacements.faster_than(options.min_step_speed) & (turn <= options.max_turn)
        return AssignmentPairs(parent[kept], row[kept], turn[kept]), cut

    def choose(self, pairs: AssignmentPairs) -> AssignmentPairs:
        """All pairs: each detection that satisfies the rules makes a potential track."""
        return pairs
