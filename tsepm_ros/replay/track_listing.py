"""Confirmed tracks as a table for a terminal."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TextIO

from tsepm_ros.kinematics.track import ConfirmedTrack
from tsepm_ros.progress import write_line
from tsepm_ros.session.result import ScanResult

_WIDTHS = {"time [s]": 14, "id": 6, "x [m]": 11, "y [m]": 11, "speed [m/s]": 11, "course [deg]": 12}
"""Columns and their widths; the reason follows."""


class TrackListing:
    """Writes confirmed tracks as aligned lines, at once.

    The course is counter-clockwise from the x axis of the fixed frame.

    Parameters
    ----------
    file : text file
    reason : callable
        Returns the reason of a track's confirmation.
    """

    def __init__(self, file: TextIO, reason: Callable[[ConfirmedTrack], str]) -> None:
        self._file = file
        self._reason = reason
        heading = "  ".join(name.rjust(width) for name, width in _WIDTHS.items())
        write_line(f"{heading}  reason", file)

    def write(self, result: ScanResult) -> None:
        """Write a line for each track that was confirmed by one scan."""
        for track in result.new:
            x, vx, y, vy = track.state.tolist()
            course = math.degrees(math.atan2(vy, vx)) % 360.0
            values = (
                f"{track.stamp:.3f}",
                str(track.track_id),
                f"{x:.1f}",
                f"{y:.1f}",
                f"{math.hypot(vx, vy):.2f}",
                f"{course:.0f}",
            )
            cells = (v.rjust(width) for v, width in zip(values, _WIDTHS.values(), strict=True))
            write_line(f"{'  '.join(cells)}  {self._reason(track)}", self._file)
