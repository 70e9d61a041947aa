"""Which neighbouring rays of a fan see one object."""

from __future__ import annotations

import math

import numpy as np

from tsepm_ros.numerics.arrays import BoolArray, FloatArray
from tsepm_ros.sensing.sensor import SensorModel

GRAZING_ANGLE = math.radians(20.0)
"""Least angle between a ray and a surface that is one object."""
NOISE_DEVIATIONS = 3.0
"""Standard deviations of a jump within which it may be noise."""
COARSEST_FAN = math.radians(3.0)
"""Angle between rays from which on neighbours are of different objects."""


def goes_on(
    before: FloatArray, after: FloatArray, increment: float, sensor: SensorModel | None = None
) -> BoolArray:
    """Whether the ranges of neighbouring rays do not jump.

    The jump is that of a surface which is hit at `GRAZING_ANGLE`, as in the adaptive breakpoints of
    Borges, Aldon, "Line extraction in 2D range images for mobile robotics", J. Intell. Robot. Syst.
    40(3), 2004, with the errors s of both ranges:
    ``|r_i - r_(i-1)| <= r sin(increment) / sin(angle - increment) + 3 sqrt(2) s``. In a coarse fan
    every range jumps.

    Parameters
    ----------
    before, after : (n,) ndarray
        m; a range that is not finite and above 0 always jumps.
    increment : float
        Angle between the rays, rad.
    sensor : SensorModel, optional
        Its range errors; without it there are none.

    Returns
    -------
    (n,) ndarray of bool
    """
    if not abs(increment) <= COARSEST_FAN:  # nan, too
        return np.zeros(len(before), bool)
    slope = math.sin(abs(increment)) / math.sin(GRAZING_ANGLE - abs(increment))
    with np.errstate(invalid="ignore", over="ignore"):
        nearer = np.minimum(before, after)
        variance = 0.0 if sensor is None else sensor.range_variance(nearer)
        noise = NOISE_DEVIATIONS * np.sqrt(2.0 * variance)
        near = np.abs(after - before) <= slope * nearer + noise
        seen = np.isfinite(before) & np.isfinite(after) & (before > 0.0) & (after > 0.0)
    return np.asarray(near & seen)
