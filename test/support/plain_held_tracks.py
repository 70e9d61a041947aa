"""Maintenance of held tracks in plain loops: by track, detection and mode of motion.

Written from the equations, for small scenes: interacting multiple models (Blom, Bar-Shalom 1988),
integrated probabilistic data association with a Markov chain two (Musicki, Evans, Stankovic 1994;
with modes: Musicki, Suvorova 2008) and targets that compete for detections (Musicki, La Scala
2008). Detections are converted by `plain_tsepm`. Every constant stands here again.
"""

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
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
ON, TURN = 0, 1
VELOCITY = np.array([[0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])

NODES, WEIGHTS = np.polynomial.legendre.leggauss(80)
ANGLES = 2.0 * math.pi * np.arange(160) / 160.0
RADII = (NODES + 1.0) / 2.0
DISC = (RADII[:, None, None] * np.stack([np.cos(ANGLES), np.sin(ANGLES)], axis=-1)).reshape(-1, 2)
DISC_AREA = np.repeat(WEIGHTS / 2.0 * RADII * 2.0 * math.pi / 160.0, 160)
"""Points of the unit disc and their areas: Gauss-Legendre along the radius, equal angles."""


@dataclass(frozen=True)
class Mode:
    """A target's state if it moves in a mode, and the probability of that."""

    probability: float
    state: np.ndarray
    covariance: np.ndarray


@dataclass(frozen=True)
class Track:
    """A held track."""

    id: int
    stamp: float
    modes: tuple[Mode, Mode]
    existence: float
    last_detected: float
    visible: float = 1.0
    covered_scans: float = 0.0
    agreeing: int = 0
    unlisted_since: float = 0.0
    proven: float = 0.005
    published: bool = True
    hit_variance: float = math.nan

    @property
    def mean(self) -> tuple[np.ndarray, np.ndarray]:
        """State and covariance over the modes."""
        return mixture([(mode.probability, mode.state, mode.covariance) for mode in self.modes])


@dataclass(frozen=True)
class Plot:
    """A detection with the data for its association."""

    detection: Detection
    clutter: float
    range_rate: float
    sensor_velocity: np.ndarray


@dataclass(frozen=True)
class Rule:
    """Parameters of the maintenance."""

    settings: Parameters
    hold_time: float
    tracked_timeout: float
    detection_probability: float
    range_rate_std: float
    max_range: float
    target_extent: float


@dataclass
class PlainMaintenance:
    """The held tracks, and the results of the last scan."""

    rule: Rule
    tracks: list[Track] = field(default_factory=list)
    ended: dict[str, list[int]] = field(default_factory=dict)
    """Ids by the reason of their end."""
    association: dict[tuple[int, int], float] = field(default_factory=dict)
    report: float | None = None
    declined: list[int] = field(default_factory=list)
    detected: float = 0.0
    covered: float = 0.0

    def add(self, id_: int, stamp: float, state: Any, covariance: Any, existence: float) -> None:
        """Hold a new track."""
        self.tracks.append(begun(id_, stamp, state, covariance, existence, stamp))

    def follow(self, stamp: float, listed: Mapping[int, tuple[float, Any, Any]]) -> None:
        """Take the report of a downstream tracker: stamp, state and covariance of each id."""
        timeout, kept = self.rule.tracked_timeout, []
        heard = self.report is not None and abs(stamp - self.report) <= timeout
        for track in self.tracks:
            since = track.unlisted_since if heard else max(track.unlisted_since, stamp)
            if track.id in listed:
                time, state, covariance = listed[track.id]
                new = begun(track.id, time, state, covariance, 0.99, -math.inf)
                kept.append(
                    replace(
                        track,
                        stamp=time,
                        modes=new.modes,
                        existence=0.99,
                        proven=0.99,
                        last_detected=max(track.last_detected, time),
                        unlisted_since=-math.inf,
                        published=True,
                    )
                )
            elif stamp - since > timeout:
                self.declined.append(track.id)
            else:
                kept.append(replace(track, unlisted_since=since))
        ids = [track.id for track in self.tracks]
        self.tracks = kept
        for id_, (time, state, covariance) in listed.items():
            if id_ not in ids:
                self.tracks.append(begun(id_, time, state, covariance, 0.99, -math.inf))
        self.report = stamp

    def step(
        self,
        scan: Mapping[str, Any],
        clutter: Sequence[float],
        detectable: Callable[[np.ndarray], float],
        whole_coverage: bool = True,
    ) -> list[float]:
        """Take a scan, of a part of the coverage or all; returns the held density at detections."""
        rule, stamp = self.rule, scan["stamp"]
        self.ended, self.declined, self.association = {"tracker": self.declined}, [], {}
        if self.report is not None and abs(stamp - self.report) > rule.tracked_timeout:
            self.report = None
        self.end("not_detected", [t.last_detected >= stamp - rule.hold_time for t in self.tracks])
        longest = max((abs(stamp - track.stamp) for track in self.tracks), default=0.0)
        predicted = [
            predict(track, stamp, longest, rule.settings.max_speed) for track in self.tracks
        ]
        p_d = [detectable(track.mean[0][[0, 2]]) for track in predicted]
        predicted = [
            waited(track, p > 0.0) if p > 0.0 or whole_coverage else track
            for track, p in zip(predicted, p_d, strict=True)
        ]
        plots = clusters_of(scan, clutter, rule)
        near = [neighbours(track, plots, stamp) for track in predicted]
        with_rates = any(has_rate(plot, rule) for plot in plots)
        fits = [
            [
                {j: fit(mode, plots[j], plots[some[0]], stamp, with_rates, rule) for j in some}
                for mode in track.modes
            ]
            for track, some in zip(predicted, near, strict=True)
        ]
        # L_ijm = s_i P_D N_ijm / lambda_j, and b_i = 1 - s_i P_D P_G.
        density = np.array([plot.clutter for plot in plots])
        visible = np.array([track.visible for track in predicted])
        empty = 1.0 - visible * p_d * P_G
        ratios = np.zeros((len(predicted), 2, len(plots)))
        for i, m in itertools.product(range(len(predicted)), (ON, TURN)):
            for j, one in fits[i][m].items():
                ratios[i, m, j] = one.likelihood
        ratios *= visible[:, None, None] * rule.detection_probability / density
        weights = np.array([[m.probability for m in t.modes] for t in predicted]).reshape(-1, 2)
        existence = np.array([track.existence for track in predicted])
        mean = np.einsum("im,imj->ij", weights, ratios)
        alone = factors(existence, empty, mean, mean)
        left = np.array([np.delete(alone, i, axis=0).prod(axis=0) for i in range(len(predicted))])
        left = left.reshape(mean.shape)
        competing = mean / left
        density = density * (factors(existence, empty, mean, competing).prod(axis=0) - 1.0)
        self.tracks, learned, located, explained = [], [], {}, {}
        for i, track in enumerate(predicted):
            listed = self.report is not None and track.unlisted_since == -math.inf
            limit = math.inf if listed else rule.settings.max_speed
            track, detected = update(track, fits[i], ratios[i] / left[i], empty[i], limit)
            if near[i]:
                error = plots[near[i][0]].detection.covariance
                wide = track.mean[1][np.ix_([0, 2], [0, 2])]
                located[track.id] = largest(wide) <= 2.0**2 * largest(error)
            origin = competing[i] / (empty[i] + competing[i].sum()) * track.existence
            self.association |= {(track.id, j): float(origin[j]) for j in near[i]}
            for j in np.flatnonzero(origin > 0.5):
                track = replace(track, hit_variance=largest(plots[j].detection.covariance))
            explained[track.id] = origin.sum()
            covered = track.covered_scans + (p_d[i] > 0.0)
            if p_d[i] > 0.0:
                learned.append((detected * track.proven / track.existence, covered))
            self.tracks.append(replace(track, covered_scans=covered * (1.0 - detected)))
        self.learn(learned)
        seen = {track.id: p > 0.0 for track, p in zip(predicted, p_d, strict=True)}
        self.end("missed", [t.existence >= 0.01 or not seen[t.id] for t in self.tracks])
        self.end("left", [track.existence >= 0.01 for track in self.tracks])
        self.tracks = counted(self.tracks, located, explained)
        self.end("duplicate", [track.agreeing < 5 for track in self.tracks])
        self.tracks = [replace(track, published=self.shown(track)) for track in self.tracks]
        return density.tolist()

    def shown(self, track: Track) -> bool:
        """Whether a track is published, not withheld.

        Its place is as well known as the last detection's, up to 4.5 times, or as the extent of a
        target, and to a quarter of the range; it exists with 0.5, or with 0.9 if it was withheld.
        """
        error = math.sqrt(largest(track.mean[1][np.ix_([0, 2], [0, 2])]))
        known = max(4.5 * math.sqrt(track.hit_variance), self.rule.target_extent)
        if self.report is not None and track.unlisted_since == -math.inf:
            return True  # the downstream tracker lists it
        exists = track.existence >= (0.5 if track.published else 0.9)
        return exists and error <= known and error <= self.rule.max_range / 4.0

    def learn(self, learned: Sequence[tuple[float, float]]) -> None:
        """P_D from the probability of a detection and the scans since the last, of each track."""
        covered = sum(detected * scans for detected, scans in learned)
        keep = math.exp(-covered / 200.0)
        self.detected = keep * self.detected + sum(detected for detected, _ in learned) / P_G
        self.covered = keep * self.covered + covered

    def learned_detection_probability(self, given: float) -> float:
        """Mean of the beta distribution, the stated one worth five scans."""
        return min(max((5.0 * given + self.detected) / (5.0 + self.covered), 0.05), 0.999)

    def end(self, why: str, kept: Sequence[bool]) -> None:
        """End tracks, but for those that the downstream tracker lists while it is heard."""
        alive = self.report is not None
        keeps = [
            keep or (alive and track.unlisted_since == -math.inf)
            for keep, track in zip(kept, self.tracks, strict=True)
        ]
        self.ended[why] = [t.id for t, keep in zip(self.tracks, keeps, strict=True) if not keep]
        self.tracks = [t for t, keep in zip(self.tracks, keeps, strict=True) if keep]


def begun(
    id_: int, stamp: float, state: Any, covariance: Any, existence: float, unlisted: float
) -> Track:
    """A track of which only a state is known: it turns as often as targets do in the long run."""
    turning = (1.0 / 30.0) / (1.0 / 30.0 + 0.5)
    state, covariance = np.array(state, float), np.array(covariance, float)
    modes = Mode(1.0 - turning, state, covariance), Mode(turning, state, covariance)
    error = largest(covariance[np.ix_([0, 2], [0, 2])])
    return Track(id_, stamp, modes, existence, stamp, unlisted_since=unlisted, hit_variance=error)


def mixture(parts: Sequence[tuple[float, np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Mean and covariance of Gaussians with weights."""
    mean = sum(weight * state for weight, state, _ in parts)
    return mean, sum(
        weight * (covariance + np.outer(state - mean, state - mean))
        for weight, state, covariance in parts
    )


def predict(track: Track, stamp: float, longest: float, max_speed: float) -> Track:
    """The track at a scan; turning, the variance of velocity grows to v_max^2 / 4 in 5 s."""
    time = stamp - track.stamp
    change = np.array([[29.0 / 30.0, 1.0 / 30.0], [0.5, 0.5]])
    modes = []
    for to in (ON, TURN):
        weights = [change[of, to] * track.modes[of].probability for of in (ON, TURN)]
        state, covariance = mixture(
            [
                (weight / sum(weights), mode.state, mode.covariance)
                for weight, mode in zip(weights, track.modes, strict=True)
            ]
        )
        noise = 0.01 + (max_speed**2 / 4.0 / max(longest, 5.0) if to == TURN else 0.0)
        block = np.array([[time**2 / 3.0, time / 2.0], [time / 2.0, 1.0]])
        q = np.kron(np.eye(2), noise * abs(time) * block)
        f = transition_matrix(time)
        modes.append(Mode(sum(weights), f @ state, f @ covariance @ f.T + q))
    return replace(track, stamp=stamp, modes=(modes[ON], modes[TURN]))


def waited(track: Track, covered: bool) -> Track:
    """The track after a scan's time in the chain of visible, faded and gone.

    A visible target fades once in 25 scans, a faded one is visible again after 8 in the mean; a
    target vanishes once in 50 scans, or leaves for good after 8 outside the coverage.
    """
    stays = 1.0 - 1.0 / 50.0 if covered else 1.0 - 1.0 / 8.0
    return replace(
        track,
        existence=stays * track.existence,
        proven=stays * track.proven,
        visible=24.0 / 25.0 * track.visible + (1.0 - track.visible) / 8.0,
    )


def clusters_of(scan: Mapping[str, Any], clutter: Sequence[float], rule: Rule) -> list[Plot]:
    """Detections of a scan."""
    detections = convert_scan(scan, 0, rule.settings)
    rates = scan.get("features", {}).get("range_rate", [math.nan] * len(detections))
    moves = np.array(scan.get("sensor_velocity", (0.0, 0.0)))
    return [
        Plot(*values, moves) for values in zip(detections, map(float, clutter), rates, strict=True)
    ]


def has_rate(plot: Plot, rule: Rule) -> bool:
    """Whether a range rate was measured, and counts."""
    return rule.range_rate_std > 0.0 and not math.isnan(plot.range_rate)


def neighbours(track: Track, plots: Sequence[Plot], stamp: float) -> list[int]:
    """The eight plots nearest to where the track is in the middle of the scan, nearest first."""
    if not plots:
        return []
    times = [plot.detection.time - stamp for plot in plots]
    state, _ = track.mean
    middle = (min(times) + max(times)) / 2.0
    centre = POSITION @ transition_matrix(middle) @ state
    away = [math.dist(plot.detection.point, centre) for plot in plots]
    return sorted(range(len(plots)), key=lambda j: away[j])[:8]


@dataclass(frozen=True)
class Fit:
    """How well a plot fits a track in a mode, and the track's state if it is the target's."""

    likelihood: float
    state: np.ndarray
    covariance: np.ndarray


def fit(mode: Mode, plot: Plot, nearest: Plot, stamp: float, with_rates: bool, rule: Rule) -> Fit:
    """Compare a plot at its own time; S is that of the track's nearest plot at that plot's time.

    So is the Kalman gain. Where plots have range rates, S and the gain are each plot's own.
    """
    x, p = mode.state, mode.covariance
    nearest = plot if with_rates else nearest
    h_nearest = POSITION @ transition_matrix(nearest.detection.time - stamp)
    h = POSITION @ transition_matrix(plot.detection.time - stamp)
    r = covariance_at(h_nearest @ x, nearest.detection.sensing, rule.settings)
    s = h_nearest @ p @ h_nearest.T + r
    v = plot.detection.point - h @ x
    distance = float(v @ np.linalg.inv(s) @ v)
    likelihood = math.exp(-distance / 2.0) / (2.0 * math.pi * math.sqrt(np.linalg.det(s)))
    kalman_gain = p @ h_nearest.T @ np.linalg.inv(s)
    x, p = x + kalman_gain @ v, p - kalman_gain @ s @ kalman_gain.T
    gate = GATE_WITH_RANGE_RATE if has_rate(plot, rule) else GATE
    if distance <= gate and has_rate(plot, rule):
        error, variance, gradient = range_rate_innovation(x, p, plot, stamp, rule)
        distance += error**2 / variance
        likelihood *= math.exp(-(error**2) / variance / 2.0) / math.sqrt(2.0 * math.pi * variance)
        kalman_gain = p @ gradient / variance
        x, p = x + kalman_gain * error, p - variance * np.outer(kalman_gain, kalman_gain)
    return Fit(likelihood if distance <= gate else 0.0, x, p)


def range_rate_innovation(
    x: np.ndarray, p: np.ndarray, plot: Plot, stamp: float, rule: Rule
) -> tuple[float, float, np.ndarray]:
    """Range rate less the expected, c = u.(v - w), to second order; its variance; its gradient.

    With the displacement across the line of sight of variance A, the velocity across it of
    variance B and C between them, the mean of what is left out is C / r, its variance
    (A B + C^2) / r^2.
    """
    at = transition_matrix(plot.detection.time - stamp)
    offset = POSITION @ at @ x - plot.detection.sensing.position
    relative = VELOCITY @ at @ x - plot.sensor_velocity
    r = math.hypot(*offset)
    u = offset / r
    rate = float(u @ relative)
    gradient = (relative - rate * u) / r @ POSITION @ at + u @ VELOCITY @ at
    across = np.array([-u[1], u[0]])
    place, speed = across @ POSITION @ at, across @ VELOCITY @ at
    a, b, c = place @ p @ place, speed @ p @ speed, place @ p @ speed
    variance = gradient @ p @ gradient + rule.range_rate_std**2 + (a * b + c * c) / r**2
    return plot.range_rate - rate - c / r, float(variance), gradient


def factors(
    existence: np.ndarray, empty: np.ndarray, ratio: np.ndarray, of_others: np.ndarray
) -> np.ndarray:
    """f: factors of the scan's likelihood by each target's possible origin of each plot."""
    rest = of_others.sum(axis=1, keepdims=True) - of_others
    r = existence[:, None]
    without = 1.0 - r + r * (empty[:, None] + rest)
    return (without + r * ratio) / without


def update(
    track: Track,
    fits: Sequence[Mapping[int, Fit]],
    ratios: np.ndarray,
    empty: float,
    max_speed: float,
) -> tuple[Track, float]:
    """The track after a scan, and the probability that its target was detected."""
    wholes, modes = [], []
    for mode, fit_of, ratio_of in zip(track.modes, fits, ratios, strict=True):
        whole = empty + ratio_of.sum()  # 1 - delta of the mode
        parts = [(empty / whole, mode.state, mode.covariance)]
        parts += [(ratio_of[j] / whole, one.state, one.covariance) for j, one in fit_of.items()]
        wholes.append(whole)
        modes.append(Mode(mode.probability * whole, *limited(*mixture(parts), max_speed)))
    whole = sum(mode.probability for mode in modes)
    r, q = track.existence, track.proven
    existence = whole * r / (1.0 - r + whole * r)
    proof = 1.0  # as if P_D were one half
    if empty < 1.0:
        proof = 1.0 - 0.5 * P_G + (whole - empty) * 0.5 * P_G / (1.0 - empty)
    proven = proof * q / (1.0 - q + proof * q)
    detected = (1.0 - empty / whole) * existence
    return (
        replace(
            track,
            modes=tuple(replace(mode, probability=mode.probability / whole) for mode in modes),
            existence=existence,
            proven=proven,
            visible=1.0 - (1.0 - track.visible) / whole,
            last_detected=track.stamp if detected >= 0.5 else track.last_detected,
        ),
        detected,
    )


def largest(covariance: np.ndarray) -> float:
    """Variance along the major axis."""
    return float(np.linalg.eigvalsh(covariance)[-1])


def limited(
    state: np.ndarray, covariance: np.ndarray, max_speed: float
) -> tuple[np.ndarray, np.ndarray]:
    """The state given a speed of at most v_max, if the mean is faster: sums over a polar grid."""
    mean, spread = VELOCITY @ state, VELOCITY @ covariance @ VELOCITY.T
    if math.hypot(*mean) <= max_speed:
        return state, covariance
    v, area = max_speed * DISC, max_speed**2 * DISC_AREA
    error = v - mean
    square = (error @ np.linalg.inv(spread) * error).sum(axis=-1)
    mass = area * np.exp(-0.5 * square) / (2.0 * math.pi * math.sqrt(np.linalg.det(spread)))
    inside = float(mass.sum())
    mass /= inside
    within = mass @ v
    apart = v - within
    second = (mass[:, None] * apart).T @ apart
    gain = covariance @ VELOCITY.T @ np.linalg.inv(spread)
    return state + gain @ (within - mean), covariance + gain @ (second - spread) @ gain.T


def counted(
    tracks: Sequence[Track], located: Mapping[int, bool], explained: Mapping[int, float]
) -> list[Track]:
    """The tracks with the scans in which each, located, agreed with an older located one nearby.

    They do not agree while both together explain more than 1.5 detections. A scan in which a track
    is located and does not agree begins the count again.
    """
    updated = []
    for i, track in enumerate(tracks):
        state, covariance = track.mean
        away = {
            k: math.dist(POSITION @ state, POSITION @ other.mean[0])
            for k, other in enumerate(tracks)
            if k != i
        }
        agrees = False
        for k in sorted(away, key=lambda k: away[k])[:7]:
            error, total = state - tracks[k].mean[0], covariance + tracks[k].mean[1]
            alone = explained[track.id] + explained[tracks[k].id] <= 1.5
            if alone and located.get(track.id) and located.get(tracks[k].id):
                agrees |= k < i and float(error @ np.linalg.solve(total, error)) <= 7.78
        begins_again = not agrees and located.get(track.id, False)
        agreeing = 0 if begins_again else track.agreeing + agrees
        updated.append(replace(track, agreeing=agreeing))
    return updated


Way = list[tuple[float, np.ndarray]]
"""Poses of the sensor, each with the range of its echo."""


def way_of_sensor(scan: Mapping[str, Any]) -> Way:
    """Poses of the sensor by the range of the echo, ascending; or one pose for all."""
    poses = np.reshape(scan.get("sensor_pose", (0.0, 0.0, 0.0)), (-1, 3))
    if len(poses) == 1:
        return [(0.0, poses[0])]
    echoes = zip(scan["range"], poses, strict=True)
    return sorted(((float(r), pose) for r, pose in echoes), key=lambda echo: echo[0])


def pose_for(way: Way, position: np.ndarray) -> np.ndarray:
    """Pose of the sensor as the echo of a position arrives, by linear interpolation."""
    distance = math.dist(position, way[len(way) // 2][1][:2])
    for (near, begin), (far, end) in itertools.pairwise(way):
        if near <= distance < far:
            return begin + (distance - near) / (far - near) * (end - begin)
    return way[0][1] if distance < way[0][0] else way[-1][1]


class Coverage:
    """Where the sensor detects: its poses by range, and the edges."""

    def __init__(
        self, min_range: float, max_range: float, azimuth_min: float, azimuth_max: float
    ) -> None:
        self.ranges, self.azimuths = (min_range, max_range), (azimuth_min, azimuth_max)
        self.way: Way = [(0.0, np.zeros(3))]

    def move(self, scan: Mapping[str, Any]) -> None:
        """Take the poses of a scan; without any, the last stay."""
        self.way = way_of_sensor(scan) or self.way

    def covers(self, position: np.ndarray) -> bool:
        """Whether the sensor covers a position, from where it is as the echo arrives."""
        pose = pose_for(self.way, position)
        offset = position - pose[:2]
        low, high = self.azimuths
        turned = (math.atan2(offset[1], offset[0]) - pose[2] - low) % (2.0 * math.pi)
        return self.ranges[0] <= math.hypot(*offset) <= self.ranges[1] and turned <= high - low
