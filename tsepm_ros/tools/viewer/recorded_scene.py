"""A whole run as the page replays it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.session.result import ScanResult, vessel_pose
from tsepm_ros.session.scan_queue import Arrival
from tsepm_ros.tools.viewer.page_frames import Frame, encode, health_of_run, make_frame, track_facts
from tsepm_ros.tracker.maintenance.track_maintenance import ENDS
from tsepm_ros.tracker.measurement import convert
from tsepm_ros.tracker.tracker import Tracker
from tsepm_ros.tracker.tracks import ConfirmedTrack


class RecordedScene:
    """Collects the results of a run.

    Parameters
    ----------
    title : str
    north : bool
        Whether y of the fixed frame is north.
    truth : sequence of (m, 3) ndarray, optional
        Time (s), x and y (m) of each target.
    mounting_yaw : float or None, optional
        As for `tsepm_ros.session.result.vessel_pose`.
    """

    def __init__(
        self,
        title: str,
        north: bool,
        truth: Sequence[FloatArray] = (),
        mounting_yaw: float | None = 0.0,
    ) -> None:
        self.title = title
        self._info = {"kind": "recording", "title": title, "north": north}
        self._truth = [np.round(path, 2).tolist() for path in truth]
        self._mounting_yaw = mounting_yaw
        self._frames: list[Frame] = []
        self._facts: dict[str, Frame] = {}
        self._scans: dict[int, tuple[float, FloatArray]] = {}

    def __len__(self) -> int:
        """Number of scans."""
        return len(self._frames)

    def add(self, result: ScanResult, initiator: Tracker) -> None:
        """Take the result of a scan, before its initiator processes the next one."""
        detections = convert(result.scan, initiator.sensor, 0)["position"]
        index = initiator.scan_index
        if index <= max(self._scans, default=-1):  # the initiator has started over
            self._scans = {}
        self._scans[index] = result.stamp, detections
        frame = make_frame(
            result.stamp,
            result.frame_id,
            detections=detections,
            tracks=result.current,
            potential=initiator.potential_tracks(),
            fixed=result.fixed_echoes,
            own_ship=vessel_pose(result.scan, self._mounting_yaw),
            restart=result.arrival is Arrival.RESTART,
        )
        frame["number"] = len(self._frames) + 1
        self._frames.append(frame)
        fresh = [
            row
            for row, key in enumerate(result.current.track_id.tolist())
            if str(key) not in self._facts
        ]
        self._facts.update(track_facts(result.current.where(np.array(fresh, int)), None))
        for track_id, end in result.ended.items():
            self._facts.get(str(track_id), {})["ended"] = [result.stamp, ENDS[end]]
        self._facts.update(
            track_facts(
                result.new,
                result.stamp,
                reasons=[initiator.reason(track) for track in result.new],
                hits=[self._hits(track) for track in result.new],
            )
        )

    def document(self, dropped: Mapping[str, int], notes: Iterable[str] = ()) -> str:
        """The recording, JSON: everything that a page is told, see `PageState.since`, and truth.

        Parameters
        ----------
        dropped : mapping of str to int
            Drops by reason.
        notes : iterable of str, optional
            Other notices of the run.
        """
        return encode(
            {
                "all": True,
                "info": self._info,
                "truth": self._truth,
                "health": health_of_run(len(self._frames), dropped, notes),
                "facts": self._facts,
                "frames": self._frames,
            }
        )

    def _hits(self, track: ConfirmedTrack) -> list[list[float]]:
        """Time (s), x and y (m) of each hit, as far as it is known."""
        hits = []
        for scan_index, detection_index in track.hits:
            stamp, positions = self._scans.get(scan_index, (0.0, np.zeros((0, 2))))
            if detection_index < len(positions):
                hits.append([stamp, *np.round(positions[detection_index], 2).tolist()])
        return hits
