"""Motion of held targets: constant velocity, interrupted by turns.

Interacting multiple models (Blom, Bar-Shalom, "The interacting multiple model algorithm for systems
with Markovian switching coefficients", IEEE Trans. Autom. Control 33(8), 1988): a target is in one
of two modes, each with its own state and covariance. A manoeuvre during missed detections therefore
stays possible: the covariance of the turning mode grows until a detection excludes the turn.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.kinematics import kalman
from tsepm_ros.numerics.arrays import FloatArray, IntArray
from tsepm_ros.numerics.gaussian import mixture

PROCESS_NOISE = 0.01
"""Spectral density of the acceleration between turns, m^2/s^3: 1 m/s per 100 s."""
SCANS_TO_TURN = 30.0
"""Mean number of scans between turns or changes of speed: a choice."""
GOES_ON = 0.5
"""Probability that a turn goes on at the next scan: a choice."""
TURN_TIME = 5.0
"""Least time in which a target of any speed has turned, s."""
MIN_MODE_PROBABILITY = 1e-30
"""Floor of a mode's probability, which keeps its state defined."""


@dataclass(frozen=True, eq=False)
class InteractingModels:
    """States of tracks in the two modes: constant velocity and turning.

    Attributes
    ----------
    probability : (2, n) ndarray
        Probability of each mode.
    state, covariance : (2, n, 4), (2, n, 4, 4) ndarray
        State and its covariance in each mode.
    """

    probability: FloatArray
    state: FloatArray
    covariance: FloatArray

    @classmethod
    def of(cls, state: FloatArray, covariance: FloatArray) -> InteractingModels:
        """Tracks with states (n, 4), covariances (n, 4, 4) and stationary mode probabilities."""
        turning = 1.0 / (1.0 + SCANS_TO_TURN * (1.0 - GOES_ON))
        probability = np.array([[1.0 - turning], [turning]]).repeat(len(state), axis=1)
        return cls(probability, np.stack([state, state]), np.stack([covariance, covariance]))

    def predicted(self, elapsed: FloatArray, max_speed: float) -> InteractingModels:
        """Predict the tracks to the next scan, over times (n,), s, of either sign.

        The states are mixed by the probabilities p_ij of a change from mode i to mode j::

            mu_j <- sum_i p_ij mu_i,    x_j <- sum_i p_ij mu_i x_i / mu_j

        and predicted. A turn begins with ``1 / SCANS_TO_TURN`` and goes on with `GOES_ON`. It ends
        at an unknown velocity of at most v_max: the variance of each component grows by
        v_max^2 / 4 over `TURN_TIME`.
        """
        begun = 1.0 / SCANS_TO_TURN
        change = np.array([[1.0 - begun, begun], [1.0 - GOES_ON, GOES_ON]])[..., None]
        joint = change * np.maximum(self.probability, MIN_MODE_PROBABILITY)[:, None]
        probability = joint.sum(axis=0)
        longest = max(float(np.abs(elapsed).max(initial=0.0)), TURN_TIME)
        turn_noise = (0.5 * max_speed) ** 2 / longest
        mixed = mixture(joint / probability, self.state[:, None], self.covariance[:, None])
        noise = np.array([[PROCESS_NOISE], [PROCESS_NOISE + turn_noise]])
        return InteractingModels(probability, *kalman.predict(*mixed, elapsed, noise))

    def combined(self) -> tuple[FloatArray, FloatArray]:
        """Mean (n, 4) and covariance (n, 4, 4) over both modes."""
        return mixture(self.probability, self.state, self.covariance)

    def modes(self) -> Iterator[tuple[FloatArray, FloatArray, FloatArray]]:
        """Probability (n,), state (n, 4) and covariance (n, 4, 4) of each mode."""
        return zip(self.probability, self.state, self.covariance, strict=True)

    def with_rows(self, rows: IntArray, other: InteractingModels) -> InteractingModels:
        """The tracks, with the given rows replaced by the tracks of `other`."""
        replaced = InteractingModels(
            self.probability.copy(), self.state.copy(), self.covariance.copy()
        )
        replaced.probability[:, rows] = other.probability
        replaced.state[:, rows] = other.state
        replaced.covariance[:, rows] = other.covariance
        return replaced

    def where(self, rows: NDArray[np.generic]) -> InteractingModels:
        """The tracks in the given rows (indices or a mask)."""
        return InteractingModels(
            self.probability[:, rows], self.state[:, rows], self.covariance[:, rows]
        )

    def joined(self, other: InteractingModels) -> InteractingModels:
        """These tracks, followed by those of `other`."""
        return InteractingModels(
            np.concatenate([self.probability, other.probability], axis=1),
            np.concatenate([self.state, other.state], axis=1),
            np.concatenate([self.covariance, other.covariance], axis=1),
        )
