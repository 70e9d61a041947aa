"""How held targets move: they go on as they are, turn for a while, and go on.

Interacting multiple models (Blom, Bar-Shalom, "The interacting multiple model algorithm for systems
with Markovian switching coefficients", IEEE Trans. Autom. Control 33(8), 1988): a target is in one
of two modes, and each has a state of its own. What a target did while it was not seen is not
forgotten so: the mode in which it turned spreads as long as nothing says that it did not.
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
"""Spectral density of a target's acceleration while it goes on, m^2/s^3: 1 m/s per 100 s."""
TIME_TO_TURN = 100.0
"""Mean time after which a target that goes on turns or changes its speed, s."""
TIME_OF_TURN = 5.0
"""Mean time that it takes to, s."""
LEAST_PROBABILITY = 1e-30
"""Floor of a mode's probability: its state stays defined."""


def stay_or_change(
    time: FloatArray, time_to_begin: float, time_to_end: float
) -> tuple[FloatArray, FloatArray]:
    """Probabilities that something which begins and ends at random is so after a time.

    With the rates ``a = 1 / time_to_begin``, ``b = 1 / time_to_end`` and
    ``e = exp(-(a + b) t)``: ``a / (a + b) (1 - e)`` where it was not so, and with
    ``+ e`` where it was.

    Parameters
    ----------
    time : (n,) ndarray
        t, s.
    time_to_begin, time_to_end : float
        Mean times, s.

    Returns
    -------
    begun, still : (n,) ndarray
        Probability where it was not so, and where it was.
    """
    begin, end = 1.0 / time_to_begin, 1.0 / time_to_end
    left = np.exp(-(begin + end) * time)
    begun = begin / (begin + end) * (1.0 - left)
    return begun, begun + left


@dataclass(frozen=True, eq=False)
class InteractingModels:
    """States of tracks in the two modes: going on and turning.

    Attributes
    ----------
    probability : (2, n) ndarray
        Of each mode.
    state, covariance : (2, n, 4), (2, n, 4, 4) ndarray
        In it.
    """

    probability: FloatArray
    state: FloatArray
    covariance: FloatArray

    @classmethod
    def of(cls, state: FloatArray, covariance: FloatArray) -> InteractingModels:
        """Tracks of which nothing is known but states (n, 4) and covariances (n, 4, 4)."""
        turning = 1.0 / TIME_TO_TURN / (1.0 / TIME_TO_TURN + 1.0 / TIME_OF_TURN)
        probability = np.array([[1.0 - turning], [turning]]).repeat(len(state), axis=1)
        return cls(probability, np.stack([state, state]), np.stack([covariance, covariance]))

    def predicted(self, step: FloatArray, max_speed: float) -> InteractingModels:
        """The tracks after time steps (n,), s, of either sign.

        The states are mixed as the modes may have changed, with the probabilities p_ij of it::

            mu_j <- sum_i p_ij mu_i,    x_j <- sum_i p_ij mu_i x_i / mu_j

        and carried on. A turn ends at a velocity that is unknown up to v_max: its components grow
        to a variance of v_max^2 / 4 over `TIME_OF_TURN`.
        """
        begun, still = stay_or_change(np.abs(step), TIME_TO_TURN, TIME_OF_TURN)
        change = np.array([[1.0 - begun, begun], [1.0 - still, still]])
        joint = change * np.maximum(self.probability, LEAST_PROBABILITY)[:, None]
        probability = joint.sum(axis=0)
        longest = max(float(np.abs(step).max(initial=0.0)), TIME_OF_TURN)
        turn = (0.5 * max_speed) ** 2 / longest
        modes = [
            kalman.predict(*mixture(share, self.state, self.covariance), step, noise)
            for share, noise in zip(
                np.swapaxes(joint / probability, 0, 1),
                (PROCESS_NOISE, PROCESS_NOISE + turn),
                strict=True,
            )
        ]
        return InteractingModels(
            probability,
            np.stack([state for state, _ in modes]),
            np.stack([covariance for _, covariance in modes]),
        )

    def combined(self) -> tuple[FloatArray, FloatArray]:
        """Mean (n, 4) and covariance (n, 4, 4) over the modes."""
        return mixture(self.probability, self.state, self.covariance)

    def modes(self) -> Iterator[tuple[FloatArray, FloatArray, FloatArray]]:
        """Probability (n,), state (n, 4) and covariance (n, 4, 4) of each mode."""
        return zip(self.probability, self.state, self.covariance, strict=True)

    def with_rows(self, rows: IntArray, other: InteractingModels) -> InteractingModels:
        """The tracks with those in some rows replaced by others."""
        made = InteractingModels(self.probability.copy(), self.state.copy(), self.covariance.copy())
        made.probability[:, rows] = other.probability
        made.state[:, rows] = other.state
        made.covariance[:, rows] = other.covariance
        return made

    def where(self, rows: NDArray[np.generic]) -> InteractingModels:
        """The tracks in the given rows (indices or a mask)."""
        return InteractingModels(
            self.probability[:, rows], self.state[:, rows], self.covariance[:, rows]
        )

    def joined(self, other: InteractingModels) -> InteractingModels:
        """These tracks and then others."""
        return InteractingModels(
            np.concatenate([self.probability, other.probability], axis=1),
            np.concatenate([self.state, other.state], axis=1),
            np.concatenate([self.covariance, other.covariance], axis=1),
        )
