"""Confirmed tracks held: carried forward, taking the detections that are theirs.

Integrated probabilistic data association (Musicki, Evans, Stankovic, "Integrated probabilistic data
association", IEEE Trans. Autom. Control 39(6), 1994): each track has a probability that its target
exists, which falls with every miss, and is updated by the mean of its detections, each weighted by
the probability that it is the target's. Over a scan a target goes on as it was or has turned, and
both are weighed by what the detections say of them (a generalised pseudo-Bayesian estimator of
first order: Bar-Shalom, Li, Kirubarajan, "Estimation with Applications to Tracking and
Navigation", 2001, section 11.6.4).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

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
GATE_MARGIN = 1.5
"""The error at the predicted position may be this much larger than the largest of the scan."""
PROCESS_NOISE = 0.01
"""Spectral density of a target's acceleration while it goes on, m^2/s^3: 1 m/s per 100 s."""
TIME_TO_TURN = 100.0
"""Mean time after which a target turns or changes its speed, s."""
LEAST_EXISTENCE = 0.001
"""Probability of existence below which a track is held no longer."""
MAX_NEIGHBOURS = 8
"""Detections that a track weighs, the nearest."""


@dataclass(frozen=True)
class Model:
    """How a target may move over a scan.

    Attributes
    ----------
    probability : float
        Of the model.
    state, covariance : (n, 4), (n, 4, 4) ndarray
        Predicted under it.
    """

    probability: float
    state: FloatArray
    covariance: FloatArray


@dataclass(frozen=True)
class Association:
    """Detections in the gates of the tracks, under one model.

    Attributes
    ----------
    owner, row : (p,) ndarray of int
        Track and detection of each pair.
    innovation : (p, 2) ndarray
        m.
    likelihood : (p,) ndarray
        P_D N(z; H x, S), 1/m^2.
    lag : (n,) ndarray
        Time after the scan's stamp of the tracks' nearest detections, s.
    spread : (n, 2, 2) ndarray
        S of each track, with the error of its nearest detection.
    """

    owner: IntArray
    row: IntArray
    innovation: FloatArray
    likelihood: FloatArray
    lag: FloatArray
    spread: FloatArray


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
        max_speed: float,
    ) -> FloatArray:
        """Carry the tracks to a scan and let them take its detections.

        With ``L_ij = P_D N(z_j; H x_i, S_i) / lambda_j`` of the detections in track i's gate::

            delta_i = P_D P_G - sum_j L_ij,    r_i <- (1 - delta_i) r_i / (1 - delta_i r_i)
            beta_ij = L_ij / (1 - delta_i)

        and over the models of motion, of probabilities mu_m,
        ``1 - delta = sum_m mu_m (1 - delta_m)`` and ``mu_m <- mu_m (1 - delta_m) / (1 - delta)``.

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
        max_speed : float
            v_max, m/s: the velocity after a turn is unknown up to it.

        Returns
        -------
        (d,) ndarray
            Density with which the held targets explain each detection,
            ``sum_i r_i P_D N(z_j; H x_i, S_i)``, 1/m^2.
        """
        explained = np.zeros(len(detections))
        if not len(self._tracks):
            return explained
        models = self._predicted(stamp, max_speed)
        probability = detectable(models[0].state[:, 0::2])
        gains, states, covariances, taken = [], [], [], np.zeros(len(self._tracks))
        for model in models:
            found = _associated(model, stamp, detections, probability, sensor)
            np.add.at(
                explained,
                found.row,
                model.probability * self._existence[found.owner] * found.likelihood,
            )
            ratio = found.likelihood / clutter[found.row]
            gain = 1.0 - probability * GATE_PROBABILITY  # 1 - delta
            missed = gain.copy()
            np.add.at(gain, found.owner, ratio)
            state, covariance = _mixed(model, found, ratio / gain[found.owner])
            gains.append(model.probability * gain)
            states.append(state)
            covariances.append(covariance)
            taken += model.probability * (gain - missed)
        self._update(stamp, np.array(gains), np.array(states), np.array(covariances), taken)
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

    def _predicted(self, stamp: float, max_speed: float) -> tuple[Model, Model]:
        """The tracks at a stamp, had they gone on and had they turned at some time since."""
        state, covariance = self._tracks.state, self._tracks.covariance
        step = stamp - self._tracks.stamp
        turned = float(-np.expm1(-step[0] / TIME_TO_TURN))
        spread = (0.5 * max_speed) ** 2 / max(step[0], 1e-9)
        return (
            Model(1.0 - turned, *filtering.predict(state, covariance, step, PROCESS_NOISE)),
            Model(turned, *filtering.predict(state, covariance, step, PROCESS_NOISE + spread)),
        )

    def _update(
        self,
        stamp: float,
        gains: FloatArray,
        states: FloatArray,
        covariances: FloatArray,
        taken: FloatArray,
    ) -> None:
        """Combine the models, (m, n) of them by track, and update the probability of existence."""
        gain = gains.sum(axis=0)
        share = gains / gain
        state = np.einsum("mn,mni->ni", share, states)
        shift = states - state
        outer = shift[..., :, None] * shift[..., None, :]
        covariance = np.einsum("mn,mnij->nij", share, covariances + outer)
        self._existence = gain * self._existence / (1.0 - (1.0 - gain) * self._existence)
        self._last_taken = np.where(taken >= 0.5 * gain, stamp, self._last_taken)
        self._tracks = replace(
            self._tracks,
            stamp=np.full(len(state), stamp),
            state=state,
            covariance=covariance,
            age=self._tracks.age + (stamp - self._tracks.stamp),
        )

    def _end(self, stamp: float) -> None:
        held = (self._last_taken >= stamp - self.hold_time) & (self._existence >= LEAST_EXISTENCE)
        if held.all():
            return
        self._ended += self._tracks.track_id[~held].tolist()
        self._tracks = self._tracks.where(held)
        self._existence, self._last_taken = self._existence[held], self._last_taken[held]


def _associated(
    model: Model,
    stamp: float,
    detections: NDArray[np.void],
    probability: FloatArray,
    sensor: SensorModel,
) -> Association:
    """The detections in the gates of the predicted tracks."""
    state, covariance = model.state, model.covariance
    if not len(detections):
        none = np.zeros(0, np.int64)
        lag = np.zeros(len(state))
        spread = covariance[:, 0::2, 0::2]
        return Association(none, none, np.zeros((0, 2)), np.zeros(0), lag, spread)
    reach = major_sigma(covariance[:, 0::2, 0::2]) ** 2 + detections["major_sigma"].max() ** 2
    reach = GATE_MARGIN * gate_factor(GATE_PROBABILITY) * np.sqrt(reach)
    count = range(1, min(MAX_NEIGHBOURS, len(detections)) + 1)
    distance, near = cKDTree(detections["position"]).query(state[:, 0::2], k=count)
    owner, place = np.nonzero(distance <= reach[:, None])
    row = near[owner, place]
    nearest = detections[near[:, 0]]
    lag = nearest["time"] - stamp
    expected = state[:, 0::2] + lag[:, None] * state[:, 1::2]
    spread = filtering.position_covariance_after(covariance, lag)
    spread += covariance_at(nearest, expected, sensor)
    # Each detection at its own time; their covariance is that at the nearest one's.
    own_lag = (detections["time"][row] - stamp)[:, None]
    innovation = detections["position"][row] - state[owner, 0::2] - own_lag * state[owner, 1::2]
    density, distance = filtering.log_density(innovation, spread[owner])
    inside = distance <= gate_factor(GATE_PROBABILITY) ** 2
    owner, row, innovation = owner[inside], row[inside], innovation[inside]
    likelihood = probability[owner] * np.exp(density[inside])
    return Association(owner, row, innovation, likelihood, lag, spread)


def _mixed(model: Model, found: Association, weight: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean and covariance of each track over which detection, if any, is the target's.

    ``x + K v``, ``P - (1 - beta_0) K S K' + K (sum_j beta_j v_j v_j' - v v') K'`` with
    ``v = sum_j beta_j v_j``.
    """
    n = len(model.state)
    some, mean, square = np.zeros(n), np.zeros((n, 2)), np.zeros((n, 2, 2))
    outer = found.innovation[:, :, None] * found.innovation[:, None, :]
    np.add.at(some, found.owner, weight)
    np.add.at(mean, found.owner, weight[:, None] * found.innovation)
    np.add.at(square, found.owner, weight[:, None, None] * outer)
    gain = filtering.gain(model.covariance, found.lag, found.spread)
    change = square - mean[:, :, None] * mean[:, None, :] - some[:, None, None] * found.spread
    state = model.state + (gain @ mean[..., None])[..., 0]
    return state, model.covariance + gain @ change @ np.swapaxes(gain, 1, 2)
