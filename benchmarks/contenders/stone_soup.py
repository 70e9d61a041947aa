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
"""Stone Soup: MultiMeasurementInitiator over GNN with 2-D assignment and a k-d tree pre-gate.

Three configurations, each faster than the one before:

- `StoneSoupContender`: the library's own `DetectionKDTreeGNN2D`. Its tree measures distance in the
  measurement's coordinates, radians and metres alike, so that only range counts.
- `TunedStoneSoupContender`: a tree over Cartesian positions instead; and each track is predicted,
  pre-gated and hypothesised in one step, so that the predictor's cache (the last 128 predictions)
  always has its prediction.
- `ConvertedStoneSoupContender`: as tuned, with positions converted beforehand.

In all of them the deleter ends a track after `window` scans, as the M/N rule does; with the
library's `UpdateTimeStepsDeleter(8)` they would have more tracks and be slower. In the first two
all detections share one measurement model, with the range error at the typical range, so that the
updater's cache serves all detections of a track.
"""

from __future__ import annotations

import datetime
import warnings

import numpy as np
from scipy.spatial import KDTree

from contenders import Contender, FloatArray, Hits, RawScan, Sea

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # about missing optional packages
    from stonesoup.base import Property
    from stonesoup.dataassociator.neighbour import GNNWith2DAssignment
    from stonesoup.dataassociator.tree import DetectionKDTreeGNN2D
    from stonesoup.deleter.base import Deleter
    from stonesoup.hypothesiser.distance import DistanceHypothesiser
    from stonesoup.measures import Mahalanobis
    from stonesoup.models.measurement.linear import LinearGaussian
    from stonesoup.models.measurement.nonlinear import CartesianToBearingRange
    from stonesoup.models.transition import linear
    from stonesoup.predictor.kalman import KalmanPredictor
    from stonesoup.tracker import simple
    from stonesoup.types.angle import Bearing
    from stonesoup.types.array import StateVector
    from stonesoup.types.detection import Detection
    from stonesoup.types.multihypothesis import MultipleHypothesis
    from stonesoup.types.state import GaussianState
    from stonesoup.types.track import Track
    from stonesoup.types.update import Update
    from stonesoup.updater.kalman import ExtendedKalmanUpdater, KalmanUpdater

START = datetime.datetime(2018, 1, 1)
POSITIONS = (0, 2)
ACCELERATION_DENSITY = 0.01  # m^2/s^3
PRIOR_POSITION_VARIANCE = 1e8  # m^2, so large that the first measurement decides
PRE_GATE_SLACK = 1.05  # the pre-gate's ellipses are not quite the hypothesiser's


class WindowDeleter(Deleter):
    """Ends a track not confirmed within a number of scans, the first scan included."""

    window: int = Property(doc="N of the M/N rule.")

    def check_for_deletion(self, track: Track, **kwargs: object) -> bool:
        """Whether the track has reached its number of scans; every scan adds a state."""
        return len(track) >= self.window


class CartesianTreeGNN2D(GNNWith2DAssignment):
    """`GNNWith2DAssignment` behind a k-d tree over Cartesian positions."""

    predictor: KalmanPredictor = Property(doc="The hypothesiser's predictor.")
    sigmas: float = Property(doc="Reach of the gate in standard deviations.")
    error_fraction: float = Property(doc="Larger measurement deviation as a fraction of range.")
    error_floor: float = Property(doc="Minimum measurement deviation, m.")

    def generate_hypotheses(
        self,
        tracks: set[Track],
        detections: set[Detection],
        timestamp: datetime.datetime,
        **kwargs: object,
    ) -> dict[Track, MultipleHypothesis]:
        """Hypothesise only detections that can lie within a track's gate."""
        listed = list(detections)
        tree = KDTree([detection.metadata["position"] for detection in listed]) if listed else None
        hypotheses = {}
        for track in tracks:
            near = self._near(track, timestamp, tree) if tree else []
            chosen = [listed[row] for row in near]
            hypotheses[track] = self.hypothesiser.hypothesise(track, chosen, timestamp, **kwargs)
        return hypotheses

    def _near(self, track: Track, timestamp: datetime.datetime, tree: KDTree) -> list[int]:
        prediction = self.predictor.predict(track, timestamp=timestamp)
        x, y = float(prediction.state_vector[0, 0]), float(prediction.state_vector[2, 0])
        error = max(self.error_floor, self.error_fraction * np.hypot(x, y))
        variance = prediction.covar[0, 0] + prediction.covar[2, 2] + error**2
        return tree.query_ball_point((x, y), PRE_GATE_SLACK * self.sigmas * np.sqrt(variance))


class StoneSoupContender(Contender):
    """Bearing and range as measured, extended Kalman updates, the library's own tree."""

    def __init__(self, sea: Sea, min_hits: int, window: int) -> None:
        super().__init__(sea, min_hits, window)
        self._range_std = sea.range_std_fraction * sea.typical_range
        updater = self._make_updater()
        predictor = KalmanPredictor(
            linear.CombinedLinearGaussianTransitionModel(
                [linear.ConstantVelocity(ACCELERATION_DENSITY)] * 2
            )
        )
        hypothesiser = DistanceHypothesiser(
            predictor, updater, Mahalanobis(), missed_distance=sea.gate_sigmas
        )
        velocity_variance = (sea.max_speed / 2.0) ** 2  # per axis, of a uniform disc of velocities
        prior = GaussianState(
            np.zeros((4, 1)),
            np.diag([PRIOR_POSITION_VARIANCE, velocity_variance] * 2),
            timestamp=START,
        )
        self._initiator = simple.MultiMeasurementInitiator(
            prior_state=prior,
            deleter=WindowDeleter(window=window),
            data_associator=self._make_associator(hypothesiser),
            updater=updater,
            min_points=min_hits,
            initiator=simple.SinglePointMeasurementInitiator(prior_state=prior, updater=updater),
        )
        self._scan_index = 0
        self._new: list[Track] = []

    def process(self, scan: RawScan) -> int:
        """See `Contender.process`."""
        timestamp = START + datetime.timedelta(seconds=scan.stamp)
        self._new = list(self._initiator.initiate(self._detections(scan, timestamp), timestamp))
        self._scan_index += 1
        return len(self._new)

    def hits(self) -> list[Hits]:
        """See `Contender.hits`."""
        return [
            tuple(
                state.hypothesis.measurement.metadata["hit"]
                for state in track
                if isinstance(state, Update)
            )
            for track in self._new
        ]

    def states(self) -> FloatArray:
        """See `Contender.states`."""
        return np.array([track.state_vector for track in self._new], float).reshape(-1, 4)

    def covariances(self) -> FloatArray:
        """See `Contender.covariances`."""
        return np.array([track.covar for track in self._new], float).reshape(-1, 4, 4)

    def counts(self) -> dict[str, int]:
        """See `Contender.counts`."""
        return {"potential": len(self._initiator.holding_tracks)}

    def _make_updater(self) -> KalmanUpdater:
        self._model = CartesianToBearingRange(
            ndim_state=4,
            mapping=POSITIONS,
            noise_covar=np.diag([self.sea.azimuth_std**2, self._range_std**2]),
        )
        return ExtendedKalmanUpdater(self._model)

    def _make_associator(self, hypothesiser: DistanceHypothesiser) -> GNNWith2DAssignment:
        sea = self.sea
        deviation = sea.max_speed / 2.0 * sea.period * (self.window - 1)  # after misses, m
        return DetectionKDTreeGNN2D(
            hypothesiser,
            predictor=hypothesiser.predictor,
            updater=hypothesiser.updater,
            max_distance=PRE_GATE_SLACK * sea.gate_sigmas * np.hypot(deviation, self._range_std),
            # The multiplier of a variance; sufficient for the smallest variance.
            max_distance_covariance_multiplier=PRE_GATE_SLACK * sea.gate_sigmas / self._range_std,
        )

    def _detections(self, scan: RawScan, timestamp: datetime.datetime) -> set[Detection]:
        x = scan.range * np.cos(scan.azimuth)
        y = scan.range * np.sin(scan.azimuth)
        return {
            Detection(
                StateVector([Bearing(scan.azimuth[row]), scan.range[row]]),
                timestamp=timestamp,
                measurement_model=self._model,
                metadata={"hit": (self._scan_index, row), "position": (x[row], y[row])},
            )
            for row in range(len(scan))
        }


class TunedStoneSoupContender(StoneSoupContender):
    """Bearing and range as measured, extended Kalman updates, a tree over positions."""

    def _make_associator(self, hypothesiser: DistanceHypothesiser) -> GNNWith2DAssignment:
        return CartesianTreeGNN2D(
            hypothesiser,
            predictor=hypothesiser.predictor,
            sigmas=self.sea.gate_sigmas,
            error_fraction=max(self.sea.azimuth_std, self.sea.range_std_fraction),
            error_floor=self._range_std,
        )


class ConvertedStoneSoupContender(TunedStoneSoupContender):
    """Positions converted beforehand, each with its own covariance; linear Kalman updates."""

    def _make_updater(self) -> KalmanUpdater:
        return KalmanUpdater(None)

    def _detections(self, scan: RawScan, timestamp: datetime.datetime) -> set[Detection]:
        cosine, sine = np.cos(scan.azimuth), np.sin(scan.azimuth)
        along = np.stack([cosine, sine], axis=1)
        across = np.stack([-sine, cosine], axis=1)
        radial = (self.sea.range_std_fraction * scan.range)[:, None] * along
        lateral = (self.sea.azimuth_std * scan.range)[:, None] * across
        covariances = radial[:, :, None] * radial[:, None] + lateral[:, :, None] * lateral[:, None]
        positions = scan.range[:, None] * along
        return {
            Detection(
                StateVector(positions[row]),
                timestamp=timestamp,
                measurement_model=LinearGaussian(4, POSITIONS, covariances[row]),
                metadata={"hit": (self._scan_index, row), "position": tuple(positions[row])},
            )
            for row in range(len(scan))
        }
