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
"""What scans wait for: their order, frames, own ship, external tracks and land.

A scan is classified by its stamp, as the next, late, the first of a restart or the first after a
long gap, and waits in a queue for own-ship data. It is registered in the fixed frame by the poses
of a moving sensor and the names of the frames in use. The newest messages of an external tracker
and of a chart are kept for it. Each input refuses what it cannot use; the session counts and
reports the refusals.
"""

from __future__ import annotations

import dataclasses
import enum
import math
import statistics
from collections import deque
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from tsepm_ros.numerics.arrays import BoolArray, FloatArray
from tsepm_ros.own_ship import registration
from tsepm_ros.own_ship.pose_history import (
    LONG_STEP,
    MIN_SPAN,
    FrozenCheck,
    PoseCoverage,
    PoseHistory,
    PoseSample,
    pose_jump,
)
from tsepm_ros.own_ship.registration import (
    Mounting,
    UnregisteredScan,
    registration_axes,
    registration_frame,
)
from tsepm_ros.session.drop_reasons import DROP_REASONS, Notice, Rejection, Remark
from tsepm_ros.settings.node_options import SessionOptions
from tsepm_ros.settings.settings import Settings
from tsepm_ros.tracker.clutter.fixed_places import LandMask
from tsepm_ros.tracker.options import MAX_WINDOW
from tsepm_ros.tracker.scan import MAX_MAGNITUDE, MIN_MAGNITUDE, Scan
from tsepm_ros.tracker.tracks import TrackArrays

Now = float | tuple[float, ...]
"""Time on one clock or on several, s."""
LEAP_SECONDS = np.array([18.0, 19.0, 37.0])
"""GPS time ahead of UTC, atomic time (TAI) ahead of GPS time, and of UTC, s."""
LEAP_ERROR = 0.5
"""Difference of two clocks from leap seconds, s."""
MIN_INTERVALS = 3
"""Minimum number of known intervals that distinguish a gap from a slow sonar."""
MAX_INTERVAL = 3600.0
"""Maximum time between scans while fewer intervals are known, s."""
MAX_LATE_SCANS = 3
"""Consecutive late scans with rising stamps that are a restart."""
QUEUE_LENGTH = 1000
"""Maximum number of scans that wait for own-ship data; beyond it, the oldest is dropped."""
MAX_NOTICED = 100
"""Pairs of frames that are remembered as noticed: a source may name a new frame each time."""
MAX_YAW_VARIANCE = math.pi**2
"""Variance of the heading above which the heading is unknown, rad^2."""
MAX_STATE = MAX_MAGNITUDE["sensor_pose"]
"""Largest accepted magnitude of a state component, m and m/s."""
MIN_SIGMA = MIN_MAGNITUDE["range_std"]
"""Smallest accepted standard deviation, m and m/s."""
JUMPED = ": tracks are elsewhere in the frame since, and end with the next scan; check the fixes"
OUTLIER = ": the pose is left out, as the next goes on from the one before; check the navigation"
MAX_ASYMMETRY = 1e-6
"""Largest accepted difference of two correlations that should be equal."""
MIN_EIGENVALUE = 1e-12
"""Smallest accepted eigenvalue of the correlations; below, it is due to rounding."""


def input_waited(since: Now, now: Now) -> float:
    """Minimum elapsed time over the clocks, s; a clock that was set back is ignored."""
    begins, ends = (one if isinstance(one, tuple) else (one, one) for one in (since, now))
    return min((b - a for a, b in zip(begins, ends, strict=True) if b - a >= 0.0), default=math.inf)


def last_clock(now: Now) -> float:
    """The time on the last clock, that of stamps, s."""
    return now[-1] if isinstance(now, tuple) else now


def input_leap_seconds(seconds: float) -> str:
    """A question about two clocks that differ by seconds like those of GPS time; else empty."""
    near = (np.abs(abs(seconds) - LEAP_SECONDS) <= LEAP_ERROR).any()
    return ": is it GPS time (18 s ahead of UTC) or TAI (37 s)?" if near else ""


class Arrival(enum.Enum):
    """Relation of a scan to the scans before it."""

    NEXT = "next"
    SAME_STAMP = "same_stamp"
    LATE = "late"
    FAR_BACK = "far_back"
    AHEAD = "ahead"
    RESTART = "restart"
    GAP = "gap"


class ScanInputOrder:
    """Classifies the stamps of arriving scans.

    Parameters
    ----------
    settings : Settings
        `restart_jump`: a backward step, s, above which a stamp is a restart (a looping bag, a reset
        clock) if the next stamp confirms it; a smaller step is a late scan. `max_gap`: a forward
        step, s, above which potential tracks are not continued; 0: `window` times the median
        interval of as many last scans.

    Attributes
    ----------
    settings : Settings
        May be replaced.
    """

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self._intervals: deque[float] = deque(maxlen=MAX_WINDOW)
        self._stamp: float | None = None
        self._late_stamps: list[float] = []

    def classify(self, stamp: float) -> Arrival:
        """Classify the next stamp (s) relative to the scans accepted so far.

        One that is far back is a restart if the next stamp confirms it; so are late scans in a row
        whose stamps rise.
        """
        if self._stamp is None:
            return Arrival.NEXT
        interval = stamp - self._stamp
        if interval > 0.0:
            return Arrival.GAP if interval > self.gap_limit else Arrival.NEXT
        if -interval > self.settings.session.restart_jump and interval < 0.0:
            return Arrival.FAR_BACK
        if interval == 0.0 and not self._late_stamps:
            return Arrival.SAME_STAMP
        if self._late_stamps and stamp <= self._late_stamps[-1]:
            self._late_stamps.clear()
        self._late_stamps.append(stamp)
        return Arrival.RESTART if len(self._late_stamps) >= MAX_LATE_SCANS else Arrival.LATE

    def leaps(self, stamp: float, heard: Now, since: Now) -> bool:
        """Whether a stamp (s) may be wrong: far ahead of the last accepted one.

        This is by the median interval, and by the time from the last arrival to its own (s), which
        is as long after a pause; nan or infinite if unknown.
        """
        step = math.nan if self._stamp is None else (stamp - self._stamp) / LONG_STEP
        return step > self.interval and not step <= input_waited(heard, since) < math.inf

    def settled(self, arrival: Arrival, stamp: float, following: float) -> Arrival:
        """The arrival of a stamp (s) far back or ahead, as the stamp `following` (s) tells.

        One ahead is wrong if the next goes on from before. One far back is a restart if the next is
        after it by no more than a gap, and before the last accepted stamp.
        """
        assert self._stamp is not None
        if arrival is not Arrival.FAR_BACK:
            return Arrival.AHEAD if self._stamp < following < stamp else arrival
        near = following - stamp <= max(self.gap_limit, MAX_INTERVAL)
        return Arrival.RESTART if stamp < following < self._stamp and near else arrival

    def accept(self, stamp: float, arrival: Arrival) -> None:
        """Continue from a processed scan; a dropped scan does not change the order."""
        self._late_stamps.clear()
        if arrival is Arrival.NEXT and self._stamp is not None:
            self._intervals.append(stamp - self._stamp)
        elif arrival in (Arrival.RESTART, Arrival.GAP):
            self._intervals.clear()  # the sonar may have changed its period
        self._stamp = stamp

    @property
    def interval(self) -> float:
        """The median of the last intervals, s; infinite while fewer are known."""
        last = list(self._intervals)[-self.settings.window :]
        return statistics.median(last) if len(last) >= MIN_INTERVALS else math.inf

    @property
    def gap_limit(self) -> float:
        """The gap, s, above which potential tracks are not continued."""
        limit = self.settings.session.max_gap or self.settings.window * self.interval
        return limit if limit < math.inf else MAX_INTERVAL


UNUSABLE = {
    Arrival.SAME_STAMP: "not later than the last scan's",
    Arrival.LATE: "not later than the last scan's",
    Arrival.FAR_BACK: "not later than the last scan's",
    Arrival.AHEAD: "later than the next scan's",
}
"""Classifications of scans that are dropped, and what is wrong with their stamps."""


class Waiting(NamedTuple):
    """The first scan in the queue.

    Attributes
    ----------
    scan : UnregisteredScan
    arrival : Arrival
    seconds : float
        Time that it waited, s.
    refusal : Rejection or None
        Of a scan whose stamp does not permit processing.
    """

    scan: UnregisteredScan
    arrival: Arrival
    seconds: float
    refusal: Rejection | None


class ScanInputQueue:
    """Scans from their arrival until they are processed or dropped.

    Parameters
    ----------
    settings : Settings

    Attributes
    ----------
    order : ScanInputOrder
        Of the scans processed so far.
    scans : deque
        Times of arrival, and the scans that wait.
    refused : Rejection or None
        Of the first scan, by its place among those of other sensors.
    """

    def __init__(self, settings: Settings) -> None:
        self.order = ScanInputOrder(settings)
        self.scans: deque[tuple[Now, UnregisteredScan]] = deque()
        self._arrival: Arrival | None = None  # of the first
        self._heard: Now = math.nan  # of the last one that was removed
        self.refused: Rejection | None = None

    @property
    def newest_stamp(self) -> float | None:
        """Stamp of the waiting scan that arrived last, s."""
        return self.scans[-1][1].scan.stamp if self.scans else None

    def add(self, arrived: UnregisteredScan, now: Now) -> Rejection | None:
        """Add a scan that arrived at `now`, s; refuse the oldest scan if the queue is full."""
        self.scans.append((now, arrived))
        if len(self.scans) <= QUEUE_LENGTH:
            return None
        self.remove_first()
        return Rejection("queue_full", f"more than {QUEUE_LENGTH} scans wait for own-ship data")

    def first(self, now: Now, *, last: bool) -> Waiting | None:
        """The first scan in the queue, classified by its stamp.

        If the stamp is far back or ahead, the next scan's stamp distinguishes a clock that was set
        from a bad stamp.

        Parameters
        ----------
        now : float or tuple of float
            s.
        last : bool
            Whether no further scan follows.

        Returns
        -------
        Waiting or None
            None if the queue is empty, or the classification needs the next scan.
        """
        if self._arrival is None and self.scans:
            self._arrival = self._classify(last)
        if self._arrival is None:
            return None
        (since, scan), refusal = self.scans[0], self.refused
        if self._arrival in UNUSABLE:
            stamp = scan.scan.stamp
            reason = "stamp_not_set" if stamp == 0.0 else f"scan_{self._arrival.value}"
            fault = "not set" if stamp == 0.0 else UNUSABLE[self._arrival]
            refusal = Rejection(reason, f"the stamp of a scan, {stamp:.3f} s, is {fault}")
        return Waiting(scan, self._arrival, input_waited(since, now), refusal)

    def remove_first(self) -> None:
        """Remove the first scan."""
        self._heard, _ = self.scans.popleft()
        self._arrival = self.refused = None

    def _classify(self, last: bool) -> Arrival | None:
        """Classify the first scan's stamp; None if that needs the next scan."""
        since, arrived = self.scans[0]
        stamp = arrived.scan.stamp
        arrival = self.order.classify(stamp)
        if arrival is not Arrival.FAR_BACK and not self.order.leaps(stamp, self._heard, since):
            return arrival
        if len(self.scans) == 1:
            return arrival if last else None
        since, following = self.scans[1]
        self.scans[0] = since, arrived  # its wait for own-ship data begins only now
        return self.order.settled(arrival, stamp, following.scan.stamp)


class InputFrames:
    """The frames in use: from the options, else from the first messages.

    Parameters
    ----------
    options : SessionOptions

    Attributes
    ----------
    options : SessionOptions
        May be replaced; the frames in use stay.
    fixed, sensor, own_ship : str
        Frame of the tracks, of the detections and of the vessel; empty while unknown.
    """

    def __init__(self, options: SessionOptions) -> None:
        self.options = options
        self._moves = options.own_ship_source != "none"
        self._noticed: deque[tuple[str, str]] = deque(maxlen=MAX_NOTICED)
        self.fixed = self.options.fixed_frame.lstrip("/")  # as tf2
        self.sensor = self.options.sensor_frame.lstrip("/")
        self.own_ship = ""

    def admit(
        self,
        arrived: UnregisteredScan,
        max_detections: int,
        others: Mapping[str, str] = MappingProxyType({}),
        *,
        mounted: bool = False,
    ) -> tuple[UnregisteredScan, Rejection | None]:
        """A scan with its frame, which is adopted; or a refusal of its size or frame.

        An empty frame becomes the frame of the options, if any. A frame of `others` is that of
        another sensor, of this name. Of a sensor at rest the mounting relates its frame, if given,
        to the fixed one.
        """
        if not arrived.frame_id:
            given = self.options.sensor_frame or ("" if self._moves else self.options.fixed_frame)
            arrived = dataclasses.replace(arrived, frame_id=given.lstrip("/"))
        frame_id = arrived.frame_id
        if not frame_id:
            return arrived, Rejection(
                "empty_frame", "the frame_id of the detections is empty, and so is sensor_frame"
            )
        stem = registration_frame(frame_id)
        expected = [(self.sensor, [frame_id])]
        if not (self._moves or arrived.north_referenced or mounted):
            # No pose relates another sensor frame to it.
            expected.append((self.fixed, [frame_id, stem]))
        whose = "" if frame_id == self.sensor else others.get(frame_id, "")
        for frame, names in expected:
            if whose or (frame and frame not in names):
                of_other = f", that of {whose}: are topics exchanged?" if whose else ""
                expected_frame = f", expected {frame!r}" if frame else ""
                return arrived, Rejection(
                    "unknown_frame",
                    f"detections are in frame {frame_id!r}{expected_frame}{of_other}",
                )
        refusal = refuse_input_size(arrived, max_detections)
        if refusal is None:
            self.sensor = frame_id
            if not self.fixed and not self._moves:
                self.fixed = stem
        return arrived, refusal

    def take_pose(self, sample: PoseSample) -> Rejection | None:
        """Adopt the frames of own-ship data, or refuse them."""
        frame = sample.frame_id or self.options.fixed_frame.lstrip("/")
        if not frame:
            return Rejection(
                "own_ship_empty_frame",
                "the frame_id of the own-ship data is empty, and so is fixed_frame",
            )
        self.fixed = self.fixed or frame
        if frame != self.fixed:
            return Rejection(
                "own_ship_frame",
                f"own-ship data is in frame {frame!r}, the fixed frame is {self.fixed!r}",
            )
        self.own_ship = sample.child_frame_id
        return None

    def mounting_state(self, mounting: Mounting, own_ship: OwnShipInput) -> str:
        """Whether the mounting is given, assumed, not needed or unknown yet."""
        if mounting.given:
            return "given"
        if own_ship.source != "odometry":
            return "not needed"
        if not self.sensor or own_ship.poses.last_stamp is None:
            return "unknown"
        coincide = registration_frame(self.own_ship) == registration_frame(self.sensor)
        return "not needed" if coincide else "assumed"

    def notices(self, mounting: Mounting) -> list[Notice]:
        """Notices of how frames are read by their names, and the mounting, once for each pair."""
        own_ship, sensor, fixed = self.own_ship, self.sensor, self.fixed
        pair = (own_ship, sensor) if self._moves else (fixed, sensor)
        if pair in self._noticed or not fixed:
            return []
        self._noticed.append(pair)
        stem, down = registration_frame(sensor), registration_axes(fixed) == "down"
        said = [
            (
                down,
                "fixed_frame",
                f"tracks have x north and y east, as {fixed!r} says",
            ),
            (
                not (down or self._moves or stem == sensor),
                "fixed_frame",
                f"the name of frame {sensor!r} states its axes (REP-103): tracks are in frame "
                f"{fixed!r}, x ahead, y to port and z up from the same origin",
            ),
            (
                mounting.given and registration_axes(own_ship) != "body",
                "mounting",
                "mounting.y is to port, mounting.yaw counter-clockwise from the bow, whatever "
                f"{own_ship!r} says",
            ),
            (
                bool(own_ship) and registration_frame(own_ship) != stem and not mounting.given,
                "mounting",
                f"own-ship data is for frame {own_ship!r}, detections are in {sensor!r}: "
                "mounting.x, y, yaw and roll are 0, so the frames coincide",
            ),
        ]
        return [Notice(subject, sentence) for applies, subject, sentence in said if applies]


def refuse_input_size(arrived: UnregisteredScan, limit: int) -> Rejection | None:
    """Refuse a scan with more detections than the limit."""
    number = len(arrived.scan)
    if number <= limit:
        return None
    return Rejection(
        "too_many_detections",
        f"a scan has {number} detections, more than max_detections = {limit}",
    )


LookUp = Callable[[str, float, float, str], str]
ReadUnread = Callable[[], bool]


class OwnShipInput:
    """The poses of a moving sensor, and whether they cover a scan's time.

    Parameters
    ----------
    options : SessionOptions

    Attributes
    ----------
    source : str
        Source of own-ship data; fixed at the start.
    moves : bool
        Whether the sensor moves in the fixed frame; if not, no scan needs a pose.
    poses : PoseHistory
    frozen : FrozenCheck
    restarted : bool
        Whether the poses were restarted since the last processed scan.
    look_up : callable or None
        Called as ``look_up(sensor frame, first, last, axes)`` with the time span (s) of a scan, to
        add its poses; returns what is missing, in words. None if poses arrive as messages.
    read_unread : callable or None
        Adds the oldest pose that has arrived and is unread, if any; returns whether there was one.
        None if no pose can be unread.
    """

    def __init__(self, options: SessionOptions) -> None:
        self.source = options.own_ship_source
        self.moves = self.source != "none"
        self.poses = PoseHistory()
        self.reset()
        self.look_up: LookUp | None = None
        self.read_unread: ReadUnread | None = None
        self._missing = ""
        self.configure(options)

    def _forget_steps(self) -> None:
        self.frozen = FrozenCheck()
        self._odd: tuple[PoseSample, str] | None = None  # after a jump, until the next pose tells
        self._jump: tuple[PoseSample, PoseSample] | None = None  # before the first, after the last

    def configure(self, options: SessionOptions) -> None:
        """Change the limits on times."""
        self._options = options
        poses, waits = self.poses, options.own_ship_timeout + options.max_wait
        poses.max_extrapolation = options.own_ship_max_extrapolation
        poses.max_gap, poses.min_span = options.own_ship_max_gap, MIN_SPAN + waits

    def reset(self) -> None:
        """Discard the poses."""
        self.poses.clear()
        self._forget_steps()
        self.restarted = False

    def add(self, sample: PoseSample) -> list[Remark]:
        """Add a sample, or refuse an invalid or a late one; one far back restarts the poses.

        So do late samples alone for longer than the timeout, with a notice. A sample after a jump,
        of its pose or of its stamp, waits for the next: if that goes on from before, the sample is
        refused. A stamp jumps only where the next is expected before a scan's wait ends, and not
        where poses are asked for by their stamps.
        """
        try:
            sample.check()
        except ValueError as error:
            return [Rejection("own_ship_invalid", f"own-ship data dropped: {error}")]
        sample = dataclasses.replace(sample, stamp=sample.stamp - self._options.own_ship_delay)
        if self._is_ahead(sample.stamp):
            self.restart(sample.stamp)
        remarks = self._settled(sample)
        longest = 0.0 if self.source == "tf" else self._options.own_ship_timeout
        if words := pose_jump(self.poses.newest, sample) or self.poses.stamp_jump(sample, longest):
            self._odd = sample, words
            return remarks
        if self.poses.add(sample):
            found = self.frozen.take(sample)
            return remarks + [Notice("own_ship_frozen", found)] * bool(found)
        remarks += [
            Rejection(
                "own_ship_late",
                f"own-ship data at {sample.stamp:.3f} s is not newer than the last sample",
            )
        ]
        if self.poses.late_span > self._options.own_ship_timeout:
            self.restart(sample.stamp)
            remarks.append(
                Notice("own_ship_restart", f"own-ship data restarts at {sample.stamp:.3f} s")
            )
        return remarks

    def _settled(self, sample: PoseSample) -> list[Remark]:
        """Whether a pose after a jump is used, as the next one tells; the same again does not."""
        if self._odd is None or sample.stamp == self._odd[0].stamp:
            return []
        (odd, words), self._odd, before = self._odd, None, self.poses.newest
        assert before is not None
        off, off_odd = (self.poses.off_path(one, one.stamp - before.stamp) for one in (sample, odd))
        goes_on = before.stamp < sample.stamp < odd.stamp and off <= off_odd
        if goes_on or pose_jump(odd, sample):
            return [Rejection("own_ship_outlier", words + OUTLIER)]
        self.poses.add(odd)
        if not pose_jump(before, odd):
            return []
        self.frozen = FrozenCheck()
        self._jump = self._jump[0] if self._jump else before, odd
        return [Notice("own_ship_jump", words + JUMPED)]

    def has_jumped(self, stamp: float) -> bool:
        """Whether own ship is elsewhere at a stamp (s), by the jumps since it was asked last."""
        if self._jump is None or stamp < self._jump[1].stamp:
            return False
        jump, self._jump = self._jump, None
        return bool(pose_jump(*jump))

    def restart(self, stamp: float) -> None:
        """Restart at a stamp (s): earlier poses are not used for later scans."""
        self._forget_steps()
        self.poses.start_over()
        if self._is_ahead(stamp):
            self.poses.clear()
        self.restarted = True

    def without_late_echoes(
        self, arrived: UnregisteredScan
    ) -> tuple[UnregisteredScan, Rejection | None]:
        """Leave out the echoes at times for which a moving sensor's scan would wait in vain."""
        usable = registration.registration_echoes(arrived)
        lost = len(usable) - int(np.count_nonzero(usable))
        if not lost:
            return arrived, None
        return registration.selected_for_registration(arrived, usable), Rejection(
            "echo_too_late",
            f"{lost} detections dropped: {registration.MAX_ECHO_TIME:g} s or more from their ping",
            lost,
        )

    def must_wait(self, arrived: UnregisteredScan, waiting: float) -> bool:
        """Whether a scan that waited for a time (s) needs poses that may still arrive."""
        first, last = registration.registration_span(arrived)
        if self.look_up is not None:
            self._missing = self.look_up(arrived.frame_id, first, last, arrived.axes)
        if self.poses.coverage(first, last) is not PoseCoverage.NOT_YET:
            return False
        if waiting < self._options.own_ship_timeout:
            return True
        self._read_unread(first, last)
        return False

    def _read_unread(self, first: float, last: float) -> None:
        """Read unread poses until they cover a time span, s, or belong to another run."""
        while self.read_unread and self.poses.coverage(first, last) is PoseCoverage.NOT_YET:
            newest = self.poses.last_stamp
            if not self.read_unread():
                return
            now = self.poses.last_stamp
            if newest is not None and (now is None or now < newest):
                return

    def refuse(self, arrived: UnregisteredScan) -> Rejection | None:
        """Refuse a scan that need not wait and has no poses."""
        first, last = registration.registration_span(arrived)
        if self._jump and self._jump[0].stamp < last and first < self._jump[1].stamp:
            return Rejection(
                "own_ship_jump", f"own ship jumps in the scan at {arrived.scan.stamp:.3f} s"
            )
        coverage = self.poses.coverage(first, last)
        reaches = coverage is PoseCoverage.YES or self.poses.can_extrapolate(last)
        if coverage is not PoseCoverage.NEVER and reaches:
            return None
        reason = "own_ship_stale" if len(self.poses) else "own_ship_missing"
        sentence = f"no own-ship data for the scan at {arrived.scan.stamp:.3f} s"
        oldest, newest = self.poses.first_stamp, self.poses.last_stamp
        if oldest is not None and newest is not None:
            which, stamp = ("oldest", oldest) if last < oldest else ("newest", newest)
            side = "before" if stamp < last else "after"
            sentence += f", the {which} is {abs(stamp - last):.3g} s {side} its last echo"
            sentence += input_leap_seconds(newest - last)
        return Rejection(reason, f"{sentence}: {self._missing}" if self._missing else sentence)

    def _is_ahead(self, stamp: float) -> bool:
        last = self.poses.last_stamp
        return last is not None and last - stamp > self._options.restart_jump


def register_input(
    arrived: UnregisteredScan, own_ship: OwnShipInput, frames: InputFrames, settings: Settings
) -> tuple[Scan | None, list[Remark]]:
    """Register a scan in the fixed frame.

    Parameters
    ----------
    arrived : UnregisteredScan
    own_ship : OwnShipInput
        The poses of a moving sensor.
    frames : InputFrames
    settings : Settings

    Returns
    -------
    scan : Scan or None
        None if the scan is refused.
    remarks : list of Rejection or Notice
        Of the scan, and of detections that are left out.
    """
    mounting, sensor = settings.mounting, settings.sensor
    remarks: list[Remark] = [*frames.notices(mounting)]
    refusal = _refuse_heading(arrived, own_ship, settings)
    if refusal is not None:
        return None, [*remarks, refusal]
    if own_ship.moves:
        try:
            scan = registration.register_in_fixed_frame(
                arrived, own_ship.poses, mounting, sector=not sensor.all_round
            )
        except registration.PosesJumpError as error:
            return None, [*remarks, Rejection("own_ship_jump", str(error))]
    else:
        down = registration_axes(frames.fixed) == "down"
        scan = registration.register_at_rest(arrived, mounting, 0.5 * math.pi if down else 0.0)
    lost = len(arrived.scan) - len(scan)
    if lost:
        remarks.append(
            Rejection(
                "no_horizontal_range",
                f"{lost} detections dropped: vertically above or below the tilted sensor",
                lost,
            )
        )
    if sensor.range_rate_std:
        before, after = (
            int(np.isfinite(each_scan.features.get("range_rate", ())).sum())
            for each_scan in (arrived.scan, scan)
        )
        if before > after:
            remarks.append(
                Notice(
                    "range_rate_unused",
                    f"{before - after} range rates not used: the line of sight is too steep, or "
                    "the sensor's velocity is unknown",
                )
            )
    return scan, remarks


def _refuse_heading(
    arrived: UnregisteredScan, own_ship: OwnShipInput, settings: Settings
) -> Rejection | None:
    """Refuse a scan that needs a heading if the heading is unknown."""
    # The sector is relative to the bow, so azimuths from north need the heading.
    sector = not settings.sensor.all_round
    if not own_ship.moves:
        if sector and arrived.north_referenced:
            return Rejection(
                "heading_unknown", "bearings from north need a heading if the coverage is a sector"
            )
        return None
    needed = sector or not arrived.north_referenced or settings.mounting.offset
    covariance = own_ship.poses.covariance(arrived.scan.stamp)
    if not needed or covariance is None or covariance[2, 2] <= MAX_YAW_VARIANCE:
        return None
    return Rejection(
        "heading_unknown", "the detections need a heading, which the own-ship data does not have"
    )


@dataclasses.dataclass(frozen=True, eq=False)
class TrackerReport:
    """Everything that a downstream tracker tracks at a time.

    Attributes
    ----------
    stamp : float
        s.
    frame_id : str
        Frame of the states.
    tracks : TrackArrays
        With stamps of their own.
    unusable : tuple of int, optional
        Ids of those that were left out, as their figures cannot be used.
    """

    stamp: float
    frame_id: str
    tracks: TrackArrays
    unusable: tuple[int, ...] = ()


def usable_input_tracks(tracks: TrackArrays) -> tuple[TrackArrays, dict[str, int]]:
    """The tracks that can be held, and the number of the dropped tracks by reason.

    Parameters
    ----------
    tracks : TrackArrays

    Returns
    -------
    tracks : TrackArrays
        With symmetric covariances.
    dropped : dict of str to int
        ``tracked_not_finite``: stamp, state or covariance is not finite, or beyond `MAX_STATE`;
        ``tracked_bad_covariance``: not symmetric and positive definite, or a standard deviation
        below `MIN_SIGMA`; ``tracked_duplicate_id``: of several with an id the first is kept.
    """
    finite = bounded_input_tracks(tracks)
    valid = finite.copy()
    valid[finite] = _proper_covariance(tracks.covariance[finite])
    _, first = np.unique(tracks.track_id[valid], return_index=True)
    kept = np.flatnonzero(valid)[np.sort(first)]
    counts = {
        "tracked_not_finite": (~finite).sum(),
        "tracked_bad_covariance": finite.sum() - valid.sum(),
        "tracked_duplicate_id": valid.sum() - len(kept),
    }
    usable_tracks = tracks.where(kept)
    symmetric = 0.5 * (usable_tracks.covariance + np.swapaxes(usable_tracks.covariance, 1, 2))
    dropped = {reason: int(number) for reason, number in counts.items() if number}
    return dataclasses.replace(usable_tracks, covariance=symmetric), dropped


def bounded_input_tracks(tracks: TrackArrays) -> BoolArray:
    """Which tracks have a finite stamp, and a state and a covariance within `MAX_STATE`."""
    finite = np.isfinite(tracks.stamp) & (np.abs(tracks.state) <= MAX_STATE).all(axis=1)
    return np.asarray(finite & (np.abs(tracks.covariance) <= MAX_STATE**2).all(axis=(1, 2)))


def _proper_covariance(covariance: FloatArray) -> BoolArray:
    """Which of the finite matrices (n, 4, 4) are covariances."""
    variance = np.diagonal(covariance, axis1=1, axis2=2)
    sigma = np.sqrt(np.maximum(variance, MIN_SIGMA**2))
    correlation = covariance / (sigma[:, :, None] * sigma[:, None, :])
    skew = np.abs(correlation - np.swapaxes(correlation, 1, 2)).max(axis=(1, 2))
    least = np.linalg.eigvalsh(correlation).min(axis=1)
    proper = (variance >= MIN_SIGMA**2).all(axis=1)
    return np.asarray(proper & (skew <= MAX_ASYMMETRY) & (least > MIN_EIGENVALUE))


class ExternalTrackerInput:
    """The newest report of the downstream tracker, until a scan uses it."""

    def __init__(self) -> None:
        self._report: TrackerReport | None = None
        self._stamp = -math.inf

    def add(self, report: TrackerReport, fixed: str, restart_jump: float) -> list[Rejection]:
        """Take a report; return refusals of it, or of its targets.

        Parameters
        ----------
        report : TrackerReport
        fixed : str
            The fixed frame; empty while unknown.
        restart_jump : float
            A larger step back, s, is a restart; a smaller one a late report.
        """
        if fixed and report.frame_id != fixed:
            return [_in_another_frame(report, fixed)]
        if 0.0 < self._stamp - report.stamp <= restart_jump:
            return [
                Rejection("tracked_late", f"tracked targets at {report.stamp:.3f} s arrived late")
            ]
        tracks, dropped = usable_input_tracks(report.tracks)
        unusable = tuple(np.setdiff1d(report.tracks.track_id, tracks.track_id).tolist())
        self._report = dataclasses.replace(report, tracks=tracks, unusable=unusable)
        self._stamp = report.stamp
        ids = f", with ids {', '.join(map(str, unusable))}" if unusable else ""
        return [
            Rejection(
                reason,
                f"{number} tracked targets dropped{ids}: {DROP_REASONS[reason].meaning}",
                number,
            )
            for reason, number in dropped.items()
        ]

    def at(
        self, stamp: float, last: float | None, fixed: str, timeout: float
    ) -> tuple[TrackerReport | None, list[Remark]]:
        """Remove and return the report for the scan at a stamp, s; or refuse it.

        It is refused if its stamp is not within the timeout, s, of the scan, of the last one before
        it, which it may answer, or between them.
        """
        report, self._report = self._report, None
        if report is None:
            return None, []
        if report.frame_id != fixed:
            return None, [_in_another_frame(report, fixed)]
        if (stamp if last is None else last) - timeout <= report.stamp <= stamp + timeout:
            return report, []
        self._stamp = -math.inf  # later reports are not late relative to it
        return None, [
            Rejection(
                "tracked_stale",
                f"tracked targets at {report.stamp:.3f} s do not match the time of the scan at "
                f"{stamp:.3f} s",
            )
        ]


def _in_another_frame(report: TrackerReport, fixed: str) -> Rejection:
    return Rejection(
        "tracked_frame",
        f"tracked targets are in frame {report.frame_id!r}, the fixed frame is {fixed!r}",
    )


class LandInput:
    """The newest chart, from its arrival until the fixed frame is known.

    Attributes
    ----------
    mask : LandMask or None
        The chart in use.
    new : tuple of LandMask or None and str, or None
        A chart to come, None if it is empty, and its frame.
    """

    def __init__(self) -> None:
        self.mask: LandMask | None = None
        self.new: tuple[LandMask | None, str] | None = None
        self._frame = ""

    def reset(self) -> None:
        """Wait for the fixed frame again: a chart is published once."""
        self.new = self.new or (self.mask, self._frame)
        self.mask = None

    def settle(self, fixed: str) -> list[Remark]:
        """Use or refuse the newest chart, once the fixed frame is known; it replaces the last."""
        if self.new is None or not fixed:
            return []
        (mask, frame), self.new = self.new, None
        if mask is None:
            had, self.mask = self.mask is not None, None
            return [Notice("land", "land is empty: no detections are left out")] if had else []
        if frame != fixed:
            return [
                Rejection("land_frame", f"land is in frame {frame!r}, the fixed frame is {fixed!r}")
            ]
        self.mask, self._frame = mask, frame
        used = f"{mask.cells} cells of {mask.resolution:g} m"
        return [Notice("land", f"land: detections on {used} are left out")]
