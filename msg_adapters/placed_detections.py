"""Registered detections: positions in the fixed frame, with their covariances.

Trackers then need no own-ship data and no sensor model, and viewers need no tf.

============================ ======== =========================================================
field                        datatype meaning
============================ ======== =========================================================
``x``, ``y``, ``z``          FLOAT32  position for viewers, m; z is 0
``position_x``, ``_y``       FLOAT64  position, m, fixed frame
``cov_xx``, ``_xy``, ``_yy`` FLOAT64  covariance of that position, m^2
``time_offset``              FLOAT64  time after the stamp for which the position is valid, s
the sensor's features        FLOAT32  the measured fields of `tsepm_ros.sensing.scan.FEATURES`
============================ ======== =========================================================
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from msg_adapters.point_cloud import read_fields, write_cloud
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.sensing.scan import FEATURES

if TYPE_CHECKING:
    from sensor_msgs.msg import PointCloud2
    from std_msgs.msg import Header


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
