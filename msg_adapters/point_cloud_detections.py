"""Detections in sensor_msgs/PointCloud2.

The position is the first of these forms that the cloud has:

1. `range` (m) and `azimuth` (rad, counter-clockwise from the sensor's x axis);
2. `range` and `bearing` (rad, clockwise from the bow or from north);
3. `x` and `y` (m, sensor frame), with `z` if the cloud has it.

Optional: `elevation` (rad, above the sensor's x-y plane) with a range, which is the slant range;
`range_std`, `azimuth_std`; `time_offset`, or `two_way_travel_time`, which is twice that, or both:
then the echo was sent at `time_offset` - half of the travel, as by a beam that turns; `intensity`,
`range_width`, `azimuth_width`, `range_rate`. Each field is FLOAT32 or FLOAT64; `intensity`, which
has no unit, may be an integer.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from msg_adapters.ping import (
    Ping,
    ReadingOptions,
    along_axes,
    azimuth_of_bearing,
    good_detections,
    in_plane,
    register,
    register_writer,
)
from msg_adapters.point_cloud import read_fields, write_cloud
from msg_adapters.stamps import MessageError, time_to_ns
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.own_ship.registration import stated_axes
from tsepm_ros.tracker.scan import FEATURES, Scan

if TYPE_CHECKING:
    from sensor_msgs.msg import PointCloud2
    from std_msgs.msg import Header


POSITION_FIELDS = (("range", "azimuth"), ("range", "bearing"), ("x", "y"))
"""The forms of a position, in order of precedence."""

TIME_FIELDS = ("time_offset", "two_way_travel_time")
"""Fields with the time at which a position is valid, in order of precedence."""

OPTIONAL_FIELDS = ("elevation", "range_std", "azimuth_std", *TIME_FIELDS, *FEATURES)
"""Optional fields of a detection whose position is a range and an angle."""

NO_TIMES = (
    "the detections have no time_offset and no two_way_travel_time, and sound_speed is 0: all are "
    "assumed valid at the stamp, but an echo is valid range / sound speed later"
)

OTHER_AXES = (
    "the name of the frame states other axes than x ahead and z up (REP-103): azimuth and bearing "
    "are still read as seen from above, counter-clockwise and clockwise from ahead"
)


@register("sensor_msgs/msg/PointCloud2")
def read_point_cloud(cloud: PointCloud2, options: ReadingOptions) -> Ping:
    """Read the detections of a cloud.

    Parameters
    ----------
    cloud : sensor_msgs.msg.PointCloud2
        One point per detection.
    options : ReadingOptions

    Returns
    -------
    Ping

    Raises
    ------
    MessageError
        If the cloud has no form of a position (an empty cloud needs no fields), or a field that is
        used is malformed.
    """
    if not cloud.fields and cloud.height * cloud.width == 0:
        empty = np.zeros(0)
        stamp_ns = time_to_ns(cloud.header.stamp)
        return good_detections(stamp_ns, cloud.header.frame_id, options, range=empty, azimuth=empty)
    available = {field.name for field in cloud.fields}
    position = _position_fields(available)
    upward = "z" if position == ("x", "y") else "elevation"
    supported = (upward, *(name for name in OPTIONAL_FIELDS if name != "elevation"))
    optional = [name for name in supported if name in available]
    values = read_fields(cloud, [*position, *optional], integers=("intensity",))
    timed = options.sound_speed or not available.isdisjoint(TIME_FIELDS)
    return detections_of_fields(
        time_to_ns(cloud.header.stamp),
        cloud.header.frame_id,
        values,
        options,
        assumptions=() if timed else (NO_TIMES,),
    )


def detections_of_fields(
    stamp_ns: int,
    frame_id: str,
    values: Mapping[str, FloatArray],
    options: ReadingOptions,
    assumptions: tuple[str, ...] = (),
) -> Ping:
    """Read detections from arrays with the names of a cloud's fields.

    In addition to the reasons of `good_detections`, a detection may be dropped for
    ``elevation_not_finite``. A two-way travel time is twice a `time_offset` that is missing, and
    its faults are counted as faults of that; beside one it tells when the echo was sent.

    Parameters
    ----------
    stamp_ns : int
        ns.
    frame_id : str
        The sensor's frame.
    values : mapping of str to (n,) ndarray
        A position in one of `POSITION_FIELDS` and optional fields, SI and radians.
    options : ReadingOptions
    assumptions : tuple of str, optional
        As in `Ping`.

    Raises
    ------
    MessageError
        If there is no form of a position.
    """
    position = _position_fields(set(values))
    first, second = position
    axes = stated_axes(frame_id)
    height, faults, travel = values.get("z"), {}, values.get("two_way_travel_time")
    if position == ("x", "y"):
        if axes == "optical" and height is None:
            raise MessageError("missing_field", f"frame {frame_id!r} has z ahead: 'z' is needed")
        z = np.zeros_like(values["x"]) if height is None else height
        ahead, port, up = along_axes(frame_id, values["x"], values["y"], z)
        height = None if height is None else up
        with np.errstate(over="ignore", invalid="ignore"):  # dropped as range_not_finite
            range, azimuth = np.hypot(ahead, port), np.arctan2(port, ahead)
    else:
        range, azimuth = values[first], values[second]
        if second == "bearing":
            azimuth = azimuth_of_bearing(azimuth, options.bearing_reference)
        assumptions += () if axes == "body" else (OTHER_AXES,)
    if "elevation" in values:
        range, height = in_plane(range, values["elevation"])
        faults = {"elevation_not_finite": ~np.isfinite(values["elevation"])}
    echo = values.get("time_offset", None if travel is None else 0.5 * travel)
    with np.errstate(invalid="ignore"):  # dropped as not finite
        sent = None if echo is None or travel is None else echo - 0.5 * travel
    return good_detections(
        stamp_ns,
        frame_id,
        options,
        range=range,
        azimuth=azimuth,
        height=height,
        faults=faults,
        features={name: values[name] for name in FEATURES if name in values},
        north_referenced="bearing" in position and options.bearing_reference == "north",
        range_std=values.get("range_std"),
        azimuth_std=values.get("azimuth_std"),
        time_offset=echo,
        transmit_offset=sent,
        assumptions=assumptions,
    )


def _position_fields(available: set[str]) -> tuple[str, str]:
    for names in POSITION_FIELDS:
        if available.issuperset(names):
            return names
    raise MessageError(
        "missing_field",
        "a detection needs the fields 'range' and 'azimuth', or 'range' and 'bearing', or 'x' and "
        f"'y'; the cloud has {', '.join(sorted(available)) or 'no fields'}",
    )


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

    The first fields are `x`, `y`, `z` in the sensor frame as FLOAT32, which RViz and PCL need; the
    given fields follow as FLOAT64. Positions of bearings not from the bow are unknown in the sensor
    frame without the heading; a cloud of them has no `x`, `y`, `z`, and RViz does not show it.

    Parameters
    ----------
    header : std_msgs.msg.Header
        Stamp of the scan and the sensor's frame.
    range : (n,) array_like
        m. No value is checked here.
    azimuth, bearing : (n,) array_like
        rad. Exactly one is given.
    bearing_reference : {"bow", "north"} or None, optional
        Reference direction of `bearing`, which is positive clockwise; None: an option of the
        reader.
    **optional : (n,) array_like or None
        `elevation`, `range_std`, `azimuth_std`, `time_offset`, `two_way_travel_time`, `intensity`,
        `range_width`, `azimuth_width` or `range_rate`; None leaves a field out.

    Returns
    -------
    sensor_msgs.msg.PointCloud2

    Raises
    ------
    ValueError
        If both or none of azimuth and bearing are given, a name is unknown, or a shape differs.
    """
    if bearing_reference is not None:
        ReadingOptions(bearing_reference)
    if (azimuth is None) == (bearing is None):
        raise ValueError("exactly one of azimuth and bearing must be given")
    unknown = sorted(set(optional) - {*OPTIONAL_FIELDS})
    if unknown:
        raise ValueError(f"{unknown[0]} is not a field of detections")
    given = {"range": range, "azimuth": azimuth, "bearing": bearing, **optional}
    fields = {name: np.asarray(v, np.float64) for name, v in given.items() if v is not None}
    for name, values in fields.items():
        if values.ndim != 1 or values.shape != fields["range"].shape:
            raise ValueError(
                f"{name} must have one dimension and the length of range; got {values.shape}"
            )
    if bearing is None:
        return write_cloud(header, _with_xyz(fields, fields["azimuth"]))
    if bearing_reference == "bow":
        return write_cloud(header, _with_xyz(fields, azimuth_of_bearing(fields["bearing"], "bow")))
    return write_cloud(header, _points(fields, ()))


@register_writer("sensor_msgs/msg/PointCloud2")
def write_point_cloud(header: Header, scan: Scan, sound_speed: float) -> PointCloud2:
    """Write all data of the scan, with the times in `time_offset`."""
    times = scan.range / sound_speed if sound_speed > 0.0 else np.zeros(len(scan))
    features: dict[str, Any] = {
        name: scan.features[name] for name in FEATURES if name in scan.features
    }
    return detections_cloud(
        header, range=scan.range, azimuth=scan.azimuth, time_offset=times, **features
    )


def _with_xyz(fields: dict[str, FloatArray], azimuth: FloatArray) -> NDArray[np.void]:
    points = _points(fields, ("x", "y", "z"))
    range = fields["range"]
    if "elevation" in fields:
        range, points["z"] = in_plane(range, fields["elevation"])
    with np.errstate(invalid="ignore"):  # an infinite azimuth has no position
        points["x"] = range * np.cos(azimuth)
        points["y"] = range * np.sin(azimuth)
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
