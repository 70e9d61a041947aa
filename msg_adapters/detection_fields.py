"""Units, angles and lengths of the arrays in detection messages."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msg_adapters.errors import MessageError
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.own_ship.attitude import AXES, stated_axes, without_suffix


def fitted(name: str, values: Sequence[Any] | NDArray[Any], n: int) -> FloatArray | None:
    """Values of an optional array of a message, one for each of its n detections.

    Parameters
    ----------
    name : str
        Name of the field.
    values : (0,), (1,) or (n,) or (0, k), (1, k) or (n, k) array_like
        No value, one value for all detections, or one value per detection.
    n : int
        Number of detections.

    Returns
    -------
    (n,) or (n, k) ndarray or None
        None if there are no values.

    Raises
    ------
    MessageError
        If there is another number of values.
    """
    array = np.asarray(values, np.float64)
    if len(array) == 0:
        return None
    if len(array) not in (1, n):
        raise MessageError("wrong_length", f"{name} has {len(array)} values for {n} detections")
    return np.broadcast_to(array, (n, *array.shape[1:]))


def intensity_feature(
    values: Sequence[float], n: int
) -> tuple[dict[str, FloatArray], tuple[str, ...]]:
    """The optional feature `intensity` of n detections.

    Parameters
    ----------
    values : (0,), (1,) or (n,) array_like
        As for `fitted`.
    n : int
        Number of detections.

    Returns
    -------
    features : dict of str to (n,) ndarray
        Empty if there are no values, or another number of values.
    assumptions : tuple of str
        A sentence if there is another number of values.
    """
    try:
        intensity = fitted("intensities", values, n)
    except MessageError:
        return {}, ("the numbers of intensities and detections differ: intensities are not used",)
    return ({} if intensity is None else {"intensity": intensity}), ()


def azimuth_of_bearing(bearing: FloatArray, reference: str) -> FloatArray:
    """Return the azimuth from the bow, or from east for bearings from north."""
    return np.pi / 2 - bearing if reference == "north" else -bearing


def along_axes(frame_id: str, *position: FloatArray) -> tuple[FloatArray, ...]:
    """Return ahead, port and up of positions x, y, z in a frame whose name may state its axes."""
    columns = AXES[stated_axes(frame_id)].T
    rows = np.abs(columns).argmax(axis=1)
    return tuple(column[row] * position[row] for column, row in zip(columns, rows, strict=True))


def turn_about_z(frame_id: str) -> float:
    """Return the sign, seen from above, of angles about z in a frame whose name may state its axes.

    Raises
    ------
    MessageError
        If z is ahead by the name: angles about it are not horizontal.
    """
    axes = stated_axes(frame_id)
    if axes == "optical":
        raise MessageError(
            "frame_axes",
            f"frame {frame_id!r} has z ahead by its name, and angles about z are not horizontal: "
            f"use a frame with z up, such as {without_suffix(frame_id)!r}",
        )
    return -1.0 if axes == "down" else 1.0


def in_plane(slant_range: FloatArray, elevation: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return range and height of detections at elevations (rad) above the sensor's x-y plane."""
    with np.errstate(invalid="ignore"):  # dropped as range_not_finite or elevation_not_finite
        return slant_range * np.cos(elevation), slant_range * np.sin(elevation)
