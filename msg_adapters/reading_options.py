"""What a detection message does not say about itself."""

from __future__ import annotations

import math
from dataclasses import dataclass

BEARING_REFERENCES = ("bow", "north")
"""What a `bearing` may be measured from, clockwise."""

SOUND_SPEED = 1500.0
"""Speed of sound where nobody says, m/s."""


@dataclass(frozen=True)
class ReadingOptions:
    """What a message does not say about itself.

    Parameters
    ----------
    bearing_reference : {"bow", "north"}
        What a field `bearing` is measured from, clockwise.
    sound_speed : float
        m/s, where a message gives neither times nor, if it has a place for it, the sound speed; 0:
        not known.

    Raises
    ------
    ValueError
        If a value is not allowed.
    """

    bearing_reference: str = "bow"
    sound_speed: float = 0.0

    def __post_init__(self) -> None:
        if self.bearing_reference not in BEARING_REFERENCES:
            raise ValueError(
                f"bearing_reference must be one of {', '.join(BEARING_REFERENCES)}; "
                f"got {self.bearing_reference!r}"
            )
        if not 0.0 <= self.sound_speed < math.inf:
            raise ValueError(f"sound_speed must be finite and not negative; got {self.sound_speed}")
