"""The track score: log-likelihood ratios of hits and misses.

Evidence for a target against clutter: log-likelihood ratios.

Each hypothesis assigns certain detections, at most one a scan, to a target. Its score is the
log-likelihood ratio of this assignment against clutter only (Sittler 1964; Bar-Shalom, Blackman,
Fitzgerald, "Dimensionless score function for multiple hypothesis tracking", IEEE Trans. Aerosp.
Electron. Syst. 43(1), 2007). In clutter alone, the mean of the ratio over all hypotheses of a start
is a martingale of mean 1: the probability that it ever reaches A is at most 1 / A (Ville 1939, Wald
1945). This bound does not hold for the best hypothesis alone.

Where hypotheses expect their targets' detections, and how exactly.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.methods.score.hypotheses import Hypotheses
from tsepm_ros.numerics.arrays import FloatArray, IntArray, taken
from tsepm_ros.tracker import motion, range_rates, splitting
from tsepm_ros.tracker.measurement import covariance_at, major_sigma
from tsepm_ros.tracker.sensor import MIN_CLUTTER_DENSITY, SensorModel

MAX_DETECTION_PROBABILITY = 0.999
"""A miss must stay possible: targets fade, also where P_D is given as 1."""


def hit_increment(
    log_density: FloatArray, detection_probability: float | FloatArray, clutter: FloatArray
) -> FloatArray:
    """Score increment of a hit: ``ln(P_D N(z; H x, S) / lambda)``.

    Parameters
    ----------
    log_density : (n,) ndarray
        ln N, the density of the detection under the hypothesis, in the coordinates of the clutter
        density.
    detection_probability : float or (n,) ndarray
        P_D where the hypothesis expects its target; where it is 0, the increment is -inf.
    clutter : (n,) ndarray
        lambda at the detection: the density of its other possible causes, 1/m^2.

    Returns
    -------
    (n,) ndarray
    """
    probability = np.minimum(detection_probability, MAX_DETECTION_PROBABILITY)
    with np.errstate(divide="ignore"):
        ratio = np.log(probability / np.maximum(clutter, MIN_CLUTTER_DENSITY))
    increment: FloatArray = log_density + ratio
    return increment


def miss_increment(detection_probability: FloatArray, gate_probability: float) -> FloatArray:
    """Score increment, below 0, of a miss: ``ln(1 - P_D P_G)``; 0 where nothing can be detected.

    Parameters
    ----------
    detection_probability : (n,) ndarray
        P_D.
    gate_probability : float
        P_G: a detection outside the gate is missed too.

    Returns
    -------
    (n,) ndarray
    """
    increment: FloatArray = np.log1p(
        -np.minimum(detection_probability, MAX_DETECTION_PROBABILITY) * gate_probability
    )
    return increment


GATE_MARGIN = 1.5
"""The error at the predicted position may be this much larger than at the detection's."""
ROUNDING = 1e-9
"""Relative margin of a gate's radius beyond rounding errors."""
_ERRORS = (
    "time",
    "range_std",
    "azimuth_std",
    "least_across",
    "sensor_pose",
    "sensor_pose_covariance",
)
"""What the innovation covariance of a hypothesis and a detection depends on."""


@dataclass(frozen=True, eq=False)
class ExpectedDetections:
    """What hypotheses expect of a scan's detections.

    Where the detections have one time and one error model, as without times and poses of their own,
    the innovation covariance, the gain and the updated covariance depend on the hypothesis alone.

    Attributes
    ----------
    hypotheses : Hypotheses
        Predicted to the scan.
    stamp : float
        The scan's, s.
    detections : (d,) ndarray of DETECTION
    sensor : SensorModel
    of_hypothesis : tuple of (n, 2) and (n, 2, 2) ndarray, or None
        Expected position, m, and innovation covariance, m^2, of any detection; None where these
        differ from detection to detection.
    has_range_rates : bool
        Whether any detection has a range rate that is used.
    """

    hypotheses: Hypotheses
    stamp: float
    detections: NDArray[np.void]
    sensor: SensorModel
    of_hypothesis: tuple[FloatArray, FloatArray] | None
    has_range_rates: bool

    @classmethod
    def of(
        cls,
        hypotheses: Hypotheses,
        stamp: float,
        detections: NDArray[np.void],
        sensor: SensorModel,
    ) -> ExpectedDetections:
        """What hypotheses that are predicted to a scan expect of its detections."""
        common = None
        if len(detections) and len(hypotheses) and _alike(detections):
            first = detections[:1]
            after = first["time"] - stamp
            expected = motion.position_after(hypotheses.state, after)
            spread = motion.position_covariance_after(hypotheses.covariance, after)
            spread += covariance_at(first, expected, sensor)
            common = expected, spread
        rated = bool(range_rates.measured(detections).any())
        return cls(hypotheses, stamp, detections, sensor, common, rated)

    def near(
        self, gate_probability: float, late: Callable[[], bool] | None = None
    ) -> tuple[IntArray, IntArray, int]:
        """Pairs of hypotheses and detections, no fewer than lie in the gates.

        Where it is `late`, only the nearest detections of each hypothesis.

        Returns
        -------
        hypothesis, detection : (p,) ndarray of int
            Rows of each pair, ascending.
        cut : int
            Pairs left out by a limit, see `splitting.neighbours`.
        """
        detections = self.detections
        if not len(self.hypotheses) or not len(detections):
            return np.zeros(0, np.int64), np.zeros(0, np.int64), 0
        reach = motion.gate_reach(gate_probability, detections)
        if self.of_hypothesis is not None:
            centres, spread = self.of_hypothesis
            radius = reach * major_sigma(spread) * (1.0 + ROUNDING)
        else:
            centres, radius = self._widest(reach)
        positions = np.ascontiguousarray(detections["position"])
        return splitting.neighbours(positions, centres, radius, late)

    def _widest(self, reach: float) -> tuple[FloatArray, FloatArray]:
        """Positions of the hypotheses (n, 2), and radii that hold the gate of any detection."""
        state, covariance = self.hypotheses.state, self.hypotheses.covariance
        detections = self.detections
        widest = detections[np.argmax(detections["azimuth_std"])].copy()
        widest["range_std"] = detections["range_std"].max()  # nan: the sensor model's
        positions = np.ascontiguousarray(state[:, 0::2])
        every = np.broadcast_to(widest, len(positions))
        error = major_sigma(covariance_at(every, positions, self.sensor))
        longest = np.abs(detections["time"] - self.stamp).max()
        position_sigma = major_sigma(covariance[:, 0::2, 0::2])
        speed_sigma = major_sigma(covariance[:, 1::2, 1::2])
        sigma = np.hypot(position_sigma + longest * speed_sigma, GATE_MARGIN * error)
        speed = np.hypot(state[:, 1], state[:, 3])
        return positions, reach * sigma + longest * speed

    def innovations(self, parent: IntArray, row: IntArray) -> tuple[FloatArray, FloatArray]:
        """Innovations (p, 2), m, and their covariances (p, 2, 2), m^2, of pairs."""
        if self.of_hypothesis is not None:
            expected, spread = self.of_hypothesis
            innovation = self.detections["position"].take(row, axis=0)
            innovation -= expected.take(parent, axis=0)
            return innovation, spread.take(parent, axis=0)
        detections = taken(self.detections, row)
        return motion.innovations(
            self.hypotheses.state[parent],
            self.hypotheses.covariance[parent],
            detections["time"] - self.stamp,
            detections,
            self.sensor,
        )

    def log_likelihood(
        self, parent: IntArray, row: IntArray, gate_probability: float
    ) -> FloatArray:
        """Log of the likelihood of each pair's detection, (p,); see `kalman.log_likelihood`."""
        innovation, spread = self.innovations(parent, row)
        if not self.has_range_rates:
            return motion.position_log_likelihood(innovation, spread, gate_probability)
        detections = taken(self.detections, row)
        return motion.log_likelihood(
            self.hypotheses.state,
            self.hypotheses.covariance,
            parent,
            detections["time"] - self.stamp,
            innovation,
            spread,
            detections,
            gate_probability,
        )

    def updated(self, parent: IntArray, row: IntArray) -> tuple[FloatArray, FloatArray]:
        """States (p, 4) and covariances (p, 4, 4) of hypotheses, ascending, after a detection.

        The position comes first, then the range rate, where there is one.
        """
        state, covariance = self.hypotheses.state, self.hypotheses.covariance
        innovation, spread = self.innovations(parent, row)
        time_after_state = self.detections["time"][row] - self.stamp
        if self.of_hypothesis is None:
            moved, changed = motion.update(
                state[parent], covariance[parent], time_after_state, innovation, spread
            )
        else:
            # A gain and a covariance for all detections of a hypothesis.
            begins = np.diff(parent, prepend=-1) != 0
            first, place = np.flatnonzero(begins), np.cumsum(begins) - 1
            rows = parent[first]
            before, spread, after = covariance[rows], spread[first], time_after_state[first]
            gain = motion.kalman_gain(before, after, spread)
            change = gain @ spread @ np.swapaxes(gain, -1, -2)
            step = gain.take(place, axis=0) @ innovation[..., None]
            moved = state.take(parent, axis=0) + step[..., 0]
            changed = (before - change).take(place, axis=0)
        if not self.has_range_rates:
            return moved, changed
        return range_rates.update(moved, changed, time_after_state, taken(self.detections, row))


def _alike(detections: NDArray[np.void]) -> bool:
    """Whether all detections have the time, the pose and the errors of the first."""
    for name in _ERRORS:
        values = detections[name]
        same = values == values[0]
        if name == "range_std":  # nan: the sensor model's
            same |= np.isnan(values) & np.isnan(values[0])
        if not same.all():
            return False
    return True
