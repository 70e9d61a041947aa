"""Detections in sensor_msgs/LaserScan: at most one for each ray of a fan.

Ray i looks at `angle_min` + i * `angle_increment`, counter-clockwise from the frame's x axis, and
leaves i * `time_increment` after the stamp. As REP-117 has it, a range of +inf is a ray on which
nothing was detected, -inf one whose object was too near to measure, nan an erroneous one. Exactly
0, where no detection can be, is what drivers older than that fill in for nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from msg_adapters.detection_fields import intensity_feature
from msg_adapters.detection_types import register, register_writer
from msg_adapters.ping import Ping, good_detections
from msg_adapters.reading_options import ReadingOptions
from msg_adapters.stamps import time_to_ns
from tsepm_ros.sensing.scan import Scan

if TYPE_CHECKING:
    from sensor_msgs.msg import LaserScan
    from std_msgs.msg import Header


NO_TIMES = (
    "the scan has no time_increment and sound_speed is 0: all rays are taken to be of the stamp, "
    "but an echo is of range / sound speed later"
)
RAYS_AT_ONCE = (
    "sound_speed is 0: every ray is taken to arrive as it leaves, as light does, but an echo is of "
    "range / sound speed later"
)

RAYS = 36_000
"""Rays all round in a written scan: far finer than a sonar's bearings."""


@register("sensor_msgs/msg/LaserScan")
def read_laser_scan(scan: LaserScan, options: ReadingOptions) -> Ping:
    """Read the detections of a scan.

    Beside the reasons of `good_detections` a ray may be dropped for ``range_below_min`` (also
    -inf) and ``range_above_max``; one on which nothing was detected is not a drop.

    Parameters
    ----------
    scan : sensor_msgs.msg.LaserScan
        `intensities` become a feature where they are as many as the ranges.
    options : ReadingOptions

    Returns
    -------
    Ping
    """
    range = np.asarray(scan.ranges, np.float64)
    rays = np.arange(len(range))
    features, assumptions = intensity_feature(scan.intensities, len(range))
    with np.errstate(invalid="ignore"):  # 0 * inf ends as azimuth_ or time_offset_not_finite
        azimuth = scan.angle_min + rays * scan.angle_increment
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
        nothing=(range == np.inf) | (range == 0.0),
        faults={
            "range_below_min": range < scan.range_min,
            "range_above_max": range > scan.range_max,
        },
        assumptions=assumptions,
    )


@register_writer("sensor_msgs/msg/LaserScan")
def write_laser_scan(header: Header, scan: Scan, sound_speed: float) -> LaserScan:
    """Write each detection on the nearest of `RAYS` rays that is free, as if measured at the stamp.

    The travel times have no place in the message.
    """
    from sensor_msgs.msg import LaserScan

    increment = 2 * np.pi / RAYS
    order = np.argsort(scan.azimuth)
    rays = np.round((scan.azimuth[order] + np.pi) / increment).astype(np.int64)
    places = np.arange(len(rays))
    rays = np.maximum.accumulate(rays - places) + places  # the next one where it is taken
    ranges = np.full(max(RAYS, rays.max(initial=0) + 1), np.inf, np.float32)
    ranges[rays] = scan.range[order]
    return LaserScan(
        header=header,
        angle_min=-np.pi,
        angle_max=-np.pi + (len(ranges) - 1) * increment,
        angle_increment=increment,
        range_max=float(scan.range.max(initial=0.0)) * (1 + 1e-6),
        ranges=ranges,
    )
