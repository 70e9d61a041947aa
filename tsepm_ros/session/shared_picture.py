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
"""The picture that the sessions of several sensors share, and the order of their scans.

Scans of all sensors are processed by their stamps. A scan waits while another sensor may still
deliver one of an earlier stamp: as the last scans of that sensor tell, which arrived so long after
their stamps; for `max_wait` at most, and for no sensor that is silent. The first scan waits for the
first ones of all sensors that have a publisher. A scan that comes after later ones of other sensors
were processed is late.

Where the stamps of a sensor go back, its scans wait until those of every other sensor do, too, or
the others are silent; the picture is then reset once. If another sensor goes on meanwhile, one of
the two clocks is wrong, and those that went back are dropped.
"""

from __future__ import annotations

import math
import re
import statistics
from collections import Counter, deque
from collections.abc import Iterator, Mapping
from dataclasses import asdict, replace
from typing import TYPE_CHECKING

import numpy as np

from tsepm_ros.methods.registry import make_initiator
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.own_ship.registration import registration_axes
from tsepm_ros.session.drop_reasons import Notice, Rejection, drop_reason_of
from tsepm_ros.session.inputs import (
    Arrival,
    ExternalTrackerInput,
    LandInput,
    Now,
    Waiting,
    input_waited,
    last_clock,
)
from tsepm_ros.tracker.clutter.sensor_performance import MIN_SAMPLES
from tsepm_ros.tracker.method import ScanStatistics
from tsepm_ros.tracker.sensor_alignment import MIN_DEVIATIONS_SAID
from tsepm_ros.tracker.sensor_state import SILENT_INTERVALS
from tsepm_ros.tracker.tracker import Tracker

if TYPE_CHECKING:
    from tsepm_ros.session.session import ScanResult, Session, SessionSnapshot

LAST_DELIVERIES = 20
"""Scans of a sensor that tell its latency and its interval."""
EARLIEST = 0.5
"""Time after a scan, in intervals, before which its sensor delivers no other: a choice."""


class ScanDeliveries:
    """When the scans of a sensor arrive.

    Attributes
    ----------
    stamp : float
        Of the last one, s; nan before the first.
    heard : float or tuple of float
        When it arrived, s.
    expected : float or tuple of float
        Since when the first is waited for, s: there is a publisher.
    latency : float
        Time from stamps to arrivals by the last clock, which is that of stamps, s: the second
        longest of the last scans, as one may have a bad stamp; infinite before the first.
    interval : float
        Median time between the last scans, s; 0 while it is unknown.
    """

    def __init__(self) -> None:
        self._latencies = deque[float](maxlen=LAST_DELIVERIES)
        self._intervals = deque[float](maxlen=LAST_DELIVERIES)
        self.stamp, self.latency, self.interval = math.nan, math.inf, 0.0
        self.heard, self.expected = -math.inf, -math.inf  # type: Now, Now

    def note(self, stamp: float, now: Now) -> None:
        """Note the arrival of a scan, processed or not."""
        if not math.isnan(latency := last_clock(now) - stamp):  # of a clock that stands still
            self._latencies.append(latency)
            self.latency = sorted(self._latencies)[-2:][0]
        if stamp > self.stamp:
            self._intervals.append(stamp - self.stamp)
            self.interval = statistics.median(self._intervals)
        self.stamp, self.heard = stamp, now

    def is_silent(self, now: Now, patience: float) -> bool:
        """Whether no scan came for `SILENT_INTERVALS` intervals; before two, for a time, s."""
        since = self.expected if math.isnan(self.stamp) else self.heard
        return input_waited(since, now) > (SILENT_INTERVALS * self.interval or patience)

    def may_deliver(self, stamp: float, now: Now) -> bool:
        """Whether a scan up to a stamp, s, may still come, if the sensor is not silent."""
        due = not stamp <= self.stamp + EARLIEST * self.interval  # before the first: any
        return due and not last_clock(now) >= stamp + self.latency  # a clock that stands is nan


class SharedPicture:
    """What the sessions of the sensors of one picture have in common, and whose turn it is.

    Parameters
    ----------
    tracker : Tracker

    Attributes
    ----------
    tracker : Tracker
        In use.
    sessions : dict of str to Session
        By the names of their sensors; of a single sensor the name is empty.
    land : LandInput
    downstream : ExternalTrackerInput
    ends : Counter
        Tracks that ended since the start or the last reset, by reason.
    totals_before : ScanStatistics
        Counts of the runs before the tracker was reset last.
    ends_of_all, restarts : int
        How often all tracks were ended at once, and the clock of all went back.
    """

    def __init__(self, tracker: Tracker) -> None:
        self.tracker, self.land, self.ends_of_all = tracker, LandInput(), 0
        self.sessions: dict[str, Session] = {}
        self.start()

    def start(self) -> None:
        """Begin without counts and reports."""
        self.ends: Counter[str] = Counter()
        self.totals_before, self.downstream = ScanStatistics(), ExternalTrackerInput()
        self.restarts, self._misaligned = 0, ""

    def forget(self) -> None:
        """Discard tracks and what was learned."""
        self.tracker.reset()
        self.ends_of_all += 1

    @property
    def fixed_frame(self) -> str:
        """Frame of the tracks; empty while unknown."""
        return next(filter(None, (one.frames.fixed for one in self.sessions.values())), "")

    def frames_of_others(self, own: Session) -> dict[str, str]:
        """Names of the other sensors by their frames, where a frame is of one sensor alone.

        Sensors with mountings may share one, if no `sensor_frame` tells them apart.
        """
        differ = own.frames.sensor or own.own_ship.source == "tf"
        return {
            one.frames.sensor: name
            for name, one in self.sessions.items()
            if one is not own and (differ or one.settings.session.sensor_frame)
        }

    def process(self, now: Now = math.inf, *, last: bool = False) -> Iterator[ScanResult]:
        """Process the scans of all sensors that are ready, by their stamps; see `Session.process`.

        Parameters
        ----------
        now : float or tuple of float
            s.
        last : bool, optional
            Whether no further scan follows.

        Yields
        ------
        ScanResult
        """
        if len(self.sessions) == 1:
            yield from next(iter(self.sessions.values())).process(now, last=last)
            return
        for one in self.sessions.values():
            one.close_sweep(now, last=last)
        while (session := self._next(now, last)) is not None:
            waiting = len(session.queue.scans)
            yield from session.process(now, last=last, most=1)
            if len(session.queue.scans) == waiting:  # for own-ship data
                return

    def _next(self, now: Now, last: bool) -> Session | None:
        """The session whose first scan is to be processed or dropped, if none must wait."""
        heads = {
            name: (self._rank(session, first), first)
            for name, session in self.sessions.items()
            if (first := session.queue.first(now, last=last)) is not None
        }
        if not heads:
            return None
        name = min(heads, key=lambda name: heads[name][0])
        (_, is_back, stamp), first = heads[name]
        session, living = self.sessions[name], self._living(now)
        limit = session.settings.session.max_wait
        if not last and first.refusal is None and first.seconds < limit:
            quickest = min((one.deliveries.latency for one in living), default=0.0)
            # For a sensor that is later than the limit it would be waited in vain.
            for other in living:
                queued, its = other.queue.scans, other.deliveries
                if queued:  # those in no order yet: the next one tells whether its clock went back
                    waits = other.sensor not in heads and queued[0][1].scan.stamp < stamp
                else:
                    waits = is_back or its.may_deliver(stamp, now)
                if waits and (math.isinf(its.latency) or its.latency - quickest <= limit):
                    return None
        on = [
            other.sensor
            for other in living
            if not other.queue.scans and input_waited(other.deliveries.heard, now) < first.seconds
        ]
        if is_back and on:
            session.queue.refused = Rejection(
                "scan_late",
                f"stamps went back to {stamp:.3f} s, and those of {', '.join(on)} did not: one of "
                "the clocks is wrong",
            )
        return session

    def _rank(self, session: Session, first: Waiting) -> tuple[bool, bool, float]:
        """Place in the order: drops first; then by stamps, those that reset the picture last."""
        is_back = first.arrival is Arrival.RESTART and session.restarts == self.restarts
        return first.refusal is None, is_back, first.scan.scan.stamp

    def _living(self, now: Now) -> list[Session]:
        """Sessions of the sensors that are not silent."""
        return [
            one
            for one in self.sessions.values()
            if not one.deliveries.is_silent(now, one.settings.session.max_wait)
        ]

    @property
    def rates(self) -> FloatArray:
        """Scans per second of each sensor, above 0 where that is unknown."""
        each = [one.deliveries.interval for one in self.sessions.values()]
        return 1.0 / np.array([interval or 1e9 for interval in each])

    def figures(self) -> SessionSnapshot:
        """State of the picture: of all sensors, or of the first where they have it in common.

        Each takes the same poses: refusals of these count once.
        """
        found = {name: session.figures() for name, session in self.sessions.items()}
        first, *others = found.values()
        dropped = Counter(first.dropped)
        for one in others:
            of_scans = [name for name in one.dropped if drop_reason_of(name).lost != "pose"]
            dropped.update({name: one.dropped[name] for name in of_scans})
        area, density = np.array(
            [(one.coverage_area, one.clutter_density) for one in found.values()]
        ).T
        scanned = self.rates * area
        registration = [
            f"{name}: {sensor_sentence(name, one.findings['registration'])}"
            for name, one in found.items()
            if one.findings.get("registration")
        ]
        return replace(
            first,
            dropped=dropped,
            coverage_area=float(scanned.sum() / self.rates.sum()),
            clutter_density=float(np.average(density, weights=scanned)),
            findings={**first.findings, "registration": "; ".join(registration)},
            waiting=sum(one.waiting for one in found.values()),
            scan_stamp=max(filter(None, (one.scan_stamp for one in found.values())), default=None),
        )

    def figures_of(self, sensor: str, now: Now) -> tuple[SessionSnapshot, dict[str, object]]:
        """State of a sensor at a time, s, and further figures of it: coverage, pose and age."""
        session, model = self.sessions[sensor], self.sessions[sensor].state.model
        snapshot, (farthest, said) = session.figures(), self.misalignment
        findings = {of: sensor_sentence(sensor, one) for of, one in snapshot.findings.items()}
        findings |= {
            "misalignment": said * (farthest == sensor),
            "late": self._late(session, now),
        }
        x, y, yaw = session.state.poses.middle.tolist()
        if registration_axes(self.fixed_frame) == "down":
            x, y, yaw = y, x, 0.5 * math.pi - yaw
        values: dict[str, object] = {
            "coverage": f"{model.min_range:.9g} {model.max_range:.9g} {model.azimuth_min:.9g} "
            f"{model.azimuth_max:.9g}",
            "pose": f"{x:.9g} {y:.9g} {yaw:.9g}" if session.state.scans else "",
            "last_scan": input_waited(session.deliveries.heard, now),
            "alignment": self._alignment(sensor),
        }
        totals = replace(snapshot.totals, detections=session.received)
        return replace(snapshot, totals=totals, findings=findings), values

    @property
    def misalignment(self) -> tuple[str, str]:
        """The sensor that lies farthest beside the others, and what is significant, in words.

        Nothing is known of one without a name, and nothing is significant without words.
        """
        for name, beside in self.tracker.misalignments.items():
            session = self.sessions[name]
            given = None if session.own_ship.source == "tf" else session.settings.mounting.yaw
            return name, sensor_sentence(name, beside.sentence(name, given))
        return "", ""

    def alignment_news(self) -> list[Notice]:
        """That another sensor lies beside the others, or the last one no longer does, once."""
        (name, said), before = self.misalignment, self._misaligned
        now = self.tracker.misalignments.get(before)
        if said and name != before:
            self._misaligned = name
            return [Notice("misalignment", said)]
        if now is None or now.away > 0.5 * MIN_DEVIATIONS_SAID:
            return []
        self._misaligned = ""
        return [Notice("alignment", f"{before} is in line again: {now}")]

    def _alignment(self, sensor: str) -> str:
        """How a sensor's detections lie beside those of the others, or that it is not known yet."""
        tracker, states = self.tracker, self.tracker.sensors
        if len(states) < 2:
            return "not compared: there is no other sensor"
        own, seen = 1 << states[sensor].number, tracker.seen_by(tracker.current)
        number = {name: one.alignment.number for name, one in states.items()}
        least = min(number[sensor], sorted(number.values())[-2])
        said = f"not compared yet, {least:.0f} of {MIN_SAMPLES} detections"
        if known := tracker.misalignments.get(sensor):
            said = f"compared, {known}"
        return f"{said}; shared tracks now: {np.count_nonzero((seen & own > 0) & (seen != own))}"

    @property
    def latencies(self) -> str:
        """Time from the stamps of the last scans of each sensor to their arrivals, in words."""
        return ", ".join(
            f"{name} {one.deliveries.latency:.2g} s"
            for name, one in self.sessions.items()
            if one.deliveries.latency < math.inf
        )

    def _late(self, session: Session, now: Now) -> str:
        """Says that a sensor delivers later than others wait for it; empty if it does not."""
        latencies = {one.sensor: one.deliveries.latency for one in self._living(now)}
        later = latencies.get(session.sensor, -math.inf) - min(latencies.values(), default=0.0)
        limit = session.settings.session.max_wait
        return (
            f"scans come {later:.3g} s later after their stamps than those of other sensors, which "
            f"wait {limit:g} s: raise max_wait, or compare the clocks of the sensors"
        ) * (limit < later < math.inf)


def sensor_sentence(sensor: str, sentence: str) -> str:
    """A sentence of one of several sensors, with its name in front of its parameters."""
    front = f"{sensor}." if sensor else ""
    return re.sub(r"(?<![\w.])(sensor|mounting)\.(?=[a-z])", rf"{front}\1.", sentence)


def share_picture(sessions: Mapping[str, Session]) -> SharedPicture:
    """Let the sessions of several sensors, by the names of these, run one tracker.

    Raises
    ------
    ValueError
        If they differ in an option of the tracker, or the method takes one sensor.
    """
    options = {
        name: {
            "method": session.settings.session.method,
            **asdict(session.settings.common),
            **asdict(session.settings.method_options),
        }
        for name, session in sessions.items()
    }
    (first, wanted), *others = options.items()
    for name, given in others:
        if differ := [key for key, value in wanted.items() if value != given.get(key)]:
            raise ValueError(
                f"{differ[0]} is of the whole picture, and {first} and {name} differ in it: give "
                "one value for both"
            )
    models = {name: session.settings.sensor for name, session in sessions.items()}
    picture = SharedPicture(make_initiator(**wanted, sensor=models))
    for name, session in sessions.items():
        picture.sessions[name], session.picture, session.sensor = session, picture, name
    return picture
