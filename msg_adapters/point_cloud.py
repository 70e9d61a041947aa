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
"""sensor_msgs/PointCloud2: reading and writing, the detections of drivers, and registered ones.

Fields are read and written with NumPy alone.

The position of a driver's detection is the first of these forms that the cloud has:

1. `range` (m) and `rx_angle` (rad, to starboard from the z axis of a frame with z ahead and x up,
   as in marine_acoustic_msgs);
2. `range` and `azimuth` (rad, counter-clockwise from the sensor's x axis);
3. `range` and `bearing` (rad, clockwise from the bow or from north);
4. `x` and `y` (m, sensor frame), with `z` if the cloud has it.

Optional: `elevation` (rad, above the sensor's x-y plane) with a range, which is the slant range;
`range_std`, `azimuth_std`; `time_offset`, or `two_way_travel_time`, which is twice that, or both:
then the echo was sent at `time_offset` - half of the travel, as by a beam that turns; `intensity`,
`range_width`, `azimuth_width`, `range_rate`. Each field is FLOAT32 or FLOAT64; `intensity`, which
has no unit, may be an integer.

Registered detections are positions in the fixed frame, with their covariances. Trackers then need
no own-ship data and no sensor model, and viewers need no tf.

============================ ======== =========================================================
field                        datatype meaning
============================ ======== =========================================================
``x``, ``y``, ``z``          FLOAT32  position for viewers, m; z is 0
``position_x``, ``_y``       FLOAT64  position, m, fixed frame
``cov_xx``, ``_xy``, ``_yy`` FLOAT64  covariance of that position, m^2
``time_offset``              FLOAT64  time after the stamp for which the position is valid, s
the sensor's features        FLOAT32  the measured fields of `tsepm_ros.tracker.scan.FEATURES`
============================ ======== =========================================================
"""

from __future__ import annotations

import array
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from msg_adapters import messages
from msg_adapters.ping import (
    Ping,
    ReadingOptions,
    azimuth_of_bearing,
    good_detections,
    ping_along_axes,
    ping_in_plane,
)
from msg_adapters.stamps import MessageError, time_to_ns
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.own_ship.registration import registration_axes
from tsepm_ros.tracker.scan import FEATURES, Scan

# The numbers are those of the message definition of sensor_msgs/PointField.
_DATATYPES = {
    1: ("INT8", "i1"),
    2: ("UINT8", "u1"),
    3: ("INT16", "i2"),
    4: ("UINT16", "u2"),
    5: ("INT32", "i4"),
    6: ("UINT32", "u4"),
    7: ("FLOAT32", "f4"),
    8: ("FLOAT64", "f8"),
}
_NUMBER_OF_FORMAT = {form: number for number, (_, form) in _DATATYPES.items()}
POSITION_FIELDS = ("range", "rx_angle"), ("range", "azimuth"), ("range", "bearing"), ("x", "y")
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
PLACED_DTYPE = np.dtype(
    [
        *((name, "<f4") for name in ("x", "y", "z")),
        *((name, "<f8") for name in ("position_x", "position_y", "cov_xx", "cov_xy", "cov_yy")),
        ("time_offset", "<f8"),
    ],
    align=True,  # each float64 at a multiple of 8
)
"""One point of the cloud without the features, which follow."""


def read_fields(
    cloud: messages.PointCloud2, names: Iterable[str], *, integers: Collection[str] = ()
) -> dict[str, NDArray[np.float64]]:
    """Read fields of a cloud.

    Fields may have any order, offset, padding and byte order; the cloud may be organised, with
    padding after its rows. Only the requested fields are checked. The sizes of a cloud without
    points are not checked.

    Parameters
    ----------
    cloud : sensor_msgs.msg.PointCloud2
        Of height h and width w.
    names : iterable of str
        The fields to read.
    integers : collection of str, optional
        Names of fields that may also have an integer datatype.

    Returns
    -------
    dict of str to (h * w,) ndarray of float64
        A copy of each field, row by row.

    Raises
    ------
    MessageError
        If a field is missing, occurs twice, has a datatype that is not allowed, is not a scalar, or
        is not inside the point; if the rows are shorter than their points, or the data than the
        rows.
    """
    fields = _cloud_fields(cloud, names, integers)
    if cloud.height * cloud.width == 0:
        return {point_field.name: np.empty(0) for point_field, _ in fields}
    if not fields:
        return {}
    _check_cloud_sizes(cloud, fields)
    order = ">" if cloud.is_bigendian else "<"
    layout = {
        "names": [field.name for field, _ in fields],
        "formats": [order + form for _, form in fields],
        "offsets": [field.offset for field, _ in fields],
        "itemsize": cloud.point_step,
    }
    points: NDArray[Any] = np.ndarray(
        (cloud.height, cloud.width),
        np.dtype(layout),  # type: ignore[call-overload]
        np.frombuffer(cloud.data, np.uint8),
        0,
        (cloud.row_step, cloud.point_step),
    )
    with np.errstate(invalid="ignore"):  # a signalling NaN is read as a NaN
        return {
            field.name: points[field.name].astype(np.float64, order="C").ravel()
            for field, _ in fields
        }


def _cloud_fields(
    cloud: messages.PointCloud2, names: Iterable[str], integers: Collection[str]
) -> list[tuple[messages.PointField, str]]:
    """The only field of each name, and its NumPy format without byte order."""
    given = [(field.name, field) for field in cloud.fields]
    by_name = {name: [field for other_name, field in given if other_name == name] for name in names}
    _refuse(
        fault
        for name, some in by_name.items()
        if len(some) != 1
        for fault in (
            (
                "missing_field",
                not some,
                f"field {name!r} is missing; the cloud has "
                f"{', '.join(other_name for other_name, _ in given) or 'no fields'}",
            ),
            ("duplicate_field", len(some) > 1, f"field {name!r} occurs {len(some)} times"),
        )
    )
    fields = [
        (field, *_DATATYPES.get(field.datatype, (f"number {field.datatype}", "")))
        for (field,) in by_name.values()
    ]
    _refuse(
        fault
        for field, datatype, form in fields
        if not form.startswith("f") or field.count != 1
        for fault in (
            (
                "wrong_datatype",
                not form.startswith(tuple("fiu" if field.name in integers else "f")),
                f"field {field.name!r} must be FLOAT32 or FLOAT64; its datatype is {datatype}",
            ),
            (
                "wrong_count",
                field.count != 1,
                f"field {field.name!r} must have the count 1; it has {field.count}",
            ),
        )
    )
    return [(field, form) for field, _, form in fields]


def _check_cloud_sizes(
    cloud: messages.PointCloud2, fields: list[tuple[messages.PointField, str]]
) -> None:
    """Check that fields lie in the point and do not overlap, and rows and data hold the points."""
    spans = sorted(
        (field.offset, field.offset + int(form[1]), field.name) for field, form in fields
    )
    row, size = cloud.width * cloud.point_step, cloud.height * cloud.row_step
    beyond = f"beyond point_step = {cloud.point_step}"
    _refuse(
        [
            *(
                (
                    "bad_offset",
                    True,
                    f"field {name!r} ends at byte {end}, {beyond}",
                )
                for _, end, name in spans
                if end > cloud.point_step
            ),
            *(
                ("bad_offset", True, f"fields {name!r} and {following!r} overlap")
                for (_, end, name), (start, _, following) in pairwise(spans)
                if start < end
            ),
            (
                "bad_row_step",
                cloud.row_step < row,
                f"row_step = {cloud.row_step} is less than width * point_step = {row}",
            ),
            (
                "short_data",
                len(cloud.data) < size,
                f"data has {len(cloud.data)} bytes, less than height * row_step = {size}",
            ),
        ]
    )


def _refuse(faults: Iterable[tuple[str, bool, str]]) -> None:
    """Raise the first fault that applies: reason, whether it does, and sentence."""
    for reason, applies, sentence in faults:
        if applies:
            raise MessageError(reason, sentence)


def write_cloud(header: messages.Header, points: NDArray[Any]) -> messages.PointCloud2:
    """Write a little-endian cloud of height 1 with the offsets of the array's dtype.

    Padding is zero, so equal points give equal bytes.

    Parameters
    ----------
    header : std_msgs.msg.Header
    points : (n,) structured ndarray
        Its fields are scalars of 8 to 32 bit integers or 32 or 64 bit floats.

    Returns
    -------
    sensor_msgs.msg.PointCloud2
        ``is_dense`` is true if every float of every point is finite.

    Raises
    ------
    ValueError
        If the array has another form.
    """
    if points.ndim != 1 or points.dtype.names is None:
        raise ValueError("points must be a structured array of one dimension")
    packed = np.zeros(len(points), points.dtype.newbyteorder("<"))
    for name in points.dtype.names:
        packed[name] = points[name]
    floats = [packed[name] for name in points.dtype.names if points.dtype[name].kind == "f"]
    return cloud_of(header, packed, all(bool(np.isfinite(values).all()) for values in floats))


def cloud_of(header: messages.Header, packed: NDArray[Any], is_dense: bool) -> messages.PointCloud2:
    """Make the cloud of points that are already little-endian with zero padding.

    Parameters
    ----------
    header : std_msgs.msg.Header
    packed : (n,) structured ndarray
        As for `write_cloud`.
    is_dense : bool
        Whether every float is finite.

    Returns
    -------
    sensor_msgs.msg.PointCloud2
    """
    return messages.PointCloud2(
        header=header,
        height=1,
        width=len(packed),
        fields=list(_point_fields(packed.dtype)),
        is_bigendian=False,
        point_step=packed.dtype.itemsize,
        row_step=packed.nbytes,
        data=array.array("B", packed.tobytes()),
        is_dense=is_dense,
    )


@lru_cache(maxsize=64)
def _point_fields(dtype: np.dtype[Any]) -> tuple[messages.PointField, ...]:
    """Return the field descriptions of a structured dtype, cached by dtype."""
    return tuple(messages.PointField(**values) for values in point_fields(dtype))


def point_fields(dtype: np.dtype[Any]) -> list[dict[str, Any]]:
    """Return the values of sensor_msgs/PointField for every field of a structured dtype.

    Raises
    ------
    ValueError
        If a field has a type that PointCloud2 does not support.
    """
    descriptions = []
    for name, (form, offset, *_) in (dtype.fields or {}).items():
        number = _NUMBER_OF_FORMAT.get(f"{form.kind}{form.itemsize}")
        if number is None:
            raise ValueError(
                f"points: field {name!r} has the type {form}, which PointCloud2 does not support"
            )
        descriptions.append({"name": name, "offset": offset, "datatype": number, "count": 1})
    return descriptions


def read_point_cloud(cloud: messages.PointCloud2, options: ReadingOptions) -> Ping:
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
    axes = registration_axes(frame_id)
    height, faults, travel = values.get("z"), {}, values.get("two_way_travel_time")
    if position == ("x", "y"):
        if axes == "optical" and height is None:
            raise MessageError("missing_field", f"frame {frame_id!r} has z ahead: 'z' is needed")
        z = np.zeros_like(values["x"]) if height is None else height
        ahead, port, up = ping_along_axes(frame_id, values["x"], values["y"], z)
        height = None if height is None else up
        with np.errstate(over="ignore", invalid="ignore"):  # dropped as range_not_finite
            range, azimuth = np.hypot(ahead, port), np.arctan2(port, ahead)
    else:
        range, azimuth = values[first], values[second]
        if second == "bearing":
            azimuth = azimuth_of_bearing(azimuth, options.bearing_reference)
        if second == "rx_angle":
            axes, azimuth = "sonar", -azimuth
        assumptions += () if axes in ("body", "sonar") else (OTHER_AXES,)
    if "elevation" in values:
        range, height = ping_in_plane(range, values["elevation"])
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
        axes=axes,
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
    header: messages.Header,
    *,
    range: ArrayLike,
    azimuth: ArrayLike | None = None,
    bearing: ArrayLike | None = None,
    rx_angle: ArrayLike | None = None,
    bearing_reference: str | None = "bow",
    **optional: ArrayLike | None,
) -> messages.PointCloud2:
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
    azimuth, bearing, rx_angle : (n,) array_like
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
        If none or several of the angles are given, a name is unknown, or a shape differs.
    """
    if bearing_reference is not None:
        ReadingOptions(bearing_reference)
    angles = {"azimuth": azimuth, "bearing": bearing, "rx_angle": rx_angle}
    if sum(angle is not None for angle in angles.values()) != 1:
        raise ValueError("exactly one of azimuth, bearing and rx_angle must be given")
    unknown = sorted(set(optional) - {*OPTIONAL_FIELDS})
    if unknown:
        raise ValueError(f"{unknown[0]} is not a field of detections")
    given = {"range": range, **angles, **optional}
    fields = {name: np.asarray(v, np.float64) for name, v in given.items() if v is not None}
    for name, values in fields.items():
        if values.ndim != 1 or values.shape != fields["range"].shape:
            raise ValueError(
                f"{name} must have one dimension and the length of range; got {values.shape}"
            )
    if bearing is not None and bearing_reference != "bow":
        return write_cloud(header, _cloud_points(fields, ()))
    if bearing is not None:
        angle = azimuth_of_bearing(fields["bearing"], "bow")
    else:
        angle = fields["azimuth"] if rx_angle is None else -fields["rx_angle"]
    points, plane = _cloud_points(fields, ("x", "y", "z")), fields["range"]
    ahead, port, up = ("x", "y", "z") if rx_angle is None else ("z", "y", "x")
    if "elevation" in fields:
        plane, points[up] = ping_in_plane(plane, fields["elevation"])
    with np.errstate(invalid="ignore"):  # an infinite azimuth has no position
        points[ahead], points[port] = plane * np.cos(angle), plane * np.sin(angle)
    if rx_angle is not None:
        points[port] *= -1.0  # y to starboard
    return write_cloud(header, points)


def write_point_cloud(
    header: messages.Header, scan: Scan, sound_speed: float
) -> messages.PointCloud2:
    """Write all data of the scan, with the times in `time_offset`."""
    times = scan.range / sound_speed if sound_speed > 0.0 else np.zeros(len(scan))
    features: dict[str, Any] = {
        name: scan.features[name] for name in FEATURES if name in scan.features
    }
    return detections_cloud(
        header, range=scan.range, azimuth=scan.azimuth, time_offset=times, **features
    )


def _cloud_points(fields: dict[str, FloatArray], coordinates: tuple[str, ...]) -> NDArray[np.void]:
    dtype = np.dtype(
        [*((name, np.float32) for name in coordinates), *((name, np.float64) for name in fields)],
        align=True,
    )
    points = np.zeros(len(fields["range"]), dtype)
    for name, values in fields.items():
        points[name] = values
    return points


@dataclass(frozen=True, eq=False)
class PlacedDetections:
    """The n detections of a ping in the fixed frame.

    Attributes
    ----------
    position : (n, 2) ndarray
        m.
    covariance : (n, 2, 2) ndarray
        Of the position, m^2.
    time_offset : (n,) ndarray
        Time after the ping's stamp for which the position is valid, s.
    features : mapping of str to (n,) ndarray
        Further measurements of the sensor.
    sensor : int or None
        Of several sensors the number of this one, from 0.
    """

    position: FloatArray
    covariance: FloatArray
    time_offset: FloatArray
    features: Mapping[str, FloatArray] = field(default_factory=dict)
    sensor: int | None = None


def placed_detections_cloud(
    header: messages.Header, placed: PlacedDetections
) -> messages.PointCloud2:
    """Build the cloud of a ping's registered detections.

    Parameters
    ----------
    header : std_msgs.msg.Header
        The fixed frame, and the ping's stamp.
    placed : PlacedDetections

    Returns
    -------
    sensor_msgs.msg.PointCloud2
    """
    layout = [(name, PLACED_DTYPE[name]) for name in PLACED_DTYPE.names or ()]
    layout += [(name, np.dtype("<f4")) for name in placed.features]
    layout += [("sensor", np.dtype("u1"))] * (placed.sensor is not None)
    points = np.zeros(len(placed.position), np.dtype(layout, align=True))
    points["position_x"], points["position_y"] = placed.position.T
    points["cov_xx"] = placed.covariance[:, 0, 0]
    points["cov_xy"] = placed.covariance[:, 0, 1]
    points["cov_yy"] = placed.covariance[:, 1, 1]
    points["time_offset"] = placed.time_offset
    if placed.sensor is not None:
        points["sensor"] = placed.sensor
    with np.errstate(over="ignore"):  # values beyond float32 become infinite
        points["x"], points["y"] = placed.position.T
        for name, values in placed.features.items():
            points[name] = values
    return write_cloud(header, points)


def read_placed_detections(cloud: messages.PointCloud2) -> PlacedDetections:
    """Read a cloud of placed detections: the inverse of `placed_detections_cloud`.

    Parameters
    ----------
    cloud : sensor_msgs.msg.PointCloud2
        With the float64 fields of this layout, in any order, and perhaps others.

    Returns
    -------
    PlacedDetections
        With the features of the cloud, without the sensor.

    Raises
    ------
    MessageError
        If a field is missing or malformed.
    """
    available = {field.name for field in cloud.fields}
    features = [name for name in FEATURES if name in available]
    names = (PLACED_DTYPE.names or ())[3:]
    values = read_fields(cloud, (*names, *features))
    xx, xy, yy = (values[name] for name in ("cov_xx", "cov_xy", "cov_yy"))
    return PlacedDetections(
        position=np.stack([values["position_x"], values["position_y"]], axis=-1),
        covariance=np.stack([xx, xy, xy, yy], axis=-1).reshape(-1, 2, 2),
        time_offset=values["time_offset"],
        features={name: values[name] for name in features},
    )
