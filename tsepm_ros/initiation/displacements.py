"""The steps from hit to hit that rules of speed, acceleration and direction look at."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsepm_ros.numerics.arrays import BoolArray, FloatArray
from tsepm_ros.numerics.rows import Rows


@dataclass(frozen=True)
class Displacements(Rows):
    """Two steps that follow each other, a row each.

    Attributes
    ----------
    before, after : (p, 2) ndarray
        From the hit before the last to the last, and from there on, m.
    time_before, time_after : (p,) ndarray
        Times of the steps, s.
    """

    before: FloatArray
    after: FloatArray
    time_before: FloatArray
    time_after: FloatArray

    @classmethod
    def of(cls, position: FloatArray, time: FloatArray) -> Displacements:
        """The steps between three positions (p, 3, 2), m, at times (p, 3), s."""
        step, elapsed = np.diff(position, axis=1), np.diff(time, axis=1)
        return cls(step[:, 0], step[:, 1], elapsed[:, 0], elapsed[:, 1])

    @property
    def acceleration(self) -> FloatArray:
        """Change of velocity over the time between the middles of the steps, (p,), m/s^2.

        For steps of one duration T it is ``|(r_3 - r_2) - (r_2 - r_1)| / T^2``; nan or infinite
        where a step takes no time.
        """
        with np.errstate(invalid="ignore", divide="ignore"):
            change = self.after / self.time_after[:, None] - self.before / self.time_before[:, None]
            time = 0.5 * (self.time_before + self.time_after)
            return np.hypot(change[:, 0], change[:, 1]) / np.abs(time)

    def faster_than(self, speed: float) -> BoolArray:
        """Whether the steps after have at least a speed (m/s), (p,)."""
        length = np.hypot(self.after[:, 0], self.after[:, 1])
        return np.asarray(length >= speed * np.abs(self.time_after))

    @property
    def turn(self) -> FloatArray:
        """Angle between the steps, (p,), rad; 0 where one has no length."""
        along = (self.before * self.after).sum(axis=1)
        across = self.before[:, 0] * self.after[:, 1] - self.before[:, 1] * self.after[:, 0]
        return np.abs(np.arctan2(across, along))
