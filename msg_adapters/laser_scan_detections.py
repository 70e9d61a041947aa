"""Detections in sensor_msgs/LaserScan: at most one detection per ray of a fan.

Ray i has the angle `angle_min` + i * `angle_increment`, counter-clockwise from the frame's x axis,
and leaves i * `time_increment` after the stamp. By REP-117, a range of +inf means no detection,
-inf an object too near to measure, and nan an erroneous measurement. Other drivers and simulators
write 0, -1, nan, `range_max` or a value just below it, or a constant for no detection.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from msg_adapters.ping import (
    Ping,
    ReadingOptions,
    good_detections,
    intensity_feature,
    register,
    register_writer,
    turn_about_z,
)
from msg_adapters.stamps import time_to_ns
from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from tsepm_ros.tracker.clusters.grouping import goes_on
from tsepm_ros.tracker.scan import Arc, Scan
from tsepm_ros.tracker.sensor import SensorModel

if TYPE_CHECKING:
    from sensor_msgs.msg import LaserScan
    from std_msgs.msg import Header


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


@register("sensor_msgs/msg/LaserScan")
def read_laser_scan(scan: LaserScan, options: ReadingOptions) -> Ping:
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
    nothing = no_returns(range, limit)
    seen = np.where(np.any(list(nothing.values()), axis=0), np.inf, range)
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
        group=runs_of_rays(seen, increment, options.sensor),
        nothing=nothing,
        faults={"range_below_min": range < scan.range_min, "range_above_max": range > limit},
        states={
            "range_max (m)": float(scan.range_max),
            "sector (rad)": len(range) * abs(increment),
        },
        assumptions=assumptions,
        beams=_fan(first, increment, len(range)),
    )


def no_returns(range: FloatArray, limit: float) -> dict[str, BoolArray]:
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


def _fan(first: float, increment: float, rays: int) -> Arc | None:
    """The azimuths of all rays; None where they are not known."""
    turn = (rays - 1) * increment
    if not rays or not math.isfinite(first + turn):
        return None
    start = math.remainder(first + min(turn, 0.0), 2 * math.pi)
    return Arc(start, min(abs(turn), 2 * math.pi), whole=True)


def runs_of_rays(
    range: FloatArray, increment: float, sensor: SensorModel | None = None
) -> IntArray:
    """Which rays see one object: neighbours whose ranges do not jump, see `grouping.goes_on`.

    Parameters
    ----------
    range : (n,) ndarray
        m; any value that is not finite and above 0 ends a run.
    increment : float
        Angle between rays, rad.
    sensor : SensorModel, optional
        Its range errors.

    Returns
    -------
    (n,) ndarray of int
        Number of each ray's run.
    """
    ends = ~goes_on(range[:-1], range[1:], increment, sensor)
    return np.concatenate([[0], np.cumsum(ends)])[: len(range)]


@register_writer("sensor_msgs/msg/LaserScan")
def write_laser_scan(header: Header, scan: Scan, sound_speed: float) -> LaserScan:
    """Write each detection to the nearest free ray of `RAYS`, as if measured at the stamp.

    The message has no field for travel times.
    """
    from sensor_msgs.msg import LaserScan

    increment = 2 * np.pi / RAYS
    order = np.argsort(scan.azimuth)
    rays = np.round((scan.azimuth[order] + np.pi) / increment).astype(np.int64)
    index = np.arange(len(rays))
    rays = np.maximum.accumulate(rays - index) + index  # the next ray if a ray is occupied
    ranges = np.full(max(RAYS, rays.max(initial=0) + 1), np.inf, np.float32)
    ranges[rays] = scan.range[order]
    return LaserScan(
        header=header,
        angle_min=-np.pi,
        angle_max=-np.pi + (len(ranges) - 1) * increment,
        angle_increment=increment,
        range_max=max(float(scan.range.max(initial=0.0)), 1.0) / (1.0 - 2.0 * JUST_BELOW),
        ranges=ranges,
    )
