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
"""A minimal tracker: a Kalman filter per target, nearest-neighbour association.

This module is without ROS; `kalman_tracker.py` is its node. `start` begins a filter with the
state and the full covariance of a new track.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from tsepm_ros import ConfirmedTrack

FloatArray = NDArray[np.float64]

GATE = 9.21
"""Gate of the squared distance: chi-square, 2 degrees of freedom, at 0.99."""


@dataclass
class Target:
    """A followed target: ``[x, vx, y, vy]`` with its covariance, and successive misses."""

    state: FloatArray
    covariance: FloatArray
    misses: int = 0

    def predict(self, interval: float, noise: float) -> None:
        """Predict over an interval (s) at constant velocity: ``F x``, ``F P F' + Q``.

        The velocity's variance grows by `noise` (m^2/s^3) per second.
        """
        F = np.kron(np.eye(2), [[1.0, interval], [0.0, 1.0]])
        t = interval
        Q = noise * np.kron(np.eye(2), [[t**3 / 3.0, t**2 / 2.0], [t**2 / 2.0, t]])
        self.state = F @ self.state
        self.covariance = F @ self.covariance @ F.T + Q

    def innovations(
        self, position: FloatArray, R: FloatArray, time_offset: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Innovation of each detection, (n, 2), and its covariance, (n, 2, 2).

        An echo's position is valid `time_offset` (n,) after the ping, s, which grows with range.
        """
        H = measurement_matrix(time_offset)
        S = H @ self.covariance @ np.swapaxes(H, 1, 2) + R
        return position - H @ self.state, S

    def update(self, innovation: FloatArray, S: FloatArray, time_offset: float) -> None:
        """Update with a detection: ``K = P H' S^-1``, ``x + K d``, ``P - K S K'``."""
        [H] = measurement_matrix(np.array([time_offset]))
        K = np.linalg.solve(S, H @ self.covariance).T
        self.state = self.state + K @ innovation
        self.covariance = self.covariance - K @ S @ K.T
        self.covariance = 0.5 * (self.covariance + self.covariance.T)


def measurement_matrix(time_offset: FloatArray) -> FloatArray:
    """Measurement matrix of the positions some times (n,) after a state, s: (n, 2, 4)."""
    H = np.zeros((len(time_offset), 2, 4))
    H[:, 0, 0] = H[:, 1, 2] = 1.0
    H[:, 0, 1] = H[:, 1, 3] = time_offset
    return H


class NearestNeighbourTracker:
    """Follows targets from their start until they have too many successive misses.

    Parameters
    ----------
    noise : float, optional
        Spectral density of the targets' acceleration, m^2/s^3.
    max_misses : int, optional
        A target with more successive misses ends.

    Attributes
    ----------
    stamp : float
        Time of all states, s.
    targets : dict of int to Target
    """

    def __init__(self, noise: float = 0.01, max_misses: int = 4) -> None:
        self.noise, self.max_misses = noise, max_misses
        self.clear()

    def clear(self) -> None:
        """Remove all targets."""
        self.stamp = -math.inf
        self.targets: dict[int, Target] = {}

    def start(self, tracks: Iterable[ConfirmedTrack]) -> None:
        """Start a filter with the state and the full covariance of each new track.

        A track with a `revision` above 0 was lost and continued: it replaces the filter of its id.
        """
        for track in tracks:
            self.targets[track.track_id] = Target(track.state, track.covariance)

    def step(
        self, stamp: float, position: FloatArray, R: FloatArray, time_offset: FloatArray
    ) -> dict[int, int]:
        """Predict all targets to a ping and update each with its detection.

        Parameters
        ----------
        stamp : float
            Stamp of the ping, s.
        position : (n, 2) ndarray
            Positions of the detections, m.
        R : (n, 2, 2) ndarray
            Their covariances, m^2.
        time_offset : (n,) ndarray
            Time after the ping's stamp at which each position is valid, s.

        Returns
        -------
        dict of int to int
            Index of the detection of each updated target.
        """
        interval = stamp - self.stamp if self.targets else 0.0
        self.stamp = stamp
        targets = list(self.targets.values())
        distance = np.full((len(targets), len(position)), GATE)
        innovations = []
        for row, target in enumerate(targets):
            target.predict(interval, self.noise)
            target.misses += 1
            innovation, S = target.innovations(position, R, time_offset)
            scaled = np.linalg.solve(S, innovation[..., None])[..., 0]
            distance[row] = np.minimum((innovation * scaled).sum(axis=1), GATE)
            innovations.append((innovation, S))
        taken = {}
        ids = list(self.targets)
        for row, column in zip(*linear_sum_assignment(distance), strict=True):
            if distance[row, column] < GATE:
                innovation, S = innovations[row]
                targets[row].update(innovation[column], S[column], time_offset[column])
                targets[row].misses = 0
                taken[ids[row]] = int(column)
        self.targets = {
            name: target
            for name, target in self.targets.items()
            if target.misses <= self.max_misses
        }
        return taken

    def tracks(self) -> list[ConfirmedTrack]:
        """All targets, as tracks for `tracked`."""
        return [
            ConfirmedTrack(name, self.stamp, target.state, target.covariance, (), math.nan)
            for name, target in self.targets.items()
        ]
