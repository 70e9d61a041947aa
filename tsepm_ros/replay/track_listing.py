"""Confirmed tracks as a table for a terminal."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TextIO

from tsepm_ros.kinematics.track import ConfirmedTrack
from tsepm_ros.own_ship.frame_axes import east_north_up
from tsepm_ros.progress import write_line
from tsepm_ros.session.result import ScanResult

_WIDTHS = {"time [s]": 14, "id": 6, "x [m]": 11, "y [m]": 11, "speed [m/s]": 11}
"""Columns and their widths; the direction and the reason follow."""


class TrackListing:
    """Writes confirmed tracks as aligned lines, at once.

    The course is clockwise from north. Where north is not known, the direction is counter-clockwise
    from the x axis of the tracks' frame.

    Parameters
    ----------
    file : text file
    reason : callable
        Returns the reason of a track's confirmation.
    north : bool
        Whether the axes of the tracks are known from north.
    """

    def __init__(
        self, file: TextIO, reason: Callable[[ConfirmedTrack], str], *, north: bool
    ) -> None:
        self._file = file
        self._reason = reason
        self._north = north
        self._widths = {**_WIDTHS, "course [deg]" if north else "direction [deg]": 15}
        heading = "  ".join(name.rjust(width) for name, width in self._widths.items())
        write_line(f"{heading}  reason", file)

    def write(self, result: ScanResult) -> None:
        """Write a line for each track that was confirmed by one scan."""
        for track in result.new:
            x, vx, y, vy = track.state.tolist()
            east, north = (east_north_up(result.frame_id)[:2, :2] @ (vx, vy)).tolist()
            angle = math.atan2(east, north) if self._north else math.atan2(vy, vx)
            values = (
                f"{track.stamp:.3f}",
                str(track.track_id),
                f"{x:.1f}",
                f"{y:.1f}",
                f"{math.hypot(vx, vy):.2f}",
                f"{math.degrees(angle) % 360.0:.0f}",
            )
            cells = (v.rjust(width) for v, width in zip(values, self._widths.values(), strict=True))
            write_line(f"{'  '.join(cells)}  {self._reason(track)}", self._file)
