"""Case of a design: a sonar, its clutter and its targets."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from tsepm_ros.analysis.measures import SECONDS_PER_HOUR
from tsepm_ros.initiation.common_options import CommonOptions
from tsepm_ros.sensing.sensor import SensorModel
from tsepm_ros.simulation.strengths import ClutterStrength, TargetStrength


@dataclass(frozen=True, kw_only=True)
class Case:
    """A sonar, its clutter and the targets to be found.

    Attributes
    ----------
    sensor : SensorModel
    common : CommonOptions
        Common options, v_max among them.
    interval : float
        Time between pings, s.
    scans : int
        Number of pings within which a target should be found.
    target_speed : float
        m/s.
    target_range : float, optional
        Range of the targets in the middle of the run, m; anywhere in the coverage if not given.
    ratio_db : float, optional
        Signal-to-clutter ratio of the targets, dB, fluctuating in Rayleigh clutter; without it
        detections have no strength.

    Raises
    ------
    ValueError
        If a value is not allowed; the message names it.
    """

    sensor: SensorModel
    common: CommonOptions = field(default_factory=CommonOptions)
    interval: float = 12.0
    scans: int = 16
    target_speed: float = 5.0
    target_range: float | None = None
    ratio_db: float | None = None

    def __post_init__(self) -> None:
        sensor, speed = self.sensor, self.target_speed
        if not (math.isfinite(self.interval) and self.interval > 0.0):
            raise ValueError(f"interval must be finite and above 0; got {self.interval!r}")
        if not 0.0 <= speed <= self.max_speed:
            raise ValueError(
                f"speed must be from 0 to max_speed = {self.max_speed:g}; got {speed!r}"
            )
        if self.scans < 3:
            raise ValueError(f"scans must be at least 3; got {self.scans}")
        if self.ratio_db is not None and not -100.0 <= self.ratio_db <= 100.0:
            raise ValueError(f"ratio must be from -100 to 100 dB; got {self.ratio_db!r}")
        nearest, farthest = sensor.min_range, sensor.max_range
        if self.target_range is not None and not (
            nearest <= self.target_range <= farthest and self.target_range > 0.0
        ):
            raise ValueError(
                f"range must be above 0 and within the coverage, {nearest:g} to {farthest:g} m; "
                f"got {self.target_range!r}"
            )

    @property
    def clutter_strength(self) -> ClutterStrength | None:
        """Law of the strength of clutter, where detections have one."""
        return None if self.ratio_db is None else ClutterStrength()

    @property
    def target_strength(self) -> TargetStrength | None:
        """Strength of the targets' echoes, where detections have one."""
        return None if self.ratio_db is None else TargetStrength(self.ratio_db)

    @property
    def max_speed(self) -> float:
        """v_max, m/s."""
        return self.common.max_speed

    @property
    def typical_range(self) -> float:
        """The targets' range, or the range beyond which half of the coverage lies, m."""
        squares = self.sensor.min_range**2 + self.sensor.max_range**2
        return self.target_range or math.sqrt(0.5 * squares)

    @property
    def scans_per_hour(self) -> float:
        """Pings per hour."""
        return SECONDS_PER_HOUR / self.interval

    @property
    def detections_per_scan(self) -> float:
        """Expected false detections per ping."""
        return self.sensor.clutter_density * self.sensor.coverage_area

    @property
    def starts_per_hour(self) -> float:
        """False detections per hour: the starts from clutter if every detection starts a track."""
        return self.detections_per_scan * self.scans_per_hour
