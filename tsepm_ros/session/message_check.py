"""Contradictions between messages, and losses of most detections.

Questions about messages that look other than meant; no value is converted or left out.

Whether half of the last scans, or of their detections, are lost; said with cause and remedy.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Mapping

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.own_ship.registration import SensorScan
from tsepm_ros.session.drop_reasons import EXPECTED, Notice, reason_of
from tsepm_ros.session.scan_queue import Now

MESSAGES, WINDOW = 10, 200
"""Messages after which they are judged, again and again, and after which counts begin anew."""
NO_RETURN = "no return: "
"""Beginning of the names of counts of values for no return."""
REPEATED_SHARE, MIN_DETECTIONS = 0.2, 50
"""Least share of detections that repeat those of the message before, to the bit, of a number."""
ECHO_FACTOR, SLOWEST_SOUND = 10.0, 1400.0
"""Factor by which a time exceeds that of an echo at the speed of sound (m/s), to be no echo's."""
STATED_CHANGE = 0.01
"""Least change of what a message states, as a part of it."""
LEAP_SECONDS = np.array([18.0, 19.0, 37.0])
"""GPS time ahead of UTC, atomic time (TAI) ahead of GPS time, and of UTC, s."""
LEAP_ERROR, MAX_AHEAD = 0.5, 1.0
"""Difference from leap seconds, and time by which a stamp may be after its arrival, s."""
MIN_ANGLES, LIKELY_SHARE = 20, 0.5
"""Least number of angles, and share of them beyond a turn above which they look like degrees."""
NEAR, COMPARED = 0.02, 50
"""Distance of two detections that may be one object's, as a part of the range, and number of
detections of a message that are compared."""
MIN_PAIRS, ALTERNATE_FACTOR = 60, 3.0
"""Least detections with one near it in the second message before, and the factor by which fewer
have one in the message before, where messages alternate."""


def leap_seconds(seconds: float) -> str:
    """A question about two clocks that differ by seconds like those of GPS time; else empty."""
    near = (np.abs(abs(seconds) - LEAP_SECONDS) <= LEAP_ERROR).any()
    return ": is it GPS time (18 s ahead of UTC) or TAI (37 s)?" if near else ""


class MessageCheck:
    """Judges the messages of a driver as they arrive, and asks each question once."""

    def __init__(self) -> None:
        self._states: dict[str, float] = {}
        self._before: deque[FloatArray] = deque(maxlen=2)
        self._times: deque[tuple[float, ...]] = deque(maxlen=MESSAGES)
        self._messages = 0
        self._counts: Counter[str] = Counter()
        self._asked: set[str] = set()

    def judge(self, arrived: SensorScan, own_ship_stamp: float | None, now: Now) -> list[Notice]:
        """Count a message that arrived at `now` (s); return the questions that are new.

        `own_ship_stamp` is that of the newest pose, s.
        """
        self._count(arrived, own_ship_stamp, now)
        asked = self._of_counts()
        if self._messages % MESSAGES == 0:
            asked |= self._of_times()
        new = [Notice(*one) for one in asked.items() if one[0] not in self._asked]
        self._asked.update(asked)
        return self._changes(arrived) + new

    def _count(self, arrived: SensorScan, own_ship_stamp: float | None, now: Now) -> None:
        scan, facts, counts = arrived.scan, arrived.facts, self._counts
        self._messages += 1
        if self._messages % WINDOW == 1:
            counts.clear()
        places = (scan.range * np.exp(1j * scan.azimuth))[:COMPARED]
        if len(self._before) == 2 and len(places):
            second, last = (np.abs(places[:, None] - before) for before in self._before)
            counts["compared"] += len(places)
            counts["repeated"] += int(np.count_nonzero(last == 0.0))
            limit = NEAR * scan.range[:COMPARED, None]
            counts["second"] += int(np.count_nonzero((second < limit).any(axis=1)))
            counts["last"] += int(np.count_nonzero((last < limit).any(axis=1)))
        self._before.append(places)
        codes = {f"{NO_RETURN}{code}": number for code, number in facts.no_return.items()}
        counts.update({**codes, "rays": facts.rays, "beyond": facts.beyond_turn})
        counts["angles"] += len(scan)
        offset = np.zeros(1) if scan.time_offset is None or not len(scan) else scan.time_offset
        own_ship = math.nan if own_ship_stamp is None else own_ship_stamp
        clock = now[-1] if isinstance(now, tuple) else now
        usual = float(np.abs(offset).mean()), float(scan.range.mean()) if len(scan) else 0.0
        self._times.append((scan.stamp, own_ship, clock, float(offset.max()), *usual))

    def _changes(self, arrived: SensorScan) -> list[Notice]:
        """What the message states otherwise than those before it."""
        said = []
        for name, value in arrived.facts.states.items():
            before = self._states.setdefault(name, value)
            if math.isfinite(value) and abs(value - before) > STATED_CHANGE * abs(before):
                self._states[name] = value
                change = f"changed from {before:g} to {value:g} at {arrived.scan.stamp:.3f} s"
                same = "the parameters `sensor.*` stay as given"
                said.append(Notice(f"changed {name}", f"{name} of messages {change}: {same}"))
        return said

    def _of_counts(self) -> dict[str, str]:
        """Questions about the detections of the window, by subject."""
        counts, said = self._counts, dict[str, str]()
        if counts["angles"] >= MIN_ANGLES and counts["beyond"] > LIKELY_SHARE * counts["angles"]:
            said["degrees"] = (
                f"{counts['beyond']} of {counts['angles']} azimuths or bearings are beyond 2 pi: "
                "are they in degrees? They are read as radians; the driver must send radians "
                "(degrees * pi / 180)"
            )
        if self._messages < MESSAGES:
            return said
        codes = [
            f"{100 * number / counts['rays']:.2g} % {name.removeprefix(NO_RETURN)}"
            for name, number in counts.items()
            if name.startswith(NO_RETURN) and not name.endswith("inf")
        ]
        if codes:
            said["no_return"] = f"rays without a return, by their ranges: {', '.join(codes)}"
        share = counts["repeated"] / max(counts["compared"], 1)
        if share >= REPEATED_SHARE and counts["compared"] >= MIN_DETECTIONS:
            said["repeated"] = (
                f"{100 * share:.0f} % of the detections repeat the message before to the bit: is "
                "that a value for no return, or a message that is sent twice? They are used"
            )
        if counts["second"] >= max(MIN_PAIRS, ALTERNATE_FACTOR * counts["last"]):
            said["two_sonars"] = (
                "every second message sees the same objects, and the messages between see others: "
                "are these two sonars on one topic? Run one node for each, on a topic of its own"
            )
        return said

    def _of_times(self) -> dict[str, str]:
        """Questions about the times of the last messages, by subject."""
        stamps, own_ship, clock, last, offsets, ranges = np.array(self._times).T
        intervals, said = np.diff(stamps), dict[str, str]()
        interval = float(np.median(intervals)) if (intervals > 0.0).all() else math.inf
        echo = ECHO_FACTOR / SLOWEST_SOUND * ranges
        offset = float(np.median(np.where(offsets > echo, offsets, 0.0)))
        if offset > interval:
            said["time_offset"] = (
                f"the time of detections after the stamp is {offset:.3g} s, with a message every "
                f"{interval:.3g} s: is it in ms, us or ns, or not after the stamp? It is read in "
                "seconds"
            )
        # A message arrives after its last echo.
        delays = {"detections": clock - stamps - 2.0 * last, "own ship": clock - own_ship}
        for name, delay in delays.items():
            steady = np.isfinite(delay).all() and np.ptp(delay) <= LEAP_ERROR and np.ptp(clock) > 0
            middle = float(np.median(delay)) if steady else 0.0
            hint = leap_seconds(middle)
            if middle < -MAX_AHEAD or (hint and middle > 2.0 * interval):
                said[f"clock of {name}"] = (
                    f"stamps of {name} are {abs(middle):.3g} s "
                    f"{'ahead of' if middle < 0.0 else 'behind'} the clock of their arrival"
                    f"{hint or ': set the clocks'}"
                )
        return said


LAST, MIN_SCANS, MIN_LOST = 20, 5, 40
"""Scans over which losses are judged, and least number of scans, and of detections."""
CONSEQUENCES = "own_ship_missing", "own_ship_stale"
"""Reasons of scans whose own-ship data may have arrived and been dropped."""


def explained(reason: str, dropped: Mapping[str, int], sentences: Mapping[str, str]) -> str:
    """A drop reason with its first cause, in words, and the remedy of that.

    Parameters
    ----------
    reason : str
    dropped : mapping of str to int
        Drops by reason.
    sentences : mapping of str to str
        First sentence by reason.
    """
    poses = [name for name in dropped if reason_of(name).lost == "pose"]
    cause = max([reason, *poses], key=dropped.__getitem__) if reason in CONSEQUENCES else reason
    counted = "" if cause == reason else f" after {dropped[cause]} {cause}"
    sentence = sentences.get(cause) or reason_of(cause).meaning
    return f"{reason}{counted}: {sentence}. Remedy: {reason_of(cause).remedy}"


class Losses:
    """The fates of the last scans and of their detections."""

    def __init__(self) -> None:
        self._last: deque[tuple[str, int, Counter[str]]] = deque(maxlen=LAST)
        self._lost: Counter[str] = Counter()
        self._sentences: dict[str, str] = {}
        self._said: set[str] = set()

    def drop(self, reason: str, sentence: str, number: int, dropped: Counter[str]) -> list[Notice]:
        """Note a drop, with the drops so far; a notice if half of the last scans are lost."""
        self._sentences.setdefault(reason, sentence)
        described = reason_of(reason)
        if described.lost == "detection" and described.remedy != EXPECTED:
            self._lost[reason] += number
        if described.lost != "scan":
            return []
        self._last.extend([(reason, 0, Counter())] * min(number, LAST))
        return self._judge(dropped)

    def processed(self, detections: int, dropped: Counter[str]) -> list[Notice]:
        """Note a processed scan; a notice if half of the last scans' detections are lost."""
        self._last.append(("", detections, self._lost))
        self._lost = Counter()
        return self._judge(dropped)

    def _judge(self, dropped: Counter[str]) -> list[Notice]:
        names, numbers, losses = zip(*self._last, strict=True)
        scans, detections = Counter(filter(None, names)), sum(losses, Counter[str]())
        share = detections.total() / max(detections.total() + sum(numbers), MIN_LOST)
        said = []
        for reasons, half, lost in (
            (scans, 2 * scans.total() >= len(names), f"{scans.total()} of the last {len(names)}"),
            (detections, 2.0 * share >= 1.0, f"{100 * share:.0f} % of the detections of the last"),
        ):
            ((reason, number),) = reasons.most_common(1) or [("", 0)]
            if half and reason not in {*self._said, ""} and len(names) >= MIN_SCANS:
                self._said.add(reason)
                why = explained(reason, dropped, self._sentences)
                told = f"{lost} scans were dropped, {number} as {why}"
                said.append(Notice(f"lost {reason}", told))
        return said
