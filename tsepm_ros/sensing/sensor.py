"""The sensor: its errors, its coverage, its detection probability and its clutter."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tsepm_ros.numerics.rows import changed
from tsepm_ros.parameters import check_group, parameter
from tsepm_ros.sensing.scan import MAX_MAGNITUDE, MIN_MAGNITUDE

SEAM = math.radians(2.5)
"""Gap between the ends of a sector that is a full turn in rounded numbers, such as 3.14 or 179
degrees to either side, rad."""
MIN_SECTOR_WIDTH = 1e-6
"""Smallest width of the azimuth sector covered, rad."""
MIN_CLUTTER_DENSITY = 1e-12
"""Floor of the clutter density, 1/m^2: false detections are possible everywhere."""
MAX_CLUTTER_DENSITY = 1e30
"""Upper bound of the clutter density, 1/m^2, far above estimates in the smallest coverage."""
MAX_STD_RATIO = 1e11
"""Largest ratio of `range_std` to `azimuth_std`, m/rad: beyond, rounding loses the smaller."""
MIN_RANGE_RATE_STD = 1e-3
"""Smallest standard deviation of range rates, m/s: below, fits lose the positions."""


@dataclass(frozen=True, kw_only=True)
class SensorModel:
    """Errors and coverage of a range/azimuth sensor. The defaults are the sonar of TSEPM 2018.

    Raises
    ------
    ValueError
        If a value is out of its range, or both range deviations are 0; the message names it.
    """

    range_std: float = parameter(
        0.0,
        "Constant part of the range's standard deviation",
        unit="m",
        minimum=0.0,
        maximum=1e5,
    )
    range_std_fraction: float = parameter(
        0.015,
        "Range-dependent part of the range's standard deviation, as a fraction of the range",
        minimum=0.0,
        maximum=1.0,
    )
    azimuth_std: float = parameter(
        math.radians(1.0),
        "Standard deviation of the azimuth (0.01745 is 1 degree)",
        unit="rad",
        minimum=1e-9,
        maximum=1.0,
    )
    min_range: float = parameter(
        0.0, "Nearest range covered", unit="m", minimum=0.0, maximum=MAX_MAGNITUDE["range"]
    )
    max_range: float = parameter(
        9000.0,
        "Farthest range covered",
        unit="m",
        minimum=MIN_MAGNITUDE["range"],
        maximum=MAX_MAGNITUDE["range"],
    )
    azimuth_min: float = parameter(
        -math.pi,
        "Start of the azimuth sector covered, counter-clockwise from the sensor's x axis",
        unit="rad",
        minimum=-2 * math.pi,
        maximum=2 * math.pi,
    )
    azimuth_max: float = parameter(
        math.pi,
        "End of the azimuth sector covered, counter-clockwise from its start",
        unit="rad",
        minimum=-2 * math.pi,
        maximum=2 * math.pi,
    )
    range_resolution: float = parameter(
        0.0,
        "Range difference below which the sensor cannot separate echoes; used to make "
        "plots. 0: unknown",
        unit="m",
        minimum=0.0,
        maximum=1e4,
    )
    azimuth_resolution: float = parameter(
        0.0,
        "Azimuth difference below which the sensor cannot separate echoes (beam width); "
        "used to make plots. 0: unknown",
        unit="rad",
        minimum=0.0,
        maximum=1.0,
    )
    detection_probability: float = parameter(
        0.9, "Probability that a target inside the coverage is detected", positive=True, maximum=1.0
    )
    clutter_density: float = parameter(
        1e-6,
        "Mean number of false detections per scan and square metre",
        unit="1/m^2",
        positive=True,
        maximum=MAX_CLUTTER_DENSITY,
    )
    range_rate_std: float = parameter(
        0.0,
        "Standard deviation of the range rates of detections; 0: range rates are not used",
        unit="m/s",
        minimum=0.0,
        maximum=1e4,
    )
    clutter_range_rate: float = parameter(
        3.0,
        "Median magnitude of the range rate over ground of false detections (Cauchy distribution); "
        "used with range rates",
        unit="m/s",
        minimum=1e-4,
        maximum=1e4,
    )

    def __post_init__(self) -> None:
        check_group(self)
        if max(self.range_std, self.range_std_fraction) < 1e-6:
            raise ValueError("range_std and range_std_fraction must not both be 0")
        if self.range_std > MAX_STD_RATIO * self.azimuth_std:
            raise ValueError(
                f"range_std must be at most {MAX_STD_RATIO:g} m/rad times azimuth_std; got "
                f"{self.range_std} and {self.azimuth_std}"
            )
        if self.max_range - self.min_range < MIN_MAGNITUDE["range"]:
            raise ValueError(
                f"min_range must be below max_range by at least {MIN_MAGNITUDE['range']:g}; got "
                f"{self.min_range} and {self.max_range}"
            )
        if self.azimuth_max - self.azimuth_min < MIN_SECTOR_WIDTH:
            raise ValueError(
                f"azimuth_min must be below azimuth_max by at least {MIN_SECTOR_WIDTH:g}; got "
                f"{self.azimuth_min} and {self.azimuth_max}"
            )
        if 0.0 < self.range_rate_std < MIN_RANGE_RATE_STD:
            raise ValueError(
                f"range_rate_std must be 0 or at least {MIN_RANGE_RATE_STD:g}; got "
                f"{self.range_rate_std}"
            )

    def with_detection_probability(self, probability: float) -> SensorModel:
        """The same sensor with an estimated detection probability, above 0 and at most 1."""
        return changed(self, detection_probability=probability)  # the others are checked

    @property
    def sector_width(self) -> float:
        """Width of the azimuth sector covered, rad; 2 pi where less than `SEAM` is missing."""
        width = self.azimuth_max - self.azimuth_min
        return width if width < 2 * math.pi - SEAM else 2 * math.pi

    @property
    def all_round(self) -> bool:
        """Whether every azimuth is covered."""
        return self.sector_width >= 2 * math.pi

    @property
    def coverage_area(self) -> float:
        """Area covered, m^2."""
        return 0.5 * self.sector_width * (self.max_range**2 - self.min_range**2)

    def range_variance(self, range: ArrayLike) -> NDArray[np.float64]:
        """Variance of the range, m^2: range_std^2 + (range_std_fraction * range)^2."""
        return self.range_std**2 + (self.range_std_fraction * np.asarray(range, float)) ** 2

    def range_variance_slope(self, range: ArrayLike) -> NDArray[np.float64]:
        """Derivative of the range's variance by the range, m: 2 range_std_fraction^2 range."""
        return 2.0 * self.range_std_fraction**2 * np.asarray(range, float)

    def covers(
        self,
        range: ArrayLike,
        azimuth: ArrayLike,
        range_margin: ArrayLike = 0.0,
        azimuth_margin: ArrayLike = 0.0,
    ) -> NDArray[np.bool_]:
        """Whether positions in the sensor frame are in the coverage.

        Parameters
        ----------
        range, azimuth : (n,) array_like
            m and rad.
        range_margin, azimuth_margin : float or (n,) array_like, optional
            Distance by which a position may lie beyond the edges, m and rad.

        Returns
        -------
        (n,) ndarray of bool
        """
        distance, range_margin = np.asarray(range, float), np.asarray(range_margin, float)
        covered: NDArray[np.bool_] = distance >= self.min_range - range_margin
        covered = covered & (distance <= self.max_range + range_margin)
        if self.all_round:
            return covered
        azimuth_margin = np.asarray(azimuth_margin, float)
        sector_start = self.azimuth_min - azimuth_margin
        from_start = np.remainder(np.asarray(azimuth, float) - sector_start, 2 * np.pi)
        return covered & (from_start <= self.sector_width + 2.0 * azimuth_margin)
