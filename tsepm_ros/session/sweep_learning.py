"""Whether messages are parts of a sweep, from the azimuths that they look at.

A message of a sensor that turns its beam looks at a small arc, and the arcs move at a constant rate
through a whole turn, or to and fro. Messages of a sonar that looks everywhere at once do not: their
arcs are wide, stay, or jump. Where a message lists only its detections, a single object seen from a
turning vessel moves like a beam: the ranges of that do not change from message to message.
"""

from __future__ import annotations

import math
import statistics
from collections import deque
from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from tsepm_ros.own_ship.registration import SensorScan
from tsepm_ros.tracker.scan import Arc, turned

WIDEST_PART = 0.5 * math.pi
"""Widest arc of a message of a sweep, and longest step between two, rad."""
MIN_PARTS, MIN_PARTS_OF_ECHOES = 4, 16
"""Least messages of a turn or sector: of all beams, and of detections only."""
MOST_PARTS = 20_000
"""Most messages of a turn."""
EVEN_RATES = 0.8
"""Least share of steps whose rate differs from the median by less than a factor of 2."""
LONGEST_OVERLAP = 0.5
"""Largest part of a message's arc that the next one may look at again."""
RANGE_CHANGE, CHANGES = 0.1, 0.25
"""Least change of the range, as a part of it, and least share of changes, of detections only."""
SECTOR_TOLERANCE = 0.2
"""Largest difference of two passes over a sector, as a part of it."""


class Turning(NamedTuple):
    """What was learned of a sweep: time of a turn or of a pass over the sector (s)."""

    seconds: float
    parts: int


@dataclass
class Pass:
    """Messages whose azimuths move in one direction.

    Attributes
    ----------
    times, azimuths, ranges : list of float
        Stamp (s), unwrapped middle of the arc (rad), and median range (m; nan without detections).
    widths : list of float
        Of the arcs, rad.
    whole : bool
        Whether the messages list all beams.
    """

    times: list[float] = field(default_factory=list)
    azimuths: list[float] = field(default_factory=list)
    ranges: list[float] = field(default_factory=list)
    widths: list[float] = field(default_factory=list)
    whole: bool = True

    def add(self, message: SensorScan, arc: Arc, azimuth: float) -> None:
        """Add a message at an unwrapped azimuth, rad."""
        scan = message.scan
        self.times.append(scan.stamp)
        self.azimuths.append(azimuth)
        self.ranges.append(float(np.median(scan.range)) if len(scan) else math.nan)
        self.widths.append(arc.width)
        self.whole = self.whole and arc.whole

    @property
    def extent(self) -> float:
        """Azimuth passed, rad, positive counter-clockwise."""
        return self.azimuths[-1] - self.azimuths[0]

    @property
    def seconds(self) -> float:
        """Time from the first to the last message."""
        return self.times[-1] - self.times[0]

    def is_sweep(self) -> bool:
        """Whether the messages are those of a beam that turns at a constant rate."""
        if len(self.times) < (MIN_PARTS if self.whole else MIN_PARTS_OF_ECHOES):
            return False
        steps = np.abs(np.diff(self.azimuths))
        rates = steps / np.diff(self.times)
        middle = float(np.median(rates))
        even = (rates < 2.0 * middle) & (rates > 0.5 * middle)
        apart = np.median(steps) >= LONGEST_OVERLAP * np.median(self.widths)
        return bool(middle > 0.0 and even.mean() >= EVEN_RATES and apart and self._varied())

    def _varied(self) -> bool:
        """Whether the messages see different objects, where they list detections only."""
        if self.whole:
            return True
        known = [value for value in self.ranges if math.isfinite(value)]
        changed = [abs(b - a) > RANGE_CHANGE * min(a, b) for a, b in pairwise(known)]
        return bool(changed) and statistics.mean(changed) >= CHANGES


class SweepLearner:
    """Looks for a sweep in messages as they arrive."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget the messages so far."""
        self._pass = Pass()
        self._before: deque[Pass] = deque(maxlen=2)

    def take(self, message: SensorScan) -> Turning | None:
        """Look at the next message; return what is learned with it, if it is a sweep's."""
        arc, known = message.beams, self._pass
        if arc is None:
            return None
        if arc.width > WIDEST_PART:
            self.reset()
            return None
        if not known.times:
            known.add(message, arc, arc.middle)
            return None
        step = turned(arc.middle - known.azimuths[-1])
        if message.scan.stamp <= known.times[-1] or step == 0.0:
            return None
        turns_back = len(known.times) > 1 and step * known.extent < 0.0
        if abs(step) > WIDEST_PART or turns_back:
            return self._turn_back(message, arc)
        known.add(message, arc, known.azimuths[-1] + step)
        if abs(known.extent) < 2 * math.pi and len(known.times) < MOST_PARTS:
            return None
        if abs(known.extent) >= 2 * math.pi and known.is_sweep():
            return Turning(known.seconds * 2 * math.pi / abs(known.extent), len(known.times))
        self._pass = Pass()  # a chance: from here anew
        return None

    def _turn_back(self, message: SensorScan, arc: Arc) -> Turning | None:
        """End a pass; two in a row over the same sector are a sweep."""
        self._before.append(self._pass)
        last = self._pass
        self._pass = Pass()
        self._pass.add(message, arc, arc.middle)
        if len(self._before) < 2:
            return None
        one, two = self._before
        if not (one.is_sweep() and two.is_sweep()):
            return None
        limit = SECTOR_TOLERANCE * abs(one.extent)
        alike = abs(abs(one.extent) - abs(two.extent)) <= limit
        wide = abs(one.extent) >= 3.0 * max(one.widths + two.widths)
        middles = [0.5 * (each.azimuths[0] + each.azimuths[-1]) for each in (one, two)]
        if not (alike and wide and abs(turned(middles[0] - middles[1])) <= limit):
            return None
        return Turning(two.times[0] - one.times[0], len(last.times))
