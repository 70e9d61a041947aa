"""The hypotheses of the likelihood-ratio method and their scores, in plain loops.

Written from the definition of the score, for small scenes: hypotheses are objects, every one is
extended by every detection, and none is left out but by the gate, the deletion threshold, the
window, and others with the same last detection that are ten thousand times as likely. Detections
are converted by `plain_tsepm`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from plain_tsepm import (
    MEASUREMENT_MATRIX,
    Detection,
    Parameters,
    convert_scan,
    covariance_at,
    range_variance,
    transition_matrix,
)

Way = list[tuple[float, np.ndarray]]
"""Places of the sensor, each with the range of the echo that it belongs to."""


@dataclass
class Hypothesis:
    """Detections that may be one target's, with the filter that followed them."""

    keys: tuple[tuple[int, int], ...]
    state: np.ndarray
    covariance: np.ndarray
    score: float


@dataclass(frozen=True)
class Rule:
    """What the method is given."""

    settings: Parameters
    detection_probability: float
    gate_probability: float
    process_noise: float
    deletion: float
    window: int
    max_range: float


def plain_hypotheses(scans: Sequence[Mapping[str, Any]], rule: Rule) -> list[list[Hypothesis]]:
    """All hypotheses after each scan."""
    alive: list[Hypothesis] = []
    after = []
    way = [(0.0, np.zeros(2))]
    for index, scan in enumerate(scans):
        way = way_of_sensor(scan) or way
        detections = [
            one
            for one in convert_scan(scan, index, rule.settings)
            if may_be_covered(float(scan["range"][one.key[1]]), one, rule)
        ]
        elapsed = scan["stamp"] - scans[index - 1]["stamp"] if index else 0.0
        grown: list[Hypothesis] = []
        for hypothesis in alive:
            predicted = predict(hypothesis, elapsed, rule)
            for detection in detections if covered(predicted, way, rule) else ():
                child = extend(predicted, detection, scan["stamp"], rule)
                if child is not None:
                    grown.append(child)
            grown.append(missed(predicted, way, rule))
        grown += [start(detection, scan["stamp"], rule) for detection in detections]
        alive = [
            one
            for one in grown
            if one.score > rule.deletion and index + 1 - one.keys[0][0] < rule.window
        ]
        best: dict[tuple[int, int], float] = {}
        for one in alive:
            best[one.keys[-1]] = max(one.score, best.get(one.keys[-1], -math.inf))
        alive = [one for one in alive if one.score > best[one.keys[-1]] - math.log(1e4)]
        after.append(alive)
    return after


def may_be_covered(measured: float, detection: Detection, rule: Rule) -> bool:
    """Whether a detection is at most three deviations of its range beyond the coverage."""
    variance = range_variance(measured, detection.sensing, rule.settings)
    return measured <= rule.max_range + 3.0 * math.sqrt(variance)


def way_of_sensor(scan: Mapping[str, Any]) -> Way:
    """Where the sensor was, by the range of the echo, nearest first; one place for all: that."""
    poses = np.asarray(scan.get("sensor_pose", (0.0, 0.0, 0.0)), float).reshape(-1, 3)
    if len(poses) == 1:
        return [(0.0, poses[0, :2])]
    echoes = zip(scan["range"], poses[:, :2], strict=True)
    return sorted(((float(range_), place) for range_, place in echoes), key=lambda echo: echo[0])


def place_at(way: Way, distance: float) -> np.ndarray:
    """Where the sensor was for an echo of a range: in a straight line between the next two."""
    for (near, begin), (far, end) in itertools.pairwise(way):
        if near <= distance < far:
            return begin + (distance - near) / (far - near) * (end - begin)
    return way[0][1] if distance < way[0][0] else way[-1][1]


def covered(predicted: Hypothesis, way: Way, rule: Rule) -> bool:
    """Whether a target where the hypothesis expects it can be detected or missed."""
    expected = predicted.state[[0, 2]]
    place = place_at(way, math.dist(expected, way[len(way) // 2][1]))
    return math.dist(expected, place) <= rule.max_range


def predict(hypothesis: Hypothesis, elapsed: float, rule: Rule) -> Hypothesis:
    """Nearly constant velocity over the time since the scan before."""
    transition = transition_matrix(elapsed)
    block = rule.process_noise * np.array(
        [[elapsed**3 / 3, elapsed**2 / 2], [elapsed**2 / 2, elapsed]]
    )
    noise = np.kron(np.eye(2), block)
    return Hypothesis(
        hypothesis.keys,
        transition @ hypothesis.state,
        transition @ hypothesis.covariance @ transition.T + noise,
        hypothesis.score,
    )


def extend(
    predicted: Hypothesis, detection: Detection, stamp: float, rule: Rule
) -> Hypothesis | None:
    """Add a detection, or None where it lies outside the gate."""
    h = MEASUREMENT_MATRIX @ transition_matrix(detection.time - stamp)
    expected = h @ predicted.state
    r = covariance_at(expected, detection.sensing, rule.settings)
    s = h @ predicted.covariance @ h.T + r
    innovation = detection.point - expected
    distance = innovation @ np.linalg.inv(s) @ innovation
    if distance > -2.0 * math.log(1.0 - rule.gate_probability):
        return None
    density = math.exp(-distance / 2.0) / (2.0 * math.pi * math.sqrt(np.linalg.det(s)))
    gain = math.log(rule.detection_probability * density / rule.settings.clutter_density)
    k = predicted.covariance @ h.T @ np.linalg.inv(s)
    return Hypothesis(
        (*predicted.keys, detection.key),
        predicted.state + k @ innovation,
        (np.eye(4) - k @ h) @ predicted.covariance,
        predicted.score + gain,
    )


def missed(predicted: Hypothesis, way: Way, rule: Rule) -> Hypothesis:
    """The branch that leaves the scan out: free of charge outside the coverage."""
    charge = 0.0
    if covered(predicted, way, rule):
        charge = math.log(1.0 - rule.detection_probability * rule.gate_probability)
    return Hypothesis(
        predicted.keys, predicted.state, predicted.covariance, predicted.score + charge
    )


def start(detection: Detection, stamp: float, rule: Rule) -> Hypothesis:
    """A hypothesis of one detection, its velocity unknown up to v_max, as of the stamp."""
    state = np.array([detection.point[0], 0.0, detection.point[1], 0.0])
    covariance = np.zeros((4, 4))
    covariance[0::2, 0::2] = detection.covariance
    covariance[1, 1] = covariance[3, 3] = rule.settings.max_speed**2 / 4.0
    back = transition_matrix(stamp - detection.time)
    return Hypothesis((detection.key,), back @ state, back @ covariance @ back.T, 0.0)
