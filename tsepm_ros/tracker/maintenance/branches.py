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
"""Branches of confirmed tracks: which detections are the target's, as far as that is open.

A confirmed track is a few hypotheses, as a tentative track is (track splitting with existence:
Musicki, La Scala, Evans, "Integrated track splitting filter", IEEE Trans. Aerosp. Electron. Syst.
43(4), 2007). With w the weight of a branch, L and b as in `data_association` for it, a scan goes
through::

    split         by the detections in its gate that are assigned to the track, or to none
    evaluate      hit: w L;  miss: w b
    prune         the `MOST_BRANCHES` best that are above `RELATIVE_WEIGHT` of the best

and the sum of what is left is the likelihood ratio Lambda of the scan. Each branch has the modes of
`motion.InteractingModels`, weighted by their likelihoods (Musicki, Suvorova, "Tracking in clutter
using IMM-IPDA-based algorithms", IEEE Trans. Aerosp. Electron. Syst. 44(1), 2008), and the chain
of seen and faded of `evaluation`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.numerics.arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    Rows,
    replaced,
    run_starts,
)
from tsepm_ros.tracker import motion, splitting
from tsepm_ros.tracker.evaluation import (
    FADED_AT_START,
    fading_after_hit,
    fading_after_miss,
    fading_predicted,
    visible_share,
)
from tsepm_ros.tracker.hypotheses import ExpectedDetections, States
from tsepm_ros.tracker.maintenance.data_association import Pairs
from tsepm_ros.tracker.maintenance.stationary import StraightFits, change_odds
from tsepm_ros.tracker.motion import InteractingModels
from tsepm_ros.tracker.options import GATE_PROBABILITY
from tsepm_ros.tracker.sensor import SensorModel

MOST_BRANCHES = 4
"""Branches of a track: a choice."""
RELATIVE_WEIGHT = -7.0
"""Logarithm of the part of the best weight below which a branch is pruned: a choice."""


@dataclass(frozen=True, eq=False)
class Branches(Rows):
    """The branches of n tracks: m rows, those of a track together, the best first.

    Rows that are taken or joined are those of tracks.

    Attributes
    ----------
    number : (n,) ndarray of int
        Branches of each track, one at least.
    log_weight : (m,) ndarray
        Of sum 1 over each track.
    faded : (m, s) ndarray
        Probability that the target has faded for each sensor.
    models : InteractingModels
        (m,) of two modes.
    """

    number: IntArray
    log_weight: FloatArray
    faded: FloatArray
    models: InteractingModels

    @classmethod
    def from_states(cls, state: FloatArray, covariance: FloatArray, sensors: int = 1) -> Branches:
        """A branch each, with states (n, 4) and covariances (n, 4, 4)."""
        n, models = len(state), InteractingModels.from_states(state, covariance)
        faded = np.full((n, sensors), FADED_AT_START)
        return cls(np.ones(n, np.int64), np.zeros(n), faded, models)

    def __getitem__(self, rows: NDArray[np.generic] | slice) -> Branches:
        """The branches of the given tracks."""
        tracks = np.arange(len(self.number))[rows]
        number = self.number[tracks]
        after = np.cumsum(number)
        row = (self.first[tracks] - after + number).repeat(number) + np.arange(number.sum())
        return Branches(number, self.log_weight[row], self.faded[row], self.models[row])

    @property
    def first(self) -> IntArray:
        """Row of the best branch of each track, (n,)."""
        return np.cumsum(self.number) - self.number

    def mean(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Mean (n, 4) over branches and modes; weights (2 m,) and deviations (2 m, 4) of these."""
        first, modes = 2 * self.first, 2 * self.number
        state = self.models.state.reshape(-1, 4)
        weight = (np.exp(self.log_weight)[:, None] * self.models.probability).ravel()
        # Exact where the alternatives are equal.
        difference = state - state[first].repeat(modes, axis=0)
        mean = np.add.reduceat(weight[:, None] * difference, first)
        return state[first] + mean, weight, difference - mean.repeat(modes, axis=0)

    def combined(self) -> tuple[FloatArray, FloatArray]:
        """Mean (n, 4) and covariance (n, 4, 4) over branches and modes."""
        mean, weight, deviation = self.mean()
        second_moments = deviation[:, :, None] * deviation[:, None]
        second_moments += self.models.covariance.reshape(-1, 4, 4)
        second_moments *= weight[:, None, None]
        return mean, np.add.reduceat(second_moments, 2 * self.first)

    def predicted(self, elapsed: FloatArray, max_speed: float, process_noise: float) -> Branches:
        """The branches after times (n,), s."""
        elapsed = elapsed.repeat(self.number)
        return replaced(self, models=self.models.predicted(elapsed, max_speed, process_noise))

    def fading(self, counts: BoolArray, sensor: int = 0, steps: float = 1.0) -> Branches:
        """The branches before a scan, which may find targets faded where it counts, (n,)."""
        faded, counts = self.faded.copy(), counts.repeat(self.number)
        faded[counts, sensor] = fading_predicted(faded[counts, sensor], steps)
        return replaced(self, faded=faded)


class Gated(NamedTuple):
    """Detections in the gates of the branches and the straight fits of n tracks.

    Attributes
    ----------
    track : (m,) ndarray of int
        Of each branch.
    expected : ExpectedDetections
        Of the modes of all branches, then of the fits: (2 m + n).
    parent, row : (q,) ndarray of int
        Rows of these, and detection, of each pair.
    likelihood : (q,) ndarray
        N(z; H x, S), 1/m^2, times that of a range rate, s/m.
    """

    track: IntArray
    expected: ExpectedDetections
    parent: IntArray
    row: IntArray
    likelihood: FloatArray

    def innovations(self, track: IntArray, row: IntArray) -> tuple[FloatArray, FloatArray]:
        """Those of pairs (p,) of a track and a detection, and their covariances.

        Of the best branch, between turns.
        """
        best = np.searchsorted(self.track, track)
        return self.expected.innovations(2 * best, row)

    @property
    def of_fits(self) -> BoolArray:
        """Which pairs (q,) are of a straight fit."""
        return np.asarray(self.parent >= 2 * len(self.track))

    @property
    def track_of_pair(self) -> IntArray:
        """Track of each pair, (q,)."""
        fits = np.arange(len(self.expected.hypotheses.state) - 2 * len(self.track))
        return np.append(self.track.repeat(2), fits)[self.parent]

    def weights(self, branches: Branches) -> FloatArray:
        """Weight of the branch and mode of each pair, (q,); 1 for a straight fit."""
        weight = np.exp(branches.log_weight)[:, None] * branches.models.probability
        number = len(self.expected.hypotheses.state) - weight.size
        return np.append(weight, np.ones(number))[self.parent]


def gate(
    branches: Branches,
    fits: StraightFits,
    stamp: float,
    detections: NDArray[np.void],
    sensor: SensorModel,
) -> Gated:
    """Gate a scan's detections, as for a tentative track.

    Parameters
    ----------
    branches : Branches
        Of n tracks, predicted to the scan.
    fits : StraightFits
    stamp : float
        s.
    detections : (d,) ndarray of DETECTION
    sensor : SensorModel
    """
    track = np.arange(len(branches.number)).repeat(branches.number)
    states = States(
        np.concatenate([branches.models.state.reshape(-1, 4), fits.state]),
        np.concatenate([branches.models.covariance.reshape(-1, 4, 4), fits.covariance]),
    )
    expected = ExpectedDetections.from_hypotheses(states, stamp, detections, sensor)
    parent, row, _ = splitting.split(expected, GATE_PROBABILITY)
    likelihood = np.exp(expected.log_likelihood(parent, row, GATE_PROBABILITY))
    inside = (likelihood > 0.0).nonzero()[0]
    return Gated(track, expected, parent[inside], row[inside], likelihood[inside])


@dataclass(frozen=True, eq=False)
class Evaluated:
    """Likelihood ratios of a scan for the branches of n tracks.

    Attributes
    ----------
    gated : Gated
    detectable : (m,) ndarray
        P_D of the target of each branch.
    branch, row : (p,) ndarray of int
        Pairs of a branch and a detection.
    of_modes : (p, 2) ndarray
        mu_m L of each mode of a pair.
    ratio : (p,) ndarray
        L of each pair.
    empty : (m,) ndarray
        The b of each branch.
    fit : Pairs
        Tracks whose straight fit has detections in its gate.
    """

    gated: Gated
    detectable: FloatArray
    branch: IntArray
    row: IntArray
    of_modes: FloatArray
    ratio: FloatArray
    empty: FloatArray
    fit: Pairs

    def of_tracks(self, branches: Branches, number: int) -> tuple[FloatArray, Pairs]:
        """b_i (n,), and the pairs of tracks and a number of detections, over their branches."""
        track, weight = self.gated.track, np.exp(branches.log_weight)
        empty = np.add.reduceat(weight * self.empty, branches.first)
        ratio = weight[self.branch] * self.ratio
        return empty, Pairs.summed(track[self.branch], self.row, ratio, number)


def evaluate(
    branches: Branches,
    gated: Gated,
    detectable: FloatArray,
    detection_probability: float,
    clutter: FloatArray,
    sensor: int = 0,
) -> Evaluated:
    """Evaluate the branches of n tracks by the detections in their gates.

    Parameters
    ----------
    branches : Branches
    gated : Gated
    detectable : (n,) ndarray
        P_D of a seen target in each track's place.
    detection_probability : float
        P_D where there is a detection, wherever the data sheet ends the coverage.
    clutter : (d,) ndarray
        lambda, 1/m^2.
    sensor : int, optional
        Number of the sensor that looked.
    """
    track, _, parent, row, likelihood = gated
    visible = visible_share(branches.faded[:, sensor])
    ratio = likelihood * detection_probability / clutter[row]
    m = len(track)
    of_branch = np.searchsorted(parent, 2 * m)  # the fits come last
    branch, mode = np.divmod(parent[:of_branch], 2)
    weight = branches.models.probability[branch, mode] * visible[branch] * ratio[:of_branch]
    key = branch * len(clutter) + row[:of_branch]
    order = key.argsort(kind="stable")
    first = run_starts(key[order])
    of_modes = np.add.reduceat((weight[:, None] * (mode[:, None] == (0, 1)))[order], first)
    fit = Pairs(parent[of_branch:] - 2 * m, row[of_branch:], ratio[of_branch:])
    detectable = detectable[track] * visible
    empty = 1.0 - detectable * GATE_PROBABILITY
    pairs = branch[order[first]], row[order[first]]
    return Evaluated(gated, detectable, *pairs, of_modes, of_modes.sum(axis=1), empty, fit)


def best_branches(track: IntArray, score: FloatArray) -> tuple[IntArray, IntArray]:
    """Rows of the branches that are kept, the best of a track first, and their number in each.

    Parameters
    ----------
    track : (m,) ndarray of int
        Of each branch: each track has some.
    score : (m,) ndarray
        Logarithm of its weight.
    """
    order = np.lexsort((-score, track))
    score, first = score[order], run_starts(track[order])
    number = np.append(first[1:], len(order))[: len(first)] - first
    kept = score > (score[first] + RELATIVE_WEIGHT).repeat(number)
    kept &= np.arange(len(order)) < (first + MOST_BRANCHES).repeat(number)
    return order[kept], np.add.reduceat(kept, first, dtype=np.int64)


def split(
    branches: Branches,
    evaluated: Evaluated,
    owner: IntArray,
    max_speed: FloatArray,
    sensor: int = 0,
) -> tuple[Branches, FloatArray, Pairs]:
    """Split the branches, and prune them.

    Parameters
    ----------
    branches : Branches
        Predicted to the scan.
    evaluated : Evaluated
    owner : (d,) ndarray of int
        Track to which each detection is assigned; -1 for none.
    max_speed : (n,) ndarray
        v_max, m/s: a mode whose mean is faster is conditioned on it; see `motion.slowed`.
    sensor : int, optional
        Number of the sensor that looked.

    Returns
    -------
    branches : Branches
    ratio : (n,) ndarray
        Lambda_i.
    pairs : Pairs
        Tracks and detections, with the weight of the branches that took these in place of L.
    """
    gated, m = evaluated.gated, len(evaluated.gated.track)
    of_pair, owner_of_pair = gated.track[evaluated.branch], owner[evaluated.row]
    may = ((owner_of_pair < 0) | (owner_of_pair == of_pair)).nonzero()[0]
    parent = np.append(np.arange(m), evaluated.branch[may])
    row = np.append(np.full(m, -1), evaluated.row[may])
    with np.errstate(divide="ignore"):
        increment = np.log(np.append(evaluated.empty, evaluated.ratio[may]))
    score = branches.log_weight[parent] + increment
    kept, number = best_branches(gated.track[parent], score)
    parent, row, score = parent[kept], row[kept], score[kept]
    first = np.cumsum(number) - number
    ratio = np.exp(score - score[first].repeat(number))
    total = score[first] + np.log(np.add.reduceat(ratio, first))
    # States: those of a miss stay; the others are updated, in both modes.
    probability, state, covariance = vars(branches.models[parent]).values()
    of_sensors = branches.faded[parent]
    faded = of_sensors[:, sensor]
    hit = (row >= 0).nonzero()[0]
    missed = fading_after_miss(faded, evaluated.detectable[parent], GATE_PROBABILITY)
    of_sensors[:, sensor] = np.where(row >= 0, fading_after_hit(faded), missed)
    if len(hit):
        modes = (2 * parent[hit, None] + np.arange(2)).ravel()
        updated = gated.expected.updated(modes, row[hit].repeat(2))
        state[hit], covariance[hit] = (
            values.reshape(len(hit), 2, *values.shape[1:]) for values in updated
        )
        of_modes = evaluated.of_modes[may[kept[hit] - m]]
        probability[hit] = of_modes / of_modes.sum(axis=1, keepdims=True)
    state, covariance = motion.slowed(
        state.reshape(-1, 4), covariance.reshape(-1, 4, 4), max_speed.repeat(2 * number)
    )
    weight = score - total.repeat(number)
    own = gated.track[parent[hit]], row[hit], np.exp(weight[hit])
    after = Branches(
        number,
        weight,
        of_sensors,
        InteractingModels(probability, state.reshape(-1, 2, 4), covariance.reshape(-1, 2, 4, 4)),
    )
    return after, np.exp(total), Pairs.summed(*own, len(owner))


def straight_fits(
    fits: StraightFits,
    evaluated: Evaluated,
    owner: IntArray,
    empty: FloatArray,
    of_filter: FloatArray,
) -> StraightFits:
    """Straight fits of n tracks after a scan, of which Lambda is the total of b and L.

    Each by the detection that fits it best, of those that are assigned to its track, or to none:
    ``x + beta d``, ``P + beta (P_j - P) + beta (1 - beta) d d'`` with the change d of the state,
    its covariance P_j, and ``beta = L / (b + L)``.

    Parameters
    ----------
    fits : StraightFits
        As predicted.
    evaluated : Evaluated
    owner : (d,) ndarray of int
        Track to which each detection is assigned; -1 for none.
    empty, of_filter : (n,) ndarray
        b_i, and Lambda of the branches.
    """
    track, row, ratio = evaluated.fit
    order = np.lexsort((-ratio, track))
    order = order[(owner[row[order]] < 0) | (owner[row[order]] == track[order])]
    best = order[run_starts(track[order])]
    state, covariance, total = fits.state.copy(), fits.covariance.copy(), empty.copy()
    if not len(best):
        return replaced(fits, change_odds=change_odds(fits.change_odds, of_filter, total))
    track, row, ratio = track[best], row[best], ratio[best]
    total[track] += ratio
    beta = (ratio / total[track])[:, None]
    moved, narrowed = evaluated.gated.expected.updated(2 * len(evaluated.gated.track) + track, row)
    change = moved - state[track]
    spread = (1.0 - beta[..., None]) * change[:, :, None] * change[:, None]
    state[track] += beta * change
    covariance[track] += beta[..., None] * (narrowed - covariance[track] + spread)
    odds = change_odds(fits.change_odds, of_filter, total)
    return replaced(fits, state=state, covariance=covariance, change_odds=odds)
