"""Detections in the gates of held tracks, and their likelihoods: a row for each pair."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from tsepm_ros.kinematics import kalman
from tsepm_ros.kinematics.interacting_models import InteractingModels
from tsepm_ros.numerics.arrays import FloatArray, IntArray
from tsepm_ros.sensing import range_rates
from tsepm_ros.sensing.conversion import covariance_at, major_sigma
from tsepm_ros.sensing.sensor import SensorModel

GATE_PROBABILITY = 0.99
"""P_G, probability that the gate holds a target's detection."""
GATE_MARGIN = 1.5
"""The error at the predicted position may be this much larger than the largest of the scan."""
SEARCH_MARGIN = 1.1
"""Factor on the search radius for detections: the gate itself is tested later."""
MAX_PAIRS = 4000
"""Tracks times detections up to which every distance is taken."""
MAX_NEIGHBOURS = 8
"""Detections considered for each track: the nearest."""


@dataclass(frozen=True)
class Neighbours:
    """Pairs of tracks and detections that may be theirs.

    Attributes
    ----------
    nearest : (n,) ndarray of int
        Detection nearest to each track; empty where there is no detection.
    track, row : (p,) ndarray of int
        Track and detection of each pair.
    """

    nearest: IntArray
    track: IntArray
    row: IntArray


@dataclass(frozen=True)
class GatedDetections:
    """How well detections fit the tracks in each of m modes of motion; pairs as in `Neighbours`.

    Attributes
    ----------
    innovation : (m, p, 2) ndarray
        z - H x, m.
    likelihood : (m, p) ndarray
        N(z; H x, S), 1/m^2, times that of a range rate, s/m; 0 outside the gate.
    time_after_scan : (n,) ndarray
        Time after the scan's stamp of the tracks' nearest detections, s.
    innovation_covariance : (m, n, 2, 2) ndarray
        S of each track, with the error of its nearest detection, m^2.
    updated : tuple of (m, p, 4) and (m, p, 4, 4) ndarray, or None
        State and covariance of each pair's track if the detection is its target's; None where no
        detection has a range rate: then the innovations suffice.
    """

    innovation: FloatArray
    likelihood: FloatArray
    time_after_scan: FloatArray
    innovation_covariance: FloatArray
    updated: tuple[FloatArray, FloatArray] | None = None


def gate(
    models: InteractingModels,
    state: FloatArray,
    stamp: float,
    detections: NDArray[np.void],
    sensor: SensorModel,
) -> tuple[Neighbours, GatedDetections]:
    """Pairs of tracks and detections, and how well they fit in each mode.

    Parameters
    ----------
    models : InteractingModels
        Predicted to the stamp.
    state : (n, 4) ndarray
        Their means over the modes.
    stamp : float
        The scan's, s.
    detections : (d,) ndarray of DETECTION
    sensor : SensorModel
    """
    near = neighbours(models, state, stamp, detections)
    nearest, candidates = detections[near.nearest], detections[near.row]
    return near, _gated(
        models.state, models.covariance, near.track, nearest, candidates, stamp, sensor
    )


def neighbours(
    models: InteractingModels, state: FloatArray, stamp: float, detections: NDArray[np.void]
) -> Neighbours:
    """The detections nearest to each predicted track, as far as the gate of any mode reaches.

    Arguments as in `gate`.
    """
    if not len(detections) or not len(state):
        return Neighbours(*np.zeros((3, 0), np.int64))
    time_after_scan = detections["time"] - stamp
    first, last = time_after_scan.min(), time_after_scan.max()
    middle = 0.5 * (first + last)
    error = GATE_MARGIN * detections["major_sigma"].max()
    centre = kalman.position_after(state, middle)
    gate = kalman.gate_reach(GATE_PROBABILITY, detections)
    position_covariance = kalman.position_covariance_after(models.covariance, np.array(middle))
    sigma = np.hypot(major_sigma(position_covariance), error)
    offset = kalman.position_after(models.state, middle) - centre
    radius = SEARCH_MARGIN * gate * sigma + np.hypot(offset[..., 0], offset[..., 1])
    if last > first:
        speed = np.hypot(models.state[..., 1], models.state[..., 3])
        radius += speed * (last - first)
    reach = radius.max(axis=0)
    distance, near = _nearest(detections["position"], centre)
    track, place = np.nonzero(distance <= reach[:, None])
    return Neighbours(near[:, 0], track, near[track, place])


def _nearest(positions: FloatArray, centres: FloatArray) -> tuple[FloatArray, IntArray]:
    """Distances and rows of the positions (d, 2) nearest to each centre (n, 2), ascending."""
    number = min(MAX_NEIGHBOURS, len(positions))
    if len(centres) * len(positions) > MAX_PAIRS:
        distance, near = cKDTree(positions).query(centres, k=range(1, number + 1))
        return distance, near
    apart = centres[:, None] - positions
    distance = np.sqrt((apart * apart).sum(axis=2))
    near = np.argsort(distance, axis=1, kind="stable")[:, :number]
    return np.take_along_axis(distance, near, axis=1), near


def _gated(
    state: FloatArray,
    covariance: FloatArray,
    track: IntArray,
    nearest: NDArray[np.void],
    candidates: NDArray[np.void],
    stamp: float,
    sensor: SensorModel,
) -> GatedDetections:
    """How well the candidates (p,) fit the predicted tracks (m, n) in each mode.

    Each detection is compared at its own time. One innovation covariance serves all detections of
    a track, ``S = H P H' + R`` at the time and with the error of the nearest (n,).
    """
    m, n = state.shape[:2]
    if not len(nearest):
        return GatedDetections(
            np.zeros((m, 0, 2)), np.zeros((m, 0)), np.zeros(n), covariance[..., 0::2, 0::2]
        )
    time_after_scan, pair_time = nearest["time"] - stamp, candidates["time"] - stamp
    innovation_covariance = kalman.position_covariance_after(covariance, time_after_scan)
    innovation_covariance += covariance_at(
        nearest, kalman.position_after(state, time_after_scan), sensor
    )
    innovation = candidates["position"] - kalman.position_after(state[:, track], pair_time)
    of_pairs = innovation_covariance[:, track]
    # A mode after the other, as if each were tracks of its own.
    every = candidates if m == 1 else np.concatenate([candidates] * m)
    times = every["time"] - stamp
    density = kalman.log_likelihood(
        state.reshape(-1, 4),
        covariance.reshape(-1, 4, 4),
        (n * np.arange(m)[:, None] + track).ravel(),
        times,
        innovation.reshape(-1, 2),
        of_pairs.reshape(-1, 2, 2),
        every,
        GATE_PROBABILITY,
    )
    updated = None
    if range_rates.measured(candidates).any():
        moved, spread = kalman.update(
            state[:, track], covariance[:, track], pair_time, innovation, of_pairs
        )
        moved, spread = range_rates.update(
            moved.reshape(-1, 4), spread.reshape(-1, 4, 4), times, every
        )
        updated = moved.reshape(m, -1, 4), spread.reshape(m, -1, 4, 4)
    return GatedDetections(
        innovation,
        np.exp(density).reshape(m, -1),
        time_after_scan,
        innovation_covariance,
        updated,
    )
