"""sensor_msgs/PointCloud2: reading, writing, and registered detections in it.

Reading and writing sensor_msgs/PointCloud2 with NumPy alone.

Registered detections: positions in the fixed frame, with their covariances.

Trackers then need no own-ship data and no sensor model, and viewers need no tf.

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
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from msg_adapters.stamps import MessageError
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.tracker.scan import FEATURES

if TYPE_CHECKING:
    from sensor_msgs.msg import PointCloud2, PointField
    from std_msgs.msg import Header


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


def read_fields(
    cloud: PointCloud2, names: Iterable[str], *, integers: Collection[str] = ()
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
    fields = _fields(cloud, names, integers)
    if cloud.height * cloud.width == 0:
        return {one.name: np.empty(0) for one, _ in fields}
    if not fields:
        return {}
    _check_sizes(cloud, fields)
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


def _fields(
    cloud: PointCloud2, names: Iterable[str], integers: Collection[str]
) -> list[tuple[PointField, str]]:
    """The only field of each name, and its NumPy format without byte order."""
    given = [(one.name, one) for one in cloud.fields]
    found = {name: [one for other, one in given if other == name] for name in names}
    _refuse(
        fault
        for name, some in found.items()
        if len(some) != 1
        for fault in (
            (
                "missing_field",
                not some,
                f"field {name!r} is missing; the cloud has "
                f"{', '.join(other for other, _ in given) or 'no fields'}",
            ),
            ("duplicate_field", len(some) > 1, f"field {name!r} occurs {len(some)} times"),
        )
    )
    fields = [
        (one, *_DATATYPES.get(one.datatype, (f"number {one.datatype}", "")))
        for (one,) in found.values()
    ]
    _refuse(
        fault
        for one, datatype, form in fields
        if not form.startswith("f") or one.count != 1
        for fault in (
            (
                "wrong_datatype",
                not form.startswith(tuple("fiu" if one.name in integers else "f")),
                f"field {one.name!r} must be FLOAT32 or FLOAT64; its datatype is {datatype}",
            ),
            (
                "wrong_count",
                one.count != 1,
                f"field {one.name!r} must have the count 1; it has {one.count}",
            ),
        )
    )
    return [(one, form) for one, _, form in fields]


def _check_sizes(cloud: PointCloud2, fields: list[tuple[PointField, str]]) -> None:
    """Check that fields lie in the point and do not overlap, and rows and data hold the points."""
    spans = sorted((one.offset, one.offset + int(form[1]), one.name) for one, form in fields)
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


def write_cloud(header: Header, points: NDArray[Any]) -> PointCloud2:
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


def cloud_of(header: Header, packed: NDArray[Any], is_dense: bool) -> PointCloud2:
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
    from sensor_msgs.msg import PointCloud2

    data = array.array("B")
    data.frombytes(np.ascontiguousarray(packed).view(np.uint8).data)
    return PointCloud2(
        header=header,
        height=1,
        width=len(packed),
        fields=list(_point_fields(packed.dtype)),
        is_bigendian=False,
        point_step=packed.dtype.itemsize,
        row_step=packed.nbytes,
        data=data,
        is_dense=is_dense,
    )


@lru_cache(maxsize=64)
def _point_fields(dtype: np.dtype[Any]) -> tuple[PointField, ...]:
    """Return the field descriptions of a structured dtype, cached by dtype."""
    from sensor_msgs.msg import PointField

    return tuple(PointField(**values) for values in point_fields(dtype))


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


PLACED_DTYPE = np.dtype(
    [
        *((name, "<f4") for name in ("x", "y", "z")),
        *((name, "<f8") for name in ("position_x", "position_y", "cov_xx", "cov_xy", "cov_yy")),
        ("time_offset", "<f8"),
    ],
    align=True,  # each float64 at a multiple of 8
)
"""One point of the cloud without the features, which follow."""


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
    """

    position: FloatArray
    covariance: FloatArray
    time_offset: FloatArray
    features: Mapping[str, FloatArray] = field(default_factory=dict)


def placed_detections_cloud(header: Header, placed: PlacedDetections) -> PointCloud2:
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
    points = np.zeros(len(placed.position), np.dtype(layout, align=True))
    points["position_x"], points["position_y"] = placed.position.T
    points["cov_xx"] = placed.covariance[:, 0, 0]
    points["cov_xy"] = placed.covariance[:, 0, 1]
    points["cov_yy"] = placed.covariance[:, 1, 1]
    points["time_offset"] = placed.time_offset
    with np.errstate(over="ignore"):  # values beyond float32 become infinite
        points["x"], points["y"] = placed.position.T
        for name, values in placed.features.items():
            points[name] = values
    return write_cloud(header, points)


def read_placed_detections(cloud: PointCloud2) -> PlacedDetections:
    """Read a cloud of placed detections: the inverse of `placed_detections_cloud`.

    Parameters
    ----------
    cloud : sensor_msgs.msg.PointCloud2
        With the float64 fields of this layout, in any order, and perhaps others.

    Returns
    -------
    PlacedDetections
        With the features of the cloud.

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
