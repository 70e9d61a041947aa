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
from collections import Counter
from collections.abc import Callable, Iterator

from tsepm_ros.own_ship.pose_history import PoseSample
from tsepm_ros.own_ship.registration import SensorScan
from tsepm_ros.session.drop_reasons import FAILURES, Notice, Refusal, Remark, shortened
from tsepm_ros.session.frames import Frames, register
from tsepm_ros.session.inputs import DownstreamInput, LandInput, OwnShipInput
from tsepm_ros.session.message_check import Losses, MessageCheck
from tsepm_ros.session.result import ScanResult, SessionSnapshot
from tsepm_ros.session.scan_queue import QUEUE_LENGTH, Arrival, Now, ScanOrder, ScanQueue, Waiting
from tsepm_ros.session.sweep import Sweep
from tsepm_ros.session.tracker_run import TrackerRun
from tsepm_ros.settings.settings import Settings
from tsepm_ros.tracker.clutter.land import LandMask
from tsepm_ros.tracker.maintenance.external_tracker import TrackerReport
from tsepm_ros.tracker.method import ScanStatistics
from tsepm_ros.tracker.scan import Scan
from tsepm_ros.tracker.tracker import Tracker


def _ignore(reason: str, sentence: str) -> None:
    pass


class Session:
    """Orders and registers scans and runs the initiator on them.

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
        self._settings = settings
        self._run = TrackerRun(settings, live=live)
        self._order = ScanOrder(settings.window, options.restart_jump, options.max_gap)
        self._queue = ScanQueue(self._order, queue_length)
        self._sweep = Sweep(settings)
        self.own_ship = OwnShipInput(options)
        self._frames = Frames(options, moves=self.own_ship.moves)
        self._downstream = DownstreamInput()
        self._land = LandInput()
        self._check = MessageCheck()
        self._losses = Losses()
        self.dropped: Counter[str] = Counter()
        self.arrived_stamp: float | None = None
        self.arrivals = 0

    @property
    def settings(self) -> Settings:
        """The settings in use."""
        return self._settings

    @property
    def tracker(self) -> Tracker:
        """The tracker in use."""
        return self._run.tracker

    @property
    def source(self) -> str:
        """Source of own-ship data; fixed at the start."""
        return self.own_ship.source

    @property
    def fixed_frame(self) -> str:
        """Frame of the tracks; empty while unknown."""
        return self._frames.fixed

    @property
    def waiting(self) -> int:
        """Scans that wait for own-ship data."""
        return len(self._queue)

    @property
    def unfinished(self) -> bool:
        """Whether scans wait: for own-ship data, the next scan, or the end of their sweep."""
        return bool(self._queue) or self._sweep.is_open

    @property
    def totals(self) -> ScanStatistics:
        """Sums over the scans since the start or the last `reset`, restarts included."""
        return self._run.totals

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
        window, options = settings.window, settings.session
        kept = self._run.configure(settings)
        if window != self._settings.window:
            self._order.resize(window)
        self._settings = settings
        self._order.restart_jump = options.restart_jump
        self._order.max_gap = options.max_gap
        self.own_ship.configure(options)
        self._frames.options = options
        self._sweep.settings = settings
        return kept

    def rehearse(self, settings: Settings) -> None:
        """Raise the errors of `configure`, without a change."""
        self._run.rehearse(settings)

    def reset(self) -> None:
        """Discard scans, tracks, poses and counts."""
        self.dropped.clear()
        self._losses = Losses()
        self.arrived_stamp = None
        self._order.reset()
        self._queue.clear()
        self._sweep.reset()
        self.own_ship.reset()
        self._frames.reset()
        self._downstream.clear()
        self._land.reset()
        self._run.reset()

    def drop(self, reason: str, sentence: str, number: int = 1) -> None:
        """Count a drop, and report it, unless it has no sentence."""
        self.dropped[reason] += number
        if sentence:
            self._report(reason, shortened(sentence))
        self._report_all(*self._losses.drop(reason, sentence, number, self.dropped))

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
        if self._refused(self._frames.take_pose(sample)):
            return
        if self._refused(self.own_ship.add(sample)):
            self._report_all(self.own_ship.restart_if_late_for_long(sample.stamp))

    def add_scan(self, arrived: SensorScan, now: Now) -> None:
        """Take a scan, or a part of a sweep, that arrived at the time `now`."""
        of_a_sweep = self._sweep.active
        if not of_a_sweep:
            self._note_arrival(arrived)
        arrived = self._frames.named(arrived)
        if self._refused(self._frames.refuse_scan(arrived) or self._refuse_size(arrived.scan)):
            return
        self._frames.take_scan(arrived)
        arrived, refusal = self.own_ship.without_late_echoes(arrived)
        self._report_all(refusal, *self._check.judge(arrived, self.own_ship_stamp, now))
        scans, remarks, changed = self._sweep.take(arrived, now)
        if changed:
            self._order.reset()
            self._queue.clear()
            self._run.start_over()
        self._report_all(*remarks)
        self._put_in_queue(scans, now, of_a_sweep)

    def _note_arrival(self, scan: SensorScan) -> None:
        self.arrived_stamp = scan.scan.stamp
        self.arrivals += 1

    def _put_in_queue(self, scans: list[SensorScan], now: Now, note: bool = True) -> None:
        for scan in scans:
            if note:
                self._note_arrival(scan)
            self._report_all(self._queue.add(scan, now))

    def add_tracked(self, report: TrackerReport) -> None:
        """Take a downstream tracker's report; the next scan uses the newest report.

        Unusable targets are left out, see `downstream_tracker.usable`.
        """
        restart_jump = self._settings.session.restart_jump
        refusal = self._frames.refuse_report(report)
        if not self._refused(refusal or self._downstream.refuse(report, restart_jump)):
            self._report_all(*self._downstream.add(report))

    def add_land(self, mask: LandMask | None, frame_id: str) -> None:
        """Take a chart, for the scans to come, in place of the last; None removes it."""
        self._land.add(mask, frame_id.lstrip("/"))
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
        scans, remarks, _ = self._sweep.close() if last else (self._sweep.overdue(now), [], False)
        self._report_all(*remarks)
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
        newest = self._queue.newest_stamp
        if newest is None and not self.own_ship.restarted:
            newest = self.tracker.stamp
        return SessionSnapshot(
            **self._run.figures(),
            dropped=dict(self.dropped),
            waiting=self.waiting,
            own_ship_source=self.source,
            mounting=self.mounting,
            own_ship_stamp=self.own_ship_stamp,
            scan_stamp=newest,
            land_area=0.0 if self._land.mask is None else self._land.mask.area,
            sweep=self._sweep.state,
            sweep_latency=self._sweep.latency,
        )

    @property
    def mounting(self) -> str:
        """Whether the mounting is given, assumed, not needed or unknown yet."""
        if self.source != "odometry":
            return "not needed"
        return self._frames.mounting_state(self._settings.mounting, self.own_ship_stamp is not None)

    def _report_all(self, *remarks: Remark | None) -> None:
        """Count and report refusals; report notices."""
        for remark in remarks:
            if isinstance(remark, Refusal):
                self.drop(*remark)
            elif remark is not None:
                self._report(remark.subject, shortened(remark.sentence))

    def _refused(self, refusal: Refusal | None) -> bool:
        """Count and report a refusal, if any; return whether there is one."""
        self._report_all(refusal)
        return refusal is not None

    def _refuse_size(self, scan: Scan) -> Refusal | None:
        limit = self._settings.common.max_detections
        if len(scan) <= limit:
            return None
        return Refusal(
            "too_many_detections",
            f"a scan has {len(scan)} detections, more than max_detections = {limit}",
        )

    def _must_wait(self, first: Waiting) -> bool:
        """Whether the first scan needs own-ship data that may still arrive."""
        if first.arrival is Arrival.RESTART and not self.own_ship.restarted:
            self.own_ship.restart(first.scan.scan.stamp)
        return first.usable and self.own_ship.must_wait(first.scan, first.seconds)

    def _result(self, first: Waiting) -> ScanResult | None:
        """Register and process the first scan, which need not wait; None if it is dropped."""
        arrived, stamp = first.scan, first.scan.scan.stamp
        refusal = first.refuse() or self._refuse_size(arrived.scan) or self.own_ship.refuse(arrived)
        if self._refused(refusal):
            return None
        scan, remarks = register(arrived, self.own_ship, self._frames, self._settings)
        self._report_all(*remarks)
        if scan is None:
            return None
        self._order.accept(stamp, first.arrival)
        self.own_ship.restarted = False
        self._start_over(first.arrival, stamp)
        return self._run_on(scan, first)

    def _start_over(self, arrival: Arrival, stamp: float) -> None:
        """Discard all tracks at a restart, and the potential tracks at a long gap."""
        if arrival is Arrival.RESTART:
            self._report_all(Notice("restart", f"stamps went back to {stamp:.3f} s: state reset"))
            self._run.start_over()
            self._downstream.clear()
        elif arrival is Arrival.GAP:
            self._report_all(
                Notice("gap", f"long gap before {stamp:.3f} s: potential tracks dropped")
            )
            self.tracker.forget_potential_tracks()

    def _report_at(self, stamp: float) -> TrackerReport | None:
        """The downstream tracker's report for the scan at a stamp (s)."""
        report = self._downstream.take()
        if report is None:
            return None
        timeout = self._settings.common.tracked_timeout
        refusal = self._frames.refuse_report(report)
        refusal = refusal or self._downstream.refuse_at(report, stamp, timeout)
        return None if self._refused(refusal) else report

    def _run_on(self, scan: Scan, first: Waiting) -> ScanResult:
        """Run the initiator on a registered scan."""
        self._report_all(self._land.settle(self.fixed_frame))
        if self._land.mask is not self.tracker.land:
            self.tracker.land = self._land.mask
        tracker, seen = self.tracker.maintenance.tracker, self.tracker.plots.seen
        new, seconds = self._run.process(scan, self._report_at(scan.stamp))
        remarks = self._run.remarks(scan, tracker, seen)
        detections = self.tracker.statistics.detections
        self._report_all(*remarks, *self._losses.processed(detections, self.dropped))
        return ScanResult(
            stamp=scan.stamp,
            stamp_ns=first.scan.stamp_ns,
            scan=scan,
            frame_id=self.fixed_frame,
            arrival=first.arrival,
            new=new,
            revised=self.tracker.revised,
            current=self.tracker.current,
            fixed_echoes=self.tracker.fixed_echoes,
            ended=self.tracker.maintenance.ended,
            statistics=self.tracker.statistics,
            core_seconds=seconds,
            waiting=first.seconds,
        )
