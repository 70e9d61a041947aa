"""Detections in radar_msgs/RadarScan.

A return has a slant range, an azimuth about the frame's z axis from its x axis, an elevation from
its x-y plane to z, and a Doppler velocity. The definition does not specify the sign of the Doppler
velocity; here, as usual for radars and like `range_rate`, it is positive if the range increases.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from msg_adapters.detection_fields import in_plane, turn_about_z
from msg_adapters.detection_types import register, register_writer
from msg_adapters.ping import Ping, ReadingOptions, good_detections
from msg_adapters.stamps import time_to_ns
from tsepm_ros.tracker.scan import Scan

if TYPE_CHECKING:
    from radar_msgs.msg import RadarScan
    from std_msgs.msg import Header


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
