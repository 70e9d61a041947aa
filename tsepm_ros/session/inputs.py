"""Inputs beside the detections: own ship, external tracks, land.

Arriving own-ship data: accepted, refused, or restarted.

Arriving reports of the downstream tracker.

Arriving charts.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np

from tsepm_ros.own_ship import registration
from tsepm_ros.own_ship.pose_history import PoseCoverage, PoseHistory, PoseSample
from tsepm_ros.own_ship.registration import SensorScan
from tsepm_ros.session.drop_reasons import Notice, Refusal, Remark
from tsepm_ros.session.message_check import leap_seconds
from tsepm_ros.settings.node_options import SessionOptions
from tsepm_ros.tracker.clutter.land import LandMask
from tsepm_ros.tracker.maintenance.external_tracker import TrackerReport, usable

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
        self.poses = PoseHistory(
            max_extrapolation=options.own_ship_max_extrapolation,
            max_gap=options.own_ship_max_gap,
        )
        self.restarted = False
        self.look_up: LookUp | None = None
        self.read_unread: ReadUnread | None = None
        self._options = options
        self._missing = ""

    @property
    def moves(self) -> bool:
        """Whether the sensor moves in the fixed frame."""
        return self.source != "none"

    def configure(self, options: SessionOptions) -> None:
        """Change the limits on times."""
        self._options = options
        self.poses.max_extrapolation = options.own_ship_max_extrapolation
        self.poses.max_gap = options.own_ship_max_gap

    def reset(self) -> None:
        """Discard the poses."""
        self.poses.clear()
        self.restarted = False

    def add(self, sample: PoseSample) -> Refusal | None:
        """Add a sample, or refuse a late sample; a sample far back restarts the poses."""
        if self._is_ahead(sample.stamp):
            self.restart(sample.stamp)
        if self.poses.add(sample):
            return None
        return Refusal(
            "own_ship_late",
            f"own-ship data at {sample.stamp:.3f} s is not newer than the last sample",
        )

    def restart_if_late_for_long(self, stamp: float) -> Notice | None:
        """Restart at a stamp (s) if only late samples arrived for longer than the timeout."""
        if self.poses.late_span <= self._options.own_ship_timeout:
            return None
        self.restart(stamp)
        return Notice("own_ship_restart", f"own-ship data restarts at {stamp:.3f} s")

    def restart(self, stamp: float) -> None:
        """Restart at a stamp (s): earlier poses are not used for later scans."""
        self.poses.start_over()
        if self._is_ahead(stamp):
            self.poses.clear()
        self.restarted = True

    def without_late_echoes(self, arrived: SensorScan) -> tuple[SensorScan, Refusal | None]:
        """Leave out the echoes at times for which a moving sensor's scan would wait in vain."""
        if not self.moves:
            return arrived, None
        usable = registration.usable_echoes(arrived)
        lost = len(usable) - int(np.count_nonzero(usable))
        if not lost:
            return arrived, None
        refusal = Refusal(
            "echo_too_late",
            f"{lost} detections dropped: {registration.MAX_ECHO_TIME:g} s or more from their ping",
            lost,
        )
        return registration.selected(arrived, usable), refusal

    def must_wait(self, arrived: SensorScan, waiting: float) -> bool:
        """Whether a scan that waited for a time (s) needs poses that may still arrive."""
        if not self.moves:
            return False
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

    def refuse(self, arrived: SensorScan) -> Refusal | None:
        """Refuse a scan that need not wait and has no poses."""
        if not self.moves:
            return None
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
        return Refusal(reason, f"{sentence}: {self._missing}" if self._missing else sentence)

    def _is_ahead(self, stamp: float) -> bool:
        last = self.poses.last_stamp
        return last is not None and last - stamp > self._options.restart_jump


class DownstreamInput:
    """The newest report, until a scan uses it."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Discard the report and the stamp of the last report."""
        self._report: TrackerReport | None = None
        self._stamp = -math.inf

    def refuse(self, report: TrackerReport, restart_jump: float) -> Refusal | None:
        """Refuse a late report; a step back of more than `restart_jump` (s) is a restart."""
        if 0.0 < self._stamp - report.stamp <= restart_jump:
            return Refusal("tracked_late", f"tracked targets at {report.stamp:.3f} s arrived late")
        return None

    def add(self, report: TrackerReport) -> list[Refusal]:
        """Take a report; return refusals of its targets, see `downstream_tracker.usable`."""
        tracks, dropped = usable(report.tracks)
        self._report = dataclasses.replace(report, tracks=tracks)
        self._stamp = report.stamp
        return [
            Refusal(reason, f"{number} tracked targets dropped: {reason}", number)
            for reason, number in dropped.items()
        ]

    def take(self) -> TrackerReport | None:
        """Remove and return the report, for the next scan."""
        report, self._report = self._report, None
        return report

    def refuse_at(self, report: TrackerReport, stamp: float, timeout: float) -> Refusal | None:
        """Refuse a report whose stamp differs from a scan's (s) by more than the timeout (s)."""
        if abs(stamp - report.stamp) <= timeout:
            return None
        self._stamp = -math.inf  # later reports are not late relative to it
        return Refusal(
            "tracked_stale",
            f"tracked targets at {report.stamp:.3f} s do not match the time of the scan at "
            f"{stamp:.3f} s",
        )


class LandInput:
    """The newest chart, from its arrival until the fixed frame is known.

    Attributes
    ----------
    mask : LandMask or None
        The chart in use.
    """

    def __init__(self) -> None:
        self.mask: LandMask | None = None
        self._frame = ""
        self._new: tuple[LandMask | None, str] | None = None

    def add(self, mask: LandMask | None, frame_id: str) -> None:
        """Take a chart, or None for an empty chart, in a frame."""
        self._new = mask, frame_id

    def reset(self) -> None:
        """Wait for the fixed frame again: a chart is published once."""
        if self._new is None and self.mask is not None:
            self._new = self.mask, self._frame
        self.mask = None

    def settle(self, fixed: str) -> Remark | None:
        """Use or refuse the newest chart, once the fixed frame is known; it replaces the last."""
        if self._new is None or not fixed:
            return None
        (mask, frame), self._new = self._new, None
        if mask is None:
            had, self.mask = self.mask is not None, None
            return Notice("land", "land is empty: no detections are left out") if had else None
        if frame != fixed:
            return Refusal(
                "land_frame", f"land is in frame {frame!r}, the fixed frame is {fixed!r}"
            )
        self.mask, self._frame = mask, frame
        return Notice(
            "land",
            f"land: detections on {mask.cells} cells of {mask.resolution:g} m are left out",
        )
