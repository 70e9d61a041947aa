"""Shares of an M/N rule's confirmations, from targets and from clutter, that pass evaluation."""

from __future__ import annotations

import math

import numpy as np

from tsepm_ros.design.expected_counts import Gating, error_radius, gate_areas
from tsepm_ros.methods.tsepm.tsepm_options import TsepmOptions
from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from tsepm_ros.sensing.conversion import convert
from tsepm_ros.sensing.scan import Scan
from tsepm_ros.sensing.sensor import SensorModel
from tsepm_ros.stages import pruning
from tsepm_ros.stages.estimation import fit
from tsepm_ros.stages.evaluation import clutter_statistic, normalized_distance

PATHS = 10_000
MIN_PASSES = 3.0
"""Minimum number of passing paths for a share; with fewer, the share of this number counts."""


def clutter_pass_share(gating: Gating, options: TsepmOptions) -> float:
    """Share of the raw confirmations from clutter that pass the method's evaluation (Step 6).

    The hits of a path are drawn uniformly in the gates. The scans of its hits have the weights
    ``prod a_k exp(-lambda a_j)`` of the gates k with a hit and the empty gates j between them.

    Parameters
    ----------
    gating : Gating
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


def target_pass_share(gating: Gating, options: TsepmOptions, speed: float) -> float:
    """Share of a target's tracks, all hits its own, that pass the method's evaluation (Step 6).

    The tracks are of targets detected with p_d in each scan whose detections lie in the gates of
    the hits before, with M hits within N scans.

    Parameters
    ----------
    gating : Gating
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


def _gate(hit: BoolArray, range_: FloatArray, azimuth: FloatArray, gating: Gating) -> None:
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
    gating: Gating,
    options: TsepmOptions,
    scans: IntArray,
    range_: FloatArray,
    azimuth: FloatArray,
) -> BoolArray:
    """Mask of the paths (n, M) of hits that pass the evaluation, (n,)."""
    sensor = gating.sensor
    flat = Scan(stamp=0.0, range=range_.ravel(), azimuth=azimuth.ravel())
    hits = convert(flat, sensor, 0).reshape(scans.shape)
    hits["time"] = scans * gating.interval
    if options.evaluation == "clutter_statistic":
        statistic = clutter_statistic(hits["position"], sensor.clutter_density)
        threshold = pruning.clutter_threshold(options.clutter_test_size, options.min_hits)
    else:
        stamp = options.window * gating.interval
        statistic = normalized_distance(hits, fit(hits, stamp, sensor, options.estimator))
        threshold = pruning.distance_threshold(options.pruning_probability, options.pruning_reading)
    return pruning.keep(statistic, threshold)
