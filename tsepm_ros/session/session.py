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
"""From arriving messages to results, without ROS, for the node and offline replays.

A session takes own-ship poses, scans and a downstream tracker's reports as they arrive. Each scan
passes the same steps::

    messages -> put together, where they are parts of a sweep -> queue
    first of the queue -> classified by its stamp -> waits for own-ship data
        -> registered in the fixed frame -> processed by the initiator -> result

or is dropped with a reason. The parts return refusals; only the session counts and reports them.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

from tsepm_ros.numerics.arrays import replaced
from tsepm_ros.own_ship.pose_history import PoseSample
from tsepm_ros.own_ship.registration import UnregisteredScan, exchanged_after_registration
from tsepm_ros.session.consistency_checks import (
    LossCheck,
    MessageCheck,
    RepetitionCheck,
    SensorCheck,
    SensorFigures,
    check_findings,
)
from tsepm_ros.session.drop_reasons import Notice, Rejection, Remark, shortened_reason
from tsepm_ros.session.inputs import (
    Arrival,
    ExternalTrackerInput,
    InputFrames,
    Now,
    OwnShipInput,
    ScanInputQueue,
    TrackerReport,
    Waiting,
    refuse_input_size,
    register_input,
)
from tsepm_ros.session.registration_check import RegistrationCheck
from tsepm_ros.session.shared_picture import ScanDeliveries, SharedPicture
from tsepm_ros.session.sweep import Sweep
from tsepm_ros.settings.settings import Settings
from tsepm_ros.tracker.clutter.fixed_places import FixedPlaces, LandMask
from tsepm_ros.tracker.maintenance.confirmed_tracks import ConfirmedTracks
from tsepm_ros.tracker.maintenance.track_maintenance import ExternalTracker
from tsepm_ros.tracker.method import ScanStatistics
from tsepm_ros.tracker.options import CommonOptions
from tsepm_ros.tracker.scan import Scan
from tsepm_ros.tracker.sensor_alignment import Alignment
from tsepm_ros.tracker.sensor_state import SensorState
from tsepm_ros.tracker.tracker import Tracker
from tsepm_ros.tracker.tracks import TrackArrays, TrackStatus


@dataclass(frozen=True, kw_only=True)
class SessionSnapshot:
    """State of a session.

    Attributes
    ----------
    totals : ScanStatistics
        Sums since the start or the last reset.
    potential_tracks : int
        Number of potential tracks.
    tracks : int
        Number of published confirmed tracks.
    states : mapping of str to int
        Number of confirmed tracks by the name of their `TrackStatus`.
    ends : mapping of str to int
        Number of tracks that ended since the start or the last reset, by the reason, a key of
        `track_maintenance.ENDS`.
    fixed_echoes : int
        Number of fixed echoes.
    dropped : mapping of str to int
        Drops by reason.
    waiting : int
        Number of scans that wait for own-ship data.
    detection_probability, detection_probability_estimated : float
        The value in use, and the estimate from the confirmed tracks.
    clutter_density : float
        The density in use, mean over `coverage_area`, 1/m^2.
    clutter_given : bool
        Whether that is a given density, not a learned one.
    coverage_area : float
        Area to which that density refers, m^2.
    findings : mapping of str to str
        What does not fit now, a sentence by subject: of the sensor's figures as given, see
        `check_findings`, of the `registration` of what stands, and of the `own_ship_frozen`; empty
        where it does.
    sensor_figures : SensorFigures
        Learned figures beside those that are given.
    own_ship_source : str
    mounting : str
        Whether the mounting is given, assumed, not needed or unknown.
    mounting_yaw : float
        As given, rad.
    own_ship_stamp, scan_stamp : float or None
        Newest stamps, s.
    tracker : str
        State of the downstream tracker: a value of `ExternalTracker`.
    tracker_lag : float
        Time from the stamp of its last report to the last scan, s; infinite: none.
    tracker_silence : float
        The same to the last scan but one, which it could answer, s; nan: none.
    intensity : str
        Whether the amplitudes of detections count, in words.
    land_area : float
        Area of the land whose detections are left out, m^2.
    sweep : str
        How scans are made of messages, in words.
    sweep_latency : float
        Time from the first message of the last scan to its completion, s.
    """

    totals: ScanStatistics
    potential_tracks: int
    tracks: int
    fixed_echoes: int
    dropped: Mapping[str, int]
    waiting: int
    detection_probability: float
    detection_probability_estimated: float
    clutter_density: float
    clutter_given: bool = True
    coverage_area: float
    findings: Mapping[str, str] = field(default_factory=dict)
    sensor_figures: SensorFigures = field(default_factory=SensorFigures)
    own_ship_source: str
    mounting: str
    own_ship_stamp: float | None
    scan_stamp: float | None
    tracker: str
    states: Mapping[str, int] = field(default_factory=dict)
    ends: Mapping[str, int] = field(default_factory=dict)
    intensity: str = "not used"
    land_area: float = 0.0
    sweep: str = "a message is a scan"
    sweep_latency: float = 0.0
    mounting_yaw: float = 0.0
    tracker_lag: float = math.inf
    tracker_silence: float = math.nan


@dataclass(frozen=True)
class ScanResult:
    """The result of one processed scan: scan and tracks in east and north, see `in_frame`.

    Attributes
    ----------
    stamp : float
        The scan's stamp, s.
    stamp_ns : int
        The stamp as received, ns.
    scan : Scan
        The registered scan, with its sensor pose.
    frame_id : str
        The fixed frame.
    arrival : Arrival
        Relation to the scans before it; RESTART discarded all tracks, GAP the potential tracks.
    new : TrackArrays
        Newly confirmed tracks.
    revised : TrackArrays
        Confirmed tracks that starts continued, under their ids.
    confirmed : ConfirmedTracks
        All confirmed tracks, published or not, at `stamp`, in east and north.
    common : CommonOptions
        By which they stand still.
    ended : dict of int to str
        Tracks that ended: their ids, and the reason of each, see `track_maintenance.ENDS`.
    statistics : ScanStatistics
        The initiator's counts.
    core_seconds : float
        Computing time of the initiator, s.
    waiting : float
        Time that the scan waited for own-ship data, s; infinite if `Session.process` got no time.
    axes : str
        Frame in whose axes tracks are; empty: east and north.
    """

    stamp: float
    stamp_ns: int
    scan: Scan
    frame_id: str
    arrival: Arrival
    new: TrackArrays
    revised: TrackArrays
    confirmed: ConfirmedTracks
    common: CommonOptions
    ended: dict[int, str]
    statistics: ScanStatistics
    core_seconds: float
    waiting: float
    axes: str = ""

    @cached_property
    def current(self) -> TrackArrays:
        """All published confirmed tracks, at `stamp`."""
        tracks = self.confirmed.stated(self.common).published.proper()
        return exchanged_after_registration(tracks, self.axes)

    @cached_property
    def fixed_echoes(self) -> TrackArrays:
        """Fixed echoes, with `min_speed`, at `stamp`."""
        tracks = self.confirmed.stated(self.common).fixed_echoes.proper()
        return exchanged_after_registration(tracks, self.axes)

    @property
    def starts(self) -> TrackArrays:
        """New tracks and continued ones, as they go out on the topic `tracks`."""
        return TrackArrays.joined(self.new, self.revised) if len(self.revised) else self.new

    def in_frame(self) -> ScanResult:
        """The result with tracks in the axes of the fixed frame, for everything that names it."""
        return replaced(
            self,
            new=exchanged_after_registration(self.new, self.frame_id),
            revised=exchanged_after_registration(self.revised, self.frame_id),
            axes=self.frame_id,
        )


class Session:
    """Orders and registers scans and runs the tracker on them.

    Parameters
    ----------
    settings : Settings
        Method, options, sensor and frames.
    report : callable, optional
        Called as ``report(reason, sentence)`` for every drop, which is counted in `dropped`, and
        every notice: a restart, a change of the downstream tracker, or a question.
    live : bool, optional
        Whether `max_scan_time` is applied.

    Attributes
    ----------
    settings : Settings
        In use; changed by `configure`.
    tracker : Tracker
        In use.
    picture : SharedPicture
        What it has in common with the sessions of other sensors, of several.
    sensor : str
        Name of the sensor, of several.
    dropped : Counter
        Drops by reason since the start or the last reset.
    arrived_stamp, arrivals : float or None, int
        Stamp of the last arrived scan, s, and their number, dropped or not; of complete sweeps.
    deliveries : ScanDeliveries
        When scans arrived.
    received : int
        Detections of the sensor that were processed since the start or the last reset.
    restarts : int
        Those of the picture that the sensor has followed.
    own_ship : OwnShipInput
        Poses; `look_up` and `read_unread` are set where poses must be fetched.
    """

    def __init__(
        self,
        settings: Settings,
        report: Callable[[str, str], None] = lambda reason, sentence: None,
        *,
        live: bool = False,
    ) -> None:
        self._report = report
        self._live = live
        self.settings = settings
        self.picture, self.sensor = SharedPicture(settings.make_tracker()), ""
        self.picture.sessions[""] = self
        self.own_ship = OwnShipInput(settings.session)
        self._message_check = MessageCheck()
        self._amplitudes_count = False
        self.arrivals, self.deliveries = 0, ScanDeliveries()
        self._start()

    def _start(self) -> None:
        """Begin without scans, reports and counts."""
        self.dropped: Counter[str] = Counter()
        self.picture.start()
        self.received = self.restarts = 0
        self._losses = LossCheck()
        # Of messages, and of scans.
        self._repetitions = RepetitionCheck(self.drop), RepetitionCheck(self.drop)
        self._sensor_check = SensorCheck()
        self._registration = RegistrationCheck(self.settings.session.own_ship_delay)
        self.arrived_stamp: float | None = None
        self.queue = ScanInputQueue(self.settings)
        self._sweep = Sweep(self.settings)
        self.frames = InputFrames(self.settings.session)

    @property
    def tracker(self) -> Tracker:
        """In use."""
        return self.picture.tracker

    @property
    def state(self) -> SensorState:
        """What the tracker has of the sensor."""
        return self.tracker.sensors[self.sensor]

    @property
    def fixed_frame(self) -> str:
        """Frame of the tracks; empty while unknown."""
        return self.frames.fixed

    @property
    def unfinished(self) -> bool:
        """Whether scans wait: for own-ship data, the next scan, or the end of their sweep."""
        return bool(self.queue.scans) or (self._sweep.active and self._sweep.is_open)

    @property
    def totals(self) -> ScanStatistics:
        """Sums over the scans since the start or the last `reset`, restarts included."""
        return self.picture.totals_before + self.tracker.totals

    def configure(self, settings: Settings) -> bool:
        """Change settings before the next scan; frames and the own-ship source do not change.

        An error leaves the settings unchanged.

        Returns
        -------
        bool
            Whether potential tracks were kept. A change of the method or of the number of hits
            discards them.
        """
        self.picture.tracker, kept = self.tracker.with_settings(settings.make_method(), self.sensor)
        if settings.mounting != self.settings.mounting:
            for state in self.tracker.sensors.values():  # as beside the mounting before
                state.alignment = Alignment()
        self.settings = self._sweep.settings = self.queue.order.settings = settings
        self._sensor_check.say_again()
        self.own_ship.configure(settings.session)
        self.frames.options = settings.session
        return kept

    def validate(self, settings: Settings) -> None:
        """Raise the errors of `configure`, without a change."""
        self.tracker.with_settings(settings.make_method(), self.sensor)

    def reset(self) -> None:
        """Discard scans, tracks, poses and counts."""
        self.picture.forget()
        self.own_ship.reset()
        self.picture.land.reset()
        self._start()

    def end_tracks(self) -> None:
        """End tracks and starts, forget where clutter stays, and keep all else."""
        for state in self.tracker.sensors.values():
            state.learned = replace(state.learned, fixed_places=FixedPlaces(state.model))
        self.tracker.forget_potential_tracks()
        self.tracker.maintenance.clear()
        self.picture.ends_of_all += 1
        self._registration.start_over()

    def start_over(self) -> None:
        """Discard tracks and what was learned, and keep counts and poses."""
        totals = self.totals
        self.picture.forget()
        self.picture.totals_before = totals
        self._start_checks()

    def _start_checks(self) -> None:
        self._sensor_check = SensorCheck()
        self._registration.start_over()

    def drop(self, reason: str, sentence: str, number: int = 1) -> None:
        """Count a drop, and report it, unless it has no sentence."""
        self.dropped[reason] += number
        if sentence:
            self._report(reason, shortened_reason(sentence))
        self._report_all(self._losses.drop(reason, sentence, number, self.dropped))

    def add_own_ship(self, sample: PoseSample) -> None:
        """Take a pose of the sensor, or of a vessel whose frame is its `child_frame_id`.

        The mounting is the pose of the sensor on the vessel. Without a mounting, if the frames
        have different names, the sensor is assumed at the vessel's origin, which is reported. The
        pose is in its `frame_id`, or, if that is empty, in the `fixed_frame` of the options.
        """
        refusal = self.frames.take_pose(sample)
        self._report_all([refusal] if refusal else self.own_ship.add(sample))

    def add_scan(self, arrived: UnregisteredScan, now: Now) -> None:
        """Take a scan, or a part of a sweep, that arrived at the time `now`."""
        of_a_sweep = self._sweep.active
        if not of_a_sweep:
            self._note_arrival(arrived.scan.stamp, now)
        self.frames.fixed = self.frames.fixed or self.picture.fixed_frame
        arrived, refusal = self.frames.admit(
            arrived,
            self.settings.common.max_detections,
            self.picture.frames_of_others(self),
            mounted=self.settings.mounting.given,
        )
        if refusal is not None:
            self.drop(*refusal)
            return
        if (found := self._repetitions[0].new_in(arrived)) is None:
            return
        arrived = found
        if self.own_ship.moves:
            arrived, refusal = self.own_ship.without_late_echoes(arrived)
        questions = self._message_check.judge(arrived, self.own_ship.poses.last_stamp, now)
        scans, remarks = self._sweep.take(arrived, now)
        if self._sweep.active and not of_a_sweep:  # the messages before were no scans
            self.queue, self.deliveries = ScanInputQueue(self.settings), ScanDeliveries()
            self.start_over()
        self._report_all([*([refusal] if refusal else ()), *questions, *remarks])
        self._put_in_queue(scans, now, of_a_sweep)

    def _note_arrival(self, stamp: float, now: Now) -> None:
        self.arrived_stamp = stamp
        self.arrivals += 1
        self.deliveries.note(stamp, now)

    def _put_in_queue(self, scans: list[UnregisteredScan], now: Now, note: bool = True) -> None:
        for scan in scans:
            if note:
                self._note_arrival(scan.scan.stamp, now)
            found = self._repetitions[1].new_in(scan) if self._sweep.active else scan
            refusal = self.queue.add(found, now) if found is not None else None
            if refusal is not None:
                self.drop(*refusal)

    def add_tracked(self, report: TrackerReport) -> None:
        """Take a downstream tracker's report; the next scan uses the newest report.

        Unusable targets are left out, see `inputs.usable_input_tracks`.
        """
        self._report_all(
            self.picture.downstream.add(
                report, self.fixed_frame, self.settings.session.restart_jump
            )
        )

    def add_land(self, mask: LandMask | None, frame_id: str) -> None:
        """Take a chart, for the scans to come, in place of the last; None removes it."""
        self.picture.land.new = mask, frame_id.lstrip("/")
        self._report_all(self.picture.land.settle(self.fixed_frame))

    def process(
        self, now: Now = math.inf, *, last: bool = False, most: float = math.inf
    ) -> Iterator[ScanResult]:
        """Process the scans that are ready, in order.

        A scan whose stamp is far back or ahead waits for the next scan, which distinguishes a clock
        that was set from a bad stamp.

        Parameters
        ----------
        now : float or tuple of float
            Time on the clock of `add_scan`, s; of several clocks, the clock with the shortest wait
            counts. Scans that waited too long for own-ship data are dropped; by default, no scan
            waits any longer.
        last : bool, optional
            Whether no further scan follows; what there is of a sweep is processed then.
        most : int, optional
            Number of scans that are processed or dropped at most.

        Yields
        ------
        ScanResult
        """
        self.close_sweep(now, last=last)
        while most > 0 and (first := self.queue.first(now, last=last)) is not None:
            result, most = None, most - 1
            try:
                if self._must_wait(first):
                    return
                result = self._result(first)
            except Exception as error:
                self.drop("internal_error", f"a scan could not be processed: {error!r}")
            self.queue.remove_first()
            if result is not None:
                yield result

    def close_sweep(self, now: Now, *, last: bool) -> None:
        """End a sweep whose messages are overdue at a time, s; or the last one."""
        if self._sweep.active:
            scans, remarks = self._sweep.close() if last else self._sweep.overdue(now)
            self._report_all(remarks)
            self._put_in_queue(scans, -math.inf if now == math.inf else now)

    def figures(self) -> SessionSnapshot:
        """State of the session, for its diagnostics."""
        tracker, newest = self.tracker, self.queue.newest_stamp
        if newest is None and not self.own_ship.restarted:
            newest = tracker.stamp
        state, sensor = self.state, self._sensor_check.figures(tracker, self.state)
        states = Counter(tracker.maintenance.confirmed.status.tolist())
        return SessionSnapshot(
            totals=self.totals,
            potential_tracks=tracker.statistics.potential_tracks,
            tracks=len(tracker.maintenance.current),
            states={state.name.lower(): states[state] for state in TrackStatus},
            ends=dict(self.picture.ends),
            fixed_echoes=len(tracker.maintenance.fixed_echoes),
            detection_probability=state.detection_probability,
            detection_probability_estimated=state.estimated_detection_probability,
            clutter_density=state.clutter_density,
            clutter_given=self.settings.common.clutter_density == "given",
            coverage_area=state.covered_area,
            intensity=state.intensity,
            findings=check_findings(sensor)
            | {
                "registration": self._registration.finding,
                "own_ship_frozen": self.own_ship.frozen.finding,
            },
            sensor_figures=sensor,
            tracker=tracker.maintenance.tracker.value,
            tracker_lag=(tracker.stamp or 0.0) - tracker.maintenance.last_report,
            tracker_silence=tracker.maintenance.silence,
            dropped=dict(self.dropped),
            waiting=len(self.queue.scans),
            own_ship_source=self.own_ship.source,
            mounting=self.frames.mounting_state(self.settings.mounting, self.own_ship),
            mounting_yaw=self.settings.mounting.yaw,
            own_ship_stamp=self.own_ship.poses.last_stamp,
            scan_stamp=newest,
            land_area=0.0 if self.picture.land.mask is None else self.picture.land.mask.area,
            sweep=self._sweep.state,
            sweep_latency=self._sweep.latency,
        )

    def _report_all(self, remarks: Iterable[Remark]) -> None:
        """Count and report refusals; report notices."""
        for remark in remarks:
            if isinstance(remark, Rejection):
                self.drop(*remark)
            else:
                self._report(remark.subject, shortened_reason(remark.sentence))

    def _must_wait(self, first: Waiting) -> bool:
        """Whether the first scan needs own-ship data that may still arrive."""
        own_ship = self.own_ship
        is_back = first.arrival is Arrival.RESTART and first.refusal is None
        if is_back and not own_ship.restarted:
            own_ship.restart(first.scan.scan.stamp)
        return (
            first.refusal is None
            and own_ship.moves
            and own_ship.must_wait(first.scan, first.seconds)
        )

    def _result(self, first: Waiting) -> ScanResult | None:
        """Register and process the first scan, which need not wait; None if it is dropped."""
        arrived = first.scan
        refusal = first.refusal or refuse_input_size(arrived, self.settings.common.max_detections)
        if refusal is None and self.own_ship.moves:
            refusal = self.own_ship.refuse(arrived)
        if refusal is not None:
            self.drop(*refusal)
            return None
        scan, remarks = register_input(arrived, self.own_ship, self.frames, self.settings)
        self._report_all(remarks)
        if scan is None:
            return None
        if any([one.own_ship.has_jumped(scan.stamp) for one in self.picture.sessions.values()]):
            self.end_tracks()
        newest, order = self.tracker.stamp, self.queue.order
        self.own_ship.restarted = False
        if self.own_ship.moves:
            settings, poses = self.settings, self.own_ship.poses
            self._report_all(
                self._registration.take(arrived, scan, settings.sensor, settings.mounting, poses)
            )
        if first.arrival is Arrival.RESTART:
            self._report("restart", f"stamps went back to {scan.stamp:.3f} s: state reset")
            if self.restarts == self.picture.restarts:
                self.picture.restarts += 1
                self.start_over()
                self.picture.downstream = ExternalTrackerInput()
            else:  # reset by another sensor, whose clock went back with that of this one
                self._start_checks()
            self.restarts = self.picture.restarts
        elif first.arrival is Arrival.GAP and (
            newest is None or scan.stamp - newest > order.gap_limit
        ):
            self._report("gap", f"long gap before {scan.stamp:.3f} s: potential tracks dropped")
            self.tracker.forget_potential_tracks()
        order.accept(scan.stamp, first.arrival)
        refusal = self._refuse_place(scan.stamp, first.arrival)
        if refusal is not None:
            self.drop(*refusal)
            return None
        self.restarts = self.picture.restarts
        return self._run_on(scan, first)

    def _refuse_place(self, stamp: float, arrival: Arrival) -> Rejection | None:
        """Refuse a scan by its stamp, s, among those of other sensors."""
        now = self.tracker.stamp
        if now is None or stamp == now:
            return None
        if stamp < now:
            return Rejection(
                "scan_late", f"stamp {stamp:.3f} s is before another sensor's last scan"
            )
        is_back = arrival is Arrival.RESTART or self.restarts == self.picture.restarts
        if is_back or stamp <= now + self.settings.session.max_wait:
            return None
        return Rejection(
            "scan_late",
            f"stamp {stamp:.3f} s is of the time before other sensors went back to {now:.3f} s",
        )

    def _run_on(self, scan: Scan, first: Waiting) -> ScanResult:
        """Run the tracker on a registered scan."""
        tracker, fixed = self.tracker, self.fixed_frame
        state, scan = self.state, scan.replaced(sensor=self.sensor)
        timeout = self.settings.common.tracked_timeout
        report, remarks = self.picture.downstream.at(scan.stamp, tracker.stamp, fixed, timeout)
        self._report_all([*self.picture.land.settle(fixed), *remarks])
        tracker.land = self.picture.land.mask
        before, seen = tracker.maintenance.tracker, state.extended_targets.seen
        new, seconds = self._tracked(scan, report)
        self.received += tracker.statistics.detections
        self._report_all(self._remarks(scan, before, seen))
        self._report_all(self._losses.processed(tracker.statistics.detections, self.dropped))
        return ScanResult(
            stamp=scan.stamp,
            stamp_ns=first.scan.stamp_ns,
            scan=scan,
            frame_id=fixed,
            arrival=first.arrival,
            new=new,
            revised=tracker.revised,
            confirmed=tracker.maintenance.confirmed,
            common=tracker.common,
            ended=tracker.maintenance.ended,
            statistics=tracker.statistics,
            core_seconds=seconds,
            waiting=first.seconds,
        )

    def _tracked(self, scan: Scan, report: TrackerReport | None) -> tuple[TrackArrays, float]:
        """Process a downstream tracker's report, then a scan: new tracks, and the time, s.

        Raises
        ------
        Exception
            All tracks are discarded then, because the tracker's state is undefined.
        """
        tracker = self.tracker
        if self._live:
            tracker.max_scan_time = self.settings.session.max_scan_time
        try:
            if report is not None:
                tracker.maintenance.follow(report.stamp, report.tracks, report.unusable)
            begin = time.perf_counter()
            new = tracker.process(scan)
        except Exception:
            self.start_over()
            raise
        seconds = time.perf_counter() - begin
        self.picture.ends.update(tracker.maintenance.ended.values())
        self._sensor_check.observe(
            scan, len(new), tracker.statistics.outside_coverage, begins=self._sweep.begins
        )
        return new, seconds

    def _remarks(self, scan: Scan, before: ExternalTracker, several_before: bool) -> list[Remark]:
        """Notices and refusals after a processed scan.

        Parameters
        ----------
        scan : Scan
        before : ExternalTracker
            State of the downstream tracker before the scan.
        several_before : bool
            Whether targets were seen before the scan to have several detections a ping.
        """
        tracker = self.tracker
        statistics, remarks = tracker.statistics, list[Remark]()
        timeout, outside = self.settings.common.tracked_timeout, statistics.outside_coverage
        change = before, tracker.maintenance.tracker
        if change == (ExternalTracker.ALIVE, ExternalTracker.SILENT):
            remarks.append(
                Notice(
                    "tracker_silent",
                    f"the downstream tracker was silent for {timeout:g} s: this node maintains its "
                    "tracks",
                )
            )
        elif change == (ExternalTracker.SILENT, ExternalTracker.ALIVE):
            remarks.append(Notice("tracker_back", "the downstream tracker reports again"))
        if tracker.sensor.extended_targets.seen and not several_before:
            remarks.append(Notice("plots", tracker.sensor.extended_targets.sentence))
        if outside:
            remarks.append(
                Rejection(
                    "outside_coverage",
                    f"{outside} of {len(scan)} detections dropped: outside the coverage of "
                    "sensor.min_range, max_range, azimuth_min and azimuth_max",
                    outside,
                )
            )
        if statistics.on_land:
            remarks.append(Rejection("on_land", "", statistics.on_land))
        remarks += [Notice(*news) for news in self._sensor_check.news(tracker)]
        counted, self._amplitudes_count = (
            self._amplitudes_count,
            tracker.sensor.intensity.startswith("used"),
        )
        if counted != self._amplitudes_count:
            remarks.append(
                Notice("intensity", f"the intensity of detections is {tracker.sensor.intensity}")
            )
        cut = statistics.cut_potential_tracks + statistics.cut_confirmations
        if cut:
            remarks.append(Notice("limit", f"a limit cut {cut} hypotheses at {scan.stamp:.3f} s"))
        return remarks
