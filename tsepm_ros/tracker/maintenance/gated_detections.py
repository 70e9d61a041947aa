"""Detections in the gates of confirmed tracks.

Detections in the gates of held tracks, and their likelihoods: a row for each pair.

A held track has a filter with two modes of motion, and a straight fit (see `stationary`). Each of
the two seeks its own detections, at its own place. All is computed for the modes of both together:
the filter's two, then the fit as a third.

Detections of a scan that are, or may be, held tracks'.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from tsepm_ros.numerics.arrays import FloatArray, IntArray, taken
from tsepm_ros.numerics.discs import squared_distances
from tsepm_ros.tracker import motion, range_rates
from tsepm_ros.tracker.measurement import covariance_at, major_sigma
from tsepm_ros.tracker.sensor import SensorModel

GATE_PROBABILITY = 0.99
"""P_G, probability that the gate holds a target's detection."""
GATE_MARGIN = 1.5
"""The error at the predicted position may be this much larger than the largest of the scan."""
SEARCH_MARGIN = 1.1
"""Factor on the search radius for detections: the gate itself is tested later."""
MAX_PAIRS = 8000
"""Places of tracks times detections up to which every distance is taken."""
MAX_NEIGHBOURS = 8
"""Detections considered for each track: the nearest."""
FILTER_MODES = 2
"""Modes of the filter."""
_SEEKER = np.array([0] * FILTER_MODES + [1])
"""Which of the two, filter or fit, each mode is of."""


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
    """How well detections fit the tracks in each mode: q pairs of a mode's track and a detection.

    The pairs of the filter come first, once for each of its modes, then those of the fit.

    Attributes
    ----------
    filter, fit : Neighbours
        Pairs of both.
    owner : (q,) ndarray of int
        Mode and track of each pair, as a place among the 3 n.
    innovation : (q, 2) ndarray
        z - H x, m.
    likelihood : (q,) ndarray
        N(z; H x, S), 1/m^2, times that of a range rate, s/m; 0 outside the gate. S is the track's,
        or where `updated` is given the pair's own.
    time_after_scan : (3, n) ndarray
        Time after the scan's stamp of the tracks' nearest detections, s.
    innovation_covariance : (3, n, 2, 2) ndarray
        S of each track, with the error of its nearest detection, m^2.
    updated : tuple of (q, 4) and (q, 4, 4) ndarray, or None
        State and covariance of each pair's track if the detection is its target's; None where no
        detection has a range rate: then the innovations suffice.
    """

    filter: Neighbours
    fit: Neighbours
    owner: IntArray
    innovation: FloatArray
    likelihood: FloatArray
    time_after_scan: FloatArray
    innovation_covariance: FloatArray
    updated: tuple[FloatArray, FloatArray] | None

    @property
    def of_filter(self) -> FloatArray:
        """The likelihoods in each mode of the filter, (2, p)."""
        return self.likelihood[: FILTER_MODES * len(self.filter.row)].reshape(FILTER_MODES, -1)

    @property
    def of_fit(self) -> FloatArray:
        """The likelihoods under the fit, (1, p)."""
        return self.likelihood[None, FILTER_MODES * len(self.filter.row) :]


def gate(
    state: FloatArray,
    covariance: FloatArray,
    mean: FloatArray,
    stamp: float,
    detections: NDArray[np.void],
    sensor: SensorModel,
) -> GatedDetections:
    """Pairs of tracks and detections, and how well they fit in each mode.

    Each detection is compared at its own time. One innovation covariance serves all detections of
    a track, ``S = H P H' + R`` at the time and with the error of the nearest (n,). In a scan with
    range rates each pair has its own: the update by its position must leave a proper covariance,
    against which the range rate is compared.

    Parameters
    ----------
    state, covariance : (3, n, 4), (3, n, 4, 4) ndarray
        The modes, predicted to the stamp.
    mean : (2, n, 4) ndarray
        Means of the filter over its modes, and of the fit.
    stamp : float
        The scan's, s.
    detections : (d,) ndarray of DETECTION
    sensor : SensorModel
    """
    n = len(mean[0])
    if not len(detections):
        none = Neighbours(*np.zeros((3, 0), np.int64))
        return GatedDetections(
            none,
            none,
            np.zeros(0, np.int64),
            np.zeros((0, 2)),
            np.zeros(0),
            np.zeros(state.shape[:2]),
            covariance[..., 0::2, 0::2],
            None,
        )
    of_filter, of_fit = _neighbours(state, covariance, mean, stamp, detections)
    pairs = FILTER_MODES * [of_filter] + [of_fit]
    owner = np.concatenate([mode * n + part.track for mode, part in enumerate(pairs)])
    row = np.concatenate([part.row for part in pairs])
    nearest = taken(detections, np.stack([part.nearest for part in pairs]))
    time_after_scan, pair_time = nearest["time"] - stamp, detections["time"][row] - stamp
    innovation_covariance = motion.position_covariance_after(covariance, time_after_scan)
    innovation_covariance += covariance_at(
        nearest, motion.position_after(state, time_after_scan), sensor
    )
    states, covariances = state.reshape(-1, 4), covariance.reshape(-1, 4, 4)
    updated = None
    if not range_rates.measured(detections).any():
        expected = motion.position_after(states.take(owner, axis=0), pair_time)
        innovation = detections["position"][row] - expected
        of_pairs = innovation_covariance.reshape(-1, 2, 2).take(owner, axis=0)
        density = motion.position_log_likelihood(innovation, of_pairs, GATE_PROBABILITY)
    else:
        candidates = taken(detections, row)
        innovation, of_pairs = motion.innovations(
            states[owner], covariances[owner], pair_time, candidates, sensor
        )
        density = motion.log_likelihood(
            states,
            covariances,
            owner,
            pair_time,
            innovation,
            of_pairs,
            candidates,
            GATE_PROBABILITY,
        )
        updated = range_rates.update(
            *motion.update(states[owner], covariances[owner], pair_time, innovation, of_pairs),
            pair_time,
            candidates,
        )
    return GatedDetections(
        of_filter,
        of_fit,
        owner,
        innovation,
        np.exp(density),
        time_after_scan,
        innovation_covariance,
        updated,
    )


def _neighbours(
    state: FloatArray,
    covariance: FloatArray,
    mean: FloatArray,
    stamp: float,
    detections: NDArray[np.void],
) -> tuple[Neighbours, Neighbours]:
    """The detections nearest to each filter and fit, as far as the gate of any mode reaches.

    Arguments as in `gate`.
    """
    time_after_scan = detections["time"] - stamp
    first, last = time_after_scan.min(), time_after_scan.max()
    middle = 0.5 * (first + last)
    error = GATE_MARGIN * detections["major_sigma"].max()
    centre = motion.position_after(mean, middle)
    gate = motion.gate_reach(GATE_PROBABILITY, detections)
    position_covariance = motion.position_covariance_after(covariance, np.array(middle))
    sigma = np.hypot(major_sigma(position_covariance), error)
    offset = motion.position_after(state, middle) - centre[_SEEKER]
    radius = SEARCH_MARGIN * gate * sigma + np.hypot(offset[..., 0], offset[..., 1])
    if last > first:
        speed = np.hypot(state[..., 1], state[..., 3])
        radius += speed * (last - first)
    reach = np.concatenate([radius[:FILTER_MODES].max(axis=0), radius[FILTER_MODES]])
    nearest, seeker, row = _within(reach, detections["position"], centre.reshape(-1, 2))
    n = len(nearest) // 2
    border = int(np.searchsorted(seeker, n))
    return (
        Neighbours(nearest[:n], seeker[:border], row[:border]),
        Neighbours(nearest[n:], seeker[border:] - n, row[border:]),
    )


def _within(
    reach: FloatArray, positions: FloatArray, centres: FloatArray
) -> tuple[IntArray, IntArray, IntArray]:
    """The position nearest to each centre, and the pairs of centres and positions in their reach.

    Of each centre the nearest `MAX_NEIGHBOURS` at most, ascending.
    """
    if len(centres) * len(positions) > MAX_PAIRS:
        number = min(MAX_NEIGHBOURS, len(positions))
        distance, near = cKDTree(positions).query(centres, k=range(1, number + 1))
        centre, place = np.nonzero(distance <= reach[:, None])
        return near[:, 0], centre, near[centre, place]
    distance = np.sqrt(squared_distances(centres, positions))
    centre, row = (distance <= reach[:, None]).nonzero()
    order = np.lexsort((distance[centre, row], centre))
    centre, row = centre[order], row[order]
    if len(positions) > MAX_NEIGHBOURS:
        place = np.arange(len(centre)) - np.searchsorted(centre, centre)
        if place.max(initial=0) >= MAX_NEIGHBOURS:
            centre, row = centre[place < MAX_NEIGHBOURS], row[place < MAX_NEIGHBOURS]
    return distance.argmin(axis=1), centre, row


class HeldAssociation(NamedTuple):
    """Detections of a scan that may be held tracks'.

    Attributes
    ----------
    row : (p,) ndarray of int
        Detection of each pair.
    probability : (p,) ndarray
        That the track's target exists and the detection is its: ``r_i beta_ij``.
    """

    row: IntArray
    probability: FloatArray

    def joined(self, further: FloatArray, clutter: FloatArray) -> HeldAssociation:
        """With detections that tracks may have beside their own.

        Parameters
        ----------
        further, clutter : (d,) ndarray
            Density of these, and of clutter, at each detection, 1/m^2.
        """
        rows = np.flatnonzero(further)
        share = further[rows] / (further[rows] + clutter[rows])
        return HeldAssociation(np.append(self.row, rows), np.append(self.probability, share))


class OwnDetections(NamedTuple):
    """Detections of a scan that are held tracks', with more than some probability.

    Attributes
    ----------
    track_id, row : (k,) ndarray of int
        Id of the track, and detection.
    """

    track_id: IntArray
    row: IntArray


NO_OWN_DETECTIONS = OwnDetections(np.zeros(0, np.int64), np.zeros(0, np.int64))
NO_ASSOCIATION = HeldAssociation(np.zeros(0, np.int64), np.zeros(0))
