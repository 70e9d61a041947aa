"""Options for reading detection messages: properties that a message does not contain."""

from __future__ import annotations

import math
from dataclasses import dataclass

from tsepm_ros.sensing.sensor import SensorModel

BEARING_REFERENCES = ("bow", "north")
"""Reference directions of a `bearing`, which is positive clockwise."""

SOUND_SPEED = 1500.0
"""Default speed of sound, m/s."""


@dataclass(frozen=True)
class ReadingOptions:
    """Properties that a message does not contain.

    Parameters
    ----------
    bearing_reference : {"bow", "north"}
        Reference direction of a field `bearing`, which is positive clockwise.
    sound_speed : float
        m/s, for messages without times, or with an unset field for the sound speed; 0: unknown.
    sensor : SensorModel, optional
        Its range errors, by which rays of one object differ.

    Raises
    ------
    ValueError
        If a value is not allowed.
    """

    bearing_reference: str = "bow"
    sound_speed: float = 0.0
    sensor: SensorModel | None = None

    def __post_init__(self) -> None:
        if self.bearing_reference not in BEARING_REFERENCES:
            raise ValueError(
                f"bearing_reference must be one of {', '.join(BEARING_REFERENCES)}; "
                f"got {self.bearing_reference!r}"
            )
        if not 0.0 <= self.sound_speed < math.inf:
            raise ValueError(f"sound_speed must be finite and not negative; got {self.sound_speed}")
