"""Judgement of confirmed tracks by known truth.

A confirmed track belongs to a target that gave more than half of its hits. Each confirmed track of
a run has one outcome: *true* (the first track of a target within 3 sigma of it, sigma being the
larger axis of the measurement error there), *redundant* (a later track within 3 sigma of the
target), *misplaced* (a track farther from its target), *false* (a track without a target). Apart
from its hits, a track is *at* each target that is within 3 sigma of it.
"""

from __future__ import annotations

import enum
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.kinematics.track import ConfirmedTrack
from tsepm_ros.numerics.arrays import FloatArray, IntArray
from tsepm_ros.sensing.conversion import major_sigma, position_covariance
from tsepm_ros.sensing.sensor import SensorModel

NO_TARGET = -1
SIGMAS = 3.0


class Outcome(enum.Enum):
    """Outcome of a confirmed track."""

    TRUE = "true"
    REDUNDANT = "redundant"
    MISPLACED = "misplaced"
    FALSE = "false"


@dataclass(frozen=True, eq=False)
class Judged:
    """A confirmed track with its outcome and errors.

    Attributes
    ----------
    track : ConfirmedTrack
    outcome : Outcome
    target : int
        Index of the target that gave more than half of the hits, or NO_TARGET.
    pure : bool
        All hits come from that target.
    position_error, velocity_error : float
        Distance from that target's state, m and m/s; nan without a target.
    nees : float
        Normalised estimation error squared, ideally 4 on average; nan without a target.
    at : frozenset of int
        Targets within 3 sigma of the track at its stamp, whatever its hits.
    """

    track: ConfirmedTrack
    outcome: Outcome
    target: int
    pure: bool
    position_error: float
    velocity_error: float
    nees: float
    at: frozenset[int] = frozenset()


def measurement_sigma(sensor: SensorModel, offset: FloatArray) -> float:
    """Larger axis of the measurement error, m, for a target at `offset` (2,) from the sensor."""
    range_ = float(np.hypot(*offset))
    covariance = position_covariance(
        range_, np.arctan2(offset[1], offset[0]), sensor.range_variance(range_), sensor.azimuth_std
    )
    return float(major_sigma(covariance))


def nees(error: FloatArray, covariance: FloatArray) -> float:
    """Normalised estimation error squared, ``e' P^-1 e``."""
    return float(error @ np.linalg.solve(covariance, error))


def judge(
    tracks: Sequence[ConfirmedTrack],
    origins: Sequence[NDArray[np.int64]],
    truth_at: Callable[[float], FloatArray],
    sensor: SensorModel,
    sensor_position_at: Callable[[float], FloatArray],
) -> list[Judged]:
    """Judge the confirmed tracks of one run.

    Parameters
    ----------
    tracks : sequence of ConfirmedTrack
        In the order of confirmation.
    origins : sequence of (n,) ndarray of int
        Per scan, the target index of each detection, negative for clutter.
    truth_at : callable
        States (k, 4) of all targets at a stamp, s.
    sensor : SensorModel
        Measurement errors.
    sensor_position_at : callable
        Sensor position (2,) at a stamp, s.

    Returns
    -------
    list of Judged
        In the order of the tracks.
    """
    started: set[int] = set()
    judged = []
    for track in tracks:
        sources = np.array([origins[scan][index] for scan, index in track.hits])
        target = _majority(sources)
        truths, sensor_position = truth_at(track.stamp), sensor_position_at(track.stamp)
        at = frozenset(
            index
            for index, truth in enumerate(truths)
            if _distance(track, truth) <= SIGMAS * _sigma_at(truth, sensor, sensor_position)
        )
        if target == NO_TARGET:
            judged.append(Judged(track, Outcome.FALSE, target, False, np.nan, np.nan, np.nan, at))
            continue
        error = track.state - truths[target]
        outcome = Outcome.MISPLACED
        if target in at:
            outcome = Outcome.REDUNDANT if target in started else Outcome.TRUE
            started.add(target)
        judged.append(
            Judged(
                track,
                outcome,
                target,
                bool((sources == target).all()),
                _distance(track, truths[target]),
                float(np.hypot(error[1], error[3])),
                nees(error, track.covariance),
                at,
            )
        )
    return judged


def origins_of(
    processed: Sequence[float], stamps: Sequence[float], origins: Sequence[IntArray]
) -> list[IntArray]:
    """Origins of the processed scans, to which hits refer; dropped scans have none.

    Parameters
    ----------
    processed : sequence of float
        Stamps of the scans that were processed, s.
    stamps : sequence of float
        Stamps of all scans, s, ascending. The nearest stamp counts, since clocks round.
    origins : sequence of (n,) ndarray of int
        Origins of all scans.
    """
    middle = 0.5 * (np.array(stamps[1:]) + np.array(stamps[:-1]))
    return [origins[index] for index in np.searchsorted(middle, processed)]


def _distance(track: ConfirmedTrack, truth: FloatArray) -> float:
    """Distance of a track from a target's state, m."""
    error = track.state - truth
    return float(np.hypot(error[0], error[2]))


def _sigma_at(truth: FloatArray, sensor: SensorModel, sensor_position: FloatArray) -> float:
    return measurement_sigma(sensor, truth[0::2] - sensor_position)


def _majority(sources: NDArray[np.int64]) -> int:
    """The target that gave more than half of the hits, or NO_TARGET."""
    targets, counts = np.unique(sources[sources >= 0], return_counts=True)
    if len(targets) and 2 * counts.max() > len(sources):
        return int(targets[counts.argmax()])
    return NO_TARGET
