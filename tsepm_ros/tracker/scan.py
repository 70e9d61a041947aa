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
"""A scan: the detections of a ping, with their checks and their geometry."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from tsepm_ros.numerics.arrays import FloatArray, IntArray

MAX_MAGNITUDE = {
    "range": 1e8,  # m
    "range_std": 1e5,  # m: beyond, rounding loses the other axis of an update
    "azimuth_std": math.pi,  # rad
    "time_offset": 1e6,  # s
    "sensor_pose": 1e9,  # m, rad
    "sensor_pose_covariance": 1e13,  # m^2, rad^2: beyond, rounding loses other covariances
    "sensor_velocity": 1e6,  # m/s
    "range_rate": 1e6,  # m/s
}
"""Largest magnitudes accepted: a larger number is a fault, and its square could overflow."""

MIN_MAGNITUDE = {"range": 1e-3, "range_std": 1e-6, "azimuth_std": 1e-9}
"""Smallest positive values accepted, m and rad: the squares of smaller values vanish."""

ECHO_FEATURES = ("intensity", "range_width", "azimuth_width")
"""What is measured of an echo beside its place and its range rate."""
FEATURES = (*ECHO_FEATURES, "range_rate", "standing")
"""Names allowed in `Scan.features`."""
MIN_STANDING = 0.5
"""The feature standing from which on a detection stands."""


@dataclass(frozen=True, eq=False)
class Scan:
    """Detections of a scan (a ping) in the sensor frame.

    Parameters
    ----------
    stamp : float
        Start of transmit, s.
    range : (n,) array_like
        Range of each detection, m, above 0. `MAX_MAGNITUDE` and `MIN_MAGNITUDE` bound all values.
    azimuth : (n,) array_like
        Azimuth of each detection, rad, counter-clockwise from the sensor's x axis (REP-103). Any
        finite angle; it is wrapped to [-pi, pi].
    range_std, azimuth_std : (n,) array_like, optional
        Standard deviation of each detection, m and rad, in place of the sensor model's.
    time_offset : (n,) array_like, optional
        Time after `stamp` at which each detection's position is valid, s; 0 if not given.
    features : mapping of str to (n,) array_like, optional
        Further measurements by name: intensity, range_width (m), azimuth_width (rad),
        range_rate (m/s, above 0 where the range grows, in the horizontal plane as the range,
        against the moving sensor; nan or beyond `MAX_MAGNITUDE`: none).
    sensor_pose : (3,) or (n, 3) array_like, optional
        Pose (x, y, yaw) of the sensor in the fixed frame, m and rad: one for the scan, or one per
        detection; the origin if not given.
    sensor_pose_covariance : (3, 3) array_like, optional
        Covariance of the sensor pose. The error is common to all detections of the scan.
    sensor_velocity : (2,) or (n, 2) array_like, optional
        Velocity of the sensor in the fixed frame, m/s, at the time of the scan, or of each
        detection's position: range rates are measured against it. Zero if not given.
    group : (n,) array_like of int, optional
        Detections of the same number, from 0, are neighbours of one object (rays of a fan), and
        become one cluster where clusters are not off; below 0: alone.
    swept : (2,) array_like, optional
        Start and width of the arc of azimuths that the scan looked at, rad, from -2 pi to 2 pi and
        from 0 to 2 pi, where that is not all of the sensor's coverage: a part of a sweep.
    sensor : str, optional
        Name of the sensor, of several in one picture.

    Raises
    ------
    ValueError
        If a shape or a value is not allowed; the message starts with the field's name.
    """

    stamp: float
    range: FloatArray
    azimuth: FloatArray
    range_std: FloatArray | None = None
    azimuth_std: FloatArray | None = None
    time_offset: FloatArray | None = None
    features: Mapping[str, FloatArray] = field(default_factory=dict)
    sensor_pose: FloatArray | tuple[float, float, float] = (0.0, 0.0, 0.0)
    sensor_pose_covariance: FloatArray | None = None
    sensor_velocity: FloatArray | tuple[float, float] = (0.0, 0.0)
    group: IntArray | None = None
    swept: FloatArray | None = None
    sensor: str = ""

    def __post_init__(self) -> None:
        number = _numbers("range", self.range).size
        vars(self).update(
            {
                name: _checked_field(name, value, number)
                for name, value in vars(self).items()
                if value is not getattr(type(self), name, self) or value  # what is not absent
            }
        )

    @classmethod
    def from_xy(cls, stamp: float, x: ArrayLike, y: ArrayLike, **fields: Any) -> Self:
        """A scan from positions in the sensor frame.

        Parameters
        ----------
        stamp : float
            Start of transmit, s.
        x, y : (n,) array_like
            Position of each detection, m: x ahead and y to the left of the sensor (REP-103).
        **fields
            The other fields of a scan.

        Raises
        ------
        ValueError
            As from the constructor; also if x and y differ in length, or a position is the
            sensor's own.
        """
        x, y = _numbers("x", x), _numbers("y", y)
        if x.ndim != 1 or x.shape != y.shape:
            raise ValueError(f"x and y must have one shape (n,); got {x.shape} and {y.shape}")
        if not (np.isfinite(x).all() and np.isfinite(y).all()):
            raise ValueError("x and y must be finite")
        return cls(stamp, np.hypot(x, y), np.arctan2(y, x), **fields)

    @classmethod
    def trusted(cls, **fields: Any) -> Self:
        """A scan of fields in the form that this class keeps: none is checked, copied or wrapped.

        Parameters
        ----------
        **fields
            Every field that differs from its default; float64 arrays that are never written to.
        """
        scan = object.__new__(cls)
        defaults = {"features": {}, "sensor_pose": np.zeros(3), "sensor_velocity": np.zeros(2)}
        vars(scan).update(defaults | fields)
        return scan

    def replaced(self, **fields: Any) -> Self:
        """The scan with some fields replaced, for the same detections; only these are checked.

        Raises
        ------
        ValueError
            As from the constructor.
        """
        checked = {name: _checked_field(name, value, len(self)) for name, value in fields.items()}
        return self.trusted(**(vars(self) | checked))

    def __len__(self) -> int:
        """Number of detections."""
        return len(self.range)


def wrap(angle: ArrayLike) -> FloatArray:
    """Wrap angles to [-pi, pi]; angles inside stay the same to the bit."""
    angle = np.asarray(angle, float)
    inside = np.abs(angle) <= np.pi
    if inside.all():
        return angle
    wrapped = np.where(inside, angle, np.remainder(angle + np.pi, 2 * np.pi) - np.pi)
    wrapped.flags.writeable = angle.flags.writeable
    return wrapped


def _checked_field(name: str, value: Any, n: int) -> Any:
    """A field of a scan of n detections in its stored form; ValueError if it is not allowed."""
    match name:
        case "stamp":
            return _checked_stamp(value)
        case "range":
            return _positive(name, value, n)
        case "azimuth":
            return wrap(_finite(name, value, (n,)))
        case "features":
            return _checked_features(value, n)
        case "sensor_pose" | "sensor_velocity":
            numbers = _numbers(name, value)
            width = 3 if name == "sensor_pose" else 2
            return _bounded(name, numbers, (width,) if numbers.shape == (width,) else (n, width))
    if value is None or name == "sensor":
        return value
    if name == "sensor_pose_covariance":
        return checked_covariance(name, value)
    if name == "swept":
        return _checked_swept(value)
    if name == "group":
        return _finite(name, value, (n,)).astype(np.int64)
    return _bounded(name, value, (n,)) if name == "time_offset" else _positive(name, value, n)


def _checked_features(value: Any, n: int) -> dict[str, FloatArray]:
    if not isinstance(value, Mapping):
        raise ValueError(f"features must be a mapping of names to arrays; got {value!r}")
    unknown = sorted(map(str, set(value) - set(FEATURES)))
    if unknown:
        raise ValueError(f"features: unknown name {unknown[0]!r}; known are {FEATURES}")
    return {name: _array(f"features[{name!r}]", values, (n,)) for name, values in value.items()}


def _checked_swept(value: Any) -> FloatArray:
    array = _finite("swept", value, (2,))
    if abs(array[0]) > 2 * math.pi or not 0.0 <= array[1] <= 2 * math.pi:
        raise ValueError(f"swept must be a start and a width within 2 pi; got {array.tolist()}")
    return array


def _checked_stamp(value: float) -> float:
    try:
        stamp = float(value)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"stamp must be a number of seconds; got {value!r}") from None
    if not abs(stamp) < 2.0**31:  # not so nan
        raise ValueError(f"stamp must be finite, in s, below 2**31 as in ROS; got {value!r}")
    return stamp


def _numbers(name: str, value: ArrayLike) -> FloatArray:
    try:
        return np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{name} must be an array of numbers") from None


def _array(name: str, value: ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    array = _numbers(name, value)
    if array.size == 0 and math.prod(shape) == 0:
        array = array.reshape(shape)
    if array.shape != shape:
        raise ValueError(f"{name} must have the shape {shape}; got {array.shape}")
    array.flags.writeable = False
    return array


def _finite(name: str, value: ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    array = _array(name, value, shape)
    if not np.isfinite(array).all():
        raise ValueError(f"{name} must be finite")
    return array


def _bounded(
    name: str, value: ArrayLike, shape: tuple[int, ...], limit: float | None = None
) -> FloatArray:
    array, limit = _finite(name, value, shape), limit or MAX_MAGNITUDE[name]
    if (np.abs(array) > limit).any():
        raise ValueError(f"{name} must be at most {limit:g}; got {np.abs(array).max():g}")
    return array


def _positive(name: str, value: ArrayLike, n: int) -> FloatArray:
    array = _bounded(name, value, (n,))
    if (array <= 0).any():
        raise ValueError(f"{name} must be above 0; got {array[array <= 0][0]}")
    if (array < MIN_MAGNITUDE[name]).any():
        raise ValueError(f"{name} must be at least {MIN_MAGNITUDE[name]:g}; got {array.min():g}")
    return array


def checked_covariance(name: str, value: ArrayLike) -> FloatArray:
    """Return a (3, 3) covariance as a checked array.

    Raises
    ------
    ValueError
        If it is not finite, symmetric and positive semi-definite, or exceeds `MAX_MAGNITUDE`; the
        message starts with `name`.
    """
    array = _bounded(name, value, (3, 3), MAX_MAGNITUDE["sensor_pose_covariance"])
    scale = np.abs(array).max()
    symmetric = np.abs(array - array.T).max() <= 1e-9 * scale
    if not symmetric or np.linalg.eigvalsh(array).min() < -1e-9 * scale:
        raise ValueError(f"{name} must be symmetric and positive semi-definite")
    return array


class ScanArc(NamedTuple):
    """An arc of azimuths.

    Attributes
    ----------
    start, width : float
        rad; the width from 0 to 2 pi, counter-clockwise.
    whole : bool
        Whether all beams of the message are known: those without a detection, too.
    """

    start: float
    width: float
    whole: bool = False

    @property
    def middle(self) -> float:
        """Azimuth of its middle, rad."""
        return self.start + 0.5 * self.width


def scan_arc_of(azimuth: FloatArray) -> ScanArc | None:
    """The smallest arc that holds azimuths (n,), rad; None if none is finite."""
    known = np.sort(np.mod(azimuth[np.isfinite(azimuth)], 2 * np.pi), kind="stable")
    if not len(known):
        return None
    gaps = np.append(known[1:], known[0] + 2 * np.pi) - known
    last = int(np.argmax(gaps))
    return ScanArc(float(known[(last + 1) % len(known)]), float(2 * np.pi - gaps[last]))


def in_sensor_frame(range: FloatArray, azimuth: FloatArray) -> FloatArray:
    """Positions of detections in the sensor's frame, (n, 2), m."""
    return np.stack([range * np.cos(azimuth), range * np.sin(azimuth)], axis=1)


def scan_positions(scan: Scan) -> FloatArray:
    """Positions of a scan's detections in the fixed frame, (n, 2), m."""
    x, y, yaw = np.reshape(scan.sensor_pose, (-1, 3)).T
    return np.stack([x, y], axis=1) + in_sensor_frame(scan.range, scan.azimuth + yaw)


def scan_of_rows(scan: Scan, rows: IntArray) -> Scan:
    """Some detections of a scan."""
    parts = {
        name: None if values is None else values[rows]
        for name, values in vars(scan).items()
        if name in ("range", "azimuth", "range_std", "azimuth_std", "time_offset", "group")
    }
    for name in ("sensor_pose", "sensor_velocity"):
        values = np.asarray(getattr(scan, name), float)
        parts[name] = values[rows] if values.ndim == 2 else values
    features = {name: values[rows] for name, values in scan.features.items()}
    return Scan.trusted(**(vars(scan) | parts | {"features": features}))


def turned(angle: float) -> float:
    """An angle wrapped to [-pi, pi), rad."""
    return math.remainder(angle, 2 * math.pi)


def check_scan(scan: Scan, last_stamp: float | None, max_detections: int) -> None:
    """Raise an error for what no scan may be.

    Parameters
    ----------
    scan : Scan
    last_stamp : float or None
        Of the scan before, s.
    max_detections : int

    Raises
    ------
    ValueError
        If the stamp is not later than the last one, or the scan has too many detections.
    """
    if not isinstance(scan, Scan):
        raise ValueError(f"scan must be a tsepm_ros.Scan; got {type(scan).__name__}")
    if last_stamp is not None and scan.stamp <= last_stamp:
        raise ValueError(
            f"stamp must be later than the last scan's; got {scan.stamp!r} after {last_stamp!r}"
        )
    if len(scan.range) > max_detections:
        raise ValueError(
            f"range has {len(scan)} detections, more than max_detections = {max_detections}"
        )
