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
"""The hypotheses of the likelihood-ratio method, their scores and its decisions, in plain loops.

Written from the definition of the score, for small scenes: hypotheses are objects, every one is
extended by every detection, and none is left out but by the gate, the deletion threshold, the
window, and others with the same last detection that are ten thousand times as likely. Detections
are converted by `plain_tsepm`. Of each it is known how probably it is a confirmed track's.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from support.plain_confirmed_tracks import VELOCITY, in_disc
from support.plain_tsepm import (
    MEASUREMENT_MATRIX,
    Detection,
    Parameters,
    convert_scan,
    covariance_at,
    range_variance,
    transition_matrix,
)

Key = tuple[int, int]
"""A detection: its scan, and its place in it."""
Way = list[tuple[float, np.ndarray]]
"""Poses of the sensor, each with the range of its echo."""


@dataclass
class Hypothesis:
    """Detections that may be one target's, with the filter that followed them."""

    keys: tuple[Key, ...]
    state: np.ndarray
    covariance: np.ndarray
    score: float
    faded: float = 8.0 * 0.02 / (25.0 + 8.0 * 0.02)


@dataclass(frozen=True)
class Rule:
    """Parameters of the method."""

    settings: Parameters
    detection_probability: float
    gate_probability: float
    target_manoeuvre: float
    deletion: float
    window: int
    max_range: float


@dataclass
class Grown:
    """The hypotheses after a scan: those that end in it, those that left it out, those kept."""

    ending: list[Hypothesis]
    missed: list[Hypothesis]
    kept: list[Hypothesis] = field(default_factory=list)


@dataclass
class Start:
    """A track: hits, evidence, hypotheses of which its state is the mean, detections likely its.

    The path is that of the best hypothesis.
    """

    hits: set[Key]
    evidence: float
    mixed: list[Hypothesis]
    probability: dict[Key, float]
    path: tuple[Key, ...]


def plain_hypotheses(
    scans: Sequence[Mapping[str, Any]], rule: Rule, confirmed: Mapping[Key, float]
) -> list[Grown]:
    """All hypotheses after each scan, given how probably detections are confirmed tracks'."""
    alive: list[Hypothesis] = []
    after = []
    way: Way = [(0.0, np.zeros(3))]
    for index, scan in enumerate(scans):
        way = way_of_sensor(scan) or way
        detections = [
            one
            for one in convert_scan(scan, index, rule.settings)
            if may_be_covered(float(scan["range"][one.key[1]]), one, rule)
        ]
        stamps = [one["stamp"] for one in scans[: index + 1]]
        noise = process_noise(np.diff(stamps), rule) if index else 0.0
        elapsed = stamps[-1] - stamps[-2] if index else 0.0
        ending: list[Hypothesis] = []
        left_out: list[Hypothesis] = []
        for hypothesis in alive:
            predicted = predict(hypothesis, elapsed, noise)
            for detection in detections if covered(predicted, way, rule) else ():
                other = rule.settings.clutter_density / (1.0 - confirmed.get(detection.key, 0.0))
                child = extend(predicted, detection, scan["stamp"], other, rule)
                if child is not None and child.score > rule.deletion:
                    ending.append(child)
            left_out.append(missed(predicted, way, rule))
        for detection in detections:
            begun = start(detection, scan["stamp"], rule)
            free = 1.0 - confirmed.get(detection.key, 0.0)
            ending.append(replace(begun, score=math.log(free)))
        ending, left_out = pruned(ending, rule), pruned(left_out, rule)
        alive = [one for one in ending + left_out if index + 1 - one.keys[0][0] < rule.window]
        after.append(Grown(ending, left_out, alive))
    return after


def pruned(hypotheses: Sequence[Hypothesis], rule: Rule) -> list[Hypothesis]:
    """The hypotheses that are neither unlikely nor far below the best of their newest detection."""
    likely = [one for one in hypotheses if one.score > rule.deletion]
    best: dict[Key, float] = {}
    for one in likely:
        best[one.keys[-1]] = max(one.score, best.get(one.keys[-1], -math.inf))
    return [one for one in likely if one.score > best[one.keys[-1]] - math.log(1e4)]


def at_max_speed(grown: Grown, max_speed: float) -> Grown:
    """The hypotheses of several hits scored under the prior that ends at v_max: 1 - exp(-2)."""

    def scored(one: Hypothesis) -> Hypothesis:
        if len(one.keys) < 2:
            return one
        spread = VELOCITY @ one.covariance @ VELOCITY.T
        inside, *_ = in_disc(VELOCITY @ one.state, spread, max_speed)
        gain = math.log(max(inside, 1e-300)) - math.log(1.0 - math.exp(-2.0))
        return replace(one, score=one.score + gain)

    return Grown(
        *([scored(one) for one in part] for part in (grown.ending, grown.missed)), grown.kept
    )


def plain_starts(grown: Grown, threshold: float) -> list[Start]:
    """Tracks that a scan confirms, in descending order of evidence."""
    starts: list[Start] = []
    left = grown
    for members in strong_groups(grown, threshold):
        newest = members[0].keys[-1]
        ending = [one for one in left.ending if one.keys[-1] == newest]
        start = resolved(ending, left) if evidence(ending) >= threshold else None
        if start is not None:
            starts.append(start)
            left = Grown(
                *([given_start(one, start) for one in part] for part in (left.ending, left.missed))
            )
    return starts


def resolved(members: Sequence[Hypothesis], grown: Grown) -> Start | None:
    """The track of a newest detection, unless its hits are unclear."""
    rivals = rivals_of(members, grown)
    long = [one for one in rivals if len(one.keys) >= 3]
    if not long:
        return None
    probability = hit_probabilities(rivals)
    certain = {key for key, value in probability.items() if value >= 0.9}
    if len(certain) < 3:
        certain = set(sorted(probability, key=lambda key: (-probability[key], key))[:3])
        if min(probability[key] for key in certain) <= 0.5:
            return None
    right = [one for one in rivals if len(certain & set(one.keys)) > len(certain) / 2]
    if sum(map(likelihood, right)) < 0.9 * sum(map(likelihood, rivals)):
        return None  # these scenes have too few scans for it to wait no longer
    path = max(long, key=lambda one: one.score).keys
    return Start(certain, evidence(members), right, probability, path)


def given_start(one: Hypothesis, start: Start) -> Hypothesis:
    """The hypothesis given the track: the score due to the track's hits is removed."""
    share = sum(start.probability.get(key, 0.0) for key in one.keys) / len(one.keys)
    return replace(one, score=one.score - share * max(one.score, 0.0))


def strong_groups(grown: Grown, threshold: float) -> list[list[Hypothesis]]:
    """Hypotheses that share a newest detection, of enough evidence together; the most first."""
    groups: dict[Key, list[Hypothesis]] = {}
    for one in grown.ending:
        groups.setdefault(one.keys[-1], []).append(one)
    strong = [
        members
        for members in groups.values()
        if evidence(members) >= threshold and max(len(one.keys) for one in members) >= 3
    ]
    return sorted(strong, key=evidence, reverse=True)


def likelihood(one: Hypothesis) -> float:
    """Likelihood ratio of a target against clutter."""
    return math.exp(one.score)


def evidence(members: Sequence[Hypothesis]) -> float:
    """Log of the summed likelihood ratios."""
    return math.log(sum(map(likelihood, members)))


def hit_probabilities(members: Sequence[Hypothesis]) -> dict[Key, float]:
    """How probably each detection is a hit, if one of the hypotheses is true."""
    whole = sum(map(likelihood, members))
    keys = {key for one in members for key in one.keys}
    return {key: sum(likelihood(m) for m in members if key in m.keys) / whole for key in keys}


def rivals_of(members: Sequence[Hypothesis], grown: Grown) -> list[Hypothesis]:
    """Hypotheses of the same target, whatever they end in, that are not negligible."""
    probability = hit_probabilities(members)
    least, mean_hits = evidence(members) - math.log(1e4), sum(probability.values())
    return [
        one
        for one in grown.ending + grown.missed
        if one.score > least
        and len(one.keys) >= 2
        and sum(probability.get(key, 0.0) for key in one.keys) > 0.3 * min(len(one.keys), mean_hits)
    ]


def may_be_covered(measured: float, detection: Detection, rule: Rule) -> bool:
    """Whether a detection is at most three deviations of its range beyond the coverage."""
    variance = range_variance(measured, detection.sensing, rule.settings)
    return measured <= rule.max_range + 3.0 * math.sqrt(variance)


def covered(predicted: Hypothesis, way: Way, rule: Rule) -> bool:
    """Whether a target where the hypothesis expects it can be detected or missed."""
    expected = predicted.state[[0, 2]]
    return math.dist(expected, pose_for(way, expected)[:2]) <= rule.max_range


def process_noise(intervals: np.ndarray, rule: Rule) -> float:
    """Density q of the acceleration: as given, or before anything is learned of it.

    Then a velocity changes by a quarter of v_max in 30 intervals, and in no less than 30 s.
    """
    interval = float(np.median(intervals))
    if rule.target_manoeuvre > 0.0:
        return rule.target_manoeuvre**2 * interval
    return (rule.settings.max_speed / 4.0) ** 2 / max(30.0 * interval, 30.0)


def predict(hypothesis: Hypothesis, elapsed: float, process_noise: float) -> Hypothesis:
    """Nearly constant velocity over the time since the scan before."""
    transition = transition_matrix(elapsed)
    block = np.array([[elapsed**3 / 3, elapsed**2 / 2], [elapsed**2 / 2, elapsed]])
    noise = np.kron(np.eye(2), process_noise * block)
    return replace(
        hypothesis,
        state=transition @ hypothesis.state,
        covariance=transition @ hypothesis.covariance @ transition.T + noise,
        faded=hypothesis.faded * (1.0 - 1.0 / 8.0) + (1.0 - hypothesis.faded) / 25.0,
    )


def of_states(hypothesis: Hypothesis, rule: Rule) -> list[tuple[float, float]]:
    """Probability of each state of a target, seen and faded, and P_D in it."""
    p_d = rule.detection_probability
    return [(1.0 - hypothesis.faded, p_d), (hypothesis.faded, 0.02 * p_d)]


def extend(
    predicted: Hypothesis, detection: Detection, stamp: float, other: float, rule: Rule
) -> Hypothesis | None:
    """Add a detection, or None where it lies outside the gate; `other` is its density otherwise."""
    h = MEASUREMENT_MATRIX @ transition_matrix(detection.time - stamp)
    expected = h @ predicted.state
    r = covariance_at(expected, detection.sensing, rule.settings)
    s = h @ predicted.covariance @ h.T + r
    innovation = detection.point - expected
    distance = innovation @ np.linalg.inv(s) @ innovation
    if distance > -2.0 * math.log(1.0 - rule.gate_probability):
        return None
    density = math.exp(-distance / 2.0) / (2.0 * math.pi * math.sqrt(np.linalg.det(s)))
    in_states = [share * p_d for share, p_d in of_states(predicted, rule)]
    increment = math.log(sum(in_states) * density / other)
    kalman_gain = predicted.covariance @ h.T @ np.linalg.inv(s)
    return Hypothesis(
        (*predicted.keys, detection.key),
        predicted.state + kalman_gain @ innovation,
        (np.eye(4) - kalman_gain @ h) @ predicted.covariance,
        predicted.score + increment,
        in_states[1] / sum(in_states),
    )


def missed(predicted: Hypothesis, way: Way, rule: Rule) -> Hypothesis:
    """The branch without a detection; its increment is 0 outside the coverage."""
    if not covered(predicted, way, rule):
        return predicted
    p_g = rule.gate_probability
    in_states = [share * (1.0 - p_d * p_g) for share, p_d in of_states(predicted, rule)]
    score = predicted.score + math.log(sum(in_states))
    return replace(predicted, score=score, faded=in_states[1] / sum(in_states))


def start(detection: Detection, stamp: float, rule: Rule) -> Hypothesis:
    """A hypothesis of one detection, its velocity unknown up to v_max, as of the stamp."""
    state = np.array([detection.point[0], 0.0, detection.point[1], 0.0])
    covariance = np.zeros((4, 4))
    covariance[0::2, 0::2] = detection.covariance
    covariance[1, 1] = covariance[3, 3] = rule.settings.max_speed**2 / 4.0
    back = transition_matrix(stamp - detection.time)
    return Hypothesis((detection.key,), back @ state, back @ covariance @ back.T, 0.0)


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
