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
"""Plain track initiation by splitting, evaluating, pruning and merging (TSEPM), in slow loops.

Steps and equations are those of Li, D. D., Lin, Y., Zhang, Y., 2018. A track initiation method for
the underwater target tracking environment. China Ocean Engineering 32(2), 206-215. Units are m, s
and rad; azimuth is counter-clockwise from the sensor's x axis, a state ``[x, vx, y, vy]``.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.stats import chi2

WEIGHTED_PASSES = 2

MEASUREMENT_MATRIX = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]])
"""H of Eqs. 10 and 18: the position within the state."""

Key = tuple[int, int]
"""Of a scan and of a detection in it."""


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
    """How a detection was measured; without an own range_std, the sensor's model counts."""

    position: np.ndarray
    yaw: float
    pose_covariance: np.ndarray | None
    range_std: float | None
    azimuth_std: float
    across_as_along: bool


@dataclass(frozen=True, eq=False)
class Detection:
    """A detection, converted to the fixed frame: z of Eq. 9 and R of Eq. 11 at its time."""

    key: Key
    time: float
    point: np.ndarray
    covariance: np.ndarray
    sensing: Sensing

    @cached_property
    def major_axis_std(self) -> float:
        return math.sqrt(np.linalg.eigvalsh(self.covariance)[-1])


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
    hit_covariances: np.ndarray


@dataclass(frozen=True, eq=False)
class PlainTrack:
    """A confirmed or merged track: its hits, or its best member's, and f1, and what is tested."""

    stamp: float
    detections: tuple[Detection, ...]
    state: np.ndarray
    covariance: np.ndarray
    distance: float
    evaluation: float

    @property
    def hits(self) -> tuple[Key, ...]:
        return tuple(one.key for one in self.detections)


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
    settings, potential, results = Parameters(**parameters), [], []
    for index, scan in enumerate(scans):
        merged, potential, counts = step(potential, scan, index, settings)
        results.append((merged, counts))
    return [merged for merged, _ in results], [counts for _, counts in results]


def step(
    potential: list[PotentialTrack], scan: Mapping[str, Any], index: int, settings: Parameters
) -> tuple[list[PlainTrack], list[PotentialTrack], PlainCounts]:
    """Take a scan; returns its tracks, the potential tracks after it, and the numbers of both."""
    stamp = float(scan["stamp"])
    detections = convert_scan(scan, index, settings)  # Step 1
    confirmed, alive = [], []
    for track in split(potential, detections, settings):  # Step 2
        if track.scan_count <= settings.window and len(track.hits) >= settings.min_hits:  # Step 3
            confirmed.append(evaluated(track.hits, stamp, settings))  # Steps 4 and 5
        elif track.scan_count < settings.window:
            alive.append(track)
    retained = [track for track in confirmed if track.evaluation <= pruning_threshold(settings)]
    merged = [of_group(group, stamp, settings) for group in groups(retained, settings)]  # Step 7
    alive += [  # Step 8: in no gate of those alive when the scan came
        PotentialTrack((one,), 1)
        for one in detections
        if not any(is_gated(track, one, settings) for track in potential)
    ]
    return merged, alive, PlainCounts(len(alive), len(confirmed), len(retained))


# --- Step 1: obtain and convert measurements -----------------------------------------------------


def convert_scan(scan: Mapping[str, Any], scan_index: int, settings: Parameters) -> list[Detection]:
    """Convert every detection of a scan without bias to z and R of Eqs. 9 and 11 (Step 1).

    E[cos(azimuth)] shrinks by exp(-azimuth_std^2 / 2), so the point is divided by it.
    """
    poses = np.reshape(scan.get("sensor_pose", (0.0, 0.0, 0.0)), (-1, 3))
    pose_covariance = scan.get("sensor_pose_covariance")

    def own(name: str, row: int) -> float | None:
        values = scan.get(name)
        return None if values is None else float(values[row])

    detections = []
    for j, (range_, azimuth) in enumerate(zip(scan["range"], scan["azimuth"], strict=True)):
        x, y, yaw = poses[j if len(poses) > 1 else 0].tolist()
        azimuth_std = own("azimuth_std", j)
        sensing = Sensing(
            np.array([x, y]),
            yaw,
            None if pose_covariance is None else np.array(pose_covariance, float),
            own("range_std", j),
            settings.azimuth_std if azimuth_std is None else azimuth_std,
            settings.across_as_along and azimuth_std is None,
        )
        reach = float(range_) * math.exp(sensing.azimuth_std**2 / 2.0)
        offset = reach * np.array([math.cos(azimuth + yaw), math.sin(azimuth + yaw)])
        covariance = converted_covariance(float(range_), azimuth + yaw, offset, sensing, settings)
        time = float(scan["stamp"]) + (own("time_offset", j) or 0.0)
        point = sensing.position + offset
        detections.append(Detection((scan_index, j), time, point, covariance, sensing))
    return detections


def range_variance(range_: float, sensing: Sensing, settings: Parameters) -> float:
    """Return the variance of a range: the detection's own, else that of the sensor's model."""
    if sensing.range_std is not None:
        return sensing.range_std**2
    return settings.range_std**2 + (settings.range_std_fraction * range_) ** 2


def converted_covariance(
    range_: float, direction: float, lever: np.ndarray, sensing: Sensing, settings: Parameters
) -> np.ndarray:
    """Return the exact covariance of the unbiased converted point, R of Eq. 11.

    With z = r_m (cos a_m, sin a_m) / s along and across the line of sight, s as in `convert_scan`,
    and Gaussian r_m and a_m about r and 0, E[z] = (r, 0), and half of E[r_m^2] / s^2 times 1 + s^4
    and 1 - s^4 are the mean squares. An uncertain yaw turns the lever.
    """
    s = math.exp(-(sensing.azimuth_std**2) / 2.0)
    half = 0.5 * (range_**2 + range_variance(range_, sensing, settings)) / s**2
    variances = np.array([half * (1.0 + s**4) - range_**2, half * (1.0 - s**4)])
    if sensing.across_as_along:
        variances[1] = max(variances)
    axes = np.array(
        [[math.cos(direction), -math.sin(direction)], [math.sin(direction), math.cos(direction)]]
    )
    covariance = axes * variances @ axes.T
    if sensing.pose_covariance is not None:
        jacobian = np.array([[1.0, 0.0, -lever[1]], [0.0, 1.0, lever[0]]])
        covariance = covariance + jacobian @ sensing.pose_covariance @ jacobian.T
    return covariance


def covariance_at(position: np.ndarray, sensing: Sensing, settings: Parameters) -> np.ndarray:
    """Return R of Eq. 11 for a target at a position of the fixed frame."""
    offset = position - sensing.position
    direction = math.atan2(offset[1], offset[0])
    return converted_covariance(math.hypot(*offset), direction, offset, sensing, settings)


# --- Step 2: update the potential tracks (track splitting) ---------------------------------------


def probability_threshold(probability: float) -> float:
    """Return the radius of the ellipse that holds a share of a 2-D Gaussian (Eqs. 5 and 26)."""
    return math.sqrt(-2.0 * math.log(1.0 - probability))


def is_gated(track: PotentialTrack, detection: Detection, settings: Parameters) -> bool:
    """Tell whether a detection lies within gamma_1 of a track's last hit (Eq. 4)."""
    last = track.hits[-1]
    gamma = settings.max_speed * abs(detection.time - last.time)
    gamma += probability_threshold(settings.gate_probability) * last.major_axis_std
    return math.dist(detection.point, last.point) <= gamma


def split(
    potential: list[PotentialTrack], detections: list[Detection], settings: Parameters
) -> list[PotentialTrack]:
    """Replace each track by a child for each gated detection, or note a miss (Section 3.2)."""
    updated = []
    for track in potential:
        gated = [(one,) for one in detections if is_gated(track, one, settings)]
        updated += [
            PotentialTrack(track.hits + more, track.scan_count + 1) for more in gated or [()]
        ]
    return updated


# --- Step 4: estimate the initial state and covariance matrix ------------------------------------


def transition_matrix(duration: float) -> np.ndarray:
    """Return A of Eq. 17 for a duration in place of T; a negative one goes back in time."""
    matrix = np.eye(4)
    matrix[0, 1] = matrix[2, 3] = duration
    return matrix


def stacked(hits: Sequence[Detection], stamp: float) -> tuple[np.ndarray, np.ndarray]:
    """Return H_ti of Eq. 16 from the state at the stamp to each hit, (m, 2, 4), and Z, (m, 2)."""
    H = [MEASUREMENT_MATRIX @ transition_matrix(hit.time - stamp) for hit in hits]
    return np.array(H), np.array([hit.point for hit in hits])


def unweighted_least_squares(hits: Sequence[Detection], stamp: float) -> Estimate:
    """Estimate by Eqs. 19 and 20, the products of Eq. 15 summed hit by hit."""
    (H, z), R = stacked(hits, stamp), np.array([hit.covariance for hit in hits])
    inverse = np.linalg.inv(np.einsum("mij,mik->jk", H, H))
    middle = np.einsum("mij,mik,mkl->jl", H, R, H)
    return Estimate(inverse @ np.einsum("mij,mi->j", H, z), inverse @ middle @ inverse, R)


def estimated(hits: Sequence[Detection], stamp: float, settings: Parameters) -> Estimate:
    """Estimate by Eqs. 19 and 20, or weighted, each R where the last fit puts the target."""
    estimate = unweighted_least_squares(hits, stamp)
    H, z = stacked(hits, stamp)
    for _ in range(WEIGHTED_PASSES if settings.estimator == "weighted" else 0):
        places = zip(H @ estimate.state, hits, strict=True)
        R = np.array([covariance_at(place, hit.sensing, settings) for place, hit in places])
        weighted = np.swapaxes(H, 1, 2) @ np.linalg.inv(R)  # H^T R^-1
        covariance = np.linalg.inv((weighted @ H).sum(axis=0))
        estimate = Estimate(covariance @ np.einsum("mij,mj->i", weighted, z), covariance, R)
    return estimate


# --- Steps 5 and 6: determine the evaluation value, and prune ------------------------------------


def evaluated(hits: tuple[Detection, ...], stamp: float, settings: Parameters) -> PlainTrack:
    """Attach both figures of Section 3.4 to a confirmed track (Step 5)."""
    estimate = estimated(hits, stamp, settings)
    distance = tested = normalized_distance(hits, estimate, stamp)
    if settings.evaluation == "clutter_statistic":  # f2 of Eq. 25, by the discs of Eq. 24
        areas = [math.pi * math.dist(one.point, other.point) ** 2 for one, other in pairwise(hits)]
        tested = 2.0 * settings.clutter_density * sum(areas)
    return PlainTrack(stamp, hits, estimate.state, estimate.covariance, distance, tested)


def normalized_distance(hits: Sequence[Detection], estimate: Estimate, stamp: float) -> float:
    """Return f1 of Eq. 23, the largest f(k) of Eq. 22 over the hits; SC_k is Eq. 21's."""
    H, z = stacked(hits, stamp)
    residual = z - H @ estimate.state
    spread = H @ estimate.covariance @ np.swapaxes(H, 1, 2) + estimate.hit_covariances
    return float(np.einsum("mi,mij,mj->m", residual, np.linalg.inv(spread), residual).max())


def pruning_threshold(settings: Parameters) -> float:
    """Return the largest evaluation that the pruning keeps (Eq. 26; for f2 the lower tail)."""
    if settings.evaluation == "clutter_statistic":
        return float(chi2.ppf(settings.clutter_test_size, 2 * settings.min_hits - 2))
    threshold = probability_threshold(settings.pruning_probability)
    return threshold**2 if settings.reading == "squared" else threshold


# --- Step 7: merge track -------------------------------------------------------------------------


def may_merge(one: PlainTrack, other: PlainTrack, settings: Parameters) -> bool:
    """Tell whether two tracks share more than M/2 hits and are close by Eqs. 28 to 30."""
    if len(set(one.hits) & set(other.hits)) <= settings.min_hits / 2:
        return False
    apart = one.state - other.state
    square = apart @ np.linalg.inv(one.covariance + other.covariance) @ apart
    return float(square) <= probability_threshold(settings.merging_probability) ** 2


def groups(tracks: list[PlainTrack], settings: Parameters) -> list[list[PlainTrack]]:
    """Return the connected components of the pairwise conditions."""
    found, remaining = [], list(tracks)
    while remaining:
        group = [remaining.pop(0)]
        for member in group:  # grows while it is walked through
            near = [other for other in remaining if may_merge(member, other, settings)]
            group += near
            remaining = [other for other in remaining if other not in near]
        found.append(group)
    return found


def of_group(group: list[PlainTrack], stamp: float, settings: Parameters) -> PlainTrack:
    """Merge a group (Section 3.6): means by Eqs. 31 to 33, or a fit to all its hits, each once."""
    best = min(group, key=lambda track: (track.evaluation, track.hits))
    state, covariance = best.state, best.covariance
    if len(group) > 1 and settings.merging == "refit":
        distinct = {hit.key: hit for track in group for hit in track.detections}
        refit = estimated([distinct[key] for key in sorted(distinct)], stamp, settings)
        state, covariance = refit.state, refit.covariance
    elif len(group) > 1:
        weights = np.array([track.distance for track in group])
        weights = weights / weights.sum() if weights.any() else np.full(len(group), 1 / len(group))
        state = weights @ [track.state for track in group]
        covariance = np.tensordot(weights, [track.covariance for track in group], 1)
    return PlainTrack(stamp, best.detections, state, covariance, best.distance, best.evaluation)
