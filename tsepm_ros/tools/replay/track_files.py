"""Tracks as CSV, as a bag of the messages that the node publishes, and as a terminal's table."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, Protocol, TextIO

import numpy as np

from msg_adapters.point_cloud import point_fields
from msg_adapters.stamps import NANOSECONDS_PER_SECOND, check_seconds
from msg_adapters.track_messages import COVARIANCE_FIELDS, STATE_FIELDS, track_points
from tsepm_ros.own_ship.registration import east_north_up
from tsepm_ros.session.session import ScanResult
from tsepm_ros.tools.replay.bag import POINTS, mcap_writer
from tsepm_ros.tools.terminal import write_line
from tsepm_ros.tracker.tracks import ConfirmedTrack, TrackArrays
from tsepm_ros.whole_files import move_whole, naming, remove, temporary_beside

COLUMNS = (
    *("stamp", "track_id"),
    *STATE_FIELDS,
    *COVARIANCE_FIELDS,
    *("evaluation", "score", "hit_count", "scan_count", "age"),
    *("stationary_probability", "signal_to_clutter_db", "revision"),
)


class TrackWriter(Protocol):
    """Writes the tracks of a run, scan by scan."""

    def write(self, result: ScanResult) -> None:
        """Write the tracks of one scan."""


class TrackTable:
    """Writes tracks as CSV: a row per confirmed track with its reason, or the held tracks.

    A correction is a row of its own, with the same id and the next revision.

    Parameters
    ----------
    file : text file
    reason : callable, optional
        Returns the reason of a track's confirmation. Without it the tracks that are held at each
        scan are written, a row per scan and track.
    """

    def __init__(self, file: TextIO, reason: Callable[[ConfirmedTrack], str] | None = None) -> None:
        self._writer = csv.writer(file, lineterminator="\n")
        self._reason = reason
        self._writer.writerow([*COLUMNS, *(["reason"] if reason else [])])

    def write(self, result: ScanResult) -> None:
        """Write the tracks that one scan confirmed or corrected, or those held after it."""
        if self._reason is None:
            self._writer.writerows(map(_row, result.current))
            return
        for track in result.starts:
            corrected = "corrected: " if track.revision else ""
            self._writer.writerow([*_row(track), corrected + self._reason(track)])


def _row(track: ConfirmedTrack) -> list[object]:
    """The values of COLUMNS."""
    return [
        repr(track.stamp),
        track.track_id,
        *track.state.tolist(),
        *track.covariance.ravel().tolist(),
        track.evaluation,
        track.score,
        len(track.hits),
        track.scan_count,
        track.age,
        track.stationary_probability,
        track.signal_to_clutter_db,
        track.revision,
    ]


class TrackBag:
    """Writes the messages of `tracks`, `tracks/current` and `fixed_echoes` as an MCAP file.

    The log time of a message is its scan's stamp. The file appears at the end of the `with` block,
    if the block ends without an error.

    Parameters
    ----------
    path : path
        Path of the file; an existing file is replaced.

    Raises
    ------
    ImportError
        If the library rosbags is not installed.
    """

    def __init__(self, path: Path) -> None:
        from rosbags.typesys import Stores, get_typestore

        self._path = path
        self._store = get_typestore(Stores.ROS2_JAZZY)
        self._temporary = temporary_beside(path)
        self._bag = self._temporary / path.stem  # the file names itself in its metadata
        self._writer = mcap_writer(self._bag)
        try:
            self._temporary.mkdir()
            self._writer.open()
            self._new, self._current, self._fixed = (
                self._writer.add_connection(topic, POINTS, typestore=self._store)
                for topic in ("/tracks", "/tracks/current", "/fixed_echoes")
            )
        except BaseException:
            self._abort()
            raise

    def __enter__(self) -> TrackBag:
        """Return the bag itself."""
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        """Close the file and move it to its path."""
        try:
            if kind is None:
                with naming(self._path):
                    self._writer.close()
                move_whole(self._bag / f"{self._path.stem}.mcap", self._path)
        finally:
            self._abort()

    def _abort(self) -> None:
        """Close the bag, if it is open, and remove the temporary folder."""
        with suppress(Exception):  # whatever the failed writer raises
            self._writer.abort()
        remove(self._temporary)

    def write(self, result: ScanResult) -> None:
        """Write the messages of one scan.

        Raises
        ------
        ValueError
            If the stamp does not fit a ROS message.
        """
        log_ns = max(result.stamp_ns, 0)
        for topic, tracks in (
            (self._new, result.starts),
            (self._current, result.current),
            (self._fixed, result.fixed_echoes),
        ):
            message = self._cloud(result.stamp_ns, result.frame_id, tracks)  # checks the stamp
            self._writer.write(topic, log_ns, self._store.serialize_cdr(message, POINTS))

    def _cloud(self, stamp_ns: int, frame_id: str, tracks: TrackArrays) -> Any:
        types = self._store.types
        seconds, nanoseconds = divmod(stamp_ns, NANOSECONDS_PER_SECOND)
        check_seconds(seconds)
        stamp = types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=nanoseconds)
        points, is_dense = track_points(tracks)
        point_field = types["sensor_msgs/msg/PointField"]
        return types[POINTS](
            header=types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame_id),
            height=1,
            width=len(points),
            fields=[point_field(**values) for values in point_fields(points.dtype)],
            is_bigendian=False,
            point_step=points.dtype.itemsize,
            row_step=points.nbytes,
            data=points.view(np.uint8),
            is_dense=is_dense,
        )


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
