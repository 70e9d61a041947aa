"""The initiator as it runs in a session: its time limit, its failures, and its counts."""

from __future__ import annotations

import time

from tsepm_ros.initiation.statistics import ScanStatistics
from tsepm_ros.kinematics.track import TrackArrays
from tsepm_ros.maintenance.downstream_tracker import Tracker, TrackerReport
from tsepm_ros.sensing.scan import Scan
from tsepm_ros.session.refusal import FAILURES, Notice, Refusal, Remark
from tsepm_ros.settings.settings import Settings


class InitiatorRun:
    """Runs the initiator that settings describe, through failures and changes of the settings.

    Parameters
    ----------
    settings : Settings
    live : bool
        Whether `max_scan_time` holds.

    Attributes
    ----------
    initiator : Initiator
    """

    def __init__(self, settings: Settings, *, live: bool) -> None:
        self._settings = settings
        self._live = live
        self.initiator = settings.make_initiator()
        self._totals_before = ScanStatistics()  # of runs that are over

    @property
    def totals(self) -> ScanStatistics:
        """Sums over the scans since the start or the last `reset`, whatever started over since."""
        return self._totals_before + self.initiator.totals

    def configure(self, settings: Settings) -> bool:
        """Change settings; where that raises, nothing has changed.

        Returns
        -------
        bool
            Whether potential tracks were kept. Another method, or another number of hits, starts
            over.
        """
        kept = self.initiator.configure(settings.make_method())
        self._settings = settings
        return kept

    def rehearse(self, settings: Settings) -> None:
        """Raise what `configure` would; nothing changes."""
        self.initiator.rehearse(settings.make_method())

    def reset(self) -> list[int]:
        """Forget tracks and counts; returns the ids of the tracks that end."""
        self.initiator.reset()
        self._totals_before = ScanStatistics()
        return self.initiator.maintenance.take_cleared()

    def start_over(self) -> None:
        """Forget tracks; counts go on."""
        self._totals_before = self.totals
        self.initiator.reset()

    def process(self, scan: Scan, report: TrackerReport | None) -> tuple[TrackArrays, float]:
        """Process a scan, after a downstream tracker's report.

        Returns
        -------
        new : TrackArrays
            Newly confirmed tracks.
        seconds : float
            Time that the initiator took.

        Raises
        ------
        FAILURES
            Everything is forgotten then: what the initiator holds is in no known state.
        """
        if self._live:
            self.initiator.max_scan_time = self._settings.session.max_scan_time
        try:
            if report is not None:
                self.initiator.maintenance.follow(report.stamp, report.tracks)
            begin = time.perf_counter()
            new = self.initiator.process(scan)
        except FAILURES:
            self.start_over()
            raise
        return new, time.perf_counter() - begin

    def remarks(self, scan: Scan, tracker_before: Tracker) -> list[Remark]:
        """What there is to say after a scan that was processed.

        Parameters
        ----------
        scan : Scan
        tracker_before : Tracker
            The downstream tracker's state before it.
        """
        remarks: list[Remark] = []
        change = tracker_before, self.initiator.maintenance.tracker
        if change == (Tracker.ALIVE, Tracker.SILENT):
            timeout = self._settings.common.tracked_timeout
            remarks.append(
                Notice(
                    "tracker_silent",
                    f"the downstream tracker was silent for {timeout:g} s: its tracks are held "
                    "here",
                )
            )
        elif change == (Tracker.SILENT, Tracker.ALIVE):
            remarks.append(Notice("tracker_back", "the downstream tracker is heard again"))
        statistics = self.initiator.statistics
        outside = statistics.outside_coverage
        if outside:
            remarks.append(
                Refusal(
                    "outside_coverage",
                    f"{outside} of {len(scan)} detections are not used: outside the coverage that "
                    "sensor.min_range, max_range, azimuth_min and azimuth_max give",
                    outside,
                )
            )
        cut = statistics.cut_potential_tracks + statistics.cut_confirmations
        if cut:
            remarks.append(Notice("limit", f"a limit cut {cut} hypotheses at {scan.stamp:.3f} s"))
        return remarks
