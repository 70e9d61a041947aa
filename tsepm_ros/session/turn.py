"""The turn of a beam, by the stamps and the azimuths of messages alone.

`Turn` follows a beam whose turn takes a known time, and says where a turn closes. `TurnLearner`
learns from messages whether they are those of a beam that turns.

A message of a sensor that turns its beam looks at a small arc, and the arcs move at a constant rate
through a whole turn, or to and fro. Messages of a sonar that looks everywhere at once do not: their
arcs are wide, stay, or jump. Where a message lists only its detections, a single object seen from a
turning vessel moves like a beam: the ranges of that do not change from message to message.
"""

from __future__ import annotations

import enum
import math
import statistics
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

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

    def lies_between(self, arc: Arc, before: Arc, after: Arc) -> bool:
        """Whether a late message has an azimuth between its neighbours in time."""
        margin = 0.5 * self.step + self._noise
        span = abs(turned(after.middle - before.middle))
        apart = [abs(turned(arc.middle - other.middle)) for other in (before, after)]
        return max(apart) <= span + margin

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


class Turning(NamedTuple):
    """What was learned of a sweep: time of a turn or of a pass over the sector (s)."""

    seconds: float
    parts: int


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

    def take(self, stamp: float, arc: Arc | None, ranges: FloatArray) -> Turning | None:
        """Look at the next message; return what is learned with it, if it is a sweep's.

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
            if rows:
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

    def _of_turn(self) -> Turning | None:
        """What a pass shows that has gone once round; one that is no sweep begins anew."""
        rows, extent = self._pass.rows, abs(self._pass.extent)
        if extent < TURN and len(rows) < MOST_PARTS:
            return None
        if extent >= TURN and self._pass.is_sweep():
            return Turning((rows[-1][0] - rows[0][0]) * TURN / extent, len(rows))
        self._pass = Pass()
        return None

    def _of_sector(self, ended: Pass) -> Turning | None:
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
        return Turning(two.rows[0][0] - one.rows[0][0], len(ended.rows))
