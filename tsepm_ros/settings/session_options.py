"""Options of a session."""

from __future__ import annotations

import math
from dataclasses import dataclass

from tsepm_ros.methods.registry import available_methods
from tsepm_ros.own_ship.frame_axes import east_north_up
from tsepm_ros.parameters import check_group, parameter

OWN_SHIP_SOURCES = ("none", "odometry", "tf")
"""Sources of the sensor's pose."""
MAX_SWEEP = 600.0
"""Longest time of a turn, s."""


@dataclass(frozen=True, kw_only=True)
class SessionOptions:
    """Method, frames, and limits on the times of arriving data.

    Raises
    ------
    ValueError
        Naming the option whose value is not allowed.
    """

    method: str = parameter("score", "Track initiation method", choices=available_methods())
    own_ship_source: str = parameter(
        "none",
        "Source of the sensor's pose: none (the sensor does not move), odometry or tf",
        choices=OWN_SHIP_SOURCES,
        read_only=True,
    )
    fixed_frame: str = parameter(
        "",
        "Frame of the tracks; empty: the odometry's frame, else the detections' frame. x is east "
        "and y north; if the name ends in _ned or _frd, x is north and y east",
        read_only=True,
    )
    sensor_frame: str = parameter(
        "", "Frame of the detections; empty: the frame of the first message", read_only=True
    )
    own_ship_timeout: float = parameter(
        2.0,
        "Maximum time that a scan waits for the own-ship data of its time",
        unit="s",
        minimum=0.0,
        maximum=3600.0,
    )
    own_ship_max_extrapolation: float = parameter(
        0.5,
        "Maximum extrapolation of the newest pose after own_ship_timeout expires",
        unit="s",
        minimum=0.0,
        maximum=3600.0,
    )
    own_ship_max_gap: float = parameter(
        10.0,
        "Maximum gap between own-ship samples for interpolation",
        unit="s",
        positive=True,
        maximum=3600.0,
    )
    restart_jump: float = parameter(
        60.0,
        "A backward step of the stamps by more than this resets the state; a smaller step "
        "marks a late scan",
        unit="s",
        minimum=0.0,
    )
    max_gap: float = parameter(
        0.0,
        "Maximum gap between scans; a longer gap drops the potential tracks. 0: the window times "
        "the median scan interval",
        unit="s",
        minimum=0.0,
    )
    max_scan_time: float = parameter(
        5.0,
        "Maximum computing time of a scan; a safeguard in addition to the limits on "
        "counts. Offline runs do not use it and are therefore reproducible",
        unit="s",
        positive=True,
        maximum=3600.0,
    )

    sweep: str = parameter(
        "auto",
        "Joining of messages that each hold a beam or sector of a sweep. auto: joined once their "
        "azimuths show a sweep; off: a message is a scan; or the time in seconds "
        "of a turn or of a pass over a sector",
        numeric=True,
        read_only=True,
    )

    def __post_init__(self) -> None:
        check_group(self)
        east_north_up(self.fixed_frame)
        if self.sweep not in ("off", "auto") and not 0.0 < self._seconds() <= MAX_SWEEP:
            raise ValueError(
                f"sweep must be off, auto, or a number of seconds above 0 and at most "
                f"{MAX_SWEEP:g}; got {self.sweep!r}"
            )

    @property
    def sweep_seconds(self) -> float:
        """The time of a turn where it is given, s; else 0."""
        return 0.0 if self.sweep in ("off", "auto") else self._seconds()

    def _seconds(self) -> float:
        try:
            return float(self.sweep)
        except ValueError:
            return math.nan
