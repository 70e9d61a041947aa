"""Arriving reports of the downstream tracker."""

from __future__ import annotations

import dataclasses
import math

from tsepm_ros.maintenance.downstream_tracker import TrackerReport, usable
from tsepm_ros.session.refusal import Refusal


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
