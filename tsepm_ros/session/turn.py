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
"""The turn of a beam, by the stamps and the azimuths of messages alone, and images joined by it.

`Turn` follows a beam whose turn takes a known time, and says where a turn closes. `TurnLearner`
learns from messages whether they are those of a beam that turns.

A message of a sensor that turns its beam looks at a small arc, and the arcs move at a constant rate
through a whole turn, or to and fro. Messages of a sonar that looks everywhere at once do not: their
arcs are wide, stay, or jump. Where a message lists only its detections, a single object seen from a
turning vessel moves like a beam: the ranges of that do not change from message to message.

`ImageTurns` joins sonar images as they arrive: whole pings, or bearings and sectors that make a
turn or a pass. `TurnBeam` is the line of azimuths over time on which the next message is expected;
a message beside it is left out. The bearings of a turn are put on a grid of even azimuths, since
their number differs from turn to turn: each in the nearest cell, and NaN where there is none. The
grid is shifted by the part of a step by which a turn's bearings lie beside it.
"""

from __future__ import annotations

import enum
import math
import statistics
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.numerics.arrays import BoolArray, FloatArray
from tsepm_ros.session.consistency_checks import CopiedRuns
from tsepm_ros.tracker.scan import ScanArc, turned, wrap

TURN = 2 * math.pi
GAP, GAP_INTERVALS = 0.5, 3.0
"""Part of a turn's time without a message that ends a turn, since the azimuth is lost; and least
number of the messages' usual intervals."""
FASTEST = 0.1
"""Shortest time of a turn, as a part of that given or learned."""
PATIENCE = 1.5
"""Turns' times that a turn lasts at most; more by this factor after each that was cut."""
MOST_PATIENCE = 20.0
"""Most turns' times that a turn lasts, however slowly the beam moves."""
WHOLE_VIEW = 1.5 * math.pi
"""Width of the arc of all beams from which on a message is a turn by itself, rad."""
STEPS = 64
"""Steps and widths of messages that are remembered."""
MIN_STEP = 1e-4
"""Smallest step of a beam that is told from noise, rad."""
MIN_PARTS = 4
"""Least messages of a turn, or a pass, whose time counts, or that show a sweep."""
TURNS = 3
"""Turns of which the longest gives the time of a turn: a part of one does not."""
WIDEST_PART = 0.5 * math.pi
"""Widest arc of a message of a sweep, and longest step between two, rad."""
MIN_ECHOES = 16
"""Least messages of a turn or sector that show a sweep, where they list detections only."""
MOST_PARTS = 20_000
"""Most messages of a turn."""
EVEN_RATES = 0.8
"""Least share of steps whose rate differs from the beam's by less than a factor of 2."""
LONGEST_OVERLAP = 0.5
"""Largest part of a message's arc that the next one may look at again."""
RANGE_CHANGE, CHANGES = 0.1, 0.25
"""Least change of the range, as a part of it, and least share of changes, of detections only."""
LINE, NEWEST = 16, 5
"""Messages of the line that a beam is followed by, and those whose median says where it is."""
STEPS_OFF, MOST_OFF = 1.5, 0.25 * math.pi
"""Steps, and angle (rad), by which a message lies beside the line at most."""
ODD = 4
"""Messages in a row beside the line that say that the beam is elsewhere."""
MAJORITY = 0.6
"""Messages of another geometry that decide, less those of the used one, as a part of a turn's."""
VAIN = 4
"""Beginnings in a row without an image from which on the turn is learned anew."""
TRY_AGAIN = 1.1
"""Factor of the messages that wait, between two attempts to learn a turn of them."""
MOST_BYTES = 2**27
"""Most memory of the messages that wait."""
CHANGED = 0.2
"""Relative change of the step, or of a sector's width, from which on the grid is another."""
WHOLE_GAP, SHORTEST = 2.5, 3.0
"""Steps, at most, that a whole turn lacks, and steps of the shortest pass over a sector."""
NO_NOISE = (
    "every image is equal to the one before to the bit: they are used, as those of a source "
    "without noise; a driver that sends its last image again gives false tracks"
)


class Closing(enum.Enum):
    """How a turn closes before a message."""

    FULL = "the beam is at the seam again, where the turn began"
    BROKEN = (
        "the azimuth is lost; the message sees all round; the beam turns back, and a pass over a "
        "sector is complete; or it stands, or is slow"
    )


class Turn:
    """Follows a beam that turns, or moves to and fro over a sector.

    Messages whose azimuth is unknown advance the beam at the rate of the turn.

    Parameters
    ----------
    seconds : float
        Time of a turn, or of a pass over a sector.

    Attributes
    ----------
    stamp : float
        Of the newest message, s; -inf before the first.
    azimuth : float
        Of the beam since the seam, along the turn, rad.
    cut : int
        Turns in a row that were cut, since the beam stood or was slow.
    """

    def __init__(self, seconds: float) -> None:
        self._durations = deque([seconds], maxlen=TURNS)
        self._shortest = FASTEST * seconds
        self._intervals, self._steps, self._widths = (deque[float](maxlen=STEPS) for _ in range(3))
        self._direction = 0.0
        self.cut = 0
        self.forget()

    def forget(self) -> None:
        """Forget where the beam is; the turn's time and direction stay."""
        self.stamp, self.azimuth = -math.inf, 0.0
        self._begin, self._messages = math.nan, 0
        self._known = math.nan, math.nan, 0.0  # stamp, azimuth as seen, and here
        self._unknown = 0  # messages since that show no azimuth

    @property
    def seconds(self) -> float:
        """Time of a turn, or of a pass over a sector, as last seen, s."""
        return max(self._durations)

    @property
    def step(self) -> float:
        """Usual step of the beam, rad."""
        return max(statistics.median(self._steps), MIN_STEP) if self._steps else MIN_STEP

    def begin(self, stamp: float, arc: ScanArc | None) -> None:
        """Begin a turn anew with a message, whose azimuth is the seam."""
        self.forget()
        self.stamp, self._begin, self._messages = stamp, stamp, 1
        if arc is not None:
            self._known = stamp, arc.middle, 0.0

    def take(self, stamp: float, arc: ScanArc | None) -> Closing | None:
        """Move the beam to the next message; return how the turn before it closes, if it does.

        After `Closing.FULL` the message is of the next turn, otherwise `begin` follows.

        Parameters
        ----------
        stamp : float
            Not before the newest, s.
        arc : ScanArc or None
            The azimuths that the message looked at; None if unknown.
        """
        interval = stamp - self.stamp
        self._intervals.append(interval)
        usual = GAP_INTERVALS * statistics.median(self._intervals)
        if interval > max(GAP * self.seconds, usual) or turn_sees_all(arc):
            return Closing.BROKEN
        forward = self._forward(stamp, arc)
        if forward < -0.5 * max([self.step, *self._widths]):  # more than noise
            self._complete(stamp)
            self.stamp, self._direction = stamp, 0.0
            return Closing.BROKEN
        self._advance(stamp, arc, forward)
        if self.azimuth >= TURN - 0.5 * self.step:
            self._pass_seam(stamp)
            return Closing.FULL
        self._messages += 1
        if stamp - self._begin > min(PATIENCE ** (1 + self.cut), MOST_PATIENCE) * self.seconds:
            self.cut += 1
            return Closing.BROKEN
        return None

    def is_beside(self, arc: ScanArc | None) -> bool:
        """Whether a message with the newest stamp is another beam of the same batch."""
        return arc is not None and abs(turned(arc.middle - self._known[1])) > 0.5 * self.step

    def _forward(self, stamp: float, arc: ScanArc | None) -> float:
        """Step of the beam since the last known azimuth, along the turn, rad; nan if unknown.

        Of the steps that differ by turns, the one that the time suggests; and of both directions
        while that is unknown.
        """
        known, azimuth, _ = self._known
        if arc is None or math.isnan(azimuth):
            return math.nan
        raw = turned(arc.middle - azimuth)
        expected = TURN / self.seconds * (stamp - known)
        steps = [raw * sign for sign in ([self._direction] if self._direction else [1.0, -1.0])]
        steps = [step + TURN * round((expected - step) / TURN) for step in steps]
        forward = min(steps, key=lambda step: abs(step - expected))
        if self._direction == 0.0 and forward >= MIN_STEP:
            self._direction = 1.0 if forward == steps[0] else -1.0
        return forward

    def _advance(self, stamp: float, arc: ScanArc | None, forward: float) -> None:
        """Move the beam to a message."""
        here, unknown = self._known[2] + forward, self._unknown
        if arc is None or math.isnan(forward):
            self.azimuth = here = self.azimuth + TURN / self.seconds * (stamp - self.stamp)
            self._unknown += 1
        else:
            self.azimuth, self._unknown = self._known[2] + max(forward, 0.0), 0
            self._steps.extend([forward / (1 + unknown)] * (forward > 0.0))
            self._widths.extend([arc.width] * (not arc.whole))
        if arc is not None:
            self._known = stamp, arc.middle, here
        self.stamp = stamp

    def _complete(self, stamp: float) -> None:
        """Learn the time of the turn, which ends at a stamp, s."""
        if self._messages >= MIN_PARTS:  # fewer are a beam that trembles
            self._durations.append(max(stamp - self._begin, self._shortest))
        self.cut = 0

    def _pass_seam(self, stamp: float) -> None:
        """Go on with the next turn."""
        known, azimuth, here = self._known
        if not math.isnan(azimuth):
            self._complete(stamp)
        self.azimuth, self._known, self.cut = self.azimuth - TURN, (known, azimuth, here - TURN), 0
        self._begin, self._messages = stamp, 1


def turn_sees_all(arc: ScanArc | None) -> bool:
    """Whether a message looks at nearly all azimuths."""
    return arc is not None and arc.whole and arc.width >= WHOLE_VIEW


def turn_looked_at(arcs: Sequence[ScanArc | None], step: float) -> FloatArray | None:
    """The arc that messages are known to have looked at; None for a whole turn.

    Parameters
    ----------
    arcs : sequence of ScanArc or None
        In the order of the messages.
    step : float
        Step of the beam, of which half is added at both ends, rad.

    Returns
    -------
    (2,) ndarray or None
        As `swept` in `Scan`.
    """
    known = [arc for arc in arcs if arc is not None]
    if not known:
        return np.zeros(2)
    middle = np.unwrap([arc.middle for arc in known])
    half = np.array([0.5 * arc.width for arc in known]) + 0.5 * step
    low, high = float((middle - half).min()), float((middle + half).max())
    return None if high - low >= TURN else np.array([turned(low), high - low])


class TurnBeam:
    """The azimuth of a beam over time: a line through its last messages.

    Parameters
    ----------
    step : float
        Usual step between two messages, rad.
    rate : float
        rad/s.
    slack : float
        How far messages lie beside the line, rad.
    """

    def __init__(self, step: float, rate: float, slack: float = 0.0) -> None:
        self.step, self.rate, self.slack = step, rate, slack
        self._line: deque[tuple[float, float]] = deque(maxlen=LINE)

    def begin(self) -> None:
        """Forget where the beam is, and its direction."""
        self._line.clear()

    @property
    def direction(self) -> float:
        """1 or -1 as the azimuth rises or falls; 0 until it has moved far enough."""
        moved = self._line[-1][1] - self._line[0][1] if self._line else 0.0
        return math.copysign(1.0, moved) if abs(moved) > STEPS_OFF * self.step else 0.0

    def place(self, stamp: float, azimuth: float) -> tuple[float, float]:
        """Azimuth of a message along the line, and how far it lies beside the line, rad."""
        if not self._line:
            return azimuth, 0.0
        newest = list(self._line)[-NEWEST:]
        rates = (self.rate,) if self.direction else (self.rate, -self.rate)
        there = [statistics.median(a + rate * (stamp - t) for t, a in newest) for rate in rates]
        off, expected = min(
            ((turned(azimuth - a), a) for a in there), key=lambda offset: abs(offset[0])
        )
        return expected + off, off

    def take(self, stamp: float, place: float) -> None:
        """Go on to a message at its place along the line, rad."""
        self._line.append((stamp, place))
        seconds, azimuth = stamp - self._line[0][0], place - self._line[0][1]
        if 2 * len(self._line) >= LINE and seconds > 0.0 and azimuth:
            self.rate = azimuth / seconds
        elif azimuth:
            self.rate = math.copysign(self.rate, azimuth)

    def fault(self, stamp: float, azimuth: float) -> str:
        """Why a message is not on the line: a reason of `DROP_REASONS`; empty if it is."""
        if not self._line:
            return ""
        last, before = self._line[-1]
        pause = max(GAP * TURN, GAP_INTERVALS * self.step) / abs(self.rate)
        is_far = not abs(stamp - last) <= pause
        reach = min(STEPS_OFF * max(self.step, self.slack), MOST_OFF)
        if not is_far and abs(self.place(stamp, azimuth)[1]) <= reach:
            return ""
        if stamp == 0.0:
            return "stamp_not_set"
        ahead = turned(azimuth - (before + math.copysign(self.step, self.rate)))
        return (
            "bearing_stamp" if is_far or abs(ahead) <= STEPS_OFF * self.step else "bearing_azimuth"
        )


@dataclass(frozen=True, eq=False)
class ImagePing:
    """What a message says of a ping, or of some of its bearings.

    Attributes
    ----------
    stamp_ns : int
    frame_id : str
    range : (m,) ndarray
        m, ascending, above 0.
    azimuth : (b,) ndarray
        rad, from ahead to port.
    intensity : (b, m) ndarray
    time_offset : (b,) ndarray or None
        Transmission of each bearing after the stamp, s.
    sound_speed : float
        m/s; 0 where the message states none.
    is_part : bool
        Whether the bearings are a part of a turn.
    assumptions : tuple of str
        Sentences about what the message does not state.
    corners : str
        Which corner of a picture without a geometry of its own is where; else empty.
    axes : str
        Of the frame, a key of `own_ship.registration.AXES`; empty: as its name states.
    """

    stamp_ns: int
    frame_id: str
    range: FloatArray
    azimuth: FloatArray
    intensity: NDArray[Any]
    time_offset: FloatArray | None = None
    sound_speed: float = 0.0
    is_part: bool = False
    assumptions: tuple[str, ...] = ()
    corners: str = ""
    axes: str = ""


Drop = Callable[[str, str], None]


class Part(NamedTuple):
    """A message of a turn, and its first azimuth along the turn, rad."""

    place: float
    ping: ImagePing


class TurnRound(NamedTuple):
    """The messages of a turn, or of a pass over a sector, their azimuths and the step, rad."""

    parts: list[Part]
    low: float
    high: float
    step: float

    @property
    def is_whole(self) -> bool:
        """Whether it is a turn."""
        return self.high - self.low >= TURN - WHOLE_GAP * self.step

    def ends(self, other: TurnRound) -> tuple[float, float]:
        """Where another one begins and ends, at the turn that is nearest to this one."""
        shift = TURN * round(0.5 * (other.low + other.high - self.low - self.high) / TURN)
        return other.low - shift, other.high - shift

    def is_like(self, other: TurnRound, beyond: float) -> bool:
        """Whether another one fills this one, and goes beyond its ends by less than an angle."""
        least, most = -CHANGED * (self.high - self.low), beyond
        low, high = self.ends(other)
        if abs(self.step - other.step) > CHANGED * self.step:
            return False
        if self.is_whole or other.is_whole:
            return self.is_whole and high - low >= (1.0 - CHANGED) * TURN
        return least <= self.low - low <= most and least <= high - self.high <= most

    def grid(self, before: TurnRound | None) -> TurnRound:
        """The grid of this turn, or of this pass and the one before."""
        if self.is_whole or before is None:
            step = TURN / round(TURN / self.step)
            return self._replace(parts=[], low=-math.pi, high=math.pi - step, step=step)
        low, high = self.ends(before)
        return self._replace(parts=[], low=min(low, self.low), high=max(high, self.high))


class TurnRow(NamedTuple):
    """What a message says of a beam.

    Attributes
    ----------
    stamp : float
        s.
    azimuth, width : float
        Of the middle of its arc, along the turn, and width of this, rad.
    range : float
        Median of its detections, m; nan without.
    whole : bool
        Whether it lists all beams.
    """

    stamp: float
    azimuth: float
    width: float
    range: float
    whole: bool


class TurnLearner:
    """Looks for a sweep in messages as they arrive."""

    def __init__(self) -> None:
        self.rows = list[TurnRow]()  # since the beam last turned back or jumped
        self._before: tuple[float, TurnRound] | None = None  # the last pass, and when it began

    def take(
        self, stamp: float, arc: ScanArc | None, ranges: FloatArray
    ) -> tuple[float, int] | None:
        """Look at the next message; return what is learned with it, if it is a sweep's.

        That is the time of a turn or of a pass over the sector, s, and its number of messages.

        Parameters
        ----------
        stamp : float
            s.
        arc : ScanArc or None
            The azimuths that the message looked at; None if unknown.
        ranges : (n,) ndarray
            Of its detections, m.
        """
        rows = self.rows
        if arc is not None and arc.width > WIDEST_PART:
            self.rows, self._before = [], None
        if arc is None or arc.width > WIDEST_PART:
            return None
        last, azimuth = rows[-1][:2] if rows else (-math.inf, math.inf)
        step = turned(arc.middle - azimuth) if rows else math.inf
        if stamp <= last or step == 0.0:
            return None
        goes_on = rows and abs(step) <= WIDEST_PART and step * (azimuth - rows[0][1]) >= 0.0
        place = azimuth + step if goes_on else arc.middle
        middle = float(np.median(ranges)) if len(ranges) else math.nan
        row = TurnRow(stamp, place, arc.width, middle, arc.whole)
        if not goes_on:
            self.rows = [row]
            return self._of_sector(rows) if rows else None
        rows.append(row)
        extent = abs(place - rows[0].azimuth)
        if extent >= TURN and turn_of_rows(rows):
            return (stamp - rows[0].stamp) * TURN / extent, len(rows)
        if extent >= TURN or len(rows) >= MOST_PARTS:
            self.rows = []
        return None

    def _of_sector(self, rows: Sequence[TurnRow]) -> tuple[float, int] | None:
        """What a pass shows that has ended: two over the same sector are a sweep."""
        before, swept = self._before, turn_of_rows(rows)
        self._before = swept and (rows[0].stamp, swept)
        if before is None or swept is None:
            return None
        began, first = before
        alike = first.is_like(swept, CHANGED * (first.high - first.low))
        return (rows[0].stamp - began, len(rows)) if alike else None


class TurnRounds:
    """Follows a beam, and joins the messages of each turn, or pass over a sector, to an image.

    A message that is not where the beam is expected, or is of another geometry, is left out. Where
    `ODD` in a row are elsewhere, the beam is there, and a turn begins with them. Of several
    geometries that is used which is met most: another one once its messages are more by `MAJORITY`
    of a turn.

    Attributes
    ----------
    parts : list of Part
        Of the open turn.
    vain : int
        Beginnings since the last image.
    messages : int
        Of the last turn or pass, those that were left out included.
    unused : int
        Messages of turns and passes that filled too little of the grid.
    """

    def __init__(self, beam: TurnBeam, drop: Drop) -> None:
        self._beam, self.drop, self.parts = beam, drop, list[Part]()
        self._odd, self._first = list[tuple[str, ImagePing]](), 0.0
        self._grid: TurnRound | None = None
        self._narrow: TurnRound | None = None  # the last, where it does not fill the grid
        self._used: ImagePing | None = None  # a message of the geometry that is used
        self._others = self._heard = self.vain = self.messages = self.unused = 0

    @property
    def waiting(self) -> list[ImagePing]:
        """Messages that are in no image yet."""
        narrow = self._narrow.parts if self._narrow else []
        return [part.ping for part in [*narrow, *self.parts]] + [ping for _, ping in self._odd]

    def take(self, ping: ImagePing, *, may_begin: bool = True) -> list[ImagePing]:
        """Take a message; return the images that are complete by it.

        Of messages that are elsewhere, a turn begins with those where `may_begin`.
        """
        stamp, azimuth = 1e-9 * ping.stamp_ns, float(ping.azimuth[0])
        self._heard += 1
        odd, enough = self._beam.fault(stamp, azimuth), len(self._odd) + 1 >= ODD
        azimuth_along, _ = self._beam.place(stamp, azimuth)
        if not odd:
            self._beam.take(stamp, azimuth_along)
        self._used = self._used or ping
        if not is_turn_alike(self._used, ping, 0.0 if odd else self._beam.direction):
            self._others, odd = self._others + 1, "bearing_geometry"
            turn = self.messages or TURN / self._beam.step
            if enough := self._others >= max(ODD, MAJORITY * turn):
                self._used, self._others = ping, 0
        if odd:
            self._odd.append((odd, ping))
            return self._begin() if enough and may_begin else []
        self._others = max(self._others - 1, 0)
        self._leave_out(len(self._odd))
        parts, self._first = self.parts, self._first if self.parts else azimuth_along
        if is_full := abs(azimuth_along - self._first) >= TURN - 0.5 * self._beam.step:
            self._first += math.copysign(TURN, azimuth_along - self._first)
            self.parts = []
        self.parts.append(Part(azimuth_along, ping))
        return self._finish(parts) if is_full else []

    def _begin(self) -> list[ImagePing]:
        """Begin a turn with messages that are elsewhere; return the images of those before."""
        self.vain += 1
        images, before = self._finish(self.parts), self.parts[1:]
        odd, self._odd, self.parts = self._odd, [], []
        self._beam.begin()
        reason, first = odd[0]
        again = [part.ping for part in before[-1:] if reason == "bearing_azimuth"]
        for ping in again:  # the message where a beam turned back is of both passes
            step = turned(float(first.azimuth[0] - ping.azimuth[0]))
            images += self.take(ping) if abs(step) <= STEPS_OFF * self._beam.step else []
        for _, ping in odd:
            images += self.take(ping, may_begin=False)
        self._leave_out(max(len(self._odd) - ODD + 1, 0))  # which are elsewhere again
        return images

    def _leave_out(self, number: int) -> None:
        """Leave out the first odd messages."""
        for reason, left in self._odd[:number]:
            self.drop(reason, f"message left out: {stated_turn(left)}")
        del self._odd[:number]

    def _finish(self, parts: list[Part]) -> list[ImagePing]:
        """The images that a turn or pass completes, on the grid, which two passes alike renew."""
        azimuth, heard, self._heard = turn_azimuths(parts), self._heard, 0
        low, high = float(azimuth.min(initial=math.inf)), float(azimuth.max(initial=-math.inf))
        if len(parts) < MIN_PARTS or high - low < SHORTEST * self._beam.step:
            self.unused += len(parts)
            return []
        least = (high - low) / (4.0 * len(azimuth))  # else a grid of any size
        step = max(float(np.median(np.abs(np.diff(azimuth)))), least)
        joined, before = TurnRound(parts, low, high, step), self._narrow
        used, self._narrow = [joined], None
        if self._grid is None or not self._grid.is_like(joined, self._grid.step):
            if before is not None and before.is_like(joined, CHANGED * (high - low)):
                used = [before, joined]
            if joined.is_whole or before in used:
                self._grid = joined.grid(before)
            else:
                self._narrow, used = joined, []
        self.unused += len(before.parts) if before and before not in used else 0
        self.vain, self.messages = (0, heard) if used else (self.vain, self.messages)
        return [turn_on_grid(used_round, self._grid) for used_round in used if self._grid]


def stated_turn(ping: ImagePing) -> str:
    """Where and when a message looked, in words."""
    return f"{ping.azimuth[0]:.3f} rad, to {ping.range[-1]:.4g} m, at {1e-9 * ping.stamp_ns:.3f} s"


def is_turn_alike(ping: ImagePing, other: ImagePing, direction: float) -> bool:
    """Whether two messages of parts have the same frame, ranges and step between bearings.

    Bearings in the order of time run the other way where the beam does, whose direction at the
    other message is 1, -1, or 0 if unknown.
    """
    steps = [
        float(one.azimuth[-1] - one.azimuth[0]) / (len(one.azimuth) - 1 or math.nan)
        for one in (ping, other)
    ]
    way = -1.0 if steps[0] * steps[1] < 0.0 <= steps[1] * direction else 1.0
    return (
        ping.frame_id == other.frame_id
        and not abs(steps[0] - way * steps[1]) > CHANGED * abs(steps[0])
        and not is_whole_turn(other)
        and np.array_equal(ping.range, other.range)
    )


def is_whole_turn(ping: ImagePing) -> bool:
    """Whether the bearings of a message are nearly a turn."""
    return bool(np.ptp(ping.azimuth) >= WHOLE_VIEW)


def turn_azimuths(parts: Sequence[Part]) -> FloatArray:
    """Azimuths of all bearings along the turn, rad."""
    return np.concatenate(
        [np.zeros(0), *[first + ping.azimuth - ping.azimuth[0] for first, ping in parts]]
    )


def bearing_times(ping: ImagePing, since_ns: int) -> FloatArray:
    """When a message looked at each of its bearings, s after a stamp."""
    return 1e-9 * (ping.stamp_ns - since_ns) + (
        np.zeros(len(ping.azimuth)) if ping.time_offset is None else ping.time_offset
    )


def turn_on_grid(joined: TurnRound, grid: TurnRound) -> ImagePing:
    """One image of the bearings of messages, each at its own time, in the nearest cell."""
    parts, cells = joined.parts, round((grid.high - grid.low) / grid.step) + 1
    first, azimuth = parts[0].ping, turn_azimuths(parts)
    time = np.concatenate([bearing_times(ping, first.stamp_ns) for _, ping in parts])
    cell = (azimuth - joined.low + grid.ends(joined)[0] - grid.low) / grid.step
    shift = float(np.angle(np.exp(2j * math.pi * cell).mean())) / (2.0 * math.pi)
    row = np.rint(cell - shift).astype(np.int64)
    row = row % cells if grid.is_whole else row
    inside = (row >= 0) & (row < cells)
    image, at = np.full((cells, len(first.range)), np.nan, np.float32), np.full(cells, np.nan)
    image[row[inside]] = np.concatenate([ping.intensity for _, ping in parts])[inside]
    at[row[inside]] = time[inside]
    known = np.flatnonzero(np.isfinite(at))
    return replace(
        first,
        azimuth=np.asarray(turned(grid.low) + (np.arange(cells) + shift) * grid.step, float),
        intensity=image,
        time_offset=np.interp(np.arange(cells), known, at[known]),
        is_part=False,
    )


class TurnRepeats:
    """Finds images that are equal to the one before to the bit: these are no new evidence.

    A source without noise, whose images have all been equal so far, goes on. Where images are
    joined of messages, that of the turning point is of two, and no copy.
    """

    def __init__(self, drop: Drop, say: Callable[[str], None]) -> None:
        self._drop, self._say = drop, say
        self.last: ImagePing | None = None

    def new_in(self, ping: ImagePing, *, is_joined: bool = False) -> ImagePing | None:
        """An image without bearings that are copies; None if it is not to be used."""
        before, self.last = self.last, ping
        values, number = ping.intensity, len(ping.azimuth)
        form, bits = (values.shape, values.dtype), f"u{values.itemsize}"
        if before is None or (before.intensity.shape, before.intensity.dtype) != form:
            self._equal, self._varies, self._runs = 0, before is not None, CopiedRuns(number)
            return ping
        equal: BoolArray = np.all(values.view(bits) == before.intensity.view(bits), axis=1)
        shows = equal.any() and np.fmax.reduce(values, axis=1) > np.fmin.reduce(values, axis=1)
        if (
            equal.all()
            and np.any(shows)
            and np.array_equal(before.range, ping.range)
            and np.allclose(before.azimuth, ping.azimuth, rtol=0.0, atol=0.1 * MIN_STEP)
        ):
            self._equal += 1
            if self._varies or self._equal < ODD:
                self._drop(
                    "image_repeated",
                    f"image left out: {stated_turn(ping)} is that before, to the bit",
                )
                return None
            self._say(NO_NOISE)
            return ping
        self._equal, self._varies = 0, True
        is_same = is_joined & np.isclose(
            bearing_times(ping, before.stamp_ns), bearing_times(before, before.stamp_ns), 0.0, 1e-9
        )
        copied = self._runs.copies(
            np.arange(number), equal & shows & ~is_same, np.ones(number, bool)
        )
        if ping.is_part or not copied.any():
            return ping
        self._drop(
            "bearing_repeated",
            f"{copied.sum()} of {number} bearings of the image from {stated_turn(ping)} on equal "
            "those of the image before to the bit",
        )
        return replace(ping, intensity=np.where(copied[:, None], np.float32(np.nan), values))


class ImageTurns:
    """Joins the bearings of a turn, or of a pass over a sector, to one image.

    The step and the rate of the beam are learned: those with which the messages so far make a turn,
    or two passes. Then these are joined too.

    Parameters
    ----------
    drop : callable, optional
        Called with a reason and a sentence for a message that is left out.
    say : callable, optional
        Called with a sentence about what is used.

    Attributes
    ----------
    unused : int
        Messages that are in no image: before the first turn, or of turns that were cut.
    """

    def __init__(
        self, drop: Drop = lambda *_: None, say: Callable[[str], None] = lambda _: None
    ) -> None:
        self._tell, self._why, self._since = drop, "less than a turn has come", 0
        self._messages, self._images = TurnRepeats(self._drop, say), TurnRepeats(self._drop, say)
        self._learning, self._passes = list[ImagePing](), None  # type: list[ImagePing], TurnRounds | None
        self.unused, self._next = 0, MIN_PARTS

    @property
    def _parts(self) -> list[ImagePing]:
        """Messages that are in no image yet."""
        return self._learning + (self._passes.waiting if self._passes else [])

    @property
    def state(self) -> str:
        """Why bearings make no image; empty where they do, and where there are none."""
        if self._passes is None and self._since:
            return f"bearings, but no turn, because {self._why}"
        if self._passes is not None and self._since > TURNS * self._passes.messages:
            return f"no image of the last {self._since} bearings, over {TURNS} turns: {self._why}"
        return ""

    def add(self, ping: ImagePing) -> list[ImagePing]:
        """Take a message; returns the images that are complete by it."""
        before = self._messages.last
        self._since += ping.is_part
        found = self._messages.new_in(ping)
        if found is None:
            return []
        if ping.is_part and before is not None and ping.stamp_ns == before.stamp_ns == 0:
            self._drop("stamp_not_set", f"message left out: {stated_turn(ping)}, as that before")
            return []
        if not ping.is_part or (is_whole_turn(ping) and not self._parts):
            self._since = 0
            return [found]
        images = self._learn(ping) if self._passes is None else self._follow(self._passes, ping)
        self._since = 0 if images else self._since
        return [new for image in images if (new := self._images.new_in(image, is_joined=True))]

    def _drop(self, reason: str, sentence: str) -> None:
        self._why = f"messages are left out as {reason}"
        self._tell(reason, sentence)

    def _follow(self, passes: TurnRounds, ping: ImagePing) -> list[ImagePing]:
        """Take a message of a learned turn; learn anew where the beam is followed in vain."""
        before, images = passes.unused, passes.take(ping)
        self.unused += passes.unused - before
        if passes.vain >= VAIN or is_much_of_turn(passes.parts, ping):
            self._passes, self._next = None, MIN_PARTS
            for waiting in passes.waiting:
                learned = self._passes
                images += self._follow(learned, waiting) if learned else self._learn(waiting)
        return images

    def _learn(self, ping: ImagePing) -> list[ImagePing]:
        """Take a message of an unknown turn; return the images of all so far that it shows."""
        waiting = self._learning
        if waiting and abs(turned(float(ping.azimuth[0] - waiting[-1].azimuth[0]))) < MIN_STEP:
            self._why, self.unused = "the beam stands", self.unused + 1
            return []
        waiting.append(ping)
        if is_much_of_turn(waiting, ping):
            self._leave_half()
        elif len(waiting) < self._next:
            return []
        self._next, dropped = math.ceil(TRY_AGAIN * len(waiting)), list[tuple[str, str]]()
        stamps = 1e-9 * np.array([each.stamp_ns - waiting[0].stamp_ns for each in waiting])
        ends = np.array([each.azimuth[[0, -1]] for each in waiting])
        beam = turn_beam(stamps, ends[:, 0], np.abs(np.diff(ends)))
        if not isinstance(beam, TurnBeam):
            self._why = beam
            return []
        passes = TurnRounds(beam, lambda *why: dropped.append(why))
        images = [image for waiting_ping in waiting for image in passes.take(waiting_ping)]
        elsewhere = sum(reason != "bearing_geometry" for reason, _ in dropped)
        many = (1.0 - EVEN_RATES) * len(waiting)
        self._why = (
            "they differ in their ranges, frame or angle increment"
            if len(dropped) - elsewhere > many
            else "their azimuths do not advance evenly with their stamps to a turn, or two passes"
            if elsewhere + passes.unused > many
            else "less than a turn, or two passes alike, has come"
        )
        if elsewhere > many:
            self._leave_half() if images else None
            return []
        if images:
            self._learning, self._passes, passes.drop = [], passes, self._drop
            self.unused += passes.unused
            for why in dropped:
                self._drop(*why)
        return images

    def _leave_half(self) -> None:
        """Forget the older half of the messages that wait for a turn."""
        half = len(self._learning) // 2
        self.unused += half
        del self._learning[:half]


def is_much_of_turn(waiting: Sequence[Any], ping: ImagePing) -> bool:
    """Whether too much waits, if all is as large as the last message."""
    return (
        len(waiting) > MOST_PARTS
        or len(waiting) * (ping.intensity.nbytes + ping.range.nbytes) > MOST_BYTES
    )


def turn_beam(stamp: FloatArray, azimuth: FloatArray, width: FloatArray) -> TurnBeam | str:
    """The beam that most messages show, or why they show none.

    Parameters
    ----------
    stamp : (n,) ndarray
        s.
    azimuth, width : (n,) ndarray
        Of each message's arc, rad.
    """
    moves = np.abs(wrap(np.diff(azimuth)))
    step = float(np.median(moves))
    if step > WIDEST_PART:
        return (
            f"messages are {math.degrees(step):.3g} degrees apart, and a turn is joined of "
            f"{MIN_PARTS} or more, at most {math.degrees(WIDEST_PART):.0f} degrees apart"
        )
    if not step > MIN_STEP or step < LONGEST_OVERLAP * np.median(width):
        return "the beam stands, or looks at the same sector again"
    # Stamps may come in groups.
    lag = min(max(int(0.5 * math.pi / step), 1), NEWEST, len(stamp) - 1)
    seconds = stamp[lag:] - stamp[:-lag]
    rises, moved = seconds > 0.0, np.abs(wrap(azimuth[lag:] - azimuth[:-lag]))
    if 2 * int(rises.sum()) <= len(rises):
        return "their stamps do not rise"
    rate = float(np.median(moved[rises] / seconds[rises]))
    if not rate > 0.0:
        return "the beam trembles"
    return TurnBeam(
        step, rate, float(np.quantile(np.abs(moves - rate * np.diff(stamp)), EVEN_RATES))
    )


def turn_of_rows(rows: Sequence[TurnRow]) -> TurnRound | None:
    """The turn or pass of messages, if they are those of a beam that turns at a constant rate."""
    stamp, azimuth, width, ranges, whole = np.array(rows).T
    if len(rows) < (MIN_PARTS if whole.all() else MIN_ECHOES):
        return None
    beam, sector = turn_beam(stamp, azimuth, width), float(np.ptp(azimuth))
    if not isinstance(beam, TurnBeam) or sector < SHORTEST * width.max():
        return None
    uneven = np.abs(np.log2(np.abs(np.diff(azimuth) / np.diff(stamp)) / beam.rate)) >= 1.0
    # Messages of detections only must see different objects.
    known = ranges[np.isfinite(ranges)]
    changed = np.abs(np.diff(known)) > RANGE_CHANGE * np.minimum(known[:-1], known[1:])
    varied = whole.all() or changed.sum() >= max(CHANGES * len(changed), 1)
    if not varied or uneven.mean() > 1.0 - EVEN_RATES:
        return None
    return TurnRound([], float(azimuth.min()), float(azimuth.max()), MIN_STEP)
