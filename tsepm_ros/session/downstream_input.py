"""The downstream tracker's reports as they arrive."""

from __future__ import annotations

import dataclasses
import math

from tsepm_ros.maintenance.downstream_tracker import TrackerReport, usable
from tsepm_ros.session.refusal import Refusal


class DownstreamInput:
    """The newest report that no scan has used yet."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Forget the report, and that others came before it."""
        self._report: TrackerReport | None = None
        self._stamp = -math.inf

    def refuse(self, report: TrackerReport, restart_jump: float) -> Refusal | None:
        """Why a report comes too late; one that is later by `restart_jump`, s, is a restart."""
        if 0.0 < self._stamp - report.stamp <= restart_jump:
            return Refusal("tracked_late", f"tracked targets of {report.stamp:.3f} s came late")
        return None

    def add(self, report: TrackerReport) -> list[Refusal]:
        """Take a report; returns what of it cannot be used, see `downstream_tracker.usable`."""
        tracks, dropped = usable(report.tracks)
        self._report = dataclasses.replace(report, tracks=tracks)
        self._stamp = report.stamp
        return [
            Refusal(reason, f"{number} tracked targets dropped: {reason}", number)
            for reason, number in dropped.items()
        ]

    def take(self) -> TrackerReport | None:
        """Take the report out, for the next scan."""
        report, self._report = self._report, None
        return report

    def refuse_at(self, report: TrackerReport, stamp: float, timeout: float) -> Refusal | None:
        """Why a report is not of the time of the scan of a stamp (s)."""
        if abs(stamp - report.stamp) <= timeout:
            return None
        self._stamp = -math.inf  # those that follow it are not late
        return Refusal(
            "tracked_stale",
            f"tracked targets of {report.stamp:.3f} s are not of the time of the scan of "
            f"{stamp:.3f} s",
        )
