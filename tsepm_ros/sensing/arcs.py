"""Arcs of azimuths."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray


class Arc(NamedTuple):
    """An arc of azimuths.

    Attributes
    ----------
    start, width : float
        rad; the width from 0 to 2 pi, counter-clockwise.
    whole : bool
        Whether all beams of the message are known: those without a detection, too.
    """

    start: float
    width: float
    whole: bool = False

    @property
    def middle(self) -> float:
        """Azimuth of its middle, rad."""
        return self.start + 0.5 * self.width


def arc_of(azimuth: FloatArray) -> Arc | None:
    """The smallest arc that holds azimuths (n,), rad; None if none is finite."""
    known = np.sort(np.mod(azimuth[np.isfinite(azimuth)], 2 * np.pi), kind="stable")
    if not len(known):
        return None
    gaps = np.diff(known, append=known[0] + 2 * np.pi)
    last = int(np.argmax(gaps))
    return Arc(float(known[(last + 1) % len(known)]), float(2 * np.pi - gaps[last]))


def turned(angle: float) -> float:
    """An angle wrapped to [-pi, pi), rad."""
    return math.remainder(angle, 2 * math.pi)
