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
"""Association by detection features in clutter zones and encounters (Environment 2018).

Shen Y., "The target tracking algorithm based on environment technology", ICOI 2018. In a clutter
zone, and in an encounter of targets, a confirmed track accepts only detections whose features
resemble those of its own. The clutter density is multiplied by the fraction of recent clutter that
resembles the track. A detection in the gates of several tracks in an encounter is assigned to a
single track, by its distance in position and features. Both are tests of a fixed size, not ratios
of densities: they need no distribution of the features of clutter.

Targets meet if their gates overlap at their closest approach (Section 2.2, Eqs. 1-9,
`measures.measured_closest_approach`). A target's detections resemble each other in intensity,
range width and azimuth width (Section 2.3). With u the mean of a track's n detections so far (Eq.
10) and u' the mean with another, the decision function is ``J = sum_p |u'_p - u_p|^2`` (Eq. 11),
small for a detection of its own.

Readings
--------
- Eq. 9 gives the time of closest approach with absolute bars, ``R |cos(phi_r - theta)| / v_r``,
  which can never be negative. Here it is negative once the targets separate, as in Fig. 4 and its
  text.
- Eq. 2 prints the two products of its numerator without the minus between them, and its fraction
  upside down: as printed, phi_r is measured from the x axis; in the text and beside Eq. 8, from y.
- Without relative velocity the distance is constant; the time is then 0.
- As printed, J adds squares of unlike units, and falls with ``1 / (n + 1)^2`` as the history grows,
  so that no threshold fits two tracks. Only the reproduction of Table 1 uses it. Association uses
  the distance of the detection from the mean in units of the track's own standard deviation,
  ``t_p^2 = (z_p - u_p)^2 / (s_p^2 (1 + 1 / n_p))`` with the variance s_p^2 of the track's n_p
  detections. For a detection of the track with Gaussian features it has an F distribution with 1
  and n_p - 1 degrees of freedom. The chi-square quantile of its probability replaces each t_p^2:
  the gate of the sum then also holds for short histories.
- "The point track and track interval are used as feature distances" where a detection fits several
  tracks: the distance in position is added to J.
- The source counts detections of a cell and its neighbours; in a clutter zone the counts exceed
  thresholds. It gives no thresholds, cells or number of scans. Here the learned density is more
  than `ZONE_FACTOR` times its mean where clutter is seen.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import chdtri, fdtrc

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray, RecordArray, Rows
from tsepm_ros.numerics.gaussian import gate_factor
from tsepm_ros.studies.assignment import AssignmentPairs, exclusive_assignment
from tsepm_ros.tools.evaluation.measures import measured_closest_approach
from tsepm_ros.tracker import motion
from tsepm_ros.tracker.maintenance.branches import Gated
from tsepm_ros.tracker.maintenance.confirmed_tracks import ConfirmedTracks
from tsepm_ros.tracker.maintenance.data_association import Pairs
from tsepm_ros.tracker.maintenance.track_maintenance import TrackMaintenance
from tsepm_ros.tracker.measurement import major_sigma
from tsepm_ros.tracker.method import Method
from tsepm_ros.tracker.options import GATE_PROBABILITY, MAX_WINDOW, CommonOptions
from tsepm_ros.tracker.scan import ECHO_FEATURES, Scan
from tsepm_ros.tracker.sensor import SensorModel
from tsepm_ros.tracker.tracker import Tracker
from tsepm_ros.tracker.tracks import EVEN_PROBABILITY, TrackArrays

DETECTION_COUNT = 30
"""Latest detections of a track that are averaged, K of Eq. 10: the aspect changes."""
CLUTTER_COUNT = 200
"""Latest detections of clutter whose features are kept."""
MIN_RELATIVE_STD = 0.01
"""Smallest standard deviation of a feature, as a fraction of its mean: sensors round."""
MAX_FEATURE = 1e100
"""Magnitude from which a feature counts as not measured: its square could overflow."""
MIN_TAIL_PROBABILITY = 1e-300
"""Floor of a tail probability, which keeps its quantile finite."""
ZONE_FACTOR = 3.0
"""Ratio of the density in a clutter zone to its mean."""


def encounter_features(scan: Scan) -> FloatArray:
    """Features of a scan's detections, (n, 3); nan where not measured."""
    columns = [scan.features.get(name, np.full(len(scan), np.nan)) for name in ECHO_FEATURES]
    values = np.stack(columns, axis=1)
    return np.where(np.abs(values) < MAX_FEATURE, values, np.nan)


@dataclass(frozen=True)
class EncounterHistories(Rows):
    """Statistics of the features of tracks' detections, a row for each track.

    Attributes
    ----------
    count : (n, 3) ndarray
        Number of detections with each feature.
    mean : (n, 3) ndarray
        Eq. 10.
    square : (n, 3) ndarray
        Sum of the squared deviations from the mean.
    """

    count: FloatArray
    mean: FloatArray
    square: FloatArray

    @classmethod
    def of(cls, features: FloatArray) -> Self:
        """Histories of detections (n, m, 3); nan: no detection, or not measured."""
        has = np.isfinite(features)
        values = np.where(has, features, 0.0)
        count = has.sum(axis=1).astype(float)
        mean = values.sum(axis=1) / np.maximum(count, 1.0)
        square = np.where(has, np.square(values - mean[:, None]), 0.0).sum(axis=1)
        return cls(count, mean, square)

    def dissimilarity(self, features: FloatArray) -> FloatArray:
        """Distance of each detection's features (n, 3) from those of its track, (n,).

        Chi-square distributed for detections of the same target; the number of comparable features
        (`known`) is the degrees of freedom.
        """
        known = self.known(features)
        freedom = np.where(known, self.count - 1.0, 1.0)
        variance = self.square / freedom
        variance = np.maximum(variance, np.square(MIN_RELATIVE_STD * self.mean))
        variance = variance * (1.0 + 1.0 / np.maximum(self.count, 1.0))
        squared_deviation = np.where(known, np.square(features - self.mean), 0.0)
        # A variance of 0: the distance is infinite for a different feature, 0 for an equal one.
        at_no_variance = np.where(squared_deviation > 0.0, np.inf, 0.0)
        with np.errstate(over="ignore"):
            distance = np.divide(
                squared_deviation, variance, out=at_no_variance, where=variance > 0.0
            )
        probability = np.maximum(fdtrc(1.0, freedom, distance), MIN_TAIL_PROBABILITY)
        return np.asarray(chdtri(1.0, probability).sum(axis=1))

    def known(self, features: FloatArray) -> BoolArray:
        """Which features of detections (n, 3) are comparable: measured, and twice in the track."""
        return np.isfinite(features) & (self.count >= 2.0)

    def resembled_by(self, features: FloatArray) -> BoolArray:
        """Whether detections (n, 3) resemble their tracks'; true without comparable features."""
        freedom = self.known(features).sum(axis=1)
        gate = chdtri(np.maximum(freedom, 1), 1.0 - GATE_PROBABILITY)
        return np.asarray((self.dissimilarity(features) <= gate) | (freedom == 0))


def encounter_pairs(
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
    apart = state[second] - state[first]
    time = np.clip(measured_closest_approach(apart)[0], -max_time, max_time)

    def reach(rows: IntArray) -> FloatArray:
        position_covariance = motion.position_covariance_after(covariance[rows], time)
        return gate * np.hypot(major_sigma(position_covariance), error[rows])

    met = np.hypot(*motion.position_after(apart, time).T) <= reach(first) + reach(second)
    return first[met], second[met]


@dataclass(frozen=True)
class EncounterEnvironment:
    """Clutter zones and clutter features in a scan.

    Attributes
    ----------
    features : (d, 3) ndarray
        Of the scan's detections.
    in_zone : (d,) ndarray of bool
        Which of them are in a clutter zone.
    clutter : (m, 3) ndarray
        Features of the latest detections that are probably clutter.
    """

    features: FloatArray
    in_zone: BoolArray
    clutter: FloatArray

    def factors(
        self, histories: EncounterHistories, meets: BoolArray, pairs: AssignmentPairs
    ) -> FloatArray:
        """Factor of the likelihood ratio of each pair of a track and a detection, (p,).

        Parameters
        ----------
        histories : EncounterHistories
            Features of the n tracks.
        meets : (n, n) ndarray of bool
            Which pairs of tracks meet.
        pairs : AssignmentPairs
            The cost is the squared distance in position; infinite outside the gate.

        Returns
        -------
        (p,) ndarray
            1 outside of clutter zones and encounters; inside, 0 for an unlike detection, else 1
            over the fraction of clutter that resembles the track, with another such detection
            (Laplace).
        """
        factors = np.ones(len(pairs))
        in_encounter: BoolArray = np.asarray(meets.any(axis=1))
        rows = np.flatnonzero(self.in_zone[pairs.row] | in_encounter[pairs.parent])
        tested = pairs[rows]
        tracks, features = histories[tested.parent], self.features[tested.row]
        alike, m = tracks.resembled_by(features), len(self.clutter)
        repeated = tracks[np.repeat(np.arange(len(tested)), m)]
        resembling = repeated.resembled_by(np.tile(self.clutter, (len(tested), 1)))
        fraction = (1.0 + resembling.reshape(len(tested), m).sum(axis=1)) / (1.0 + m)
        factors[rows] = alike / fraction
        rivals = np.flatnonzero(alike & np.isfinite(tested.cost) & ~self.in_zone[tested.row])
        parent, row = tested[rivals].parent, tested[rivals].row
        contested = (row[:, None] == row) & meets[parent[:, None], parent]
        rivals = rivals[contested.any(axis=1)]
        cost = tested.cost[rivals] + tracks[rivals].dissimilarity(features[rivals])
        assigned = exclusive_assignment(tested[rivals], cost)
        factors[rows[np.delete(rivals, assigned)]] = 0.0
        return factors


class EncounterMaintenance(TrackMaintenance):
    """Track maintenance that associates by features where clutter is dense and targets meet.

    Parameters
    ----------
    options : CommonOptions
    encounter_time : float
        Targets meet at most this time before or after a scan, s.
    """

    def __init__(self, options: CommonOptions, encounter_time: float) -> None:
        super().__init__(options)
        self.encounter_time = encounter_time
        self.forget_features()

    def forget_features(self) -> None:
        """Forget the features of all detections."""
        self.clutter = np.zeros((0, len(ECHO_FEATURES)))
        self.scans: dict[int, tuple[FloatArray, BoolArray]] = {}
        self.latest: dict[int, deque[FloatArray]] = {}

    def clear(self) -> None:
        """See `TrackMaintenance.clear`."""
        super().clear()
        self.forget_features()

    def look(self, index: int, scan: Scan, in_zone: BoolArray) -> None:
        """Take the next scan, of an index, and which of its detections are in a clutter zone."""
        self.scans[index] = encounter_features(scan), in_zone
        self.scans.pop(index - MAX_WINDOW, None)

    def step(
        self,
        stamp: float,
        detections: RecordArray,
        clutter: FloatArray,
        *more: Any,
        **options: Any,
    ) -> FloatArray:
        """See `TrackMaintenance.step`."""
        confirmed = super().step(stamp, detections, clutter, *more, **options)
        features, _ = self.of_scan(detections)
        for track_id, row in zip(*self.probable_detections, strict=True):
            self.latest[int(track_id)].append(features[row])
        is_clutter = (confirmed < EVEN_PROBABILITY) & np.isfinite(features).any(axis=1)
        self.clutter = np.concatenate([self.clutter, features[is_clutter]])[-CLUTTER_COUNT:]
        return confirmed

    def of_scan(self, detections: RecordArray) -> tuple[FloatArray, BoolArray]:
        """Features (d, 3) of the last scan's detections, and which are in a clutter zone, (d,)."""
        features, in_zone = self.scans[max(self.scans)]
        return features[detections["index"]], in_zone[detections["index"]]

    def histories(self, tracks: TrackArrays) -> EncounterHistories:
        """Features of the latest detections of tracks: of new tracks, their hits."""
        self.latest = {
            track_id: self.latest.get(track_id)
            or deque((self.scans[i][0][row] for i, row in hits if i in self.scans), DETECTION_COUNT)
            for track_id, hits in zip(tracks.track_id.tolist(), tracks.hits, strict=True)
        }
        features = np.full((len(tracks), DETECTION_COUNT, len(ECHO_FEATURES)), np.nan)
        for row, latest in enumerate(self.latest.values()):
            features[row, : len(latest)] = np.reshape(list(latest), (-1, len(ECHO_FEATURES)))
        return EncounterHistories.of(features)

    def gate(
        self,
        confirmed: ConfirmedTracks,
        stamp: float,
        detections: RecordArray,
        sensor: SensorModel,
    ) -> Gated:
        """The detections in the gates, with likelihoods times `EncounterEnvironment.factors`."""
        gated = super().gate(confirmed, stamp, detections, sensor)
        environment = EncounterEnvironment(*self.of_scan(detections), self.clutter)
        histories = self.histories(confirmed.tracks)
        if not len(gated.row):
            return gated
        nearest = np.zeros(len(confirmed), np.int64)
        order = np.argsort(gated.likelihood)
        nearest[gated.track_of_pair[order]] = gated.row[order]
        error = detections["major_sigma"][nearest]
        first, second = encounter_pairs(
            confirmed.tracks.state,
            confirmed.branches.combined()[1],
            error,
            gate_factor(GATE_PROBABILITY),
            self.encounter_time,
        )
        meets = np.zeros((len(confirmed), len(confirmed)), bool)
        meets[first, second] = meets[second, first] = True
        # Of the filter, over its branches and modes, and of the straight fit.
        mean = gated.weights(confirmed.branches) * gated.likelihood
        likelihood, number = gated.likelihood.copy(), len(detections)
        for rows in (np.flatnonzero(~gated.of_fits), np.flatnonzero(gated.of_fits)):
            of_pair = gated.track_of_pair[rows], gated.row[rows]
            track, row, mean_of_pair = Pairs.summed(*of_pair, mean[rows], number)
            cost = -2.0 * np.log(np.maximum(mean_of_pair, np.finfo(float).tiny))
            factors = environment.factors(histories, meets, AssignmentPairs(track, row, cost))
            likelihood[rows] *= factors[
                np.searchsorted(track * number + row, of_pair[0] * number + of_pair[1])
            ]
        inside = np.flatnonzero(likelihood > 0.0)
        return gated._replace(
            parent=gated.parent[inside], row=gated.row[inside], likelihood=likelihood[inside]
        )


class FeatureTracker(Tracker):
    """A tracker with `EncounterMaintenance`.

    Parameters
    ----------
    method : Method
    encounter_time : float, optional
        s.
    """

    maintenance: EncounterMaintenance

    def __init__(self, method: Method, encounter_time: float = 60.0) -> None:
        super().__init__(method)
        self.maintenance = EncounterMaintenance(method.common, encounter_time)

    def process(self, scan: Scan) -> TrackArrays:
        """See `Tracker.process`."""
        known = self.sensor.learned.clutter_map
        density = known.at(known.grid.cells(scan.range, scan.azimuth))
        self.maintenance.look(self.scan_index + 1, scan, density > ZONE_FACTOR * known.mean)
        return super().process(scan)
