"""Axes that the name of a frame states, by the suffixes of REP-103.

Inside, detections are ahead and to port of the sensor, and poses and tracks in east and north. A
fixed frame whose name ends in `_ned` or `_frd` has x north, y east and z down: there, x and y are
exchanged at the input and at the output.
"""

from __future__ import annotations

import re

import numpy as np

from tsepm_ros.kinematics.track import TrackArrays
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.numerics.rows import changed

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
