"""Confirmed tracks held: carried forward, taking the detections that are theirs.

Integrated probabilistic data association (Musicki, Evans, Stankovic, "Integrated probabilistic data
association", IEEE Trans. Autom. Control 39(6), 1994): each track has a probability that its target
exists, which falls with every miss, and is updated by the mean of its detections, each weighted by
the probability that it is the target's. What exists may fade and be seen again (their Markov chain
two): misses come in runs where scans follow quickly, and a run of them does not end a track. The
modes in which a target moves are weighed by what the detections say of them
(`kinematics.interacting_models`; together: Musicki, Suvorova, "Tracking in clutter using
IMM-IPDA-based algorithms", IEEE Trans. Aerosp. Electron. Syst. 44(1), 2008).

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

from tsepm_ros.environment.detection_probability import DetectionProbability
from tsepm_ros.environment.feature_association import Environment
from tsepm_ros.kinematics import kalman
from tsepm_ros.kinematics.interacting_models import InteractingModels, stay_or_change
from tsepm_ros.kinematics.track import TrackArrays
from tsepm_ros.numerics.arrays import FloatArray, IntArray
from tsepm_ros.numerics.gaussian import gate_factor
from tsepm_ros.sensing import range_rates
from tsepm_ros.sensing.conversion import covariance_at, major_sigma
from tsepm_ros.sensing.plot_features import Histories
from tsepm_ros.sensing.sensor import LEAST_DENSITY, SensorModel
from tsepm_ros.stages.association import Pairs
from tsepm_ros.stages.paths import NO_HIT

GATE_PROBABILITY = 0.99
GATE_MARGIN = 1.5
"""The error at the predicted position may be this much larger than the largest of the scan."""
TIME_TO_FADE = 300.0
"""Mean time after which a target that is seen fades, s."""
TIME_OF_FADING = 20.0
"""Mean time for which it is not seen then, s."""
TIME_TO_VANISH = 600.0
"""Mean time after which a target is gone, s: without it no number of misses would tell."""
LEAST_EXISTENCE = 0.01
"""Probability of existence below which a track is held no longer."""
TRACKED_EXISTENCE = 0.99
"""Probability that a target exists which a downstream tracker says it tracks: a choice."""
LARGEST_FACTOR = 100.0
"""Logarithm of the largest factor by which detections are explained: no overflow."""
ROUNDING = 1e-12
"""Relative error of a covariance that has to be reckoned with."""
SAME_SCANS = 5
"""Scans in a row for which a track must agree with an older one to be the same target's."""
SAME_DISTANCE = 7.78
"""Squared distance of two states that agree: chi-square of four degrees of freedom at 0.9."""
MAX_NEIGHBOURS = 8
"""Detections that a track weighs, the nearest."""
NO_CLAIMS = np.zeros(0, np.int64), np.zeros(0)
"""See `TrackHold.claims`."""


class Tracker(enum.Enum):
    """What is known of a downstream tracker."""

    NONE = "none"
    ALIVE = "alive"
    SILENT = "silent"


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
    """Detections near the tracks, in one mode of motion; pairs as in `Neighbours`.

    Attributes
    ----------
    innovation : (p, 2) ndarray
        m.
    likelihood : (p,) ndarray
        N(z; H x, S), 1/m^2, times that of a range rate, s/m; 0 outside the gate.
    lag : (n,) ndarray
        Time after the scan's stamp of the tracks' nearest detections, s.
    spread : (n, 2, 2) ndarray
        S of each track, with the error of its nearest detection.
    updated : tuple of (p, 4) and (p, 4, 4) ndarray, or None
        State and covariance of each pair's track if the detection is its target's; None where no
        detection has a range rate, and the innovations say it all.
    """

    innovation: FloatArray
    likelihood: FloatArray
    lag: FloatArray
    spread: FloatArray
    updated: tuple[FloatArray, FloatArray] | None = None


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
    detection_probability : DetectionProbability
        As the tracks tell it, from the scans after their confirmation.
    claims : tuple of (p,) ndarray
        Detections of the last scan that may be a track's, and the probability of each that the
        track's target exists and the detection is its: ``r_i beta_ij``.
    """

    def __init__(self, hold_time: float, tracked_timeout: float = 60.0) -> None:
        self.hold_time = hold_time
        self.tracked_timeout = tracked_timeout
        self._ended: list[int] = []
        self._cleared: list[int] = []
        self._forget()

    def _forget(self) -> None:
        self._tracks = TrackArrays.of([])
        self._motion = InteractingModels.of(np.zeros((0, 4)), np.zeros((0, 4, 4)))
        self._existence = np.zeros(0)
        # Probability that each target, if it exists, is seen: not faded.
        self._seen = np.zeros(0)
        # Scans that covered each target since it was last detected.
        self._undecided = np.zeros(0)
        self._last_taken = np.zeros(0)
        self._agreed = np.zeros(0, np.int64)
        # Since when each track waits for the tracker to list it, s; -inf: it does.
        self._waiting_since = np.zeros(0)
        self._histories = Histories.of(np.zeros((0, 0, 3)))
        self.tracker = Tracker.NONE
        self._heard = -np.inf
        self.detection_probability = DetectionProbability()
        self.claims = NO_CLAIMS

    def step(
        self,
        stamp: float,
        detections: NDArray[np.void],
        clutter: FloatArray,
        detectable: Callable[[FloatArray], FloatArray],
        sensor: SensorModel,
        max_speed: float,
        environment: Environment | None = None,
    ) -> FloatArray:
        """Carry the tracks to a scan and let them take its detections.

        With ``L_ij = s_i P_D N(z_j; H x_i, S_i) / lambda_j`` of the detections in track i's gate,
        and s_i the probability that target i has not faded::

            delta_i = s_i P_D P_G - sum_j L_ij,    r_i <- (1 - delta_i) r_i / (1 - delta_i r_i)
            beta_ij = L_ij / (1 - delta_i),        1 - s_i <- (1 - s_i) / (1 - delta_i)

        and over the modes of motion, of probabilities mu_m,
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
        environment : Environment, optional
            Clutter zones and encounters, in which plots' features count.

        Returns
        -------
        (d,) ndarray
            Density at each detection, 1/m^2, that stands beside the clutter for what the held
            targets explain: ``lambda_j (prod_i f_ij - 1)`` with the factor by which the scan is
            less likely if detection j is not there for target i,
            ``f_ij = (1 - delta_i r_i) / (1 - delta_i r_i - r_i L_ij)``. Where another detection
            may as well be target i's, little is explained: so a second target is seen beside it.

        Notes
        -----
        Targets compete for detections: to each, what the others explain is clutter, so that in all
        but the f_ij of j itself ``L_ij / prod_k!=i f_kj`` stands for L_ij (as in Musicki, La Scala,
        "Multi-target tracking in clutter without measurement assignment", IEEE Trans. Aerosp.
        Electron. Syst. 44(3), 2008).
        """
        self._ended, self._cleared = self._cleared, []
        self.claims = NO_CLAIMS
        self._listen(stamp)
        none = np.zeros(len(detections))
        if not len(self._tracks):
            return none
        self._end(self._last_taken >= stamp - self.hold_time)
        step = stamp - self._tracks.stamp
        self._existence = self._existence * np.exp(-np.maximum(step, 0.0) / TIME_TO_VANISH)
        clutter = np.maximum(clutter, LEAST_DENSITY)
        faded, still = stay_or_change(np.abs(step), TIME_TO_FADE, TIME_OF_FADING)
        self._seen = 1.0 - self._seen * faded - (1.0 - self._seen) * still
        predicted = self._motion.predicted(step, max_speed)
        expected, spread = predicted.combined()
        probability = detectable(expected[:, 0::2])
        missed = 1.0 - self._seen * probability * GATE_PROBABILITY
        near = _neighbours(predicted, expected, stamp, detections)
        found = [
            _associated(state, covariance, near, stamp, detections, sensor)
            for _, state, covariance in predicted.modes()
        ]
        # What is there was detected, wherever the data sheet ends the coverage.
        scale = self._seen[near.owner] * sensor.detection_probability / clutter[near.row]
        if environment is not None:
            likelihood = _over_modes(predicted, near, [mode.likelihood for mode in found])
            scale = scale * self._resemblance(
                environment, near, likelihood, expected, spread, detections
            )
        ratios = np.array([mode.likelihood for mode in found]) * scale
        ratio = _over_modes(predicted, near, ratios)
        alone = self._factors(near, missed, ratio, ratio)
        by_others = np.bincount(near.row, alone, minlength=len(detections))[near.row] - alone
        left = np.exp(-np.minimum(by_others, LARGEST_FACTOR))
        factors = np.bincount(
            near.row, self._factors(near, missed, ratio, left * ratio), minlength=len(detections)
        )
        total = missed + np.bincount(near.owner, left * ratio, minlength=len(missed))
        beta = left * ratio / total[near.owner]
        plots = np.full(len(missed), NO_HIT)
        if environment is not None:
            likely = beta > 0.5
            plots[near.owner[likely]] = near.row[likely]
            own = np.flatnonzero(plots != NO_HIT)
            self._histories = self._histories.with_plots(own, detections["features"][plots[own]])
            # In a clutter zone a second plot tells of no second target.
            plots[own[environment.in_zone[plots[own]]]] = NO_HIT
        taken = self._update(stamp, predicted, near, found, left * ratios, missed)
        self.claims = near.row, beta * self._existence[near.owner]
        self._count(taken, probability > 0.0)
        plots = plots[self._end(self._existence >= LEAST_EXISTENCE)]
        self._end(~self._repeated(plots))
        return clutter * np.expm1(np.minimum(factors, LARGEST_FACTOR))

    def add(
        self,
        tracks: TrackArrays,
        existence: float | FloatArray,
        histories: Histories | None = None,
    ) -> None:
        """Hold newly confirmed tracks whose targets exist with a probability, one or (n,).

        Their hits have features as in `histories`, if these are known.
        """
        if not len(tracks):
            return
        unknown = Histories.of(np.zeros((len(tracks), 0, 3)))
        self._histories = Histories.joined(self._histories, histories or unknown)
        self._tracks = self._tracks.joined(tracks)
        self._motion = self._motion.joined(InteractingModels.of(tracks.state, tracks.covariance))
        self._seen = np.concatenate([self._seen, np.ones(len(tracks))])
        self._undecided = np.concatenate([self._undecided, np.zeros(len(tracks))])
        self._existence = np.concatenate([self._existence, np.broadcast_to(existence, len(tracks))])
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
            `tsepm_ros.maintenance.downstream_tracker.usable`.
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
        self._motion = self._motion.with_rows(
            row, InteractingModels.of(told.state, told.covariance)
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

    def _resemblance(
        self,
        environment: Environment,
        near: Neighbours,
        likelihood: FloatArray,
        state: FloatArray,
        covariance: FloatArray,
        detections: NDArray[np.void],
    ) -> FloatArray:
        """Factor of each pair's L_ij that features give, (p,); see `Environment.factors`."""
        if not len(near.owner):
            return np.ones(0)
        error = detections["major_sigma"][near.nearest]
        meets = environment.meeting(state, covariance, error, gate_factor(GATE_PROBABILITY))
        inside = likelihood > 0.0
        cost = np.full(len(likelihood), np.inf)
        cost[inside] = -2.0 * np.log(likelihood[inside])
        pairs = Pairs(near.owner, near.row, cost)
        return environment.factors(self._histories, meets, pairs, detections["features"])

    def _factors(
        self, near: Neighbours, missed: FloatArray, ratio: FloatArray, left: FloatArray
    ) -> FloatArray:
        """Logarithm of f of each pair, (p,).

        Parameters
        ----------
        near : Neighbours
        missed : (n,) ndarray
            ``1 - s_i P_D P_G``.
        ratio, left : (p,) ndarray
            L_ij, and what other targets leave of it where it is the alternative.
        """
        existence = self._existence[near.owner]
        other = missed + np.bincount(near.owner, left, minlength=len(missed))
        least = 1.0 - existence + existence * missed[near.owner]
        without = 1.0 - existence + existence * (other[near.owner] - left)
        factor: FloatArray = np.log1p(existence * ratio / np.maximum(without, least))
        return factor

    def _update(
        self,
        stamp: float,
        predicted: InteractingModels,
        near: Neighbours,
        found: list[Association],
        ratios: FloatArray,
        missed: FloatArray,
    ) -> FloatArray:
        """Update states, modes and the probabilities that the targets exist and are seen.

        Parameters
        ----------
        stamp : float
            s.
        predicted : Motion
        near : Neighbours
        found : list of Association
            By mode.
        ratios : (2, p) ndarray
            L_ij in each mode.
        missed : (n,) ndarray
            ``1 - s_i P_D P_G``.

        Returns
        -------
        (n,) ndarray
            Probability that each target exists and was detected.
        """
        gains, states, covariances = [], [], []
        for (probability, state, covariance), mode, ratio in zip(
            predicted.modes(), found, ratios, strict=True
        ):
            of_mode = missed + np.bincount(near.owner, ratio, minlength=len(missed))  # 1 - delta
            after = _mixed(state, covariance, near, mode, ratio / of_mode[near.owner])
            gains.append(probability * of_mode)
            states.append(after[0])
            covariances.append(after[1])
        gain = np.sum(gains, axis=0)
        self._motion = InteractingModels(gains / gain, np.array(states), np.array(covariances))
        state, covariance = self._motion.combined()
        self._existence = gain * self._existence / (1.0 - (1.0 - gain) * self._existence)
        self._seen = 1.0 - (1.0 - self._seen) / gain
        taken: FloatArray = (1.0 - missed / gain) * self._existence
        self._last_taken = np.where(taken >= 0.5, stamp, self._last_taken)
        self._tracks = replace(
            self._tracks,
            stamp=np.full(len(state), stamp),
            state=state,
            covariance=covariance,
            age=self._tracks.age + (stamp - self._tracks.stamp),
        )
        return taken

    def _count(self, taken: FloatArray, covered: NDArray[np.bool_]) -> None:
        """Count the detections that the tracks take, and the scans that each took."""
        self._undecided += covered
        self.detection_probability.update(
            taken[covered], self._undecided[covered], GATE_PROBABILITY
        )
        self._undecided *= 1.0 - taken

    def _repeated(self, plots: IntArray) -> NDArray[np.bool_]:
        """Which tracks have for some scans been where an older one is: the same target again.

        Two tracks agree where ``d' (P_i + P_j)^-1 d`` of their states is within the gate for four
        dimensions, and they do not each have a plot (n,) of their own. Looked for among the nearest
        only.
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
        near &= (plots[one] == plots[two]) | (plots[one] == NO_HIT) | (plots[two] == NO_HIT)
        agrees = np.zeros(n, bool)
        agrees[one[near]] = True
        self._agreed = np.where(agrees, self._agreed + 1, 0)
        return self._agreed >= SAME_SCANS

    def _end(self, held: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """End all tracks but those held and those that the downstream tracker lists.

        Returns which were kept.
        """
        if self.tracker is Tracker.ALIVE:
            held = held | np.isneginf(self._waiting_since)
        if held.all():
            return held
        self._ended = self._ended + self._tracks.track_id[~held].tolist()
        self._keep(held)
        return held

    def _keep(self, held: NDArray[np.bool_]) -> None:
        """Keep only the tracks held."""
        self._tracks, self._motion = self._tracks.where(held), self._motion.where(held)
        self._seen, self._undecided = self._seen[held], self._undecided[held]
        self._existence, self._last_taken = self._existence[held], self._last_taken[held]
        self._agreed, self._waiting_since = self._agreed[held], self._waiting_since[held]
        self._histories = self._histories[held]


def _over_modes(
    motion: InteractingModels, near: Neighbours, values: FloatArray | list[FloatArray]
) -> FloatArray:
    """Mean of values (2, p) of pairs over the modes of their tracks, (p,)."""
    mean: FloatArray = (motion.probability[:, near.owner] * np.asarray(values)).sum(axis=0)
    return mean


def _put(array: FloatArray, row: IntArray, values: FloatArray) -> FloatArray:
    """A copy of an array with other values in some rows."""
    array = array.copy()
    array[row] = values
    return array


def _neighbours(
    motion: InteractingModels, expected: FloatArray, stamp: float, detections: NDArray[np.void]
) -> Neighbours:
    """The detections nearest to each predicted track, as far as the gate of any mode reaches."""
    if not len(detections) or not len(expected):
        return Neighbours(*np.zeros((3, 0), np.int64))
    lag = detections["time"] - stamp
    middle = 0.5 * (lag.min() + lag.max())
    centre = expected[:, 0::2] + middle * expected[:, 1::2]
    reach = np.zeros(len(expected))
    gate = kalman.gate_reach(GATE_PROBABILITY, detections)
    for _, state, covariance in motion.modes():
        spread = kalman.position_covariance_after(covariance, np.full(len(state), middle))
        sigma = np.hypot(major_sigma(spread), GATE_MARGIN * detections["major_sigma"].max())
        offset = state[:, 0::2] + middle * state[:, 1::2] - centre
        of_mode = 1.1 * gate * sigma + np.hypot(*offset.T)
        of_mode += np.hypot(state[:, 1], state[:, 3]) * np.ptp(lag)
        reach = np.maximum(reach, of_mode)
    count = range(1, min(MAX_NEIGHBOURS, len(detections)) + 1)
    distance, near = cKDTree(detections["position"]).query(centre, k=count)
    owner, place = np.nonzero(distance <= reach[:, None])
    return Neighbours(near[:, 0], owner, near[owner, place])


def _associated(
    state: FloatArray,
    covariance: FloatArray,
    near: Neighbours,
    stamp: float,
    detections: NDArray[np.void],
    sensor: SensorModel,
) -> Association:
    """How well the detections fit the predicted tracks."""
    if not len(near.nearest):
        lag, spread = np.zeros(len(state)), covariance[:, 0::2, 0::2]
        return Association(np.zeros((0, 2)), np.zeros(0), lag, spread)
    owner, row = near.owner, near.row
    nearest = detections[near.nearest]
    lag = nearest["time"] - stamp
    expected = state[:, 0::2] + lag[:, None] * state[:, 1::2]
    spread = kalman.position_covariance_after(covariance, lag)
    spread += covariance_at(nearest, expected, sensor)
    # Each detection at its own time; their covariance is that at the nearest one's.
    own_lag = (detections["time"][row] - stamp)[:, None]
    innovation = detections["position"][row] - state[owner, 0::2] - own_lag * state[owner, 1::2]
    found, own_step = detections[row], own_lag[:, 0]
    density = kalman.log_likelihood(
        state, covariance, owner, own_step, innovation, spread[owner], found, GATE_PROBABILITY
    )
    updated = None
    if range_rates.measured(found).any():
        placed = kalman.update(state[owner], covariance[owner], own_step, innovation, spread[owner])
        updated = range_rates.update(*placed, own_step, found)
    return Association(innovation, np.exp(density), lag, spread, updated)


def _mixed(
    state: FloatArray,
    covariance: FloatArray,
    near: Neighbours,
    found: Association,
    weight: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Mean and covariance of each track over which detection, if any, is the target's.

    ``x + K v``, ``P - (1 - beta_0) K S K' + K (sum_j beta_j v_j v_j' - v v') K'`` with
    ``v = sum_j beta_j v_j``; with range rates the mixture of the states updated by each.
    """
    n = len(state)
    if found.updated is not None:
        return _symmetric(*_mixture(state, covariance, near, found.updated, weight))
    x, y = found.innovation.T
    parts = (np.ones_like(x), x, y, x * x, x * y, y * y)
    some, *sums = (np.bincount(near.owner, weight * part, minlength=n) for part in parts)
    mean = np.stack(sums[:2], axis=-1)
    square = np.stack([sums[2], sums[3], sums[3], sums[4]], axis=-1).reshape(n, 2, 2)
    gain = kalman.kalman_gain(covariance, found.lag, found.spread)
    change = square - mean[:, :, None] * mean[:, None, :] - some[:, None, None] * found.spread
    state = state + (gain @ mean[..., None])[..., 0]
    return _symmetric(state, covariance + gain @ change @ np.swapaxes(gain, 1, 2))


def _mixture(
    state: FloatArray,
    covariance: FloatArray,
    near: Neighbours,
    updated: tuple[FloatArray, FloatArray],
    weight: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Mean and covariance of each track as it is, and as each detection of a weight makes it.

    ``x + m``, ``beta_0 P + sum_j beta_j (P_j + d_j d_j') - m m'`` with ``d_j = x_j - x`` and
    ``m = sum_j beta_j d_j``.
    """
    after, spread = updated
    moved = after - state[near.owner]
    spread = spread - covariance[near.owner] + moved[:, :, None] * moved[:, None, :]
    mean, change = np.zeros_like(state), np.zeros_like(covariance)
    np.add.at(mean, near.owner, weight[:, None] * moved)
    np.add.at(change, near.owner, weight[:, None, None] * spread)
    return state + mean, covariance + change - mean[:, :, None] * mean[:, None, :]


def _symmetric(state: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    # Rounding must not make it asymmetric, a part that would grow from scan to scan, or indefinite.
    covariance = 0.5 * (covariance + np.swapaxes(covariance, 1, 2))
    covariance[:, range(4), range(4)] *= 1.0 + ROUNDING
    return state, covariance
