"""Plain versions of the methods `sequential` and `logic`: loops, to be compared with.

Equations of Ji, D., Li, D., 2014. An improved sequential initiation method for multitarget track in
clutter with large noise measurement. Mathematical Problems in Engineering, 394297.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import chi2

from support.plain_tsepm import (
    MEASUREMENT_MATRIX,
    Detection,
    Estimate,
    Parameters,
    convert_scan,
    normalized_distance,
    range_variance,
    transition_matrix,
    unweighted_least_squares,
)


@dataclass(eq=False)
class Path:
    """A potential track: its hits, and the scan of the first."""

    hits: list[Detection]
    first_scan: int


@dataclass(frozen=True, eq=False)
class PlainTrack:
    """A track put out."""

    hits: tuple[tuple[int, int], ...]
    state: np.ndarray
    covariance: np.ndarray
    evaluation: float


def settings_of(sensor: Mapping[str, float], options: Mapping[str, Any]) -> Parameters:
    names = ("max_speed", "min_hits", "window")
    return Parameters(**sensor, **{name: options[name] for name in names})


def finish(hits: list[Detection], stamp: float, estimate: Estimate) -> PlainTrack:
    return PlainTrack(
        tuple(hit.key for hit in hits),
        estimate.state,
        estimate.covariance,
        normalized_distance(hits, estimate, stamp),
    )


# --- sequential ----------------------------------------------------------------------------------


def plain_sequential(
    scans: Sequence[Mapping[str, Any]], sensor: Mapping[str, float], options: Mapping[str, Any]
) -> list[tuple[list[PlainTrack], int]]:
    """Tracks of each scan, and the number of potential tracks after it."""
    settings = settings_of(sensor, options)
    potential: list[Path] = []
    results = []
    for index, scan in enumerate(scans):
        detections = convert_scan(scan, index, settings)
        used = match(potential, detections, settings, options)  # Step 3
        complete, left = [], []
        for path in potential:
            if len(path.hits) >= settings.min_hits:  # Step 7
                estimate = plain_estimate(path.hits, float(scan["stamp"]), options)
                complete.append(finish(path.hits, float(scan["stamp"]), estimate))
            elif index + 1 - path.first_scan < settings.window:  # Step 6
                left.append(path)
        tracks = best_apart(complete)
        taken = {key for track in tracks for key in track.hits}
        left = [path for path in left if not any(hit.key in taken for hit in path.hits)]
        left += [Path([one], index) for j, one in enumerate(detections) if j not in used]  # Step 5
        potential = left
        results.append((tracks, len(potential)))
    return results


def match(
    potential: list[Path],
    detections: list[Detection],
    settings: Parameters,
    options: Mapping[str, Any],
) -> set[int]:
    """Add its detection to each path, by the reading chosen; returns the detections used."""
    pairs = []
    for i, path in enumerate(potential):
        turn = path.first_scan if options["matching"] == "oldest" else 0
        for j, detection in enumerate(detections):
            if in_gate(path.hits[-1], detection, settings, options):
                pairs.append((turn, math.dist(path.hits[-1].point, detection.point), i, j))
    used_paths: set[int] = set()
    used: set[int] = set()
    for _, _, i, j in sorted(pairs):
        if i not in used_paths and (j not in used or options["matching"] == "shared"):
            potential[i].hits.append(detections[j])
            used_paths.add(i)
            used.add(j)
    return used


def in_gate(
    last: Detection, detection: Detection, settings: Parameters, options: Mapping[str, Any]
) -> bool:
    """Eq. 7."""
    if options["gate_error"] == "major_axis":
        sigma = last.major_axis_std
    else:
        apart = math.dist(last.point, last.sensing.position)
        measured = apart * math.exp(-0.5 * last.sensing.azimuth_std**2)
        sigma = math.sqrt(range_variance(measured, last.sensing, settings))
    reach = settings.max_speed * abs(detection.time - last.time) + options["gate_sigmas"] * sigma
    return math.dist(last.point, detection.point) <= reach


def plain_estimate(hits: list[Detection], stamp: float, options: Mapping[str, Any]) -> Estimate:
    """The estimator that the options name."""
    if options["estimator"] == "kalman_filter":
        return plain_kalman(hits, stamp, options["process_noise"])
    if options["estimator"] == "linear_fitting":
        return plain_line(hits, stamp)
    return unweighted_least_squares(hits, stamp)


def plain_kalman(hits: list[Detection], stamp: float, noise: float) -> Estimate:
    """Two-point differencing, then predict and update, as in any textbook."""
    first, second = hits[:2]
    dt = second.time - first.time
    velocity = (second.point - first.point) / dt
    x = np.array([second.point[0], velocity[0], second.point[1], velocity[1]])
    p = np.zeros((4, 4))
    p[0::2, 0::2] = second.covariance
    p[0::2, 1::2] = p[1::2, 0::2] = second.covariance / dt
    p[1::2, 1::2] = (first.covariance + second.covariance) / dt**2
    p[1, 1] += noise * abs(dt) / 3.0
    p[3, 3] += noise * abs(dt) / 3.0
    h = MEASUREMENT_MATRIX
    time = second.time
    for hit in hits[2:]:
        x, p = plain_predict(x, p, hit.time - time, noise)
        time = hit.time
        kalman_gain = p @ h.T @ np.linalg.inv(h @ p @ h.T + hit.covariance)
        x = x + kalman_gain @ (hit.point - h @ x)
        p = (np.eye(4) - kalman_gain @ h) @ p
    x, p = plain_predict(x, p, stamp - time, noise)
    return Estimate(x, p, np.array([hit.covariance for hit in hits]))


def plain_predict(
    x: np.ndarray, p: np.ndarray, dt: float, noise: float
) -> tuple[np.ndarray, np.ndarray]:
    f = transition_matrix(dt)
    q = noise * abs(dt) * np.kron(np.eye(2), np.array([[dt**2 / 3, dt / 2], [dt / 2, 1.0]]))
    return f @ x, f @ p @ f.T + q


def plain_line(hits: list[Detection], stamp: float) -> Estimate:
    """The line by singular values; its covariance is not compared."""
    points = np.array([hit.point for hit in hits])
    mean = points.mean(axis=0)
    direction = np.linalg.svd(points - mean)[2][0]
    ends = [(points[k] - mean) @ direction for k in (0, -1)]
    velocity = direction * (ends[1] - ends[0]) / (hits[-1].time - hits[0].time)
    position = mean + direction * ends[1] + velocity * (stamp - hits[-1].time)
    state = np.array([position[0], velocity[0], position[1], velocity[1]])
    covariance = unweighted_least_squares(hits, stamp).covariance
    return Estimate(state, covariance, np.array([hit.covariance for hit in hits]))


# --- logic ---------------------------------------------------------------------------------------


def plain_logic(
    scans: Sequence[Mapping[str, Any]], sensor: Mapping[str, float], options: Mapping[str, Any]
) -> list[tuple[list[PlainTrack], int]]:
    """Tracks of each scan, and the number of potential tracks after it."""
    settings = settings_of(sensor, options)
    gamma = chi2.ppf(options["gate_probability"], 2)
    potential: list[Path] = []
    results = []
    for index, scan in enumerate(scans):
        stamp = float(scan["stamp"])
        detections = convert_scan(scan, index, settings)
        used: set[tuple[int, int]] = set()
        grown, waiting = [], []
        for path in potential:
            inside = []
            for j, detection in enumerate(detections):
                distance = region_distance(path.hits, detection, settings, options)
                if distance <= gamma:
                    inside.append((distance, j))
            if inside and len(path.hits) > 1:
                inside = [min(inside)]
            for _, j in inside:
                used.add(detections[j].key)
                grown.append(Path([*path.hits, detections[j]], path.first_scan))
            if not inside and options["missed"] == "waits":
                waiting.append(path)
        complete = [path for path in grown if len(path.hits) >= settings.min_hits]
        tracks = best_apart(
            [finish(one.hits, stamp, unweighted_least_squares(one.hits, stamp)) for one in complete]
        )
        taken = {key for track in tracks for key in track.hits}
        left = [
            path
            for path in [*(path for path in grown if path not in complete), *waiting]
            if index + 1 - path.first_scan < settings.window
            and not any(hit.key in taken for hit in path.hits)
        ]
        left += [Path([one], index) for one in detections if one.key not in used]
        potential = left
        results.append((tracks, len(potential)))
    return results


def best_apart(tracks: list[PlainTrack]) -> list[PlainTrack]:
    """The tracks that share no hit with a better one."""
    kept: list[PlainTrack] = []
    for track in sorted(tracks, key=lambda one: one.evaluation):
        if not any(set(track.hits) & set(other.hits) for other in kept):
            kept.append(track)
    return kept


def region_distance(
    hits: list[Detection], detection: Detection, settings: Parameters, options: Mapping[str, Any]
) -> float:
    """D of Eqs. 5 and 6, or of the prediction by a polynomial."""
    if len(hits) == 1:
        (hit,) = hits
        reach = settings.max_speed * abs(detection.time - hit.time)
        displacement = detection.point - hit.point
        d = np.array([max(0.0, v - reach) + max(0.0, -v - reach) for v in displacement])
        return float(d @ np.linalg.inv(hit.covariance + detection.covariance) @ d)
    degree = min(len(hits) - 1, options["degree"])
    # Weights of the hits in the prediction: the fit to each unit vector, evaluated.
    times = np.array([hit.time - detection.time for hit in hits]) / 10.0
    powers = np.vander(times, degree + 1, increasing=True)
    weights = powers @ np.linalg.inv(powers.T @ powers)[:, 0]  # of the hits, at time 0
    predicted = sum(weight * hit.point for weight, hit in zip(weights, hits, strict=True))
    covariance = detection.covariance + sum(
        weight**2 * hit.covariance for weight, hit in zip(weights, hits, strict=True)
    )
    misfit = detection.point - predicted
    return float(misfit @ np.linalg.inv(covariance) @ misfit)
