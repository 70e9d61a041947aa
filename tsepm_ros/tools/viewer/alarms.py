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
"""The alarms of the boat: a state machine for each condition, without ROS and without a page.

An alarm begins with its cause and stays until its cause is over and somebody has acknowledged it:

================  =======  ===============
state             cause    acknowledged
================  =======  ===============
inactive          over     yes: it is gone
unacknowledged    present  no
silenced          present  no, without sound for `SILENCE_TIME`
acknowledged      present  yes
rectified         over     no
================  =======  ===============

A cause is over once it has been absent for the `AlarmSupervisor.patience`; a cause that comes back
before the acknowledgement is counted in its alarm. All times are in seconds of a monotonic clock,
but those of onsets, which outlive a restart.
"""

from __future__ import annotations

import math
import statistics
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np

from msg_adapters.track_messages import track_ellipses
from tsepm_ros.numerics.arrays import BoolArray, FloatArray
from tsepm_ros.settings.node_options import AlarmOptions
from tsepm_ros.tools.bridge.nmea import nmea_closest_approach, nmea_ids_again
from tsepm_ros.tracker.tracks import ConfirmedTrack, TrackArrays, TrackStatus

MIN_PATIENCE, PATIENCE_INTERVALS, FIRST_PATIENCE = 5.0, 3.0, 60.0
"""Time after which data is missing or a cause is over: at least so many seconds and intervals; and
the time, s, while the interval between scans is not known."""
SILENCE_TIME = 30.0
"""Time for which a silenced alarm makes no sound, s."""
MAX_AGE = 3600.0
"""Difference between stamps and clock, s, above which the stamps are of another time: a replay."""
APPROACH_MARGIN = 2.0
"""Standard deviations by which a closest approach exceeds the limit once its alarm is over, and
factor of the limit of its time."""
LAST_INTERVALS, ROUND = 9, 2 * math.pi - 1e-6
"""Intervals of which the median is taken; and width of a sector that is all round, rad."""
MAX_ALARMS = 500
"""Alarms at once; beyond, only those of lost tracks give way to new ones."""
KINDS = {
    "data": "No data",
    "limits": "Limits lost",
    "watch": "Cannot alarm",
    "age": "Old data",
    "detections": "No detections",
    "cpa": "Closest approach",
    "zone": "Guard zone",
    "lost": "Lost",
}
"""Titles of the conditions by the first word of their keys, the most urgent first."""


AlarmState = StrEnum(
    "AlarmState", ["INACTIVE", "UNACKNOWLEDGED", "SILENCED", "ACKNOWLEDGED", "RECTIFIED"]
)
"""States of an alarm, see the module's table."""


@dataclass
class Alarm:
    """The alarm of one condition.

    Attributes
    ----------
    key : str
        The condition, such as ``cpa 7``.
    sentence, onset : str
        What was seen last, and at the alarm.
    time : float
        Of the onset, s since 1970.
    present : float
        When the cause was present last, s.
    places : dict of str to (x, y)
        Of lost tracks by their ids, m.
    count : int
        How often its cause has begun.
    is_active, is_acknowledged : bool
    silent_until : float
        s.
    due : float
        When the closest approach is, s; 0 of others.
    """

    key: str
    sentence: str
    onset: str
    time: float
    present: float
    places: dict[str, Sequence[float]] = field(default_factory=dict)
    count: int = 1
    is_active: bool = True
    is_acknowledged: bool = False
    silent_until: float = -math.inf
    due: float = 0.0

    @property
    def kind(self) -> str:
        """The first word of its key."""
        return self.key.partition(" ")[0]

    def state(self, now: float) -> AlarmState:
        """The state at a time."""
        if self.is_acknowledged:
            return AlarmState.ACKNOWLEDGED if self.is_active else AlarmState.INACTIVE
        if not self.is_active:
            return AlarmState.RECTIFIED
        return AlarmState.SILENCED if now < self.silent_until else AlarmState.UNACKNOWLEDGED


class ObservedScan(NamedTuple):
    """What a scan says to the alarms.

    Attributes
    ----------
    stamp : float
        s.
    tracks : TrackArrays
        The tracks that are held, with finite states.
    fixed : frozenset of int
        Ids of fixed echoes.
    own_ship : sequence of float or None
        x, y (m), heading (rad from x), vx and vy (m/s); nan: unknown.
    north : bool
        Whether y is north.
    """

    stamp: float
    tracks: TrackArrays
    fixed: frozenset[int] = frozenset()
    own_ship: Sequence[float] | None = None
    north: bool = True

    def away(self, x: float, y: float) -> str:
        """Range and bearing of a place from own ship in words: T true, R from the bow."""
        if self.own_ship is None:
            return ""
        dx, dy = x - self.own_ship[0], y - self.own_ship[1]
        up = math.pi / 2 if self.north else self.own_ship[2]
        angle = (round(math.degrees(up - math.atan2(dy, dx))) % 360) if up == up else None
        bearing = "" if angle is None else f", {angle:03d}°{'T' if self.north else 'R'}"
        return f", {meters(math.hypot(dx, dy))}{bearing}"


class HeldTrack(NamedTuple):
    """A track as it was held last.

    Attributes
    ----------
    seen : float
        s.
    state : (4,) ndarray
    reach : (2,) ndarray
        Semi-axis of its 95 % ellipse, m, and growth of that, m/s.
    """

    seen: float
    state: FloatArray
    reach: FloatArray

    def near(self, tracks: TrackArrays, now: float) -> BoolArray:
        """Which of some tracks are where this one would be now, within its 95 % ellipse."""
        step = np.array([1.0, now - self.seen])
        away = np.hypot(*(tracks.state[:, 0::2] - step @ self.state.reshape(2, 2).T).T)
        return np.asarray(away <= step @ self.reach)


def meters(distance: float, std: float | None = None) -> str:
    """A distance in words, m, with its standard deviation."""
    digits = 2 if distance < 10.0 else 1 if distance < 100.0 else 0
    return f"{distance:.{digits}f}{'' if std is None else f' ± {std:.{digits}f}'} m"


def _duration(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 120.0 else f"{seconds / 60.0:.1f} min"


def _time_until(due: float, now: float) -> str:
    return (f" in {_duration(due - now)}" if due >= now else ", passed") if due else ""


def finite_tracks(tracks: Sequence[ConfirmedTrack]) -> TrackArrays:
    """The tracks with finite states."""
    arrays = TrackArrays.from_tracks(tracks)
    return arrays.where(np.flatnonzero(np.isfinite(arrays.state).all(axis=1)))


def closest_approaches(tracks: TrackArrays, own_ship: Sequence[float]) -> FloatArray:
    """Closest approaches to own ship, at constant velocities.

    With ``u`` the direction from own ship to the track then, the distance has the variance ``g' P
    g``, ``g = [u_x, T u_x, u_y, T u_y]``, to first order: u is across the relative velocity, so
    that the error of T does not count. Own ship counts as known. Where its velocity is nan, T is 0.

    Parameters
    ----------
    tracks : TrackArrays
    own_ship : (x, y, heading, vx, vy)
        m, rad and m/s.

    Returns
    -------
    (n, 3) ndarray
        Time T until then (s; below 0 where it was in the past), distance and its standard
        deviation (m).
    """
    position = tracks.state[:, 0::2] - own_ship[:2]
    velocity = tracks.state[:, 1::2] - own_ship[3:5]
    time, distance = nmea_closest_approach(position, velocity)
    then = position + time[:, None] * np.nan_to_num(velocity)
    across = np.where(distance[:, None] > 0.0, then, velocity[:, ::-1] * (-1.0, 1.0))
    unit = across / np.maximum(np.hypot(*across.T), np.finfo(float).tiny)[:, None]
    gradient = np.stack([unit, time[:, None] * unit], axis=2).reshape(-1, 4)
    variance = np.einsum("ni,nij,nj->n", gradient, tracks.covariance, gradient)
    return np.stack([time, distance, np.sqrt(np.maximum(variance, 0.0))], axis=1)


class AlarmSupervisor:
    """Holds the alarms: takes what each scan says and what the time is, and has their states.

    Parameters
    ----------
    options : AlarmOptions
        The limits; they may be replaced at any time.
    clock : callable
        The time of onsets, s since 1970.

    Attributes
    ----------
    alarms : dict of str to Alarm
        By key.
    run : int
        Counts the runs of the track initiator.
    left_out : int
        Alarms of lost tracks that gave way to newer ones since the last acknowledgement.
    """

    def __init__(self, options: AlarmOptions, clock: Callable[[], float]) -> None:
        self.options, self._clock = options, clock
        self.alarms: dict[str, Alarm] = {}
        self.left_out = 0
        self._arrivals = deque[float](maxlen=LAST_INTERVALS + 1)
        self._ages = deque[tuple[float, float]](maxlen=1000)
        self._held: dict[str, HeldTrack] = {}
        self._lost: dict[str, HeldTrack] = {}
        self.run, self._newest = 1, (-1, -math.inf)  # the largest id, and when it was there first
        self._placed = self._returned = -math.inf  # since when own ship, and data, are there
        self._late = 0.0  # by how much stamps are late

    @property
    def patience(self) -> float:
        """Time after which data is missing, or a cause that is absent is over, s."""
        intervals = np.diff(self._arrivals).tolist()
        if not intervals:
            return FIRST_PATIENCE
        return max(MIN_PATIENCE, PATIENCE_INTERVALS * statistics.median(intervals))

    def silence_of_data(self, now: float) -> float:
        """Time since the last scan if it is longer than the patience, else 0, s."""
        since = now - self._arrivals[-1] if self._arrivals else 0.0
        return since if since > self.patience else 0.0

    def judge(self, key: str, holds: bool, sentence: str, now: float, due: float = 0.0) -> None:
        """Begin the alarm of a condition if it holds, or end it once it has been absent."""
        alarm = self.alarms.get(key)
        if holds and alarm is None and self._makes_room():
            onset = sentence + _time_until(due, now)
            alarm = self.alarms[key] = Alarm(key, sentence, onset, self._clock(), now)
        if holds and alarm is not None:
            alarm.count += not alarm.is_active
            alarm.is_active, alarm.present = True, now
            alarm.sentence, alarm.due = sentence, due
        elif alarm is not None and now - max(alarm.present, self._returned) > self.patience:
            self._end(alarm)

    def _makes_room(self) -> bool:
        """Whether there is room for one more: the oldest of a lost track gives way, and counts."""
        if len(self.alarms) >= MAX_ALARMS:
            lost = (key for key, alarm in self.alarms.items() if alarm.kind == "lost")
            self.left_out += self.alarms.pop(next(lost, ""), None) is not None
        return len(self.alarms) < MAX_ALARMS

    def acknowledge(self, counts: Mapping[str, float] | None = None) -> None:
        """Acknowledge alarms by key up to their counts; all of them by default.

        That of a lost track is over then: nothing else would end it.
        """
        self.left_out = 0
        for alarm in list(self.alarms.values()):
            if counts is None or counts.get(alarm.key, 0) >= alarm.count:
                alarm.is_acknowledged = True
                if not alarm.is_active or alarm.kind == "lost":
                    self._end(alarm)

    def silence(self, now: float) -> None:
        """Take the sound off all alarms for `SILENCE_TIME`."""
        for alarm in self.alarms.values():
            alarm.silent_until = now + SILENCE_TIME

    def tick(self, now: float) -> None:
        """Take that time has passed. Without any scan so far, nothing is known of the data."""
        if self._arrivals:
            since = self.silence_of_data(now)
            self.judge("data", since > 0.0, f"no scan for {_duration(since)}", now)

    def observe(self, scan: ObservedScan, now: float, age: float) -> None:
        """Take a scan that arrived at `now`, with the time from its stamp until then, s."""
        if self.silence_of_data(now) or not self._arrivals:
            self._placed = self._returned = now
        self._arrivals.append(now)
        self.tick(now)
        self._judge_age(now, age)
        self._judge_own_ship(scan.own_ship, now)
        moving, stands = scan.tracks.sure, scan.tracks.status == TrackStatus.STANDS_STILL
        again, self._newest = nmea_ids_again(self._newest, scan.tracks, scan.stamp)
        self.run += again
        for track_id in (*scan.fixed, *scan.tracks.track_id[stands].tolist()):
            self._held.pop(self.name(track_id), None)
        self._hold(moving, now)
        if (ship := scan.own_ship) is not None:
            self._judge_zone(scan, ship, now)
            self._judge_approaches(moving, ship, now)
        for name, held in list(self._held.items()):
            if now - max(held.seen, self._returned) > self.patience:
                self._lose(name, held, scan, now)
        for alarm in list(self.alarms.values()):
            if alarm.kind in ("cpa", "zone") and alarm.present < now:
                self.judge(alarm.key, False, "", now)

    def name(self, track_id: int) -> str:
        """Name of a track: its id, and which run of the track initiator has given it."""
        return str(track_id) if self.run == 1 else f"{track_id} (run {self.run})"

    def kept(self) -> dict[str, Any]:
        """What outlives a restart, for `restore`."""
        unkept = ("present", "silent_until", "due", "sentence")  # they change with each scan
        alarms = [asdict(alarm) for alarm in self.alarms.values()]
        kept = [{key: one[key] for key in one if key not in unkept} for one in alarms]
        return {"run": self.run, "newest": self._newest, "alarms": kept}

    def restore(self, kept: Mapping[str, Any], now: float) -> None:
        """Take what an earlier life has kept; causes must be seen again to last.

        Data is expected from now on: it may have stopped meanwhile.

        Raises
        ------
        KeyError, TypeError, ValueError
            If it is not what `kept` returns.
        """
        alarms = {
            one["key"]: Alarm(sentence=one["onset"], present=now, **one) for one in kept["alarms"]
        }
        self.run, (newest, stamp) = int(kept["run"]), kept["newest"]
        self._newest = int(newest), float(stamp)
        self._placed = self._returned = now
        self._arrivals.append(now)
        self.alarms = {key: alarm for key, alarm in alarms.items() if alarm.kind in KINDS}

    def listed(self, now: float) -> list[dict[str, Any]]:
        """The alarms for a page or a message, the most urgent first."""
        order = list(KINDS)
        alarms = sorted(
            self.alarms.values(),
            key=lambda one: (one.is_acknowledged, order.index(one.kind), one.due),
        )
        return [
            {
                "key": alarm.key,
                "title": KINDS[alarm.kind],
                "state": str(alarm.state(now)),
                "sounds": not alarm.is_acknowledged and now >= alarm.silent_until,
                "sentence": alarm.sentence + _time_until(alarm.due, now),
                "onset": alarm.onset,
                "time": round(alarm.time, 1),
                "count": alarm.count,
                "places": alarm.places,
            }
            for alarm in alarms
        ]

    def watched(self) -> str:
        """What the limits watch, in words; empty: nothing."""
        options = self.options
        near = f" within {meters(options.lost_range)}" if options.lost_range else ""
        near += f" ({self.left_out} older alarms left out)" * (self.left_out > 0)
        watched = (
            f"CPA {meters(options.cpa_limit)}" * (options.cpa_limit > 0.0),
            "guard zone" * (options.guard_max_range > 0.0),
            f"lost targets{near}" * options.lost_targets,
        )
        return ", ".join(filter(None, watched))

    def _end(self, alarm: Alarm) -> None:
        """Note that a cause is over, and forget the alarm if it is acknowledged."""
        alarm.is_active = False
        if alarm.is_acknowledged:
            self.alarms.pop(alarm.key, None)

    def _judge_age(self, now: float, age: float) -> None:
        """The freshest of the last scans counts: one may be late, or stamped as a clock stepped."""
        self._ages.append((now, age))
        while self._ages[0][0] < now - self.patience:
            self._ages.popleft()
        age = min((age for _, age in self._ages), key=abs)
        self._late = age if 0.0 < age <= MAX_AGE else 0.0
        side = "old" if age > 0.0 else "ahead"
        sentence = f"stamps are {_duration(abs(age))} {side}, or the clocks differ"
        self.judge("age", self.patience < abs(age) <= MAX_AGE, sentence, now)

    def _judge_own_ship(self, ship: Sequence[float] | None, now: float) -> None:
        """What the limits need of own ship, once it has been missing for the patience."""
        options, known = self.options, ship or (math.nan,) * 4
        is_zone = options.guard_max_range > 0.0
        needs = (
            ("own ship", known[0], options.cpa_limit > 0.0 or is_zone or options.lost_range > 0.0),
            ("heading", known[2], is_zone and self._sector <= ROUND),
            ("speed of own ship", known[3], options.cpa_limit > 0.0),
        )
        missing = [f"no {name}" for name, value, is_needed in needs if is_needed and value != value]
        if not missing:
            self._placed = now
        self.judge("watch", now - self._placed > self.patience, "".join(missing[:1]), now)

    @property
    def _sector(self) -> float:
        return self.options.guard_azimuth_max - self.options.guard_azimuth_min

    def _hold(self, tracks: TrackArrays, now: float) -> None:
        """Remember the tracks of a scan, and end the alarms of those that were lost."""
        parts = tracks.covariance[:, 0::2, 0::2], tracks.covariance[:, 1::2, 1::2]
        reach = np.stack([track_ellipses(part)[:, 0] for part in parts], axis=1)
        names = [self.name(track_id) for track_id in tracks.track_id.tolist()]
        self._inherit(names, tracks, now)
        states = zip(names, tracks.state, reach, strict=True)
        self._held |= {name: HeldTrack(now, *state) for name, *state in states}
        found = {name for name, held in self._lost.items() if held.near(tracks, now).any()}
        for alarm in [alarm for alarm in self.alarms.values() if alarm.places]:
            for name in alarm.places.keys() & found.union(names):
                del alarm.places[name]
            if not alarm.places:
                self._end(alarm)
        there = set[str]().union(*(alarm.places for alarm in self.alarms.values()))
        self._lost = {name: held for name, held in self._lost.items() if name in there}

    def _inherit(self, names: Sequence[str], tracks: TrackArrays, now: float) -> None:
        """Give the alarms of tracks that are missing to those that are new in their places."""
        fresh = [row for row, name in enumerate(names) if name not in self._held]
        news = tracks.where(np.array(fresh, int))
        for alarm in list(self.alarms.values()):
            old = alarm.key.partition(" ")[2]
            near = self._held[old].near(news, now) if old in self._held.keys() - names else None
            if near is not None and near.any():
                self.alarms.pop(alarm.key)
                alarm.key = f"{alarm.kind} {names[fresh[int(near.argmax())]]}"
                self.alarms[alarm.key] = alarm

    def _judge_zone(self, scan: ObservedScan, ship: Sequence[float], now: float) -> None:
        """Tracks in the guard zone, whose sector is from the bow."""
        options, tracks = self.options, scan.tracks
        x, y = (tracks.state[:, 0::2] - ship[:2]).T
        start = (np.arctan2(y, x) - ship[2] - options.guard_azimuth_min) % (2 * math.pi)
        inside = (start <= self._sector) | (self._sector > ROUND)
        near, far, away = options.guard_min_range, options.guard_max_range, np.hypot(x, y)
        inside &= (near <= away) & (away <= far) & (far > 0.0)
        kinds = [TrackStatus.CONFIRMED] + [TrackStatus.STANDS_STILL] * options.guard_standing
        for row in np.flatnonzero(inside & np.isin(tracks.status, kinds)).tolist():
            name = self.name(int(tracks.track_id[row]))
            sentence = f"track {name}{scan.away(*tracks.state[row, 0::2])}"
            self.judge(f"zone {name}", True, sentence, now)

    def _judge_approaches(self, tracks: TrackArrays, ship: Sequence[float], now: float) -> None:
        """Closest approaches below the limit; 0 m is none, whatever the error."""
        options, approaches = self.options, closest_approaches(tracks, ship).tolist()
        away = np.hypot(*(tracks.state[:, 0::2] - ship[:2]).T).tolist()
        for row, (time, distance, std) in enumerate(approaches):
            key = f"cpa {self.name(int(tracks.track_id[row]))}"
            begins = distance < options.cpa_limit and 0.0 <= time <= options.tcpa_limit
            is_soon = 0.0 <= time <= APPROACH_MARGIN * options.tcpa_limit
            is_over = (
                distance - APPROACH_MARGIN * std > options.cpa_limit
                or (away[row] > options.cpa_limit and not is_soon)
                or not options.cpa_limit
            )
            if begins or (key in self.alarms and not is_over):
                sentence = f"track {key.removeprefix('cpa ')}, {meters(distance, std)}"
                self.judge(key, True, sentence, now, time and now + time - self._late)

    def _lose(self, name: str, held: HeldTrack, scan: ObservedScan, now: float) -> None:
        """A track that is missing or coasts is lost, unless another is in its place."""
        del self._held[name]
        x, y = held.state[0::2].tolist()
        ship, limit = scan.own_ship, self.options.lost_range or math.inf
        is_near = ship is None or math.hypot(x - ship[0], y - ship[1]) <= limit
        has_alarm = f"cpa {name}" in self.alarms or f"zone {name}" in self.alarms
        is_watched = has_alarm or (self.options.lost_targets and is_near)
        others = scan.tracks.where(scan.tracks.status != TrackStatus.COASTING)
        if not is_watched or held.near(others, now).any():
            return
        self._lost[name] = held
        is_of_gap = held.seen < self._returned
        key = "lost when data stopped" if is_of_gap else f"lost {name}"
        places = {**(self.alarms[key].places if key in self.alarms else {}), name: (x, y)}
        sentence = f"track {name}{scan.away(x, y)}"
        if is_of_gap:
            sentence = f"{len(places)} when data stopped: {', '.join(places)}"
        self.judge(key, True, sentence, now)
        if alarm := self.alarms.get(key):
            alarm.places, alarm.onset = places, sentence
