"""Everything that a session is made from."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any

from tsepm_ros.initiation.common_options import CommonOptions
from tsepm_ros.initiation.initiator import Initiator
from tsepm_ros.methods.registry import METHODS, available_methods, make_initiator
from tsepm_ros.own_ship.mounting import Mounting
from tsepm_ros.parameters import check_group, parameter
from tsepm_ros.sensing.sensor import SensorModel

OWN_SHIP_SOURCES = ("none", "odometry", "tf")


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


@dataclass(frozen=True)
class Settings:
    """Everything a session is made from.

    Attributes
    ----------
    session : SessionOptions
    sensor : SensorModel
    common : CommonOptions
    methods : mapping of str to options
        Each method's own options, by the method's name; defaults where one is missing.
    mounting : Mounting
        Where the sensor is on the vessel of the odometry.

    Raises
    ------
    ValueError
        If a mounting is given where there is no odometry to use it with.
    """

    session: SessionOptions = field(default_factory=SessionOptions)
    sensor: SensorModel = field(default_factory=SensorModel)
    common: CommonOptions = field(default_factory=CommonOptions)
    methods: dict[str, Any] = field(default_factory=dict)
    mounting: Mounting = field(default_factory=Mounting)

    def __post_init__(self) -> None:
        source = self.session.own_ship_source
        if self.mounting.given and source != "odometry":
            raise ValueError(
                f"mounting.x, mounting.y and mounting.yaw must be 0 where own_ship_source is "
                f"{source}: they say where the sensor is on the vessel of the odometry"
            )

    @property
    def method_options(self) -> Any:
        """Options of the chosen method."""
        method = self.session.method
        return self.methods.get(method) or METHODS[method].Options()

    def make_initiator(self) -> Initiator:
        """Make the initiator that these settings describe."""
        return make_initiator(
            self.session.method,
            sensor=self.sensor,
            **dataclasses.asdict(self.common),
            **dataclasses.asdict(self.method_options),
        )

    @property
    def window(self) -> int:
        """Scans of the chosen method's window."""
        return int(self.method_options.window)
