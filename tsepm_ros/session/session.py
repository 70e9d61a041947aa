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
from collections.abc import Callable, Iterable, Iterator

from tsepm_ros.own_ship.pose_history import PoseSample
from tsepm_ros.own_ship.registration import SensorScan
from tsepm_ros.session.consistency_checks import Losses, MessageCheck, SensorCheck, findings
from tsepm_ros.session.drop_reasons import FAILURES, Notice, Rejection, Remark, shortened
from tsepm_ros.session.inputs import ExternalTrackerInput, Frames, LandInput, OwnShipInput, register
from tsepm_ros.session.result import ScanResult, SessionSnapshot
from tsepm_ros.session.scan_queue import QUEUE_LENGTH, Arrival, Now, ScanOrder, ScanQueue, Waiting
from tsepm_ros.session.sweep import Sweep
from tsepm_ros.settings.settings import Settings
from tsepm_ros.tracker.clutter.land import LandMask
from tsepm_ros.tracker.maintenance.external_tracker import ExternalTracker, TrackerReport
from tsepm_ros.tracker.maintenance.stationary import Status
from tsepm_ros.tracker.method import ScanStatistics
from tsepm_ros.tracker.scan import Scan
from tsepm_ros.tracker.tracks import TrackArrays


def _ignore(reason: str, sentence: str) -> None:
    pass


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
    queue_length : int, optional
        Maximum number of scans that wait for own-ship data.

    Attributes
    ----------
    settings : Settings
        In use; changed by `configure`.
    tracker : Tracker
        In use.
    dropped : Counter
        Drops by reason since the start or the last reset.
    arrived_stamp, arrivals : float or None, int
        Stamp of the last arrived scan, s, and their number, dropped or not; of complete sweeps.
    own_ship : OwnShipInput
        Poses; `look_up` and `read_unread` are set where poses must be fetched.
    """

    def __init__(
        self,
        settings: Settings,
        report: Callable[[str, str], None] = _ignore,
        *,
        live: bool = False,
        queue_length: int = QUEUE_LENGTH,
    ) -> None:
        options = settings.session
        self._report = report
        self._live = live
        self.settings = settings
        self.tracker = settings.make_initiator()
        self._sensor_check = SensorCheck()
        self._strengths_count = False
        self._totals_before = ScanStatistics()  # of runs before the last `_start_over`
        self._ends: Counter[str] = Counter()
        self._order = ScanOrder(settings.window, options.restart_jump, options.max_gap)
        self._queue = ScanQueue(self._order, queue_length)
        self._sweep = Sweep(settings)
        self.own_ship = OwnShipInput(options)
        self._frames = Frames(options, moves=self.own_ship.moves)
        self._downstream = ExternalTrackerInput()
        self._land = LandInput()
        self._message_check = MessageCheck()
        self._losses = Losses()
        self.dropped: Counter[str] = Counter()
        self.arrived_stamp: float | None = None
        self.arrivals = 0

    @property
    def fixed_frame(self) -> str:
        """Frame of the tracks; empty while unknown."""
        return self._frames.fixed

    @property
    def waiting(self) -> int:
        """Scans that wait for own-ship data."""
        return len(self._queue.scans)

    @property
    def unfinished(self) -> bool:
        """Whether scans wait: for own-ship data, the next scan, or the end of their sweep."""
        return bool(self._queue.scans) or (self._sweep.active and self._sweep.is_open)

    @property
    def totals(self) -> ScanStatistics:
        """Sums over the scans since the start or the last `reset`, restarts included."""
        return self._totals_before + self.tracker.totals

    @property
    def own_ship_stamp(self) -> float | None:
        """Stamp of the newest own-ship pose, s."""
        return self.own_ship.poses.last_stamp

    def configure(self, settings: Settings) -> bool:
        """Change settings before the next scan; frames and the own-ship source do not change.

        An error leaves the settings unchanged.

        Returns
        -------
        bool
            Whether potential tracks were kept. A change of the method or of the number of hits
            discards them.
        """
        options = settings.session
        self.tracker, kept = self.tracker.with_settings(settings.make_method())
        self.settings = self._sweep.settings = settings
        self._sensor_check.say_again()
        self._order.resize(settings.window)
        self._order.restart_jump = options.restart_jump
        self._order.max_gap = options.max_gap
        self.own_ship.configure(options)
        self._frames.options = options
        return kept

    def validate(self, settings: Settings) -> None:
        """Raise the errors of `configure`, without a change."""
        self.tracker.with_settings(settings.make_method())

    def reset(self) -> None:
        """Discard scans, tracks, poses and counts."""
        self.dropped.clear()
        self._ends.clear()
        self._losses = Losses()
        self.arrived_stamp = None
        self._order.reset()
        self._queue.clear()
        self._sweep.reset()
        self.own_ship.reset()
        self._frames.reset()
        self._downstream.clear()
        self._land.reset()
        self._start_over()
        self._totals_before = ScanStatistics()

    def drop(self, reason: str, sentence: str, number: int = 1) -> None:
        """Count a drop, and report it, unless it has no sentence."""
        self.dropped[reason] += number
        if sentence:
            self._report(reason, shortened(sentence))
        self._report_all(self._losses.drop(reason, sentence, number, self.dropped))

    def add_own_ship(self, sample: PoseSample) -> None:
        """Take a pose of the sensor, or of a vessel whose frame is its `child_frame_id`.

        The mounting is the pose of the sensor on the vessel. Without a mounting, if the frames
        have different names, the sensor is assumed at the vessel's origin, which is reported. The
        pose is in its `frame_id`, or, if that is empty, in the `fixed_frame` of the options.
        """
        try:
            sample.check()
        except ValueError as error:
            self.drop("own_ship_invalid", f"own-ship data dropped: {error}")
            return
        refusal = self._frames.take_pose(sample)
        self._report_all([refusal] if refusal else self.own_ship.add(sample))

    def add_scan(self, arrived: SensorScan, now: Now) -> None:
        """Take a scan, or a part of a sweep, that arrived at the time `now`."""
        of_a_sweep = self._sweep.active
        if not of_a_sweep:
            self._note_arrival(arrived)
        arrived, refusal = self._frames.admit(arrived, self.settings.common.max_detections)
        if refusal is not None:
            self.drop(*refusal)
            return
        if self.own_ship.moves:
            arrived, refusal = self.own_ship.without_late_echoes(arrived)
        questions = self._message_check.judge(arrived, self.own_ship_stamp, now)
        scans, remarks, changed = self._sweep.take(arrived, now)
        if changed:
            self._order.reset()
            self._queue.clear()
            self._start_over()
        if refusal or questions or remarks:
            self._report_all([*([refusal] if refusal else ()), *questions, *remarks])
        self._put_in_queue(scans, now, of_a_sweep)

    def _note_arrival(self, scan: SensorScan) -> None:
        self.arrived_stamp = scan.scan.stamp
        self.arrivals += 1

    def _put_in_queue(self, scans: list[SensorScan], now: Now, note: bool = True) -> None:
        for scan in scans:
            if note:
                self._note_arrival(scan)
            refusal = self._queue.add(scan, now)
            if refusal is not None:
                self.drop(*refusal)

    def add_tracked(self, report: TrackerReport) -> None:
        """Take a downstream tracker's report; the next scan uses the newest report.

        Unusable targets are left out, see `external_tracker.usable`.
        """
        jump = self.settings.session.restart_jump
        self._report_all(self._downstream.add(report, self.fixed_frame, jump))

    def add_land(self, mask: LandMask | None, frame_id: str) -> None:
        """Take a chart, for the scans to come, in place of the last; None removes it."""
        self._land.new = mask, frame_id.lstrip("/")
        self._report_all(self._land.settle(self.fixed_frame))

    def process(self, now: Now = math.inf, *, last: bool = False) -> Iterator[ScanResult]:
        """Process the scans that are ready, in order.

        A scan whose stamp is far back waits for the next scan, which distinguishes a restart from a
        bad stamp.

        Parameters
        ----------
        now : float or tuple of float
            Time on the clock of `add_scan`, s; of several clocks, the clock with the shortest wait
            counts. Scans that waited too long for own-ship data are dropped; by default, no scan
            waits any longer.
        last : bool, optional
            Whether no further scan follows; what there is of a sweep is processed then.

        Yields
        ------
        ScanResult
        """
        if self._sweep.active:
            scans, remarks, _ = self._sweep.close() if last else self._sweep.overdue(now)
            self._report_all(remarks)
            self._put_in_queue(scans, -math.inf if now == math.inf else now)
        while (first := self._queue.first(now, last=last)) is not None:
            result = None
            try:
                if self._must_wait(first):
                    return
                result = self._result(first)
            except FAILURES as error:
                self.drop("internal_error", f"a scan could not be processed: {error!r}")
            self._queue.remove_first()
            if result is not None:
                yield result

    def figures(self) -> SessionSnapshot:
        """State of the session, for its diagnostics."""
        tracker, newest = self.tracker, self._queue.newest_stamp
        if newest is None and not self.own_ship.restarted:
            newest = tracker.stamp
        sensor = self._sensor_check.figures(tracker)
        states = Counter(tracker.maintenance.held.status.tolist())
        return SessionSnapshot(
            totals=self.totals,
            potential_tracks=tracker.statistics.potential_tracks,
            tracks=len(tracker.current),
            states={state.name.lower(): states[state] for state in Status},
            ends=dict(self._ends),
            fixed_echoes=len(tracker.fixed_echoes),
            detection_probability=tracker.detection_probability,
            detection_probability_estimated=tracker.estimated_detection_probability,
            clutter_density=tracker.clutter_density,
            coverage_area=tracker.covered_area,
            intensity=tracker.intensity,
            sensor_findings=findings(sensor),
            sensor_figures=sensor,
            tracker=tracker.maintenance.tracker.status.value,
            dropped=dict(self.dropped),
            waiting=self.waiting,
            own_ship_source=self.own_ship.source,
            mounting=self._mounting(),
            mounting_yaw=self.settings.mounting.yaw,
            own_ship_stamp=self.own_ship_stamp,
            scan_stamp=newest,
            land_area=0.0 if self._land.mask is None else self._land.mask.area,
            sweep=self._sweep.state,
            sweep_latency=self._sweep.latency,
        )

    def _mounting(self) -> str:
        """Whether the mounting is given, assumed, not needed or unknown yet."""
        if self.own_ship.source != "odometry":
            return "not needed"
        return self._frames.mounting_state(self.settings.mounting, self.own_ship_stamp is not None)

    def _report_all(self, remarks: Iterable[Remark]) -> None:
        """Count and report refusals; report notices."""
        for remark in remarks:
            if isinstance(remark, Rejection):
                self.drop(*remark)
            else:
                self._report(remark.subject, shortened(remark.sentence))

    def _start_over(self) -> None:
        """Discard tracks and keep counts."""
        self._totals_before = self.totals
        self.tracker.reset()
        self._sensor_check = SensorCheck()

    def _must_wait(self, first: Waiting) -> bool:
        """Whether the first scan needs own-ship data that may still arrive."""
        own_ship = self.own_ship
        if first.arrival is Arrival.RESTART and not own_ship.restarted:
            own_ship.restart(first.scan.scan.stamp)
        wanted = first.refusal is None and own_ship.moves
        return wanted and own_ship.must_wait(first.scan, first.seconds)

    def _result(self, first: Waiting) -> ScanResult | None:
        """Register and process the first scan, which need not wait; None if it is dropped."""
        arrived = first.scan
        refusal = first.refusal or self._frames.refuse_size(
            arrived, self.settings.common.max_detections
        )
        if refusal is None and self.own_ship.moves:
            refusal = self.own_ship.refuse(arrived)
        if refusal is not None:
            self.drop(*refusal)
            return None
        scan, remarks = register(arrived, self.own_ship, self._frames, self.settings)
        if remarks:
            self._report_all(remarks)
        if scan is None:
            return None
        self._order.accept(scan.stamp, first.arrival)
        self.own_ship.restarted = False
        if first.arrival is Arrival.RESTART:
            said = f"stamps went back to {scan.stamp:.3f} s: state reset"
            self._report_all([Notice("restart", said)])
            self._start_over()
            self._downstream.clear()
        elif first.arrival is Arrival.GAP:
            said = f"long gap before {scan.stamp:.3f} s: potential tracks dropped"
            self._report_all([Notice("gap", said)])
            self.tracker.forget_potential_tracks()
        return self._run_on(scan, first)

    def _run_on(self, scan: Scan, first: Waiting) -> ScanResult:
        """Run the tracker on a registered scan."""
        tracker, fixed = self.tracker, self.fixed_frame
        timeout = self.settings.common.tracked_timeout
        report, remarks = self._downstream.at(scan.stamp, fixed, timeout)
        if self._land.new or remarks:
            self._report_all([*self._land.settle(fixed), *remarks])
        if self._land.mask is not tracker.land:
            tracker.land = self._land.mask
        before, seen = tracker.maintenance.tracker.status, tracker.plots.seen
        new, seconds = self._tracked(scan, report)
        remarks = self._remarks(scan, before, seen)
        detections = tracker.statistics.detections
        self._report_all([*remarks, *self._losses.processed(detections, self.dropped)])
        return ScanResult(
            stamp=scan.stamp,
            stamp_ns=first.scan.stamp_ns,
            scan=scan,
            frame_id=fixed,
            arrival=first.arrival,
            new=new,
            revised=tracker.revised,
            current=tracker.current,
            fixed_echoes=tracker.fixed_echoes,
            ended=tracker.maintenance.ended,
            statistics=tracker.statistics,
            core_seconds=seconds,
            waiting=first.seconds,
        )

    def _tracked(self, scan: Scan, report: TrackerReport | None) -> tuple[TrackArrays, float]:
        """Process a downstream tracker's report, then a scan: new tracks, and the time, s.

        Raises
        ------
        FAILURES
            All tracks are discarded then, because the tracker's state is undefined.
        """
        tracker = self.tracker
        if self._live:
            tracker.max_scan_time = self.settings.session.max_scan_time
        try:
            if report is not None:
                tracker.maintenance.follow(report.stamp, report.tracks)
            begin = time.perf_counter()
            new = tracker.process(scan)
        except FAILURES:
            self._start_over()
            raise
        seconds = time.perf_counter() - begin
        self._ends.update(tracker.maintenance.ended.values())
        self._sensor_check.observe(
            scan.stamp, len(new), tracker.statistics.outside_coverage, len(scan)
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
        change = before, tracker.maintenance.tracker.status
        if change == (ExternalTracker.ALIVE, ExternalTracker.SILENT):
            said = (
                f"the downstream tracker was silent for {timeout:g} s: this node maintains its "
                "tracks"
            )
            remarks.append(Notice("tracker_silent", said))
        elif change == (ExternalTracker.SILENT, ExternalTracker.ALIVE):
            remarks.append(Notice("tracker_back", "the downstream tracker reports again"))
        if tracker.plots.seen and not several_before:
            remarks.append(Notice("plots", tracker.plots.sentence))
        if outside:
            said = (
                f"{outside} of {len(scan)} detections dropped: outside the coverage of "
                "sensor.min_range, max_range, azimuth_min and azimuth_max"
            )
            remarks.append(Rejection("outside_coverage", said, outside))
        if statistics.on_land:
            remarks.append(Rejection("on_land", "", statistics.on_land))
        remarks += [Notice(*news) for news in self._sensor_check.news(tracker)]
        counted, self._strengths_count = self._strengths_count, tracker.intensity.startswith("used")
        if counted != self._strengths_count:
            said = f"the intensity of detections is {tracker.intensity}"
            remarks.append(Notice("intensity", said))
        cut = statistics.cut_potential_tracks + statistics.cut_confirmations
        if cut:
            remarks.append(Notice("limit", f"a limit cut {cut} hypotheses at {scan.stamp:.3f} s"))
        return remarks
