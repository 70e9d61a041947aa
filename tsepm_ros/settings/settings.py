"""The settings of a session."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any

from tsepm_ros.initiation.common_options import CommonOptions
from tsepm_ros.initiation.initiator import Initiator
from tsepm_ros.initiation.method import Method
from tsepm_ros.methods.registry import METHODS, make_method
from tsepm_ros.own_ship.mounting import Mounting
from tsepm_ros.sensing.sensor import SensorModel
from tsepm_ros.settings.session_options import SessionOptions


@dataclass(frozen=True)
class Settings:
    """The settings of a session.

    Attributes
    ----------
    session : SessionOptions
    sensor : SensorModel
    common : CommonOptions
    methods : mapping of str to options
        Options of each method by its name; a missing method has the defaults.
    mounting : Mounting
        Pose of the sensor relative to the frame of the odometry.

    Raises
    ------
    ValueError
        If a mounting is given and own-ship data is not from odometry.
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
                f"mounting.x, mounting.y and mounting.yaw must be 0 if own_ship_source is "
                f"{source}: they are relative to the frame of the odometry"
            )

    @property
    def method_options(self) -> Any:
        """Options of the chosen method."""
        method = self.session.method
        return self.methods.get(method) or METHODS[method].Options()

    def make_initiator(self) -> Initiator:
        """Make the initiator that these settings describe."""
        return Initiator(self.make_method())

    def make_method(self) -> Method:
        """Make the method that these settings describe."""
        return make_method(
            self.session.method,
            sensor=self.sensor,
            **dataclasses.asdict(self.common),
            **dataclasses.asdict(self.method_options),
        )

    @property
    def window(self) -> int:
        """Window of the chosen method, scans."""
        return int(self.method_options.window)
