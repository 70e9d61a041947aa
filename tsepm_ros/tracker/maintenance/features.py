"""Association by features: plot features, and encounters of targets.

Encounters of targets: the closest approach of two (Environment 2018, Section 2.2, Eqs. 1-9).

Shen Y., "The target tracking algorithm based on environment technology", ICOI 2018.

With the relative position r and velocity v of two targets on straight courses, the time until they
are closest, and their distance then, are ::

    T_cpa = -r.v / |v|^2,    d_cpa = |r + v T_cpa|

Readings
--------
- Eq. 9 gives the same time with absolute bars, ``R |cos(phi_r - theta)| / v_r``, which can never be
  negative. Here it is negative once the targets separate, as in Fig. 4 and its text.
- Eq. 2 prints the two products of its numerator without the minus between them, and its fraction
  upside down: as printed, phi_r is measured from the x axis; in the text and beside Eq. 8, from y.
- Without relative velocity the distance is constant; the time is then 0.

Association by plot features in clutter zones and encounters (Environment 2018).

Shen Y., "The target tracking algorithm based on environment technology", ICOI 2018. In a clutter
zone, and in an encounter, a track accepts only plots whose features resemble those of its own. The
clutter density is multiplied by the fraction of recent clutter that resembles the track. A plot in
the gates of several tracks in an encounter is assigned to a single track, by its distance in
position and features.

Both are tests of a fixed size, not ratios of densities: they need no distribution of the features
of clutter.

Readings
--------
- Resemblance is the normalised distance of `measurement.Histories`, not the printed decision
  function (Eqs. 10 and 11), for which no threshold fits two tracks.
- In a clutter zone the estimated density is several times its mean over the coverage
  (`density.ClutterMap.in_zone`). The source compares the counts of a cell and its neighbours
  with thresholds, whose values it does not give.

Plot features and strengths of held tracks: factors of likelihood ratios, the own plots.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray, changed
from tsepm_ros.numerics.gaussian import gate_factor
from tsepm_ros.tracker import motion
from tsepm_ros.tracker.assignment import Pairs, exclusive
from tsepm_ros.tracker.initial_state import NO_HIT
from tsepm_ros.tracker.maintenance.confirmed_tracks import ConfirmedTracks
from tsepm_ros.tracker.maintenance.data_association import GATE_PROBABILITY
from tsepm_ros.tracker.measurement import (
    MAX_PLOT_COUNT,
    NAMES,
    DetectionWindow,
    Histories,
    major_sigma,
)


def closest_approach(first: FloatArray, second: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Time until two targets are closest and their distance then (Eqs. 1-9).

    Parameters
    ----------
    first, second : (..., 4) ndarray
        States ``[x, vx, y, vy]`` at a common time.

    Returns
    -------
    time : (...) ndarray
        T_cpa, s; below 0 where they separate.
    distance : (...) ndarray
        m.
    """
    relative = second - first
    position, velocity = relative[..., 0::2], relative[..., 1::2]
    square = np.square(velocity).sum(axis=-1)
    approach = -(position * velocity).sum(axis=-1)
    time = np.divide(approach, square, out=np.zeros_like(square), where=square > 0.0)
    return time, distance_at(first, second, time)


def distance_at(first: FloatArray, second: FloatArray, time: FloatArray) -> FloatArray:
    """Distance of two targets (..., 4) after a time (...), s, on straight courses (Eq. 7); m."""
    position = motion.position_after(second - first, time)
    return np.asarray(np.hypot(position[..., 0], position[..., 1]))


def meeting(
    state: FloatArray,
    covariance: FloatArray,
    error: FloatArray,
    gate: float,
    max_time: float,
) -> tuple[IntArray, IntArray]:
    """Pairs of targets whose gates overlap at some time within `max_time` of now.

    The gates are compared at the time of the closest approach, limited to `max_time` before and
    after now. The radius of a gate is along the major axis of the predicted detection's error.

    Parameters
    ----------
    state, covariance : (n, 4), (n, 4, 4) ndarray
        At a common time, now.
    error : (n,) ndarray
        Standard deviation of a detection of each target, along the major axis, m.
    gate : float
        Radius of a gate in standard deviations.
    max_time : float
        Largest time before or after now, s.

    Returns
    -------
    first, second : (p,) ndarray of int
        Rows of the targets, the first below the second.
    """
    if len(state) < 2:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    # Pairs farther apart cannot meet within the time; few pairs remain.
    deviation = major_sigma(covariance[:, 0::2, 0::2])
    deviation = deviation + max_time * major_sigma(covariance[:, 1::2, 1::2])
    farthest = gate * np.hypot(deviation, error) + max_time * np.hypot(state[:, 1], state[:, 3])
    near = cKDTree(state[:, 0::2]).query_pairs(2.0 * farthest.max(), output_type="ndarray")
    first, second = near[np.lexsort((near[:, 1], near[:, 0]))].T
    time, _ = closest_approach(state[first], state[second])
    time = np.clip(time, -max_time, max_time)

    def reach(rows: IntArray) -> FloatArray:
        position_covariance = motion.position_covariance_after(covariance[rows], time)
        return gate * np.hypot(major_sigma(position_covariance), error[rows])

    met = distance_at(state[first], state[second], time) <= reach(first) + reach(second)
    return first[met], second[met]


MAX_CLUTTER_PLOTS = 200
"""Number of latest clutter plots whose features are kept."""


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
        tested = pairs[rows]
        tracks, plots = histories[tested.parent], features[tested.row]
        alike = tracks.resembled_by(plots)
        factors[rows] = alike / self._clutter_fraction(histories, tested.parent)
        rivals = np.flatnonzero(alike & np.isfinite(tested.cost) & ~self.in_zone[tested.row])
        rivals = rivals[_contested(tested[rivals], meets)]
        cost = tested.cost[rivals] + tracks[rivals].dissimilarity(plots[rivals])
        assigned = exclusive(tested[rivals], cost)
        factors[rows[np.delete(rivals, assigned)]] = 0.0
        return factors

    def _clutter_fraction(self, histories: Histories, parent: IntArray) -> FloatArray:
        """Fraction of clutter that resembles the tracks (p,), with one more such plot (Laplace)."""
        tracks, track = np.unique(parent, return_inverse=True)
        m = len(self.clutter)
        repeated = histories[np.repeat(tracks, m)]
        alike = repeated.resembled_by(np.tile(self.clutter, (len(tracks), 1)))
        fraction = (1.0 + alike.reshape(len(tracks), m).sum(axis=1)) / (1.0 + m)
        return np.asarray(fraction[track.ravel()])


def _contested(pairs: Pairs, meets: BoolArray) -> BoolArray:
    """Which pairs' detections also pair with a track in an encounter with theirs, (p,)."""
    several = np.flatnonzero(np.bincount(pairs.row)[pairs.row] > 1)
    parent, row = pairs.parent[several], pairs.row[several]
    contested = np.zeros(len(pairs), bool)
    rivals = (row[:, None] == row) & meets[parent[:, None], parent]
    contested[several] = rivals.any(axis=1)
    return contested


class Surroundings:
    """Features of the latest plots that were probably clutter.

    Attributes
    ----------
    clutter : (m, 3) ndarray
    """

    def __init__(self) -> None:
        self.clutter = np.zeros((0, len(NAMES)))

    def observe(self, features: FloatArray, clutter: BoolArray) -> None:
        """Take those of a scan (d, 3), after its association: of what is probably clutter (d,)."""
        has = np.isfinite(features).any(axis=1)
        self.clutter = np.concatenate([self.clutter, features[clutter & has]])[-MAX_CLUTTER_PLOTS:]


def histories_of(window: DetectionWindow, hits: NDArray[np.object_]) -> Histories:
    """Features of the hits (scan, index) of tracks, as far as they are in the window."""
    features = np.full((len(hits), max(map(len, hits), default=0), len(NAMES)), np.nan)
    for row, ids in enumerate(map(window.find, hits)):
        features[row, : len(ids)] = window[ids]["features"]
    return Histories.of(features)


OWN_PROBABILITY = 0.5
"""Association probability above which a detection is a track's own plot."""


def likelihood_factors(
    environment: Environment,
    held: ConfirmedTracks,
    row: IntArray,
    likelihood: FloatArray,
    detections: NDArray[np.void],
) -> FloatArray:
    """Factor that features put to each pair's likelihood ratio, (n, 2, k).

    See `Environment.factors`.

    Parameters
    ----------
    environment : Environment
    held : ConfirmedTracks
        Predicted to the scan.
    row : (n, 2, k) ndarray of int
        Detections near each filter and each fit.
    likelihood : (n, 2, k) ndarray
        Of the position and range rate, the mean over the modes; 0 outside the gate.
    detections : (d,) ndarray of DETECTION
    """
    factors = np.ones(row.shape)
    if not row.size:
        return factors
    error = detections["major_sigma"][row[:, 0, 0]]
    state, covariance = held.tracks.state, held.tracks.covariance
    first, second = meeting(
        state, covariance, error, gate_factor(GATE_PROBABILITY), environment.encounter_time
    )
    meets = np.zeros((len(held), len(held)), bool)
    meets[first, second] = meets[second, first] = True
    for seeker in (0, 1):
        track, place = inside = likelihood[:, seeker].nonzero()
        cost = -2.0 * np.log(likelihood[:, seeker][inside])
        pairs = Pairs(track, row[track, seeker, place], cost)
        factors[track, seeker, place] = environment.factors(
            held.histories, meets, pairs, detections["features"]
        )
    return factors


def with_strengths(
    held: ConfirmedTracks, row: IntArray, probability: FloatArray, strength: FloatArray
) -> ConfirmedTracks:
    """The rows with the strengths of the detections that may be theirs.

    Older detections fade, over `MAX_PLOT_COUNT`: the aspect changes.

    Parameters
    ----------
    held : ConfirmedTracks
    row, probability : (n, k) ndarray
        Detections near each track, and the probability that each is its target's.
    strength : (d,) ndarray
        Exponent of each detection; nan where it is not known.
    """
    known = np.isfinite(strength)
    if not known.any():
        return held
    of_pairs = np.where(known, strength, 0.0)[row]
    share = np.where(known[row], probability, 0.0)
    hits = share.sum(axis=1)
    keep = 1.0 - np.minimum(hits, 1.0) / MAX_PLOT_COUNT
    total = (share * of_pairs).sum(axis=1)
    return changed(
        held,
        strength_hits=keep * held.strength_hits + hits,
        strength_total=keep * held.strength_total + total,
    )


def with_plots(
    held: ConfirmedTracks,
    row: IntArray,
    probability: FloatArray,
    detections: NDArray[np.void],
    environment: Environment | None,
) -> tuple[ConfirmedTracks, IntArray]:
    """The rows with the features of the tracks' own plots, and the plots that separate tracks.

    A plot in a clutter zone separates no tracks: two plots there are not two targets.

    Parameters
    ----------
    held : ConfirmedTracks
    row, probability : (n, k) ndarray
        Detections near each track, and their association probabilities.
    detections : (d,) ndarray of DETECTION
    environment : Environment or None
        Without it features do not count.

    Returns
    -------
    held : ConfirmedTracks
    plots : (n,) ndarray of int
        Detection that is each track's own; NO_HIT where there is none.
    """
    plots = np.full(len(held), NO_HIT)
    if environment is None:
        return held, plots
    likely = (probability > OWN_PROBABILITY).nonzero()
    plots[likely[0]] = row[likely]
    own = np.flatnonzero(plots != NO_HIT)
    histories = held.histories.with_plots(own, detections["features"][plots[own]])
    plots[own[environment.in_zone[plots[own]]]] = NO_HIT
    return changed(held, histories=histories), plots
