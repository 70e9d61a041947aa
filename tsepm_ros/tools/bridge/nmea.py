"""Tracks for plotters: sentences of NMEA 0183, relative to own ship or on the earth, and Signal K.

``$--TTM,number,distance,bearing,T,speed,course,T,CPA,time,N,name,status,,hhmmss.s,A*sum`` in
nautical miles, degrees, knots and minutes, and
``$--TLL,number,ddmm.mmmm,N,dddmm.mmmm,E,name,hhmmss.s,status,*sum``. A receiver knows 100 numbers
of targets. A sentence has at most 82 characters.

Signal K reads neither: a delta is a line of JSON in SI units and radians. Its context is the track,
a vessel with a UUID.

A report of a track is the fields of its sentence, or its delta. At a track's end its last report is
repeated with the status lost, in a delta with null: empty fields would be read as a place.
"""

from __future__ import annotations

import json
import math
import uuid
from collections import deque
from collections.abc import Callable, Collection, Sequence
from datetime import UTC, datetime
from functools import reduce
from operator import xor
from typing import Any, TextIO

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.session.session import ScanResult
from tsepm_ros.tools.bridge.geographic import MAX_DISTANCE, GeographicReference
from tsepm_ros.tracker.maintenance import features
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
STATUS_AND_TIME = {"TTM": (12, 14), "TLL": (8, 7)}
"""Places of these fields in a sentence."""
LEAST_SPEED = 1e-3
"""Relative speed, m/s, below which nothing approaches: rounding of equal velocities."""
MINUTE_PARTS = 10_000
"""Parts of a minute of arc that are written: 0.2 m."""
OFFLINE = uuid.UUID(int=0)
"""Instance of offline runs: a recording gives the same deltas each time."""


def closest_approach(position: FloatArray, velocity: FloatArray) -> tuple[FloatArray, FloatArray]:
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
    return features.closest_approach(np.zeros(4), state)


class TargetNumbers:
    """Numbers 00 to 99 of the tracks: each is free again at its track's end.

    A track that comes back has its number again if no other took it; the number that is free for
    the longest time is taken first.
    """

    def __init__(self) -> None:
        self._free = deque(range(NUMBERS))
        self._last: dict[int, int] = {}  # id by number
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
            self._free.append(self.of.pop(track))
        for track in ids:
            if track not in self.of and self._free:
                before = (one for one in self._free if self._last.get(one) == track)
                number = next(before, self._free[0])
                self._free.remove(number)
                self.of[track] = number
                self._last[number] = track
        return len(present) - len(self.of)


class Reports:
    """What a receiver was told of each track, so that it is told each end."""

    def __init__(self) -> None:
        self._last: dict[int, Any] = {}

    def texts(self, present: Collection[int], stamp: float, reports: dict[int, Any]) -> list[str]:
        """Lines to send: the ends of tracks that are no longer there, and the new reports.

        Parameters
        ----------
        present : collection of int
            Ids of the held tracks.
        stamp : float
            s.
        reports : dict of int to report
            Of held tracks, by id: fields of sentences, or deltas.
        """
        ended = [self._last.pop(track) for track in list(self._last) if track not in present]
        self._last |= reports
        return [_line(one) for one in (*(_end(one, stamp) for one in ended), *reports.values())]


def _line(report: Any) -> str:
    if isinstance(report, dict):
        return json.dumps(report, allow_nan=False, separators=(",", ":")) + "\n"
    return sentence(*report)


def _end(report: Any, stamp: float) -> Any:
    """The last report of a track as that of its end."""
    if isinstance(report, dict):
        (update,) = report["updates"]
        values = [one | {"value": None} for one in update["values"] if one["path"]]
        return report | {"updates": [update | {"timestamp": _date(stamp), "values": values}]}
    ended = list(report)
    status, time = STATUS_AND_TIME[report[0][2:]]
    ended[status], ended[time] = LOST, _time(stamp)
    return ended


def sentence(*fields: str) -> str:
    """A sentence of fields, with its checksum and line end.

    Parameters
    ----------
    *fields : str
        The first is talker and type, such as ``RATTM``.
    """
    body = ",".join(fields)
    return f"${body}*{reduce(xor, body.encode('ascii')):02X}\r\n"


def ttm(
    talker: str,
    tracks: TrackArrays,
    numbers: dict[int, int],
    own_ship: tuple[FloatArray, FloatArray],
    from_north: bool = True,
) -> dict[int, list[str]]:
    """Fields of tracks relative to own ship, by id.

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
    with np.errstate(over="ignore", invalid="ignore"):
        away = np.hypot(*(tracks.state[:, 0::2] - own_ship[0]).T)
        speed = np.hypot(*tracks.state[:, 1::2].T) / KNOT
    written = (away <= MAX_DISTANCE) & (np.round(speed, 1) <= MAX_SPEED)
    tracks = tracks.where(written)
    position, velocity = tracks.state[:, 0::2] - own_ship[0], tracks.state[:, 1::2]
    times, distances = closest_approach(position, velocity - own_ship[1])
    figures = [
        np.maximum(away[written] / NAUTICAL_MILE, MIN_MILES),
        _direction(position, from_north),
        speed[written],
        _direction(velocity, from_north),
        distances / NAUTICAL_MILE,
        np.round(np.clip(times / 60.0, -MAX_MINUTES, MAX_MINUTES), 1) + 0.0,  # 0.0, not -0.0
    ]
    axis, time = "T" if from_north else "R", _time(tracks.stamp.max(initial=0.0))
    rows = zip(tracks.track_id.tolist(), *map(np.ndarray.tolist, figures), strict=True)
    return {
        track: [
            *(f"{talker}TTM", f"{numbers[track]:02d}", _miles(away), f"{bearing:.1f}", axis),
            *(f"{speed:.1f}", f"{course:.1f}", axis, _miles(closest), f"{minutes:.1f}", "N"),
            *(_name(track), TRACKED, "", time, "A"),
        ]
        for track, away, bearing, speed, course, closest, minutes in rows
        if track in numbers
    }


def tll(
    talker: str, tracks: TrackArrays, numbers: dict[int, int], geographic: FloatArray
) -> dict[int, list[str]]:
    """Fields of tracks on the earth, by id.

    Parameters
    ----------
    talker, tracks, numbers
        See `ttm`.
    geographic : (n, 2) ndarray
        Latitude and longitude of the tracks, degrees; tracks where it is nan are left out.
    """
    rows = zip(tracks.track_id.tolist(), tracks.stamp.tolist(), geographic.tolist(), strict=True)
    return {
        track: [
            *(f"{talker}TLL", f"{numbers[track]:02d}"),
            *(*_angle(latitude, 2, "NS"), *_angle(longitude, 3, "EW")),
            *(_name(track), _time(stamp), TRACKED, ""),
        ]
        for track, stamp, (latitude, longitude) in rows
        if track in numbers and math.isfinite(latitude)
    }


def deltas(
    tracks: TrackArrays, instance: uuid.UUID, geographic: FloatArray
) -> dict[int, dict[str, Any]]:
    """Deltas of Signal K for tracks in east and north, by id.

    Parameters
    ----------
    tracks : TrackArrays
    instance : uuid.UUID
        Of the run: the tracks of another run are other vessels.
    geographic : (n, 2) ndarray
        See `tll`.
    """
    rows = zip(tracks.track_id.tolist(), tracks.stamp.tolist(), geographic.tolist(), strict=True)
    made: dict[int, dict[str, Any]] = {}
    for (track, stamp, (latitude, longitude)), (vx, vy) in zip(
        rows, tracks.state[:, 1::2].tolist(), strict=True
    ):
        if not math.isfinite(latitude):
            continue
        # Signal K takes UUIDs of version 4 only.
        vessel = uuid.UUID(bytes=uuid.uuid5(instance, str(track)).bytes, version=4)
        values = {
            "navigation.position": {
                "latitude": round(latitude, 7),
                "longitude": round(longitude, 7),
            },
            "navigation.courseOverGroundTrue": round(math.atan2(vx, vy) % math.tau, 4),
            "navigation.speedOverGround": round(math.hypot(vx, vy), 3),
            "": {"name": f"Track {track}"},
        }
        update = {
            "$source": "tsepm_ros",
            "timestamp": _date(stamp),
            "values": [{"path": path, "value": value} for path, value in values.items()],
        }
        made[track] = {"context": f"vessels.urn:mrn:signalk:uuid:{vessel}", "updates": [update]}
    return made


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


def _date(stamp: float) -> str:
    """Date and time in UTC as Signal K has it."""
    text = datetime.fromtimestamp(stamp, UTC).isoformat(timespec="milliseconds")
    return text.replace("+00:00", "Z")


def _time(stamp: float) -> str:
    """Time of day in UTC, hhmmss.s."""
    return datetime.fromtimestamp(round(stamp, 1), UTC).strftime("%H%M%S.%f")[:8]


def _angle(degrees: float, digits: int, signs: str) -> tuple[str, str]:
    """Degrees and minutes of an angle, and its direction."""
    parts = round(abs(degrees) * 60 * MINUTE_PARTS)
    whole, parts = divmod(parts, 60 * MINUTE_PARTS)
    minutes = f"{parts / MINUTE_PARTS:07.4f}"
    return f"{whole:0{digits}d}{minutes}", signs[0] if degrees >= 0.0 else signs[1]


def report_writer(
    file: TextIO, reference: GeographicReference, notes: dict[str, str], form: str = "nmea"
) -> Callable[[ScanResult], None]:
    """A writer of the held tracks of a run as TLL, or as deltas of Signal K, scan by scan.

    Parameters
    ----------
    file : text file
    reference : GeographicReference
        In east and north, as the results are.
    notes : dict of str to str
        Sentences by reason: that of `numbers` says how much was not written.
    form : {"nmea", "signalk"}
    """
    numbers, told, not_written = TargetNumbers(), Reports(), 0

    def write(result: ScanResult) -> None:
        nonlocal not_written
        tracks = result.current
        present = tracks.track_id.tolist()
        places = reference.geographic(tracks.state[:, 0::2])
        if form == "signalk":
            reports: dict[int, Any] = deltas(tracks, OFFLINE, places)
        else:
            without = numbers.update(present)
            reports = tll("RA", tracks, numbers.of, places)
            if without:
                not_written += without
                notes["numbers"] = (
                    f"{not_written} positions of tracks beyond {NUMBERS} at a time are not "
                    "written: NMEA 0183 has no more numbers"
                )
        file.writelines(told.texts(present, 1e-9 * result.stamp_ns, reports))

    return write
