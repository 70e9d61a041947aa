"""Attitude of frames: rotations, and the names of axes.

Attitude: from a tilted sensor's axes to the horizontal plane.

Axes are named as in REP-103: x ahead, y to port, z up. An attitude is yaw, pitch and roll: the
rotation of the fixed axes by yaw about z, then by pitch about y, then by roll about x gives the
vessel's axes, ``R = Rz(yaw) Ry(pitch) Rx(roll)``. Positive pitch is bow down, positive roll is
port up.

Axes that the name of a frame states, by the suffixes of REP-103.

Inside, detections are ahead and to port of the sensor, and poses and tracks in east and north. A
fixed frame whose name ends in `_ned` or `_frd` has x north, y east and z down: there, x and y are
exchanged at the input and at the output.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray, changed
from tsepm_ros.tracker.tracks import TrackArrays

MIN_QUATERNION_NORM = 1e-6
"""Smallest norm of a quaternion; below, its direction is noise."""
MIN_PITCH_COSINE = 1e-6
"""Smallest cosine of the pitch; below, yaw and roll are the same rotation."""
MAX_SLANT_RATIO = 1.1
"""Largest ratio of slant to horizontal range at which range rates are used: 24.6 degrees."""

AXES: dict[str, FloatArray] = {
    "body": np.eye(3),
    "down": np.diag([1.0, -1.0, -1.0]),
    "sonar": np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]]),
    "optical": np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]),
}
"""Ahead, port and up, as columns, in a frame's axes: `body` x ahead, y to port, z up; `down`
x ahead, y to starboard, z down; `sonar` z ahead, x up, y to starboard (marine_acoustic_msgs);
`optical` z ahead, x to starboard, y down."""


def rotation_of(quaternion: Sequence[float]) -> FloatArray:
    """Rotation matrix (3, 3) from the child frame to the parent frame.

    Parameters
    ----------
    quaternion : sequence of 4 float
        x, y, z, w, of any length above `MIN_QUATERNION_NORM`.

    Raises
    ------
    ValueError
        If it is zero or not finite.
    """
    norm = math.hypot(*quaternion)
    if not MIN_QUATERNION_NORM < norm < math.inf:
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
    if level < MIN_PITCH_COSINE:
        raise ValueError("points straight up or down and has no heading")
    roll = math.atan2(rotation[2, 1], rotation[2, 2])
    return math.atan2(ahead_y, ahead_x), math.atan2(-ahead_z, level), roll


def ahead_and_port(
    x: FloatArray, y: FloatArray, z: FloatArray, roll: FloatArray, pitch: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Horizontal components of vectors in a tilted vessel's axes.

    The first two of ``Ry(pitch) Rx(roll) (x, y, z)``, in level axes with the vessel's heading::

        ahead = x cos(pitch) + (y sin(roll) + z cos(roll)) sin(pitch)
        port  = y cos(roll) - z sin(roll)

    Parameters
    ----------
    x, y, z : (...) ndarray
        Any unit.
    roll, pitch : (...) ndarray
        rad.

    Returns
    -------
    ahead, port : (...) ndarray
    """
    unrolled_z = y * np.sin(roll) + z * np.cos(roll)
    return x * np.cos(pitch) + unrolled_z * np.sin(pitch), y * np.cos(roll) - z * np.sin(roll)


def levelled(
    range: FloatArray,
    azimuth: FloatArray,
    height: FloatArray | None,
    roll: FloatArray,
    pitch: FloatArray,
    mounting_yaw: float = 0.0,
    mounting_roll: float = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """Range and azimuth in the horizontal plane of a tilted sensor's detections.

    A detection at slant range s, azimuth a and elevation e is at ``s d``, with the direction
    ``d = (cos e cos a, cos e sin a, sin e)`` in the sensor's axes. It is given by the range
    ``r = s cos e`` in the sensor's x-y plane and the height ``h = s sin e`` above it, which are
    exact for a level sensor. With the mounting yaw m and roll q of the sensor on the vessel::

        w = Ry(pitch) Rx(roll) Rz(m) Rx(q) (r cos a, r sin a, h)
        range = hypot(w_x, w_y),  azimuth = atan2(w_y, w_x) - m

    The standard deviations of range and azimuth stay the same: a tilt of 10 degrees changes them
    by 1.5 %, less than their own uncertainty.

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
    mounting_roll : float, optional
        q, rad, about the sensor's x axis.

    Returns
    -------
    range : (n,) ndarray
        m; may be 0, or not finite for an excessive height.
    azimuth : (n,) ndarray
        From the sensor's heading, yaw + m, counter-clockwise about the vertical, rad. Where roll
        and pitch are 0, and q too, range and azimuth stay the same to the bit.
    """
    tilted = (roll != 0.0) | (pitch != 0.0) | (mounting_roll != 0.0)
    if not tilted.any():
        return range, azimuth
    z = np.zeros_like(range) if height is None else height
    with np.errstate(over="ignore", invalid="ignore"):  # results in a range that is not finite
        if mounting_roll:
            x, y = range * np.cos(azimuth), range * np.sin(azimuth)
            sine, cosine = math.sin(mounting_roll), math.cos(mounting_roll)
            y, z = cosine * y - sine * z, sine * y + cosine * z
            range, azimuth = np.hypot(x, y), np.arctan2(y, x)
        angle = azimuth + mounting_yaw
        ahead, port = ahead_and_port(range * np.cos(angle), range * np.sin(angle), z, roll, pitch)
        horizontal = np.hypot(ahead, port)
    level_azimuth = np.arctan2(port, ahead) - mounting_yaw
    return np.where(tilted, horizontal, range), np.where(tilted, level_azimuth, azimuth)


def horizontal_range_rate(
    range_rate: FloatArray, slant_range: FloatArray, range: FloatArray
) -> FloatArray:
    """Rate of the horizontal range, from the rate along a slant line of sight.

    Slant range s, horizontal range r and height h satisfy ``s^2 = r^2 + h^2``. Target and sensor
    move horizontally, so h is constant and ``s ds/dt = r dr/dt``::

        dr/dt = s / r ds/dt

    A relative vertical velocity w, for example the sensor's heave, adds ``w h / r``, which is not
    corrected. The rate's standard deviation also grows by s / r; it is not scaled, since s / r is
    at most `MAX_SLANT_RATIO`.

    Parameters
    ----------
    range_rate : (n,) ndarray
        ds/dt, m/s.
    slant_range, range : (n,) ndarray
        s and r, m; r may be 0.

    Returns
    -------
    (n,) ndarray
        dr/dt, m/s; nan where s / r exceeds `MAX_SLANT_RATIO`. Where s equals r, the rates stay the
        same to the bit.
    """
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):  # results in nan
        ratio = slant_range / range
        return np.where(ratio <= MAX_SLANT_RATIO, ratio * range_rate, np.nan)


_SUFFIX = re.compile(r"(?:^|(?<=/)|_)(ned|frd|optical)(?=(?:_frame)?$)", re.IGNORECASE)
_AXES = {"ned": "down", "frd": "down", "optical": "optical"}
_EAST_NORTH_UP = {
    "body": np.eye(3),
    "down": np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]),
}
_EXCHANGED = [2, 3, 0, 1]


def stated_axes(frame_id: str) -> str:
    """Axes that a frame's name states, a key of `attitude.AXES`; `body` without a suffix."""
    suffix = _SUFFIX.search(frame_id)
    return _AXES[suffix[1].lower()] if suffix else "body"


def without_suffix(frame_id: str) -> str:
    """The frame to which a frame of other axes belongs, with x ahead or east, and z up."""
    return _SUFFIX.sub("", frame_id).rstrip("/") or "level"


def east_north_up(frame_id: str) -> FloatArray:
    """Rotation (3, 3) from a fixed frame's axes, as its name states them, to east, north and up.

    Raises
    ------
    ValueError
        If x and y are not horizontal.
    """
    axes = stated_axes(frame_id)
    if axes not in _EAST_NORTH_UP:
        raise ValueError(
            f"fixed_frame {frame_id!r} has z ahead and y down by its name, but x and y of tracks "
            f"are horizontal (REP-103): use a frame such as {without_suffix(frame_id)!r}"
        )
    return _EAST_NORTH_UP[axes]


def exchanged(tracks: TrackArrays, frame_id: str) -> TrackArrays:
    """Tracks of a fixed frame in east and north, or back: x and y are exchanged if x is north."""
    if stated_axes(frame_id) != "down":
        return tracks
    covariance = tracks.covariance[:, _EXCHANGED][:, :, _EXCHANGED]
    return changed(tracks, state=tracks.state[:, _EXCHANGED], covariance=covariance)
