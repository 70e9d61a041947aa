"""The background that each cell has of its own: what its past predicts of it.

A wall, a pile, its shadow and the texture of the ground stand in the same cells of every image of a
sensor that does not move. Each cell has a running mean ``m`` of the values ``x`` and a running mean
``e`` of the absolute deviations of the smoothed ones; ``s`` is the median of ``e`` over the cells::

    z  = smoothed(normalised(x - b m)),    z' = z ((e + K s) / s)^-c

The data say how far the past predicts: ``b`` and ``c`` are regressions over the cells of each
image, in 0 to 1. Both are near 0 in noise and where the sensor moves, and ``b`` is near 1 at walls.

Values count up to `REACH` mean deviations. A cell that something has *entered* is frozen, up to
`HOLD` images; a cell that it has *left* learns in a few images; all cells are learned anew where
many have changed at once.
"""

from __future__ import annotations

import numpy as np

from tsepm_ros.detector.range_profile import Image
from tsepm_ros.numerics.arrays import BoolArray

MEMORY = 40
"""Images over which a cell's mean and deviation are learned."""
FIRST = 4
"""Images of which means are learned before they predict, and deviations from them are."""
PRIOR = 8
"""Images as many as which the median deviation counts for each cell's own."""
SETTLED = 15
"""Images before cells are frozen."""
REACH = 3.1
"""Mean deviations up to which a value counts, 2.5 standard deviations of a normal law."""
LEAST = 0.5
"""Part of the median deviation that is the least reach of a cell is counted in."""
KAPPA = 0.1
"""Part of the median deviation that is added to each."""
RECENT = 5.0
"""Images over which it is said that something entered, or left."""
CHANGE = 2.0
"""Mean deviations by which the mean of these images is another then."""
EACH = 30
"""Images after which a cell learns with every second one."""
OFTEN = 4
"""Images of which one makes the scale of the cells anew."""
HOLD = 400
"""Most images for which a cell is frozen."""
CHANGED = 0.25
"""Part of the cells that have changed from which on all are learned anew."""
BLOCK = 4
"""Cells, each way, of a block of the regression of means: their noise lowers it."""
MOST = 9.0
"""Largest mean of a block that counts there."""
ALIKE = 1e-4
"""Variance of the logarithms of deviations that are alike."""
STEP = 3
"""Cells, each way, of which one is taken for the regression of deviations."""


def predicted(x: Image, mean: Image) -> float:
    """How far means predict an image, over blocks of cells: ``b = sum x m / sum m^2``."""
    now, past = (np.clip(_blocks(a), -MOST, MOST) for a in (x, mean))
    return float(np.clip(np.vdot(now, past) / max(float(np.vdot(past, past)), 1e-9), 0.0, 1.0))


def _blocks(a: Image) -> Image:
    """Means of blocks of cells (b, m)."""
    b, m = (min(BLOCK, n) for n in a.shape)
    rows = a[: len(a) // b * b, : a.shape[1] // m * m].reshape(len(a) // b, b, -1).sum(axis=1)
    return np.asarray(rows.reshape(len(rows), -1, m) @ np.full(m, 1.0 / (b * m), np.float32))


def power(z: Image, deviation: Image, median: float) -> float:
    """How far deviations predict the absolute values of an image: the slope of the logarithms.

    ``c = sum log|z| (v - mean v) / sum (v - mean v)^2``, with ``v = log(e + K s)``.
    """
    some = slice(None, None, STEP)
    v = np.log(deviation[some, some] + np.float32(KAPPA * median))
    u = np.log(np.maximum(np.abs(z[some, some]), np.float32(KAPPA * median)))
    v -= v.mean()
    return float(np.clip(np.vdot(u, v) / (float(np.vdot(v, v)) + ALIKE * v.size), 0.0, 1.0))


class Background:
    """Learns the background of the cells from image to image, for one box of an echo.

    Attributes
    ----------
    images : int
        Learned since the beginning, or since all was learned anew.
    share : float
        The regression of means, b.
    power : float
        That of deviations, c.
    """

    def __init__(self) -> None:
        self.images, self.share, self.power, self._median = 0, 0.0, 0.0, 0.0

    def expected(self, x: Image) -> Image:
        """What the past predicts of an image, ``b m``."""
        if not self.images:
            self._state = tuple(np.zeros_like(x) for _ in range(5))
            self._mean, self._deviation, _, self._changed, _ = self._state
            self._scale = np.ones((1, 1), np.float32)
        self.share = predicted(x, self._mean) if self.images >= FIRST else 0.0
        return self._mean * np.float32(self.share)

    def scaled(self, z: Image) -> Image:
        """A smoothed image whose deviations are alike, as far as the past predicts them."""
        some = slice(None, None, STEP)
        self._median = float(np.median(self._deviation[some, some]))
        if self.images < FIRST or self._median < 1e-6:
            return z
        now = power(z, self._deviation, self._median)
        self.power += (now - self.power) / min(self.images - FIRST + 1, RECENT)
        if self.images % OFTEN == FIRST % OFTEN:
            even = self._deviation * np.float32(1.0 / self._median) + np.float32(KAPPA)
            self._scale = np.power(even, np.float32(-self.power), out=even)
        return np.asarray(z * self._scale)

    def learn(self, x: Image, z: Image, defined: BoolArray) -> None:
        """Learn an image and its smoothed values, which `scaled` was given."""
        step = 1 if self.images <= EACH else 2
        rows = slice(self.images % step, None, step)
        mean, e, age, changed, held = (state[rows] for state in self._state)
        size, least = np.abs(z[rows]), np.float32(LEAST * self._median + 1e-6)
        far = z[rows] / np.maximum(e, least)
        counted = np.float32(REACH) / np.maximum(np.abs(far), np.float32(REACH))
        far *= counted
        far *= age >= FIRST
        changed += (far - changed) * np.float32(step / RECENT)
        entered, left = changed > CHANGE, changed < -CHANGE
        many = self.share < 0.5 and self.images > SETTLED and np.mean(entered | left) > CHANGED
        frozen = entered & (age >= SETTLED / step) & (held < HOLD)
        held += step
        held *= entered
        again = left | (held >= HOLD)
        if again.any():
            age[again], changed[again] = 2.0, 0.0
        free = defined[rows] & ~frozen
        if self.images < FIRST:
            e[:] = np.median(size[::STEP, ::STEP])
        else:
            limited = size * counted
            limited -= e
            limited *= np.float32(step / min(self.images - FIRST + PRIOR, MEMORY))
            limited *= free
            e += limited
        rate = np.where(age < FIRST, np.float32(1.0), counted)
        rate *= free
        rate /= age + np.float32(1.0)
        rate *= x[rows] - mean
        mean += rate
        np.minimum(age + np.float32(1.0), np.float32(MEMORY / step), out=age)
        self.images += 1
        if many:
            self.images, self.share, self.power = 0, 0.0, 0.0
