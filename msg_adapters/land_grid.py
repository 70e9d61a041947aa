"""Land from nav_msgs/OccupancyGrid."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from msg_adapters.errors import MessageError
from tsepm_ros.own_ship.attitude import angles_of, rotation_of, stated_axes
from tsepm_ros.tracker.clutter.land import LandMask

if TYPE_CHECKING:
    from nav_msgs.msg import OccupancyGrid


OCCUPIED = 50
"""Least occupancy of land, from 0 to 100; -1 is unknown, and not land."""
MAX_TILT = 0.01
"""Largest tilt of a chart, rad."""


def read_land(message: OccupancyGrid) -> LandMask | None:
    """Read a chart.

    Parameters
    ----------
    message : nav_msgs.msg.OccupancyGrid
        Its origin is the pose of the corner of the first cell; the rows of `data` go along x.

    Returns
    -------
    LandMask or None
        In east and north; None where the grid has no cells.

    Raises
    ------
    MessageError
        If the grid is malformed: ``land_invalid``.
    """
    info = message.info
    width, height, number = int(info.width), int(info.height), len(message.data)
    if width * height != number:
        raise MessageError("land_invalid", f"data has {number} cells, not {width} x {height}")
    if not number:
        return None
    place, q = info.origin.position, info.origin.orientation
    try:
        yaw, pitch, roll = angles_of(rotation_of((q.x, q.y, q.z, q.w)))
        if not max(abs(pitch), abs(roll)) <= MAX_TILT:
            raise ValueError("must be level")
    except ValueError as error:
        raise MessageError("land_invalid", f"info.origin.orientation {error}") from None
    occupied = np.asarray(message.data, np.int8).reshape(height, width) >= OCCUPIED
    origin = place.x, place.y, yaw
    if stated_axes(message.header.frame_id) == "down":
        occupied, origin = occupied.T, (place.y, place.x, -yaw)
    try:
        return LandMask(occupied, float(info.resolution), origin)
    except ValueError as error:
        raise MessageError("land_invalid", f"info: {error}") from None
