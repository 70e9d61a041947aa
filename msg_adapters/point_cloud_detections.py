"""Detections in sensor_msgs/PointCloud2.

The position is taken from the first of these that the cloud has:

1. `range` (m) and `azimuth` (rad, counter-clockwise from the sensor's x axis);
2. `range` and `bearing` (rad, clockwise from the bow or from north);
3. `x` and `y` (m, sensor frame), with `z` where the cloud has it.

Optional: `elevation` (rad, above the sensor's x-y plane) beside a range, which is the slant range;
`range_std`, `azimuth_std`, `time_offset`, `intensity`, `range_width`, `azimuth_width`,
`range_rate`. Each field is FLOAT32 or FLOAT64; `intensity`, which has no unit, may be an integer.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from msg_adapters.detections import (
    DetectionMessage,
    ReadingOptions,
    azimuth_of_bearing,
    good_detections,
    in_plane,
    register,
    register_writer,
)
from msg_adapters.errors import MessageError
from msg_adapters.point_cloud import read_fields, write_cloud
from msg_adapters.stamps import time_to_ns

if TYPE_CHECKING:
    from sensor_msgs.msg import PointCloud2
    from std_msgs.msg import Header

FloatArray = NDArray[np.float64]

POSITION_FIELDS = (("range", "azimuth"), ("range", "bearing"), ("x", "y"))
"""The forms of a position, in order of precedence."""

ERROR_FIELDS = ("range_std", "azimuth_std", "time_offset")
FEATURE_FIELDS = ("intensity", "range_width", "azimuth_width", "range_rate")


NO_TIMES = (
    "the detections have no time_offset and sound_speed is 0: all are taken to be of the stamp, "
    "but an echo is of range / sound speed later"
)


@register("sensor_msgs/msg/PointCloud2")
def read_point_cloud(cloud: PointCloud2, options: ReadingOptions) -> DetectionMessage:
    """Read the detections of a cloud.

    Parameters
    ----------
    cloud : sensor_msgs.msg.PointCloud2
        One point per detection.
    options : ReadingOptions

    Returns
    -------
    DetectionMessage

    Raises
    ------
    MessageError
        If the cloud has no form of a position (an empty one needs no fields at all), or a field
        that is used is malformed.
    """
    if not cloud.fields and cloud.height * cloud.width == 0:
        nothing = np.zeros(0)
        return good_detections(
            time_to_ns(cloud.header.stamp), cloud.header.frame_id, range=nothing, azimuth=nothing
        )
    there = {field.name for field in cloud.fields}
    position = _position_fields(there)
    upward = "z" if position == ("x", "y") else "elevation"
    optional = [name for name in (upward, *ERROR_FIELDS, *FEATURE_FIELDS) if name in there]
    values = read_fields(cloud, [*position, *optional], integers=("intensity",))
    first, second = position
    range, azimuth = _polar(values[first], values[second], position, options)
    height, faults = values.get("z"), {}
    if "elevation" in values:
        range, height = in_plane(range, values["elevation"])
        faults = {"elevation_not_finite": ~np.isfinite(values["elevation"])}
    return good_detections(
        time_to_ns(cloud.header.stamp),
        cloud.header.frame_id,
        range=range,
        azimuth=azimuth,
        height=height,
        faults=faults,
        features={name: values[name] for name in FEATURE_FIELDS if name in values},
        north_referenced="bearing" in position and options.bearing_reference == "north",
        range_std=values.get("range_std"),
        azimuth_std=values.get("azimuth_std"),
        time_offset=values.get("time_offset"),
        assumptions=() if "time_offset" in there or options.sound_speed else (NO_TIMES,),
    )


def _position_fields(there: set[str]) -> tuple[str, str]:
    for names in POSITION_FIELDS:
        if there.issuperset(names):
            return names
    raise MessageError(
        "missing_field",
        "a detection needs the fields 'range' and 'azimuth', or 'range' and 'bearing', or 'x' and "
        f"'y'; the cloud has {', '.join(sorted(there)) or 'none'}",
    )


def _polar(
    first: FloatArray, second: FloatArray, names: tuple[str, str], options: ReadingOptions
) -> tuple[FloatArray, FloatArray]:
    """Return range and azimuth of positions in any form."""
    if names == ("range", "bearing"):
        return first, azimuth_of_bearing(second, options.bearing_reference)
    if names == ("x", "y"):
        with np.errstate(over="ignore", invalid="ignore"):  # ends as range_not_finite
            return np.hypot(first, second), np.arctan2(second, first)
    return first, second


def detections_cloud(
    header: Header,
    *,
    range: ArrayLike,
    azimuth: ArrayLike | None = None,
    bearing: ArrayLike | None = None,
    bearing_reference: str | None = "bow",
    **optional: ArrayLike | None,
) -> PointCloud2:
    """Build a cloud of detections that `read_point_cloud` reads back without loss.

    First come `x`, `y`, `z` = 0 in the sensor frame as FLOAT32, which RViz and PCL need, then what
    is given here as FLOAT64. Bearings not from the bow are the exception: where they lie in the
    sensor frame is not known without the heading, so such a cloud has no `x`, `y`, `z`, and RViz
    does not show it.

    Parameters
    ----------
    header : std_msgs.msg.Header
        Stamp of the scan and the sensor's frame.
    range : (n,) array_like
        m. No value is checked here.
    azimuth, bearing : (n,) array_like
        rad. Exactly one is given.
    bearing_reference : {"bow", "north"} or None, optional
        What `bearing` is measured from, clockwise; None: not known here, the reader's to say.
    **optional : (n,) array_like or None
        `range_std`, `azimuth_std`, `time_offset`, `intensity`, `range_width`, `azimuth_width` or
        `range_rate`; None leaves a field out.

    Returns
    -------
    sensor_msgs.msg.PointCloud2

    Raises
    ------
    ValueError
        If both or none of azimuth and bearing are given, a name is not known, or a shape differs.
    """
    if bearing_reference is not None:
        ReadingOptions(bearing_reference)
    if (azimuth is None) == (bearing is None):
        raise ValueError("exactly one of azimuth and bearing must be given")
    unknown = sorted(set(optional) - {*ERROR_FIELDS, *FEATURE_FIELDS})
    if unknown:
        raise ValueError(f"{unknown[0]} is not a field of detections")
    given = {"range": range, "azimuth": azimuth, "bearing": bearing, **optional}
    fields = {name: np.asarray(v, np.float64) for name, v in given.items() if v is not None}
    for name, values in fields.items():
        if values.ndim != 1 or values.shape != fields["range"].shape:
            raise ValueError(
                f"{name} must be of one dimension and as long as range; got {values.shape}"
            )
    if bearing is None:
        return write_cloud(header, _with_xyz(fields, fields["azimuth"]))
    if bearing_reference == "bow":
        return write_cloud(header, _with_xyz(fields, azimuth_of_bearing(fields["bearing"], "bow")))
    return write_cloud(header, _points(fields, ()))


@register_writer("sensor_msgs/msg/PointCloud2", takes_range_rate=True)
def write_point_cloud(
    header: Header,
    range: FloatArray,
    azimuth: FloatArray,
    sound_speed: float,
    range_rate: FloatArray | None = None,
) -> PointCloud2:
    """Write everything, the times in `time_offset`."""
    times = range / sound_speed if sound_speed > 0.0 else np.zeros(len(range))
    return detections_cloud(
        header, range=range, azimuth=azimuth, time_offset=times, range_rate=range_rate
    )


def _with_xyz(fields: dict[str, FloatArray], azimuth: FloatArray) -> NDArray[np.void]:
    points = _points(fields, ("x", "y", "z"))
    with np.errstate(invalid="ignore"):  # an infinite azimuth has no position
        points["x"] = fields["range"] * np.cos(azimuth)
        points["y"] = fields["range"] * np.sin(azimuth)
    return points


def _points(fields: dict[str, FloatArray], coordinates: tuple[str, ...]) -> NDArray[np.void]:
    dtype = np.dtype(
        [*((name, np.float32) for name in coordinates), *((name, np.float64) for name in fields)],
        align=True,
    )
    points = np.zeros(len(fields["range"]), dtype)
    for name, values in fields.items():
        points[name] = values
    return points
