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
"""Sweeps in parts: messages of a beam or a sector each are joined to scans.

Where a turn begins and ends is said by `turn.Turn`. Here are the messages that wait for its end,
and what is joined: the rows of all messages, each at its own time.

A target that lies across the seam, where one turn ends and the next begins, is seen by the last
beams of a turn and by the first of the next. Its echoes follow each other without a pause: they all
belong to the turn that ends.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from tsepm_ros.own_ship.registration import UnregisteredScan, selected_for_registration
from tsepm_ros.session.drop_reasons import Notice, Rejection, Remark
from tsepm_ros.session.inputs import MAX_INTERVAL, Now, input_waited
from tsepm_ros.session.turn import (
    MIN_PARTS,
    TURN,
    Closing,
    Turn,
    TurnLearner,
    turn_looked_at,
    turn_sees_all,
)
from tsepm_ros.settings.settings import Settings
from tsepm_ros.tracker.scan import Scan, turned
from tsepm_ros.tracker.sensor import SensorModel, rays_go_on

LINKED_STEPS = 2.5
"""Steps of the beam within which echoes follow each other."""
WIDEST_BEAM = math.radians(5.0)
"""Azimuth after the seam up to which echoes belong before it, where no resolution is given, rad."""
DEVIATIONS = 3.0
"""Standard deviations of the difference of two ranges up to which they are of one target."""
SAME_RAY = 1e-6
"""Difference of azimuths up to which a detection is on a ray, rad."""
_OF_SCANS = ("range", "azimuth", "range_std", "azimuth_std", "time_offset")
MAX_LATE_TIME = 0.5
"""Part of a turn's time over which late messages that rise are a clock that was set back."""
MIN_SILENCE = 1.0
"""Shortest time without a message after which an open scan is ended, s."""
MAX_CUT = 4
"""Scans in a row, cut since the beam stands, after which a learned sweep is none any more."""


class SweepSeamEchoes:
    """Follows echoes from the end of a turn over the seam.

    Parameters
    ----------
    sensor : SensorModel
        Resolution and errors say how far apart the echoes of one target are.
    target_extent : float
        m.
    step : float
        Step of the beam, rad.
    """

    def __init__(self, sensor: SensorModel, target_extent: float, step: float) -> None:
        self._sensor = sensor
        self._extent = target_extent
        self._reach = max(LINKED_STEPS * step, sensor.azimuth_resolution)
        self._limit = max(WIDEST_BEAM, sensor.azimuth_resolution)
        self._beam: FloatArray = np.zeros(0)
        self._range: FloatArray = np.zeros(0)

    def add(self, beam: float, range: FloatArray) -> None:
        """Note echoes (n,), m, at an azimuth after the seam, rad; before it, below 0."""
        if -beam <= self._reach:
            self._beam = np.append(self._beam, np.full(len(range), beam))
            self._range = np.append(self._range, range)

    def take(self, beam: float, range: FloatArray) -> BoolArray:
        """Which echoes (n,), m, at an azimuth after the seam, rad, belong before it."""
        if beam > self._limit:
            return np.zeros(len(range), bool)
        chain = self._range[np.abs(beam - self._beam) <= self._reach]
        deviation = np.sqrt(2.0 * self._sensor.range_variance(range))
        reach = np.maximum(DEVIATIONS * deviation, self._sensor.range_resolution + self._extent)
        before = np.asarray((np.abs(range[:, None] - chain) <= reach[:, None]).any(axis=1))
        self.add(beam, range[before])
        return before

    def ends(self, beam: float) -> bool:
        """Whether no echo at an azimuth after the seam, rad, can belong before it any more."""
        return beam > self._limit or not (beam - self._beam <= self._reach).any()


def sweep_delay(first: UnregisteredScan, message: UnregisteredScan) -> float:
    """Time from the stamp of a message to that of another, s; to the nanosecond, where known."""
    if first.stamp_ns and message.stamp_ns:
        return (message.stamp_ns - first.stamp_ns) / 1e9
    return message.scan.stamp - first.scan.stamp


def stacked_sweep(
    tables: Sequence[Mapping[str, FloatArray]], missing: Callable[[str, int], FloatArray]
) -> dict[str, FloatArray]:
    """Rows of tables below each other, with every column that any of them has.

    Parameters
    ----------
    tables : sequence of mapping of str to (n, ...) ndarray
        At least one: columns of one row per detection, bearing or whatever a message consists of.
    missing : callable
        Called as ``missing(column, index of the table)``: the rows of a column that it lacks.

    Returns
    -------
    dict of str to (sum of n, ...) ndarray
    """
    return {
        name: np.concatenate(
            [
                table[name] if name in table else missing(name, index)
                for index, table in enumerate(tables)
            ]
        )
        for name in dict.fromkeys(name for table in tables for name in table)
    }


def joined_sweep(
    messages: Sequence[UnregisteredScan], sensor: SensorModel, swept: FloatArray | None
) -> UnregisteredScan:
    """One scan of the detections of messages, each at its own time.

    Parameters
    ----------
    messages : sequence of UnregisteredScan
        At least one, in the order of their stamps, in one frame and of one reference direction.
    sensor : SensorModel
        Errors of the detections of a message that gives none, where another one does.
    swept : (2,) ndarray or None
        As in `Scan`.

    Returns
    -------
    UnregisteredScan
        With the stamp of the first message; a detection's times are those of its message plus the
        time between the two stamps.
    """
    first = messages[0]
    if len(messages) == 1:
        scan = first.scan if swept is None else dataclasses.replace(first.scan, swept=swept)
        return first if swept is None else dataclasses.replace(first, scan=scan)
    full = [message for message in messages if len(message.scan)] or [first]

    def missing(name: str, index: int) -> FloatArray:
        scan = full[index].scan
        if name == "range_std":
            return np.sqrt(sensor.range_variance(scan.range))
        value = {"azimuth_std": sensor.azimuth_std, "height": 0.0}.get(name, math.nan)
        return np.full(len(scan), value)

    rows = stacked_sweep([_rows(message, sweep_delay(first, message)) for message in full], missing)
    height, transmit_offset = rows.pop("height", None), rows.pop("transmit_offset")
    own = {name: rows.pop(name) for name in _OF_SCANS if name in rows}
    scan = Scan.trusted(
        **dict.fromkeys(_OF_SCANS) | own,
        stamp=first.scan.stamp,
        features=rows,
        group=_groups(messages, sensor),
        swept=swept,
    )
    return dataclasses.replace(
        first, scan=scan, transmit_offset=transmit_offset, height=height, beams=None
    )


def _rows(message: UnregisteredScan, later: float) -> dict[str, FloatArray]:
    """The columns of a message's detections, by name, at times later by some seconds."""
    scan, zero = message.scan, np.zeros(len(message.scan))
    columns = {
        "range": scan.range,
        "azimuth": scan.azimuth,
        "range_std": scan.range_std,
        "azimuth_std": scan.azimuth_std,
        "time_offset": later + (zero if scan.time_offset is None else scan.time_offset),
        "transmit_offset": later + zero + message.sent,
        "height": message.height,
        **scan.features,
    }
    return {name: values for name, values in columns.items() if values is not None}


def _groups(messages: Sequence[UnregisteredScan], sensor: SensorModel) -> IntArray | None:
    """Groups of all detections; runs of rays go on from one message to the next."""
    if all(message.scan.group is None for message in messages):
        return None
    groups, following = [np.zeros(0, np.int64)], 0
    for before, message in zip([None, *messages[:-1]], messages, strict=True):
        group = message.scan.group
        if group is None or not len(group):
            groups.append(np.full(len(message.scan), -1))
            continue
        own = np.where(group < 0, -1, group - group.min() + following)
        if before is not None and group.min() >= 0 and _continues(before, message, sensor):
            own = own - 1 + (following - own[0])
        groups.append(own)
        following = int(own.max(initial=following - 1)) + 1
    return np.concatenate(groups)


def _continues(before: UnregisteredScan, after: UnregisteredScan, sensor: SensorModel) -> bool:
    """Whether the last ray of a message and the first of the next see one object."""
    arc_before, arc_after = before.beams, after.beams
    if arc_before is None or arc_after is None or before.scan.group is None or not len(before.scan):
        return False
    # Of the first and last beams of both, the two that are next to each other.
    edges = [
        (end, begin)
        for end in (arc_before.start, arc_before.start + arc_before.width)
        for begin in (arc_after.start, arc_after.start + arc_after.width)
    ]
    end, begin = min(edges, key=lambda pair: abs(turned(pair[1] - pair[0])))
    last, first = float(before.scan.azimuth[-1]), float(after.scan.azimuth[0])
    if max(abs(turned(last - end)), abs(turned(first - begin))) > SAME_RAY:
        return False
    rays = before.scan.range[-1:], after.scan.range[:1]
    return bool(rays_go_on(*rays, turned(first - last), sensor)[0])


class Part(NamedTuple):
    """A message of a scan that is not complete, and its azimuth since the seam, rad."""

    beam: float
    message: UnregisteredScan


Taken = tuple[list[UnregisteredScan], list[Remark]]
"""What a message leads to: scans that are complete, and remarks."""


class Sweep:
    """Makes scans of messages, by the option `sweep`; pure logic, without clocks.

    A scan ends where the turn closes, and before it has too many detections.

    Parameters
    ----------
    settings : Settings

    Attributes
    ----------
    settings : Settings
        May be replaced; the option `sweep` does not change.
    active : bool
        Whether messages are put together.
    begins : bool
        Whether beams, each listed whole, advance to a turn that is not known yet.
    latency : float
        Time from the first message of the last scan to its completion, by the stamps, s.
    """

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.reset()

    def reset(self) -> None:
        """Forget the messages that wait, and what was learned."""
        given = self.settings.session.sweep_seconds
        self.active, self.begins = given > 0.0, False
        self.latency = 0.0
        self._turn, self._learner = Turn(given), TurnLearner()
        self._parts = self._detections = 0  # of the last scan, and of the open one
        self._heard: Now = math.nan
        self._far_back: UnregisteredScan | None = None
        self._late_since, self._late_stamp = math.nan, math.inf
        self._open: list[Part] | None = None
        self._ending: tuple[list[Part], SweepSeamEchoes] | None = None

    @property
    def is_open(self) -> bool:
        """Whether messages wait for the end of their sweep."""
        return self._open is not None or self._ending is not None

    @property
    def state(self) -> str:
        """How scans are made of messages, in words."""
        if not self.active:
            return "a message is a scan"
        return f"sweeps of {self._turn.seconds:.3g} s" + (
            f" in {self._parts} messages" if self._parts else ", none complete yet"
        )

    def take(self, message: UnregisteredScan, now: Now) -> Taken:
        """Take a message that arrived at `now`, s."""
        learns = self.settings.session.sweep == "auto"
        if self.active:
            self._heard = now
            scans, remarks = self._join(message)
            if learns and self._turn.cut >= MAX_CUT:
                scans += self._end()
                self.reset()
                remarks.append(
                    Notice("sweep", "the beam no longer turns: each message is a scan again")
                )
            return scans, remarks
        scan = message.scan
        turning = self._learner.take(scan.stamp, message.beams, scan.range) if learns else None
        rows = self._learner.rows
        self.begins = turning is None and len(rows) >= MIN_PARTS and rows[-1].whole
        if turning is None:
            return [message], []
        seconds, parts = turning
        self.active, self._heard, self._turn = True, now, Turn(seconds)
        self._join(message)
        said = (
            f"messages are parts of a sweep of {seconds:.3g} s (about {parts} messages): they are "
            "joined to scans, and earlier tracks are discarded"
        )
        return [], [Notice("sweep", said)]

    def overdue(self, now: Now) -> Taken:
        """End the open scan if no message has arrived for the time of a turn."""
        silent = max(self._turn.seconds, MIN_SILENCE) < input_waited(self._heard, now) < math.inf
        return self._end() if self.is_open and silent else [], []

    def close(self) -> Taken:
        """End the open scan: no message follows."""
        return self._end(), self._refuse_far_back()

    def _join(self, message: UnregisteredScan) -> Taken:
        """Put the next message to the others; return the scans that are complete."""
        stamp, newest, held = message.scan.stamp, self._turn.stamp, self._far_back
        scans: list[UnregisteredScan] = []
        if held and held.scan.stamp < stamp < min(newest, held.scan.stamp + MAX_INTERVAL):
            self._far_back = None
            scans = self._end() + self._begin(held)
        remarks = self._refuse_far_back()
        newest = self._turn.stamp
        if self._open is None:
            scans += self._begin(message)
        elif stamp > newest or (stamp == newest and self._turn.is_beside(message.beams)):
            scans += self._take_next(self._open, message)
        elif newest - stamp > self.settings.session.restart_jump:
            self._far_back = message
        else:
            late, refusals = self._take_late(self._open, message)
            return scans + late, remarks + refusals
        self._late_stamp = math.inf
        return scans, remarks

    def _refuse_far_back(self) -> list[Remark]:
        """Refuse a message whose stamp is far back, and that no other has confirmed."""
        held, self._far_back = self._far_back, None
        if held is None:
            return []
        stamp = held.scan.stamp
        reason = "stamp_not_set" if stamp == 0.0 else "scan_far_back"
        return [Rejection(reason, f"the message at {stamp:.3f} s is far back")]

    def _begin(self, message: UnregisteredScan) -> list[UnregisteredScan]:
        """Begin anew with a message; return it if it is a scan by itself."""
        self._turn.begin(message.scan.stamp, message.beams)
        self._open, self._detections = [Part(0.0, message)], len(message.scan)
        return self._end(complete=True) if turn_sees_all(message.beams) else []

    def _take_next(self, scan: list[Part], message: UnregisteredScan) -> list[UnregisteredScan]:
        """Take a message that is newer than the others of the open scan."""
        closing: Closing | None = Closing.BROKEN
        first, axes = scan[0].message, (message.frame_id, message.axes, message.north_referenced)
        if axes == (first.frame_id, first.axes, first.north_referenced):
            closing = self._turn.take(message.scan.stamp, message.beams)
        scans: list[UnregisteredScan] = []
        if closing is Closing.FULL:
            scans = self._end_waiting()
            extent = self.settings.common.target_extent
            seam = SweepSeamEchoes(self.settings.sensor, extent, self._turn.step)
            for part in scan:
                seam.add(part.beam - TURN, part.message.scan.range)
            self._ending, self._open, closing = (scan, seam), [], None
            self._detections = 0
        most = self.settings.common.max_detections - len(message.scan)
        if closing is not None or (self._open is scan and self._detections > most):
            return self._end() + self._begin(message)
        return scans + self._over_the_seam(message)

    def _over_the_seam(self, message: UnregisteredScan) -> list[UnregisteredScan]:
        """Add a message to the open scan, and what of it belongs before the seam to that before."""
        assert self._open is not None
        beam, ended = self._turn.azimuth, list[UnregisteredScan]()
        if self._ending is not None:
            ending, seam = self._ending
            before = seam.take(beam, message.scan.range)
            if before.any():
                ending.append(Part(TURN, selected_for_registration(message, before)))
                message = selected_for_registration(message, ~before)
            if seam.ends(beam + self._turn.step):
                ended = self._end_waiting()
        self._open.append(Part(beam, message))
        self._detections += len(message.scan)
        return ended

    def _end(self, *, complete: bool = False) -> list[UnregisteredScan]:
        """End the open scan, as a rule incomplete, and return what was not returned yet."""
        scans = self._end_waiting()
        if self._open is not None:
            scans.append(self._whole(self._open, complete=complete))
        self._open = None
        self._turn.forget()
        return scans

    def _end_waiting(self) -> list[UnregisteredScan]:
        """Return the turn that waited for echoes across the seam."""
        ending, self._ending = self._ending, None
        return [] if ending is None else [self._whole(ending[0], complete=True)]

    def _whole(self, scan: list[Part], *, complete: bool) -> UnregisteredScan:
        """The messages as one scan, with what it has looked at where that is not a whole turn."""
        messages = [part.message for part in scan]
        self._parts = len(messages)
        self.latency = self._turn.stamp - messages[0].scan.stamp
        arcs = [message.beams for message in messages]
        swept = None if complete else turn_looked_at(arcs, self._turn.step)
        return joined_sweep(messages, self.settings.sensor, swept)

    def _take_late(self, scan: list[Part], message: UnregisteredScan) -> Taken:
        """Refuse a late message, unless the clock was set back."""
        stamp = message.scan.stamp
        if any(part.message.scan.stamp == stamp for part in scan):
            return [], [Rejection("scan_same_stamp", f"a second message at {stamp:.3f} s")]
        if stamp <= self._late_stamp:
            self._late_since = stamp
        self._late_stamp = stamp
        if stamp - self._late_since <= MAX_LATE_TIME * self._turn.seconds:
            return [], [Rejection("message_late", f"the message at {stamp:.3f} s is late")]
        self._late_stamp = math.inf
        return self._end() + self._begin(message), []
