"""Units, angles and lengths of what detection messages give."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msg_adapters.errors import MessageError
from tsepm_ros.numerics.arrays import FloatArray


def fitted(name: str, values: Sequence[Any] | NDArray[Any], n: int) -> FloatArray | None:
    """Values of an array that a message need not give, one for each of its n detections.

    Parameters
    ----------
    name : str
        Name of the field.
    values : (0,), (1,) or (n,) or (0, k), (1, k) or (n, k) array_like
        None given, one for all, or one each.
    n : int
        Number of detections.

    Returns
    -------
    (n,) or (n, k) ndarray or None
        None if no values are given.

    Raises
    ------
    MessageError
        If there are more or fewer.
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
    """The feature `intensity` of n detections; they are good without it, too.

    Parameters
    ----------
    values : (0,), (1,) or (n,) array_like
        As for `fitted`.
    n : int
        Number of detections.

    Returns
    -------
    features : dict of str to (n,) ndarray
        Empty where no values are given, or another number of them.
    assumptions : tuple of str
        Says so where it is another number.
    """
    try:
        found = fitted("intensities", values, n)
    except MessageError:
        return {}, ("intensities are not as many as detections: they are not used",)
    return ({} if found is None else {"intensity": found}), ()


def azimuth_of_bearing(bearing: FloatArray, reference: str) -> FloatArray:
    """Return the azimuth from the bow, or from east for bearings from north."""
    return np.pi / 2 - bearing if reference == "north" else -bearing


def in_plane(slant_range: FloatArray, elevation: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return range and height of detections at elevations (rad) above the sensor's x-y plane."""
    with np.errstate(invalid="ignore"):  # ends as range_not_finite or elevation_not_finite
        return slant_range * np.cos(elevation), slant_range * np.sin(elevation)
