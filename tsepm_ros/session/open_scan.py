"""The messages of a scan that is not complete, and what they have looked at."""

from __future__ import annotations

import math
from bisect import insort
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.own_ship.registration import SensorScan
from tsepm_ros.sensing.arcs import turned

TURN = 2 * math.pi


class Part(NamedTuple):
    """A message of the open scan, sorted by stamp.

    Attributes
    ----------
    stamp : float
        s.
    number : int
        Number of the message.
    beam : float
        Azimuth since the seam, along the turn, rad.
    message : SensorScan
    """

    stamp: float
    number: int
    beam: float
    message: SensorScan


@dataclass
class OpenScan:
    """The messages of a scan that is not complete."""

    parts: list[Part] = field(default_factory=list)
    detections: int = 0

    def add(self, part: Part) -> None:
        """Add a message in its place."""
        insort(self.parts, part, key=lambda each: each[:2])
        self.detections += len(part.message.scan)

    @property
    def first(self) -> SensorScan:
        """The first message."""
        return self.parts[0].message


def looked_at(messages: Sequence[SensorScan], step: float) -> FloatArray | None:
    """The arc that messages are known to have looked at; None for a whole turn.

    Parameters
    ----------
    messages : sequence of SensorScan
        In order.
    step : float
        Step of the beam, of which half is added at both ends, rad.

    Returns
    -------
    (2,) ndarray or None
        As `swept` in `Scan`.
    """
    arcs = [message.beams for message in messages if message.beams is not None]
    if not arcs:
        return np.zeros(2)
    middle = np.unwrap([arc.middle for arc in arcs])
    half = np.array([0.5 * arc.width for arc in arcs]) + 0.5 * step
    low, high = float((middle - half).min()), float((middle + half).max())
    if high - low >= TURN:
        return None
    return np.array([turned(low), high - low])
