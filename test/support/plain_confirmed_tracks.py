"""One scan of confirmed tracks, written from the equations: loops over track, mode and detection.

Interacting multiple models (Blom, Bar-Shalom 1988), integrated probabilistic data association with
a Markov chain two (Musicki, Evans, Stankovic 1994; with modes: Musicki, Suvorova 2008) and targets
that compete for detections (Musicki, La Scala 2008). Detections are converted by `plain_tsepm`.
Every constant stands here again. Tracks are a mapping of columns, with the modes of motion, going
on and turning, along the second axis.
"""

import itertools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
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

Columns = dict[str, np.ndarray]


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
class PlainStep:
    """The tracks before a scan, and after `take` those after it and what the scan told."""

    rule: Rule
    tracks: Columns
    ended: dict[int, str] = field(default_factory=dict)
    association: list[tuple[int, float]] = field(default_factory=list)
    density: np.ndarray = field(default_factory=lambda: np.zeros(0))
    covered: tuple[np.ndarray, np.ndarray] = (np.zeros(0), np.zeros(0))

    def take(
        self,
        scan: Mapping[str, Any],
        elapsed: float,
        clutter: np.ndarray,
        detectable: Callable[[np.ndarray], np.ndarray],
        whole_coverage: bool,
    ) -> None:
        """Take a scan of a part of the coverage or all, some seconds after the tracks' stamp."""
        rule, stamp = self.rule, scan["stamp"]
        self.end(self.tracks["last_detected"] >= stamp - rule.hold_time, "not_detected")
        t = self.tracks
        predict(t, elapsed, rule.settings.max_speed)
        place, _ = mixture(t["probability"], t["state"], t["covariance"])
        p_d = detectable(place[:, [0, 2]])
        t["seen"] = p_d > 0.0
        wait(t, t["seen"] | whole_coverage)
        detections = convert_scan(scan, 0, rule.settings)
        near = [neighbours(one, detections, stamp) for one in place]
        likelihood, state, covariance = fits(t, detections, near, scan, rule)
        # L_ijm = s_i P_D N_ijm / lambda_j, and b_i = 1 - s_i P_D P_G.
        empty = 1.0 - t["visible"] * p_d * P_G
        ratio = likelihood * t["visible"][:, None, None] * rule.detection_probability / clutter
        mean = np.einsum("im,imj->ij", t["probability"], ratio)
        alone = factors(t["existence"], empty, mean, mean)
        left = [np.delete(alone, i, axis=0).prod(axis=0) for i in range(len(alone))]
        left = np.reshape(left, mean.shape)
        competing = mean / left
        of_confirmed = factors(t["existence"], empty, mean, competing).prod(axis=0)
        self.density = clutter * (of_confirmed - 1.0)
        detected = update(t, state, covariance, ratio / left[:, None], empty, rule, stamp)
        scans = t["covered_scans"] + t["seen"]
        t["covered_scans"] = scans * (1.0 - detected)
        sample = detected * t["proven"] / t["existence"]
        self.covered = sample[t["seen"]], scans[t["seen"]]
        origin = competing / (empty + competing.sum(axis=1))[:, None] * t["existence"][:, None]
        self.association = [(j, origin[i, j]) for i, some in enumerate(near) for j in some]
        t["explained"], t["located"] = origin.sum(axis=1), np.zeros(len(origin), bool)
        for i, some in enumerate(near):
            if some:
                spread = t["spread"][i][np.ix_([0, 2], [0, 2])]
                t["located"][i] = sigma(spread) <= 2.0 * detections[some[0]].major_axis_std
            for j in np.flatnonzero(origin[i] > 0.5):
                t["hit_sigma"][i] = detections[j].major_axis_std
        self.end((t["existence"] >= 0.01) | ~t["seen"], "missed")
        self.end(self.tracks["existence"] >= 0.01, "left")
        count(self.tracks)
        self.end(self.tracks["agreeing_scans"] < 5, "duplicate")
        self.tracks["published"] = self.shown()

    def end(self, kept: np.ndarray, why: str) -> None:
        self.ended |= dict.fromkeys(self.tracks["track_id"][~kept].tolist(), why)
        self.tracks = {name: column[kept] for name, column in self.tracks.items()}

    def shown(self) -> np.ndarray:
        """Which tracks are published, not withheld.

        The place is as well known as the last detection's, up to 4.5 times, or as the extent of a
        target, and to a quarter of the range; it exists with 0.5, or with 0.9 if it was withheld.
        """
        t = self.tracks
        error = np.array([sigma(one[np.ix_([0, 2], [0, 2])]) for one in t["spread"]])
        known = np.minimum(
            np.maximum(4.5 * t["hit_sigma"], self.rule.target_extent), self.rule.max_range / 4.0
        )
        return (t["existence"] >= np.where(t["published"], 0.5, 0.9)) & (error <= known)


def mixture(
    weight: np.ndarray, state: np.ndarray, covariance: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of Gaussians along the last axis of their weights."""
    mean = np.einsum("...k,...ki->...i", weight, state)
    apart = state - mean[..., None, :]
    spread = covariance + apart[..., :, None] * apart[..., None, :]
    return mean, np.einsum("...k,...kij->...ij", weight, spread)


def predict(t: Columns, time: float, max_speed: float) -> None:
    """Carry the tracks on; turning, the variance of velocity grows to v_max^2 / 4 in 5 s."""
    mixed = t["probability"][:, :, None] * CHANGE
    before, f = (t["state"], t["covariance"]), transition_matrix(time)
    t["probability"] = mixed.sum(axis=1)
    t["state"], t["covariance"] = np.empty_like(before[0]), np.empty_like(before[1])
    for to, turning in enumerate((0.0, max_speed**2 / 4.0 / max(time, 5.0))):
        block = np.array([[time**2 / 3.0, time / 2.0], [time / 2.0, 1.0]])
        q = np.kron(np.eye(2), (0.01 + turning) * time * block)
        state, covariance = mixture(mixed[..., to] / t["probability"][:, [to]], *before)
        t["state"][:, to], t["covariance"][:, to] = state @ f.T, f @ covariance @ f.T + q


def wait(t: Columns, counts: np.ndarray) -> None:
    """A scan's time in the chain of visible, faded and gone, where the scan counts.

    A visible target fades once in 25 scans, a faded one is visible again after 8 in the mean; a
    target vanishes once in 50 scans, or leaves for good after 8 outside the coverage.
    """
    stays = np.where(t["seen"], 1.0 - 1.0 / 50.0, 1.0 - 1.0 / 8.0)
    for name in ("existence", "proven"):
        t[name] = np.where(counts, stays, 1.0) * t[name]
    visible = 24.0 / 25.0 * t["visible"] + (1.0 - t["visible"]) / 8.0
    t["visible"] = np.where(counts, visible, t["visible"])


def neighbours(state: np.ndarray, detections: list[Detection], stamp: float) -> list[int]:
    """The eight detections nearest to where a track is in the middle of the scan, nearest first."""
    times = [detection.time - stamp for detection in detections] or [0.0]
    centre = POSITION @ transition_matrix((min(times) + max(times)) / 2.0) @ state
    return sorted(range(len(detections)), key=lambda j: math.dist(detections[j].point, centre))[:8]


def fits(
    t: Columns,
    detections: list[Detection],
    near: list[list[int]],
    scan: Mapping[str, Any],
    rule: Rule,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Likelihood (n, 2, d) of near detections, and the states if they are the targets'.

    A detection is compared at its own time; S is that of the track's nearest detection at that
    detection's time. So is the Kalman gain. Where detections have range rates, S and the gain are
    each detection's own.
    """
    stamp, shape = scan["stamp"], (len(near), 2, len(detections))
    rates = np.array(scan.get("features", {}).get("range_rate", np.full(len(detections), math.nan)))
    has_rate = np.isfinite(rates) & (rule.range_rate_std > 0.0)
    likelihood, states, covariances = (np.zeros((*shape, *more)) for more in ((), (4,), (4, 4)))
    for (i, some), m in itertools.product(enumerate(near), (0, 1)):
        for j in some:
            detection, nearest = detections[j], detections[j if has_rate.any() else some[0]]
            x, p = t["state"][i, m], t["covariance"][i, m]
            h_nearest = POSITION @ transition_matrix(nearest.time - stamp)
            h = POSITION @ transition_matrix(detection.time - stamp)
            s = h_nearest @ p @ h_nearest.T
            s = s + covariance_at(h_nearest @ x, nearest.sensing, rule.settings)
            v = detection.point - h @ x
            distance = v @ np.linalg.inv(s) @ v
            scale = 2.0 * math.pi * math.sqrt(np.linalg.det(s))
            gain = p @ h_nearest.T @ np.linalg.inv(s)
            x, p = x + gain @ v, p - gain @ s @ gain.T
            if distance <= GATE_WITH_RANGE_RATE and has_rate[j]:
                moves = np.array(scan["sensor_velocity"])
                error, variance, gradient = range_rate_innovation(
                    x, p, detection, rates[j], moves, stamp, rule.range_rate_std
                )
                distance += error**2 / variance
                scale *= math.sqrt(2.0 * math.pi * variance)
                gain = p @ gradient / variance
                x, p = x + gain * error, p - variance * np.outer(gain, gain)
            if distance <= (GATE_WITH_RANGE_RATE if has_rate[j] else GATE):
                likelihood[i, m, j] = math.exp(-distance / 2.0) / scale
            states[i, m, j], covariances[i, m, j] = x, p
    return likelihood, states, covariances


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


def factors(
    existence: np.ndarray, empty: np.ndarray, ratio: np.ndarray, of_others: np.ndarray
) -> np.ndarray:
    """f: factors of the scan's likelihood by each target's possible origin of each detection."""
    rest = of_others.sum(axis=1, keepdims=True) - of_others
    r = existence[:, None]
    without = 1.0 - r + r * (empty[:, None] + rest)
    return (without + r * ratio) / without


def update(
    t: Columns,
    state: np.ndarray,
    covariance: np.ndarray,
    ratio: np.ndarray,
    empty: np.ndarray,
    rule: Rule,
    stamp: float,
) -> np.ndarray:
    """Update the tracks; returns the probabilities that the targets were detected."""
    weight = np.append(np.broadcast_to(empty[:, None, None], (len(empty), 2, 1)), ratio, axis=2)
    of_mode = weight.sum(axis=2)  # 1 - delta of the mode
    state = np.append(t["state"][:, :, None], state, axis=2)
    covariance = np.append(t["covariance"][:, :, None], covariance, axis=2)
    state, covariance = mixture(weight / of_mode[..., None], state, covariance)
    for row in np.ndindex(of_mode.shape):
        state[row], covariance[row] = limited(state[row], covariance[row], rule.settings.max_speed)
    probability = t["probability"] * of_mode
    whole = probability.sum(axis=1)
    probability /= whole[:, None]
    proof = np.ones(len(whole))  # as if P_D were one half
    some = empty < 1.0
    proof[some] += 0.5 * P_G * ((whole - empty)[some] / (1.0 - empty[some]) - 1.0)
    mean, spread = mixture(probability, state, covariance)
    t |= {"probability": probability, "state": state, "covariance": covariance}
    t |= {"mean": mean, "spread": spread, "visible": 1.0 - (1.0 - t["visible"]) / whole}
    for name, factor in (("existence", whole), ("proven", proof)):
        t[name] = factor * t[name] / (1.0 - t[name] + factor * t[name])
    detected = (1.0 - empty / whole) * t["existence"]
    t["last_detected"] = np.where(detected >= 0.5, stamp, t["last_detected"])
    return detected


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


def count(t: Columns) -> None:
    """Count the scans in which each track, located, agreed with an older located one nearby.

    They do not agree while both together explain more than 1.5 detections. A scan in which a track
    is located and does not agree begins the count again.
    """
    places = t["mean"][:, [0, 2]]
    for i in np.flatnonzero(t["located"]):
        away = np.hypot(*(places - places[i]).T)
        agrees = False
        for k in np.argsort(away, kind="stable")[1:8]:
            error, total = t["mean"][i] - t["mean"][k], t["spread"][i] + t["spread"][k]
            alone = t["explained"][i] + t["explained"][k] <= 1.5
            if k < i and alone and t["located"][k]:
                agrees |= bool(error @ np.linalg.solve(total, error) <= 7.78)
        t["agreeing_scans"][i] = t["agreeing_scans"][i] + 1 if agrees else 0
