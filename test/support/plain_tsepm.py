"""Plain track initiation by splitting, evaluating, pruning and merging (TSEPM), in slow loops.

Steps and equations are those of Li, D. D., Lin, Y., Zhang, Y., 2018. A track initiation method for
the underwater target tracking environment. China Ocean Engineering 32(2), 206-215. Units are m, s
and rad; azimuth is counter-clockwise from the sensor's x axis, a state ``[x, vx, y, vy]``.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.stats import chi2

WEIGHTED_PASSES = 2

MEASUREMENT_MATRIX = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]])
"""H of Eqs. 10 and 18: the position within the state."""


@dataclass(frozen=True, kw_only=True)
class Parameters:
    """Parameters of the method, by the names of the node's.

    `clutter_test_size` is the probability that a track of clutter passes the test of f2;
    `across_as_along` is not of the published method.
    """

    range_std: float
    range_std_fraction: float
    azimuth_std: float
    clutter_density: float
    max_speed: float
    min_hits: int
    window: int
    gate_probability: float = 0.9
    evaluation: str = "normalized_distance"  # or clutter_statistic
    reading: str = "literal"  # or squared
    pruning_probability: float = 0.99
    clutter_test_size: float = 0.05
    merging: str = "moments"  # or refit
    merging_probability: float = 0.9
    estimator: str = "unweighted"  # or weighted
    across_as_along: bool = False


@dataclass(frozen=True, eq=False)
class Sensing:
    """How a detection was measured: what its covariance depends on besides its place."""

    position: np.ndarray
    yaw: float
    pose_covariance: np.ndarray | None
    """Of x, y and yaw."""
    range_std: float | None
    """The detection's own; None means the sensor's model."""
    azimuth_std: float
    across_as_along: bool


@dataclass(frozen=True, eq=False)
class Detection:
    """A detection, converted to the fixed frame: z of Eq. 9 and R of Eq. 11 at its time."""

    key: tuple[int, int]
    """Of the scan and of the detection in it."""
    time: float
    point: np.ndarray
    covariance: np.ndarray
    sensing: Sensing


@dataclass(frozen=True, eq=False)
class PotentialTrack:
    """An unconfirmed hypothesis: its hits, oldest first, and N_a, the scans since the first."""

    hits: tuple[Detection, ...]
    scan_count: int


@dataclass(frozen=True, eq=False)
class Estimate:
    """State and covariance at the confirming scan, and the R_k that Eq. 21 needs."""

    state: np.ndarray
    covariance: np.ndarray
    hit_covariances: list[np.ndarray]


@dataclass(frozen=True, eq=False)
class EvaluatedTrack:
    """A confirmed track with its estimate and both figures of Section 3.4."""

    hits: tuple[Detection, ...]
    estimate: Estimate
    distance: float
    clutter_statistic: float


@dataclass(frozen=True, eq=False)
class PlainTrack:
    """A track put out: hits, evaluation and f1 of the best member, and the hits of every one."""

    stamp: float
    hits: tuple[tuple[int, int], ...]
    members: frozenset[tuple[tuple[int, int], ...]]
    state: np.ndarray
    covariance: np.ndarray
    evaluation: float
    distance: float


@dataclass(frozen=True)
class PlainCounts:
    """Tracks of one scan: potential after it; confirmed; of these, left by the pruning."""

    potential: int
    confirmed: int
    retained: int


def plain_tsepm_with_counts(
    scans: Sequence[Mapping[str, Any]], **parameters: Any
) -> tuple[list[list[PlainTrack]], list[PlainCounts]]:
    """Run the method over scans, with the fields of `Scan` as keys and those of `Parameters`."""
    settings = Parameters(**parameters)
    potential: list[PotentialTrack] = []
    all_tracks = []
    all_counts = []
    for scan_index, scan in enumerate(scans):
        stamp = float(scan["stamp"])
        detections = convert_scan(scan, scan_index, settings)  # Step 1
        updated = update_tracks(potential, detections, settings)  # Step 2
        confirmed, alive = confirm_tracks(updated, settings)  # Step 3
        evaluated = []
        for track in confirmed:
            estimate = estimate_track(track.hits, stamp, settings)  # Step 4
            evaluated.append(evaluate_track(track.hits, estimate, stamp, settings))  # Step 5
        retained = [track for track in evaluated if is_retained(track, settings)]  # Step 6
        merged = merge_tracks(retained, stamp, settings)  # Step 7
        potential = alive + start_tracks(potential, detections, settings)  # Step 8
        all_tracks.append(merged)
        all_counts.append(PlainCounts(len(potential), len(confirmed), len(retained)))
    return all_tracks, all_counts


# --- Step 1: obtain and convert measurements -----------------------------------------------------


def convert_scan(scan: Mapping[str, Any], scan_index: int, settings: Parameters) -> list[Detection]:
    """Convert every detection of a scan without bias to z and R of Eqs. 9 and 11 (Step 1).

    E[cos(azimuth)] shrinks by exp(-azimuth_std^2 / 2), so the point is divided by it.
    """
    detections = []
    for j, (range_, azimuth) in enumerate(zip(scan["range"], scan["azimuth"], strict=True)):
        sensing = sensing_of(scan, j, settings)
        shrinkage = math.exp(-(sensing.azimuth_std**2) / 2.0)
        direction = np.array([math.cos(azimuth), math.sin(azimuth)])
        offset = rotation_matrix(sensing.yaw) @ (float(range_) * direction / shrinkage)
        covariance = fixed_frame_covariance(
            float(range_), float(azimuth), offset, sensing, settings
        )
        time = float(scan["stamp"]) + (detection_value(scan, "time_offset", j) or 0.0)
        point = sensing.position + offset
        detections.append(Detection((scan_index, j), time, point, covariance, sensing))
    return detections


def detection_value(scan: Mapping[str, Any], name: str, detection_index: int) -> float | None:
    """Return an optional value of one detection, None where the scan does not have it."""
    values = scan.get(name)
    return None if values is None else float(values[detection_index])


def sensing_of(scan: Mapping[str, Any], detection_index: int, settings: Parameters) -> Sensing:
    """Return how one detection of a scan was measured."""
    poses = np.reshape(scan.get("sensor_pose", (0.0, 0.0, 0.0)), (-1, 3))
    x, y, yaw = poses[detection_index if len(poses) > 1 else 0].tolist()
    pose_covariance = scan.get("sensor_pose_covariance")
    azimuth_std = detection_value(scan, "azimuth_std", detection_index)
    return Sensing(
        position=np.array([x, y]),
        yaw=yaw,
        pose_covariance=None if pose_covariance is None else np.array(pose_covariance, float),
        range_std=detection_value(scan, "range_std", detection_index),
        azimuth_std=settings.azimuth_std if azimuth_std is None else azimuth_std,
        across_as_along=settings.across_as_along and azimuth_std is None,
    )


def rotation_matrix(angle: float) -> np.ndarray:
    """Return the matrix that turns a vector counter-clockwise."""
    return np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])


def range_variance(range_: float, sensing: Sensing, settings: Parameters) -> float:
    """Return the variance of a range: the detection's own, else that of the sensor's model."""
    if sensing.range_std is not None:
        return sensing.range_std**2
    return settings.range_std**2 + (settings.range_std_fraction * range_) ** 2


def converted_covariance(
    range_: float, azimuth: float, range_variance_: float, azimuth_std: float
) -> np.ndarray:
    """Return the exact covariance of the unbiased converted point, R of Eq. 11.

    With z = (r_m cos a_m, r_m sin a_m) / s, s = exp(-azimuth_std^2 / 2), and Gaussian r_m and a_m
    about the given range r and azimuth a, E[z] = p = (r cos a, r sin a) and

        E[r_m^2] = r^2 + range_variance,
        E[cos^2 a_m] = (1 + s^4 cos 2a) / 2,
        E[sin^2 a_m] = (1 - s^4 cos 2a) / 2,
        E[sin a_m cos a_m] = s^4 sin 2a / 2,

    so that the covariance is E[z z^T] - p p^T.
    """
    shrinkage = math.exp(-(azimuth_std**2) / 2.0)
    mean_square = (range_**2 + range_variance_) / shrinkage**2
    cos_double = shrinkage**4 * math.cos(2.0 * azimuth)
    sin_double = shrinkage**4 * math.sin(2.0 * azimuth)
    x = range_ * math.cos(azimuth)
    y = range_ * math.sin(azimuth)
    xx = mean_square * (1.0 + cos_double) / 2.0 - x * x
    yy = mean_square * (1.0 - cos_double) / 2.0 - y * y
    xy = mean_square * sin_double / 2.0 - x * y
    return np.array([[xx, xy], [xy, yy]])


def fixed_frame_covariance(
    range_: float, azimuth: float, offset: np.ndarray, sensing: Sensing, settings: Parameters
) -> np.ndarray:
    """Return R of Eq. 11 in the fixed frame; the offset is the lever of the sensor's yaw."""
    in_sensor_frame = converted_covariance(
        range_, azimuth, range_variance(range_, sensing, settings), sensing.azimuth_std
    )
    if sensing.across_as_along:
        along = np.array([[math.cos(azimuth)], [math.sin(azimuth)]])
        across = rotation_matrix(0.5 * math.pi) @ along
        lacking = along.T @ in_sensor_frame @ along - across.T @ in_sensor_frame @ across
        in_sensor_frame = in_sensor_frame + max(float(lacking[0, 0]), 0.0) * (across @ across.T)
    rotation = rotation_matrix(sensing.yaw)
    covariance = rotation @ in_sensor_frame @ rotation.T
    if sensing.pose_covariance is not None:
        dx, dy = offset
        pose_jacobian = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx]])
        covariance = covariance + pose_jacobian @ sensing.pose_covariance @ pose_jacobian.T
    return covariance


# --- Step 2: update the potential tracks (track splitting) ---------------------------------------


def probability_threshold(probability: float) -> float:
    """Return the radius of the ellipse that holds a share of a 2-D Gaussian (Eqs. 5 and 26)."""
    return math.sqrt(-2.0 * math.log(1.0 - probability))


def gate_threshold(last_hit: Detection, detection: Detection, settings: Parameters) -> float:
    """Return gamma_1 of Eq. 4, with kT the time between the two detections."""
    elapsed = abs(detection.time - last_hit.time)
    major_axis_std = math.sqrt(max(np.linalg.eigvalsh(last_hit.covariance)))
    alpha = probability_threshold(settings.gate_probability)
    return settings.max_speed * elapsed + alpha * major_axis_std


def is_gated(track: PotentialTrack, detection: Detection, settings: Parameters) -> bool:
    """Tell whether a detection lies within the gate about a track's last hit (Eq. 4)."""
    last_hit = track.hits[-1]
    separation = math.dist(detection.point, last_hit.point)
    return separation <= gate_threshold(last_hit, detection, settings)


def update_tracks(
    potential: list[PotentialTrack], detections: list[Detection], settings: Parameters
) -> list[PotentialTrack]:
    """Replace each track by a child for each gated detection, or note a miss (Section 3.2)."""
    updated = []
    for track in potential:
        gated = [detection for detection in detections if is_gated(track, detection, settings)]
        for detection in gated:
            updated.append(PotentialTrack((*track.hits, detection), track.scan_count + 1))
        if not gated:
            updated.append(PotentialTrack(track.hits, track.scan_count + 1))
    return updated


# --- Step 3: confirm the track -------------------------------------------------------------------


def confirm_tracks(
    updated: list[PotentialTrack], settings: Parameters
) -> tuple[list[PotentialTrack], list[PotentialTrack]]:
    """Return the confirmed tracks and those that stay potential; terminate the rest (Step 3)."""
    confirmed = []
    alive = []
    for track in updated:
        hit_count = len(track.hits)
        if track.scan_count <= settings.window and hit_count >= settings.min_hits:
            confirmed.append(track)
        elif track.scan_count >= settings.window and hit_count < settings.min_hits:
            continue
        else:
            alive.append(track)
    return confirmed, alive


# --- Step 4: estimate the initial state and covariance matrix ------------------------------------


def transition_matrix(duration: float) -> np.ndarray:
    """Return A of Eq. 17 for a duration in place of T; a negative one goes back in time."""
    return np.kron(np.eye(2), [[1.0, duration], [0.0, 1.0]])


def hit_matrix(hit: Detection, stamp: float) -> np.ndarray:
    """Return H_ti of Eq. 16: from the state at the stamp to the position at the hit's time."""
    return MEASUREMENT_MATRIX @ transition_matrix(hit.time - stamp)


def estimate_track(hits: Sequence[Detection], stamp: float, settings: Parameters) -> Estimate:
    """Estimate state and covariance at the stamp by the chosen least squares (Step 4)."""
    if settings.estimator == "weighted":
        return weighted_least_squares(hits, stamp, settings)
    return unweighted_least_squares(hits, stamp)


def unweighted_least_squares(hits: Sequence[Detection], stamp: float) -> Estimate:
    """Estimate by Eqs. 19 and 20, the products of Eq. 15 summed hit by hit."""
    normal_matrix = np.zeros((4, 4))  # H^T H
    normal_vector = np.zeros(4)  # H^T Z
    middle = np.zeros((4, 4))  # H^T R H
    for hit in hits:
        h = hit_matrix(hit, stamp)
        normal_matrix += h.T @ h
        normal_vector += h.T @ hit.point
        middle += h.T @ hit.covariance @ h
    inverse = np.linalg.inv(normal_matrix)
    return Estimate(
        state=inverse @ normal_vector,
        covariance=inverse @ middle @ inverse,
        hit_covariances=[hit.covariance for hit in hits],
    )


def weighted_least_squares(
    hits: Sequence[Detection], stamp: float, settings: Parameters
) -> Estimate:
    """The weighted counterpart of Eqs. 19 and 20, each R where the last fit puts the target."""
    estimate = unweighted_least_squares(hits, stamp)
    for _ in range(WEIGHTED_PASSES):
        information = np.zeros((4, 4))  # H^T R^-1 H
        information_vector = np.zeros(4)  # H^T R^-1 Z
        hit_covariances = []
        for hit in hits:
            h = hit_matrix(hit, stamp)
            hit_covariance = covariance_at(h @ estimate.state, hit.sensing, settings)
            weight = np.linalg.inv(hit_covariance)
            information += h.T @ weight @ h
            information_vector += h.T @ weight @ hit.point
            hit_covariances.append(hit_covariance)
        covariance = np.linalg.inv(information)
        estimate = Estimate(covariance @ information_vector, covariance, hit_covariances)
    return estimate


def covariance_at(position: np.ndarray, sensing: Sensing, settings: Parameters) -> np.ndarray:
    """Return R of Eq. 11 for a target at a position of the fixed frame."""
    offset = position - sensing.position
    range_ = math.hypot(offset[0], offset[1])
    azimuth = math.atan2(offset[1], offset[0]) - sensing.yaw
    return fixed_frame_covariance(range_, azimuth, offset, sensing, settings)


# --- Step 5: determine the evaluation value ------------------------------------------------------


def evaluate_track(
    hits: tuple[Detection, ...], estimate: Estimate, stamp: float, settings: Parameters
) -> EvaluatedTrack:
    """Attach both figures of Section 3.4 to a confirmed track (Step 5)."""
    return EvaluatedTrack(
        hits=hits,
        estimate=estimate,
        distance=normalized_distance(hits, estimate, stamp),
        clutter_statistic=clutter_statistic(hits, settings.clutter_density),
    )


def normalized_distance(hits: Sequence[Detection], estimate: Estimate, stamp: float) -> float:
    """Return f1 of Eq. 23, the largest f(k) of Eq. 22 over the hits."""
    distances = []
    for hit, hit_covariance in zip(hits, estimate.hit_covariances, strict=True):
        transition = transition_matrix(hit.time - stamp)
        state = transition @ estimate.state
        state_covariance = transition @ estimate.covariance @ transition.T
        residual = hit.point - MEASUREMENT_MATRIX @ state
        residual_covariance = (  # SC_k of Eq. 21
            MEASUREMENT_MATRIX @ state_covariance @ MEASUREMENT_MATRIX.T + hit_covariance
        )
        distances.append(float(residual @ np.linalg.inv(residual_covariance) @ residual))
    return max(distances)


def clutter_statistic(hits: Sequence[Detection], clutter_density: float) -> float:
    """Return f2 of Eq. 25, V(k) being the disc (Eq. 24) out to the next associated point."""
    areas = [math.pi * math.dist(one.point, other.point) ** 2 for one, other in pairwise(hits)]
    return 2.0 * clutter_density * sum(areas)


def evaluation_of(track: EvaluatedTrack, settings: Parameters) -> float:
    """Return the figure that the pruning tests."""
    if settings.evaluation == "clutter_statistic":
        return track.clutter_statistic
    return track.distance


# --- Step 6: prune track -------------------------------------------------------------------------


def is_retained(track: EvaluatedTrack, settings: Parameters) -> bool:
    """Tell whether the pruning keeps a confirmed track (Step 6, Section 3.5)."""
    return evaluation_of(track, settings) <= pruning_threshold(settings)


def pruning_threshold(settings: Parameters) -> float:
    """Return the largest evaluation that the pruning keeps (Eq. 26; for f2 the lower tail)."""
    if settings.evaluation == "clutter_statistic":
        degrees_of_freedom = 2 * settings.min_hits - 2
        return float(chi2.ppf(settings.clutter_test_size, degrees_of_freedom))
    threshold = probability_threshold(settings.pruning_probability)
    return threshold**2 if settings.reading == "squared" else threshold


# --- Step 7: merge track -------------------------------------------------------------------------


def hit_keys(track: EvaluatedTrack) -> tuple[tuple[int, int], ...]:
    """Return (scan index, detection index) of each hit, oldest first."""
    return tuple(hit.key for hit in track.hits)


def may_merge(first: EvaluatedTrack, second: EvaluatedTrack, settings: Parameters) -> bool:
    """Tell whether two tracks share more than M/2 hits and are close by Eq. 30 (Section 3.6)."""
    shared = set(hit_keys(first)) & set(hit_keys(second))
    if len(shared) <= settings.min_hits / 2:
        return False
    threshold = probability_threshold(settings.merging_probability)
    return state_distance(first, second) <= threshold**2


def state_distance(first: EvaluatedTrack, second: EvaluatedTrack) -> float:
    """Return the left side of Eq. 30, the squared distance of two states (Eqs. 28 and 29)."""
    difference = first.estimate.state - second.estimate.state
    covariance = first.estimate.covariance + second.estimate.covariance
    return float(difference @ np.linalg.inv(covariance) @ difference)


def group_tracks(tracks: list[EvaluatedTrack], settings: Parameters) -> list[list[EvaluatedTrack]]:
    """Return the connected components of the pairwise conditions."""
    groups = []
    remaining = list(tracks)
    while remaining:
        group = [remaining.pop(0)]
        for member in group:  # grows while it is walked through
            neighbours = [other for other in remaining if may_merge(member, other, settings)]
            group.extend(neighbours)
            remaining = [other for other in remaining if other not in neighbours]
        groups.append(group)
    return groups


def merge_tracks(
    tracks: list[EvaluatedTrack], stamp: float, settings: Parameters
) -> list[PlainTrack]:
    """Merge each group of tracks into one (Step 7, Section 3.6)."""
    merged = []
    for group in group_tracks(tracks, settings):
        best = min(group, key=lambda track: (evaluation_of(track, settings), hit_keys(track)))
        state, covariance = merged_state(group, stamp, settings)
        merged.append(
            PlainTrack(
                stamp=stamp,
                hits=hit_keys(best),
                members=frozenset(hit_keys(track) for track in group),
                state=state,
                covariance=covariance,
                evaluation=evaluation_of(best, settings),
                distance=best.distance,
            )
        )
    return merged


def merged_state(
    group: list[EvaluatedTrack], stamp: float, settings: Parameters
) -> tuple[np.ndarray, np.ndarray]:
    """Return state and covariance of a group; a track alone keeps its own."""
    if len(group) == 1:
        return group[0].estimate.state, group[0].estimate.covariance
    if settings.merging == "refit":
        return refitted_state(group, stamp, settings)
    return moments_state(group)


def moments_state(group: list[EvaluatedTrack]) -> tuple[np.ndarray, np.ndarray]:
    """Return the weighted means of Eqs. 32 and 33, with the weights of Eq. 31."""
    total_distance = sum(track.distance for track in group)
    state = np.zeros(4)
    covariance = np.zeros((4, 4))
    for track in group:
        weight = track.distance / total_distance if total_distance > 0.0 else 1.0 / len(group)
        state += weight * track.estimate.state
        covariance += weight * track.estimate.covariance
    return state, covariance


def refitted_state(
    group: list[EvaluatedTrack], stamp: float, settings: Parameters
) -> tuple[np.ndarray, np.ndarray]:
    """Estimate again (Step 7) from the group's hits, every distinct detection taken once."""
    distinct = {hit.key: hit for track in group for hit in track.hits}
    hits = [distinct[key] for key in sorted(distinct)]
    estimate = estimate_track(hits, stamp, settings)
    return estimate.state, estimate.covariance


# --- Step 8: create new potential tracks ---------------------------------------------------------


def start_tracks(
    potential: list[PotentialTrack], detections: list[Detection], settings: Parameters
) -> list[PotentialTrack]:
    """Start a track from every detection in no gate of those alive when the scan came (Step 8)."""
    return [
        PotentialTrack((detection,), 1)
        for detection in detections
        if not any(is_gated(track, detection, settings) for track in potential)
    ]
