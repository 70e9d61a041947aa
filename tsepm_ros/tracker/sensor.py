# Copyright 2026 tsepm_ros developers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""The sensor: errors, detection probability, clutter, and the coverage as it moves."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from tsepm_ros.parameters import WHOLE_TURN, ParameterGroup, parameter
from tsepm_ros.tracker.scan import MAX_MAGNITUDE, MIN_MAGNITUDE, Scan

FULL_TURN = math.radians(357.5)
"""Least width of a sector that is a full turn in rounded numbers, such as 3.14 or 179 degrees to
either side, rad."""
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
GRAZING_ANGLE = math.radians(20.0)
"""Least angle between a ray and a surface that is one object."""
COARSEST_FAN = math.radians(3.0)
"""Angle between rays from which on neighbours are of different objects."""
MAX_ERROR_DEVIATIONS = 3.0
"""Standard deviations within which a measurement may be in error."""
POSE_ROUNDS = 3
"""Rounds of `EchoPoses` by azimuth: each divides the error by the ratio of the two rates."""


@dataclass(frozen=True, kw_only=True)
class Coverage(ParameterGroup):
    """Limits of range and azimuth beyond which a sensor detects nothing.

    Raises
    ------
    ValueError
        If a value is out of its range, or the limits are too near to each other.
    """

    min_range: float = parameter(
        0.0, "Nearest range covered", unit="m", minimum=0.0, maximum=MAX_MAGNITUDE["range"]
    )
    max_range: float = parameter(
        MAX_MAGNITUDE["range"],
        "Farthest range covered",
        unit="m",
        minimum=MIN_MAGNITUDE["range"],
        maximum=MAX_MAGNITUDE["range"],
    )
    azimuth_min: float = parameter(
        -math.pi,
        "Start of the azimuth sector covered, counter-clockwise from the sensor's x axis",
        unit="rad",
        minimum=-WHOLE_TURN,
        maximum=WHOLE_TURN,
    )
    azimuth_max: float = parameter(
        math.pi,
        "End of the azimuth sector covered, counter-clockwise from its start",
        unit="rad",
        minimum=-WHOLE_TURN,
        maximum=WHOLE_TURN,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
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

    @property
    def sector_width(self) -> float:
        """Width of the azimuth sector covered, rad; 2 pi from `FULL_TURN` on."""
        width = self.azimuth_max - self.azimuth_min
        return width if width < FULL_TURN else 2 * math.pi

    @property
    def all_round(self) -> bool:
        """Whether every azimuth is covered."""
        return self.azimuth_max - self.azimuth_min >= FULL_TURN

    @property
    def coverage_area(self) -> float:
        """Area covered, m^2."""
        return 0.5 * self.sector_width * (self.max_range**2 - self.min_range**2)

    def covers(
        self,
        range: ArrayLike,
        azimuth: ArrayLike,
        range_margin: ArrayLike = 0.0,
        azimuth_margin: ArrayLike = 0.0,
    ) -> BoolArray:
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
        covered: BoolArray = distance >= self.min_range - range_margin
        covered = covered & (distance <= self.max_range + range_margin)
        if self.all_round:
            return covered
        azimuth_margin = np.asarray(azimuth_margin, float)
        sector_start = self.azimuth_min - azimuth_margin
        from_start = np.remainder(np.asarray(azimuth, float) - sector_start, 2 * np.pi)
        return covered & (from_start <= self.sector_width + 2.0 * azimuth_margin)


@dataclass(frozen=True, kw_only=True)
class SensorModel(Coverage):
    """Errors and coverage of a range/azimuth sensor. The defaults are the sonar of TSEPM 2018.

    Raises
    ------
    ValueError
        If a value is out of its range, or both range deviations are 0; the message names it.
    """

    max_range: float = parameter(
        9000.0,
        "Farthest range covered",
        unit="m",
        minimum=MIN_MAGNITUDE["range"],
        maximum=MAX_MAGNITUDE["range"],
    )
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
    range_resolution: float = parameter(
        0.0,
        "Range difference below which the sensor cannot separate echoes; used for clusters. 0: "
        "unknown",
        unit="m",
        minimum=0.0,
        maximum=1e4,
    )
    azimuth_resolution: float = parameter(
        0.0,
        "Azimuth difference below which the sensor cannot separate echoes (beam width); used for "
        "clusters. 0: unknown",
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
        super().__post_init__()
        if max(self.range_std, self.range_std_fraction) < 1e-6:
            raise ValueError("range_std and range_std_fraction must not both be 0")
        if self.range_std > MAX_STD_RATIO * self.azimuth_std:
            raise ValueError(
                f"range_std must be at most {MAX_STD_RATIO:g} m/rad times azimuth_std; got "
                f"{self.range_std} and {self.azimuth_std}"
            )
        if 0.0 < self.range_rate_std < MIN_RANGE_RATE_STD:
            raise ValueError(
                f"range_rate_std must be 0 or at least {MIN_RANGE_RATE_STD:g}; got "
                f"{self.range_rate_std}"
            )

    def range_variance(self, range: ArrayLike, number: IntArray | None = None) -> FloatArray:
        """Variance of the range, m^2: range_std^2 + (range_std_fraction * range)^2.

        The number of the sensor is of no account here; see `RangeErrors`.
        """
        return self.range_std**2 + (self.range_std_fraction * np.asarray(range, float)) ** 2


class RangeErrors(NamedTuple):
    """Range errors of several sensors, by the numbers of these, (s,) each.

    Attributes
    ----------
    range_std, range_std_fraction : ndarray
        As in `SensorModel`.
    """

    range_std: FloatArray
    range_std_fraction: FloatArray

    def range_variance(self, range: FloatArray, number: IntArray) -> FloatArray:
        """Variance of ranges (...) of detections by sensors of these numbers (...), m^2."""
        return self.range_std[number] ** 2 + (self.range_std_fraction[number] * range) ** 2


def rays_go_on(
    before: FloatArray, after: FloatArray, increment: float, sensor: SensorModel | None = None
) -> BoolArray:
    """Whether the ranges of neighbouring rays do not jump.

    The jump is that of a surface which is hit at `GRAZING_ANGLE`, as in the adaptive breakpoints of
    Borges, Aldon, "Line extraction in 2D range images for mobile robotics", J. Intell. Robot. Syst.
    40(3), 2004, with the errors s of both ranges:
    ``|r_i - r_(i-1)| <= r sin(increment) / sin(angle - increment) + 3 sqrt(2) s``. In a coarse fan
    every range jumps.

    Parameters
    ----------
    before, after : (n,) ndarray
        m; a range that is not finite and above 0 always jumps.
    increment : float
        Angle between the rays, rad.
    sensor : SensorModel, optional
        Its range errors; without it there are none.

    Returns
    -------
    (n,) ndarray of bool
    """
    if not abs(increment) <= COARSEST_FAN:  # nan, too
        return np.zeros(len(before), bool)
    slope = math.sin(abs(increment)) / math.sin(GRAZING_ANGLE - abs(increment))
    with np.errstate(invalid="ignore", over="ignore"):
        nearer = np.minimum(before, after)
        variance = 0.0 if sensor is None else sensor.range_variance(nearer)
        longest = slope * nearer + MAX_ERROR_DEVIATIONS * np.sqrt(2.0 * variance)
        seen = np.isfinite(before) & np.isfinite(after) & (before > 0.0) & (after > 0.0)
        return np.asarray(seen & (np.abs(after - before) <= longest))


def error_variances(scan: Scan, sensor: SensorModel) -> FloatArray:
    """Variances of the ranges and azimuths of a scan's detections, (2, n), m^2 and rad^2."""
    range_std, angle = scan.range_std, scan.azimuth_std
    along = sensor.range_variance(scan.range) if range_std is None else range_std**2
    turn = np.full(len(scan.range), sensor.azimuth_std) if angle is None else angle
    return np.stack([along, turn**2])


def inside_coverage(scan: Scan, sensor: SensorModel) -> BoolArray:
    """Which detections (n,) may be of a target in the coverage, given their errors.

    The sensor detects no target outside the coverage: detections beyond are false.
    """
    margins = MAX_ERROR_DEVIATIONS * np.sqrt(error_variances(scan, sensor))
    return sensor.covers(scan.range, scan.azimuth, *margins)


@dataclass(frozen=True)
class EchoPoses:
    """Poses of the sensor at the echoes of a scan, as a function of what determines their time.

    Echoes of a ping arrive in the order of their ranges, those of a beam that turns in the order of
    their azimuths, whatever the order of the detections in their message.

    Attributes
    ----------
    key : (k,) ndarray
        Range, m, ascending; or azimuth, rad, ascending over less than a turn from the sweep's seam.
    pose : (k, 3) ndarray
        x, y, yaw; the yaw is unwrapped.
    by_azimuth : bool
        Whether the key is the azimuth.
    """

    key: FloatArray
    pose: FloatArray
    by_azimuth: bool = False

    @cached_property
    def middle(self) -> FloatArray:
        """The pose of the echo of median range or azimuth, (3,)."""
        return self.pose[len(self.pose) // 2]

    def of_echoes_from(self, positions: FloatArray) -> FloatArray:
        """Pose (3,), or poses (3, n), at the echoes from positions (n, 2) in the fixed frame.

        The pose is interpolated at the range from the middle pose. The azimuth determines the pose,
        and the pose the azimuth: `POSE_ROUNDS` rounds from the middle pose solve for both, since
        the beam turns much faster than the sensor.
        """
        pose, key = self.middle, self.key
        if len(self.pose) == 1:
            return pose
        if not self.by_azimuth:
            distance = np.hypot(positions[:, 0] - pose[0], positions[:, 1] - pose[1])
            return np.stack([np.interp(distance, key, values) for values in self.pose.T])
        for _ in range(POSE_ROUNDS):
            from_seam = np.mod(_polar_from(positions, pose)[1] - key[0], 2 * np.pi)
            # Beyond the last echo begins the seam, which the first follows.
            pose = np.stack([np.interp(from_seam, key - key[0], values) for values in self.pose.T])
        return pose

    def polar(self, positions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Range (m) and azimuth (rad) in the sensor frame of positions (n, 2)."""
        return _polar_from(positions, self.of_echoes_from(positions))


def echo_poses(scan: Scan) -> EchoPoses | None:
    """The poses of a scan; None for a pose per detection without detections.

    They follow from the range in a ping, and from the azimuth in a sweep, by which the times in
    order vary less.
    """
    pose, time = np.reshape(scan.sensor_pose, (-1, 3)), scan.time_offset
    if len(pose) < 2:
        return EchoPoses(np.zeros(1), pose) if len(pose) else None
    order, key, by_azimuth = np.lexsort((*pose.T, scan.range)), scan.range, False
    if len(pose) > 2 and time is not None:
        around = np.argsort(scan.azimuth, kind="stable")
        jumps = np.abs(np.diff(time[around], append=time[around[0]]))
        around = np.roll(around, -1 - int(np.argmax(jumps)))
        along, across = (np.abs(np.diff(time[rows])).sum() for rows in (order, around))
        if along > across:
            seam = scan.azimuth[around[0]]
            order, key, by_azimuth = around, seam + np.mod(scan.azimuth - seam, 2 * np.pi), True
    pose = pose[order]
    pose[:, 2] = np.unwrap(pose[:, 2])
    return EchoPoses(key[order], pose, by_azimuth)


def scan_looked_at(
    scan: Scan, sensor: SensorModel, poses: EchoPoses, positions: FloatArray
) -> BoolArray:
    """Whether a scan looked at positions (n, 2) in the fixed frame: coverage, and arc swept."""
    pose = poses.of_echoes_from(positions)
    swept = None if scan.swept is None else tuple(scan.swept)
    if sensor.all_round and swept is None:
        distance = np.hypot(positions[:, 0] - pose[0], positions[:, 1] - pose[1])
        return np.asarray((distance >= sensor.min_range) & (distance <= sensor.max_range))
    range_, azimuth = _polar_from(positions, pose)
    return sensor.covers(range_, azimuth) & _in_arc(swept, azimuth)


def _in_arc(arc: tuple[float, ...] | None, azimuth: FloatArray) -> BoolArray:
    """Whether azimuths (n,) are of an arc, its start and width; None for all around."""
    if arc is None:
        return np.ones(len(azimuth), bool)
    start, width = arc
    return np.asarray(np.mod(azimuth - start, 2 * np.pi) <= width)


@dataclass(frozen=True, kw_only=True)
class Picture:
    """The sensors of one picture, as a sensor looks; a sensor lives until it is silent.

    Attributes
    ----------
    number, sensors : int
        Number of the sensor that looks, from 0, and how many there are.
    living : tuple of int
        Numbers of those that live.
    interval : float
        Mean time between scans of any living sensor, s; 0 while it is unknown.
    own, slowest : float
        Median of the last intervals of the sensor, and the largest of a living one, s; 0 while it
        is unknown.
    counts_absence : bool
        Whether the scan is one of the slowest living sensor: targets outside every coverage are
        absent once in its scans.
    max_range : float
        Largest of the living sensors, m.
    remembered : int
        Scans of the picture that hold the window of each living sensor.
    others : tuple
        Last scan, model and poses of each other living sensor.
    """

    number: int = 0
    sensors: int = 1
    living: tuple[int, ...] = (0,)
    interval: float = 0.0
    own: float = 0.0
    slowest: float = 0.0
    counts_absence: bool = True
    max_range: float = math.inf
    remembered: int = 0
    others: tuple[tuple[Scan, SensorModel, EchoPoses], ...] = ()

    def covered_by_others(self, positions: FloatArray) -> BoolArray:
        """Whether another living sensor covers each position (n, 2), as it lies now."""
        covered = np.zeros(len(positions), bool)
        for scan, model, poses in self.others:
            covered |= scan_looked_at(scan.replaced(swept=None), model, poses, positions)
        return covered


class SensorView(NamedTuple):
    """What a scan looked at.

    Attributes
    ----------
    sensor : SensorModel
    pose : tuple of float
        Of the sensor: x, y, yaw.
    swept : tuple of float or None
        Start and width of the arc, rad; None for all that is in the coverage.
    """

    sensor: SensorModel
    pose: tuple[float, ...]
    swept: tuple[float, ...] | None

    def covers(self, positions: FloatArray) -> BoolArray:
        """Whether positions (n, 2) in the fixed frame were looked at."""
        range_, azimuth = _polar_from(positions, np.array(self.pose))
        return self.sensor.covers(range_, azimuth) & _in_arc(self.swept, azimuth)


def _polar_from(positions: FloatArray, pose: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Range and azimuth of positions (n, 2) from a pose (3,) or poses (3, n)."""
    x, y, yaw = pose
    east, north = positions[:, 0] - x, positions[:, 1] - y
    return np.hypot(east, north), np.arctan2(north, east) - yaw
