"""Sweeps in parts: messages of a beam or a sector each are joined to scans.

Where a turn begins and ends is said by `turn.Turn`. Here are the messages that wait for its end,
those that arrive late, and what is joined: the rows of all messages, each at its own time.

A target that lies across the seam, where one turn ends and the next begins, is seen by the last
beams of a turn and by the first of the next. Its echoes follow each other without a pause: they all
belong to the turn that ends.
"""

from __future__ import annotations

import dataclasses
import math
from bisect import bisect_left, insort
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from tsepm_ros.own_ship.registration import SensorScan, selected
from tsepm_ros.session.drop_reasons import Notice, Rejection, Remark
from tsepm_ros.session.scan_queue import MAX_INTERVAL, Now, waited
from tsepm_ros.session.turn import TURN, Closing, Turn, TurnLearner, looked_at, sees_all
from tsepm_ros.settings.settings import Settings
from tsepm_ros.tracker.clusters.grouping import goes_on
from tsepm_ros.tracker.scan import Scan, turned
from tsepm_ros.tracker.sensor import SensorModel

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
        deviation = math.sqrt(2.0) * np.sqrt(self._sensor.range_variance(range))
        reach = np.maximum(DEVIATIONS * deviation, self._sensor.range_resolution + self._extent)
        before = np.asarray((np.abs(range[:, None] - chain) <= reach[:, None]).any(axis=1))
        self.add(beam, range[before])
        return before

    def ends(self, beam: float) -> bool:
        """Whether no echo at an azimuth after the seam, rad, can belong before it any more."""
        return beam > self._limit or not (beam - self._beam <= self._reach).any()


SAME_RAY = 1e-6
"""Difference of azimuths up to which a detection is on a ray, rad."""


def delay(first: SensorScan, message: SensorScan) -> float:
    """Time from the stamp of a message to that of another, s; to the nanosecond, where known."""
    if first.stamp_ns and message.stamp_ns:
        return (message.stamp_ns - first.stamp_ns) / 1e9
    return message.scan.stamp - first.scan.stamp


def stacked(
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
        scan = first.scan if swept is None else dataclasses.replace(first.scan, swept=swept)
        return first if swept is None else dataclasses.replace(first, scan=scan)
    full = [message for message in messages if len(message.scan)] or [first]

    def missing(name: str, index: int) -> FloatArray:
        scan = full[index].scan
        if name == "range_std":
            return np.sqrt(sensor.range_variance(scan.range))
        value = {"azimuth_std": sensor.azimuth_std, "height": 0.0}.get(name, math.nan)
        return np.full(len(scan), value)

    rows = stacked([_rows(message, delay(first, message)) for message in full], missing)
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


_OF_SCANS = ("range", "azimuth", "range_std", "azimuth_std", "time_offset")


def _rows(message: SensorScan, later: float) -> dict[str, FloatArray]:
    """The columns of a message's detections, by name, at times later by some seconds."""
    scan, zero = message.scan, np.zeros(len(message.scan))
    transmit_offset = zero if message.transmit_offset is None else message.transmit_offset
    columns = {
        "range": scan.range,
        "azimuth": scan.azimuth,
        "range_std": scan.range_std,
        "azimuth_std": scan.azimuth_std,
        "time_offset": later + (zero if scan.time_offset is None else scan.time_offset),
        "transmit_offset": later + transmit_offset,
        "height": message.height,
        **scan.features,
    }
    return {name: values for name, values in columns.items() if values is not None}


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


MAX_LATE_TIME = 0.5
"""Part of a turn's time over which late messages that rise are a clock that was set back."""
MIN_SILENCE = 1.0
"""Shortest time without a message after which an open scan is ended, s."""
MAX_CUT = 4
"""Scans in a row, cut since the beam stands, after which a learned sweep is none any more."""


class Part(NamedTuple):
    """A message of a scan that is not complete: its azimuth since the seam, rad, and its number."""

    number: int
    beam: float
    message: SensorScan

    @property
    def order(self) -> tuple[float, int]:
        """Place among the messages: by stamp, then as they arrived."""
        return self.message.scan.stamp, self.number


@dataclass
class OpenScan:
    """The messages of a scan that is not complete, sorted by stamp."""

    parts: list[Part] = field(default_factory=list)
    detections: int = 0

    def add(self, part: Part) -> None:
        """Add a message in its place."""
        insort(self.parts, part, key=lambda each: each.order)
        self.detections += len(part.message.scan)


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
    latency : float
        Time from the first message of the last scan to its completion, by the stamps, s.
    """

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.reset()

    def reset(self) -> None:
        """Forget the messages that wait, and what was learned."""
        given = self.settings.session.sweep_seconds
        self.active = given > 0.0
        self.latency = 0.0
        self._turn, self._learner = Turn(given), TurnLearner()
        self._parts = self._number = 0
        self._heard: Now = math.nan
        self._far_back: SensorScan | None = None
        self._late_since = self._late_stamp = math.nan
        self._open: OpenScan | None = None
        self._ending: tuple[OpenScan, SeamEchoes] | None = None

    @property
    def is_open(self) -> bool:
        """Whether messages wait for the end of their sweep."""
        return self._open is not None or self._ending is not None

    @property
    def state(self) -> str:
        """How scans are made of messages, in words."""
        if not self.active:
            return "a message is a scan"
        known = f" in {self._parts} messages" if self._parts else ", none complete yet"
        return f"sweeps of {self._turn.seconds:.3g} s{known}"

    def take(self, message: SensorScan, now: Now) -> Taken:
        """Take a message that arrived at `now`, s."""
        learns = self.settings.session.sweep == "auto"
        if self.active:
            self._heard = now
            taken = self._join(message)
            if not learns or self._turn.cut < MAX_CUT:
                return taken
            taken.scans.extend(self._end())
            self.reset()
            said = "the beam no longer turns: each message is a scan again"
            return Taken(taken.scans, [*taken.remarks, Notice("sweep", said)])
        scan = message.scan
        turning = self._learner.take(scan.stamp, message.beams, scan.range) if learns else None
        if turning is None:
            return Taken([message], [])
        self.active, self._heard, self._turn = True, now, Turn(turning.seconds)
        self._join(message)
        said = (
            f"messages are parts of a sweep of {turning.seconds:.3g} s (about {turning.parts} "
            "messages): they are joined to scans, and earlier tracks are discarded"
        )
        return Taken([], [Notice("sweep", said)], changed=True)

    def overdue(self, now: Now) -> Taken:
        """End the open scan if no message has arrived for the time of a turn."""
        silence = waited(self._heard, now)
        late = self.is_open and max(self._turn.seconds, MIN_SILENCE) < silence < math.inf
        return Taken(self._end() if late else [], [])

    def close(self) -> Taken:
        """End the open scan: no message follows."""
        refusals = self._refuse_far_back()
        return Taken(self._end(), [*refusals])

    def _join(self, message: SensorScan) -> Taken:
        """Put the next message to the others; return the scans that are complete."""
        stamp, newest, held = message.scan.stamp, self._turn.stamp, self._far_back
        scans: list[SensorScan] = []
        if held and held.scan.stamp < stamp < min(newest, held.scan.stamp + MAX_INTERVAL):
            self._far_back = None
            scans = self._end() + self._begin(held)
        refusals: list[Remark] = [*self._refuse_far_back()]
        newest = self._turn.stamp
        if self._open is None:
            scans += self._begin(message)
        elif stamp > newest or (stamp == newest and self._turn.is_beside(message.beams)):
            scans += self._take_next(self._open, message)
        elif newest - stamp > self.settings.session.restart_jump:
            self._far_back = message
        else:
            taken = self._take_late(self._open, message)
            return Taken(scans + taken.scans, refusals + taken.remarks)
        self._late_since = math.nan
        return Taken(scans, refusals)

    def _refuse_far_back(self) -> list[Rejection]:
        """Refuse a message whose stamp is far back, and that no other has confirmed."""
        held, self._far_back = self._far_back, None
        if held is None:
            return []
        stamp = held.scan.stamp
        reason = "stamp_not_set" if stamp == 0.0 else "scan_far_back"
        return [Rejection(reason, f"the message at {stamp:.3f} s is far back")]

    def _begin(self, message: SensorScan) -> list[SensorScan]:
        """Begin anew with a message; return it if it is a scan by itself."""
        self._turn.begin(message.scan.stamp, message.beams)
        self._open = OpenScan()
        self._add(self._open, message, 0.0)
        return self._end(complete=True) if sees_all(message.beams) else []

    def _add(self, scan: OpenScan, message: SensorScan, beam: float) -> None:
        self._number += 1
        scan.add(Part(self._number, beam, message))

    def _take_next(self, scan: OpenScan, message: SensorScan) -> list[SensorScan]:
        """Take a message that is newer than the others of the open scan."""
        closing: Closing | None = Closing.PAUSE
        if _fit(scan.parts[0].message, message):
            closing = self._turn.take(message.scan.stamp, message.beams)
        scans: list[SensorScan] = []
        if closing is Closing.FULL:
            scans = self._end_waiting()
            common = self.settings.common
            seam = SeamEchoes(self.settings.sensor, common.target_extent, self._turn.step)
            for part in scan.parts:
                seam.add(part.beam - TURN, part.message.scan.range)
            self._ending, self._open, closing = (scan, seam), OpenScan(), None
        too_many = scan.detections + len(message.scan) > self.settings.common.max_detections
        if closing is not None or (self._open is scan and too_many):
            return self._end() + self._begin(message)
        return scans + self._over_the_seam(message)

    def _over_the_seam(self, message: SensorScan) -> list[SensorScan]:
        """Add a message to the open scan, and what of it belongs before the seam to that before."""
        assert self._open is not None
        beam = self._turn.azimuth
        if self._ending is None:
            self._add(self._open, message, beam)
            return []
        ending, seam = self._ending
        before = seam.take(beam, message.scan.range)
        if before.any():
            self._add(ending, selected(message, before), TURN)
            message = selected(message, ~before)
        self._add(self._open, message, beam)
        return self._end_waiting() if seam.ends(beam + self._turn.step) else []

    def _end(self, *, complete: bool = False) -> list[SensorScan]:
        """End the open scan, as a rule incomplete, and return what was not returned yet."""
        scans = self._end_waiting()
        if self._open is not None:
            scans.append(self._whole(self._open, complete=complete))
        self._open = None
        self._turn.forget()
        return scans

    def _end_waiting(self) -> list[SensorScan]:
        """Return the turn that waited for echoes across the seam."""
        ending, self._ending = self._ending, None
        return [] if ending is None else [self._whole(ending[0], complete=True)]

    def _whole(self, scan: OpenScan, *, complete: bool) -> SensorScan:
        """The messages as one scan, with what it has looked at where that is not a whole turn."""
        messages = [part.message for part in scan.parts]
        self._parts = len(messages)
        self.latency = self._turn.stamp - messages[0].scan.stamp
        arcs = [message.beams for message in messages]
        swept = None if complete else looked_at(arcs, self._turn.step)
        return joined(messages, self.settings.sensor, swept)

    def _take_late(self, scan: OpenScan, message: SensorScan) -> Taken:
        """Put a late message in its place in the open scan, or refuse it."""
        stamp, stamps = message.scan.stamp, [part.message.scan.stamp for part in scan.parts]
        if stamp in stamps:
            return Taken([], [Rejection("scan_same_stamp", f"a second message at {stamp:.3f} s")])
        place = bisect_left(stamps, stamp)
        if place > 0 and self._lies_between(message, *scan.parts[place - 1 : place + 1]):
            beam = 0.5 * (scan.parts[place - 1].beam + scan.parts[place].beam)
            self._add(scan, message, beam)
            return Taken([], [])
        if not (stamp > self._late_stamp and math.isfinite(self._late_since)):
            self._late_since = stamp
        self._late_stamp = stamp
        if stamp - self._late_since <= MAX_LATE_TIME * self._turn.seconds:
            return Taken([], [Rejection("scan_late", f"the message at {stamp:.3f} s is late")])
        self._late_since = math.nan  # the clock was set back
        return Taken(self._end() + self._begin(message), [])

    def _lies_between(self, message: SensorScan, before: Part, after: Part) -> bool:
        """Whether a late message belongs between its neighbours in time, by its azimuth."""
        own, one, two = (each.beams for each in (message, before.message, after.message))
        if own is None or one is None or two is None:
            return len(message.scan) == 0 or own is None
        return self._turn.lies_between(own, one, two)


def _fit(first: SensorScan, message: SensorScan) -> bool:
    """Whether a message may be of the scan of another: of the same axes and reference."""
    return (first.frame_id, first.axes, first.north_referenced) == (
        message.frame_id,
        message.axes,
        message.north_referenced,
    )
