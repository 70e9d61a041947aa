"""Confirmed tracks held: carried forward, taking the detections that are theirs.

Integrated probabilistic data association (Musicki, Evans, Stankovic, "Integrated probabilistic data
association", IEEE Trans. Autom. Control 39(6), 1994): each track has a probability that its target
exists, which falls with every miss, and is updated by the mean of its detections, each weighted by
the probability that it is the target's. Over a scan a target goes on as it was or has turned, and
both are weighed by what the detections say of them (a generalised pseudo-Bayesian estimator of
first order: Bar-Shalom, Li, Kirubarajan, "Estimation with Applications to Tracking and
Navigation", 2001, section 11.6.4).

Where a downstream tracker says what it tracks, that replaces what is held, and the rules by which
tracks end here are for the others only: those it has not listed yet.
"""

from __future__ import annotations

import enum
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from tsepm_ros import filtering
from tsepm_ros.conversion import covariance_at, major_sigma
from tsepm_ros.evidence import LEAST_DENSITY
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
TIME_TO_VANISH = 600.0
"""Mean time after which a target is gone, s: without it no number of misses would tell."""
LEAST_EXISTENCE = 0.01
"""Probability of existence below which a track is held no longer."""
TRACKED_EXISTENCE = 0.99
"""Probability that a target exists which a downstream tracker says it tracks: a choice."""
LARGEST_FACTOR = 100.0
"""Logarithm of the largest factor by which detections are explained: no overflow."""
SAME_SCANS = 5
"""Scans in a row for which a track must agree with an older one to be the same target's."""
SAME_DISTANCE = 7.78
"""Squared distance of two states that agree: chi-square of four degrees of freedom at 0.9."""
MAX_NEIGHBOURS = 8
"""Detections that a track weighs, the nearest."""


class Tracker(enum.Enum):
    """What is known of a downstream tracker."""

    NONE = "none"
    ALIVE = "alive"
    SILENT = "silent"


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
class Neighbours:
    """Pairs of tracks and detections that may be theirs.

    Attributes
    ----------
    nearest : (n,) ndarray of int
        Detection nearest to each track; empty where there is no detection.
    owner, row : (p,) ndarray of int
        Track and detection of each pair.
    """

    nearest: IntArray
    owner: IntArray
    row: IntArray


@dataclass(frozen=True)
class Association:
    """Detections near the tracks, under one model; pairs as in `Neighbours`.

    Attributes
    ----------
    innovation : (p, 2) ndarray
        m.
    likelihood : (p,) ndarray
        P_D N(z; H x, S), 1/m^2; 0 outside the gate.
    lag : (n,) ndarray
        Time after the scan's stamp of the tracks' nearest detections, s.
    spread : (n, 2, 2) ndarray
        S of each track, with the error of its nearest detection.
    """

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
        after that, or sooner, where its target was missed so often that it probably exists no more,
        or where it has come to be the same as an older track.
    tracked_timeout : float, optional
        Time, s, after which a downstream tracker that said nothing is silent, and for which it may
        leave a track unlisted before that counts as declined.

    Attributes
    ----------
    tracker : Tracker
        Whether a downstream tracker was heard since the last clearing, and still is.
    """

    def __init__(self, hold_time: float, tracked_timeout: float = 60.0) -> None:
        self.hold_time = hold_time
        self.tracked_timeout = tracked_timeout
        self._ended: list[int] = []
        self._cleared: list[int] = []
        self._forget()

    def _forget(self) -> None:
        self._tracks = TrackArrays.of([])
        self._existence = np.zeros(0)
        self._last_taken = np.zeros(0)
        self._agreed = np.zeros(0, np.int64)
        # Since when each track waits for the tracker to list it, s; -inf: it does.
        self._waiting_since = np.zeros(0)
        self.tracker = Tracker.NONE
        self._heard = -np.inf

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
            Density at each detection, 1/m^2, that stands beside the clutter for what the held
            targets explain: ``lambda_j (prod_i f_ij - 1)`` with the factor by which the scan is
            less likely if detection j is not there for target i,
            ``f_ij = (1 - delta_i r_i) / (1 - delta_i r_i - r_i L_ij)``. Where another detection
            may as well be target i's, little is explained: so a second target is seen beside it.
        """
        self._ended, self._cleared = self._cleared, []
        self._listen(stamp)
        none = np.zeros(len(detections))
        if not len(self._tracks):
            return none
        self._end(self._last_taken >= stamp - self.hold_time)
        step = stamp - self._tracks.stamp
        self._existence = self._existence * np.exp(-np.maximum(step, 0.0) / TIME_TO_VANISH)
        clutter = np.maximum(clutter, LEAST_DENSITY)
        models = self._predicted(step, max_speed)
        missed = 1.0 - detectable(models[0].state[:, 0::2]) * GATE_PROBABILITY
        near = _neighbours(models[-1], stamp, detections)
        gains, states, covariances = [], [], []
        ratio = np.zeros(len(near.row))
        for model in models:
            found = _associated(model, near, stamp, detections, sensor)
            of_model = found.likelihood / clutter[near.row]
            gain = missed + np.bincount(near.owner, of_model, minlength=len(missed))  # 1 - delta
            state, covariance = _mixed(model, near, found, of_model / gain[near.owner])
            gains.append(model.probability * gain)
            states.append(state)
            covariances.append(covariance)
            ratio += model.probability * of_model
        existence = self._existence[near.owner]
        whole = 1.0 - existence + existence * np.sum(gains, axis=0)[near.owner]
        least = 1.0 - existence + existence * missed[near.owner]
        factor = np.log(whole) - np.log(np.maximum(whole - existence * ratio, least))
        factors = np.bincount(near.row, factor, minlength=len(detections))
        self._update(stamp, np.array(gains), np.array(states), np.array(covariances), missed)
        self._end(self._existence >= LEAST_EXISTENCE)
        self._end(~self._repeated())
        return clutter * np.expm1(np.minimum(factors, LARGEST_FACTOR))

    def add(self, tracks: TrackArrays, existence: float) -> None:
        """Hold newly confirmed tracks whose targets exist with a probability."""
        if not len(tracks):
            return
        self._tracks = self._tracks.joined(tracks)
        self._existence = np.concatenate([self._existence, np.full(len(tracks), existence)])
        self._last_taken = np.concatenate([self._last_taken, tracks.stamp])
        self._agreed = np.concatenate([self._agreed, np.zeros(len(tracks), np.int64)])
        self._waiting_since = np.concatenate([self._waiting_since, tracks.stamp])

    def follow(self, stamp: float, tracks: TrackArrays) -> None:
        """Take over what a downstream tracker says that it tracks, before the next step.

        A track of the same id gets the tracker's state, and keeps its other figures; one of another
        id joins the hold. What the tracker listed before, and lists no more, ends. A track that it
        has not listed yet is held by the rules here, and ends where the tracker, heard all the
        while, has not listed it for `tracked_timeout`. After a silence, all begin to wait again.

        Parameters
        ----------
        stamp : float
            Time at which the tracker says so, s; it may be later than the next step's.
        tracks : TrackArrays
            With stamps of their own, finite numbers and an id each, see
            `tsepm_ros.tracked.usable`.
        """
        self._listen(stamp)
        if self.tracker is not Tracker.ALIVE:
            self._waiting_since = np.maximum(self._waiting_since, stamp)
        self.tracker, self._heard = Tracker.ALIVE, stamp
        ids = self._tracks.track_id
        waited = stamp - self._waiting_since > self.tracked_timeout
        over = waited & ~np.isin(ids, tracks.track_id)
        self._cleared += ids[over].tolist()
        self._keep(~over)
        self.add(tracks.where(~np.isin(tracks.track_id, ids)), TRACKED_EXISTENCE)
        held = self._tracks
        _, row, given = np.intersect1d(held.track_id, tracks.track_id, return_indices=True)
        told = tracks.where(given)
        self._tracks = replace(
            held,
            stamp=_put(held.stamp, row, told.stamp),
            state=_put(held.state, row, told.state),
            covariance=_put(held.covariance, row, told.covariance),
            age=_put(held.age, row, held.age[row] + told.stamp - held.stamp[row]),
        )
        self._existence[row] = TRACKED_EXISTENCE
        self._last_taken[row] = np.maximum(self._last_taken[row], told.stamp)
        self._waiting_since[row] = -np.inf

    @property
    def current(self) -> TrackArrays:
        """Every track held, at the last scan's stamp; between `follow` and `step` at their own."""
        return self._tracks

    @property
    def ended(self) -> list[int]:
        """Ids of the tracks that ended at the last step, or before it since the one before."""
        return self._ended

    def clear(self) -> None:
        """End every track and forget what a downstream tracker said."""
        self._cleared += self._tracks.track_id.tolist()
        self._forget()

    def take_cleared(self) -> list[int]:
        """Ids of the tracks that ended since the last step; the next will not name them."""
        cleared, self._cleared = self._cleared, []
        return cleared

    def _listen(self, stamp: float) -> None:
        """Notice at a time (s) that the downstream tracker has fallen silent."""
        if self.tracker is Tracker.ALIVE and abs(stamp - self._heard) > self.tracked_timeout:
            self.tracker = Tracker.SILENT

    def _predicted(self, step: FloatArray, max_speed: float) -> tuple[Model, Model]:
        """The tracks after a time step, had they gone on and had they turned at some time since."""
        state, covariance = self._tracks.state, self._tracks.covariance
        longest = float(np.abs(step).max(initial=0.0))
        turned = float(-np.expm1(-longest / TIME_TO_TURN))
        spread = (0.5 * max_speed) ** 2 / max(longest, 1e-9)
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
        missed: FloatArray,
    ) -> None:
        """Combine the models, (m, n) of them by track, and update the probability of existence."""
        gain = gains.sum(axis=0)
        share = gains / gain
        state = np.einsum("mn,mni->ni", share, states)
        shift = states - state
        outer = shift[..., :, None] * shift[..., None, :]
        covariance = np.einsum("mn,mnij->nij", share, covariances + outer)
        self._existence = gain * self._existence / (1.0 - (1.0 - gain) * self._existence)
        own = (1.0 - missed / gain) * self._existence >= 0.5
        self._last_taken = np.where(own, stamp, self._last_taken)
        self._tracks = replace(
            self._tracks,
            stamp=np.full(len(state), stamp),
            state=state,
            covariance=covariance,
            age=self._tracks.age + (stamp - self._tracks.stamp),
        )

    def _repeated(self) -> NDArray[np.bool_]:
        """Which tracks have for some scans been where an older one is: the same target again.

        Two tracks agree where ``d' (P_i + P_j)^-1 d`` of their states is within the gate for four
        dimensions. Looked for among the nearest only.
        """
        n = len(self._tracks)
        if n < 2:
            self._agreed[:] = 0
            return self._agreed >= SAME_SCANS
        state, covariance = self._tracks.state, self._tracks.covariance
        count = range(2, min(MAX_NEIGHBOURS, n) + 1)
        _, other = cKDTree(state[:, 0::2]).query(state[:, 0::2], k=count)
        one = np.repeat(np.arange(n), len(count))
        two = other.ravel()
        older = two < one
        one, two = one[older], two[older]
        apart = state[one] - state[two]
        spread = covariance[one] + covariance[two]
        scaled = np.linalg.solve(spread, apart[..., None])[..., 0]
        near = np.einsum("pi,pi->p", apart, scaled) <= SAME_DISTANCE
        agrees = np.zeros(n, bool)
        agrees[one[near]] = True
        self._agreed = np.where(agrees, self._agreed + 1, 0)
        return self._agreed >= SAME_SCANS

    def _end(self, held: NDArray[np.bool_]) -> None:
        """End all tracks but those held and those that the downstream tracker lists."""
        if self.tracker is Tracker.ALIVE:
            held = held | np.isneginf(self._waiting_since)
        if held.all():
            return
        self._ended = self._ended + self._tracks.track_id[~held].tolist()
        self._keep(held)

    def _keep(self, held: NDArray[np.bool_]) -> None:
        """Keep only the tracks held."""
        self._tracks = self._tracks.where(held)
        self._existence, self._last_taken = self._existence[held], self._last_taken[held]
        self._agreed, self._waiting_since = self._agreed[held], self._waiting_since[held]


def _put(array: FloatArray, row: IntArray, values: FloatArray) -> FloatArray:
    """A copy of an array with other values in some rows."""
    array = array.copy()
    array[row] = values
    return array


def _neighbours(model: Model, stamp: float, detections: NDArray[np.void]) -> Neighbours:
    """The detections nearest to each predicted track."""
    state, covariance = model.state, model.covariance
    if not len(detections) or not len(state):
        return Neighbours(*np.zeros((3, 0), np.int64))
    lag = detections["time"] - stamp
    middle = 0.5 * (lag.min() + lag.max())
    centre = state[:, 0::2] + middle * state[:, 1::2]
    spread = filtering.position_covariance_after(covariance, np.full(len(state), middle))
    sigma = np.hypot(major_sigma(spread), GATE_MARGIN * detections["major_sigma"].max())
    reach = 1.1 * gate_factor(GATE_PROBABILITY) * sigma
    reach += np.hypot(state[:, 1], state[:, 3]) * np.ptp(lag)
    count = range(1, min(MAX_NEIGHBOURS, len(detections)) + 1)
    distance, near = cKDTree(detections["position"]).query(centre, k=count)
    owner, place = np.nonzero(distance <= reach[:, None])
    return Neighbours(near[:, 0], owner, near[owner, place])


def _associated(
    model: Model,
    near: Neighbours,
    stamp: float,
    detections: NDArray[np.void],
    sensor: SensorModel,
) -> Association:
    """How well the detections fit the predicted tracks."""
    state, covariance = model.state, model.covariance
    if not len(near.nearest):
        lag, spread = np.zeros(len(state)), covariance[:, 0::2, 0::2]
        return Association(np.zeros((0, 2)), np.zeros(0), lag, spread)
    owner, row = near.owner, near.row
    nearest = detections[near.nearest]
    lag = nearest["time"] - stamp
    expected = state[:, 0::2] + lag[:, None] * state[:, 1::2]
    spread = filtering.position_covariance_after(covariance, lag)
    spread += covariance_at(nearest, expected, sensor)
    # Each detection at its own time; their covariance is that at the nearest one's.
    own_lag = (detections["time"][row] - stamp)[:, None]
    innovation = detections["position"][row] - state[owner, 0::2] - own_lag * state[owner, 1::2]
    density, distance = filtering.log_density(innovation, spread[owner])
    inside = distance <= gate_factor(GATE_PROBABILITY) ** 2
    # What is there was detected, wherever the data sheet ends the coverage.
    likelihood = np.where(inside, sensor.detection_probability * np.exp(density), 0.0)
    return Association(innovation, likelihood, lag, spread)


def _mixed(
    model: Model, near: Neighbours, found: Association, weight: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Mean and covariance of each track over which detection, if any, is the target's.

    ``x + K v``, ``P - (1 - beta_0) K S K' + K (sum_j beta_j v_j v_j' - v v') K'`` with
    ``v = sum_j beta_j v_j``.
    """
    n = len(model.state)
    x, y = found.innovation.T
    parts = (np.ones_like(x), x, y, x * x, x * y, y * y)
    some, *sums = (np.bincount(near.owner, weight * part, minlength=n) for part in parts)
    mean = np.stack(sums[:2], axis=-1)
    square = np.stack([sums[2], sums[3], sums[3], sums[4]], axis=-1).reshape(n, 2, 2)
    gain = filtering.gain(model.covariance, found.lag, found.spread)
    change = square - mean[:, :, None] * mean[:, None, :] - some[:, None, None] * found.spread
    state = model.state + (gain @ mean[..., None])[..., 0]
    covariance = model.covariance + gain @ change @ np.swapaxes(gain, 1, 2)
    # Rounding must not make it asymmetric: that part would grow from scan to scan.
    return state, 0.5 * (covariance + np.swapaxes(covariance, 1, 2))
