"""Tracks as sentences of NMEA 0183: TTM, relative to own ship, and TLL, on the earth.

``$--TTM,number,distance,bearing,T,speed,course,T,CPA,time,N,name,status,,hhmmss.s,A*sum`` in
nautical miles, degrees, knots and minutes, and
``$--TLL,number,ddmm.mmmm,N,dddmm.mmmm,E,name,hhmmss.s,status,*sum``. A receiver knows 100 numbers
of targets.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime
from functools import reduce
from operator import xor
from typing import TextIO

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.session.session import ScanResult
from tsepm_ros.tools.bridge.geographic import GeographicReference
from tsepm_ros.tracker import motion
from tsepm_ros.tracker.tracks import TrackArrays

NUMBERS = 100
"""Numbers of targets: 00 to 99."""
NAUTICAL_MILE = 1852.0
"""m."""
KNOT = NAUTICAL_MILE / 3600.0
"""m/s."""
MAX_MINUTES = 999.9
"""Largest time of an approach that is written, min."""
TRACKED, LOST = "T", "L"
LEAST_SPEED = 1e-3
"""Relative speed, m/s, below which nothing approaches: rounding of equal velocities."""
MINUTE_PARTS = 10_000
"""Parts of a minute of arc that are written: 0.2 m."""


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
    return motion.closest_approach(state)


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

    def update(self, ids: Sequence[int]) -> tuple[dict[int, int], int]:
        """Take the ids of the present tracks.

        Returns
        -------
        ended : dict of int to int
            Numbers of the tracks that are no longer there, by id.
        without : int
            Tracks that are left without a number, the last ones.
        """
        present = set(ids)
        ended = {track: number for track, number in self.of.items() if track not in present}
        for track, number in ended.items():
            del self.of[track]
            self._free.append(number)
        for track in ids:
            if track not in self.of and self._free:
                before = (one for one in self._free if self._last.get(one) == track)
                number = next(before, self._free[0])
                self._free.remove(number)
                self.of[track] = number
                self._last[number] = track
        return ended, len(present) - len(self.of)


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
) -> Iterator[str]:
    """Tracks relative to own ship.

    Parameters
    ----------
    talker : str
        Two letters.
    tracks : TrackArrays
        In east and north, or ahead and to port of a sensor that stands still.
    numbers : dict of int to int
        Number of each track that is written, by id.
    own_ship : tuple of (2,) ndarray
        Position and velocity at the stamp of the tracks, m and m/s.
    from_north : bool
        Whether the axes are east and north: bearings are true, else from the x axis.
    """
    position, velocity = tracks.state[:, 0::2] - own_ship[0], tracks.state[:, 1::2]
    times, distances = closest_approach(position, velocity - own_ship[1])
    figures = [
        np.hypot(*position.T) / NAUTICAL_MILE,
        _direction(position, from_north),
        np.hypot(*velocity.T) / KNOT,
        _direction(velocity, from_north),
        distances / NAUTICAL_MILE,
        np.round(np.clip(times / 60.0, -MAX_MINUTES, MAX_MINUTES), 1) + 0.0,  # 0.0, not -0.0
    ]
    axis, time = "T" if from_north else "R", _time(tracks.stamp.max(initial=0.0))
    rows = zip(tracks.track_id.tolist(), *map(np.ndarray.tolist, figures), strict=True)
    for track, away, bearing, speed, course, closest, minutes in rows:
        if track in numbers:
            yield sentence(
                f"{talker}TTM,{numbers[track]:02d},{away:.3f},{bearing:.1f},{axis},{speed:.1f}",
                f"{course:.1f},{axis},{closest:.3f},{minutes:.1f},N",
                _name(track),
                TRACKED,
                "",
                time,
                "A",
            )


def tll(
    talker: str, tracks: TrackArrays, numbers: dict[int, int], geographic: FloatArray
) -> Iterator[str]:
    """Tracks on the earth.

    Parameters
    ----------
    talker, tracks, numbers
        See `ttm`.
    geographic : (n, 2) ndarray
        Latitude and longitude of the tracks, degrees.
    """
    for row, track in enumerate(tracks.track_id.tolist()):
        if track in numbers:
            place = (*_angle(geographic[row, 0], 2, "NS"), *_angle(geographic[row, 1], 3, "EW"))
            time = _time(float(tracks.stamp[row]))
            number = f"{numbers[track]:02d}"
            yield sentence(f"{talker}TLL", number, *place, _name(track), time, TRACKED, "")


def lost(talker: str, ended: dict[int, int], stamp: float, kind: str) -> Iterator[str]:
    """The end of tracks: sentences of a kind, TTM or TLL, with the status lost.

    Parameters
    ----------
    talker : str
    ended : dict of int to int
        Number of each track by its id.
    stamp : float
        s.
    kind : str
    """
    for track, number in ended.items():
        name, time = _name(track), _time(stamp)
        if kind == "TLL":
            yield sentence(f"{talker}TLL", f"{number:02d}", *[""] * 4, name, time, LOST, "")
        else:
            fields = (*[""] * 9, name, LOST, "", time, "A")
            yield sentence(f"{talker}TTM", f"{number:02d}", *fields)


def _direction(vectors: FloatArray, from_north: bool) -> FloatArray:
    """Directions, degrees clockwise from north or ahead, below 360 when rounded; (n,) of (n, 2)."""
    x, y = vectors.T
    angles = np.arctan2(x, y) if from_north else np.arctan2(-y, x)
    return np.round(np.degrees(angles) % 360.0, 1) % 360.0


def _name(track: int) -> str:
    """The track's id; of a long one the last digits, since a sentence has 82 characters."""
    return str(track % 10_000_000)


def _time(stamp: float) -> str:
    """Time of day in UTC, hhmmss.s."""
    return datetime.fromtimestamp(round(stamp, 1), UTC).strftime("%H%M%S.%f")[:8]


def _angle(degrees: float, digits: int, signs: str) -> tuple[str, str]:
    """Degrees and minutes of an angle, and its direction."""
    parts = round(abs(degrees) * 60 * MINUTE_PARTS)
    whole, parts = divmod(parts, 60 * MINUTE_PARTS)
    minutes = f"{parts / MINUTE_PARTS:07.4f}"
    return f"{whole:0{digits}d}{minutes}", signs[0] if degrees >= 0.0 else signs[1]


def tll_writer(
    file: TextIO, reference: GeographicReference, notes: dict[str, str]
) -> Callable[[ScanResult], None]:
    """A writer of the held tracks of a run as TLL, scan by scan.

    Parameters
    ----------
    file : text file
    reference : GeographicReference
        In east and north, as the results are.
    notes : dict of str to str
        Sentences by reason: that of `numbers` says how much was not written.
    """
    numbers, not_written = TargetNumbers(), 0

    def write(result: ScanResult) -> None:
        nonlocal not_written
        tracks = result.current
        ended, without = numbers.update(tracks.track_id.tolist())
        if without:
            not_written += without
            notes["numbers"] = (
                f"{not_written} positions of tracks beyond {NUMBERS} at a time are not written: "
                "NMEA 0183 has no more numbers"
            )
        places = reference.geographic(tracks.state[:, 0::2])
        file.writelines(lost("RA", ended, 1e-9 * result.stamp_ns, "TLL"))
        file.writelines(tll("RA", tracks, numbers.of, places))

    return write
