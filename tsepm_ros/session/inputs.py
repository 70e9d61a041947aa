"""What a scan needs beside its detections: frames, own ship, external tracks, land.

The names of the frames in use, the poses of a moving sensor, the registration of a scan by both in
the fixed frame, and the newest messages of an external tracker and of a chart. Each refuses what it
cannot use; the session counts and reports the refusals.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np

from tsepm_ros.own_ship import registration
from tsepm_ros.own_ship.attitude import stated_axes, without_suffix
from tsepm_ros.own_ship.pose_history import PoseCoverage, PoseHistory, PoseSample
from tsepm_ros.own_ship.registration import Mounting, SensorScan
from tsepm_ros.session.consistency_checks import leap_seconds
from tsepm_ros.session.drop_reasons import Notice, Rejection, Remark
from tsepm_ros.settings.node_options import SessionOptions
from tsepm_ros.settings.settings import Settings
from tsepm_ros.tracker.clutter.land import LandMask
from tsepm_ros.tracker.maintenance.external_tracker import TrackerReport, usable
from tsepm_ros.tracker.scan import Scan

MAX_NOTICED = 100
"""Pairs of frames that are remembered as noticed: a source may name a new frame each time."""


class Frames:
    """The frames in use: from the options, else from the first messages.

    Parameters
    ----------
    options : SessionOptions
    moves : bool
        Whether the sensor moves in the fixed frame.

    Attributes
    ----------
    options : SessionOptions
        May be replaced; the frames in use stay until `reset`.
    fixed, sensor, own_ship : str
        Frame of the tracks, of the detections and of the vessel; empty while unknown.
    """

    def __init__(self, options: SessionOptions, *, moves: bool) -> None:
        self.options = options
        self._moves = moves
        self._noticed: set[tuple[str, str]] = set()
        self.reset()

    def reset(self) -> None:
        """Return to the frames of the options."""
        self.fixed = self.options.fixed_frame.lstrip("/")  # as tf2
        self.sensor = self.options.sensor_frame.lstrip("/")
        self.own_ship = ""

    def admit(
        self, arrived: SensorScan, max_detections: int
    ) -> tuple[SensorScan, Rejection | None]:
        """A scan with its frame, which is adopted; or a refusal of its size or frame.

        An empty frame becomes the frame of the options, if any.
        """
        if not arrived.frame_id:
            given = self.options.sensor_frame or ("" if self._moves else self.options.fixed_frame)
            arrived = dataclasses.replace(arrived, frame_id=given.lstrip("/"))
        frame_id = arrived.frame_id
        if not frame_id:
            said = "the frame_id of the detections is empty, and so is sensor_frame"
            return arrived, Rejection("empty_frame", said)
        stem = without_suffix(frame_id)
        expected = [(self.sensor, [frame_id])]
        if not self._moves and not arrived.north_referenced:
            # No pose relates another sensor frame to it.
            expected.append((self.fixed, [frame_id, stem]))
        for frame, names in expected:
            if frame and frame not in names:
                said = f"detections are in frame {frame_id!r}, expected {frame!r}"
                return arrived, Rejection("unknown_frame", said)
        refusal = self.refuse_size(arrived, max_detections)
        if refusal is None:
            self.sensor = frame_id
            if not self.fixed and not self._moves:
                self.fixed = stem
        return arrived, refusal

    def refuse_size(self, arrived: SensorScan, limit: int) -> Rejection | None:
        """Refuse a scan with more detections than the limit."""
        number = len(arrived.scan.range)
        if number <= limit:
            return None
        said = f"a scan has {number} detections, more than max_detections = {limit}"
        return Rejection("too_many_detections", said)

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

    def mounting_state(self, mounting: Mounting, own_ship_known: bool) -> str:
        """Whether the mounting is given, assumed, not needed or unknown yet."""
        if mounting.given:
            return "given"
        if not self.sensor or not own_ship_known:
            return "unknown"
        coincide = without_suffix(self.own_ship) == without_suffix(self.sensor)
        return "not needed" if coincide else "assumed"

    def notices(self, mounting: Mounting) -> list[Notice]:
        """Notices of how frames are read by their names, and the mounting, once for each pair."""
        own_ship, sensor, fixed = self.own_ship, self.sensor, self.fixed
        pair = (own_ship, sensor) if self._moves else (fixed, sensor)
        if pair in self._noticed or not fixed:
            return []
        if len(self._noticed) == MAX_NOTICED:
            self._noticed.clear()
        self._noticed.add(pair)
        stem = without_suffix(sensor)
        axes = f"the name of frame {sensor!r} states its axes (REP-103)"
        origin = f"tracks are in frame {fixed!r}, x ahead, y to port and z up from the same origin"
        sense = "mounting.y is to port, mounting.yaw counter-clockwise from the bow"
        frames = f"own-ship data is for frame {own_ship!r}, detections are in {sensor!r}"
        assumed = "no mounting is given, so the frames are assumed to coincide"
        down, turned = stated_axes(fixed) == "down", stated_axes(own_ship) != "body"
        apart = bool(own_ship) and without_suffix(own_ship) != stem
        said = [
            (down, "fixed_frame", f"tracks have x north and y east, as {fixed!r} says"),
            (not (down or self._moves or stem == sensor), "fixed_frame", f"{axes}: {origin}"),
            (turned and mounting.given, "mounting", f"{sense}, whatever {own_ship!r} says"),
            (apart and not mounting.given, "mounting", f"{frames}: {assumed}"),
        ]
        return [Notice(*one) for applies, *one in said if applies]


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
        self.poses = PoseHistory(
            max_extrapolation=options.own_ship_max_extrapolation,
            max_gap=options.own_ship_max_gap,
        )
        self.restarted = False
        self.look_up: LookUp | None = None
        self.read_unread: ReadUnread | None = None
        self._options = options
        self._missing = ""

    def configure(self, options: SessionOptions) -> None:
        """Change the limits on times."""
        self._options = options
        self.poses.max_extrapolation = options.own_ship_max_extrapolation
        self.poses.max_gap = options.own_ship_max_gap

    def reset(self) -> None:
        """Discard the poses."""
        self.poses.clear()
        self.restarted = False

    def add(self, sample: PoseSample) -> list[Remark]:
        """Add a sample, or refuse a late one; a sample far back restarts the poses.

        So do late samples alone for longer than the timeout, with a notice.
        """
        if self._is_ahead(sample.stamp):
            self.restart(sample.stamp)
        if self.poses.add(sample):
            return []
        stamp = f"own-ship data at {sample.stamp:.3f} s"
        remarks: list[Remark] = [
            Rejection("own_ship_late", f"{stamp} is not newer than the last sample")
        ]
        if self.poses.late_span > self._options.own_ship_timeout:
            self.restart(sample.stamp)
            said = f"own-ship data restarts at {sample.stamp:.3f} s"
            remarks.append(Notice("own_ship_restart", said))
        return remarks

    def restart(self, stamp: float) -> None:
        """Restart at a stamp (s): earlier poses are not used for later scans."""
        self.poses.start_over()
        if self._is_ahead(stamp):
            self.poses.clear()
        self.restarted = True

    def without_late_echoes(self, arrived: SensorScan) -> tuple[SensorScan, Rejection | None]:
        """Leave out the echoes at times for which a moving sensor's scan would wait in vain."""
        usable = registration.usable_echoes(arrived)
        lost = len(usable) - int(np.count_nonzero(usable))
        if not lost:
            return arrived, None
        refusal = Rejection(
            "echo_too_late",
            f"{lost} detections dropped: {registration.MAX_ECHO_TIME:g} s or more from their ping",
            lost,
        )
        return registration.selected(arrived, usable), refusal

    def must_wait(self, arrived: SensorScan, waiting: float) -> bool:
        """Whether a scan that waited for a time (s) needs poses that may still arrive."""
        first, last = registration.echo_span(arrived)
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

    def refuse(self, arrived: SensorScan) -> Rejection | None:
        """Refuse a scan that need not wait and has no poses."""
        first, last = registration.echo_span(arrived)
        coverage = self.poses.coverage(first, last)
        reaches = coverage is PoseCoverage.YES or self.poses.can_extrapolate(last)
        if coverage is not PoseCoverage.NEVER and reaches:
            return None
        reason = "own_ship_stale" if len(self.poses) else "own_ship_missing"
        sentence = f"no own-ship data for the scan at {arrived.scan.stamp:.3f} s"
        newest = self.poses.last_stamp
        if newest is not None:
            side = "before" if newest < last else "after"
            sentence += f", the newest is {abs(newest - last):.3g} s {side} its last echo"
            sentence += leap_seconds(newest - last)
        return Rejection(reason, f"{sentence}: {self._missing}" if self._missing else sentence)

    def _is_ahead(self, stamp: float) -> bool:
        last = self.poses.last_stamp
        return last is not None and last - stamp > self._options.restart_jump


MAX_YAW_VARIANCE = math.pi**2
"""Variance of the heading above which the heading is unknown, rad^2."""


def register(
    arrived: SensorScan, own_ship: OwnShipInput, frames: Frames, settings: Settings
) -> tuple[Scan | None, list[Remark]]:
    """Register a scan in the fixed frame.

    Parameters
    ----------
    arrived : SensorScan
    own_ship : OwnShipInput
        The poses of a moving sensor.
    frames : Frames
    settings : Settings

    Returns
    -------
    scan : Scan or None
        None if the scan is refused.
    remarks : list of Refusal or Notice
        Of the scan, and of detections that are left out.
    """
    mounting, sensor = settings.mounting, settings.sensor
    remarks: list[Remark] = [*frames.notices(mounting)]
    refusal = _refuse_heading(arrived, own_ship, settings)
    if refusal is not None:
        return None, [*remarks, refusal]
    if own_ship.moves:
        sector = not sensor.all_round
        try:
            scan = registration.to_fixed_frame(arrived, own_ship.poses, mounting, sector=sector)
        except registration.PosesJumpError as error:
            return None, [*remarks, Rejection("own_ship_jump", str(error))]
        lost = len(arrived.scan) - len(scan)
        if lost:
            said = f"{lost} detections dropped: vertically above or below the tilted sensor"
            remarks.append(Rejection("no_horizontal_range", said, lost))
    else:
        scan = registration.at_rest(arrived)
        if stated_axes(frames.fixed) == "down" and not arrived.north_referenced:
            scan = scan.replaced(sensor_pose=np.array([0.0, 0.0, 0.5 * math.pi]))
    if sensor.range_rate_std:
        before, after = (
            int(np.isfinite(one.features.get("range_rate", ())).sum())
            for one in (arrived.scan, scan)
        )
        if before > after:
            said = (
                f"{before - after} range rates not used: the line of sight is too steep, or the "
                "sensor's velocity is unknown"
            )
            remarks.append(Notice("range_rate_unused", said))
    return scan, remarks


def _refuse_heading(
    arrived: SensorScan, own_ship: OwnShipInput, settings: Settings
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
    if not (sector or not arrived.north_referenced or settings.mounting.offset):
        return None
    covariance = own_ship.poses.covariance(arrived.scan.stamp)
    if covariance is None or covariance[2, 2] <= MAX_YAW_VARIANCE:
        return None
    return Rejection(
        "heading_unknown", "the detections need a heading, which the own-ship data does not have"
    )


class ExternalTrackerInput:
    """The newest report of the downstream tracker, until a scan uses it."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Discard the report and the stamp of the last report."""
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
            said = f"tracked targets at {report.stamp:.3f} s arrived late"
            return [Rejection("tracked_late", said)]
        tracks, dropped = usable(report.tracks)
        self._report = dataclasses.replace(report, tracks=tracks)
        self._stamp = report.stamp
        return [
            Rejection(reason, f"{number} tracked targets dropped: {reason}", number)
            for reason, number in dropped.items()
        ]

    def at(
        self, stamp: float, fixed: str, timeout: float
    ) -> tuple[TrackerReport | None, list[Remark]]:
        """Remove and return the report for the scan at a stamp, s; or refuse it.

        It is refused if its stamp differs from the scan's by more than the timeout, s.
        """
        report, self._report = self._report, None
        if report is None:
            return None, []
        if report.frame_id != fixed:
            return None, [_in_another_frame(report, fixed)]
        if abs(stamp - report.stamp) <= timeout:
            return report, []
        self._stamp = -math.inf  # later reports are not late relative to it
        said = (
            f"tracked targets at {report.stamp:.3f} s do not match the time of the scan at "
            f"{stamp:.3f} s"
        )
        return None, [Rejection("tracked_stale", said)]


def _in_another_frame(report: TrackerReport, fixed: str) -> Rejection:
    said = f"tracked targets are in frame {report.frame_id!r}, the fixed frame is {fixed!r}"
    return Rejection("tracked_frame", said)


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
        if self.new is None and self.mask is not None:
            self.new = self.mask, self._frame
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
            said = f"land is in frame {frame!r}, the fixed frame is {fixed!r}"
            return [Rejection("land_frame", said)]
        self.mask, self._frame = mask, frame
        said = f"land: detections on {mask.cells} cells of {mask.resolution:g} m are left out"
        return [Notice("land", said)]
