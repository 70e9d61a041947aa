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
"""Track splitting without evaluation (2016), and with Kennedy's test for clutter.

Split-merge 2016
----------------
Track splitting and merging (Split-merge 2016), the predecessor of TSEPM.

Li D., Zhang Y., Lin Y., Liu J., "A novel track initiation method for track splitting and merging",
2016.

Every detection in the gate ``v_max k T + sigma_l`` of a potential track (Eq. 2) makes a branch, M
of N hits confirm it (5 of 8), and there is no evaluation: merging alone makes the tracks fewer. Two
tracks merge (Section III.D) if they are confirmed in the same scan, their states are close, and
they share more than M/2 measurements. Scan by scan the measurements of the merged track are

- a measurement that they share, as it is,
- the measurement of one of them, where the other has none,
- a combination of their two,

and its state and covariance are estimated again from them by least squares (Eqs. 12 and 13).

Readings:

- The rule is "N_a <= N and N_v >= M": Step 3 has the first inequality reversed (TSEPM 2018 corrects
  it).
- sigma_l is half the major axis of the 0.9 ellipse of the position's error (TSEPM 2018, Eq. 4).
  Below Eq. 1 it is "the length of the major axis", the whole one: a margin twice as wide, with 158
  tracks after splitting in place of 27 and 26 after merging in place of 10; the paper has 13 and 8.
  Eq. 6 has an eigenvalue of the polar R, whose units are mixed.
- "Their states are close" is not defined: the distance of TSEPM 2018, Eq. 30, with its threshold.
- Groups are the connected components of the pairs, and what a scan combines are the distinct
  measurements of all members.
- A target has one detection a scan, so a combination is one or the other: its moments are those of
  the mixture with equal weights, the spread of their means included. Averaging them as two
  measurements of one target, the other reading, would halve the variance.
- The position is Eq. 4's, R is from the unscented transform (`split_merge_unscented`).

The clutter test
----------------
Track splitting with Kennedy's test for clutter: the reference of TSEPM 2018, Section 5.

Kennedy H. L., "Clutter-based test statistics for automatic track initiation", Acta Automatica
Sinica 34(3), 266-273, 2008, as TSEPM 2018 describes it: "a tentative track is confirmed when the
track-is-on-clutter hypothesis is rejected".

The tree of splits, the M/N rule and the least-squares fit are those of `tsepm`. With lambda the
clutter density and d_k the distance of a hit from the one before, the statistic (Eqs. 24 and 25) ::

    f_2 = 2 lambda sum_k pi d_k^2

(with `clutter_density` "estimated" lambda_k, the density at each hit, in place of one lambda) is
chi-square distributed with 2 M - 2 degrees of freedom for nearest points of pure clutter, and
small for a target: tracks at or below the quantile of the test's size are published. There is no
merging.

Readings:

- Small values indicate a target (Sections 3.4 and 3.5 contradict each other).
- V(k) is the area out to the associated point, not the gate's.
- Where a limit cuts confirmations, those of smaller f_2 are kept.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import ClassVar

import numpy as np

from tsepm_ros.methods.tsepm import Candidates, Tsepm, WindowedMethod
from tsepm_ros.numerics.arrays import FloatArray, RecordArray
from tsepm_ros.parameters import parameter
from tsepm_ros.tracker.initial_state import ESTIMATORS
from tsepm_ros.tracker.measurement import (
    MeasurementWindow,
    covariance_of_pose,
    major_sigma,
    measured_polar,
    range_variance_at,
    rotated_covariance,
)
from tsepm_ros.tracker.method import MethodResult
from tsepm_ros.tracker.observation import Observation
from tsepm_ros.tracker.options import MnOptions
from tsepm_ros.tracker.sensor import SensorModel
from tsepm_ros.tracker.tracks import ConfirmedTrack, TrackArrays


def split_merge_unscented(detections: RecordArray, sensor: SensorModel) -> RecordArray:
    """Convert the detections as Split-merge 2016 does, with R by the unscented transform.

    The position is ``r (cos a, sin a)`` (Eq. 4), with the bias that `unbiased_position`
    removes.
    The sigma points are (r, a), (r +- sqrt(3) s_r, a) and (r, a +- sqrt(3) s_a), with the weights
    1/3 and 1/6 (Julier, Uhlmann 1997, n + kappa = 3). The variances along and across the line of
    sight are::

        along  = s_r^2 + 2/9 r^2 (1 - cos(sqrt(3) s_a))^2
        across = 1/3 r^2 sin(sqrt(3) s_a)^2

    Parameters
    ----------
    detections : (...) ndarray of DETECTION
        From `convert_measurements`.
    sensor : SensorModel
        Range errors of detections without their own.

    Returns
    -------
    (...) ndarray of DETECTION
    """
    converted = detections.copy()
    range_, azimuth = measured_polar(detections)
    cosine, sine = np.cos(azimuth), np.sin(azimuth)
    offset = range_[..., None] * np.stack([cosine, sine], axis=-1)
    angle = math.sqrt(3.0) * detections["azimuth_std"]
    along = range_variance_at(detections, range_, sensor)
    along = along + 2.0 / 9.0 * np.square(range_ * (1.0 - np.cos(angle)))
    across = np.square(range_ * np.sin(angle)) / 3.0
    converted["position"] = detections["sensor_pose"][..., :2] + offset
    converted["covariance"] = rotated_covariance(along, across, cosine, sine) + covariance_of_pose(
        offset, detections["sensor_pose_covariance"]
    )
    converted["major_sigma"] = major_sigma(converted["covariance"])
    return converted


@dataclass(frozen=True, kw_only=True)
class SplitMergeOptions(MnOptions):
    """Options of splitting and merging; the defaults are the paper's."""

    evaluation: ClassVar[str] = "normalized_distance"
    estimator: ClassVar[str] = "unweighted"

    gate_probability: float = parameter(
        0.9,
        "Probability of the error ellipse whose half axis is sigma_l (Eqs. 1 and 2)",
        positive=True,
        maximum=0.999999,
    )
    merging_probability: float = parameter(
        0.9,
        "Probability that two close states overlap (TSEPM 2018, Eq. 30)",
        positive=True,
        maximum=0.999999,
    )


class SplitMerge(Tsepm):
    """Track splitting and merging of 2016: merged measurements, estimated again."""

    Options = SplitMergeOptions  # type: ignore[assignment]
    options: SplitMergeOptions  # type: ignore[assignment]
    operating_points = MappingProxyType(
        {
            f"{min_hits}/{window}": {"min_hits": min_hits, "window": window}
            for min_hits, window in ((7, 8), (6, 8), (5, 6), (5, 8), (4, 5), (3, 4))
        }
    )

    def reason(self, track: ConfirmedTrack) -> str:
        """Its rule.

        See `Method.reason`.
        """
        return WindowedMethod.reason(self, track)

    def forget(self) -> None:
        """See `Method.forget`."""
        super().forget()
        self._unscented = MeasurementWindow()

    def step(self, observed: Observation) -> MethodResult:
        """Step of `Tsepm` on detections with the unscented transform's covariances.

        See `Method.step`.
        """
        detections = split_merge_unscented(observed.detections, self.sensor)
        self._unscented.forget(observed.scan_index + 1 - self.options.window)
        ids, window = self._unscented.append(detections), self._unscented
        return super().step(replace(observed, detections=detections, ids=ids, window=window))

    @property
    def threshold(self) -> float:
        """Nothing is pruned."""
        return math.inf

    def merged(self, group: Candidates) -> tuple[FloatArray, FloatArray]:
        """State and covariance of a group, from its combined measurements."""
        fitted = self.fit(split_merge_combined(self.detections[np.unique(group.hits)])[None])
        return fitted.state[0], fitted.covariance[0]


def split_merge_combined(hits: RecordArray) -> RecordArray:
    """Combine the distinct measurements of merged tracks to a single measurement a scan.

    ``z = sum z_i / k``, ``R = sum (R_i + (z_i - z)(z_i - z)') / k``, at the mean of their times.

    Parameters
    ----------
    hits : (n,) ndarray of DETECTION
        In the order of their scans.

    Returns
    -------
    (s,) ndarray of DETECTION
        One for each scan.
    """
    _, first, scan, number = np.unique(
        hits["scan"], return_index=True, return_inverse=True, return_counts=True
    )
    combined = hits[first].copy()
    for name in ("time", "position"):
        total = np.zeros_like(combined[name])
        np.add.at(total, scan, hits[name] - hits[name][first][scan])  # exact where there is one
        combined[name] += (total.T / number).T
    deviation = hits["position"] - combined["position"][scan]
    covariance = np.zeros((len(first), 2, 2))
    np.add.at(covariance, scan, hits["covariance"] + deviation[:, :, None] * deviation[:, None, :])
    combined["covariance"] = covariance / number[:, None, None]
    return combined


@dataclass(frozen=True, kw_only=True)
class ClutterTestOptions(MnOptions):
    """Options of the clutter test."""

    evaluation: ClassVar[str] = "clutter_statistic"

    gate_probability: float = parameter(
        0.9,
        "Probability P that a detected target falls into the gate (Eq. 5)",
        positive=True,
        maximum=0.999999,
    )
    clutter_test_size: float = parameter(
        0.05,
        "Nominal fraction of clutter tracks that pass the test",
        positive=True,
        maximum=0.999999,
    )
    estimator: str = parameter("unweighted", "Fit of a track, as with tsepm", choices=ESTIMATORS)


class SplitMergeClutterTest(Tsepm):
    """Track splitting with Kennedy's test for clutter, without merging."""

    Options = ClutterTestOptions  # type: ignore[assignment]
    options: ClutterTestOptions  # type: ignore[assignment]
    operating_points = MappingProxyType(
        {
            f"size {size:g}": {"clutter_test_size": size}
            for size in (0.001, 0.003, 0.01, 0.03, 0.05, 0.1, 0.2)
        }
    )

    def merge(self, candidates: Candidates) -> TrackArrays:
        """Every candidate is a track of its own."""
        return self.tracks(candidates)
