"""Confirmed tracks held: carried forward, taking the detections that are theirs.

Integrated probabilistic data association (Musicki, Evans, Stankovic, "Integrated probabilistic data
association", IEEE Trans. Autom. Control 39(6), 1994): each track has a probability that its target
exists, which falls with every miss, and is updated by the mean of its detections, each weighted by
the probability that it is the target's.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from tsepm_ros import filtering
from tsepm_ros.conversion import covariance_at, major_sigma
from tsepm_ros.sensor import SensorModel
from tsepm_ros.splitting import gate_factor
from tsepm_ros.track import TrackArrays

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

GATE_PROBABILITY = 0.99
PROCESS_NOISE = 0.01
"""Spectral density of a held target's acceleration, m^2/s^3: 1 m/s per 100 s."""
LEAST_EXISTENCE = 0.05
"""Probability of existence below which a track is held no longer."""
MAX_NEIGHBOURS = 8
"""Detections that a track weighs, the nearest."""


class TrackHold:
    """Holds confirmed tracks for a while after their last detection.

    Parameters
    ----------
    hold_time : float
        Time, s, for which a track is held without a detection of its own; it ends at the first scan
        after that.
    """

    def __init__(self, hold_time: float) -> None:
        self.hold_time = hold_time
        self._forget()

    def _forget(self) -> None:
        self._tracks = TrackArrays.of([])
        self._existence = np.zeros(0)
        self._last_taken = np.zeros(0)
        self._ended: list[int] = []

    def step(
        self,
        stamp: float,
        detections: NDArray[np.void],
        clutter: FloatArray,
        detectable: Callable[[FloatArray], FloatArray],
        sensor: SensorModel,
    ) -> FloatArray:
        """Carry the tracks to a scan and let them take its detections.

        With ``L_ij = P_D N(z_j; H x_i, S_i) / lambda_j`` of the detections in track i's gate::

            delta_i = P_D P_G - sum_j L_ij,    r_i <- (1 - delta_i) r_i / (1 - delta_i r_i)
            beta_ij = L_ij / (1 - delta_i)

        Parameters
        ----------
        stamp : float
            The scan's, s.
        detections : (d,) ndarray of DETECTION
        clutter : (d,) ndarray
            Clutter density lambda at each detection, 1/m^2.
        detectable : callable
            P_D of targets at positions (n, 2).
        sensor : SensorModel

        Returns
        -------
        (d,) ndarray
            Density with which the held targets explain each detection,
            ``sum_i r_i P_D N(z_j; H x_i, S_i)``, 1/m^2.
        """
        self._carry(stamp)
        explained = np.zeros(len(detections))
        if len(self._tracks):
            expected = self._tracks.state[:, 0::2]
            explained = self._take(stamp, detections, clutter, detectable(expected), sensor)
        self._end(stamp)
        return explained

    def add(self, tracks: TrackArrays, existence: float) -> None:
        """Hold newly confirmed tracks whose targets exist with a probability."""
        if not len(tracks):
            return
        self._tracks = self._tracks.joined(tracks)
        self._existence = np.concatenate([self._existence, np.full(len(tracks), existence)])
        self._last_taken = np.concatenate([self._last_taken, tracks.stamp])

    @property
    def current(self) -> TrackArrays:
        """Every track held, at the last scan's stamp."""
        return self._tracks

    def take_ended(self) -> list[int]:
        """Ids of the tracks that have ended since this was last asked."""
        ended, self._ended = self._ended, []
        return ended

    def clear(self) -> None:
        """End every track."""
        ended = self._ended + self._tracks.track_id.tolist()
        self._forget()
        self._ended = ended

    def _carry(self, stamp: float) -> None:
        tracks = self._tracks
        step = stamp - tracks.stamp
        state, covariance = filtering.predict(tracks.state, tracks.covariance, step, PROCESS_NOISE)
        self._tracks = replace(
            tracks,
            stamp=np.full(len(tracks), stamp),
            state=state,
            covariance=covariance,
            age=tracks.age + step,
        )

    def _take(
        self,
        stamp: float,
        detections: NDArray[np.void],
        clutter: FloatArray,
        detectable: FloatArray,
        sensor: SensorModel,
    ) -> FloatArray:
        state, covariance = self._tracks.state, self._tracks.covariance
        n = len(state)
        explained = np.zeros(len(detections))
        ratio_sum = np.zeros(n)
        if len(detections):
            nearest, owner, row = _neighbours(state, covariance, detections)
            lag = detections["time"][nearest] - stamp
            expected = state[:, 0::2] + lag[:, None] * state[:, 1::2]
            spread = filtering.position_covariance_after(covariance, lag)
            spread += covariance_at(detections[nearest], expected, sensor)
            # Each detection at its own time; their covariance is that at the nearest one's.
            own_lag = (detections["time"][row] - stamp)[:, None]
            innovation = detections["position"][row] - state[owner, 0::2]
            innovation -= own_lag * state[owner, 1::2]
            density, distance = filtering.log_density(innovation, spread[owner])
            inside = distance <= gate_factor(GATE_PROBABILITY) ** 2
            owner, row, innovation = owner[inside], row[inside], innovation[inside]
            likelihood = detectable[owner] * np.exp(density[inside])
            np.add.at(explained, row, self._existence[owner] * likelihood)
            ratio = likelihood / clutter[row]
            np.add.at(ratio_sum, owner, ratio)
        gain = 1.0 - detectable * GATE_PROBABILITY + ratio_sum  # 1 - delta
        self._existence = gain * self._existence / (1.0 - (1.0 - gain) * self._existence)
        if len(detections):
            state, covariance = _mixed(
                state, covariance, lag, spread, owner, innovation, ratio / gain[owner]
            )
            self._tracks = replace(self._tracks, state=state, covariance=covariance)
        taken = ratio_sum >= 0.5 * gain
        self._last_taken = np.where(taken, stamp, self._last_taken)
        return explained

    def _end(self, stamp: float) -> None:
        held = (self._last_taken >= stamp - self.hold_time) & (self._existence >= LEAST_EXISTENCE)
        if held.all():
            return
        self._ended += self._tracks.track_id[~held].tolist()
        self._tracks = self._tracks.where(held)
        self._existence, self._last_taken = self._existence[held], self._last_taken[held]


def _neighbours(
    state: FloatArray, covariance: FloatArray, detections: NDArray[np.void]
) -> tuple[IntArray, IntArray, IntArray]:
    """The nearest detection of each track, and pairs of tracks and detections near them."""
    spread = major_sigma(covariance[:, 0::2, 0::2]) ** 2 + detections["major_sigma"].max() ** 2
    reach = 1.5 * gate_factor(GATE_PROBABILITY) * np.sqrt(spread)
    count = min(MAX_NEIGHBOURS, len(detections))
    distance, row = cKDTree(detections["position"]).query(state[:, 0::2], k=range(1, count + 1))
    owner, place = np.nonzero(distance <= reach[:, None])
    return row[:, 0], owner, row[owner, place]


def _mixed(
    state: FloatArray,
    covariance: FloatArray,
    lag: FloatArray,
    spread: FloatArray,
    owner: IntArray,
    innovation: FloatArray,
    weight: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Mean and covariance of each track over which detection, if any, is the target's.

    ``x + K v``, ``P - (1 - beta_0) K S K' + K (sum_j beta_j v_j v_j' - v v') K'`` with
    ``v = sum_j beta_j v_j``.
    """
    n = len(state)
    some = np.zeros(n)
    np.add.at(some, owner, weight)
    mean = np.zeros((n, 2))
    np.add.at(mean, owner, weight[:, None] * innovation)
    square = np.zeros((n, 2, 2))
    outer = innovation[:, :, None] * innovation[:, None, :]
    np.add.at(square, owner, weight[:, None, None] * outer)
    gain = filtering.gain(covariance, lag, spread)
    change = square - mean[:, :, None] * mean[:, None, :] - some[:, None, None] * spread
    return (
        state + (gain @ mean[..., None])[..., 0],
        covariance + gain @ change @ np.swapaxes(gain, 1, 2),
    )
