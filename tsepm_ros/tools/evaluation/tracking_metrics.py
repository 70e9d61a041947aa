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
"""Distances of tracks from targets: OSPA, GOSPA with its parts, and CLEAR-MOT.

OSPA and GOSPA compare the positions at one time and know no identities; CLEAR-MOT follows the
identities from scan to scan. All have a cutoff c, m: a track farther than that is not the target's.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from tsepm_ros.numerics.arrays import FloatArray

Identity = Any
"""Name of a target or id of a track."""
ORDER = 2.0
"""p of both metrics."""


def _cut_off_distances(tracks: FloatArray, targets: FloatArray, cutoff: float) -> FloatArray:
    """Distances of tracks (n, 2) and targets (m, 2), at most the cutoff: (n, m), m."""
    offset = np.reshape(tracks, (-1, 1, 2)) - np.reshape(targets, (1, -1, 2))
    return np.asarray(np.fmin(np.hypot(offset[..., 0], offset[..., 1]), cutoff))


def ospa(tracks: FloatArray, targets: FloatArray, cutoff: float, order: float = ORDER) -> float:
    """Optimal sub-pattern assignment metric, m, at most the cutoff c.

    Schuhmacher, Vo, Vo, "A consistent metric for performance evaluation of multi-object filters",
    IEEE Trans. Signal Process. 56(8), 2008, Eq. 3. For m <= n positions x_i and y_j, else exchanged
    (0 for two empty sets)::

        d^p = 1/n ( min_pi sum_(i=1..m) min(c, |x_i - y_pi(i)|)^p + c^p (n - m) )

    Parameters
    ----------
    tracks, targets : (n, 2), (m, 2) ndarray
        Positions, m.
    cutoff : float
        c, m.
    order : float, optional
        p, at least 1.
    """
    cost = _cut_off_distances(tracks, targets, cutoff) ** order
    few, many = sorted(cost.shape)
    total = cost[linear_sum_assignment(cost)].sum() + cutoff**order * (many - few)
    return float((total / max(many, 1)) ** (1.0 / order))


@dataclass(frozen=True)
class Gospa:
    """The parts of the squared metric, m^2, which add up to it.

    Attributes
    ----------
    localisation : float
        Of the targets with a track of their own.
    missed, false : float
        Of the targets without a track, and of the tracks without a target.
    """

    localisation: float
    missed: float
    false: float

    @property
    def distance(self) -> float:
        """The metric, m."""
        return math.sqrt(self.localisation + self.missed + self.false)


def gospa(tracks: FloatArray, targets: FloatArray, cutoff: float) -> Gospa:
    """Generalised optimal sub-pattern assignment metric with alpha = 2 and p = 2.

    Rahmathullah, Garcia-Fernandez, Svensson, "Generalized optimal sub-pattern assignment metric",
    FUSION 2017, Proposition 1. Over all assignments theta of some of n tracks to as many of m
    targets::

        d^p = min_theta [ sum_(i,j in theta) |x_i - y_j|^p + c^p / 2 (n + m - 2 |theta|) ]

    Parameters
    ----------
    tracks, targets : (n, 2), (m, 2) ndarray
        Positions, m.
    cutoff : float
        c, m.
    """
    # At the cutoff a pair costs as much as a track and a target that are left alone.
    cost = _cut_off_distances(tracks, targets, cutoff) ** ORDER
    pairs = cost[linear_sum_assignment(cost)]
    own = pairs[pairs < cutoff**ORDER]
    alone = 0.5 * cutoff**ORDER
    return Gospa(
        float(own.sum()),
        alone * (cost.shape[1] - len(own)),
        alone * (cost.shape[0] - len(own)),
    )


@dataclass(frozen=True)
class ClearMotCounts:
    """Counts of CLEAR-MOT in one scan, or summed over scans.

    Attributes
    ----------
    targets, matches, misses, false, switches : int
        Targets g, those with a track c and those without m, tracks without a target fp, and
        targets with another track than before mme.
    distance : float
        Sum of the distances of the matched pairs, m.
    """

    targets: int = 0
    matches: int = 0
    misses: int = 0
    false: int = 0
    switches: int = 0
    distance: float = 0.0

    @classmethod
    def total(cls, counts: Iterable[ClearMotCounts]) -> ClearMotCounts:
        """Sum of the counts of scans."""
        return cls(*map(sum, zip(*(vars(count).values() for count in counts), strict=True)))

    @property
    def right(self) -> int:
        """Targets less errors: MOTA times the targets."""
        return self.targets - self.misses - self.false - self.switches

    @property
    def mota(self) -> float:
        """Accuracy, ``1 - sum (m + fp + mme) / sum g``; nan without targets."""
        return self.right / self.targets if self.targets else math.nan

    @property
    def motp(self) -> float:
        """Precision, ``sum d / sum c``, m: smaller is better; nan without matches."""
        return self.distance / self.matches if self.matches else math.nan


@dataclass
class ClearMot:
    """Matches of tracks and targets by CLEAR-MOT: a target keeps its track within the gate.

    Bernardin, Stiefelhagen, "Evaluating multiple object tracking performance: the CLEAR MOT
    metrics", EURASIP J. Image Video Process. 2008, 246309, Section 2.1. The other targets and
    tracks are matched one to one, as many as the gate allows, with the least sum of distances. A
    target that gets another track than its last one is an identity switch, also after a pause.

    Attributes
    ----------
    gate : float
        Largest distance of a match, m.
    last, now : dict
        Track of each target: the last one, and that in the last scan.
    matches : dict
        Track of each target scan by scan; None without a track.
    switches : int
    """

    gate: float
    last: dict[Identity, Identity] = field(default_factory=dict)
    now: dict[Identity, Identity] = field(default_factory=dict)
    matches: dict[Identity, list[Identity | None]] = field(default_factory=dict)
    switches: int = 0

    def take(
        self, targets: Mapping[Any, FloatArray], tracks: Mapping[Any, FloatArray]
    ) -> ClearMotCounts:
        """Take a scan: positions (2,), m, of the targets that are there and of the tracks."""
        beyond = self.gate * (1.0 + len(tracks) + len(targets))  # costs more than all other pairs
        distance = _cut_off_distances(
            np.array([*targets.values()]), np.array([*tracks.values()]), beyond
        )
        rows, columns = (
            {name: place for place, name in enumerate(names)} for names in (targets, tracks)
        )
        self.now, before = {}, self.now
        for target in sorted(targets, key=lambda target: target not in before):
            track = self.last.get(target)
            free = track is not None and track in tracks and track not in self.now.values()
            if free and distance[rows[target], columns[track]] <= self.gate:
                self.now[target] = track
        alone = [target for target in targets if target not in self.now]
        others = [track for track in tracks if track not in self.now.values()]
        part = distance[np.ix_([rows[name] for name in alone], [columns[name] for name in others])]
        pairs = linear_sum_assignment(np.where(part <= self.gate, part, beyond))
        for row, column in zip(*pairs, strict=True):
            if part[row, column] <= self.gate:
                self.now[alone[row]] = others[column]
        switches = sum(self.last.get(target, track) != track for target, track in self.now.items())
        for target in targets:
            self.matches.setdefault(target, []).append(self.now.get(target))
        self.last |= self.now
        self.switches += switches
        matched = len(self.now)
        return ClearMotCounts(
            targets=len(targets),
            matches=matched,
            misses=len(targets) - matched,
            false=len(tracks) - matched,
            switches=switches,
            distance=sum(float(distance[rows[t], columns[k]]) for t, k in self.now.items()),
        )
