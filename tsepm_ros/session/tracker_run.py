"""The initiator in a session: its time limit, failures and counts."""

from __future__ import annotations

import time
from collections import Counter
from typing import Any

from tsepm_ros.session.drop_reasons import FAILURES, Notice, Refusal, Remark
from tsepm_ros.session.sensor_check import SensorCheck, findings
from tsepm_ros.settings.settings import Settings
from tsepm_ros.tracker.maintenance.external_tracker import ExternalTracker, TrackerReport
from tsepm_ros.tracker.maintenance.stationary import Status
from tsepm_ros.tracker.method import ScanStatistics
from tsepm_ros.tracker.scan import Scan
from tsepm_ros.tracker.tracks import TrackArrays


class TrackerRun:
    """Runs the initiator of the settings, through failures and changes of the settings.

    Parameters
    ----------
    settings : Settings
    live : bool
        Whether `max_scan_time` is applied.

    Attributes
    ----------
    initiator : Tracker
    check : SensorCheck
        Compares the sensor's figures as given with what the scans show.
    """

    def __init__(self, settings: Settings, *, live: bool) -> None:
        self._settings = settings
        self._live = live
        self.tracker = settings.make_initiator()
        self.check = SensorCheck()
        self._strengths_count = False
        self._totals_before = ScanStatistics()  # of runs before the last `start_over`
        self._ends: Counter[str] = Counter()

    @property
    def totals(self) -> ScanStatistics:
        """Sums over the scans since the start or the last `reset`, across calls of `start_over`."""
        return self._totals_before + self.tracker.totals

    def configure(self, settings: Settings) -> bool:
        """Change settings; an error leaves them unchanged.

        Returns
        -------
        bool
            Whether potential tracks were kept. A change of the method or of the number of hits
            discards them.
        """
        self.tracker, kept = self.tracker.with_settings(settings.make_method())
        self._settings = settings
        self.check.say_again()
        return kept

    def rehearse(self, settings: Settings) -> None:
        """Raise the errors of `configure`, without a change."""
        self.tracker.with_settings(settings.make_method())

    def reset(self) -> None:
        """Discard tracks and counts."""
        self.tracker.reset()
        self.check = SensorCheck()
        self._totals_before = ScanStatistics()
        self._ends.clear()

    def start_over(self) -> None:
        """Discard tracks and keep counts."""
        self._totals_before = self.totals
        self.tracker.reset()
        self.check = SensorCheck()

    def process(self, scan: Scan, report: TrackerReport | None) -> tuple[TrackArrays, float]:
        """Process a downstream tracker's report, then a scan.

        Returns
        -------
        new : TrackArrays
            Newly confirmed tracks.
        seconds : float
            Computing time of the initiator, s.

        Raises
        ------
        FAILURES
            All tracks are discarded then, because the initiator's state is undefined.
        """
        if self._live:
            self.tracker.max_scan_time = self._settings.session.max_scan_time
        try:
            if report is not None:
                self.tracker.maintenance.follow(report.stamp, report.tracks)
            begin = time.perf_counter()
            new = self.tracker.process(scan)
        except FAILURES:
            self.start_over()
            raise
        seconds = time.perf_counter() - begin
        self._ends.update(self.tracker.maintenance.ended.values())
        outside = self.tracker.statistics.outside_coverage
        self.check.observe(scan.stamp, len(new), outside, len(scan))
        return new, seconds

    def figures(self) -> dict[str, Any]:
        """The fields of a `SessionSnapshot` that describe the initiator."""
        initiator = self.tracker
        check = self.check.figures(initiator)
        states = Counter(initiator.maintenance.held.status.tolist())
        return {
            "totals": self.totals,
            "potential_tracks": initiator.statistics.potential_tracks,
            "tracks": len(initiator.current),
            "states": {state.name.lower(): states[state] for state in Status},
            "ends": dict(self._ends),
            "fixed_echoes": len(initiator.fixed_echoes),
            "detection_probability": initiator.detection_probability,
            "detection_probability_estimated": initiator.estimated_detection_probability,
            "clutter_density": initiator.clutter_density,
            "coverage_area": initiator.covered_area,
            "intensity": initiator.intensity,
            "sensor_findings": findings(check),
            "sensor_figures": check,
            "tracker": initiator.maintenance.tracker.value,
        }

    def remarks(
        self, scan: Scan, tracker_before: ExternalTracker, several_before: bool
    ) -> list[Remark]:
        """Return notices and refusals after a processed scan.

        Parameters
        ----------
        scan : Scan
        tracker_before : ExternalTracker
            State of the downstream tracker before the scan.
        several_before : bool
            Whether targets were seen before the scan to have several detections a ping.
        """
        remarks: list[Remark] = []
        change = tracker_before, self.tracker.maintenance.tracker
        if change == (ExternalTracker.ALIVE, ExternalTracker.SILENT):
            timeout = self._settings.common.tracked_timeout
            remarks.append(
                Notice(
                    "tracker_silent",
                    f"the downstream tracker was silent for {timeout:g} s: this node "
                    "maintains its tracks",
                )
            )
        elif change == (ExternalTracker.SILENT, ExternalTracker.ALIVE):
            remarks.append(Notice("tracker_back", "the downstream tracker reports again"))
        if self.tracker.plots.seen and not several_before:
            remarks.append(Notice("plots", self.tracker.plots.sentence))
        statistics = self.tracker.statistics
        outside = statistics.outside_coverage
        if outside:
            remarks.append(
                Refusal(
                    "outside_coverage",
                    f"{outside} of {len(scan)} detections dropped: outside the coverage of "
                    "sensor.min_range, max_range, azimuth_min and azimuth_max",
                    outside,
                )
            )
        if statistics.on_land:
            remarks.append(Refusal("on_land", "", statistics.on_land))
        remarks += [Notice(*news) for news in self.check.news(self.tracker)]
        counted, self._strengths_count = (
            self._strengths_count,
            self.tracker.uses_intensity,
        )
        if counted != self._strengths_count:
            remarks.append(
                Notice("intensity", f"the intensity of detections is {self.tracker.intensity}")
            )
        cut = statistics.cut_potential_tracks + statistics.cut_confirmations
        if cut:
            remarks.append(Notice("limit", f"a limit cut {cut} hypotheses at {scan.stamp:.3f} s"))
        return remarks
