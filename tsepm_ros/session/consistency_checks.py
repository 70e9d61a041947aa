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
"""Contradictions between messages, parameters and what the scans show, each said once.

A contradiction is said with its remedy; no value is converted or left out because of it. It may be
in messages that look other than meant, in parameters that look like degrees, in figures of the
sensor that do not fit the scans, or in the loss of half of the last scans or of their detections.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from tsepm_ros.own_ship.registration import Mounting, UnregisteredScan, selected_for_registration
from tsepm_ros.parameters import WHOLE_TURN
from tsepm_ros.session.drop_reasons import EXPECTED, Notice, drop_reason_of
from tsepm_ros.session.inputs import LEAP_ERROR, Now, input_leap_seconds, last_clock
from tsepm_ros.tracker.clutter.density import ClutterExtent
from tsepm_ros.tracker.clutter.sensor_performance import FittedErrors
from tsepm_ros.tracker.scan import Scan
from tsepm_ros.tracker.sensor import SensorModel
from tsepm_ros.tracker.sensor_state import SensorState
from tsepm_ros.tracker.tracker import Tracker

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
MAX_AHEAD = 1.0
"""Time by which a stamp may be after its arrival, s."""
MIN_ANGLES, LIKELY_SHARE = 20, 0.5
"""Least number of angles, and share of them beyond a turn above which they look like degrees."""
DEGREES = (
    "are they in degrees (360 a turn) or gradians (400)? They are read as radians; the driver must "
    "send radians (degrees * pi / 180, gradians * pi / 200)"
)
NEAR, COMPARED = 0.02, 50
"""Distance of two detections that may be one object's, as a part of the range, and number of
detections of a message that are compared."""
MIN_PAIRS, ALTERNATE_FACTOR = 60, 3.0
"""Least detections with one near it in the second message before, and the factor by which fewer
have one in the message before, where messages alternate."""
CHANGED_SHARE, MIN_EQUAL = 0.5, 2
"""Share of the detections of two scans that differ, above which two equal scans are no chance, and
least number of detections of the first of these."""
SECTORS, COPY_CHANCE, LEAST_CHANCE = 720, 1e-3, 1e-2
"""Sectors of a turn in which it is learned how often detections are equal by nature, chance of a
scan to have a run that is taken for a copy, and least chance of an equal."""
LAST, MIN_SCANS, MIN_LOST = 20, 5, 40
"""Scans over which losses are judged, and least number of scans, and of detections."""
CONSEQUENCES = "own_ship_missing", "own_ship_stale"
"""Reasons of scans whose own-ship data may have arrived and been dropped."""
MIN_SEEN = 30
"""Detections of clutter from which on the extent of them is certain enough to be said."""
AREA_FACTOR = 2.0
"""Factor by which the coverage as given may exceed the area in which detections fall."""
MIN_LOG_RATIO = 14.0
"""Log-likelihood ratio of the smaller area from which on it is said."""
MAX_OUTSIDE_SHARE = 0.05
"""Share of the detections outside the coverage that is accepted."""
MIN_OUTSIDE = 20
"""Detections outside the coverage from which on it is said."""
OUTSIDE_SCANS = 100
"""Scans, the last, over which these are counted."""
ERROR_FACTOR = 1.5
"""Factor by which the errors as given may differ from those of the innovations."""
LEAST_FACTOR, POSE_FACTOR = 0.01, 10.0
"""Factor below which detections have no errors of a sensor: they are simulated, or rounded; and
factor by which the stated error of own ship's position may exceed theirs. At 12 in a scene of 15
false detections a ping, and at 17 of 4, no track starts any more."""
RATE_WINDOW = 3600.0
"""Time over which confirmations are counted, s."""
RATE_FACTOR = 10.0
"""Confirmations may exceed the target false-track rate by this factor: there are targets too."""
SCANS_BETWEEN = 10
MIN_EMPTY_SECTOR = math.pi / 3.0
"""Sector without detections, rad, below which they count as all round: chance leaves gaps."""
MIN_CONFIRMATIONS = 30
"""Confirmations from which on a flood is said."""


class MessageCheck:
    """Judges the messages of a driver as they arrive, and asks each question once."""

    def __init__(self) -> None:
        self._states: dict[str, list[float]] = {}
        self._before: deque[FloatArray] = deque(maxlen=2)
        self._times: deque[tuple[float, ...]] = deque(maxlen=MESSAGES)
        self._messages = 0
        self._counts: Counter[str] = Counter()
        self._asked: set[str] = set()

    def judge(
        self, arrived: UnregisteredScan, own_ship_stamp: float | None, now: Now
    ) -> list[Notice]:
        """Count a message that arrived at `now` (s); return the questions that are new.

        `own_ship_stamp` is that of the newest pose, s.
        """
        self._count(arrived, own_ship_stamp, now)
        asked = self._of_counts()
        if self._messages % MESSAGES == 0:
            asked |= self._of_times()
        new = [Notice(*question) for question in asked.items() if question[0] not in self._asked]
        self._asked.update(asked)
        return [*(self._changes(arrived) if arrived.facts.states else ()), *new]

    def _count(self, arrived: UnregisteredScan, own_ship_stamp: float | None, now: Now) -> None:
        scan, facts, counts = arrived.scan, arrived.facts, self._counts
        self._messages += 1
        if self._messages % WINDOW == 1:
            counts.clear()
        places = (scan.range * np.exp(1j * scan.azimuth))[:COMPARED]
        if len(self._before) == 2 and len(places):
            second, last = (np.abs(places[:, None] - before) for before in self._before)
            counts["compared"] += len(places)
            counts["repeated"] += int(np.count_nonzero((last == 0.0).any(axis=1)))
            limit = NEAR * scan.range[:COMPARED, None]
            counts["second"] += int(np.count_nonzero((second < limit).any(axis=1)))
            counts["last"] += int(np.count_nonzero((last < limit).any(axis=1)))
        self._before.append(places)
        counts.update({f"{NO_RETURN}{code}": n for code, n in facts.no_return.items()})
        counts.update(rays=facts.rays, beyond=facts.beyond_turn)
        number = len(scan)
        counts["angles"] += number
        counts["largest angle"] = max(counts["largest angle"], round(facts.largest_angle))
        offset = np.zeros(1) if scan.time_offset is None or not number else scan.time_offset
        self._times.append(
            (
                scan.stamp,
                math.nan if own_ship_stamp is None else own_ship_stamp,
                last_clock(now),
                float(offset.max()),
                float(np.abs(offset).mean()),
                float(scan.range.mean()) if number else 0.0,
            )
        )

    def _changes(self, arrived: UnregisteredScan) -> list[Notice]:
        """What the message states otherwise than all before it: parts of a turn may alternate."""
        said = []
        for name, value in arrived.facts.states.items():
            known = np.array(self._states.setdefault(name, [value]))
            if math.isfinite(value) and (abs(value - known) > STATED_CHANGE * abs(known)).all():
                self._states[name].append(value)
                said.append(
                    Notice(
                        f"changed {name}",
                        f"{name} of messages changed to {value:g} at {arrived.scan.stamp:.3f} s, "
                        f"from {', '.join(f'{one:g}' for one in known)} before: the "
                        "parameters `sensor.*` stay as given",
                    )
                )
        return said

    def _of_counts(self) -> dict[str, str]:
        """Questions about the detections of the window, by subject."""
        counts, known = self._counts, self._messages >= MESSAGES
        angles, beyond, compared = counts["angles"], counts["beyond"], counts["compared"]
        codes = ", ".join(
            f"{100 * number / counts['rays']:.2g} % {name.removeprefix(NO_RETURN)}"
            for name, number in counts.items()
            if name.startswith(NO_RETURN) and not name.endswith("inf")
        )
        share = counts["repeated"] / max(compared, 1)
        alternate = counts["second"] >= max(MIN_PAIRS, ALTERNATE_FACTOR * counts["last"])
        rows = (
            (
                "degrees",
                (angles >= MIN_ANGLES and beyond > LIKELY_SHARE * angles)
                and f"{beyond} of {angles} azimuths or bearings are beyond 2 pi, up to "
                f"{counts['largest angle']}: {DEGREES}",
            ),
            (
                "no_return",
                (known and codes) and f"rays without a return, by their ranges: {codes}",
            ),
            (
                "repeated",
                (known and share >= REPEATED_SHARE and compared >= MIN_DETECTIONS)
                and f"{100 * share:.0f} % of the detections repeat the message before to the bit: "
                "is that a value for no return, or a message that is sent twice? They are used",
            ),
            (
                "two_sonars",
                (known and alternate)
                and "every second message sees the same objects, and the messages between see "
                "others: are these two sonars on one topic? Run one node for each, on a topic of "
                "its own",
            ),
        )
        return {subject: sentence for subject, sentence in rows if sentence}

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
        # A message arrives after its last detection, which may be of a bearing sent last.
        delays = {"detections": clock - stamps - last, "own ship": clock - own_ship}
        for name, delay in delays.items():
            steady = np.isfinite(delay).all() and np.ptp(delay) <= LEAP_ERROR and np.ptp(clock) > 0
            middle = float(np.median(delay)) if steady else 0.0
            hint = input_leap_seconds(middle)
            if middle < -MAX_AHEAD or (hint and middle > 2.0 * interval):
                said[f"clock of {name}"] = (
                    f"stamps of {name} are {abs(middle):.3g} s "
                    f"{'ahead of' if middle < 0.0 else 'behind'} the clock of their arrival"
                    f"{hint or ': set the clocks'}"
                )
        return said


class CopiedRuns:
    """Finds runs of neighbours that are copies of the scan before, and no equals by nature.

    How often a place is equal from scan to scan is learned: always, as of a source without noise;
    often, as of coarse values; or never. A run is a copy where that, and the share of equals beside
    it, make so long a run no chance. Copies are not learned.

    Parameters
    ----------
    places : int
        Number of bearings, or of sectors.
    """

    def __init__(self, places: int) -> None:
        self._equal, self._all = np.zeros(places), np.zeros(places)

    def copies(self, place: IntArray, equal: BoolArray, goes_on: BoolArray) -> BoolArray:
        """Which of the elements (n,) of a scan, in their order, are copies.

        Parameters
        ----------
        place : (n,) ndarray of int
        equal : (n,) ndarray of bool
            Whether the scan before has an equal one.
        goes_on : (n,) ndarray of bool
            Whether the equals of an element and of the one before it were neighbours too.
        """
        copied = equal & ~self._are_chance(place, equal, goes_on) if equal.any() else equal
        np.add.at(self._equal, place[~copied], equal[~copied])
        np.add.at(self._all, place[~copied], 1.0)
        return np.asarray(copied)

    def _are_chance(self, place: IntArray, equal: BoolArray, goes_on: BoolArray) -> BoolArray:
        """Which elements are in runs of equals that may be chance."""
        usual = (self._equal.sum() + 1.0) / (self._all.sum() + 1.0)
        chance = (self._equal[place] + usual) / (self._all[place] + 1.0)
        run = np.cumsum(~(goes_on & equal & np.append(False, equal[:-1]))) - 1
        length = np.bincount(run, equal)[run]
        beside = (equal.sum() - length) / (len(equal) - length + 1.0)
        log_chance = np.log(np.clip(np.maximum(chance, beside), LEAST_CHANCE, 1.0))
        return np.asarray(np.bincount(run, log_chance)[run] > math.log(COPY_CHANCE / len(equal)))


class RepetitionCheck:
    """Finds what repeats the scan before, or its own: all fields of detections equal to the bit.

    Of detections that equal another of their scan, the first is used. If the detections change
    otherwise, an equal scan is no chance, and no new evidence: a driver or a relay has sent the
    scan, or a part of it, again. If they do not change, as those of a simulator without noise, it
    is none. Until the first change, and while it may be chance, equal scans are used.

    Parameters
    ----------
    drop : callable
        Called with a reason, a sentence and a number for what is left out.
    """

    def __init__(self, drop: Callable[[str, str, int], None]) -> None:
        self._drop, self._stamp, self._keys = drop, -math.inf, np.zeros(0)
        self._runs, self._changing, self._found = CopiedRuns(SECTORS), False, False

    def new_in(self, arrived: UnregisteredScan) -> UnregisteredScan | None:
        """What of a scan repeats not the last that has detections; their times do not count."""
        scan, before = arrived.scan, np.append(self._keys, np.inf)
        if not len(scan) or scan.stamp == self._stamp:
            return arrived
        features = (scan.features[name] for name in sorted(scan.features))
        # A number for all fields of a detection, which no other has but by chance.
        columns = np.nan_to_num(
            [
                scan.range,
                scan.azimuth,
                0.0 * scan.range if arrived.height is None else arrived.height,
                *features,
            ]
        )
        keys = (columns * np.sqrt(np.arange(2.0, len(columns) + 2.0))[:, None]).sum(axis=0)
        times = 0.0 if scan.time_offset is None else math.pi * scan.time_offset
        if more := len(keys) - len(set((keys + times).tolist())):
            self._drop(
                "detection_repeated",
                f"{more} of {len(keys)} detections at {scan.stamp:.3f} s equal another of their "
                "scan to the bit",
                more,
            )
            kept = np.isin(np.arange(len(keys)), np.unique(keys + times, return_index=True)[1])
            arrived, keys = selected_for_registration(arrived, kept), keys[kept]
            scan = arrived.scan
        self._stamp, self._keys = scan.stamp, keys
        if len(before) == 1:  # the first scan
            return arrived
        order = np.argsort(before)
        number = order[np.searchsorted(before, keys, sorter=order)]
        equal = before[number] == keys
        if np.array_equal(keys, before[:-1]):
            self._found |= self._changing and len(scan) >= MIN_EQUAL
            if self._found and self._changing:
                self._drop(
                    "scan_repeated",
                    f"the detections at {scan.stamp:.3f} s equal the last ones to the bit",
                    1,
                )
                return None
        else:
            self._changing = bool(equal.mean() < CHANGED_SHARE)
        copied = self._runs.copies(
            np.floor((scan.azimuth / (2.0 * math.pi) + 0.5) * SECTORS).astype(int) % SECTORS,
            equal,
            np.append(False, np.abs(np.diff(number)) == 1),
        )
        if not copied.any():
            return arrived
        self._drop(
            "detection_repeated",
            f"{copied.sum()} of {len(scan)} detections at {scan.stamp:.3f} s, neighbours, equal "
            "those of the last scan to the bit",
            int(copied.sum()),
        )
        return selected_for_registration(arrived, ~copied)


def explained_by_check(
    reason: str, dropped: Mapping[str, int], sentences: Mapping[str, str]
) -> str:
    """A drop reason with its first cause, in words, and the remedy of that.

    Parameters
    ----------
    reason : str
    dropped : mapping of str to int
        Drops by reason.
    sentences : mapping of str to str
        First sentence by reason.
    """
    poses = [name for name in dropped if drop_reason_of(name).lost == "pose"]
    cause = max([reason, *poses], key=dropped.__getitem__) if reason in CONSEQUENCES else reason
    counted = "" if cause == reason else f" after {dropped[cause]} {cause}"
    sentence = sentences.get(cause) or drop_reason_of(cause).meaning
    return f"{reason}{counted}: {sentence}. Remedy: {drop_reason_of(cause).remedy}"


class LossCheck:
    """The fates of the last scans and of their detections."""

    def __init__(self) -> None:
        self._last: deque[tuple[str, int, Counter[str]]] = deque(maxlen=LAST)
        self._lost: Counter[str] = Counter()
        self._sentences: dict[str, str] = {}
        self._said: set[str] = set()

    def drop(self, reason: str, sentence: str, number: int, dropped: Counter[str]) -> list[Notice]:
        """Note a drop, with the drops so far; a notice if half of the last scans are lost."""
        self._sentences.setdefault(reason, sentence)
        described = drop_reason_of(reason)
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
        return self._judge(dropped) if any(why or lost for why, _, lost in self._last) else []

    def _judge(self, dropped: Counter[str]) -> list[Notice]:
        names, numbers, losses = zip(*self._last, strict=True)
        scans, detections = Counter(filter(None, names)), sum(filter(None, losses), Counter[str]())
        share = detections.total() / max(detections.total() + sum(numbers), MIN_LOST)
        said = []
        for reasons, half, lost in (
            (scans, 2 * scans.total() >= len(names), f"{scans.total()} of the last {len(names)}"),
            (detections, 2.0 * share >= 1.0, f"{100 * share:.0f} % of the detections of the last"),
        ):
            ((reason, number),) = reasons.most_common(1) or [("", 0)]
            if half and reason not in {*self._said, ""} and len(names) >= MIN_SCANS:
                self._said.add(reason)
                why = explained_by_check(reason, dropped, self._sentences)
                said.append(
                    Notice(f"lost {reason}", f"{lost} scans were dropped, {number} as {why}")
                )
        return said


def check_questions(sensor: SensorModel, mounting: Mounting) -> list[str]:
    """Questions about parameters in radians that look like degrees, a sentence each.

    Likely are errors of an azimuth up to 11 degrees, beams up to 46, and a yaw of a mounting up to
    half a turn.
    """
    return [
        f"{name} is {value:g} rad, which is {math.degrees(value):.0f} degrees: if {value:g} "
        f"degrees are meant, set {math.radians(value):.4g}"
        for name, value, limit in (
            ("sensor.azimuth_std", sensor.azimuth_std, 0.2),
            ("sensor.azimuth_resolution", sensor.azimuth_resolution, 0.8),
            ("mounting.yaw", mounting.yaw, 3.2),
        )
        if abs(value) > limit
    ]


@dataclass(frozen=True)
class SensorFigures:
    """Learned figures beside those that are given.

    Attributes
    ----------
    sensor : SensorModel
        As given.
    seen : ClutterExtent or None
        Where clutter is seen; None before enough detections.
    seen_detections : int
        Detections from which this is known.
    outside : int
        Detections outside the coverage, in the last `OUTSIDE_SCANS`.
    detections : int
        All detections of these.
    outside_extent : ClutterExtent or None
        Ranges and sector of all detections, where some are outside the coverage.
    errors : FittedErrors or None
        Errors that fit the confirmed tracks' innovations.
    confirmed : int
        Tracks confirmed within `duration`.
    duration : float
        s, at most `RATE_WINDOW`.
    false_tracks_per_hour : float or None
        The target false-track rate; None where the method has none.
    pose_error : float
        Standard deviation that own ship's data states of its position, m.
    """

    sensor: SensorModel = field(default_factory=SensorModel)
    seen: ClutterExtent | None = None
    seen_detections: int = 0
    outside: int = 0
    detections: int = 0
    outside_extent: ClutterExtent | None = None
    errors: FittedErrors | None = None
    confirmed: int = 0
    duration: float = 0.0
    false_tracks_per_hour: float | None = None
    pose_error: float = 0.0


def check_coverage_too_large(figures: SensorFigures) -> str:
    """Detections fall in a small part of the coverage."""
    seen, given = figures.seen, figures.sensor.coverage_area
    if seen is None or not 0.0 < AREA_FACTOR * seen.area <= given:
        return ""
    if figures.seen_detections * math.log(given / seen.area) < MIN_LOG_RATIO:
        return ""
    return (
        f"all detections are {_extent_in_words(seen)}; by the parameters, the coverage is "
        f"{_extent_in_words(ClutterExtent.of_sensor(figures.sensor))}: "
        + "a thousand times these ranges fit: give m if they are in km; "
        * _fit(1e3 * seen.max_range, figures.sensor)
        + f"if the sonar covers no more, set {_settings(seen, figures.sensor)} (m, rad)"
    )


def check_coverage_too_small(figures: SensorFigures) -> str:
    """Detections are dropped since they lie outside the coverage."""
    share = figures.outside / max(figures.detections, 1)
    extent = figures.outside_extent
    if extent is None or figures.outside < MIN_OUTSIDE or share < MAX_OUTSIDE_SHARE:
        return ""
    sector = np.array([extent.azimuth_min, extent.azimuth_max])
    ranges = np.array([extent.min_range, extent.max_range])
    sensor = figures.sensor
    remedy = (
        "are angles in another unit than rad? Else "
        * (not (sensor.all_round or _is_sector(extent)))
        + f"set {_settings(extent, sensor)}, unless the coverage is limited on purpose"
    )
    if not sensor.covers(ranges, 0.0, 0.1 * ranges, math.pi).any():
        if _fit(1e-3 * extent.max_range, sensor):
            remedy = f"a thousandth of these ranges fits: give m if they are in mm, else {remedy}"
    elif (
        _is_sector(extent)
        and not sensor.covers(extent.max_range, sector, np.inf, 0.1).all()
        and sensor.covers(extent.max_range, -sector, np.inf, 0.1).all()
    ):
        remedy = (
            "that is the mirror of the coverage: if azimuths are clockwise, use the field bearing "
            f"(of images, the other image.port_first), else {remedy}"
        )
    return (
        f"{100.0 * share:.0f} % of the detections are outside the coverage and dropped; they are "
        f"{_extent_in_words(extent)}: {remedy}"
    )


def check_errors_differ(figures: SensorFigures) -> str:
    """The errors of range or azimuth do not fit the detections of confirmed tracks."""
    errors = figures.errors
    if errors is None:
        return ""
    if min(errors.range_factor, errors.azimuth_factor) < LEAST_FACTOR:
        return (
            "as the detections of confirmed tracks show, errors of range or azimuth are less than "
            f"{100.0 * LEAST_FACTOR:g} % of those of the parameters: are the detections simulated?"
        )
    rows = (
        (
            errors.range_factor,
            f"range errors are {errors.range_factor:.2g} times those of the parameters (at a "
            f"median range of {errors.median_range:.3g} m): set sensor.range_std to "
            f"{errors.range_std:.2g} and sensor.range_std_fraction to "
            f"{errors.range_std_fraction:.2g}",
        ),
        (
            errors.azimuth_factor,
            f"azimuth errors are {errors.azimuth_factor:.2g} times those of the parameters: set "
            f"sensor.azimuth_std to {errors.azimuth_std:.2g} rad "
            f"({math.degrees(errors.azimuth_std):.2g} degrees)",
        ),
    )
    parts = [said for factor, said in rows if not 1.0 / ERROR_FACTOR <= factor <= ERROR_FACTOR]
    return "as the detections of confirmed tracks show, " + "; ".join(parts) if parts else ""


def check_many_confirmations(figures: SensorFigures) -> str:
    """Far more tracks are confirmed than the target false-track rate allows."""
    rate, confirmed = figures.false_tracks_per_hour, figures.confirmed
    if rate is None or confirmed < MIN_CONFIRMATIONS:
        return ""
    if confirmed <= RATE_FACTOR * rate * figures.duration / 3600.0:
        return ""
    return (
        f"{confirmed} tracks were confirmed in {figures.duration / 60.0:.0f} min; the target "
        f"false-track rate is {rate:g} per hour. If there are fewer targets, see "
        "docs/watch_and_operate.md, too many tracks"
    )


def check_pose_error(figures: SensorFigures) -> str:
    """Own ship's position is stated with an error that hides all motion."""
    return (
        "the sensor's position, by the stated errors of own ship's position and heading, has an "
        f"error (standard deviation) of {figures.pose_error:.3g} m, detections have {error:.3g} m "
        "at most: it counts anew in each ping, so tracks are vague, or none start. State the error "
        "from ping to ping"
        if figures.pose_error
        > POSE_FACTOR
        * (
            error := max(
                math.sqrt(figures.sensor.range_variance(figures.sensor.max_range)),
                figures.sensor.azimuth_std * figures.sensor.max_range,
            )
        )
        else ""
    )


FINDINGS: dict[str, Callable[[SensorFigures], str]] = {
    "coverage": check_coverage_too_large,
    "coverage_too_small": check_coverage_too_small,
    "errors": check_errors_differ,
    "confirmations": check_many_confirmations,
    "own_ship_error": check_pose_error,
}
"""What is looked for in the figures of the sensor: each returns its sentence, or an empty one."""


def check_findings(figures: SensorFigures) -> dict[str, str]:
    """Sentences by subject, for what does not fit."""
    sentences = {subject: look(figures) for subject, look in FINDINGS.items()}
    return {subject: sentence for subject, sentence in sentences.items() if sentence}


def _is_sector(extent: ClutterExtent) -> bool:
    """Whether an extent leaves out more than a chance gap."""
    return extent.azimuth_max - extent.azimuth_min <= 2.0 * math.pi - MIN_EMPTY_SECTOR


def _extent_in_words(extent: ClutterExtent) -> str:
    """An extent in words."""
    sector = "all round"
    if _is_sector(extent):
        sector = (
            f"between {math.degrees(extent.azimuth_min):.0f} and "
            f"{math.degrees(extent.azimuth_max):.0f} degrees"
        )
    return f"from {_rounded_down(extent.min_range):g} to {extent.max_range:.4g} m, {sector}"


def _fit(farthest: float, sensor: SensorModel) -> bool:
    """Whether ranges up to the farthest, m, may be those of the coverage."""
    return bool(0.1 * sensor.max_range < farthest < 1.1 * sensor.max_range)


def _settings(extent: ClutterExtent, sensor: SensorModel) -> str:
    """Parameters that make an extent the coverage."""
    farthest, is_sector = _rounded_up(extent.max_range), _is_sector(extent)
    begin, end = (extent.azimuth_min, extent.azimuth_max) if is_sector else (-math.pi, math.pi)
    turn = 2.0 * math.pi * (end > WHOLE_TURN)  # beyond the bounds of the parameter
    rows = (
        (farthest != sensor.max_range, "max_range", f"{farthest:g}"),
        (extent.min_range < sensor.min_range, "min_range", f"{_rounded_down(extent.min_range):g}"),
        (is_sector or not sensor.all_round, "azimuth_min", f"{begin - turn:.3g}"),
        (is_sector or not sensor.all_round, "azimuth_max", f"{end - turn:.3g}"),
    )
    return ", ".join(f"sensor.{name} to {value}" for applies, name, value in rows if applies)


def _rounded_up(value: float) -> float:
    """To two significant digits, not below."""
    step = 10.0 ** (math.floor(math.log10(value)) - 1)
    return step * math.ceil(value / step - 0.1)


def _rounded_down(value: float) -> float:
    """To two significant digits, not above."""
    step = 10.0 ** (math.floor(math.log10(max(value, 1e-300))) - 1)
    return step * math.floor(value / step)


class SensorCheck:
    """Compares the sensor's figures with what an initiator learned; says each finding once."""

    def __init__(self) -> None:
        self._said: set[str] = set()
        self._confirmed: deque[float] = deque(maxlen=10_000)
        self._outside: deque[tuple[int, int]] = deque(maxlen=OUTSIDE_SCANS)
        self._first_stamp: float | None = None
        # Images state their coverage, a first turn sees a part; error of own ship's position, m.
        self._keeps_extent, self._pose_error = False, 0.0

    def observe(self, scan: Scan, confirmed: int, outside: int, *, begins: bool = False) -> None:
        """Count what a scan brought.

        Parameters
        ----------
        scan : Scan
        confirmed : int
            New tracks.
        outside : int
            Detections outside the coverage.
        begins : bool, optional
            Whether the scan is a beam of the first turn, as `Sweep.begins`.
        """
        stamp, self._keeps_extent = scan.stamp, begins or "standing" in scan.features
        self._pose_error = (
            0.0
            if (pose := scan.sensor_pose_covariance) is None
            else math.sqrt(np.linalg.norm(pose[:2, :2], 2))
        )
        self._outside.append((outside, len(scan)))
        self._first_stamp = stamp if self._first_stamp is None else self._first_stamp
        self._confirmed.extend([stamp] * confirmed)
        while self._confirmed and self._confirmed[0] < stamp - RATE_WINDOW:
            self._confirmed.popleft()

    def figures(self, initiator: Tracker, state: SensorState | None = None) -> SensorFigures:
        """Learned figures beside those that are given, of the last sensor or another one."""
        state = state or initiator.sensor
        learned, sensor = state.learned, state.model
        seen, all_seen = learned.seen_extent, learned.all_extent
        stamp, first = initiator.stamp, self._first_stamp
        duration = 0.0 if stamp is None or first is None else stamp - first
        outside = sum(number for number, _ in self._outside)
        return SensorFigures(
            sensor=sensor,
            seen=None if seen.detections < MIN_SEEN or self._keeps_extent else seen.region.extent,
            seen_detections=seen.detections,
            outside=outside,
            detections=sum(number for _, number in self._outside),
            outside_extent=all_seen.region.extent if outside else None,
            # Beside other sensors these alone show too little, see `SensorAlignment`.
            errors=learned.errors.fitted if len(initiator.sensors) == 1 else None,
            confirmed=len(self._confirmed),
            duration=min(duration, RATE_WINDOW),
            false_tracks_per_hour=getattr(initiator.options, "false_tracks_per_hour", None),
            pose_error=self._pose_error,
        )

    def news(self, initiator: Tracker) -> list[tuple[str, str]]:
        """Subjects and sentences not found before; looked for at every tenth scan."""
        if (initiator.scan_index + 1) % SCANS_BETWEEN:
            return []
        findings = check_findings(self.figures(initiator))
        new = [(subject, said) for subject, said in findings.items() if subject not in self._said]
        self._said |= {subject for subject, _ in new}
        return new

    def say_again(self) -> None:
        """Say every finding again, and count anew: the figures as given may have changed."""
        self._said = set()
        self._outside.clear()
