"""Detections in radar_msgs/RadarScan.

A return has a slant range, an azimuth counter-clockwise from the frame's x axis, an elevation above
its x-y plane, and a Doppler velocity. The definition leaves the sign of that open; here, as usual
with radars, it is positive where the range grows, which is the sign of `range_rate`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from msg_adapters.detections import (
    DetectionMessage,
    ReadingOptions,
    good_detections,
    in_plane,
    register,
    register_writer,
)
from msg_adapters.stamps import time_to_ns
from tsepm_ros.numerics.arrays import FloatArray

if TYPE_CHECKING:
    from radar_msgs.msg import RadarScan
    from std_msgs.msg import Header


@register("radar_msgs/msg/RadarScan")
def read_radar_scan(scan: RadarScan, options: ReadingOptions) -> DetectionMessage:
    """Read the returns of a scan.

    Beside the reasons of `good_detections` a return may be dropped for ``elevation_not_finite``.

    Parameters
    ----------
    scan : radar_msgs.msg.RadarScan
        The amplitude becomes the feature `intensity`, the Doppler velocity `range_rate` (m/s,
        along the line of sight, against the moving radar).
    options : ReadingOptions

    Returns
    -------
    DetectionMessage
    """
    rows = [
        (one.range, one.azimuth, one.elevation, one.doppler_velocity, one.amplitude)
        for one in scan.returns
    ]
    slant_range, azimuth, elevation, doppler, amplitude = (
        np.array(rows, np.float64).reshape(-1, 5).T
    )
    range, height = in_plane(slant_range, elevation)
    return good_detections(
        time_to_ns(scan.header.stamp),
        scan.header.frame_id,
        range=range,
        azimuth=azimuth,
        height=height,
        features={"intensity": amplitude, "range_rate": doppler},
        faults={"elevation_not_finite": ~np.isfinite(elevation)},
    )


@register_writer("radar_msgs/msg/RadarScan", features=("intensity", "range_rate"))
def write_radar_scan(
    header: Header,
    range: FloatArray,
    azimuth: FloatArray,
    sound_speed: float,
    intensity: FloatArray | None = None,
    range_rate: FloatArray | None = None,
) -> RadarScan:
    """Write the detections as returns in the horizontal plane.

    The travel times have no place in the message.
    """
    from radar_msgs.msg import RadarReturn, RadarScan

    scan = RadarScan()
    scan.header = header
    unknown = np.full(len(range), math.nan)
    amplitudes = unknown if intensity is None else intensity
    rates = unknown if range_rate is None else range_rate
    for distance, angle, rate, amplitude in zip(
        range.tolist(), azimuth.tolist(), rates.tolist(), amplitudes.tolist(), strict=True
    ):
        one = RadarReturn()
        one.range, one.azimuth = distance, angle
        one.doppler_velocity, one.amplitude = rate, amplitude
        scan.returns.append(one)
    return scan
