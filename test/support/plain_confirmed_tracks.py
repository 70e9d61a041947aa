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
"""One scan of confirmed tracks, written from the equations: loops over branches and detections.

Track splitting with existence (Musicki, La Scala, Evans 2007), each branch of interacting multiple
models (Blom, Bar-Shalom 1988; Musicki, Suvorova 2008), one global assignment (Blackman 2004), and
for starts the detections that are a target's (Musicki, La Scala 2008). Detections are converted by
`plain_tsepm`. Every constant stands here again. The modes of motion are going on and turning.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.stats import chi2

from support.plain_tsepm import MEASUREMENT_MATRIX as POSITION
from support.plain_tsepm import (
    Detection,
    Parameters,
    convert_scan,
    covariance_at,
    transition_matrix,
)

P_G = 0.99
GATE, GATE_WITH_RANGE_RATE = chi2.ppf(P_G, [2, 3]).tolist()
VELOCITY = np.array([[0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
CHANGE = np.array([[29.0 / 30.0, 1.0 / 30.0], [0.5, 0.5]])
"""Probability of each mode, along the second axis, after each in the scan before."""
FADED = 0.02
"""P_D of a faded target, in that of a seen one."""


@dataclass(frozen=True)
class Rule:
    """Parameters of the maintenance."""

    settings: Parameters
    hold_time: float
    detection_probability: float
    range_rate_std: float
    max_range: float
    target_extent: float


@dataclass
class Branch:
    """Weight, probability to have faded, and probability (2,) and states (2, ...) of the modes."""

    weight: float
    faded: float
    probability: np.ndarray
    state: np.ndarray
    covariance: np.ndarray

    @property
    def visible(self) -> float:
        return 1.0 - self.faded + FADED * self.faded


@dataclass
class PlainTrack:
    """A confirmed track."""

    track_id: int
    branches: list[Branch]
    fit: tuple[np.ndarray, np.ndarray]
    odds: float
    existence: float
    proven: float
    covered_scans: float
    last_detected: float
    hit_sigma: float
    sure: bool
    seen: bool = True

    def mean(self) -> tuple[np.ndarray, np.ndarray]:
        """Over all modes of all branches."""
        return mixture(
            np.concatenate([one.weight * one.probability for one in self.branches]),
            np.concatenate([one.state for one in self.branches]),
            np.concatenate([one.covariance for one in self.branches]),
        )


Hit = tuple[float, np.ndarray, np.ndarray]
"""Likelihood of a detection, 0 outside the gate, and the state and covariance after it."""


@dataclass
class PlainStep:
    """The tracks before a scan, and after `take` those after it and what the scan told."""

    rule: Rule
    tracks: list[PlainTrack]
    ended: dict[int, str] = field(default_factory=dict)
    own: list[tuple[int, int]] = field(default_factory=list)
    probability: np.ndarray = field(default_factory=lambda: np.zeros(0))
    covered: list[tuple[float, float]] = field(default_factory=list)
    branched: int = 0

    def take(
        self,
        scan: Mapping[str, Any],
        elapsed: float,
        clutter: np.ndarray,
        detectable: Callable[[np.ndarray], np.ndarray],
        whole: bool,
        noise: float,
    ) -> None:
        """Take a scan of a part of the coverage or all, some seconds after the tracks' stamp."""
        rule, stamp = self.rule, scan["stamp"]
        self.end(lambda t: t.last_detected >= stamp - rule.hold_time, lambda t: "not_detected")
        detections = convert_scan(scan, 0, rule.settings)
        hits = Hits(detections, scan, rule)
        empty, ratios, mine = [], [], []
        for t in self.tracks:
            p_d = self.predict(t, elapsed, whole, noise, detectable)
            rate = rule.detection_probability / clutter
            found = [
                [hits.of_modes(one.state, one.covariance, j) for j in range(len(detections))]
                for one in t.branches
            ]
            own = [
                [
                    one.visible * rate[j] * one.probability * [mode[0] for mode in modes]
                    for j, modes in enumerate(of_branch)
                ]
                for one, of_branch in zip(t.branches, found, strict=True)
            ]
            empty.append(sum(one.weight * (1.0 - p_d * one.visible * P_G) for one in t.branches))
            ratios.append(
                [
                    sum(one.weight * of[j].sum() for one, of in zip(t.branches, own, strict=True))
                    for j in range(len(detections))
                ]
            )
            mine.append((p_d, found, own))
        existence = np.array([t.existence for t in self.tracks])
        ratio = np.reshape(ratios, (len(self.tracks), len(detections)))
        owner = assigned(existence, np.array(empty), ratio)
        self.probability = confirmed_probability(existence, np.array(empty), ratio)
        for i, t in enumerate(self.tracks):
            may = [j for j in range(len(detections)) if owner[j] in (-1, i)]
            of_fit = self.fit(t, hits, may, clutter, empty[i])
            of_filter, taken = self.split(t, may, *mine[i])
            t.odds *= of_filter / (0.98 * of_fit + 0.02 * of_filter)
            self.update(t, of_filter, empty[i], stamp)
            for j, weight in taken.items():
                if weight * t.existence > 0.5:
                    t.hit_sigma = detections[j].major_axis_std
                    self.own.append((t.track_id, j))
            if t.odds >= 9.0:
                t.fit, t.odds = t.mean(), 0.0
        self.end(lambda t: t.existence >= 1e-5, lambda t: "missed" if t.seen else "left")
        for t in self.tracks:
            t.sure = self.shown(t)

    def end(self, kept: Callable[[PlainTrack], bool], why: Callable[[PlainTrack], str]) -> None:
        self.ended |= {t.track_id: why(t) for t in self.tracks if not kept(t)}
        self.tracks = [t for t in self.tracks if kept(t)]

    def predict(
        self,
        t: PlainTrack,
        time: float,
        whole: bool,
        noise: float,
        detectable: Callable[[np.ndarray], np.ndarray],
    ) -> float:
        """Carry a track on to the scan; returns P_D where it then is.

        A seen target fades once in 25 scans, a faded one is seen again after 8 in the mean; a
        target vanishes once in 50 scans, or leaves for good after 8 outside the coverage. A scan of
        a part of the coverage elsewhere tells of neither.
        """
        for one in t.branches:
            predict(one, time, self.rule.settings.max_speed, noise)
        (x, p), f = t.fit, transition_matrix(time)
        t.fit = f @ x, f @ p @ f.T + white_noise(time, 1e-4)
        t.odds += 1.0 - math.exp(-time / 1e4)
        (p_d,) = detectable(t.mean()[0][None, [0, 2]])
        for one in t.branches if whole or p_d > 0.0 else ():
            one.faded = 7.0 / 8.0 * one.faded + (1.0 - one.faded) / 25.0
        t.seen = p_d > 0.0
        if whole or t.seen:
            stays = 49.0 / 50.0 if t.seen else 7.0 / 8.0
            t.existence, t.proven = stays * t.existence, stays * t.proven
        return float(p_d)

    def split(
        self,
        t: PlainTrack,
        may: list[int],
        p_d: float,
        found: list[list[list[Hit]]],
        own: list[list[np.ndarray]],
    ) -> tuple[float, dict[int, float]]:
        """Split and prune; returns Lambda, and the weight of each detection's branches."""
        new: list[tuple[float, int, Branch]] = []
        speed = self.rule.settings.max_speed
        for one, hits, ratios in zip(t.branches, found, own, strict=True):
            missed = 1.0 - p_d * one.visible * P_G
            faded = one.faded * (1.0 - FADED * p_d * P_G) / missed
            new.append((one.weight * missed, -1, replace(one, faded=faded)))
            for j in may:
                if (sum_ := ratios[j].sum()) > 0.0:
                    _, state, covariance = map(np.array, zip(*hits[j], strict=True))
                    faded = FADED * one.faded / one.visible
                    hit = Branch(0.0, faded, ratios[j] / sum_, state, covariance)
                    new.append((one.weight * sum_, j, hit))
        new.sort(key=lambda row: -row[0])
        new = [row for row in new[:4] if row[0] > math.exp(-7.0) * new[0][0]]
        total = sum(weight for weight, _, _ in new)
        t.branches = [replace(one, weight=weight / total) for weight, _, one in new]
        for one in t.branches:
            states = map(limited, one.state, one.covariance, (speed, speed))
            one.state, one.covariance = map(np.array, zip(*states, strict=True))
        self.branched += len(new) > 1
        return total, {
            j: sum(weight for weight, row, _ in new if row == j) / total
            for j in {row for _, row, _ in new if row >= 0}
        }

    def fit(
        self, t: PlainTrack, hits: "Hits", may: list[int], clutter: np.ndarray, empty: float
    ) -> float:
        """Update a track's straight fit by the detection that fits it best; returns its Lambda."""
        x, p = t.fit
        found = {j: hits.of_modes(x[None], p[None], j)[0] for j in may}
        ratio = {
            j: hit[0] * self.rule.detection_probability / clutter[j] for j, hit in found.items()
        }
        if not any(ratio.values()):
            return empty
        best = max(ratio, key=ratio.__getitem__)
        total = empty + ratio[best]
        beta = ratio[best] / total
        _, moved, narrowed = found[best]
        t.fit = mixture(np.array([1.0 - beta, beta]), np.stack([x, moved]), np.stack([p, narrowed]))
        return total

    def update(self, t: PlainTrack, ratio: float, empty: float, stamp: float) -> None:
        """The probabilities after a scan."""
        t.existence *= ratio / (1.0 - t.existence + ratio * t.existence)
        of_target = max(1.0 - empty / ratio, 0.0)
        if t.seen:  # the proof is as if P_D were one half
            proof = 1.0 + 0.5 * P_G * ((ratio - empty) / (1.0 - empty) - 1.0)
            t.proven *= proof / (1.0 - t.proven + proof * t.proven)
            self.covered.append((of_target * t.proven, t.covered_scans + 1.0))
        t.covered_scans = (t.covered_scans + t.seen) * (1.0 - of_target * t.existence)
        if of_target * t.existence >= 0.5:
            t.last_detected = stamp

    def shown(self, t: PlainTrack) -> bool:
        """Whether a track is sure, and does not coast.

        The place is as well known as the last detection's, up to 4.5 times, or as the extent of a
        target, and to a quarter of the range; it exists with 0.5, or with 0.9 if it coasted.
        """
        error = sigma(t.mean()[1][np.ix_([0, 2], [0, 2])])
        known = min(max(4.5 * t.hit_sigma, self.rule.target_extent), self.rule.max_range / 4.0)
        return t.existence >= (0.5 if t.sure else 0.9) and error <= known


def mixture(
    weight: np.ndarray, state: np.ndarray, covariance: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of Gaussians along the first axis."""
    mean = weight @ state
    apart = state - mean
    spread = covariance + apart[:, :, None] * apart[:, None, :]
    return mean, np.einsum("k,kij->ij", weight, spread)


def white_noise(time: float, density: float) -> np.ndarray:
    """Covariance of a state by white acceleration."""
    block = np.array([[time**2 / 3.0, time / 2.0], [time / 2.0, 1.0]])
    return np.kron(np.eye(2), density * time * block)


def predict(one: Branch, time: float, max_speed: float, noise: float) -> None:
    """Carry a branch on; turning, the variance of velocity grows to v_max^2 / 4 in 5 s.

    Modes change as in a scan of a second or longer, in a shorter time as much less.
    """
    change = np.eye(2) + min(abs(time), 1.0) * (CHANGE - np.eye(2))
    mixed = np.maximum(one.probability, 1e-30)[:, None] * change
    before, f = (one.state, one.covariance), transition_matrix(time)
    one.probability = mixed.sum(axis=0)
    one.state, one.covariance = np.empty_like(before[0]), np.empty_like(before[1])
    for to, turning in enumerate((0.0, max_speed**2 / 4.0 / max(time, 5.0))):
        state, covariance = mixture(mixed[:, to] / one.probability[to], *before)
        one.state[to] = f @ state
        one.covariance[to] = f @ covariance @ f.T + white_noise(time, noise + turning)


@dataclass
class Hits:
    """What the detections of a scan make of a state."""

    detections: list[Detection]
    scan: Mapping[str, Any]
    rule: Rule

    def of_modes(self, state: np.ndarray, covariance: np.ndarray, j: int) -> list[Hit]:
        """Of one detection in each mode; what is far outside every gate is left out."""
        detection, modes = self.detections[j], list(zip(state, covariance, strict=True))
        h = POSITION @ transition_matrix(detection.time - self.scan["stamp"])
        error = (3.0 * detection.major_axis_std) ** 2
        far = [
            math.dist(detection.point, h @ x) ** 2 > 30.0 * (np.trace(h @ p @ h.T) + error)
            for x, p in modes
        ]
        return [(0.0, x, p) if all(far) else self.of(x, p, j) for x, p in modes]

    def of(self, x: np.ndarray, p: np.ndarray, j: int) -> Hit:
        """Of one detection, at its own time, with its range rate where it has one."""
        detection, rule, stamp = self.detections[j], self.rule, self.scan["stamp"]
        rates = self.scan.get("features", {}).get("range_rate", np.full(j + 1, math.nan))
        has_rate = math.isfinite(rates[j]) and rule.range_rate_std > 0.0
        gate = GATE_WITH_RANGE_RATE if has_rate else GATE
        h = POSITION @ transition_matrix(detection.time - stamp)
        s = h @ p @ h.T + covariance_at(h @ x, detection.sensing, rule.settings)
        v = detection.point - h @ x
        distance = v @ np.linalg.inv(s) @ v
        scale = 2.0 * math.pi * math.sqrt(np.linalg.det(s))
        gain = p @ h.T @ np.linalg.inv(s)
        x, p = x + gain @ v, p - gain @ s @ gain.T
        if has_rate:
            moves = np.array(self.scan["sensor_velocity"])
            error, variance, gradient = range_rate_innovation(
                x, p, detection, rates[j], moves, stamp, rule.range_rate_std
            )
            distance += error**2 / variance
            scale *= math.sqrt(2.0 * math.pi * variance)
            gain = p @ gradient / variance
            x, p = x + gain * error, p - variance * np.outer(gain, gain)
        return (math.exp(-distance / 2.0) / scale if distance <= gate else 0.0), x, p


def assigned(existence: np.ndarray, empty: np.ndarray, ratio: np.ndarray) -> np.ndarray:
    """Track of each detection, or -1: the largest product of ratios above 1."""
    r, owner = existence[:, None], np.full(ratio.shape[1], -1)
    gain = np.log((1.0 - r + r * ratio) / (1.0 - r + r * empty[:, None]))
    track, row = linear_sum_assignment(np.maximum(gain, 0.0), maximize=True)
    some = gain[track, row] > 0.0
    owner[row[some]] = track[some]
    return owner


def confirmed_probability(
    existence: np.ndarray, empty: np.ndarray, ratio: np.ndarray
) -> np.ndarray:
    """Probability that each detection is a target's; of ratios (n, d)."""
    (n, d), alone, factor = ratio.shape, np.ones(ratio.shape), np.ones(ratio.shape)

    def of(i: int, j: int, values: np.ndarray) -> float:
        rest = empty[i] + sum(values[i, k] for k in range(d) if k != j)
        r = existence[i]
        return (1.0 - r + r * (rest + ratio[i, j])) / (1.0 - r + r * rest)

    for i, j in np.ndindex(n, d):
        alone[i, j] = of(i, j, ratio)
    others = [
        [math.prod(alone[k, j] for k in range(n) if k != i) for j in range(d)] for i in range(n)
    ]
    for i, j in np.ndindex(n, d):
        factor[i, j] = of(i, j, ratio / np.reshape(others, ratio.shape))
    return 1.0 - 1.0 / factor.prod(axis=0)


def range_rate_innovation(
    x: np.ndarray,
    p: np.ndarray,
    detection: Detection,
    measured: float,
    sensor_velocity: np.ndarray,
    stamp: float,
    std: float,
) -> tuple[float, float, np.ndarray]:
    """Range rate less the expected, c = u.(v - w), to second order; its variance; its gradient.

    With the displacement across the line of sight of variance A, the velocity across it of
    variance B and C between them, the mean of what is left out is C / r, its variance
    (A B + C^2) / r^2.
    """
    at = transition_matrix(detection.time - stamp)
    offset = POSITION @ at @ x - detection.sensing.position
    relative = VELOCITY @ at @ x - sensor_velocity
    r = math.hypot(*offset)
    u = offset / r
    rate = float(u @ relative)
    gradient = (relative - rate * u) / r @ POSITION @ at + u @ VELOCITY @ at
    across = np.array([-u[1], u[0]])
    place, speed = across @ POSITION @ at, across @ VELOCITY @ at
    a, b, c = place @ p @ place, speed @ p @ speed, place @ p @ speed
    variance = gradient @ p @ gradient + std**2 + (a * b + c * c) / r**2
    return measured - rate - c / r, float(variance), gradient


def sigma(covariance: np.ndarray) -> float:
    """Standard deviation along the major axis."""
    return math.sqrt(np.linalg.eigvalsh(covariance)[-1])


def in_disc(
    mean: np.ndarray, covariance: np.ndarray, radius: float, radii: int = 80, angles: int = 160
) -> tuple[float, np.ndarray, np.ndarray]:
    """Probability of a disc, and mean and covariance in it, by sums over a polar grid."""
    nodes, weights = np.polynomial.legendre.leggauss(radii)
    along, angle = radius * (nodes + 1.0) / 2.0, 2.0 * math.pi * np.arange(angles) / angles
    v = np.outer(along, np.exp(1j * angle)).ravel().view(float).reshape(-1, 2)
    area = np.repeat(weights * radius / 2.0 * along * 2.0 * math.pi / angles, angles)
    error = v - mean
    square = (error @ np.linalg.inv(covariance) * error).sum(axis=1)
    mass = area * np.exp(-0.5 * square) / (2.0 * math.pi * math.sqrt(np.linalg.det(covariance)))
    mean = mass @ v / mass.sum()
    apart = v - mean
    return float(mass.sum()), mean, (mass[:, None] * apart).T @ apart / mass.sum()


def limited(
    state: np.ndarray, covariance: np.ndarray, max_speed: float
) -> tuple[np.ndarray, np.ndarray]:
    """The state given a speed of at most v_max, if the mean is faster."""
    mean, spread = VELOCITY @ state, VELOCITY @ covariance @ VELOCITY.T
    if math.hypot(*mean) <= max_speed:
        return state, covariance
    _, within, second = in_disc(mean, spread, max_speed)
    gain = covariance @ VELOCITY.T @ np.linalg.inv(spread)
    return state + gain @ (within - mean), covariance + gain @ (second - spread) @ gain.T
