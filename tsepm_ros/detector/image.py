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
"""What the detector takes: its options, and a sonar image, amplitudes over bearing and range."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.parameters import WHOLE_TURN, ParameterGroup, parameter, parameter_table
from tsepm_ros.tracker.scan import MAX_MAGNITUDE, MIN_MAGNITUDE
from tsepm_ros.tracker.sensor import Coverage

COVERAGE = tuple(row.name for row in parameter_table(Coverage))
"""Fields of the tracker's `SensorModel` that follow the images."""
COVERAGE_CHANGE = 0.02
"""Relative difference of a coverage from which on it is another."""


@dataclass(frozen=True, kw_only=True)
class DetectorOptions(ParameterGroup):
    """Options of the detector."""

    false_detections_per_ping: float = parameter(
        5.0,
        "Stated number of false detections per ping that do not stand; the threshold keeps it up "
        "to a tenth of the independent cells of an image",
        minimum=0.1,
        maximum=1e4,
    )
    range_extent: float = parameter(
        0.0, "Extent of a target's echo in range; 0: learned", unit="m", minimum=0.0, maximum=1e4
    )
    azimuth_extent: float = parameter(
        0.0,
        "Extent of a target's echo in azimuth, with the beam width; 0: learned",
        unit="rad",
        minimum=0.0,
        maximum=math.pi,
    )
    slowest_speed: float = parameter(
        0.1,
        "Speed of the slowest target that must not be taken for a fixed echo",
        unit="m/s",
        minimum=1e-3,
        maximum=100.0,
    )


@dataclass(frozen=True, eq=False)
class SonarImage:
    """Amplitudes of a ping over bearing and range.

    Parameters
    ----------
    stamp : float
        Start of transmit, s.
    range : (m,) array_like
        Centres of the cells, m, ascending and above 0, at least 2.
    azimuth : (b,) array_like
        Bearings, rad, counter-clockwise from the sensor's x axis, ascending or descending by at
        most a turn in all, in any spacing.
    intensity : (b, m) array_like
        Larger is stronger, in any real type and on any scale; NaN where nothing was measured.
    time_offset : (b,) array_like, optional
        Time of each bearing after `stamp`, s.
    sensor_pose : (3,) or (b, 3) array_like, optional
        Pose (x, y, yaw) in the fixed frame, m and rad: of the image, or of each bearing.
    states_ranges : bool, optional
        Whether the sonar states `range` with each image. If not, a change of the ranges is looked
        for in what stands.

    Raises
    ------
    ValueError
        If a shape or a value is not allowed; the message starts with the field's name.
    """

    stamp: float
    range: FloatArray
    azimuth: FloatArray
    intensity: NDArray[Any]
    time_offset: FloatArray | None = None
    sensor_pose: FloatArray | tuple[float, float, float] | None = None
    states_ranges: bool = False

    def __post_init__(self) -> None:
        image = np.asarray(self.intensity)
        if image.dtype.kind not in "buif":
            raise ValueError(f"intensity must be real numbers; got the type {image.dtype}")
        distance, azimuth = (
            _finite_numbers("range", self.range),
            _finite_numbers("azimuth", self.azimuth),
        )
        shape = (b, m) = len(azimuth), len(distance)
        offset = _finite_numbers(
            "time_offset", np.zeros(b) if self.time_offset is None else self.time_offset
        )
        pose = np.array((0, 0, 0) if self.sensor_pose is None else self.sensor_pose, float)
        steps, swapped = np.diff(azimuth), image.shape == shape[::-1] != shape
        limits = MIN_MAGNITUDE["range"], MAX_MAGNITUDE["range"]
        for wrong, sentence in (
            (
                not abs(self.stamp) < 2.0**31,  # not so nan
                f"stamp must be finite, in s, below 2**31 as in ROS; got {self.stamp}",
            ),
            (m < 2, f"range must have at least 2 cells; got {m}"),
            (np.any(np.diff(distance) <= 0), "range must ascend"),
            (
                np.any((distance < limits[0]) | (distance > limits[1])),
                f"range must be from {limits[0]:g} to {limits[1]:g} m",
            ),
            (b < 1, "azimuth must have at least 1 bearing"),
            (np.any(steps <= 0) and np.any(steps >= 0), "azimuth must ascend or descend"),
            (abs(steps.sum()) > WHOLE_TURN + 1e-6, "azimuth must span at most a turn, in rad"),
            (
                image.shape != shape,
                f"intensity must have the shape (bearings, ranges) = {shape}; got {image.shape}"
                + ": transpose the image" * swapped,
            ),
            (np.isinf(image).any(), "intensity must not be infinite; NaN: not measured"),
            (offset.shape != (b,), f"time_offset must have the shape ({b},); got {offset.shape}"),
            (
                pose.shape not in ((3,), (b, 3))
                or not (np.abs(pose) <= MAX_MAGNITUDE["sensor_pose"]).all(),
                f"sensor_pose must be finite, at most {MAX_MAGNITUDE['sensor_pose']:g}, of the "
                f"shape (3,) or ({b}, 3); got {pose.shape}",
            ),
        ):
            if wrong:
                raise ValueError(sentence)
        vars(self).update(
            range=distance,
            azimuth=azimuth,
            intensity=image,
            sensor_pose=pose,
            time_offset=None if self.time_offset is None else offset,
        )


class ImageCoverage:
    """Coverage of an image, to the edges of its cells.

    Parameters
    ----------
    distance, azimuth : (m,) and (b,) ndarray
        Centres of its cells, m and rad, as in `SonarImage`.
    limits : Coverage
        Of the detector, which some cell is in.

    Attributes
    ----------
    values : dict of str to float
        By the names of `COVERAGE`.
    """

    def __init__(self, distance: FloatArray, azimuth: FloatArray, limits: Coverage) -> None:
        half = 0.5 * (distance[1] - distance[0])
        # The width of a single bearing is not known: a radian, as for its errors.
        step = 0.5 * float(np.median(np.abs(np.diff(azimuth)))) if len(azimuth) > 1 else 0.5
        near = max(float(distance[0] - half), limits.min_range)
        far = min(float(distance[-1] + half), limits.max_range)
        low, high = limits.azimuth_min, limits.azimuth_max
        if np.ptp(azimuth) < 2.0 * np.pi - 6.0 * step:
            seen = azimuth[limits.covers(limits.min_range, azimuth, 0.0, step)]
            low, high = float(seen.min()) - step, float(seen.max()) + step
        turns = 2.0 * np.pi * int(max(low, high, key=abs) / WHOLE_TURN)
        self.values = dict(zip(COVERAGE, (near, far, low - turns, high - turns), strict=True))
        self._slack = 2.0 * step + 1e-3

    def agrees(self, other: Sequence[float]) -> bool:
        """Whether values in the order of `COVERAGE` are these, but for a bearing."""
        return bool(np.allclose(other, [*self.values.values()], COVERAGE_CHANGE, self._slack))


def _finite_numbers(name: str, value: Any) -> FloatArray:
    numbers = np.array(value, float)
    if numbers.ndim != 1 or not np.isfinite(numbers).all():
        raise ValueError(f"{name} must be finite numbers of the shape (n,); got {numbers.shape}")
    return numbers
