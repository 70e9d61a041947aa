"""A tracker as small as it can be: a Kalman filter per target, nearest-neighbour association.

No ROS here; `kalman_tracker.py` is the node around it. What is special is `start`: the filter
begins with the state and the full covariance of a new track.
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
"""Squared distance within which a detection may be a target's: chi-square, 2 degrees, at 0.99."""


@dataclass
class Target:
    """A target that is followed: ``[x, vx, y, vy]`` with its covariance, and misses in a row."""

    state: FloatArray
    covariance: FloatArray
    misses: int = 0

    def predict(self, step: float, noise: float) -> None:
        """Carry it over a time (s) at constant velocity: ``F x``, ``F P F' + Q``.

        The velocity's variance grows by `noise` (m^2/s^3) per second.
        """
        F = np.kron(np.eye(2), [[1.0, step], [0.0, 1.0]])
        Q = noise * np.kron(np.eye(2), [[step**3 / 3.0, step**2 / 2.0], [step**2 / 2.0, step]])
        self.state = F @ self.state
        self.covariance = F @ self.covariance @ F.T + Q

    def innovations(
        self, position: FloatArray, R: FloatArray, lag: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """What each detection is off, (n, 2), and the covariance of that, (n, 2, 2).

        An echo's position is valid some time `lag` (n,) after the ping, s: far ones later.
        """
        H = measurement_matrix(lag)
        S = H @ self.covariance @ np.swapaxes(H, 1, 2) + R
        return position - H @ self.state, S

    def update(self, innovation: FloatArray, S: FloatArray, lag: float) -> None:
        """Take a detection: ``K = P H' S^-1``, ``x + K d``, ``P - K S K'``."""
        [H] = measurement_matrix(np.array([lag]))
        K = np.linalg.solve(S, H @ self.covariance).T
        self.state = self.state + K @ innovation
        self.covariance = self.covariance - K @ S @ K.T
        self.covariance = 0.5 * (self.covariance + self.covariance.T)


def measurement_matrix(lag: FloatArray) -> FloatArray:
    """From a state to the positions some times (n,) later, s: (n, 2, 4)."""
    H = np.zeros((len(lag), 2, 4))
    H[:, 0, 0] = H[:, 1, 2] = 1.0
    H[:, 0, 1] = H[:, 1, 3] = lag
    return H


class NearestNeighbourTracker:
    """Follows targets from where they were started until they are missed too often.

    Parameters
    ----------
    noise : float, optional
        Spectral density of the targets' acceleration, m^2/s^3.
    max_misses : int, optional
        A target with more misses in a row ends.

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
        """Forget everything."""
        self.stamp = -math.inf
        self.targets: dict[int, Target] = {}

    def start(self, tracks: Iterable[ConfirmedTrack]) -> None:
        """Start a filter with the state and the full covariance of each new track of this time."""
        for track in tracks:
            self.targets[track.track_id] = Target(track.state, track.covariance)

    def step(
        self, stamp: float, position: FloatArray, R: FloatArray, lag: FloatArray
    ) -> dict[int, int]:
        """Carry all targets to a ping and give each its detection.

        Parameters
        ----------
        stamp : float
            The ping's, s.
        position : (n, 2) ndarray
            Of the detections, m.
        R : (n, 2, 2) ndarray
            Covariance of these, m^2.
        lag : (n,) ndarray
            Time after the ping's stamp for which each is valid, s.

        Returns
        -------
        dict of int to int
            The detection that each target took.
        """
        step = stamp - self.stamp if self.targets else 0.0
        self.stamp = stamp
        targets = list(self.targets.values())
        distance = np.full((len(targets), len(position)), GATE)
        found = []
        for row, target in enumerate(targets):
            target.predict(step, self.noise)
            target.misses += 1
            innovation, S = target.innovations(position, R, lag)
            scaled = np.linalg.solve(S, innovation[..., None])[..., 0]
            distance[row] = np.minimum((innovation * scaled).sum(axis=1), GATE)
            found.append((innovation, S))
        taken = {}
        ids = list(self.targets)
        for row, column in zip(*linear_sum_assignment(distance), strict=True):
            if distance[row, column] < GATE:
                innovation, S = found[row]
                targets[row].update(innovation[column], S[column], lag[column])
                targets[row].misses = 0
                taken[ids[row]] = int(column)
        self.targets = {
            name: target
            for name, target in self.targets.items()
            if target.misses <= self.max_misses
        }
        return taken

    def tracks(self) -> list[ConfirmedTrack]:
        """Everything that is followed, as what `tracked` is to say."""
        return [
            ConfirmedTrack(name, self.stamp, target.state, target.covariance, (), math.nan)
            for name, target in self.targets.items()
        ]
