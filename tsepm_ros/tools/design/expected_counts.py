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

r"""Theory of the rule M/N: detection, false starts, expected counts, shares that pass evaluation.

The probabilities of the rule are in closed form and by Markov chains. The scans of a start count
from its first hit, which is one of the M hits and the first of the N scans.

The theory is a chain of expected numbers per m^2, scan by scan, at each range :math:`r`. Clutter is
Poisson with :math:`\lambda`. The gate of a track whose last hit is :math:`k` scans old has the area
:math:`a_k(r)` of the part inside the disc of a circle of radius
:math:`v_{max} k T + \alpha\sigma(r)` (Eqs. 4-5), and expects :math:`\lambda a_k` detections.

*Tracks.* Let :math:`F(n, h, k)` be the expected density of potential tracks with :math:`n` scans
since the first hit, inclusive, and :math:`h` hits, the last of them :math:`k` scans before the next
scan. The published rules turn it into

- :math:`\lambda a_k F` tracks :math:`(n+1, h+1, 1)`: one child for each gated detection;
- :math:`e^{-\lambda a_k} F` tracks :math:`(n+1, h, k+1)`: only an empty gate leaves the parent;
- at :math:`h+1 = M` the children are raw confirmations; at :math:`n+1 = N` the others end.

These means are exact for a given density of starts, since every scan's clutter is independent of
the tracks that meet it. A start thus has :math:`\prod \lambda a` paths: tracks of :math:`j` hits
grow as :math:`\lambda^j`, raw confirmations as :math:`\lambda^M`, as long as starts grow as
:math:`\lambda`.

*Starts.* Starts do not grow likewise: only detections outside every gate start a track. Let
:math:`G(n, h, k)` be the density of *distinct* last hits by the state of the path that lives
longest. The number of gates over a point is taken as Poisson with mean :math:`\mu = \sum a_k G`, so
that :math:`\lambda e^{-\mu}` detections start a track; a covered detection continues the path of
fewest hits among its gates: :math:`P(\text{fewest} = h) = e^{-\mu_{<h}} (1 - e^{-\mu_h})`. A last
hit whose paths are all confirmed has no gate. This mean field ignores that gates cluster.

Two consequences: where gates overlap (:math:`\lambda a > 1`), starts fall with clutter while each
start's tree grows. Starts come in waves: nearly every detection of the first scan starts a track,
the trees cover the disc, and when all their paths are confirmed in scan M, the next wave starts.
The chain is for clutter alone; a target adds its own paths.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from tsepm_ros.methods.tsepm import (
    TsepmOptions,
    clutter_statistic,
    clutter_threshold,
    distance_threshold,
    normalized_distance,
)
from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from tsepm_ros.numerics.gaussian import gate_factor
from tsepm_ros.tracker.initial_state import fit_states
from tsepm_ros.tracker.measurement import (
    convert_measurements,
    major_sigma,
    measurement_covariance,
)
from tsepm_ros.tracker.scan import Scan
from tsepm_ros.tracker.sensor import SensorModel

RINGS = 60
"""Rings into which the disc is divided."""
PATHS = 10_000
MIN_PASSES = 3.0
"""Minimum number of passing paths for a share; with fewer, the share of this number counts."""


def confirmation_probability(
    min_hits: int, window: int, detection_probability: float, gate_probability: float
) -> float:
    """P_DT, the P_D of TSEPM 2018, Table 1: a target confirmed by a start in the first scan.

    ``P_D = p_d P(Binomial(N - 1, P p_d) >= M - 1)``

    Parameters
    ----------
    min_hits, window : int
        M and N.
    detection_probability, gate_probability : float
        p_d, and P that a detected target falls into the gate.
    """
    hit = gate_probability * detection_probability
    trials = window - 1
    return detection_probability * sum(
        math.comb(trials, hits) * hit**hits * (1.0 - hit) ** (trials - hits)
        for hits in range(min_hits - 1, trials + 1)
    )


def unbounded_gate_areas(
    max_speed: float, interval: float, margin: ArrayLike, window: int
) -> FloatArray:
    """Area of the gate k scans after the last hit, ``pi (v_max k T + g)^2``, k = 1 to N, m^2.

    Parameters
    ----------
    max_speed, interval : float
        v_max, m/s, and T, s.
    margin : (...) array_like
        g, m: ``alpha sigma_Rmax`` in Eq. 4.
    window : int
        N.

    Returns
    -------
    (..., N) ndarray
    """
    reach = max_speed * interval * np.arange(1, window + 1)
    return np.pi * np.square(reach + np.asarray(margin, float)[..., None])


def false_start_probability(
    min_hits: int, window: int, clutter_density: float, areas: FloatArray
) -> float:
    """P_F(1) of TSEPM 2018, Table 1: a start from clutter reaches M hits within N scans.

    A first-passage chain over the number of hits and the scans k since the last hit. A gate has a
    hit with probability ``p_k = 1 - exp(-lambda a_k)``; tracks do not split.

    Parameters
    ----------
    min_hits, window : int
        M and N.
    clutter_density : float
        lambda, 1/m^2.
    areas : (N,) ndarray
        a_k, see `gate_areas`, m^2.
    """
    hit = -np.expm1(-clutter_density * areas[:window])
    state = np.zeros((min_hits, window))  # hits - 1, k - 1
    state[0, 0] = 1.0
    confirmed = 0.0
    for _ in range(window - 1):
        hits = state @ hit
        confirmed += hits[min_hits - 2]
        missed = state * (1.0 - hit)
        state = np.zeros_like(state)
        state[:, 1:] = missed[:, :-1]
        state[1:, 0] = hits[:-1]
        state[min_hits - 1] = 0.0
    return float(confirmed)


def confirmed_by(
    min_hits: int,
    window: int,
    detection_probability: float,
    gate_probability: float,
    scans: int,
    pass_share: float = 1.0,
) -> FloatArray:
    """Probability that a target present from the first scan on is confirmed by each scan.

    A chain over the scans and hits of the target's start. While a start lives, the
    target's hits extend it. It ends after N scans without M hits or when its evaluation fails; then
    the next detection starts a new track.

    Parameters
    ----------
    min_hits, window : int
        M and N.
    detection_probability, gate_probability : float
        p_d and P.
    scans : int
        Number of scans.
    pass_share : float, optional
        Share of a target's tracks that pass the evaluation.

    Returns
    -------
    (scans,) ndarray
        Without clutter, which can only delay a target's start or add hits to it.
    """
    hit = gate_probability * detection_probability
    alive = np.zeros((window, min_hits))  # scans - 1, hits - 1
    idle, confirmed = 1.0, 0.0
    by_scan = np.zeros(scans)
    for scan in range(scans):
        moved = np.zeros_like(alive)
        moved[1:] += alive[:-1] * (1.0 - hit)
        moved[1:, 1:] += alive[:-1, :-1] * hit
        reached = moved[:, min_hits - 1].sum()
        moved[:, min_hits - 1] = 0.0
        confirmed += reached * pass_share
        ended = reached * (1.0 - pass_share) + moved[window - 1].sum()
        moved[window - 1] = 0.0
        moved[0, 0] = idle * detection_probability
        idle = idle * (1.0 - detection_probability) + ended
        alive = moved
        by_scan[scan] = confirmed
    return by_scan


@dataclass(frozen=True, kw_only=True)
class ExpectedGating:
    """Parameters that determine the size of the gates.

    Attributes
    ----------
    sensor : SensorModel
    max_speed : float
        v_max, m/s.
    interval : float
        T, s.
    gate_probability : float
        P.
    """

    sensor: SensorModel
    max_speed: float
    interval: float
    gate_probability: float


@dataclass(frozen=True)
class Expected:
    """Expected numbers over the disc, per scan from the first scan on.

    Attributes
    ----------
    potential : (scans,) ndarray
        Potential tracks kept after the scan.
    started : (scans,) ndarray
        Potential tracks started.
    raw : (scans,) ndarray
        Raw confirmations, before any limit.
    """

    potential: FloatArray
    started: FloatArray
    raw: FloatArray


def overlap_area(distance: FloatArray, radius: FloatArray, disc: float) -> FloatArray:
    """Area of the part of a circle within a disc about the origin.

    Parameters
    ----------
    distance, radius : (...) ndarray
        Distance of the circle's centre from the origin, above 0, and the circle's radius, m.
    disc : float
        Radius of the disc, m, at least as large as any circle's.
    """
    crossing = distance + radius > disc
    at_circle = (distance**2 + radius**2 - disc**2) / (2.0 * distance * radius)
    at_disc = (distance**2 + disc**2 - radius**2) / (2.0 * distance * disc)
    kite = (
        (disc + radius - distance)
        * (distance + radius - disc)
        * (distance - radius + disc)
        * (distance + radius + disc)
    )
    lens = (
        radius**2 * np.arccos(np.clip(at_circle, -1.0, 1.0))
        + disc**2 * np.arccos(np.clip(at_disc, -1.0, 1.0))
        - 0.5 * np.sqrt(np.maximum(kite, 0.0))
    )
    return np.where(crossing, lens, np.pi * radius**2)


def error_radius(gating: ExpectedGating, ranges: FloatArray) -> FloatArray:
    """Part of the gate's radius due to the errors, ``alpha sigma_Rmax``, (r,), m."""
    sensor = gating.sensor
    covariance = measurement_covariance(
        ranges, np.zeros_like(ranges), sensor.range_variance(ranges), sensor.azimuth_std
    )
    return gate_factor(gating.gate_probability) * major_sigma(covariance)


def gate_areas(gating: ExpectedGating, ranges: FloatArray, window: int) -> FloatArray:
    """Areas a_k of the gates, k = 1 ... N, at each range, (r, N), m^2."""
    disc = gating.sensor.max_range
    reach = gating.max_speed * gating.interval * np.arange(1, window + 1)
    radius = reach + error_radius(gating, ranges)[:, None]
    return overlap_area(ranges[:, None], np.minimum(radius, disc), disc)


def expected(gating: ExpectedGating, min_hits: int, window: int, scans: int) -> Expected:
    """Follow the chain from an empty start.

    A sector has its share of the disc; the loss of gate area beyond its sides is neglected.

    Parameters
    ----------
    gating : ExpectedGating
    min_hits, window : int
        M and N.
    scans : int
        Number of scans.
    """
    sensor = gating.sensor
    edges = np.linspace(sensor.min_range, sensor.max_range, RINGS + 1)
    ring = 0.5 * sensor.sector_width * np.diff(np.square(edges))
    areas = gate_areas(gating, 0.5 * (edges[1:] + edges[:-1]), window)
    shape = (RINGS, window, min_hits - 1, window)  # ring, n - 1, h - 1, k - 1
    tracks, last_hits = np.zeros(shape), np.zeros(shape)
    counts = np.zeros((3, scans))
    density = sensor.clutter_density
    for scan in range(scans):
        tracks, last_hits, started, raw = _next_scan(tracks, last_hits, areas, density)
        counts[:, scan] = ring @ tracks.sum(axis=(1, 2, 3)), ring @ started, ring @ raw
    return Expected(*counts)


def _next_scan(
    tracks: FloatArray, last_hits: FloatArray, areas: FloatArray, density: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """F and G after one more scan, and the densities of starts and raw confirmations."""
    children = np.einsum("rnhk,rk->rnh", tracks, density * areas)
    covering = np.einsum("rnhk,rk->rnh", last_hits, areas)
    started = density * np.exp(-covering.sum(axis=(1, 2)))
    continued = density * _fewest_hits(covering)
    empty = np.exp(-density * areas)
    return (
        _next_states(tracks, empty, children, started),
        _next_states(last_hits, empty, continued, started),
        started,
        children[:, :, -1].sum(axis=1),
    )


def _next_states(
    old: FloatArray, empty: FloatArray, hit: FloatArray, started: FloatArray
) -> FloatArray:
    """States after a scan, from states with empty gates, states with hits and starts."""
    new = np.zeros_like(old)
    new[:, 1:, :, 1:] = old[:, :-1, :, :-1] * empty[:, None, None, :-1]
    new[:, 1:, 1:, 0] = hit[:, :-1, :-1]  # with M hits they are confirmed, not kept
    new[:, 0, 0, 0] = started
    new[:, -1] = 0.0  # N scans without M hits
    return new


def _fewest_hits(covering: FloatArray) -> FloatArray:
    """Probability that the covering path of fewest hits is in state (n, h), (r, n, h)."""
    by_hits = covering.sum(axis=1)
    fewer = np.cumsum(by_hits, axis=1) - by_hits
    probability = np.exp(-fewer) * -np.expm1(-by_hits)
    share = np.divide(
        covering,
        by_hits[:, None],
        out=np.zeros_like(covering),
        where=by_hits[:, None] > 0.0,
    )
    return share * probability[:, None]


def clutter_pass_share(gating: ExpectedGating, options: TsepmOptions) -> float:
    """Share of the raw confirmations from clutter that pass the method's evaluation (Step 6).

    The hits of a path are drawn uniformly in the gates. The scans of its hits have the weights
    ``prod a_k exp(-lambda a_j)`` of the gates k with a hit and the empty gates j between them.

    Parameters
    ----------
    gating : ExpectedGating
    options : TsepmOptions

    Returns
    -------
    float
        At least the share of MIN_PASSES passing paths.
    """
    rng = np.random.default_rng(1)
    ranges, scans = _drawn_paths(rng, gating.sensor, options)
    gaps = np.diff(scans, axis=1)
    areas = gate_areas(gating, ranges, options.window)
    taken = np.take_along_axis(areas, gaps - 1, axis=1)
    before = np.cumsum(areas, axis=1) - areas
    empty = np.take_along_axis(before, gaps - 1, axis=1)
    weight = (np.log(taken) - gating.sensor.clutter_density * empty).sum(axis=1)
    weight = np.exp(weight - weight.max())
    radius = gating.max_speed * gating.interval * gaps + error_radius(gating, ranges)[:, None]
    displacement = radius * np.sqrt(rng.random(radius.shape))
    heading = rng.uniform(-math.pi, math.pi, radius.shape)
    x = np.cumsum(np.column_stack([ranges, displacement * np.cos(heading)]), axis=1)
    y = np.cumsum(np.column_stack([np.zeros(PATHS), displacement * np.sin(heading)]), axis=1)
    passing = _passing(gating, options, scans, np.hypot(x, y), np.arctan2(y, x))
    effective_paths = weight.sum() ** 2 / np.square(weight).sum()
    return float(max(np.average(passing, weights=weight), MIN_PASSES / effective_paths))


def target_pass_share(gating: ExpectedGating, options: TsepmOptions, speed: float) -> float:
    """Share of a target's tracks, all hits its own, that pass the method's evaluation (Step 6).

    The tracks are of targets detected with p_d in each scan whose detections lie in the gates of
    the hits before, with M hits within N scans.

    Parameters
    ----------
    gating : ExpectedGating
    options : TsepmOptions
    speed : float
        Speed of the target, m/s.
    """
    rng = np.random.default_rng(2)
    sensor, shape = gating.sensor, (PATHS, options.window)
    ranges = np.sqrt(rng.uniform(sensor.min_range**2, sensor.max_range**2, PATHS))
    heading = rng.uniform(-math.pi, math.pi, (PATHS, 1))
    distance = speed * gating.interval * np.arange(options.window)
    x, y = ranges[:, None] + distance * np.cos(heading), distance * np.sin(heading)
    true_range = np.hypot(x, y)
    range_error = rng.standard_normal(shape) * np.sqrt(sensor.range_variance(true_range))
    range_ = np.abs(true_range + range_error)
    azimuth = np.arctan2(y, x) + rng.standard_normal(shape) * sensor.azimuth_std
    hit = rng.random(shape) < sensor.detection_probability
    hit[:, 0] = True
    _gate(hit, range_, azimuth, gating)
    count = np.cumsum(hit, axis=1)
    hit &= count <= options.min_hits
    reached = count[:, -1] >= options.min_hits
    if not reached.any():
        return 0.0
    scans = np.nonzero(hit[reached])[1].reshape(-1, options.min_hits)
    taken = [np.take_along_axis(part[reached], scans, axis=1) for part in (range_, azimuth)]
    return float(_passing(gating, options, scans, *taken).mean())


def _gate(hit: BoolArray, range_: FloatArray, azimuth: FloatArray, gating: ExpectedGating) -> None:
    """Remove, in place, the hits (n, N) outside the gate of the hit before (Eq. 4)."""
    x, y = range_ * np.cos(azimuth), range_ * np.sin(azimuth)
    rows = np.arange(len(hit))
    last = np.zeros(len(hit), np.int64)
    for scan in range(1, hit.shape[1]):
        distance = np.hypot(x[:, scan] - x[rows, last], y[:, scan] - y[rows, last])
        reach = gating.max_speed * gating.interval * (scan - last)
        hit[:, scan] &= distance <= reach + error_radius(gating, range_[rows, last])
        last[hit[:, scan]] = scan


def _drawn_paths(
    rng: np.random.Generator, sensor: SensorModel, options: TsepmOptions
) -> tuple[FloatArray, IntArray]:
    """First ranges (n,) over the coverage, and scans (n, M) of the hits, the first in scan 0."""
    ranges = np.sqrt(rng.uniform(sensor.min_range**2, sensor.max_range**2, PATHS))
    later = rng.permuted(np.tile(np.arange(1, options.window), (PATHS, 1)), axis=1)
    later = np.sort(later[:, : options.min_hits - 1], axis=1)
    return ranges, np.concatenate([np.zeros((PATHS, 1), np.int64), later], axis=1)


def _passing(
    gating: ExpectedGating,
    options: TsepmOptions,
    scans: IntArray,
    range_: FloatArray,
    azimuth: FloatArray,
) -> BoolArray:
    """Mask of the paths (n, M) of hits that pass the evaluation, (n,)."""
    sensor = gating.sensor
    flat = Scan(stamp=0.0, range=range_.ravel(), azimuth=azimuth.ravel())
    hits = convert_measurements(flat, sensor, 0).reshape(scans.shape)
    hits["time"] = scans * gating.interval
    if options.evaluation == "clutter_statistic":
        statistic = clutter_statistic(hits["position"], sensor.clutter_density)
        threshold = clutter_threshold(options.clutter_test_size, options.min_hits)
    else:
        stamp = options.window * gating.interval
        statistic = normalized_distance(hits, fit_states(hits, stamp, sensor, options.estimator))
        threshold = distance_threshold(options.pruning_probability, options.pruning_reading)
    return statistic <= threshold
