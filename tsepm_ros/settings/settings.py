"""Everything that a session is made from."""

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
        """Scans of the chosen method's window."""
        return int(self.method_options.window)
