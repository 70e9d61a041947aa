"""At which pings of a fast sonar the spacing of detections is looked at."""

from __future__ import annotations

import math
from dataclasses import dataclass

INTERVAL = 0.2
"""Mean time between looks, s: targets stay as close together for longer. A choice."""
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
"""Step of the share of `INTERVAL`: times between looks never fall into step with the pings."""


@dataclass(frozen=True)
class Looks:
    """Looks `INTERVAL` apart on average, between half of it and one and a half.

    Pings less than half of `INTERVAL` apart are not all looked at; pings more than one and a half
    apart are.

    Attributes
    ----------
    last : float or None
        Stamp of the last look, s; None before the first.
    number : int
        Looks so far.
    """

    last: float | None = None
    number: int = 0

    def is_due(self, stamp: float) -> bool:
        """Whether a ping at a stamp, s, is to be looked at."""
        share = (self.number * GOLDEN) % 1.0
        return self.last is None or stamp >= self.last + INTERVAL * (0.5 + share)

    def elapsed(self, stamp: float) -> float:
        """Time since the last look, s; 0 before the first."""
        return 0.0 if self.last is None else stamp - self.last

    def after(self, stamp: float) -> Looks:
        """With a look at a stamp, s."""
        return Looks(stamp, self.number + 1)
