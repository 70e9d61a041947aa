"""From arriving messages to results, without ROS: what the node and offline replays share.

A session takes own-ship poses, scans and a downstream tracker's reports as they arrive, puts each
scan in its place in time and in the fixed frame, or drops it with a reason, and runs the initiator.
"""

from __future__ import annotations

import dataclasses
import math
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator

import numpy as np

from tsepm_ros.initiation.statistics import ScanStatistics
from tsepm_ros.maintenance.downstream_tracker import Tracker, TrackerReport, usable
from tsepm_ros.own_ship import registration
from tsepm_ros.own_ship.pose_history import PoseCoverage, PoseHistory
from tsepm_ros.own_ship.pose_sample import PoseSample
from tsepm_ros.own_ship.registration import SensorScan
from tsepm_ros.sensing.scan import Scan
from tsepm_ros.session.clocks import Now, waited
from tsepm_ros.session.result import ScanResult
from tsepm_ros.session.scan_order import Arrival, ScanOrder
from tsepm_ros.session.snapshot import SessionSnapshot
from tsepm_ros.settings.settings import Settings

UNUSABLE = Arrival.SAME_STAMP, Arrival.LATE, Arrival.FAR_BACK
"""Arrivals of scans that are dropped."""

QUEUE_LENGTH = 1000
"""Scans that may wait for own-ship data at once."""

MAX_YAW_VARIANCE = math.pi**2
"""Variance of the heading above which there is none, rad^2."""

FAILURES = (ArithmeticError, LookupError, MemoryError, ValueError)
"""What a scan may bring about; it is lost then, and the next one is processed."""


def _ignore(reason: str, sentence: str) -> None:
    pass


class Session:
    """Puts scans in order and in place and runs the initiator on them.

    Parameters
    ----------
    settings : Settings
        Method, options, sensor and frames.
    report : callable, optional
        Called as ``report(reason, sentence)`` for every scan, detection, own-ship sample or tracked
        target that is dropped, whose reasons are counted in `dropped` as well; for every reset;
        and where the downstream tracker falls silent or comes back.
    live : bool, optional
        Whether `max_scan_time` holds.

    Attributes
    ----------
    dropped : Counter
        Drops by reason since the start or the last reset.
    arrived_stamp : float or None
        Stamp of the scan that arrived last, whatever becomes of it, s.
    source : str
        Where own-ship data comes from: as at the start, whatever settings say later.
    look_up : callable or None
        Called as ``look_up(sensor frame, first, last, axes)`` for the span of time (s) of a scan
        that is to be placed, to give its poses and attitudes by `add_own_ship`; None where they
        come by themselves.
    """

    def __init__(
        self,
        settings: Settings,
        report: Callable[[str, str], None] = _ignore,
        *,
        live: bool = False,
    ) -> None:
        self._report = report
        self._live = live
        self._settings = settings
        self.initiator = settings.make_initiator()
        self._totals_before = ScanStatistics()  # of initiators, and runs, that are over
        self.dropped: Counter[str] = Counter()
        self.look_up: Callable[[str, float, float, str], None] | None = None
        options = settings.session
        self._order = ScanOrder(settings.window, options.restart_jump, options.max_gap)
        self._poses = PoseHistory(
            max_extrapolation=options.own_ship_max_extrapolation,
            max_gap=options.own_ship_max_gap,
        )
        self.source = options.own_ship_source
        self._fixed_frame: str | None = None
        self._sensor_frame: str | None = None
        self._own_ship_frame = ""
        self._said_of_mounting: set[tuple[str, str]] = set()
        self._forget_frames()
        self.arrived_stamp: float | None = None
        self._tracked: TrackerReport | None = None
        self._tracked_stamp = -math.inf
        self._waiting: deque[tuple[Now, SensorScan]] = deque()
        self._arrival: Arrival | None = None  # of the first that waits
        self._poses_restarted = False  # since the last scan processed

    @property
    def settings(self) -> Settings:
        """The settings in use."""
        return self._settings

    @property
    def _moves(self) -> bool:
        return self.source != "none"

    @property
    def waiting(self) -> int:
        """Scans that wait for own-ship data."""
        return len(self._waiting)

    @property
    def totals(self) -> ScanStatistics:
        """Sums over the scans since the start or the last `reset`, whatever started over since."""
        return self._totals_before + self.initiator.totals

    @property
    def own_ship_stamp(self) -> float | None:
        """Stamp of the newest own-ship pose, s."""
        return self._poses.last_stamp

    def configure(self, settings: Settings) -> bool:
        """Change settings before the next scan; frames and the own-ship source stay as they are.

        Where that raises, nothing has changed.

        Returns
        -------
        bool
            Whether potential tracks were kept. Another method, or another number of hits, starts
            over.
        """
        window = settings.window
        kept = self.initiator.configure(settings.make_method())
        old, self._settings = self._settings, settings
        options = settings.session
        self._order.restart_jump = options.restart_jump
        self._order.max_gap = options.max_gap
        self._poses.max_extrapolation = options.own_ship_max_extrapolation
        self._poses.max_gap = options.own_ship_max_gap
        if window != old.window:
            self._order.resize(window)
        return kept

    def rehearse(self, settings: Settings) -> None:
        """Raise what `configure` would; nothing changes."""
        self.initiator.rehearse(settings.make_method())

    def reset(self) -> list[int]:
        """Forget scans, tracks, poses and counts; returns the ids of the tracks that end."""
        self.initiator.reset()
        self._totals_before = ScanStatistics()
        self.dropped.clear()
        self._order.reset()
        self._poses.clear()
        self._poses_restarted = False
        self._waiting.clear()
        self.arrived_stamp = None
        self._arrival = None
        self._forget_frames()
        self._forget_tracker()
        return self.initiator.hold.take_cleared()

    def drop(self, reason: str, sentence: str, number: int = 1) -> None:
        """Count and report something that cannot be used."""
        self.dropped[reason] += number
        self._report(reason, sentence)

    def add_own_ship(self, sample: PoseSample) -> None:
        """Take a pose of the sensor, or of a vessel whose frame is its `child_frame_id`.

        The mounting says where on the vessel the sensor is. Where it says nothing and the frames
        have different names, the sensor is taken to be at the vessel's origin, and that is
        reported. The pose is in its `frame_id`, or, where that is empty, in the `fixed_frame`
        given.
        """
        try:
            sample.check()
        except ValueError as error:
            self.drop("own_ship_invalid", f"own-ship data dropped: {error}")
            return
        frame_id = sample.frame_id or self._settings.session.fixed_frame
        if not frame_id:
            self.drop("own_ship_empty_frame", "own-ship data names no frame, nor does fixed_frame")
            return
        if self._fixed_frame is None:
            self._fixed_frame = frame_id
        if frame_id != self._fixed_frame:
            self.drop(
                "own_ship_frame",
                f"own-ship data is in frame {frame_id!r}, the fixed frame is {self._fixed_frame!r}",
            )
            return
        self._own_ship_frame = sample.child_frame_id
        if self._poses_are_ahead(sample.stamp):
            self._restart_poses(sample.stamp)
        if self._poses.add(sample):
            return
        self.drop(
            "own_ship_late", f"own-ship data of {sample.stamp:.3f} s is not newer than the last"
        )
        if self._poses.late_span > self._settings.session.own_ship_timeout:
            self._report("own_ship_restart", f"own-ship data starts over at {sample.stamp:.3f} s")
            self._restart_poses(sample.stamp)

    def add_scan(self, arrived: SensorScan, now: Now) -> None:
        """Take a scan that arrived at the time `now`."""
        self.arrived_stamp = arrived.scan.stamp
        arrived = self._with_frame(arrived)
        if not self._frame_is_known(arrived) or self._is_too_large(arrived.scan):
            return
        self._sensor_frame = arrived.frame_id
        if self._fixed_frame is None and not self._moves:
            self._fixed_frame = arrived.frame_id
        self._waiting.append((now, arrived))
        if len(self._waiting) > QUEUE_LENGTH:
            self._waiting.popleft()
            self._arrival = None
            self.drop("queue_full", f"more than {QUEUE_LENGTH} scans wait for own-ship data")

    def add_tracked(self, report: TrackerReport) -> None:
        """Take what a downstream tracker says that it tracks; the newest counts at the next scan.

        Targets that cannot be used are left out, see `downstream_tracker.usable`.
        """
        if self._fixed_frame is not None and not self._is_in_fixed_frame(report):
            return
        if 0.0 < self._tracked_stamp - report.stamp <= self._settings.session.restart_jump:
            self.drop("tracked_late", f"tracked targets of {report.stamp:.3f} s came late")
            return
        tracks, dropped = usable(report.tracks)
        for reason, number in dropped.items():
            self.drop(reason, f"{number} tracked targets dropped: {reason}", number)
        self._tracked = dataclasses.replace(report, tracks=tracks)
        self._tracked_stamp = report.stamp

    def process(self, now: Now = math.inf, *, last: bool = False) -> Iterator[ScanResult]:
        """Process the scans that can be, in order.

        One whose stamp is far back waits for the next: only that tells a restart from a bad stamp.

        Parameters
        ----------
        now : float or tuple of float
            Time on the clock of `add_scan`, s; of several clocks the one counts by which a scan
            has waited least. Scans that waited too long for own-ship data are dropped; by default
            none waits any longer.
        last : bool, optional
            Whether no scan follows any more.

        Yields
        ------
        ScanResult
        """
        while self._waiting and self._judge_first(last):
            since, arrived = self._waiting.popleft()
            waiting = waited(since, now)
            result = None
            try:
                if self._must_wait(arrived, waiting):
                    self._waiting.appendleft((since, arrived))
                    return
                result = self._result(arrived, waiting)
            except FAILURES as error:
                self.drop("internal_error", f"a scan could not be processed: {error!r}")
            self._arrival = None
            if result is not None:
                yield result

    def figures(self) -> SessionSnapshot:
        """State of the session, by which its health is judged."""
        initiator = self.initiator
        newest = None if self._poses_restarted else initiator.stamp
        if self._waiting:
            newest = self._waiting[-1][1].scan.stamp
        return SessionSnapshot(
            totals=self.totals,
            potential_tracks=initiator.statistics.potential_tracks,
            tracks=len(initiator.hold.current),
            dropped=dict(self.dropped),
            waiting=len(self._waiting),
            detection_probability=initiator.detection_probability,
            detection_probability_estimated=initiator.estimated_detection_probability,
            clutter_density=initiator.clutter_density,
            coverage_area=initiator.sensor.coverage_area,
            own_ship_source=self.source,
            mounting=self.mounting,
            own_ship_stamp=self.own_ship_stamp,
            scan_stamp=newest,
            tracker=initiator.hold.tracker.value,
        )

    def _is_too_large(self, scan: Scan) -> bool:
        limit = self._settings.common.max_detections
        if len(scan) > limit:
            self.drop(
                "too_many_detections",
                f"a scan of {len(scan)} detections is more than max_detections = {limit}",
            )
        return len(scan) > limit

    def _forget_frames(self) -> None:
        options = self._settings.session
        self._fixed_frame = options.fixed_frame or None
        self._sensor_frame = options.sensor_frame or None
        self._own_ship_frame = ""

    def _forget_tracker(self) -> None:
        """Forget a downstream tracker's report that no scan has used yet."""
        self._tracked, self._tracked_stamp = None, -math.inf

    @property
    def fixed_frame(self) -> str:
        """Frame of the tracks; empty while it is not known."""
        return self._fixed_frame or ""

    def _with_frame(self, arrived: SensorScan) -> SensorScan:
        """A scan that names no frame is in the one given, if there is one."""
        options = self._settings.session
        given = options.sensor_frame or ("" if self._moves else options.fixed_frame)
        return dataclasses.replace(arrived, frame_id=arrived.frame_id or given)

    def _frame_is_known(self, arrived: SensorScan) -> bool:
        if not arrived.frame_id:
            self.drop("empty_frame", "detections name no frame, nor does sensor_frame")
            return False
        frames = [self._sensor_frame]
        if not self._moves and not arrived.north_referenced:
            frames.append(self._fixed_frame)  # nothing tells where else the sensor might be
        for expected in frames:
            if expected is not None and arrived.frame_id != expected:
                self.drop(
                    "unknown_frame",
                    f"detections are in frame {arrived.frame_id!r}, expected is {expected!r}",
                )
                return False
        return True

    def _judge_first(self, last: bool) -> bool:
        """Judge the stamp of the first scan that waits; False where only the next one tells."""
        if self._arrival is not None:
            return True
        arrived = self._waiting[0][1]
        stamp = arrived.scan.stamp
        arrival = self._order.judge(stamp)
        if self._order.is_far_back(stamp):
            if len(self._waiting) == 1 and not last:
                return False
            arrival = Arrival.FAR_BACK
            if len(self._waiting) > 1:
                since, following = self._waiting[1]
                if self._order.is_confirmed(stamp, following.scan.stamp):
                    arrival = Arrival.RESTART
                    self._waiting[0] = since, arrived  # until now it did not wait for own-ship data
        if arrival is Arrival.RESTART and not self._poses_restarted:
            self._restart_poses(stamp)  # those of before place nothing after it
        self._arrival = arrival
        return True

    def _must_wait(self, arrived: SensorScan, waiting: float) -> bool:
        """Whether the first scan needs own-ship data that may still come."""
        if not self._moves or self._arrival in UNUSABLE:
            return False
        first, last = registration.echo_span(arrived)
        if self.look_up is not None:
            self.look_up(arrived.frame_id, first, last, arrived.axes)
        timed_out = waiting >= self._settings.session.own_ship_timeout
        return self._poses.coverage(first, last) is PoseCoverage.NOT_YET and not timed_out

    def _result(self, arrived: SensorScan, waiting: float) -> ScanResult | None:
        """Process the first scan, which need not wait; None where it is dropped."""
        arrival, stamp = self._arrival, arrived.scan.stamp
        assert arrival is not None
        if arrival in UNUSABLE:
            reason = "stamp_not_set" if stamp == 0.0 else f"scan_{arrival.value}"
            self.drop(reason, f"the scan of {stamp:.3f} s is not later than the last one")
            return None
        if self._is_too_large(arrived.scan):
            return None
        placed = self._placed(arrived)
        if placed is None:
            return None
        self._order.accept(stamp, arrival)
        self._poses_restarted = False
        self._start_over(arrival, stamp)
        return self._run(placed, arrival, arrived.stamp_ns, waiting)

    def _placed(self, arrived: SensorScan) -> Scan | None:
        """The scan in the fixed frame; None where it cannot be placed, which is reported."""
        scan = arrived.scan
        # Azimuths from north say where in a sector they are only with the heading.
        sector = not self._settings.sensor.all_round
        if not self._moves:
            if sector and arrived.north_referenced:
                self.drop("heading_unknown", "no heading: bearings from north need it in a sector")
                return None
            return self._with_usable_rates(scan, registration.at_rest(arrived))
        first, last = registration.echo_span(arrived)
        coverage = self._poses.coverage(first, last)
        if coverage is PoseCoverage.NEVER or not (
            coverage is PoseCoverage.YES or self._poses.can_extrapolate(last)
        ):
            reason = "own_ship_stale" if len(self._poses) else "own_ship_missing"
            self.drop(reason, f"no own-ship data for the scan of {scan.stamp:.3f} s")
            return None
        self._say_of_mounting(arrived.frame_id)
        covariance = self._poses.covariance(scan.stamp)
        needed = sector or not arrived.north_referenced or self._settings.mounting.offset
        if needed and covariance is not None and covariance[2, 2] > MAX_YAW_VARIANCE:
            self.drop("heading_unknown", "the own-ship data has no heading, but it is needed")
            return None
        found = registration.to_fixed_frame(
            arrived, self._poses, self._settings.mounting, sector=sector
        )
        lost = len(scan) - len(found)
        if lost:
            self.drop(
                "no_horizontal_range",
                f"{lost} detections dropped: straight above or below the tilted sensor",
                lost,
            )
        return self._with_usable_rates(scan, found)

    def _with_usable_rates(self, scan: Scan, placed: Scan) -> Scan:
        """The scan as placed; reports where that took range rates from it which would be used."""
        before, after = (
            np.isfinite(one.features.get("range_rate", ())).sum() for one in (scan, placed)
        )
        if after < before and self._settings.sensor.range_rate_std:
            self._report(
                "range_rate_unused",
                f"{before - after} range rates not used: measured too steeply above or below the "
                "horizontal, or the sensor's velocity is not known",
            )
        return placed

    @property
    def mounting(self) -> str:
        """Whether the sensor's place on the vessel is given, assumed, not needed or unknown yet."""
        if self.source != "odometry":
            return "not needed"
        if self._settings.mounting.given:
            return "given"
        if self._sensor_frame is None or self.own_ship_stamp is None:
            return "unknown"
        return "not needed" if self._own_ship_frame == self._sensor_frame else "assumed"

    def _say_of_mounting(self, frame_id: str) -> None:
        """Report, once for each pair of frames, that nobody says where the sensor is."""
        frames = self._own_ship_frame, frame_id
        if frames[0] in ("", frame_id) or self._settings.mounting.given:
            return
        if frames not in self._said_of_mounting:
            self._said_of_mounting.add(frames)
            self._report(
                "mounting",
                f"own-ship data is of frame {frames[0]!r}, detections are in {frames[1]!r}: taken "
                "to be the same place and direction, as no mounting is given",
            )

    def _poses_are_ahead(self, stamp: float) -> bool:
        last = self._poses.last_stamp
        return last is not None and last - stamp > self._settings.session.restart_jump

    def _restart_poses(self, stamp: float) -> None:
        self._poses.start_over()
        if self._poses_are_ahead(stamp):
            self._poses.clear()
        self._poses_restarted = True

    def _start_over(self, arrival: Arrival, stamp: float) -> None:
        """Drop what cannot continue across a restart or a long gap."""
        if arrival is Arrival.RESTART:
            self._report("restart", f"stamps went back to {stamp:.3f} s: starting over")
            self._reset_initiator()
            self._forget_tracker()
        elif arrival is Arrival.GAP:
            self._report("gap", f"long gap before {stamp:.3f} s: potential tracks dropped")
            self.initiator.forget_potential_tracks()

    def _reset_initiator(self) -> None:
        self._totals_before = self.totals
        self.initiator.reset()

    def _is_in_fixed_frame(self, report: TrackerReport) -> bool:
        inside = report.frame_id == self._fixed_frame
        if not inside:
            self.drop(
                "tracked_frame",
                f"tracked targets are in frame {report.frame_id!r}, the fixed frame is "
                f"{self._fixed_frame!r}",
            )
        return inside

    def _follow_tracker(self, stamp: float) -> None:
        """Give the hold the downstream tracker's report, before the scan of a stamp (s)."""
        report, self._tracked = self._tracked, None
        if report is None or not self._is_in_fixed_frame(report):
            return
        if not abs(stamp - report.stamp) <= self._settings.common.tracked_timeout:
            self._tracked_stamp = -math.inf  # those that follow it are not late
            self.drop(
                "tracked_stale",
                f"tracked targets of {report.stamp:.3f} s are not of the time of the scan of "
                f"{stamp:.3f} s",
            )
            return
        self.initiator.hold.follow(report.stamp, report.tracks)

    def _say_of_tracker(self, before: Tracker) -> None:
        """Report where the downstream tracker fell silent or came back."""
        change = before, self.initiator.hold.tracker
        if change == (Tracker.ALIVE, Tracker.SILENT):
            timeout = self._settings.common.tracked_timeout
            self._report(
                "tracker_silent",
                f"the downstream tracker was silent for {timeout:g} s: its tracks are held here",
            )
        elif change == (Tracker.SILENT, Tracker.ALIVE):
            self._report("tracker_back", "the downstream tracker is heard again")

    def _run(self, scan: Scan, arrival: Arrival, stamp_ns: int, waiting: float) -> ScanResult:
        if self._live:
            self.initiator.max_scan_time = self._settings.session.max_scan_time
        tracker = self.initiator.hold.tracker
        try:
            self._follow_tracker(scan.stamp)
            begin = time.perf_counter()
            new = self.initiator.process(scan)
        except FAILURES:
            self._reset_initiator()  # what it holds is in no known state
            raise
        core_seconds = time.perf_counter() - begin
        self._say_of_tracker(tracker)
        statistics = self.initiator.statistics
        outside = statistics.outside_coverage
        if outside:
            self.drop(
                "outside_coverage",
                f"{outside} of {len(scan)} detections are not used: outside the coverage that "
                "sensor.min_range, max_range, azimuth_min and azimuth_max give",
                outside,
            )
        cut = statistics.cut_potential_tracks + statistics.cut_confirmations
        if cut:
            self._report("limit", f"a limit cut {cut} hypotheses at {scan.stamp:.3f} s")
        return ScanResult(
            stamp=scan.stamp,
            stamp_ns=stamp_ns,
            scan=scan,
            frame_id=self.fixed_frame,
            arrival=arrival,
            new=new,
            current=self.initiator.hold.current,
            ended=self.initiator.hold.ended,
            statistics=statistics,
            core_seconds=core_seconds,
            waiting=waiting,
        )
