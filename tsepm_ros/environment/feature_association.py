"""What surrounds the targets, and what it changes in the association (Environment 2018).

Shen Y., "The target tracking algorithm based on environment technology", ICOI 2018. In a clutter
zone, and where targets meet, a track takes only plots whose features resemble those of its own. The
clutter that does so is thinner than all clutter: its density counts with the share of the latest
clutter that resembles the track. Where plots may be several meeting targets', each goes to one, by
its distance in position and features.

Both are tests of a fixed size, not ratios of densities: what distribution the features of clutter
have need not be known.

Readings
--------
- Resemblance is the normalised distance of `sensing.plot_features`, not the printed decision
  function (Eqs. 10 and 11), for which no threshold fits two tracks.
- A clutter zone is where the estimated density is several times its mean over the coverage
  (`clutter_map.ClutterMap.in_zone`). The source asks for a cell's count and its neighbours' above
  thresholds that it does not give.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from tsepm_ros.environment import encounters
from tsepm_ros.kinematics.track import TrackArrays
from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from tsepm_ros.sensing.plot_features import NAMES, Histories
from tsepm_ros.stages.association import Pairs, nearest_first

MAX_CLUTTER_PLOTS = 200
"""Plots that tell the features of clutter, the latest."""
MEMORY = 64
"""Scans whose plots a new track may have as hits."""


@dataclass(frozen=True)
class Environment:
    """The surroundings in one scan.

    Attributes
    ----------
    in_zone : (d,) ndarray of bool
        Which of the scan's detections are in a clutter zone.
    clutter : (m, 3) ndarray
        Features of the latest plots that are probably clutter.
    encounter_time : float
        Time before and after it for which targets meet, s.
    """

    in_zone: BoolArray
    clutter: FloatArray
    encounter_time: float

    def meeting(
        self, state: FloatArray, covariance: FloatArray, error: FloatArray, gate: float
    ) -> BoolArray:
        """Which pairs of targets meet, (n, n); see `encounters.meeting`."""
        one, two = encounters.meeting(state, covariance, error, gate, self.encounter_time)
        pairs = np.zeros((len(state), len(state)), bool)
        pairs[one, two] = pairs[two, one] = True
        return pairs

    def factors(
        self,
        histories: Histories,
        meets: BoolArray,
        pairs: Pairs,
        features: FloatArray,
    ) -> FloatArray:
        """Factor of the likelihood ratio of each pair of a track and a detection, (p,).

        Parameters
        ----------
        histories : Histories
            Of the n tracks.
        meets : (n, n) ndarray of bool
            Which of them meet.
        pairs : Pairs
            Their cost is a squared distance in position; infinite outside the gate.
        features : (d, 3) ndarray
            Of the scan's detections.

        Returns
        -------
        (p,) ndarray
            1 where nothing is special; else 0, or 1 over the share of clutter that resembles the
            track.
        """
        factors = np.ones(len(pairs))
        in_encounter: BoolArray = np.asarray(meets.any(axis=1))
        rows = np.flatnonzero(self.in_zone[pairs.row] | in_encounter[pairs.parent])
        if not len(rows):
            return factors
        some = pairs[rows]
        own, found = histories[some.parent], features[some.row]
        alike = own.resembled_by(found)
        factors[rows] = alike / self._share(histories, some.parent)
        fits = np.flatnonzero(alike & np.isfinite(some.cost) & ~self.in_zone[some.row])
        fits = fits[_contested(some[fits], meets)]
        cost = some.cost[fits] + own[fits].dissimilarity(found[fits])
        candidates = Pairs(some.parent[fits], some.row[fits], cost)
        lost = ~np.isin(
            _names(candidates, len(features)), _names(nearest_first(candidates), len(features))
        )
        factors[rows[fits[lost]]] = 0.0
        return factors

    def _share(self, histories: Histories, parent: IntArray) -> FloatArray:
        """Share of clutter that resembles the tracks (p,), one plot more counted as if it did."""
        tracks, place = np.unique(parent, return_inverse=True)
        m = len(self.clutter)
        repeated = histories[np.repeat(tracks, m)]
        alike = repeated.resembled_by(np.tile(self.clutter, (len(tracks), 1)))
        share = (1.0 + alike.reshape(len(tracks), m).sum(axis=1)) / (1.0 + m)
        return np.asarray(share[place.ravel()])


def _names(pairs: Pairs, detections: int) -> IntArray:
    """A number for each pair that no other has."""
    return np.asarray(pairs.parent * detections + pairs.row)


def _contested(pairs: Pairs, meets: BoolArray) -> BoolArray:
    """Which pairs' detection may also be that of a track that meets theirs, (p,)."""
    several = np.flatnonzero(np.bincount(pairs.row)[pairs.row] > 1)
    parent, row = pairs.parent[several], pairs.row[several]
    contested = np.zeros(len(pairs), bool)
    rivals = (row[:, None] == row) & meets[parent[:, None], parent]
    contested[several] = rivals.any(axis=1)
    return contested


class Surroundings:
    """What the scans so far tell of plots' features."""

    def __init__(self) -> None:
        self._first_scan = 0
        self._features: deque[FloatArray] = deque(maxlen=MEMORY)  # by index in the whole scan
        self._clutter = np.zeros((0, len(NAMES)))

    def at(self, in_zone: BoolArray, encounter_time: float) -> Environment:
        """The environment of a scan, of whose detections (d,) some are in a clutter zone."""
        return Environment(in_zone, self._clutter, encounter_time)

    def observe(
        self, scan_index: int, index: IntArray, features: FloatArray, clutter: BoolArray
    ) -> None:
        """Take what a scan tells, after its association.

        Scans come one by one; after a gap what was before is forgotten.

        Parameters
        ----------
        scan_index : int
        index : (d,) ndarray of int
            Of the detections in the coverage, within the whole scan: hits are named by it.
        features : (d, 3) ndarray
        clutter : (d,) ndarray of bool
            Which of them are probably clutter.
        """
        if scan_index != self._first_scan + len(self._features):
            self._features.clear()
        whole = np.full((int(index.max(initial=-1)) + 1, len(NAMES)), np.nan)
        whole[index] = features
        self._features.append(whole)
        self._first_scan = scan_index + 1 - len(self._features)
        has = np.isfinite(features).any(axis=1)
        known = np.concatenate([self._clutter, features[clutter & has]])
        self._clutter = known[-MAX_CLUTTER_PLOTS:]

    def histories(self, tracks: TrackArrays) -> Histories:
        """Features of the hits of tracks, as far as their scans are remembered."""
        most = max((len(hits) for hits in tracks.hits), default=0)
        features = np.full((len(tracks), most, len(NAMES)), np.nan)
        for row, hits in enumerate(tracks.hits):
            for place, (scan, index) in enumerate(hits):
                back = scan - self._first_scan
                if 0 <= back < len(self._features):
                    features[row, place] = self._features[back][index]
        return Histories.of(features)
