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
"""Detections in messages of every type: the readers and writers, and their tables.

A reader is a function of a message and :class:`ReadingOptions` that returns a :class:`Ping`: the
good detections, with its drops and assumptions. A writer converts a scan to a message, for
simulations. Each type has a row in `READERS` and in `WRITERS`.

sensor_msgs/PointCloud2 has a module of its own, `point_cloud`.

sensor_msgs/LaserScan has at most one detection per ray of a fan. Ray i has the angle `angle_min` +
i * `angle_increment`, counter-clockwise from the frame's x axis, and leaves i * `time_increment`
after the stamp. By REP-117, a range of +inf means no detection, -inf an object too near to measure,
and nan an erroneous measurement. Other drivers and simulators write 0, -1, nan, `range_max` or a
value just below it, or a constant for no detection.

The frame of marine_acoustic_msgs/SonarDetections and SonarRanges has z out of the sonar's face, x
up and y to starboard. An array is empty if it is not reported, has one value if it is constant, and
otherwise one value per beam.

The position of a detection in a vision_msgs/Detection3DArray is the centre of its bounding box or,
if the box is not set (centre and size are zero), the pose of its result with the highest score. The
frame has x ahead and y to port, or the axes that its name states: see
`tsepm_ros.own_ship.registration`.

A return in a radar_msgs/RadarScan has a slant range, an azimuth about the frame's z axis from its x
axis, an elevation from its x-y plane to z, and a Doppler velocity. The definition does not specify
the sign of the Doppler velocity; here, as usual for radars and like `range_rate`, it is positive if
the range increases.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Collection
from typing import Any

import numpy as np

from msg_adapters import messages
from msg_adapters.ping import (
    Ping,
    ReadingOptions,
    check_supported,
    fitted_to_ping,
    good_detections,
    intensity_feature,
    ping_along_axes,
    ping_in_plane,
    read_by,
    stated_sound_speed,
    turn_about_z,
)
from msg_adapters.point_cloud import read_point_cloud, write_point_cloud
from msg_adapters.stamps import NANOSECONDS_PER_SECOND, MessageError, time_to_ns
from tsepm_ros.numerics.arrays import BoolArray, FloatArray
from tsepm_ros.own_ship.registration import AXES, registration_axes
from tsepm_ros.tracker.scan import Scan, ScanArc
from tsepm_ros.tracker.sensor import SensorModel, rays_go_on

NO_TIMES = (
    "the scan has no time_increment and sound_speed is 0: all detections are assumed valid at the "
    "stamp, but an echo is valid range / sound speed later"
)
RAYS_AT_ONCE = (
    "sound_speed is 0: every ray is assumed to arrive when it leaves, like light, but an echo is "
    "valid range / sound speed later"
)

NO_RANGE_MAX = (
    "range_max of the scan is 0, or not above range_min: the driver does not set it, and no limit "
    "is applied; it must set the largest range in m"
)

ROUNDING, JUST_BELOW = 1e-6, 2e-3
"""Distances from `range_max`, as parts of it: of a range that is `range_max`, and of equal ranges
of several rays that are no return."""
MIN_TIES, MIN_TIED_SHARE = 8, 0.1
"""Least number and share of rays of one and the same largest range that are no return."""
NEAR_TIES = 0.01
"""Part of that range in which hardly any other range lies, since walls have several."""

RAYS = 36_000
"""Number of rays of a written all-round scan, much finer than the bearings of a sonar."""
_MAX_ANGLE = float(np.float32(np.pi / 2))  # the float32 is slightly larger than pi / 2
_ROUNDING = 1e-6  # of the squared sine of a float32 angle


def read_laser_scan(scan: messages.LaserScan, options: ReadingOptions) -> Ping:
    """Read the detections of a scan.

    In addition to the reasons of `good_detections`, a ray may be dropped for ``range_below_min``
    (also -inf) and ``range_above_max``; a ray without a detection is not counted.

    Parameters
    ----------
    scan : sensor_msgs.msg.LaserScan
        `intensities` become a feature if their number equals that of the ranges.
    options : ReadingOptions

    Returns
    -------
    Ping
    """
    range = np.asarray(scan.ranges, np.float64)
    rays = np.arange(len(range))
    turn = turn_about_z(scan.header.frame_id)
    first, increment = turn * float(scan.angle_min), turn * float(scan.angle_increment)
    features, assumptions = intensity_feature(scan.intensities, len(range))
    limit = float(scan.range_max)
    if not limit > max(float(scan.range_min), 0.0):
        limit, assumptions = math.inf, (*assumptions, NO_RANGE_MAX)
    nothing = rays_without_detection(range, limit)
    seen = np.where(np.any(list(nothing.values()), axis=0), np.inf, range)
    jumps = ~rays_go_on(seen[:-1], seen[1:], increment, options.sensor)  # to another object
    with np.errstate(invalid="ignore"):  # 0 * inf is dropped as azimuth_ or time_offset_not_finite
        azimuth = np.asarray(first + rays * increment, np.float64)
        leaving = echo = rays * scan.time_increment if scan.time_increment else None
        if leaving is not None and options.sound_speed > 0.0:
            echo = leaving + range / options.sound_speed
    if options.sound_speed == 0.0:
        assumptions += (NO_TIMES if leaving is None else RAYS_AT_ONCE,)
    return good_detections(
        time_to_ns(scan.header.stamp),
        scan.header.frame_id,
        options,
        range=range,
        azimuth=azimuth,
        time_offset=echo,
        transmit_offset=leaving,
        features=features,
        group=np.concatenate([[0], np.cumsum(jumps)])[: len(range)],
        nothing=nothing,
        faults={"range_below_min": range < scan.range_min, "range_above_max": range > limit},
        states={
            "range_max (m)": float(scan.range_max),
            "sector (rad)": len(range) * abs(increment),
        },
        assumptions=assumptions,
        beams=_fan(first, increment, len(range)),
    )


def rays_without_detection(range: FloatArray, limit: float) -> dict[str, BoolArray]:
    """Rays without a return, by the value that says so.

    A constant is the largest range of many rays, in a scan that has no other value for no return.

    Parameters
    ----------
    range : (n,) ndarray
        m, any values.
    limit : float
        `range_max`, m; infinite if it is not set.

    Returns
    -------
    dict of str to (n,) ndarray of bool
    """
    known = np.isfinite(range) & (range > 0.0)
    values, numbers = np.unique(range[known], return_counts=True)
    above = values > limit
    above &= (above.sum() == 1) & (numbers[above].sum() > 1)  # else a limit that is too small
    near_limit = (values >= limit * (1.0 - JUST_BELOW)) & (numbers > 1)
    at_limit = (near_limit | (values >= limit * (1.0 - ROUNDING))) & (values <= limit)
    top = values.max(initial=0.0)
    near_top = numbers[values >= (1.0 - NEAR_TIES) * top].sum() / (1.0 + MIN_TIED_SHARE)
    tied = numbers >= max(MIN_TIES, MIN_TIED_SHARE * len(range), near_top)
    alone = known.all() and not (at_limit | above).any()
    return {
        "inf": range == np.inf,
        "nan": np.isnan(range),
        "0 or below": np.isfinite(range) & (range <= 0.0),
        "at or just below range_max": np.isin(range, values[at_limit]),
        "a constant above range_max": np.isin(range, values[above]),
        "a constant": np.isin(range, values[alone & tied & (values == top)]),
    }


def _fan(first: float, increment: float, rays: int) -> ScanArc | None:
    """The azimuths of all rays; None where they are not known."""
    turn = (rays - 1) * increment
    if not rays or not math.isfinite(first + turn):
        return None
    start = math.remainder(first + min(turn, 0.0), 2 * math.pi)
    return ScanArc(start, min(abs(turn), 2 * math.pi), whole=True)


def write_laser_scan(header: messages.Header, scan: Scan, sound_speed: float) -> messages.LaserScan:
    """Write each detection to the nearest free ray of `RAYS`, as if measured at the stamp.

    The message has no field for travel times.
    """
    increment = 2 * np.pi / RAYS
    order = np.argsort(scan.azimuth)
    rays = np.round((scan.azimuth[order] + np.pi) / increment).astype(np.int64)
    index = np.arange(len(rays))
    rays = np.maximum.accumulate(rays - index) + index  # the next ray if a ray is occupied
    ranges = np.full(max(RAYS, rays.max(initial=0) + 1), np.inf, np.float32)
    ranges[rays] = scan.range[order]
    return messages.LaserScan(
        header=header,
        angle_min=-np.pi,
        angle_max=-np.pi + (len(ranges) - 1) * increment,
        angle_increment=increment,
        range_max=max(float(scan.range.max(initial=0.0)), 1.0) / (1.0 - 2.0 * JUST_BELOW),
        ranges=ranges,
    )


def read_sonar_detections(message: messages.SonarDetections, options: ReadingOptions) -> Ping:
    """Read the detections of a multibeam sonar's travel times.

    In addition to the reasons of `good_detections`, a beam may be dropped for ``flagged_bad`` and
    for ``direction_undefined``: angles that are not finite, exceed 90 degrees, or together define
    no direction. A transmit angle that is not reported is 0.

    Parameters
    ----------
    message : marine_acoustic_msgs.msg.SonarDetections
        The range is half of the travel time times the sound speed.
    options : ReadingOptions
        Its sound speed is used if the message has none.

    Returns
    -------
    Ping
        Azimuths from ahead to port.

    Raises
    ------
    MessageError
        If travel times or receive angles are missing, or an array has another length.
    """
    n = _beams(two_way_travel_times=message.two_way_travel_times, rx_angles=message.rx_angles)
    travel = _detection_of_beams("two_way_travel_times", message.two_way_travel_times, n)
    rx = _detection_of_beams("rx_angles", message.rx_angles, n)
    tx = _detection_of_beams("tx_angles", message.tx_angles, n)
    with np.errstate(invalid="ignore"):
        up, starboard = np.sin(tx), np.sin(rx)
        ahead = 1.0 - up**2 - starboard**2
        undefined = ~((ahead >= -_ROUNDING) & (abs(rx) <= _MAX_ANGLE) & (abs(tx) <= _MAX_ANGLE))
        direction = np.stack([up, starboard, np.sqrt(np.maximum(ahead, 0.0))], axis=1)
    speed, assumptions = stated_sound_speed(message, options.sound_speed)
    return _detections(
        message,
        options,
        slant_range=0.5 * speed * travel,
        half_travel_time=0.5 * travel,
        delay=_detection_of_beams("tx_delays", message.tx_delays, n),
        direction=direction,
        undefined=undefined,
        assumptions=assumptions,
    )


def read_sonar_ranges(message: messages.SonarRanges, options: ReadingOptions) -> Ping:
    """Read the detections of a sonar's ranges along beams.

    In addition to the reasons of `good_detections`, a beam may be dropped for ``flagged_bad`` and
    for ``direction_undefined``: a vector that is zero or not finite.

    Parameters
    ----------
    message : marine_acoustic_msgs.msg.SonarRanges
        Its vectors need not be of unit length.
    options : ReadingOptions
        Its sound speed, which determines the times of the echoes, is used if the message has none.

    Returns
    -------
    Ping
        Azimuths from ahead to port.

    Raises
    ------
    MessageError
        If ranges or vectors are missing, or an array has another length.
    """
    n = _beams(ranges=message.ranges, beam_unit_vec=message.beam_unit_vec)
    slant_range = _detection_of_beams("ranges", message.ranges, n)
    vectors = [(vector.x, vector.y, vector.z) for vector in message.beam_unit_vec]
    beam = _detection_of_beams("beam_unit_vec", vectors, n).reshape(n, 3)
    with np.errstate(all="ignore"):
        largest = np.abs(beam).max(axis=1, initial=0.0, keepdims=True)  # its square may overflow
        direction = beam / largest
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    speed, assumptions = stated_sound_speed(message, options.sound_speed)
    return _detections(
        message,
        options,
        slant_range=slant_range,
        half_travel_time=slant_range / speed,
        delay=_detection_of_beams("transmit_delays", message.transmit_delays, n),
        direction=direction,
        undefined=~np.isfinite(direction).all(axis=1),
        assumptions=assumptions,
    )


def _beams(**arrays: Any) -> int:
    """Return the number of beams of the arrays that give ranges and directions."""
    lengths = {name: len(values) for name, values in arrays.items()}
    missing = [name for name, length in lengths.items() if not length]
    if missing and any(lengths.values()):
        raise MessageError("missing_field", f"{missing[0]} is empty: the beams have no position")
    return max(lengths.values())


def _detection_of_beams(name: str, values: Any, n: int) -> FloatArray:
    """Return one value per beam; zeros if the array is not reported."""
    per_beam = fitted_to_ping(name, values, n)
    return np.zeros(n) if per_beam is None else per_beam


def _detections(
    message: Any,
    options: ReadingOptions,
    *,
    slant_range: FloatArray,
    half_travel_time: FloatArray,
    delay: FloatArray,
    direction: FloatArray,
    undefined: BoolArray,
    assumptions: tuple[str, ...],
) -> Ping:
    """Return the detections of beams: m, s, s after the stamp, unit vectors (n, 3)."""
    n = len(slant_range)
    flags = _detection_of_beams("flags", [flag.flag for flag in message.flags], n)
    features, more = intensity_feature(message.intensities, n)
    up, starboard, ahead = direction.T
    with np.errstate(invalid="ignore"):  # dropped as not finite or direction_undefined
        range = slant_range * np.hypot(starboard, ahead)
        azimuth = np.arctan2(-starboard, ahead)
        height = slant_range * up
        echo = delay + half_travel_time
    return good_detections(
        time_to_ns(message.header.stamp),
        message.header.frame_id,
        options,
        range=range,
        azimuth=azimuth,
        height=height,
        time_offset=echo,
        transmit_offset=delay,
        features=features,
        axes="sonar",
        states={"sound speed (m/s)": float(message.ping_info.sound_speed)},
        faults={"flagged_bad": flags != 0, "direction_undefined": undefined},
        assumptions=(*assumptions, *more),
    )


def write_sonar_detections(
    header: messages.Header, scan: Scan, sound_speed: float
) -> messages.SonarDetections:
    """Write the detections ahead; the message has no directions abeam and astern."""
    _check_sound_speed(sound_speed)
    ahead = np.cos(scan.azimuth) > 0.0
    angles = -np.arctan2(np.sin(scan.azimuth), np.cos(scan.azimuth))
    message = messages.SonarDetections(
        header=header,
        two_way_travel_times=(2.0 * scan.range[ahead] / sound_speed).tolist(),
        rx_angles=angles[ahead].tolist(),
    )
    message.ping_info.sound_speed = sound_speed
    return message


def write_sonar_ranges(
    header: messages.Header, scan: Scan, sound_speed: float
) -> messages.SonarRanges:
    """Write the detections as beams in the horizontal plane."""
    _check_sound_speed(sound_speed)
    vectors = [
        messages.Vector3(y=-math.sin(angle), z=math.cos(angle)) for angle in scan.azimuth.tolist()
    ]
    message = messages.SonarRanges(header=header, ranges=scan.range.tolist(), beam_unit_vec=vectors)
    message.ping_info.sound_speed = sound_speed
    return message


def _check_sound_speed(sound_speed: float) -> None:
    if sound_speed <= 0.0:
        raise ValueError(
            "sound_speed of the scenario must be above 0: the messages contain travel times"
        )


def read_detection_array(array: messages.Detection3DArray, options: ReadingOptions) -> Ping:
    """Read the detections of an array.

    In addition to the reasons of `good_detections`, a detection may be dropped for ``other_frame``,
    if its own header has another frame, and ``no_position``: neither a box nor a result.

    Parameters
    ----------
    array : vision_msgs.msg.Detection3DArray
        The score of the best result becomes the feature `intensity`. Its covariance gives the
        standard deviations of range and azimuth, if every detection has a nonzero covariance. A
        detection whose own header has a stamp is valid at that stamp.
    options : ReadingOptions

    Returns
    -------
    Ping
    """
    detections, frame = array.detections, array.header.frame_id
    names = ("", frame.lstrip("/"))
    best = [max(detection.results, key=_score, default=None) for detection in detections]
    position = [_position(*both) for both in zip(detections, best, strict=True)]
    ahead, port, up = ping_along_axes(frame, *np.array(position, np.float64).reshape(-1, 3).T)
    range_std, azimuth_std = _deviations(best, ahead, port, AXES[registration_axes(frame)])
    stamp_ns = time_to_ns(array.header.stamp)
    times = np.array([_time_after(stamp_ns, detection) for detection in detections])
    intensity = np.array([np.nan if result is None else _score(result) for result in best])
    with np.errstate(over="ignore"):  # dropped as range_not_finite
        range = np.hypot(ahead, port)
    return good_detections(
        stamp_ns,
        frame,
        options,
        range=range,
        azimuth=np.arctan2(port, ahead),
        height=up,
        range_std=range_std,
        azimuth_std=azimuth_std,
        # Light has no delay.
        time_offset=times if times.any() else None,
        transmit_offset=times if times.any() else None,
        features={"intensity": intensity},
        faults={
            "other_frame": _each_detection(
                detections, lambda d: d.header.frame_id.lstrip("/") not in names
            ),
            "no_position": _each_detection(detections, lambda d: not (_has_box(d) or d.results)),
        },
    )


def _each_detection(detections: Any, condition: Callable[[Any], bool]) -> BoolArray:
    return np.array([condition(detection) for detection in detections], bool)


def _score(result: Any) -> float:
    """Return the score of a result; -inf if it is nan. Older versions have no hypothesis."""
    score = float(getattr(result, "hypothesis", result).score)
    return score if score == score else -np.inf


def _has_box(detection: messages.Detection3D) -> bool:
    center, size = detection.bbox.center.position, detection.bbox.size
    return any(value != 0.0 for at in (center, size) for value in (at.x, at.y, at.z))


def _position(detection: messages.Detection3D, best: Any) -> tuple[float, float, float]:
    """Return x, y, z, m; zeros without a box and a result."""
    at = detection.bbox.center.position
    if best is not None and not _has_box(detection):
        at = best.pose.pose.position
    return at.x, at.y, at.z


def _time_after(stamp_ns: int, detection: messages.Detection3D) -> float:
    """Return the time after the array's stamp, s; 0 without a stamp, nan for an invalid stamp."""
    try:
        own = time_to_ns(detection.header.stamp)
    except MessageError:
        return math.nan  # dropped as time_offset_not_finite
    return (own - stamp_ns) / NANOSECONDS_PER_SECOND if own else 0.0


def _deviations(
    best: list[Any], ahead: FloatArray, port: FloatArray, axes: FloatArray
) -> tuple[FloatArray | None, FloatArray | None]:
    """Return the standard deviations of range (m) and azimuth (rad), if every result has them."""
    if not best or None in best:
        return None, None
    covariance = np.reshape([result.pose.covariance for result in best], (-1, 6, 6))
    rows = np.abs(axes[:, :2]).argmax(axis=0)
    signs = axes[rows, [0, 1]]
    plane = covariance[:, rows][:, :, rows] * np.outer(signs, signs)
    if not plane.any(axis=(1, 2)).all():
        return None, None
    with np.errstate(all="ignore"):  # dropped as range_std_ or azimuth_std_not_positive
        range = np.hypot(ahead, port)
        along = np.stack([ahead, port], axis=1) / range[:, None]
        across = along[:, ::-1] * [-1.0, 1.0]
        variances = [np.einsum("ni,nij,nj->n", axis, plane, axis) for axis in (along, across)]
        return np.sqrt(variances[0]), np.sqrt(variances[1]) / range


def write_detection_array(
    header: messages.Header, scan: Scan, sound_speed: float
) -> messages.Detection3DArray:
    """Write the detections as boxes of zero size in the horizontal plane, valid at the stamp.

    The message has no field for travel times.
    """
    array = messages.Detection3DArray(header=header)
    for distance, azimuth in zip(scan.range.tolist(), scan.azimuth.tolist(), strict=True):
        detection = messages.Detection3D(header=header)
        center = detection.bbox.center.position
        center.x, center.y = distance * math.cos(azimuth), distance * math.sin(azimuth)
        array.detections.append(detection)
    return array


def read_radar_scan(scan: messages.RadarScan, options: ReadingOptions) -> Ping:
    """Read the returns of a scan.

    In addition to the reasons of `good_detections`, a return may be dropped for
    ``elevation_not_finite``.

    Parameters
    ----------
    scan : radar_msgs.msg.RadarScan
        The amplitude becomes the feature `intensity`, the Doppler velocity the feature
        `range_rate` (m/s, along the line of sight, relative to the moving radar).
    options : ReadingOptions

    Returns
    -------
    Ping
    """
    rows = [
        (echo.range, echo.azimuth, echo.elevation, echo.doppler_velocity, echo.amplitude)
        for echo in scan.returns
    ]
    slant_range, azimuth, elevation, doppler, amplitude = (
        np.array(rows, np.float64).reshape(-1, 5).T
    )
    turn = turn_about_z(scan.header.frame_id)
    range, height = ping_in_plane(slant_range, turn * elevation)
    return good_detections(
        time_to_ns(scan.header.stamp),
        scan.header.frame_id,
        options,
        range=range,
        azimuth=turn * azimuth,
        height=height,
        features={"intensity": amplitude, "range_rate": doppler},
        faults={"elevation_not_finite": ~np.isfinite(elevation)},
    )


def write_radar_scan(header: messages.Header, scan: Scan, sound_speed: float) -> messages.RadarScan:
    """Write the detections as returns in the horizontal plane.

    The message has no field for travel times.
    """
    unknown = np.full(len(scan), math.nan)
    columns = {
        "range": scan.range,
        "azimuth": scan.azimuth,
        "doppler_velocity": scan.features.get("range_rate", unknown),
        "amplitude": scan.features.get("intensity", unknown),
    }
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    echoes = [messages.RadarReturn(**dict(zip(columns, row, strict=True))) for row in rows]
    return messages.RadarScan(header=header, returns=echoes)


READERS: dict[str, Callable[[Any, ReadingOptions], Ping]] = {
    "sensor_msgs/msg/PointCloud2": read_point_cloud,
    "sensor_msgs/msg/LaserScan": read_laser_scan,
    "marine_acoustic_msgs/msg/SonarDetections": read_sonar_detections,
    "marine_acoustic_msgs/msg/SonarRanges": read_sonar_ranges,
    "vision_msgs/msg/Detection3DArray": read_detection_array,
    "radar_msgs/msg/RadarScan": read_radar_scan,
}
"""Every reader, by the message type that it reads."""
WRITERS: dict[str, Callable[[messages.Header, Scan, float], Any]] = {
    "sensor_msgs/msg/PointCloud2": write_point_cloud,
    "sensor_msgs/msg/LaserScan": write_laser_scan,
    "marine_acoustic_msgs/msg/SonarDetections": write_sonar_detections,
    "marine_acoustic_msgs/msg/SonarRanges": write_sonar_ranges,
    "vision_msgs/msg/Detection3DArray": write_detection_array,
    "radar_msgs/msg/RadarScan": write_radar_scan,
}


def supported_types() -> tuple[str, ...]:
    """Return the sorted names of the message types that `read_detections` supports."""
    return tuple(sorted(READERS))


def read_detections(
    message: Any,
    *,
    bearing_reference: str = "bow",
    sound_speed: float = 0.0,
    sensor: SensorModel | None = None,
) -> Ping:
    """Read a detection message of any supported type.

    Bad detections are left out and counted; an unusable message is an error.

    Parameters
    ----------
    message : ROS message
        Of one of `supported_types`. Only its attributes are used, so messages of a bag library are
        possible if their ``__msgtype__`` is the name of the type.
    bearing_reference : {"bow", "north"}, optional
        Reference direction of a field `bearing`, which is positive clockwise. An azimuth is always
        counter-clockwise from the sensor's x axis.
    sound_speed : float, optional
        m/s. If it is not 0 and a message has no times, the ping is assumed to leave at the stamp:
        `time_offset` is range / sound_speed. It also applies to messages with an unset field for
        the sound speed; for these, 0 means SOUND_SPEED.
    sensor : SensorModel, optional
        Its range errors, by which the rays of one object in a `LaserScan` differ.

    Returns
    -------
    Ping

    Raises
    ------
    MessageError
        If the type is not supported or the message is malformed.
    ValueError
        If an option has a value that is not allowed.
    """
    return read_by(READERS, message, ReadingOptions(bearing_reference, sound_speed, sensor))


def write_detections(
    type_name: str, header: messages.Header, scan: Scan, *, sound_speed: float
) -> Any:
    """Make a message of any supported type, like a sonar driver.

    Data without a field in the type is left out: see the writer of its module.

    Parameters
    ----------
    type_name : str
        One of `supported_types`.
    header : std_msgs.msg.Header
        Stamp of the scan and the sensor's frame.
    scan : Scan
        Its ranges, azimuths and features are written; the stamp is that of the header.
    sound_speed : float
        m/s; 0: the echoes arrive without delay.

    Returns
    -------
    ROS message

    Raises
    ------
    MessageError
        If the type is not supported, or its package is not installed.
    ValueError
        If the type needs a travel time and the sound speed is 0.
    """
    message_class(type_name)
    return WRITERS[type_name](header, scan, sound_speed)


def message_class(type_name: str, readable: Collection[str] | None = None) -> type:
    """Import the class of a supported message type.

    Parameters
    ----------
    type_name : str
        One of those.
    readable : collection of str, optional
        The supported types; by default `supported_types`.

    Raises
    ------
    MessageError
        If the type is not supported, or its package is not installed.
    """
    check_supported(type_name, READERS if readable is None else readable)
    try:
        return installed_class(type_name)
    except (ImportError, AttributeError) as error:
        raise MessageError(
            "package_not_installed",
            f"message type {type_name!r} needs the package {type_name.partition('/')[0]!r}, which "
            f"is not installed or too old ({error})",
        ) from error


def installed_class(type_name: str) -> type:
    """The class of a message type; ImportError or AttributeError if it is not installed."""
    package, _, name = type_name.split("/")
    message_type: type = getattr(importlib.import_module(f"{package}.msg"), name)
    return message_type
