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
"""The logic-based method: chi-square acceptance regions around polynomial predictions.

As Sequential 2014, Section 3.2 describes it, after Bar-Shalom, Fortmann, "Tracking and data
association", 1988, and Leung, Hu, Blanchette, "Evaluation of multiple target track initiation
techniques in real radar tracking environments", IEE Proc. RSN 143(4), 1996.

The second hit z_j of a track that begins at z_i lies, t_s later, no farther than the speed limits
and the errors allow, component by component (Eqs. 5 and 6)::

    d^k  = max[0, z_j^k - z_i^k - v_max t_s] + max[0, -z_j^k + z_i^k - v_max t_s]
    D_ij = d' [R_i + R_j]^-1 d <= gamma,   gamma the chi-square quantile of 2 degrees of freedom

Every detection in this region makes a potential track. From two hits the third is predicted along
the straight line through them, from three and more by a second-order polynomial fitted by least
squares. With a prediction ``p = sum_i w_i z_i`` the region is::

    (z_j - p)' [sum_i w_i^2 R_i + R_j]^-1 (z_j - p) <= gamma

and the closest detection in it continues the track. Detections that continue none start new ones.

Readings
--------
- The limits v_min and v_max of a component are -v_max and v_max.
- "The least squares method is used to estimate the residual (in order to determine the validating
  gate size)": the prediction's covariance follows from the errors of the hits, as above. A variance
  estimated from the residuals, the other reading, is undefined while the polynomial passes through
  all hits.
- Closest is by the normalised distance, not by metres.
- Point (iv) terminates a track without a detection in its region; Section 1 has methods look for M
  hits within a window of N scans, which a track can only reach if it outlives a miss. `missed`
  "waits", the default, is the second and differs from Section 3.2; "ends" is point (iv).
- The article does not specify the treatment of confirmed tracks that share a detection: the best
  fit (f_1 of TSEPM 2018, Eq. 23) is published.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from types import MappingProxyType

import numpy as np

from tsepm_ros.numerics import gaussian
from tsepm_ros.numerics.arrays import FloatArray, IntArray, RecordArray, rows_of
from tsepm_ros.parameters import parameter
from tsepm_ros.studies.assignment import AssignmentPairs, assignment_within
from tsepm_ros.studies.path_following import PathFollower
from tsepm_ros.tracker import splitting
from tsepm_ros.tracker.measurement import major_sigma
from tsepm_ros.tracker.options import MnOptions, hits_option, window_option


@dataclass(frozen=True, eq=False)
class LogicPolynomials:
    """Polynomials fitted to the hits of n tracks by least squares.

    At the time t, with ``s = (t - reference) / scale`` of the track, the position is
    ``sum_k s^k c_k``; the coefficients ``c_k = sum_i A_ki z_i`` have the covariances
    ``C_kl = sum_i A_ki A_li R_i``.

    Attributes
    ----------
    reference : float
        Time, s.
    scale : (n,) ndarray
        s.
    last_time : (n,) ndarray
        Time of the last hit, s.
    coefficients : (n, k, 2) ndarray
        c, m.
    covariance : (n, k, k, 2, 2) ndarray
        C, m^2.
    """

    reference: float
    scale: FloatArray
    last_time: FloatArray
    coefficients: FloatArray
    covariance: FloatArray

    @classmethod
    def fitted(cls, hits: RecordArray, reference: float, degree: int) -> LogicPolynomials:
        """Fit hits (n, m) of DETECTION, by the minimum norm where their times leave it open."""
        interval = hits["time"] - reference
        scale = np.abs(interval).max(axis=1)
        scale[scale == 0.0] = 1.0
        powers = (interval / scale[:, None])[..., None] ** np.arange(degree + 1)
        weights = np.linalg.pinv(powers)  # (n, k, m)
        return cls(
            reference,
            scale,
            hits["time"][:, -1],
            weights @ hits["position"],
            np.einsum("nki,nli,nipq->nklpq", weights, weights, hits["covariance"], optimize=True),
        )

    @property
    def degree(self) -> int:
        """Order of the polynomials."""
        return self.coefficients.shape[1] - 1

    def at(self, track: IntArray, time: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Predicted position and its covariance.

        Parameters
        ----------
        track : (p,) ndarray of int
            Rows of tracks.
        time : (p,) ndarray
            s.

        Returns
        -------
        position : (p, 2) ndarray
            m.
        covariance : (p, 2, 2) ndarray
            m^2.
        """
        count = self.coefficients.shape[1]
        powers = ((time - self.reference) / self.scale[track])[:, None] ** np.arange(count)
        position = np.einsum("pk,pkc->pc", powers, self.coefficients[track])
        covariance = np.einsum(
            "pk,pl,pkluv->puv", powers, powers, self.covariance[track], optimize=True
        )
        return position, covariance

    def reach(self, max_interval: float) -> tuple[FloatArray, FloatArray]:
        """Bounds over the times within `max_interval`, s, of the reference time.

        Returns
        -------
        drift, sigma : (n,) ndarray
            Bounds of the distance from the position at the reference time, ``sum |s|^k |c_k|`` from
            k = 1 on, and of the error along its major axis, ``sum |s|^k sigma_k`` (Minkowski), m.
        """
        count = self.coefficients.shape[1]
        powers = (max_interval / self.scale)[:, None] ** np.arange(count)
        length = np.hypot(self.coefficients[..., 0], self.coefficients[..., 1])
        diagonal = np.arange(count)
        sigma = (powers * major_sigma(self.covariance[:, diagonal, diagonal])).sum(axis=1)
        return (powers * length)[:, 1:].sum(axis=1), sigma


@dataclass(frozen=True, kw_only=True)
class LogicOptions(MnOptions):
    """Options of the logic-based method."""

    min_hits: int = hits_option(4)
    window: int = window_option(5)
    gate_probability: float = parameter(
        0.99,
        "Probability that a detected target falls into the acceptance region",
        positive=True,
        maximum=0.999999,
    )
    degree: int = parameter(
        2, "Maximum order of the polynomial that predicts a track", minimum=1, maximum=3
    )
    missed: str = parameter(
        "waits",
        "Reaction of a potential track without a detection in its region: it waits until "
        "its scans are over, or ends at once",
        choices=("waits", "ends"),
    )


class Logic(PathFollower):
    """The logic-based method: chi-square regions around polynomial predictions, M of N."""

    Options = LogicOptions
    options: LogicOptions
    operating_points = MappingProxyType(
        {
            f"{min_hits}/{window}": {"min_hits": min_hits, "window": window}
            for min_hits, window in ((8, 10), (6, 8), (5, 6), (5, 8), (4, 5), (3, 4))
        }
        | {
            "6/8 straight": {"min_hits": 6, "window": 8, "degree": 1},
            "4/5 ends": {"min_hits": 4, "window": 5, "missed": "ends"},
        }
    )

    @property
    def ends_when_missed(self) -> bool:
        """See `PathFollower.ends_when_missed`."""
        return self.options.missed == "ends"

    def pairs(self, detections: RecordArray) -> tuple[AssignmentPairs, int]:
        """The detections in the acceptance region of each potential track, by D."""
        if not len(detections):
            return AssignmentPairs.none(), 0
        middle = float(detections["time"].min() + 0.5 * np.ptp(detections["time"]))
        parts, cuts = [AssignmentPairs.none()], 0
        for rows, ids in self.potential.of_equal_count():
            hits = self.detections[ids]
            predicted = LogicPolynomials.fitted(
                hits, middle, min(ids.shape[1] - 1, self.options.degree)
            )
            owner, row, cut = self._near(predicted, detections)
            distance = partial(self._distance, predicted, detections)
            inside = assignment_within(owner, row, distance, self._threshold)
            parts.append(AssignmentPairs(rows[inside.parent], inside.row, inside.cost))
            cuts += cut
        return AssignmentPairs.joined(*parts), cuts

    @property
    def _threshold(self) -> float:
        """gamma: the chi-square quantile of two degrees of freedom."""
        return gaussian.gate_factor(self.options.gate_probability) ** 2

    def _near(
        self, predicted: LogicPolynomials, detections: RecordArray
    ) -> tuple[IntArray, IntArray, int]:
        """Pairs of predictions and detections, no fewer than lie in the regions."""
        times = detections["time"]
        drift, sigma = predicted.reach(0.5 * np.ptp(times))
        sigma = np.hypot(sigma, detections["major_sigma"].max())
        radius = np.sqrt(self._threshold) * sigma + drift
        if predicted.degree == 0:
            elapsed = np.abs(
                times[[np.argmin(times), np.argmax(times)], None] - predicted.last_time
            )
            radius += np.sqrt(2.0) * self.common.max_speed * elapsed.max(axis=0)
        positions = np.ascontiguousarray(detections["position"])
        return splitting.neighbours(
            positions,
            np.ascontiguousarray(predicted.coefficients[:, 0]),
            radius * (1.0 + 1e-9),
            most=self.most_pairs,
        )

    def _distance(
        self,
        predicted: LogicPolynomials,
        detections: RecordArray,
        owner: IntArray,
        row: IntArray,
    ) -> FloatArray:
        """D of pairs of predictions and detections, (p,)."""
        candidates = rows_of(detections, row)
        expected, covariance = predicted.at(owner, candidates["time"])
        misfit = candidates["position"] - expected
        if predicted.degree == 0:
            reach = self.common.max_speed * np.abs(candidates["time"] - predicted.last_time[owner])
            misfit = np.maximum(0.0, misfit - reach[:, None]) + np.maximum(
                0.0, -misfit - reach[:, None]
            )
        return gaussian.squared_mahalanobis_distance(misfit, covariance + candidates["covariance"])
