"""The turn of a beam, by the stamps and the azimuths of messages alone, and images joined by it.

`Turn` follows a beam whose turn takes a known time, and says where a turn closes. `TurnLearner`
learns from messages whether they are those of a beam that turns.

A message of a sensor that turns its beam looks at a small arc, and the arcs move at a constant rate
through a whole turn, or to and fro. Messages of a sonar that looks everywhere at once do not: their
arcs are wide, stay, or jump. Where a message lists only its detections, a single object seen from a
turning vessel moves like a beam: the ranges of that do not change from message to message.

Sonar images as they arrive: whole pings, or bearings that are joined to a turn or a pass.

A turn's bearings are put on a grid of even azimuths, since their number differs from turn to turn:
each in the nearest cell, and NaN where there is none. The grid is shifted by the part of a step by
which a turn's bearings lie beside it.
"""

from __future__ import annotations

import enum
import math
import statistics
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.tracker.scan import Arc, turned

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


class Closing(enum.Enum):
    """How a turn closes before a message."""

    PAUSE = "the azimuth is lost, or the message sees all round"
    BACK = "the beam turns back: a pass over a sector is complete"
    FULL = "the beam is at the seam again, where the turn began"
    CUT = "the beam stands, or is slow"


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
        self._intervals: deque[float] = deque(maxlen=STEPS)
        self._steps: deque[float] = deque(maxlen=STEPS)
        self._widths: deque[float] = deque(maxlen=STEPS)
        self._direction = 0.0
        self.cut = 0
        self.forget()

    def forget(self) -> None:
        """Forget where the beam is; the turn's time and direction stay."""
        self.stamp, self.azimuth = -math.inf, 0.0
        self._begin, self._messages = math.nan, 0
        self._known: tuple[float, float, float] | None = None  # stamp, azimuth as seen, and here
        self._unknown = 0  # messages since that show no azimuth

    @property
    def seconds(self) -> float:
        """Time of a turn, or of a pass over a sector, as last seen, s."""
        return max(self._durations)

    @property
    def step(self) -> float:
        """Usual step of the beam, rad."""
        return max(statistics.median(self._steps), MIN_STEP) if self._steps else MIN_STEP

    @property
    def _noise(self) -> float:
        """Largest step back that is not a reversal, rad."""
        return max(0.5 * self.step, 0.5 * max(self._widths, default=0.0))

    def begin(self, stamp: float, arc: Arc | None) -> None:
        """Begin a turn anew with a message, whose azimuth is the seam."""
        self.forget()
        self.stamp, self._begin, self._messages = stamp, stamp, 1
        if arc is not None:
            self._known = stamp, arc.middle, 0.0

    def take(self, stamp: float, arc: Arc | None) -> Closing | None:
        """Move the beam to the next message; return how the turn before it closes, if it does.

        After `Closing.FULL` the message is of the next turn, otherwise `begin` follows.

        Parameters
        ----------
        stamp : float
            Not before the newest, s.
        arc : Arc or None
            The azimuths that the message looked at; None if unknown.
        """
        interval = stamp - self.stamp
        self._intervals.append(interval)
        usual = GAP_INTERVALS * statistics.median(self._intervals)
        if interval > max(GAP * self.seconds, usual) or sees_all(arc):
            return Closing.PAUSE
        forward = self._forward(stamp, arc)
        if forward is not None and forward < -self._noise:
            self._complete(stamp)
            self.stamp, self._direction = stamp, 0.0
            return Closing.BACK
        self._advance(stamp, arc, forward)
        if self.azimuth >= TURN - 0.5 * self.step:
            self._pass_seam(stamp)
            return Closing.FULL
        self._messages += 1
        if stamp - self._begin > min(PATIENCE ** (1 + self.cut), MOST_PATIENCE) * self.seconds:
            self.cut += 1
            return Closing.CUT
        return None

    def is_beside(self, arc: Arc | None) -> bool:
        """Whether a message with the newest stamp is another beam of the same batch."""
        if arc is None or self._known is None:
            return False
        return abs(turned(arc.middle - self._known[1])) > 0.5 * self.step

    def _forward(self, stamp: float, arc: Arc | None) -> float | None:
        """Step of the beam since the last known azimuth, along the turn, rad; None if unknown.

        Of the steps that differ by turns, the one that the time suggests; and of both directions
        while that is unknown.
        """
        if arc is None or self._known is None:
            return None
        known, azimuth, _ = self._known
        raw = turned(arc.middle - azimuth)
        expected = TURN / self.seconds * (stamp - known)
        steps = [raw * sign for sign in ([self._direction] if self._direction else [1.0, -1.0])]
        steps = [step + TURN * round((expected - step) / TURN) for step in steps]
        forward = min(steps, key=lambda step: abs(step - expected))
        if self._direction == 0.0 and forward >= MIN_STEP:
            self._direction = 1.0 if forward == steps[0] else -1.0
        return forward

    def _advance(self, stamp: float, arc: Arc | None, forward: float | None) -> None:
        """Move the beam to a message."""
        if forward is None or self._known is None or arc is None:
            self.azimuth += TURN / self.seconds * (stamp - self.stamp)
            self._unknown += 1
            if arc is not None:
                self._known = stamp, arc.middle, self.azimuth
        else:
            _, _, before = self._known
            self._unknown, unknown = 0, self._unknown
            self.azimuth = before + max(forward, 0.0)
            self._known = stamp, arc.middle, before + forward
            if forward > 0.0:
                self._steps.append(forward / (1 + unknown))
            if not arc.whole:
                self._widths.append(arc.width)
        self.stamp = stamp

    def _complete(self, stamp: float) -> None:
        """Learn the time of the turn, which ends at a stamp, s."""
        if self._messages >= MIN_PARTS:  # fewer are a beam that trembles
            self._durations.append(max(stamp - self._begin, self._shortest))
        self.cut = 0

    def _pass_seam(self, stamp: float) -> None:
        """Go on with the next turn."""
        self.azimuth -= TURN
        if self._known is not None:
            self._complete(stamp)
            known, azimuth, here = self._known
            self._known = known, azimuth, here - TURN
        self.cut = 0
        self._begin, self._messages = stamp, 1


def sees_all(arc: Arc | None) -> bool:
    """Whether a message looks at nearly all azimuths."""
    return arc is not None and arc.whole and arc.width >= WHOLE_VIEW


def looked_at(arcs: Sequence[Arc | None], step: float) -> FloatArray | None:
    """The arc that messages are known to have looked at; None for a whole turn.

    Parameters
    ----------
    arcs : sequence of Arc or None
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


WIDEST_PART = 0.5 * math.pi
"""Widest arc of a message of a sweep, and longest step between two, rad."""
MIN_ECHOES = 16
"""Least messages of a turn or sector that show a sweep, where they list detections only."""
MOST_PARTS = 20_000
"""Most messages of a turn."""
EVEN_RATES = 0.8
"""Least share of steps whose rate differs from the median by less than a factor of 2."""
LONGEST_OVERLAP = 0.5
"""Largest part of a message's arc that the next one may look at again."""
RANGE_CHANGE, CHANGES = 0.1, 0.25
"""Least change of the range, as a part of it, and least share of changes, of detections only."""
SECTOR_TOLERANCE = 0.2
"""Largest difference of two passes over a sector, as a part of it."""


@dataclass
class Pass:
    """Messages whose azimuths move in one direction.

    Attributes
    ----------
    rows : list of tuple of float
        Stamp (s), unwrapped middle and width of the arc (rad), and median range (m; nan without
        detections) of each message.
    whole : bool
        Whether the messages list all beams.
    """

    rows: list[tuple[float, float, float, float]] = field(default_factory=list)
    whole: bool = True

    def add(self, stamp: float, arc: Arc, azimuth: float, ranges: FloatArray) -> None:
        """Add a message at an unwrapped azimuth, rad."""
        middle = float(np.median(ranges)) if len(ranges) else math.nan
        self.rows.append((stamp, azimuth, arc.width, middle))
        self.whole = self.whole and arc.whole

    @property
    def extent(self) -> float:
        """Azimuth passed, rad, positive counter-clockwise."""
        return self.rows[-1][1] - self.rows[0][1]

    def is_sweep(self) -> bool:
        """Whether the messages are those of a beam that turns at a constant rate."""
        if len(self.rows) < (MIN_PARTS if self.whole else MIN_ECHOES):
            return False
        times, azimuths, widths, ranges = np.array(self.rows).T
        steps = np.abs(np.diff(azimuths))
        rates = steps / np.diff(times)
        middle = float(np.median(rates))
        even = (rates < 2.0 * middle) & (rates > 0.5 * middle)
        apart = np.median(steps) >= LONGEST_OVERLAP * np.median(widths)
        # Messages of detections only must see different objects.
        known = ranges[np.isfinite(ranges)]
        changed = np.abs(np.diff(known)) > RANGE_CHANGE * np.minimum(known[:-1], known[1:])
        varied = self.whole or (changed.size > 0 and changed.mean() >= CHANGES)
        return bool(middle > 0.0 and even.mean() >= EVEN_RATES and apart and varied)


class TurnLearner:
    """Looks for a sweep in messages as they arrive."""

    def __init__(self) -> None:
        self._pass = Pass()
        self._before: deque[Pass] = deque(maxlen=2)

    def take(self, stamp: float, arc: Arc | None, ranges: FloatArray) -> tuple[float, int] | None:
        """Look at the next message; return what is learned with it, if it is a sweep's.

        That is the time of a turn or of a pass over the sector, s, and its number of messages.

        Parameters
        ----------
        stamp : float
            s.
        arc : Arc or None
            The azimuths that the message looked at; None if unknown.
        ranges : (n,) ndarray
            Of its detections, m.
        """
        rows = self._pass.rows
        if arc is None:
            return None
        if arc.width > WIDEST_PART:
            self._pass = Pass()
            self._before.clear()
            return None
        if not rows:
            self._pass.add(stamp, arc, arc.middle, ranges)
            return None
        last, azimuth, *_ = rows[-1]
        step = turned(arc.middle - azimuth)
        if stamp <= last or step == 0.0:
            return None
        turns_back = len(rows) > 1 and step * self._pass.extent < 0.0
        if abs(step) > WIDEST_PART or turns_back:
            ended, self._pass = self._pass, Pass()
            self._pass.add(stamp, arc, arc.middle, ranges)
            return self._of_sector(ended)
        self._pass.add(stamp, arc, azimuth + step, ranges)
        return self._of_turn()

    def _of_turn(self) -> tuple[float, int] | None:
        """What a pass shows that has gone once round; one that is no sweep begins anew."""
        rows, extent = self._pass.rows, abs(self._pass.extent)
        if extent < TURN and len(rows) < MOST_PARTS:
            return None
        if extent >= TURN and self._pass.is_sweep():
            return (rows[-1][0] - rows[0][0]) * TURN / extent, len(rows)
        self._pass = Pass()
        return None

    def _of_sector(self, ended: Pass) -> tuple[float, int] | None:
        """What passes show of which the last has ended: two over the same sector are a sweep."""
        self._before.append(ended)
        if len(self._before) < 2:
            return None
        one, two = self._before
        if not (one.is_sweep() and two.is_sweep()):
            return None
        sector = abs(one.extent)
        limit = SECTOR_TOLERANCE * sector
        widest = max(width for _, _, width, _ in one.rows + two.rows)
        middles = [0.5 * (each.rows[0][1] + each.rows[-1][1]) for each in (one, two)]
        alike = abs(sector - abs(two.extent)) <= limit and sector >= 3.0 * widest
        if not (alike and abs(turned(middles[0] - middles[1])) <= limit):
            return None
        return two.rows[0][0] - one.rows[0][0], len(ended.rows)


CHANGED = 0.2
"""Relative change of the step, or of a sector's width, from which on the grid is another."""
WHOLE_GAP = 2.5
"""Steps, at most, that a whole turn lacks."""


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
        rad, from the sensor's x axis to port.
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


class ImageTurns:
    """Joins the bearings of a turn, or of a pass over a sector, to one ping.

    The time of a turn is learned from the first: its bearings are not used.

    Attributes
    ----------
    unused : int
        Messages whose bearings are in no ping: of the first turn, or before a change of ranges.
    """

    def __init__(self) -> None:
        self.unused, self._parts = 0, list[ImagePing]()
        self._start_over()

    def add(self, ping: ImagePing) -> list[ImagePing]:
        """Take a message; returns the pings that are complete by it."""
        low, high = float(ping.azimuth.min()), float(ping.azimuth.max())
        if not ping.is_part or high - low >= WHOLE_VIEW:
            return [ping]
        arc, stamp = Arc(low, high - low, True), 1e-9 * ping.stamp_ns
        before = self._parts[-1] if self._parts else ping
        same = before.frame_id == ping.frame_id and np.array_equal(before.range, ping.range)
        back = self._turn is not None and stamp < self._turn.stamp
        if not same or back or len(self._parts) >= MOST_PARTS:
            self._start_over()
        if self._turn is None:
            self._learn(ping, stamp, arc)
            return []
        closing = self._turn.take(stamp, arc)
        if closing is None:
            self._parts.append(ping)
            return []
        if closing is not Closing.FULL:
            self._turn.begin(stamp, arc)
        parts, self._parts = self._parts, [ping]
        if closing is Closing.BACK:  # the bearing where it turned is of both passes
            self._parts.insert(0, parts[-1])
        if len(parts) < 2:
            self.unused += 1
            return []
        return [self._joined(parts)]

    def _start_over(self) -> None:
        """Forget the bearings so far: the ranges, or the run, are others."""
        self.unused += len(self._parts)
        self._parts = []
        self._grid: tuple[float, float, int] | None = None  # begin and step, rad, and cells
        self._learner, self._turn = TurnLearner(), None  # type: tuple[TurnLearner, Turn | None]

    def _learn(self, ping: ImagePing, stamp: float, arc: Arc) -> None:
        self.unused += len(self._parts)
        self._parts = [ping]
        learned = self._learner.take(stamp, arc, np.zeros(0))
        if learned is not None:
            self._turn = Turn(learned[0])
            self._turn.begin(stamp, arc)

    def _joined(self, parts: Sequence[ImagePing]) -> ImagePing:
        """One ping of the bearings of parts, each at its own time."""
        first = parts[0]
        azimuth = np.unwrap(np.concatenate([one.azimuth for one in parts]))
        time = np.concatenate(
            [
                1e-9 * (one.stamp_ns - first.stamp_ns)
                + (0.0 if one.time_offset is None else one.time_offset) * np.ones(len(one.azimuth))
                for one in parts
            ]
        )
        begin, step, cells = self._grid_of(azimuth)
        place = (azimuth - begin) / step
        shift = float(np.angle(np.exp(2j * math.pi * place).mean())) / (2.0 * math.pi)
        whole = cells * step >= TURN - 1e-9
        row = np.rint(place - shift).astype(np.int64)
        row = row % cells if whole else np.clip(row, 0, cells - 1)
        image = np.full((cells, len(first.range)), np.nan, np.float32)
        image[row] = np.concatenate([one.intensity for one in parts])
        at = np.full(cells, np.nan)
        at[row] = time
        known = np.flatnonzero(np.isfinite(at))
        return replace(
            first,
            azimuth=np.asarray(begin + (np.arange(cells) + shift) * step, float),
            intensity=image,
            time_offset=np.interp(np.arange(cells), known, at[known]),
            is_part=False,
        )

    def _grid_of(self, azimuth: FloatArray) -> tuple[float, float, int]:
        """Begin, step (rad) and cells of the grid: those before, where they fit."""
        low, high = float(azimuth.min()), float(azimuth.max())
        least = (high - low) / (4.0 * len(azimuth))  # else a grid of any size
        step = max(float(np.median(np.abs(np.diff(azimuth)))), least) or 1e-3
        whole = high - low >= TURN - WHOLE_GAP * step
        if self._grid is not None:
            begin, before, cells = self._grid
            end, margin = begin + (cells - 1) * before, 0.5 * before
            within = whole or (low >= begin - margin and high <= end + margin)
            wide = whole or high - low >= (1.0 - CHANGED) * (end - begin)
            if abs(step - before) <= CHANGED * before and within and wide:
                return self._grid
        cells = round(TURN / step) if whole else round((high - low) / step) + 1
        self._grid = (
            (-math.pi, TURN / cells, cells) if whole else (turned(low), step, max(cells, 2))
        )
        return self._grid
