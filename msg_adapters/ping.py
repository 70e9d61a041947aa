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
"""What is read from a message of detections, and what the readers of several types share.

Units, angles and lengths of the arrays in messages are converted by functions at the end.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from msg_adapters.stamps import MessageError, ns_to_seconds
from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from tsepm_ros.own_ship.registration import (
    AXES,
    MessageFacts,
    UnregisteredScan,
    registration_axes,
    registration_frame,
)
from tsepm_ros.session.drop_reasons import NUMBERS
from tsepm_ros.tracker.scan import MAX_MAGNITUDE, MIN_MAGNITUDE, Scan, ScanArc, scan_arc_of, wrap
from tsepm_ros.tracker.sensor import SensorModel

BEARING_REFERENCES = ("bow", "north")
"""Reference directions of a `bearing`, which is positive clockwise."""

SOUND_SPEED = 1500.0
"""Default speed of sound, m/s."""
MIN_SOUND_SPEED, MAX_SOUND_SPEED = 100.0, 10_000.0
"""Accepted sound speeds of messages, m/s; in their definitions, 0 means unknown."""
MAX_TURN = 2.5 * np.pi
"""Largest angle of a driver that counts from any axis and does not wrap, rad: a turn from there."""
_LARGEST = {**MAX_MAGNITUDE, "transmit_offset": MAX_MAGNITUDE["time_offset"]}
_IS_FAULT: Mapping[str, Callable[[str, FloatArray], BoolArray]] = {
    "not_finite": lambda name, values: ~np.isfinite(values),
    "not_positive": lambda name, values: ~(np.isfinite(values) & (values > 0.0)),
    "too_small": lambda name, values: values < MIN_MAGNITUDE[name],
    "too_large": lambda name, values: np.abs(values) > _LARGEST[name],
}
"""Whether values of a quantity, by its name, have a fault of `drop_reasons.NUMBERS`."""
T = TypeVar("T")
RENAMED = {"acoustic_msgs": "marine_acoustic_msgs", "ping360_sonar": "ping360_sonar_msgs"}
"""Packages of messages that have another name since, as in bags of ROS 1."""


@dataclass(frozen=True)
class ReadingOptions:
    """Properties that a message does not contain.

    Parameters
    ----------
    bearing_reference : {"bow", "north"}
        Reference direction of a field `bearing`, which is positive clockwise.
    sound_speed : float
        m/s, for messages without times, or with an unset field for the sound speed; 0: unknown.
    sensor : SensorModel, optional
        Its range errors, by which rays of one object differ.

    Raises
    ------
    ValueError
        If a value is not allowed.
    """

    bearing_reference: str = "bow"
    sound_speed: float = 0.0
    sensor: SensorModel | None = None

    def __post_init__(self) -> None:
        if self.bearing_reference not in BEARING_REFERENCES:
            raise ValueError(
                f"bearing_reference must be one of {', '.join(BEARING_REFERENCES)}; "
                f"got {self.bearing_reference!r}"
            )
        if not 0.0 <= self.sound_speed < math.inf:
            raise ValueError(f"sound_speed must be finite and not negative; got {self.sound_speed}")


@dataclass(frozen=True, eq=False)
class Ping:
    """The good detections of one message, which every reader returns.

    Attributes
    ----------
    sensor_scan : UnregisteredScan
        Input for a session.
    dropped : dict of str to int
        Number of detections that were left out, by reason.
    index : (n,) ndarray of int
        Index of each detection in the message.
    assumptions : tuple of str
        Sentences about data that the message does not have and that was assumed; equal for all
        messages of a driver.
    """

    sensor_scan: UnregisteredScan
    dropped: dict[str, int]
    index: NDArray[np.int64]
    assumptions: tuple[str, ...] = ()

    @property
    def scan(self) -> Scan:
        """The detections in the sensor's own axes."""
        return self.sensor_scan.scan

    def __len__(self) -> int:
        """Return the number of good detections."""
        return len(self.index)


def good_detections(
    stamp_ns: int,
    frame_id: str,
    options: ReadingOptions,
    *,
    range: FloatArray,
    azimuth: FloatArray,
    height: FloatArray | None = None,
    range_std: FloatArray | None = None,
    azimuth_std: FloatArray | None = None,
    time_offset: FloatArray | None = None,
    transmit_offset: FloatArray | None = None,
    features: Mapping[str, FloatArray] | None = None,
    group: IntArray | None = None,
    north_referenced: bool = False,
    axes: str = "",
    faults: Mapping[str, BoolArray] | None = None,
    nothing: Mapping[str, BoolArray] | None = None,
    states: Mapping[str, float] | None = None,
    assumptions: tuple[str, ...] = (),
    beams: ScanArc | None = None,
) -> Ping:
    """Leave out the bad detections of a message and count them; the last step of every reader.

    The reasons are ``range_not_finite``, ``range_not_positive``, ``azimuth_not_finite``,
    ``range_std_not_positive`` and ``azimuth_std_not_positive`` (also for nan and infinity),
    ``time_offset_not_finite`` and ``transmit_offset_not_finite``, and ``<field>_too_large`` and
    ``<field>_too_small`` for values above `tsepm_ros.tracker.scan.MAX_MAGNITUDE` or below
    `tsepm_ros.tracker.scan.MIN_MAGNITUDE`. A detection counts once, under the first reason that
    applies.

    Parameters
    ----------
    stamp_ns : int
        Stamp of the message, ns.
    frame_id : str
        Its frame.
    options : ReadingOptions
        If its sound speed is not 0 and there is no `time_offset`, the ping is assumed to leave at
        the stamp.
    range : (n,) ndarray
        In the plane of the sensor's ahead and port axes, m: the slant range times the cosine of the
        elevation. Like all following arrays it may have any values.
    azimuth : (n,) ndarray
        In that plane, rad, counter-clockwise from ahead, or from east if `north_referenced`.
    height : (n,) ndarray, optional
        Above that plane, m: the slant range times the sine of the elevation. A height that is not
        finite or too large is replaced by 0, like an unmeasured height.
    range_std, azimuth_std : (n,) ndarray, optional
        Standard deviations, m and rad.
    time_offset : (n,) ndarray, optional
        Time after the stamp for which each position is valid, s.
    transmit_offset : (n,) ndarray, optional
        Time after the stamp at which the ping of each detection left, s; 0 if not given.
    features : mapping of str to (n,) ndarray, optional
        Further measurements by the names of `tsepm_ros.Scan`.
    group : (n,) ndarray of int, optional
        Neighbouring detections of one object, as in `tsepm_ros.Scan`.
    north_referenced, axes
        As in `tsepm_ros.own_ship.registration.UnregisteredScan`; by default the axes that the
        name of the frame states.
    faults : mapping of str to (n,) ndarray of bool, optional
        The reader's own reasons and the detections to which they apply; they precede the others.
    nothing : mapping of str to (n,) ndarray of bool, optional
        Elements of the message without a detection, which are no drops, by the value that says so,
        in words.
    states : mapping of str to float, optional
        As in `tsepm_ros.own_ship.registration.MessageFacts`.
    assumptions : tuple of str, optional
        As in :class:`Ping`.
    beams : ScanArc, optional
        The azimuths of all beams; by default those of the elements of the message, good or bad.

    Returns
    -------
    Ping
    """
    if height is not None:
        height = np.where(np.abs(height) <= MAX_MAGNITUDE["range"], height, 0.0)
    if time_offset is None and options.sound_speed > 0.0:
        with np.errstate(over="ignore", invalid="ignore"):  # dropped as range_not_finite
            slant = range if height is None else np.hypot(range, height)
            time_offset = slant / options.sound_speed
    arrays = {
        "range": range,
        "azimuth": azimuth,
        "range_std": range_std,
        "azimuth_std": azimuth_std,
        "time_offset": time_offset,
        "transmit_offset": transmit_offset,
    }
    given = {name: values for name, values in arrays.items() if values is not None}
    common = {
        f"{name}_{fault}": _IS_FAULT[fault](name, values)
        for name, values in given.items()
        for fault in NUMBERS[name]
    }
    kept = np.ones(len(range), bool)
    no_return = _left_out(nothing or {}, kept)
    dropped = _left_out({**(faults or {}), **common}, kept)
    # Copies, independent of the message's buffer.
    own = {name: np.asarray(values, np.float64)[kept] for name, values in given.items()}
    transmitted, number = own.pop("transmit_offset", None), len(range)
    angles = np.abs(own["azimuth"])
    beyond_turn = int(np.count_nonzero(angles > MAX_TURN)), float(angles.max(initial=0.0))
    own["azimuth"] = wrap(own["azimuth"])
    scan = Scan.trusted(
        **dict.fromkeys(("range_std", "azimuth_std", "time_offset")) | own,
        stamp=ns_to_seconds(stamp_ns),
        features={
            name: np.asarray(values, np.float64)[kept] for name, values in (features or {}).items()
        },
        group=None if group is None else group[kept],
    )
    sensor_scan = UnregisteredScan(
        scan=scan,
        frame_id=frame_id.lstrip("/"),  # as tf2
        north_referenced=north_referenced,
        stamp_ns=stamp_ns,
        transmit_offset=transmitted,
        height=None if height is None else height[kept],
        axes=axes or registration_axes(frame_id),
        beams=beams or scan_arc_of(azimuth),
        facts=MessageFacts(*beyond_turn, number, no_return, states or {}),
    )
    return Ping(sensor_scan, dropped, np.flatnonzero(kept), assumptions)


def _left_out(causes: Mapping[str, BoolArray], kept: BoolArray) -> dict[str, int]:
    """Remove elements from those that are kept, and return their numbers by the first cause."""
    numbers: dict[str, int] = {}
    for cause, bad in causes.items():
        count = int(np.count_nonzero(bad & kept))
        if count:
            numbers[cause] = count
            kept &= ~bad
    return numbers


def read_by(readers: Mapping[str, Callable[..., T]], message: Any, *options: Any) -> T:
    """What the reader of a message's type makes of it.

    Raises
    ------
    MessageError
        If there is no reader, or the message has other fields; and what the reader raises.
    """
    name = type_name_of(message)
    check_supported(name, readers)
    try:
        return readers[name](message, *options)
    except (AttributeError, TypeError) as error:
        field = getattr(error, "name", "") or "a value of another kind"
        raise MessageError(
            "unknown_version",
            f"this {name} is of a version that is not read: its fields differ at {field}; "
            "docs/topics.md says which versions are read",
        ) from error


def check_supported(type_name: str, readable: Collection[str]) -> None:
    """Refuse a message type that is not read.

    Raises
    ------
    MessageError
        If the type is none of those.
    """
    if type_name not in readable:
        raise MessageError(
            "unknown_type",
            f"message type {type_name!r} is not supported; supported types are "
            f"{', '.join(sorted(readable))}",
        )


def type_name_of(message: Any) -> str:
    """Present ROS name of a message's type, also of a message of a bag library."""
    kind = type(message)
    declared: str | None = getattr(kind, "__msgtype__", None)
    return present_name(declared or f"{kind.__module__.partition('.')[0]}/msg/{kind.__name__}")


def present_name(type_name: str) -> str:
    """The name of a message type in the present package."""
    package, *rest = type_name.split("/")
    return "/".join([RENAMED.get(package, package), *rest])


def stated_sound_speed(message: Any, otherwise: float) -> tuple[float, tuple[str, ...]]:
    """The sound speed of a message of marine_acoustic_msgs, m/s, and what is assumed about it.

    Parameters
    ----------
    message : ROS message
    otherwise : float
        m/s, for a message without one; 0: `SOUND_SPEED`.
    """
    speed = float(message.ping_info.sound_speed)
    if MIN_SOUND_SPEED <= speed <= MAX_SOUND_SPEED:
        return speed, ()
    name = type_name_of(message).rpartition("/")[2]
    speed = otherwise or SOUND_SPEED
    source = "the parameter sound_speed" if otherwise else "sound_speed is not set"
    return speed, (f"{name} has no sound speed: {speed:g} m/s is assumed; {source}",)


def fitted_to_ping(name: str, values: Sequence[Any] | NDArray[Any], n: int) -> FloatArray | None:
    """Values of an optional array of a message, one for each of its n detections.

    Parameters
    ----------
    name : str
        Name of the field.
    values : (0,), (1,) or (n,) or (0, k), (1, k) or (n, k) array_like
        No value, one value for all detections, or one value per detection.
    n : int
        Number of detections.

    Returns
    -------
    (n,) or (n, k) ndarray or None
        None if there are no values.

    Raises
    ------
    MessageError
        If there is another number of values.
    """
    array = np.asarray(values, np.float64)
    if len(array) == 0:
        return None
    if len(array) not in (1, n):
        raise MessageError("wrong_length", f"{name} has {len(array)} values for {n} detections")
    return np.broadcast_to(array, (n, *array.shape[1:]))


def intensity_feature(
    values: Sequence[float], n: int
) -> tuple[dict[str, FloatArray], tuple[str, ...]]:
    """The optional feature `intensity` of n detections.

    Parameters
    ----------
    values : (0,), (1,) or (n,) array_like
        As for `fitted_to_ping`.
    n : int
        Number of detections.

    Returns
    -------
    features : dict of str to (n,) ndarray
        Empty if there are no values, or another number of values.
    assumptions : tuple of str
        A sentence if there is another number of values.
    """
    try:
        intensity = fitted_to_ping("intensities", values, n)
    except MessageError:
        return {}, ("the numbers of intensities and detections differ: intensities are not used",)
    return ({} if intensity is None else {"intensity": intensity}), ()


def azimuth_of_bearing(bearing: FloatArray, reference: str) -> FloatArray:
    """Return the azimuth from the bow, or from east for bearings from north."""
    return np.pi / 2 - bearing if reference == "north" else -bearing


def ping_along_axes(frame_id: str, *position: FloatArray) -> tuple[FloatArray, ...]:
    """Return ahead, port and up of positions x, y, z in a frame whose name may state its axes."""
    columns = AXES[registration_axes(frame_id)].T
    rows = np.abs(columns).argmax(axis=1)
    return tuple(column[row] * position[row] for column, row in zip(columns, rows, strict=True))


def turn_about_z(frame_id: str) -> float:
    """Return the sign, seen from above, of angles about z in a frame whose name may state its axes.

    Raises
    ------
    MessageError
        If z is ahead by the name: angles about it are not horizontal.
    """
    axes = registration_axes(frame_id)
    if axes == "optical":
        raise MessageError(
            "frame_axes",
            f"frame {frame_id!r} has z ahead by its name, and angles about z are not horizontal: "
            f"use a frame with z up, such as {registration_frame(frame_id)!r}",
        )
    return -1.0 if axes == "down" else 1.0


def ping_in_plane(slant_range: FloatArray, elevation: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return range and height of detections at elevations (rad) above the sensor's x-y plane."""
    with np.errstate(invalid="ignore"):  # dropped as range_not_finite or elevation_not_finite
        return slant_range * np.cos(elevation), slant_range * np.sin(elevation)
