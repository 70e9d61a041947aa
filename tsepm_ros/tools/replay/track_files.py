# Copyright 2026 tsepm_ros developers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""Tracks as CSV, GeoJSON, a bag of the messages that the node publishes, or a terminal's table."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from msg_adapters.point_cloud import point_fields
from msg_adapters.stamps import NANOSECONDS_PER_SECOND, check_seconds
from msg_adapters.track_messages import COVARIANCE_FIELDS, STATE_FIELDS, track_points
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.own_ship.registration import registration_axes, registration_east_north_up
from tsepm_ros.session.session import ScanResult
from tsepm_ros.tools.bridge.geographic import GeographicReference
from tsepm_ros.tools.replay.bag import POINTS, mcap_bag_writer, message_types
from tsepm_ros.tools.terminal import write_terminal_line
from tsepm_ros.tracker.tracks import ConfirmedTrack, TrackArrays, TrackStatus
from tsepm_ros.whole_files import (
    CREATOR,
    move_whole,
    naming_file,
    remove_whole_file,
    temporary_beside_file,
)

COLUMNS = (
    *("stamp", "track_id"),
    *STATE_FIELDS,
    *COVARIANCE_FIELDS,
    *("evaluation", "score", "hit_count", "scan_count", "age"),
    *("stationary_probability", "signal_to_clutter_db", "revision"),
    *("existence_probability", "time_since_hit", "status"),
)


TrackWriter = Callable[[ScanResult], None]
"""Writes the tracks of a run, scan by scan."""
_LINE = "{:>14}  {:>6}  {:>11}  {:>11}  {:>11}  {:>15}  {}"
"""Time, id, position, speed, direction and reason of a track."""
DIGITS = 7
"""Decimals of a degree: 1 cm."""


def track_table_file(
    file: TextIO,
    reason: Callable[[ConfirmedTrack], str] | None = None,
    *,
    several_sensors: bool = False,
) -> TrackWriter:
    """A writer of CSV: a row per confirmed track with its reason, or the confirmed tracks.

    A track that a start continued has another row, with the next revision.

    Parameters
    ----------
    file : text file
    reason : callable, optional
        Returns the reason of a track's confirmation. Without it the confirmed tracks at each
        scan are written, a row per scan and track.
    several_sensors : bool, optional
        Whether rows have the name of their scan's sensor.
    """
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow([*COLUMNS, *["sensor"] * several_sensors, *["reason"] * bool(reason)])

    def write(result: ScanResult) -> None:
        sensor = [result.scan.sensor] * several_sensors
        if reason is None:
            writer.writerows([*_row(track), *sensor] for track in result.current)
            return
        for track in result.starts:
            again = "continued: " if track.revision else ""
            writer.writerow([*_row(track), *sensor, again + reason(track)])

    return write


def write_truth_table(
    file: TextIO, truth: Sequence[FloatArray], span: tuple[float, float], frame_id: str
) -> None:
    """Write the truth as CSV, a row per time and target, in the axes of the tracks' frame.

    Parameters
    ----------
    file : text file
    truth : sequence of (m, 3) ndarray
        Time (s), and x and y (m), east and north, of each target.
    span : (float, float)
        First and last time, s: rows before and after are left out.
    frame_id : str
        Fixed frame of the tracks.
    """
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(["stamp", "target_id", "state_x", "state_y"])
    axes = [0, 2, 1] if registration_axes(frame_id) == "down" else [0, 1, 2]
    rows = [
        (time, target, x, y)
        for target, path in enumerate(truth)
        for time, x, y in path[np.isfinite(path).all(axis=1)][:, axes].tolist()
        if span[0] <= time <= span[1]
    ]
    writer.writerows(sorted(rows))


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
        track.existence_probability,
        track.time_since_hit,
        TrackStatus(track.status).name.lower(),
    ]


@contextmanager
def track_bag_file(path: Path) -> Iterator[TrackWriter]:
    """A writer of the messages of `tracks`, `tracks/current` and `fixed_echoes` as an MCAP file.

    The log time of a message is its scan's stamp, which must fit a ROS message, else it is a
    ValueError. The file appears at the end of the `with` block, if that ends without an error.

    Parameters
    ----------
    path : path
        Path of the file; an existing file is replaced.

    Raises
    ------
    ImportError
        If the library rosbags is not installed.
    """
    temporary = temporary_beside_file(path)
    bag = temporary / path.stem  # the file names itself in its metadata
    store, _ = message_types()
    try:
        with naming_file(path), mcap_bag_writer(bag) as writer:
            topics = [
                writer.add_connection(topic, POINTS, typestore=store)
                for topic in ("/tracks", "/tracks/current", "/fixed_echoes")
            ]

            def write(result: ScanResult) -> None:
                contents = (result.starts, result.current, result.fixed_echoes)
                for topic, tracks in zip(topics, contents, strict=True):
                    message = _cloud(store.types, result.stamp_ns, result.frame_id, tracks)
                    data = store.serialize_cdr(message, POINTS)
                    writer.write(topic, max(result.stamp_ns, 0), data)

            yield write
        move_whole(bag / f"{path.stem}.mcap", path)
    finally:
        remove_whole_file(temporary)


def _cloud(types: Any, stamp_ns: int, frame_id: str, tracks: TrackArrays) -> Any:
    """The message of tracks, of the classes of rosbags."""
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


def track_listing_file(
    file: TextIO, reason: Callable[[ConfirmedTrack], str], *, north: bool
) -> TrackWriter:
    """A writer of confirmed tracks as aligned lines, at once.

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
    direction = "course [deg]" if north else "direction [deg]"
    names = ("time [s]", "id", "x [m]", "y [m]", "speed [m/s]", direction, "reason")
    write_terminal_line(_LINE.format(*names), file)

    def write(result: ScanResult) -> None:
        for track in result.new:
            x, vx, y, vy = track.state.tolist()
            to_east, to_north = (
                registration_east_north_up(result.frame_id)[:2, :2] @ (vx, vy)
            ).tolist()
            angle = math.atan2(to_east, to_north) if north else math.atan2(vy, vx)
            values = (
                f"{track.stamp:.3f}",
                track.track_id,
                f"{x:.1f}",
                f"{y:.1f}",
                f"{math.hypot(vx, vy):.2f}",
                f"{math.degrees(angle) % 360.0:.0f}",
                reason(track),
            )
            write_terminal_line(_LINE.format(*values), file)

    return write


@contextmanager
def track_lines_file(file: TextIO, reference: GeographicReference) -> Iterator[TrackWriter]:
    """A writer of confirmed tracks as GeoJSON (RFC 7946), a line each, at the end of `with`.

    Parameters
    ----------
    file : text file
        Nothing is written if the block has failed.
    reference : GeographicReference
        In east and north, as the results are.
    """
    tracks: dict[int, tuple[list[list[float]], dict[str, Any]]] = {}  # places and properties

    def write(result: ScanResult) -> None:
        places = reference.geographic(result.current.state[:, 0::2])
        time = datetime.fromtimestamp(result.stamp_ns * 1e-9, UTC).isoformat()
        for track, (latitude, longitude) in zip(result.current, places.tolist(), strict=True):
            if math.isnan(latitude):  # on no place of the earth
                continue
            identity: dict[str, Any] = {"track_id": track.track_id, "times": [], "status": []}
            line, properties = tracks.setdefault(track.track_id, ([], identity))
            line.append([round(longitude, DIGITS), round(latitude, DIGITS)])
            properties["times"].append(time)
            properties["status"].append(TrackStatus(track.status).name.lower())
            vx, vy = track.velocity.tolist()
            existence = track.existence_probability
            properties |= {
                "speed": round(math.hypot(vx, vy), 3),
                "course": round(math.degrees(math.atan2(vx, vy)) % 360.0, 1),
                "existence_probability": None if math.isnan(existence) else round(existence, 4),
                "revision": track.revision,
            }
        for track_id in result.ended.keys() & tracks.keys():
            tracks[track_id][1]["ended"] = result.ended[track_id]

    yield write
    features = [
        {"type": "Feature", "geometry": _geometry(line), "properties": properties}
        for line, properties in tracks.values()
    ]
    content = {"type": "FeatureCollection", "generator": CREATOR, "features": features}
    json.dump(content, file)
    file.write("\n")


def _geometry(line: list[list[float]]) -> dict[str, Any]:
    """A point, a line, or lines that are cut at 180 degrees of longitude."""
    if len(line) == 1:
        return {"type": "Point", "coordinates": line[0]}
    parts = [[line[0]]]
    for before, after in pairwise(line):
        if abs(after[0] - before[0]) > 180.0:
            side = math.copysign(180.0, before[0])
            way = after[0] + 2.0 * side - before[0]
            share = (side - before[0]) / way if way else 0.0
            latitude = round(before[1] + share * (after[1] - before[1]), DIGITS)
            parts[-1].append([side, latitude])
            parts.append([[-side, latitude]])
        parts[-1].append(after)
    if len(parts) == 1:
        return {"type": "LineString", "coordinates": parts[0]}
    return {"type": "MultiLineString", "coordinates": parts}
