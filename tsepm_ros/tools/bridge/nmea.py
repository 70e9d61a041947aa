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
"""Tracks for plotters: sentences of NMEA 0183, relative to own ship or on the earth, and Signal K.

``$--TTM,number,distance,bearing,T,speed,course,T,CPA,time,N,name,status,,hhmmss.s,A*sum`` in
nautical miles, degrees, knots and minutes, and
``$--TLL,number,ddmm.mmmm,N,dddmm.mmmm,E,name,hhmmss.s,status,*sum``. A receiver knows 100 numbers
of targets. A sentence has at most 82 characters.

Signal K reads neither: a delta is a line of JSON in SI units and radians. Its context is the track,
a vessel with a UUID.

A report of a track is its sentence without status and time, or context and values of its delta. At
a track's end its last report is repeated with the status lost, in a delta with null: empty fields
would be read as a place.
"""

from __future__ import annotations

import json
import math
import uuid
from collections.abc import Callable, Collection, Mapping, Sequence
from datetime import UTC, datetime
from functools import reduce
from operator import xor
from typing import Any, TextIO

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.session.session import ScanResult
from tsepm_ros.tools.bridge.geographic import MAX_DISTANCE, GeographicReference
from tsepm_ros.tools.evaluation import measures
from tsepm_ros.tracker.tracks import TrackArrays

NUMBERS = 100
"""Numbers of targets: 00 to 99."""
NAUTICAL_MILE = 1852.0
"""m."""
KNOT = NAUTICAL_MILE / 3600.0
"""m/s."""
MAX_MINUTES = 999.9
"""Largest time of an approach that is written, min."""
MAX_SPEED = 999.9
"""Largest speed that is written, knots: a sentence has no room for more digits."""
MIN_MILES = 0.001
"""Smallest distance that is written, nautical miles: receivers take 0 for a lost target."""
TRACKED, LOST = "T", "L"
LEAST_SPEED = 1e-3
"""Relative speed, m/s, below which nothing approaches: rounding of equal velocities."""
MINUTE_PARTS = 10_000
"""Parts of a minute of arc that are written: 0.2 m."""
Report = str | tuple[str, dict[str, Any]]
OFFLINE = uuid.UUID(int=0)
"""Instance of offline runs: a recording gives the same deltas each time."""


def nmea_closest_approach(
    position: FloatArray, velocity: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Time until the closest approach, and the distance then.

    Parameters
    ----------
    position, velocity : (n, 2) ndarray
        Of the targets relative to own ship, m and m/s.

    Returns
    -------
    time : (n,) ndarray
        s; below 0 where it was in the past, 0 where they move together.
    distance : (n,) ndarray
        m.
    """
    moves = np.hypot(*velocity.T)[:, None] > LEAST_SPEED
    state = np.stack([position, np.where(moves, velocity, 0.0)], axis=2).reshape(-1, 4)
    return measures.measured_closest_approach(state)


def nmea_ids_again(
    newest: tuple[int, float], tracks: TrackArrays, stamp: float
) -> tuple[bool, tuple[int, float]]:
    """Whether a track initiator that was started again gives ids again, to other targets.

    Ids increase with the confirmations. Of one run no track has its first hit after one with a
    larger id, or the same, was there, and stamps ascend.

    Parameters
    ----------
    newest : tuple of int and float
        The largest id before, and the stamp at which it was there first, s.
    tracks : TrackArrays
        The tracks that are held.
    stamp : float
        Of them, s.

    Returns
    -------
    is_again : bool
    newest : tuple of int and float
        After these tracks.
    """
    again = (tracks.stamp - tracks.age > newest[1]) | (stamp < newest[1])
    is_again = bool(((tracks.track_id <= newest[0]) & again).any())
    largest = int(max(tracks.track_id, default=-1))
    return is_again, (largest, stamp) if is_again or largest > newest[0] else newest


class NmeaTargetNumbers:
    """Numbers 00 to 99 of the tracks: each is free again at its track's end.

    A track that comes back has its number again if no other took it; the number that is free for
    the longest time is taken first.
    """

    def __init__(self) -> None:
        self._free: dict[int, int | None] = dict.fromkeys(range(NUMBERS))  # its last id, by number
        self.of: dict[int, int] = {}
        """Number of each track, by its id."""

    def update(self, ids: Sequence[int]) -> int:
        """Take the ids of the present tracks.

        Returns
        -------
        int
            Tracks that are left without a number, the last ones.
        """
        present = set(ids)
        for track in [track for track in self.of if track not in present]:
            self._free[self.of.pop(track)] = track
        for track in ids:
            if track not in self.of and self._free:
                before = (number for number, last in self._free.items() if last == track)
                self.of[track] = next(before, next(iter(self._free)))
                del self._free[self.of[track]]
        return len(present) - len(self.of)


class NmeaReports(dict[int, Report]):
    """What a receiver was told of each track, by its id, so that it is told each end."""

    def texts(
        self, present: Collection[int], stamp: float, reports: Mapping[int, Report]
    ) -> list[str]:
        """Lines to send: the ends of tracks that are no longer there, and the new reports.

        Parameters
        ----------
        present : collection of int
            Ids of the confirmed tracks.
        stamp : float
            s.
        reports : mapping of int to report
            Of confirmed tracks, by id.
        """
        gone = [self.pop(track) for track in list(self) if track not in present]
        self.update(reports)
        ends = [_line(report, stamp, LOST) for report in gone]
        return ends + [_line(report, stamp, TRACKED) for report in reports.values()]


def _line(report: Report, stamp: float, status: str) -> str:
    """A sentence, or a delta, with its end of line."""
    date = datetime.fromtimestamp(round(stamp, 1 if isinstance(report, str) else 3), UTC)
    if isinstance(report, str):
        return nmea_sentence(report.format(status, date.strftime("%H%M%S.%f")[:8]))
    context, given = report
    values = [
        {"path": path, "value": None if status == LOST else value}
        for path, value in given.items()
        if path or status == TRACKED  # the name stays
    ]
    time = date.isoformat(timespec="milliseconds").replace("+00:00", "Z")
    update = {"$source": "tsepm_ros", "timestamp": time, "values": values}
    return json.dumps({"context": context, "updates": [update]}, allow_nan=False) + "\n"


def nmea_sentence(body: str) -> str:
    """A sentence of fields between commas, with its checksum and line end.

    Parameters
    ----------
    body : str
        Begins with talker and type, such as ``RATTM``.
    """
    return f"${body}*{reduce(xor, body.encode('ascii')):02X}\r\n"


def nmea_ttm(
    talker: str,
    tracks: TrackArrays,
    numbers: dict[int, int],
    own_ship: tuple[FloatArray, FloatArray],
    from_north: bool = True,
) -> dict[int, str]:
    """Reports of tracks relative to own ship, by id.

    Parameters
    ----------
    talker : str
        Two letters.
    tracks : TrackArrays
        In east and north, or ahead and to port of a sensor that stands still. Tracks farther than
        `MAX_DISTANCE` or faster than `MAX_SPEED` are left out.
    numbers : dict of int to int
        Number of each track that is written, by id.
    own_ship : tuple of (2,) ndarray
        Position and velocity at the stamp of the tracks, m and m/s.
    from_north : bool
        Whether the axes are east and north: bearings are true, else from the x axis.
    """
    position, velocity = tracks.state[:, 0::2] - own_ship[0], tracks.state[:, 1::2]
    away, speed = np.hypot(*position.T), np.round(np.hypot(*velocity.T) / KNOT, 1)
    times, distances = nmea_closest_approach(position, velocity - own_ship[1])
    figures = [
        (away <= MAX_DISTANCE) & (speed <= MAX_SPEED),
        np.maximum(away / NAUTICAL_MILE, MIN_MILES),
        _direction(position, from_north),
        speed,
        _direction(velocity, from_north),
        distances / NAUTICAL_MILE,
        np.round(np.clip(times / 60.0, -MAX_MINUTES, MAX_MINUTES), 1) + 0.0,  # 0.0, not -0.0
    ]
    axis = "T" if from_north else "R"
    rows = zip(tracks.track_id.tolist(), *map(np.ndarray.tolist, figures), strict=True)
    return {
        track: f"{talker}TTM,{numbers[track]:02d},{_miles(away)},{bearing:.1f},{axis},"
        f"{speed:.1f},{course:.1f},{axis},{_miles(closest)},{minutes:.1f},N,{_name(track)},{{0}},,{{1}},A"
        for track, is_written, away, bearing, speed, course, closest, minutes in rows
        if is_written and track in numbers
    }


def nmea_tll(
    talker: str, tracks: TrackArrays, numbers: dict[int, int], geographic: FloatArray
) -> dict[int, str]:
    """Reports of tracks on the earth, by id.

    Parameters
    ----------
    talker, tracks, numbers
        See `nmea_ttm`.
    geographic : (n, 2) ndarray
        Latitude and longitude of the tracks, degrees; tracks where it is nan are left out.
    """
    rows = zip(tracks.track_id.tolist(), geographic.tolist(), strict=True)
    return {
        track: f"{talker}TLL,{numbers[track]:02d},{_angle(latitude, 2, 'NS')},"
        f"{_angle(longitude, 3, 'EW')},{_name(track)},{{1}},{{0}},"
        for track, (latitude, longitude) in rows
        if track in numbers and math.isfinite(latitude)
    }


def nmea_deltas(
    tracks: TrackArrays, instance: uuid.UUID, geographic: FloatArray
) -> dict[int, tuple[str, dict[str, Any]]]:
    """Reports of tracks in east and north for Signal K, by id: context, and values by path.

    Parameters
    ----------
    tracks : TrackArrays
    instance : uuid.UUID
        Of the run: the tracks of another run are other vessels.
    geographic : (n, 2) ndarray
        See `nmea_tll`.
    """
    velocities = tracks.state[:, 1::2].tolist()
    rows = zip(tracks.track_id.tolist(), geographic.tolist(), velocities, strict=True)
    return {
        track: (
            # Signal K takes UUIDs of version 4 only.
            "vessels.urn:mrn:signalk:uuid:"
            f"{uuid.UUID(bytes=uuid.uuid5(instance, str(track)).bytes, version=4)}",
            {
                "navigation.position": {
                    "latitude": round(latitude, 7),
                    "longitude": round(longitude, 7),
                },
                "navigation.courseOverGroundTrue": round(math.atan2(vx, vy) % math.tau, 4),
                "navigation.speedOverGround": round(math.hypot(vx, vy), 3),
                "": {"name": f"Track {track}"},
            },
        )
        for track, (latitude, longitude), (vx, vy) in rows
        if math.isfinite(latitude)
    }


def _direction(vectors: FloatArray, from_north: bool) -> FloatArray:
    """Directions, degrees clockwise from north or ahead, below 360 when rounded; (n,) of (n, 2)."""
    x, y = vectors.T
    angles = np.arctan2(x, y) if from_north else np.arctan2(-y, x)
    return np.round(np.degrees(angles) % 360.0, 1) % 360.0


def _miles(distance: float) -> str:
    """Nautical miles, cut to seven characters: a sentence has 82."""
    return f"{distance:.3f}"[:7]


def _name(track: int) -> str:
    """The track's id; of a long one the last digits, since a sentence has 82 characters."""
    return str(track % 1_000_000)


def _angle(degrees: float, digits: int, signs: str) -> str:
    """Degrees and minutes of an angle, and its direction: two fields."""
    parts = round(abs(degrees) * 60 * MINUTE_PARTS)
    whole, parts = divmod(parts, 60 * MINUTE_PARTS)
    sign = signs[0] if degrees >= 0.0 else signs[1]
    return f"{whole:0{digits}d}{parts / MINUTE_PARTS:07.4f},{sign}"


def nmea_report_writer(
    file: TextIO, reference: GeographicReference, notes: dict[str, str], form: str = "nmea"
) -> Callable[[ScanResult], None]:
    """A writer of the confirmed tracks of a run as TLL, or as deltas of Signal K, scan by scan.

    Parameters
    ----------
    file : text file
    reference : GeographicReference
        In east and north, as the results are.
    notes : dict of str to str
        Sentences by reason: that of `numbers` says how much was not written.
    form : {"nmea", "signalk"}
    """
    numbers, told, not_written = NmeaTargetNumbers(), NmeaReports(), 0

    def write(result: ScanResult) -> None:
        nonlocal not_written
        tracks = result.current.sure
        present = tracks.track_id.tolist()
        places = reference.geographic(tracks.state[:, 0::2])
        if form == "signalk":
            reports: Mapping[int, Report] = nmea_deltas(tracks, OFFLINE, places)
        else:
            not_written += numbers.update(present)
            reports = nmea_tll("RA", tracks, numbers.of, places)
            if not_written:
                notes["numbers"] = (
                    f"{not_written} positions of tracks beyond {NUMBERS} at a time are not "
                    "written: NMEA 0183 has no more numbers"
                )
        file.writelines(told.texts(present, 1e-9 * result.stamp_ns, reports))

    return write
