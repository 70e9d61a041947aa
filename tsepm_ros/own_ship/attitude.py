"""From a tilted sensor's axes to the horizontal plane.

Axes are named as in REP-103: x ahead, y to port, z up. An attitude is yaw, pitch and roll: the
fixed axes turned by yaw about z, then by pitch about y, then by roll about x are the vessel's,
``R = Rz(yaw) Ry(pitch) Rx(roll)``. A positive pitch has the bow down, a positive roll port up.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray

SMALLEST_NORM = 1e-6
"""Of a quaternion; below, its direction is noise."""
SMALLEST_COSINE = 1e-6
"""Of the pitch; below, yaw and roll are one rotation."""
STEEPEST = 1.1
"""Slant over horizontal range beyond which a range rate says too little: 24.6 degrees."""

AXES: dict[str, FloatArray] = {
    "body": np.eye(3),
    "sonar": np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]]),
    "optical": np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]),
}
"""Ahead, port and up, as columns, in a frame's own axes: `body` x ahead, y to port, z up; `sonar`
z ahead, x up, y to starboard (marine_acoustic_msgs); `optical` z ahead, x to starboard, y down."""


def rotation_of(quaternion: Sequence[float]) -> FloatArray:
    """Matrix (3, 3) that turns vectors of the child frame into the parent's.

    Parameters
    ----------
    quaternion : sequence of 4 float
        x, y, z, w, of any length above `SMALLEST_NORM`.

    Raises
    ------
    ValueError
        If it is zero or not finite.
    """
    norm = math.hypot(*quaternion)
    if not SMALLEST_NORM < norm < math.inf:
        raise ValueError(f"must not be zero; its norm is {norm:g}")
    x, y, z, w = (component / norm for component in quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def angles_of(rotation: FloatArray) -> tuple[float, float, float]:
    """Yaw, pitch and roll (rad) of a rotation matrix, whose columns are ahead, port and up.

    Raises
    ------
    ValueError
        If ahead is straight up or down.
    """
    ahead_x, ahead_y, ahead_z = (float(value) for value in rotation[:, 0])
    level = math.hypot(ahead_x, ahead_y)
    if level < SMALLEST_COSINE:
        raise ValueError("points straight up or down and has no heading")
    roll = math.atan2(rotation[2, 1], rotation[2, 2])
    return math.atan2(ahead_y, ahead_x), math.atan2(-ahead_z, level), roll


def ahead_and_port(
    x: FloatArray, y: FloatArray, z: FloatArray, roll: FloatArray, pitch: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Horizontal components of vectors given in a tilted vessel's axes.

    The first two of ``Ry(pitch) Rx(roll) (x, y, z)``, in level axes with the vessel's heading::

        ahead = x cos(pitch) + (y sin(roll) + z cos(roll)) sin(pitch)
        port  = y cos(roll) - z sin(roll)

    Parameters
    ----------
    x, y, z : (...) ndarray
        Of any unit.
    roll, pitch : (...) ndarray
        rad.

    Returns
    -------
    ahead, port : (...) ndarray
    """
    up = y * np.sin(roll) + z * np.cos(roll)
    return x * np.cos(pitch) + up * np.sin(pitch), y * np.cos(roll) - z * np.sin(roll)


def levelled(
    range: FloatArray,
    azimuth: FloatArray,
    height: FloatArray | None,
    roll: FloatArray,
    pitch: FloatArray,
    mounting_yaw: float = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """Range and azimuth in the horizontal plane of what a tilted sensor measured.

    A detection at slant range s, azimuth a and elevation e is at ``s d``, with the direction
    ``d = (cos e cos a, cos e sin a, sin e)`` in the sensor's axes. It comes as the range
    ``r = s cos e`` in the sensor's own x-y plane and the height ``h = s sin e`` above it, so that
    nothing is lost where the sensor stands level. With the sensor turned by m on the vessel::

        w = Ry(pitch) Rx(roll) Rz(m) (r cos a, r sin a, h)
        range = hypot(w_x, w_y),  azimuth = atan2(w_y, w_x) - m

    The deviations of range and azimuth are left as they are: a tilt of 10 degrees changes them by
    1.5 %, which is less than anybody knows them by.

    Parameters
    ----------
    range, azimuth : (n,) ndarray
        m, rad.
    height : (n,) ndarray or None
        m; None: 0, in the sensor's x-y plane.
    roll, pitch : (n,) or (1,) ndarray
        Of the vessel, rad.
    mounting_yaw : float, optional
        m, rad, counter-clockwise from the vessel's bow to the sensor's x axis.

    Returns
    -------
    range : (n,) ndarray
        m; may vanish, or not be finite where the height is not of this world.
    azimuth : (n,) ndarray
        From the sensor's heading, yaw + m, counter-clockwise about the vertical, rad. Both are
        the given ones, to the bit, where roll and pitch are 0.
    """
    tilted = (roll != 0.0) | (pitch != 0.0)
    if not tilted.any():
        return range, azimuth
    angle = azimuth + mounting_yaw
    up = np.zeros_like(range) if height is None else height
    with np.errstate(over="ignore", invalid="ignore"):  # ends as a range that is not finite
        ahead, port = ahead_and_port(range * np.cos(angle), range * np.sin(angle), up, roll, pitch)
        horizontal = np.hypot(ahead, port)
    turned = np.arctan2(port, ahead) - mounting_yaw
    return np.where(tilted, horizontal, range), np.where(tilted, turned, azimuth)


def horizontal_range_rate(
    range_rate: FloatArray, slant_range: FloatArray, range: FloatArray
) -> FloatArray:
    """Rate of the horizontal range, from the rate along a slant line of sight.

    The slant range s, the horizontal range r and the height h are ``s^2 = r^2 + h^2``. Where
    target and sensor move horizontally, h stays, so that ``s ds/dt = r dr/dt``::

        dr/dt = s / r ds/dt

    A vertical velocity w of one against the other, such as the sensor's heave, adds ``w h / r`` to
    that, which is not taken out. The deviation of the rate grows by s / r, too, and is left as it
    is, for s / r is at most `STEEPEST`.

    Parameters
    ----------
    range_rate : (n,) ndarray
        ds/dt, m/s.
    slant_range, range : (n,) ndarray
        s and r, m; r may vanish.

    Returns
    -------
    (n,) ndarray
        dr/dt, m/s; nan where s / r is beyond `STEEPEST`. The given ones, to the bit, where s is r.
    """
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):  # ends as nan
        ratio = slant_range / range
        return np.where(ratio <= STEEPEST, ratio * range_rate, np.nan)
