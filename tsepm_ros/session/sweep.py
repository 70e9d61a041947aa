"""Sweeps: messages joined to scans.

The messages of a scan that is not complete, and what they have looked at.

Echoes on both sides of the seam, where one turn of a sweep ends and the next begins.

A target that lies across the seam is seen by the last beams of a turn and by the first of the next.
Its echoes follow each other without a pause: they all belong to the turn that ends.

Messages of one sweep as one scan.

Puts the messages of a beam that turns together to scans.

Sweeps in parts: what a session does with messages of a beam or a sector each.
"""

from __future__ import annotations

import dataclasses
import math
import statistics
from bisect import bisect_left, insort
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

import numpy as np

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from tsepm_ros.own_ship.registration import SensorScan
from tsepm_ros.session.drop_reasons import Notice, Refusal, Remark
from tsepm_ros.session.scan_queue import MAX_INTERVAL, Now, waited
from tsepm_ros.session.sweep_learning import SweepLearner
from tsepm_ros.settings.settings import Settings
from tsepm_ros.tracker.clustering import chosen, goes_on
from tsepm_ros.tracker.scan import Scan, turned
from tsepm_ros.tracker.sensor import SensorModel

TURN = 2 * math.pi


class Part(NamedTuple):
    """A message of the open scan, sorted by stamp.

    Attributes
    ----------
    stamp : float
        s.
    number : int
        Number of the message.
    beam : float
        Azimuth since the seam, along the turn, rad.
    message : SensorScan
    """

    stamp: float
    number: int
    beam: float
    message: SensorScan


@dataclass
class OpenScan:
    """The messages of a scan that is not complete."""

    parts: list[Part] = field(default_factory=list)
    detections: int = 0

    def add(self, part: Part) -> None:
        """Add a message in its place."""
        insort(self.parts, part, key=lambda each: each[:2])
        self.detections += len(part.message.scan)

    @property
    def first(self) -> SensorScan:
        """The first message."""
        return self.parts[0].message


def looked_at(messages: Sequence[SensorScan], step: float) -> FloatArray | None:
    """The arc that messages are known to have looked at; None for a whole turn.

    Parameters
    ----------
    messages : sequence of SensorScan
        In order.
    step : float
        Step of the beam, of which half is added at both ends, rad.

    Returns
    -------
    (2,) ndarray or None
        As `swept` in `Scan`.
    """
    arcs = [message.beams for message in messages if message.beams is not None]
    if not arcs:
        return np.zeros(2)
    middle = np.unwrap([arc.middle for arc in arcs])
    half = np.array([0.5 * arc.width for arc in arcs]) + 0.5 * step
    low, high = float((middle - half).min()), float((middle + half).max())
    if high - low >= TURN:
        return None
    return np.array([turned(low), high - low])


LINKED_STEPS = 2.5
"""Steps of the beam within which echoes follow each other."""
WIDEST_BEAM = math.radians(5.0)
"""Azimuth after the seam up to which echoes belong before it, where no resolution is given, rad."""
DEVIATIONS = 3.0
"""Standard deviations of the difference of two ranges up to which they are of one target."""


class SeamEchoes:
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

    def add(self, beam: float, message: SensorScan) -> None:
        """Note the echoes of a message before the seam, at an azimuth after it (below 0), rad."""
        if -beam <= self._reach:
            self._note(beam, message.scan.range)

    def take(self, beam: float, message: SensorScan) -> BoolArray:
        """Which detections (n,) of a message after the seam, at an azimuth (rad), belong before."""
        if beam > self._limit:
            return np.zeros(len(message.scan), bool)
        chain = self._range[np.abs(beam - self._beam) <= self._reach]
        apart = np.abs(message.scan.range[:, None] - chain)
        before = np.asarray((apart <= self._reaches(message.scan.range)[:, None]).any(axis=1))
        self._note(beam, message.scan.range[before])
        return before

    def ends(self, beam: float) -> bool:
        """Whether no echo at an azimuth after the seam, rad, can belong before it any more."""
        return beam > self._limit or not (beam - self._beam <= self._reach).any()

    def _note(self, beam: float, range: FloatArray) -> None:
        self._beam = np.append(self._beam, np.full(len(range), beam))
        self._range = np.append(self._range, range)

    def _reaches(self, range: FloatArray) -> FloatArray:
        """How far apart ranges of one target are at the most, (n,), m."""
        deviation = math.sqrt(2.0) * np.sqrt(self._sensor.range_variance(range))
        resolved = self._sensor.range_resolution + self._extent
        return np.maximum(DEVIATIONS * deviation, resolved)


SAME_RAY = 1e-6
"""Difference of azimuths up to which a detection is on a ray, rad."""


def part_of(message: SensorScan, kept: BoolArray) -> SensorScan:
    """Some detections of a message, by a mask (n,)."""

    def of(values: FloatArray | None) -> FloatArray | None:
        return None if values is None else values[kept]

    return dataclasses.replace(
        message,
        scan=chosen(message.scan, np.flatnonzero(kept)),
        transmit_offset=of(message.transmit_offset),
        height=of(message.height),
    )


def delay(first: SensorScan, message: SensorScan) -> float:
    """Time from the stamp of a message to that of another, s; to the nanosecond, where known."""
    if first.stamp_ns and message.stamp_ns:
        return (message.stamp_ns - first.stamp_ns) / 1e9
    return message.scan.stamp - first.scan.stamp


def joined(
    messages: Sequence[SensorScan], sensor: SensorModel, swept: FloatArray | None
) -> SensorScan:
    """One scan of the detections of messages, each at its own time.

    Parameters
    ----------
    messages : sequence of SensorScan
        At least one, in the order of their stamps, in one frame and of one reference direction.
    sensor : SensorModel
        Errors of the detections of a message that gives none, where another one does.
    swept : (2,) ndarray or None
        As in `Scan`.

    Returns
    -------
    SensorScan
        With the stamp of the first message; a detection's times are those of its message plus the
        time between the two stamps.
    """
    first = messages[0]
    if len(messages) == 1:
        return first if swept is None else _swept(first, swept)
    later = [delay(first, message) for message in messages]
    full = [
        (message, time) for message, time in zip(messages, later, strict=True) if len(message.scan)
    ]
    scans = [message.scan for message, _ in full]

    def all_of(values: Callable[[SensorScan], FloatArray | None]) -> FloatArray:
        parts = [values(message) for message, _ in full]
        return np.concatenate(
            [
                np.zeros(len(scan)) if part is None else part
                for scan, part in zip(scans, parts, strict=True)
            ]
            or [np.zeros(0)]
        )

    def of_scans(values: Callable[[Scan], FloatArray | None]) -> FloatArray:
        return all_of(lambda message: values(message.scan))

    time = np.repeat([time for _, time in full], [len(scan) for scan in scans])
    names = dict.fromkeys(name for scan in scans for name in scan.features)
    own_range = any(scan.range_std is not None for scan in scans)
    own_azimuth = any(scan.azimuth_std is not None for scan in scans)
    scan = Scan.trusted(
        stamp=first.scan.stamp,
        range=of_scans(lambda scan: scan.range),
        azimuth=of_scans(lambda scan: scan.azimuth),
        range_std=of_scans(lambda scan: _range_std(scan, sensor)) if own_range else None,
        azimuth_std=of_scans(lambda scan: _azimuth_std(scan, sensor)) if own_azimuth else None,
        time_offset=time + of_scans(lambda scan: scan.time_offset),
        features={name: of_scans(partial(_feature, name)) for name in names},
        group=_groups(messages, sensor),
        swept=swept,
    )
    heights = any(message.height is not None for message, _ in full)
    return dataclasses.replace(
        first,
        scan=scan,
        transmit_offset=time + all_of(lambda message: message.transmit_offset),
        height=all_of(lambda message: message.height) if heights else None,
        beams=None,
    )


def _swept(message: SensorScan, swept: FloatArray) -> SensorScan:
    return dataclasses.replace(message, scan=dataclasses.replace(message.scan, swept=swept))


def _range_std(scan: Scan, sensor: SensorModel) -> FloatArray:
    own = scan.range_std
    return np.sqrt(sensor.range_variance(scan.range)) if own is None else own


def _azimuth_std(scan: Scan, sensor: SensorModel) -> FloatArray:
    own = scan.azimuth_std
    return np.full(len(scan), sensor.azimuth_std) if own is None else own


def _feature(name: str, scan: Scan) -> FloatArray:
    return scan.features.get(name, np.full(len(scan), np.nan))


def _groups(messages: Sequence[SensorScan], sensor: SensorModel) -> IntArray | None:
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


def _continues(before: SensorScan, after: SensorScan, sensor: SensorModel) -> bool:
    """Whether the last ray of a message and the first of the next see one object."""
    one, two = before.beams, after.beams
    if one is None or two is None or before.scan.group is None or not len(before.scan):
        return False
    # Of the first and last beams of both, the two that are next to each other.
    edges = [
        (end, begin)
        for end in (one.start, one.start + one.width)
        for begin in (two.start, two.start + two.width)
    ]
    end, begin = min(edges, key=lambda pair: abs(turned(pair[1] - pair[0])))
    last, first = float(before.scan.azimuth[-1]), float(after.scan.azimuth[0])
    if max(abs(turned(last - end)), abs(turned(first - begin))) > SAME_RAY:
        return False
    rays = before.scan.range[-1:], after.scan.range[:1]
    return bool(goes_on(*rays, turned(first - last), sensor)[0])


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


MIN_SILENCE = 1.0
"""Shortest time without a message after which an open scan is ended, s."""
MAX_CUT = 4
"""Scans in a row, cut since the beam stands, after which a learned sweep is none any more."""


class Taken(NamedTuple):
    """What a message leads to.

    Attributes
    ----------
    scans : list of SensorScan
        That are complete.
    remarks : list of Refusal or Notice
    changed : bool
        Whether scans are made in another way from this message on: those before it are none.
    """

    scans: list[SensorScan]
    remarks: list[Remark]
    changed: bool = False


class Sweep:
    """Makes scans of messages, by the option `sweep`.

    Parameters
    ----------
    settings : Settings
    """

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self.reset()

    def reset(self) -> None:
        """Forget the messages that wait, and what was learned."""
        self._learner = SweepLearner()
        self._assembly: SweepAssembly | None = None
        self._heard: Now = math.nan
        given = self._settings.session.sweep_seconds
        if given:
            self._assembly = self._make(given)

    def configure(self, settings: Settings) -> None:
        """Change the sensor and the limits; the option `sweep` does not change."""
        self._settings = settings
        if self._assembly is not None:
            self._assembly.sensor = settings.sensor
            self._assembly.target_extent = settings.common.target_extent
            self._assembly.max_detections = settings.common.max_detections
            self._assembly.restart_jump = settings.session.restart_jump

    @property
    def active(self) -> bool:
        """Whether messages are put together."""
        return self._assembly is not None

    @property
    def is_open(self) -> bool:
        """Whether messages wait for the end of their sweep."""
        return self._assembly is not None and self._assembly.is_open

    @property
    def state(self) -> str:
        """How scans are made of messages, in words."""
        if self._assembly is None:
            return "a message is a scan"
        if not self._assembly.parts:
            return f"sweeps of {self._assembly.seconds:.3g} s, none complete yet"
        return f"sweeps of {self._assembly.seconds:.3g} s in {self._assembly.parts} messages"

    @property
    def latency(self) -> float:
        """Time from the first message of the last scan to its completion, by the stamps, s."""
        return 0.0 if self._assembly is None else self._assembly.waited

    def take(self, message: SensorScan, now: Now) -> Taken:
        """Take a message that arrived at `now`, s."""
        if self._assembly is not None:
            self._heard = now
            scans, refusals = self._assembly.take(message)
            if self._settings.session.sweep == "auto" and self._assembly.cut >= MAX_CUT:
                scans += self._assembly.close()
                self.reset()
                said = "the beam no longer turns: each message is a scan again"
                return Taken(scans, [*refusals, Notice("sweep", said)])
            return Taken(scans, list(refusals))
        if self._settings.session.sweep == "auto":
            turning = self._learner.take(message)
            if turning is not None:
                self._assembly = self._make(turning.seconds)
                self._heard = now
                self._assembly.take(message)
                said = (
                    f"messages are parts of a sweep of {turning.seconds:.3g} s (about "
                    f"{turning.parts} messages): they are joined to scans, and earlier tracks are "
                    "discarded"
                )
                return Taken([], [Notice("sweep", said)], changed=True)
        return Taken([message], [])

    def overdue(self, now: Now) -> list[SensorScan]:
        """End the open scan if no message has arrived for the time of a turn."""
        assembly = self._assembly
        if assembly is None or not self.is_open:
            return []
        silence = waited(self._heard, now)
        if not max(assembly.seconds, MIN_SILENCE) < silence < math.inf:
            return []
        return assembly.close()

    def close(self) -> Taken:
        """End the open scan: no message follows."""
        if self._assembly is None:
            return Taken([], [])
        refusals = self._assembly.refuse_held()
        return Taken(self._assembly.close(), list(refusals))

    def _make(self, seconds: float) -> SweepAssembly:
        settings = self._settings
        return SweepAssembly(
            seconds,
            settings.sensor,
            settings.common.target_extent,
            settings.common.max_detections,
            settings.session.restart_jump,
        )
