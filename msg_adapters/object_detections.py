"""Detections in lists of objects: vision_msgs/Detection3DArray and radar_msgs/RadarScan.

The position of a detection in a Detection3DArray is the centre of its bounding box or, if the box
is not set (centre and size are zero), the pose of its result with the highest score. The frame has
x ahead and y to port, or the axes that its name states: see `tsepm_ros.own_ship.registration`.

A return in a RadarScan has a slant range, an azimuth about the frame's z axis from its x axis, an
elevation from its x-y plane to z, and a Doppler velocity. The definition does not specify the sign
of the Doppler velocity; here, as usual for radars and like `range_rate`, it is positive if the
range increases.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from msg_adapters.ping import (
    Ping,
    ReadingOptions,
    along_axes,
    good_detections,
    in_plane,
    register,
    register_writer,
    turn_about_z,
)
from msg_adapters.stamps import NANOSECONDS_PER_SECOND, MessageError, time_to_ns
from tsepm_ros.numerics.arrays import BoolArray, FloatArray
from tsepm_ros.own_ship.registration import AXES, stated_axes
from tsepm_ros.tracker.scan import Scan

if TYPE_CHECKING:
    from radar_msgs.msg import RadarScan
    from std_msgs.msg import Header
    from vision_msgs.msg import Detection3D, Detection3DArray


@register("vision_msgs/msg/Detection3DArray")
def read_detection_array(array: Detection3DArray, options: ReadingOptions) -> Ping:
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
    position = _rows([_position(*both) for both in zip(detections, best, strict=True)], 3)
    ahead, port, up = along_axes(frame, *position.T)
    range_std, azimuth_std = _deviations(best, ahead, port, AXES[stated_axes(frame)])
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
            "other_frame": _each(detections, lambda d: d.header.frame_id.lstrip("/") not in names),
            "no_position": _each(detections, lambda d: not (_has_box(d) or d.results)),
        },
    )


def _each(detections: Any, condition: Callable[[Any], bool]) -> BoolArray:
    return np.array([condition(detection) for detection in detections], bool)


def _rows(rows: list[Any], width: int) -> FloatArray:
    return np.array(rows, np.float64).reshape(-1, width)


def _score(result: Any) -> float:
    """Return the score of a result; -inf if it is nan."""
    score = float(result.hypothesis.score)
    return score if score == score else -np.inf


def _has_box(detection: Detection3D) -> bool:
    center, size = detection.bbox.center.position, detection.bbox.size
    return any(value != 0.0 for at in (center, size) for value in (at.x, at.y, at.z))


def _position(detection: Detection3D, best: Any) -> tuple[float, float, float]:
    """Return x, y, z, m; zeros without a box and a result."""
    at = detection.bbox.center.position
    if best is not None and not _has_box(detection):
        at = best.pose.pose.position
    return at.x, at.y, at.z


def _time_after(stamp_ns: int, detection: Detection3D) -> float:
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
    covariance = _rows([result.pose.covariance for result in best], 36).reshape(-1, 6, 6)
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


@register_writer("vision_msgs/msg/Detection3DArray")
def write_detection_array(header: Header, scan: Scan, sound_speed: float) -> Detection3DArray:
    """Write the detections as boxes of zero size in the horizontal plane, valid at the stamp.

    The message has no field for travel times.
    """
    from vision_msgs.msg import Detection3D, Detection3DArray

    array = Detection3DArray()
    array.header = header
    ahead, port = scan.range * np.cos(scan.azimuth), scan.range * np.sin(scan.azimuth)
    for x, y in zip(ahead, port, strict=True):
        detection = Detection3D()
        detection.header = header
        center = detection.bbox.center.position
        center.x, center.y = float(x), float(y)
        array.detections.append(detection)
    return array


@register("radar_msgs/msg/RadarScan")
def read_radar_scan(scan: RadarScan, options: ReadingOptions) -> Ping:
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
    range, height = in_plane(slant_range, turn * elevation)
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


@register_writer("radar_msgs/msg/RadarScan")
def write_radar_scan(header: Header, scan: Scan, sound_speed: float) -> RadarScan:
    """Write the detections as returns in the horizontal plane.

    The message has no field for travel times.
    """
    from radar_msgs.msg import RadarReturn, RadarScan

    message = RadarScan()
    message.header = header
    unknown = np.full(len(scan), math.nan)
    rates = scan.features.get("range_rate", unknown)
    amplitudes = scan.features.get("intensity", unknown)
    columns = (scan.range, scan.azimuth, rates, amplitudes)
    for row in zip(*(column.tolist() for column in columns), strict=True):
        echo = RadarReturn()
        echo.range, echo.azimuth, echo.doppler_velocity, echo.amplitude = row
        message.returns.append(echo)
    return message
