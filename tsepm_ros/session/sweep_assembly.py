"""Puts the messages of a beam that turns together to scans."""

from __future__ import annotations

import math
import statistics
from bisect import bisect_left
from collections import deque

from tsepm_ros.own_ship.registration import SensorScan
from tsepm_ros.sensing.arcs import turned
from tsepm_ros.sensing.sensor import SensorModel
from tsepm_ros.session.joined_messages import delay, joined, part_of
from tsepm_ros.session.open_scan import TURN, OpenScan, Part, looked_at
from tsepm_ros.session.refusal import Refusal
from tsepm_ros.session.scan_order import MAX_INTERVAL
from tsepm_ros.session.seam import SeamEchoes

GAP, GAP_INTERVALS = 0.5, 3.0
"""Part of a turn's time without a message that ends a scan, since the azimuth is lost; and least
number of the messages' usual intervals."""
FASTEST = 0.1
"""Shortest time of a turn, as a part of that given or learned."""
PATIENCE = 1.5
"""Turns' times that a scan lasts at most; more by this factor after each that was cut."""
MOST_PATIENCE = 20.0
"""Most turns' times that a scan lasts, however slowly the beam turns."""
WHOLE_VIEW = 1.5 * math.pi
"""Width of the arc of all beams from which on a message is a scan by itself, rad."""
STEPS = 64
"""Steps and widths of messages that are remembered."""
MIN_STEP = 1e-4
"""Smallest step of a beam that is told from noise, rad."""
MIN_PARTS = 4
"""Least messages of a turn, or a pass, whose time counts."""
TURNS = 3
"""Turns of which the longest gives the time of a turn: a part of one does not."""
MAX_LATE_TIME = 0.5
"""Part of a turn's time over which late messages that rise are a clock that was set back."""


class SweepAssembly:
    """Puts messages together to scans; pure logic, without clocks.

    A scan ends after a full turn from the azimuth where the first began (the seam), where the beam
    turns back, at a gap in time, after `PATIENCE` turns' times where the beam stands or is slow,
    and before it has too many detections. Messages whose azimuth is unknown advance the beam at the
    rate of the turn.

    Parameters
    ----------
    seconds : float
        Time of a turn, or of a pass over a sector.
    sensor : SensorModel
    target_extent : float
        m.
    max_detections : int
        Of a scan.
    restart_jump : float
        As in `ScanOrder`, s.

    Attributes
    ----------
    parts : int
        Messages of the last scan.
    waited : float
        Time by the stamps from the first message of the last scan to the one that completed it, s.
    cut : int
        Scans in a row that were cut, since the beam stood or was slow.
    """

    def __init__(
        self,
        seconds: float,
        sensor: SensorModel,
        target_extent: float,
        max_detections: int,
        restart_jump: float,
    ) -> None:
        self._durations = deque([seconds], maxlen=TURNS)
        self._shortest = FASTEST * seconds
        self._intervals: deque[float] = deque(maxlen=STEPS)
        self.sensor = sensor
        self.target_extent = target_extent
        self.max_detections = max_detections
        self.restart_jump = restart_jump
        self.parts, self.waited, self.cut = 0, 0.0, 0
        self._steps: deque[float] = deque(maxlen=STEPS)
        self._widths: deque[float] = deque(maxlen=STEPS)
        self._direction = 0.0
        self._number = 0
        self._far_back: SensorScan | None = None
        self._late_since = self._late_stamp = math.nan
        self._forget()

    def _forget(self) -> None:
        """Forget the beam's azimuth and the open scans; the turn's time and direction stay."""
        self._open: OpenScan | None = None
        self._ending: tuple[OpenScan, SeamEchoes] | None = None
        self._stamp = -math.inf  # of the newest message
        self._beam = 0.0  # its azimuth since the seam
        self._known: tuple[float, float, float] | None = None  # stamp, azimuth, beam
        self._unknown = 0  # messages since that show no azimuth

    @property
    def seconds(self) -> float:
        """Time of a turn, or of a pass over a sector, as last seen, s."""
        return max(self._durations)

    @property
    def is_open(self) -> bool:
        """Whether messages wait for their scan to be complete."""
        return self._open is not None or self._ending is not None

    def take(self, message: SensorScan) -> tuple[list[SensorScan], list[Refusal]]:
        """Take the next message; return the scans that are complete, and what is refused."""
        scans: list[SensorScan] = []
        refusals: list[Refusal] = []
        stamp = message.scan.stamp
        held, self._far_back = self._far_back, None
        if held is not None:
            if held.scan.stamp < stamp < min(self._stamp, held.scan.stamp + MAX_INTERVAL):
                scans += self.close() + self._begin(held)
            else:
                refusals.append(refused_far_back(held))
        if self._open is None:
            scans += self._begin(message)
        elif stamp > self._stamp or self._is_next_of_batch(message):
            scans += self._take_next(message)
        elif self._stamp - stamp > self.restart_jump:
            self._far_back = message
        else:
            scans_of, refusal = self._take_late(message)
            scans += scans_of
            refusals += refusal
            return scans, refusals
        self._late_since = math.nan
        return scans, refusals

    def close(self, *, complete: bool = False) -> list[SensorScan]:
        """End the open scan, as a rule incomplete, and return what was not returned yet."""
        scans = self._end_waiting()
        if self._open is not None:
            scans.append(self._whole(self._open, complete=complete))
        self._forget()
        return scans

    def refuse_held(self) -> list[Refusal]:
        """Refuse a message far back that no other has confirmed."""
        held, self._far_back = self._far_back, None
        return [] if held is None else [refused_far_back(held)]

    @property
    def _step(self) -> float:
        """Usual step of the beam, rad."""
        return max(statistics.median(self._steps), MIN_STEP) if self._steps else MIN_STEP

    @property
    def _noise(self) -> float:
        """Largest step back that is not a reversal, rad."""
        return max(0.5 * self._step, 0.5 * max(self._widths, default=0.0))

    def _begin(self, message: SensorScan) -> list[SensorScan]:
        """Begin anew with a message, whose azimuth is the seam; return it if it is a scan."""
        self._forget()
        self._open = OpenScan()
        self._stamp = message.scan.stamp
        if message.beams is not None:
            self._known = self._stamp, message.beams.middle, 0.0
        self._add(message)
        return self.close(complete=True) if _alone(message) else []

    def _add(self, message: SensorScan) -> None:
        assert self._open is not None
        self._number += 1
        self._open.add(Part(message.scan.stamp, self._number, self._beam, message))

    def _is_next_of_batch(self, message: SensorScan) -> bool:
        """Whether a message with the newest stamp is another beam of the same batch."""
        if message.scan.stamp != self._stamp or message.beams is None or self._known is None:
            return False
        return abs(turned(message.beams.middle - self._known[1])) > 0.5 * self._step

    def _take_next(self, message: SensorScan) -> list[SensorScan]:
        """Take a message that is newer than the others."""
        assert self._open is not None
        first = self._open.first
        interval = message.scan.stamp - self._stamp
        self._intervals.append(interval)
        usual = GAP_INTERVALS * statistics.median(self._intervals)
        if interval > max(GAP * self.seconds, usual) or _alone(message) or not _fit(first, message):
            return self.close() + self._begin(message)
        forward = self._forward(message)
        if forward is not None and forward < -self._noise:
            return self._turn_back(message)
        self._advance(message, forward)
        if self._beam >= TURN - 0.5 * self._step:
            return self._next_turn(message)
        duration = delay(first, message)
        limit = min(PATIENCE ** (1 + self.cut), MOST_PATIENCE) * self.seconds
        too_many = self._open.detections + len(message.scan) > self.max_detections
        if duration > limit or too_many:
            self.cut += not too_many
            return self.close() + self._begin(message)
        return self._over_the_seam(message)

    def _forward(self, message: SensorScan) -> float | None:
        """Step of the beam since the last known azimuth, along the turn, rad; None if unknown.

        Of the steps that differ by turns, the one that the time suggests; and of both directions
        while that is unknown.
        """
        arc = message.beams
        if arc is None or self._known is None:
            return None
        stamp, azimuth, _ = self._known
        raw = turned(arc.middle - azimuth)
        expected = TURN / self.seconds * (message.scan.stamp - stamp)
        steps = [raw * sign for sign in ([self._direction] if self._direction else [1.0, -1.0])]
        steps = [step + TURN * round((expected - step) / TURN) for step in steps]
        forward = min(steps, key=lambda step: abs(step - expected))
        if self._direction == 0.0 and forward >= MIN_STEP:
            self._direction = 1.0 if forward == steps[0] else -1.0
        return forward

    def _advance(self, message: SensorScan, forward: float | None) -> None:
        """Move the beam to a message."""
        stamp, arc = message.scan.stamp, message.beams
        if forward is None or self._known is None or arc is None:
            self._beam += TURN / self.seconds * (stamp - self._stamp)
            self._unknown += 1
            if arc is not None:
                self._known = stamp, arc.middle, self._beam
        else:
            _, _, beam = self._known
            self._unknown, unknown = 0, self._unknown
            self._beam = beam + max(forward, 0.0)
            self._known = stamp, arc.middle, beam + forward
            if forward > 0.0:
                self._steps.append(forward / (1 + unknown))
            if not arc.whole:
                self._widths.append(arc.width)
        self._stamp = stamp

    def _turn_back(self, message: SensorScan) -> list[SensorScan]:
        """End the pass over a sector, and begin the next with a message."""
        assert self._open is not None
        self._learn_time(message)
        scans = self._end_waiting()
        scans.append(self._whole(self._open, complete=False, until=message))
        self.cut = 0
        self._direction = 0.0
        return scans + self._begin(message)

    def _learn_time(self, message: SensorScan) -> None:
        """Learn the time of a turn from the open scan, which ends before a message."""
        assert self._open is not None
        if len(self._open.parts) >= MIN_PARTS:  # fewer are a beam that trembles
            self._durations.append(max(delay(self._open.first, message), self._shortest))

    def _next_turn(self, message: SensorScan) -> list[SensorScan]:
        """End the turn, except for what lies across the seam, and begin the next."""
        assert self._open is not None
        scans = self._end_waiting()
        seam = SeamEchoes(self.sensor, self.target_extent, self._step)
        for part in self._open.parts:
            seam.add(part.beam - TURN, part.message)
        if self._known is not None:
            self._learn_time(message)
        self.cut = 0
        self._ending, self._open = (self._open, seam), OpenScan()
        self._beam -= TURN
        if self._known is not None:
            stamp, azimuth, beam = self._known
            self._known = stamp, azimuth, beam - TURN
        return scans + self._over_the_seam(message)

    def _over_the_seam(self, message: SensorScan) -> list[SensorScan]:
        """Add a message to the open scan, and what of it belongs before the seam to that before."""
        if self._ending is None:
            self._add(message)
            return []
        ending, seam = self._ending
        before = seam.take(self._beam, message)
        if before.any():
            self._number += 1
            ending.add(Part(self._stamp, self._number, TURN, part_of(message, before)))
            message = part_of(message, ~before)
        self._add(message)
        return self._end_waiting() if seam.ends(self._beam + self._step) else []

    def _end_waiting(self) -> list[SensorScan]:
        """Return the turn that waited for echoes across the seam."""
        if self._ending is None:
            return []
        (ending, _), self._ending = self._ending, None
        return [self._whole(ending, complete=True)]

    def _whole(
        self, scan: OpenScan, *, complete: bool, until: SensorScan | None = None
    ) -> SensorScan:
        """The messages as one scan, with what it has looked at where that is not a whole turn."""
        self.parts = len(scan.parts)
        self.waited = max(self._stamp if until is None else until.scan.stamp, self._stamp)
        self.waited -= scan.first.scan.stamp
        messages = [part.message for part in scan.parts]
        swept = None if complete else looked_at(messages, self._step)
        return joined(messages, self.sensor, swept)

    def _take_late(self, message: SensorScan) -> tuple[list[SensorScan], list[Refusal]]:
        """Put a late message in its place in the open scan, or refuse it."""
        assert self._open is not None
        stamp, parts = message.scan.stamp, self._open.parts
        stamps = [part.stamp for part in parts]
        if stamp in stamps:
            return [], [Refusal("scan_same_stamp", f"a second message at {stamp:.3f} s")]
        place = bisect_left(stamps, stamp)
        if place > 0 and self._lies_between(message, parts[place - 1], parts[place]):
            self._number += 1
            beam = 0.5 * (parts[place - 1].beam + parts[place].beam)
            self._open.add(Part(stamp, self._number, beam, message))
            return [], []
        if not (stamp > self._late_stamp and math.isfinite(self._late_since)):
            self._late_since = stamp
        self._late_stamp = stamp
        if stamp - self._late_since <= MAX_LATE_TIME * self.seconds:
            return [], [Refusal("scan_late", f"the message at {stamp:.3f} s is late")]
        self._late_since = math.nan  # the clock was set back
        return self.close() + self._begin(message), []

    def _lies_between(self, message: SensorScan, before: Part, after: Part) -> bool:
        """Whether a late message has an azimuth between its neighbours in time."""
        arcs = [each.beams for each in (message, before.message, after.message)]
        if any(arc is None for arc in arcs):
            return len(message.scan) == 0 or message.beams is None
        own, one, two = (arc.middle for arc in arcs if arc is not None)
        margin = 0.5 * self._step + self._noise
        span = abs(turned(two - one))
        return max(abs(turned(own - one)), abs(turned(own - two))) <= span + margin


def refused_far_back(message: SensorScan) -> Refusal:
    """Refuse a message whose stamp is far back."""
    stamp = message.scan.stamp
    reason = "stamp_not_set" if stamp == 0.0 else "scan_far_back"
    return Refusal(reason, f"the message at {stamp:.3f} s is far back")


def _alone(message: SensorScan) -> bool:
    """Whether a message looks at nearly all azimuths."""
    arc = message.beams
    return arc is not None and arc.whole and arc.width >= WHOLE_VIEW


def _fit(first: SensorScan, message: SensorScan) -> bool:
    """Whether a message may be of the scan of another: of the same axes and reference."""
    return (first.frame_id, first.axes, first.north_referenced) == (
        message.frame_id,
        message.axes,
        message.north_referenced,
    )
