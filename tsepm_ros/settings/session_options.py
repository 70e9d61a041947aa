"""Options of a session."""

from __future__ import annotations

from dataclasses import dataclass

from tsepm_ros.methods.registry import available_methods
from tsepm_ros.parameters import check_group, parameter

OWN_SHIP_SOURCES = ("none", "odometry", "tf")
"""Where the sensor's pose may come from."""


@dataclass(frozen=True, kw_only=True)
class SessionOptions:
    """How arriving data is put in order and in place.

    Raises
    ------
    ValueError
        Naming the option whose value is not allowed.
    """

    method: str = parameter("score", "Track initiation method", choices=available_methods())
    own_ship_source: str = parameter(
        "none",
        "Where the sensor's pose comes from: none (it does not move), odometry or tf",
        choices=OWN_SHIP_SOURCES,
        read_only=True,
    )
    fixed_frame: str = parameter(
        "",
        "Frame of the tracks (ENU); empty: the odometry's frame, else the detections' own",
        read_only=True,
    )
    sensor_frame: str = parameter(
        "", "Frame of the detections; empty: that of the first message", read_only=True
    )
    own_ship_timeout: float = parameter(
        2.0,
        "Time that a scan waits for the own-ship data that belongs to it",
        unit="s",
        minimum=0.0,
        maximum=3600.0,
    )
    own_ship_max_extrapolation: float = parameter(
        0.5,
        "Own-ship data this much older than the scan still places it, once it has waited",
        unit="s",
        minimum=0.0,
        maximum=3600.0,
    )
    own_ship_max_gap: float = parameter(
        10.0,
        "Longest gap between own-ship data that is interpolated across",
        unit="s",
        positive=True,
        maximum=3600.0,
    )
    restart_jump: float = parameter(
        60.0,
        "A stamp farther back than this is a restart and resets the state; nearer is a late scan",
        unit="s",
        minimum=0.0,
    )
    max_gap: float = parameter(
        0.0,
        "A gap between scans longer than this drops the potential tracks; 0: the window times the "
        "median scan interval",
        unit="s",
        minimum=0.0,
    )
    max_scan_time: float = parameter(
        5.0,
        "Time that a scan may take, a last resort behind the limits on counts; off in studies and "
        "offline runs, so that they are reproducible",
        unit="s",
        positive=True,
        maximum=3600.0,
    )

    def __post_init__(self) -> None:
        check_group(self)
