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
"""Joint integrated probabilistic data association (JIPDA), as published, as a contender.

D. Musicki, R. Evans, "Joint integrated probabilistic data association: JIPDA", IEEE Transactions on
Aerospace and Electronic Systems 40(3), 2004, with Markov chain one of existence and tracks that
start on single detections. A track of existence probability p, whose target is detected with P_D
and gated with P_G, has of a detection i with the clutter density rho_i in a joint event the factor
``p P_D P_G Lambda_i / rho_i`` and without a detection ``1 - P_D P_G p``; an event's probability is
proportional to the product of its tracks' factors. The marginals beta_i and beta_0 of the feasible
joint events give::

    exists, not detected   q = beta_0 p (1 - P_D P_G) / (1 - P_D P_G p)
    p  <- q + sum_i beta_i

and the state is the mean of its updates with weights q and beta_i (probabilistic data association).
A detection starts a track with the existence ``new_existence (1 - sum of its beta)``. Events are
enumerated in clusters of tracks that share detections; in a cluster of more than `MAX_EVENTS`
events the marginals are those of loopy belief propagation (J. Williams, R. Lau, "Approximate
evaluation of marginal association probabilities with belief propagation", IEEE Transactions on
Aerospace and Electronic Systems 50(4), 2014).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from contenders import Contender, FloatArray, Hits, RawScan, Sea
from tsepm_ros.numerics.arrays import BoolArray, IntArray

MAX_EVENTS = 5000
"""Product of the numbers of choices of a cluster's tracks up to which events are enumerated."""
PROPAGATIONS = 100
CONVERGED = 1e-4
SAME_TARGET = 9.49
"""Squared distance of two states in their covariances' sum below which the tracks are the same:
95 % of a chi-square with four degrees of freedom.
"""


@dataclass(frozen=True, kw_only=True)
class Parameters:
    """Parameters of the tracker."""

    detection_probability: float
    max_speed: float  # m/s: the standard deviation of a new track's velocity is a half
    acceleration_density: float = 0.01  # m^2/s^3
    gate_probability: float = 0.99
    survival: float = 0.999  # probability of existence in a scan, given existence in that before
    new_existence: float = 0.02
    confirm: float = 0.99
    terminate: float = 0.002


@dataclass
class Track:
    """A track: state (4,), covariance (4, 4), existence and the most probable hits."""

    track_id: int
    state: FloatArray
    covariance: FloatArray
    existence: float
    hits: list[tuple[int, int]] = field(default_factory=list)
    confirmed: bool = False


class Jipda:
    """A tracker of positions with errors in clutter of known density."""

    def __init__(self, parameters: Parameters) -> None:
        self.parameters = parameters
        self.tracks: list[Track] = []
        self._stamp = 0.0
        self._scan_index = 0
        self._started = 0

    def process(
        self, stamp: float, position: FloatArray, covariance: FloatArray, density: FloatArray
    ) -> list[Track]:
        """Take a scan and return the newly confirmed tracks.

        Parameters
        ----------
        stamp : float
            s.
        position, covariance : (d, 2), (d, 2, 2) ndarray
            Detections in a fixed frame, m, m^2.
        density : (d,) ndarray
            Clutter density at the detections, 1/m^2.
        """
        for track in self.tracks:
            self._predict(track, stamp - self._stamp)
        gated, likelihood = self._likelihoods(position, covariance)
        ratio = np.where(gated, likelihood / density, 0.0)
        marginal = self._marginals(ratio)
        for track, beta in zip(self.tracks, marginal, strict=True):
            self._update(track, beta, position, covariance)
        self._start(position, covariance, 1.0 - marginal.sum(axis=0))
        self._end()
        self._stamp = stamp
        self._scan_index += 1
        new = [
            track
            for track in self.tracks
            if not track.confirmed and track.existence >= self.parameters.confirm
        ]
        for track in new:
            track.confirmed = True
        return new

    def _predict(self, track: Track, interval: float) -> None:
        step = np.kron(np.eye(2), [[1.0, interval], [0.0, 1.0]])
        noise = [[interval**3 / 3.0, interval**2 / 2.0], [interval**2 / 2.0, interval]]
        noise = self.parameters.acceleration_density * np.kron(np.eye(2), noise)
        track.state = step @ track.state
        track.covariance = step @ track.covariance @ step.T + noise
        track.existence *= self.parameters.survival

    def _likelihoods(
        self, position: FloatArray, covariance: FloatArray
    ) -> tuple[BoolArray, FloatArray]:
        """Whether detections are gated by tracks, and ``P_D P_G Lambda``, (n, d)."""
        n = len(self.tracks)
        if not n or not len(position):
            return np.zeros((n, len(position)), bool), np.zeros((n, len(position)))
        state = np.array([track.state for track in self.tracks])
        spread = np.array([track.covariance for track in self.tracks])
        innovation = position - state[:, None, 0::2]
        total = spread[:, None, 0::2, 0::2] + covariance
        squared = np.einsum(
            "ndi,ndi->nd", innovation, np.linalg.solve(total, innovation[..., None])[..., 0]
        )
        density = np.exp(-0.5 * squared) / (2.0 * np.pi * np.sqrt(np.linalg.det(total)))
        gate = -2.0 * math.log(1.0 - self.parameters.gate_probability)
        return squared <= gate, self.parameters.detection_probability * density

    def _marginals(self, ratio: FloatArray) -> FloatArray:
        """Probability that each detection is of each track's target, (n, d)."""
        detected = self.parameters.detection_probability * self.parameters.gate_probability
        existence = np.array([track.existence for track in self.tracks]).reshape(-1, 1)
        weight = existence * ratio / (1.0 - detected * existence)
        return association_marginals(weight)

    def _update(
        self, track: Track, beta: FloatArray, position: FloatArray, covariance: FloatArray
    ) -> None:
        detected = self.parameters.detection_probability * self.parameters.gate_probability
        none = max(1.0 - beta.sum(), 0.0)
        missed = none * track.existence * (1.0 - detected) / (1.0 - detected * track.existence)
        track.existence = float(missed + beta.sum())
        rows = np.flatnonzero(beta)
        if len(rows) and beta[rows].max() > missed:
            track.hits.append((self._scan_index, int(rows[beta[rows].argmax()])))
        if track.existence <= 0.0:
            return
        weights = np.append(missed, beta[rows]) / track.existence
        spread = track.covariance
        gain = spread[:, 0::2] @ np.linalg.inv(spread[0::2, 0::2] + covariance[rows])
        innovation = position[rows] - track.state[0::2]
        states = track.state + np.einsum("dij,dj->di", gain, innovation)
        spreads = spread - gain @ spread[0::2]
        states = np.concatenate([track.state[None], states])
        spreads = np.concatenate([spread[None], spreads])
        track.state = weights @ states
        apart = states - track.state
        mixed = np.einsum("k,kij->ij", weights, spreads)
        mixed += np.einsum("k,ki,kj->ij", weights, apart, apart)
        track.covariance = 0.5 * (mixed + mixed.T)

    def _start(self, position: FloatArray, covariance: FloatArray, free: FloatArray) -> None:
        for row, share in enumerate(free):
            existence = self.parameters.new_existence * max(float(share), 0.0)
            if existence < self.parameters.terminate:
                continue
            state, spread = np.zeros(4), np.zeros((4, 4))
            state[0::2] = position[row]
            spread[0::2, 0::2] = covariance[row]
            spread[1, 1] = spread[3, 3] = (self.parameters.max_speed / 2.0) ** 2
            hits = [(self._scan_index, row)]
            self.tracks.append(Track(self._started, state, spread, existence, hits))
            self._started += 1

    def _end(self) -> None:
        """End improbable tracks, and those of a target that a more probable track has."""
        order = sorted(self.tracks, key=lambda track: (not track.confirmed, -track.existence))
        kept: list[Track] = []
        for track in order:
            if track.existence < self.parameters.terminate:
                continue
            if len(track.hits) > 1 and any(_same(track, other) for other in kept):
                continue
            kept.append(track)
        self.tracks = sorted(kept, key=lambda track: track.track_id)


def _same(track: Track, other: Track) -> bool:
    if len(other.hits) < 2 or not set(track.hits[-2:]) & set(other.hits[-2:]):
        return False
    apart = track.state - other.state
    return bool(apart @ np.linalg.solve(track.covariance + other.covariance, apart) < SAME_TARGET)


def association_marginals(weight: FloatArray) -> FloatArray:
    """Marginals of the feasible joint events.

    Parameters
    ----------
    weight : (n, d) ndarray
        Factor of each detection for each track; that of no detection is 1; 0: not gated.

    Returns
    -------
    (n, d) ndarray
    """
    n, _ = weight.shape
    marginal = np.zeros_like(weight)
    tracks, detections = np.nonzero(weight)
    if not len(tracks):
        return marginal
    size = sum(weight.shape)
    graph = coo_array((np.ones(len(tracks)), (tracks, n + detections)), shape=(size, size))
    _, label = connected_components(graph, directed=False)
    for cluster in np.unique(label[tracks]):
        rows = np.flatnonzero(label[:n] == cluster)
        columns = np.flatnonzero(label[n:] == cluster)
        part = weight[np.ix_(rows, columns)]
        choices = math.prod(1 + int(k) for k in np.count_nonzero(part, axis=1))
        of_cluster = enumerated if choices <= MAX_EVENTS else propagated
        marginal[np.ix_(rows, columns)] = of_cluster(part)
    return marginal


def enumerated(weight: FloatArray) -> FloatArray:
    """Marginals of a cluster by the enumeration of its events."""
    choices: list[IntArray] = [np.flatnonzero(row) for row in weight]
    total, sums = 0.0, np.zeros_like(weight)
    stack: list[tuple[tuple[int, ...], float]] = [((), 1.0)]
    while stack:
        event, factor = stack.pop()
        track = len(event)
        if track == len(choices):
            total += factor
            for row, column in enumerate(event):
                if column >= 0:
                    sums[row, column] += factor
            continue
        stack.append(((*event, -1), factor))
        stack.extend(
            ((*event, int(column)), factor * float(weight[track, column]))
            for column in choices[track]
            if column not in event
        )
    return sums / total


def propagated(weight: FloatArray) -> FloatArray:
    """Marginals of a cluster by loopy belief propagation."""
    message = np.ones_like(weight)
    for _ in range(PROPAGATIONS):
        product = weight * message
        to_detection = weight / (1.0 + product.sum(axis=1, keepdims=True) - product)
        new = 1.0 / (1.0 + to_detection.sum(axis=0) - to_detection)
        converged = np.abs(new - message).max() < CONVERGED
        message = new
        if converged:
            break
    product = weight * message
    return product / (1.0 + product.sum(axis=1, keepdims=True))


class JipdaContender(Contender):
    """JIPDA with the scene's parameters; its rule is the existence from which tracks confirm."""

    def __init__(self, sea: Sea, min_hits: int = 0, window: int = 0, confirm: float = 0.99) -> None:
        super().__init__(sea, min_hits, window)
        self._tracker = Jipda(
            Parameters(
                detection_probability=sea.detection_probability,
                max_speed=sea.max_speed,
                acceleration_density=1e-4,
                confirm=confirm,
            )
        )
        self._new: list[Track] = []

    def process(self, scan: RawScan) -> int:
        """See `Contender.process`."""
        position, covariance = converted(
            scan.range,
            scan.azimuth,
            self.sea.range_std_fraction * scan.range,
            np.full(len(scan), self.sea.azimuth_std),
        )
        density = np.full(len(scan), self.sea.clutter_density)
        self._new = self._tracker.process(scan.stamp, position, covariance, density)
        return len(self._new)

    def hits(self) -> list[Hits]:
        """See `Contender.hits`."""
        return [tuple(track.hits) for track in self._new]

    def states(self) -> FloatArray:
        """See `Contender.states`."""
        return np.array([track.state for track in self._new]).reshape(-1, 4)

    def covariances(self) -> FloatArray:
        """See `Contender.covariances`."""
        return np.array([track.covariance for track in self._new]).reshape(-1, 4, 4)

    def counts(self) -> dict[str, int]:
        """See `Contender.counts`."""
        return {"potential": sum(not track.confirmed for track in self._tracker.tracks)}


def converted(
    range_: FloatArray, azimuth: FloatArray, range_std: FloatArray, azimuth_std: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Positions (d, 2) and covariances (d, 2, 2) of detections, linearised."""
    cosine, sine = np.cos(azimuth), np.sin(azimuth)
    turn = np.moveaxis(np.array([[cosine, -sine], [sine, cosine]]), -1, 0)
    errors = np.stack([range_std, range_ * azimuth_std], axis=1) ** 2
    covariance = np.einsum("dij,dj,dkj->dik", turn, errors, turn)
    return range_[:, None] * np.stack([cosine, sine], axis=1), covariance
