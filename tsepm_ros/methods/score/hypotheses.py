"""Hypotheses of the likelihood-ratio method: which detections are one target's, and where it is."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.kinematics import kalman
from tsepm_ros.numerics import grouped
from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from tsepm_ros.numerics.grouped import places, sums_over_hits
from tsepm_ros.sensing import range_rates
from tsepm_ros.sensing.conversion import covariance_at, major_sigma
from tsepm_ros.sensing.sensor import SensorModel
from tsepm_ros.stages import splitting
from tsepm_ros.stages.paths import Paths

GATE_MARGIN = 1.5
"""The error at the predicted position may be this much larger than at the detection's."""


@dataclass(frozen=True)
class Hypotheses(Paths):
    """Hypotheses as arrays, a row each.

    Attributes
    ----------
    hits, hit_count, first_scan
        As in `Paths`, for at most `window` hits.
    state, covariance : (n, 4), (n, 4, 4) ndarray
        At the last scan's stamp.
    score : (n,) ndarray
        Log-likelihood ratio.
    beside : (n,) ndarray
        The same for one more target, where what held ones explain counts as clutter does.
    """

    state: FloatArray
    covariance: FloatArray
    score: FloatArray
    beside: FloatArray

    def as_beside(self) -> Hypotheses:
        """The hypotheses scored as one more target beside those that are held."""
        return replace(self, score=self.beside)

    def beside_claims(self, ids: IntArray, probability: FloatArray) -> Hypotheses:
        """The hypotheses as seen beside a new track that claims detections.

        Parameters
        ----------
        ids : (c,) ndarray of int
            Detections, ascending.
        probability : (c,) ndarray
            How probably each is the new track's.

        Returns
        -------
        Hypotheses
            `beside` is less by the share of the hits claimed: on average each gave the same.
        """
        share = sums_over_hits(self.hits, ids, probability) / self.hit_count
        return replace(self, beside=self.beside - share * np.maximum(self.beside, 0.0))

    def predicted(self, interval: float, process_noise: float) -> Hypotheses:
        """The hypotheses after a time interval, s, with nearly constant velocity."""
        state, covariance = kalman.predict(self.state, self.covariance, interval, process_noise)
        return replace(self, state=state, covariance=covariance)

    def near(
        self,
        detections: NDArray[np.void],
        stamp: float,
        sensor: SensorModel,
        gate_probability: float,
    ) -> tuple[IntArray, IntArray, int]:
        """Pairs of hypotheses and detections, no fewer than lie in the gates.

        Parameters
        ----------
        detections : (d,) ndarray of DETECTION
        stamp : float
            The hypotheses' time, s.
        sensor : SensorModel
        gate_probability : float

        Returns
        -------
        parent, row : (p,) ndarray of int
            Hypothesis and detection of each pair.
        cut : int
            Pairs left out by `splitting.MAX_GATED`.
        """
        if not len(self) or not len(detections):
            return np.zeros(0, np.int64), np.zeros(0, np.int64), 0
        widest = detections[np.argmax(detections["azimuth_std"])].copy()
        widest["range_std"] = detections["range_std"].max()  # nan: the sensor model's
        positions = np.ascontiguousarray(self.state[:, 0::2])
        error = major_sigma(covariance_at(np.broadcast_to(widest, len(self)), positions, sensor))
        lag = np.abs(detections["time"] - stamp).max()
        spread = major_sigma(self.covariance[:, 0::2, 0::2])
        drift = major_sigma(self.covariance[:, 1::2, 1::2])
        sigma = np.hypot(spread + lag * drift, GATE_MARGIN * error)
        speed = np.hypot(self.state[:, 1], self.state[:, 3])
        radius = kalman.gate_reach(gate_probability, detections) * sigma + lag * speed
        return splitting.neighbours(np.ascontiguousarray(detections["position"]), positions, radius)

    def innovations(
        self, parent: IntArray, found: NDArray[np.void], stamp: float, sensor: SensorModel
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """How far detections are from where hypotheses expect them.

        Parameters
        ----------
        parent : (p,) ndarray of int
            Hypotheses.
        found : (p,) ndarray of DETECTION
        stamp : float
            The hypotheses' time, s.
        sensor : SensorModel

        Returns
        -------
        lag : (p,) ndarray
            Time after the stamp, s.
        innovation : (p, 2) ndarray
            m.
        spread : (p, 2, 2) ndarray
            Its covariance S, m^2.
        """
        lag = found["time"] - stamp
        innovation, spread = kalman.innovations(
            self.state[parent], self.covariance[parent], lag, found, sensor
        )
        return lag, innovation, spread

    def updated(
        self,
        parent: IntArray,
        found: NDArray[np.void],
        ids: IntArray,
        score: FloatArray,
        beside: FloatArray,
        stamp: float,
        sensor: SensorModel,
    ) -> Hypotheses:
        """The children of hypotheses and detections, with their scores; as in `innovations`.

        The position comes first, then the range rate, where there is one.
        """
        lag, innovation, spread = self.innovations(parent, found, stamp, sensor)
        children = self.extended(parent, ids)
        state, covariance = kalman.update(
            children.state, children.covariance, lag, innovation, spread
        )
        state, covariance = range_rates.update(state, covariance, lag, found)
        return replace(children, state=state, covariance=covariance, score=score, beside=beside)

    def best_of_last_hit(self, number: int, margin: float) -> BoolArray:
        """Which are among the best `number` with the same last hit, and within `margin`, (n,).

        A margin below 0, to the best one's score.
        """
        _, group = np.unique(self.last_hit, return_inverse=True)
        best = grouped.largest_of(self.score, group, len(self))[group]
        return (places(group, self.score) < number) & (self.score > best + margin)

    @classmethod
    def none(cls, window: int) -> Hypotheses:
        """No hypotheses."""
        count = np.zeros(0, np.int64)
        return cls(
            np.zeros((0, window), np.int64),
            count,
            count,
            np.zeros((0, 4)),
            np.zeros((0, 4, 4)),
            np.zeros(0),
            np.zeros(0),
        )
