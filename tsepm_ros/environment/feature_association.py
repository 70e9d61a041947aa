"""Association by plot features in clutter zones and encounters (Environment 2018).

Shen Y., "The target tracking algorithm based on environment technology", ICOI 2018. In a clutter
zone, and in an encounter, a track accepts only plots whose features resemble those of its own. The
clutter density is multiplied by the fraction of recent clutter that resembles the track. A plot in
the gates of several tracks in an encounter is assigned to a single track, by its distance in
position and features.

Both are tests of a fixed size, not ratios of densities: they need no distribution of the features
of clutter.

Readings
--------
- Resemblance is the normalised distance of `sensing.plot_features`, not the printed decision
  function (Eqs. 10 and 11), for which no threshold fits two tracks.
- In a clutter zone the estimated density is several times its mean over the coverage
  (`clutter_map.ClutterMap.in_zone`). The source compares the counts of a cell and its neighbours
  with thresholds, whose values it does not give.
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
"""Number of latest clutter plots whose features are kept."""
MEMORY = 64
"""Number of latest scans whose plots may be hits of a new track."""


@dataclass(frozen=True)
class Environment:
    """Clutter zones, clutter features and encounters in a scan.

    Attributes
    ----------
    in_zone : (d,) ndarray of bool
        Which of the scan's detections are in a clutter zone.
    clutter : (m, 3) ndarray
        Features of the latest plots that are probably clutter.
    encounter_time : float
        Largest time of an encounter before or after the scan, s.
    """

    in_zone: BoolArray
    clutter: FloatArray
    encounter_time: float

    def meeting(
        self, state: FloatArray, covariance: FloatArray, error: FloatArray, gate: float
    ) -> BoolArray:
        """Which pairs of targets meet, (n, n); see `encounters.meeting`."""
        first, second = encounters.meeting(state, covariance, error, gate, self.encounter_time)
        meets = np.zeros((len(state), len(state)), bool)
        meets[first, second] = meets[second, first] = True
        return meets

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
            Features of the n tracks.
        meets : (n, n) ndarray of bool
            Which pairs of tracks meet.
        pairs : Pairs
            The cost is the squared distance in position; infinite outside the gate.
        features : (d, 3) ndarray
            Features of the scan's detections.

        Returns
        -------
        (p,) ndarray
            1 outside of clutter zones and encounters; inside, 0 for an unlike plot, else 1 over the
            fraction of clutter that resembles the track.
        """
        factors = np.ones(len(pairs))
        in_encounter: BoolArray = np.asarray(meets.any(axis=1))
        rows = np.flatnonzero(self.in_zone[pairs.row] | in_encounter[pairs.parent])
        if not len(rows):
            return factors
        tested = pairs[rows]
        tracks, plots = histories[tested.parent], features[tested.row]
        alike = tracks.resembled_by(plots)
        factors[rows] = alike / self._clutter_fraction(histories, tested.parent)
        rivals = np.flatnonzero(alike & np.isfinite(tested.cost) & ~self.in_zone[tested.row])
        rivals = rivals[_contested(tested[rivals], meets)]
        cost = tested.cost[rivals] + tracks[rivals].dissimilarity(plots[rivals])
        candidates = Pairs(tested.parent[rivals], tested.row[rivals], cost)
        assigned = _pair_ids(nearest_first(candidates), len(features))
        lost = ~np.isin(_pair_ids(candidates, len(features)), assigned)
        factors[rows[rivals[lost]]] = 0.0
        return factors

    def _clutter_fraction(self, histories: Histories, parent: IntArray) -> FloatArray:
        """Fraction of clutter that resembles the tracks (p,), with one more such plot (Laplace)."""
        tracks, track = np.unique(parent, return_inverse=True)
        m = len(self.clutter)
        repeated = histories[np.repeat(tracks, m)]
        alike = repeated.resembled_by(np.tile(self.clutter, (len(tracks), 1)))
        fraction = (1.0 + alike.reshape(len(tracks), m).sum(axis=1)) / (1.0 + m)
        return np.asarray(fraction[track.ravel()])


def _pair_ids(pairs: Pairs, detections: int) -> IntArray:
    """A unique number for each pair."""
    return np.asarray(pairs.parent * detections + pairs.row)


def _contested(pairs: Pairs, meets: BoolArray) -> BoolArray:
    """Which pairs' detections also pair with a track in an encounter with theirs, (p,)."""
    several = np.flatnonzero(np.bincount(pairs.row)[pairs.row] > 1)
    parent, row = pairs.parent[several], pairs.row[several]
    contested = np.zeros(len(pairs), bool)
    rivals = (row[:, None] == row) & meets[parent[:, None], parent]
    contested[several] = rivals.any(axis=1)
    return contested


class Surroundings:
    """Features of the plots of recent scans, and of clutter."""

    def __init__(self) -> None:
        self._first_scan = 0
        self._features: deque[FloatArray] = deque(maxlen=MEMORY)  # by index in the whole scan
        self._clutter = np.zeros((0, len(NAMES)))

    def at(self, in_zone: BoolArray, encounter_time: float) -> Environment:
        """The environment of a scan whose detections (d,) are partly in a clutter zone."""
        return Environment(in_zone, self._clutter, encounter_time)

    def observe(
        self, scan_index: int, index: IntArray, features: FloatArray, clutter: BoolArray
    ) -> None:
        """Store the features of a scan, after its association.

        Scans are consecutive; a gap clears the stored scans.

        Parameters
        ----------
        scan_index : int
        index : (d,) ndarray of int
            Index in the whole scan of each detection in the coverage, as in tracks' hits.
        features : (d, 3) ndarray
        clutter : (d,) ndarray of bool
            Which detections are probably clutter.
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
        """Features of the hits of tracks, as far as their scans are stored."""
        max_hits = max((len(hits) for hits in tracks.hits), default=0)
        features = np.full((len(tracks), max_hits, len(NAMES)), np.nan)
        for row, hits in enumerate(tracks.hits):
            for place, (scan, index) in enumerate(hits):
                stored = scan - self._first_scan
                if 0 <= stored < len(self._features):
                    features[row, place] = self._features[stored][index]
        return Histories.of(features)
