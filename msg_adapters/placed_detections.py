"""Detections where they were placed in the fixed frame, for viewers that have no tf."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from msg_adapters.point_cloud import write_cloud

if TYPE_CHECKING:
    from sensor_msgs.msg import PointCloud2
    from std_msgs.msg import Header


def placed_detections_cloud(
    header: Header,
    position: NDArray[np.float64],
    features: Mapping[str, NDArray[np.float64]],
) -> PointCloud2:
    """Build the cloud of a scan's detections as the tracks see them.

    Parameters
    ----------
    header : std_msgs.msg.Header
        The fixed frame.
    position : (n, 2) ndarray
        m.
    features : mapping of str to (n,) ndarray
        What the sensor gave besides.

    Returns
    -------
    sensor_msgs.msg.PointCloud2
        `x`, `y`, `z` = 0 and the features, all FLOAT32.
    """
    points = np.zeros(len(position), [(name, "<f4") for name in ("x", "y", "z", *features)])
    points["x"], points["y"] = position[:, 0], position[:, 1]
    with np.errstate(over="ignore"):  # what is beyond float32 becomes infinite
        for name, values in features.items():
            points[name] = values
    return write_cloud(header, points)
