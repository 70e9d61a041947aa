"""The names of the fixed frame, the sensor frame and the vessel's frame."""

from __future__ import annotations

import dataclasses

from tsepm_ros.maintenance.downstream_tracker import TrackerReport
from tsepm_ros.own_ship.mounting import Mounting
from tsepm_ros.own_ship.pose_sample import PoseSample
from tsepm_ros.own_ship.registration import SensorScan
from tsepm_ros.session.refusal import Notice, Refusal
from tsepm_ros.settings.session_options import SessionOptions

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
        self.fixed = self.options.fixed_frame
        self.sensor = self.options.sensor_frame
        self.own_ship = ""

    @property
    def remembered(self) -> int:
        """Number of pairs of frames whose assumed mounting was noticed, at most MAX_NOTICED."""
        return len(self._noticed)

    def named(self, arrived: SensorScan) -> SensorScan:
        """Return a scan with its frame; an empty frame becomes the frame of the options, if any."""
        given = self.options.sensor_frame or ("" if self._moves else self.options.fixed_frame)
        return dataclasses.replace(arrived, frame_id=arrived.frame_id or given)

    def refuse_scan(self, arrived: SensorScan) -> Refusal | None:
        """Refuse a scan whose frame cannot be used."""
        if not arrived.frame_id:
            return Refusal(
                "empty_frame", "the frame_id of the detections is empty, and so is sensor_frame"
            )
        expected = [self.sensor]
        if not self._moves and not arrived.north_referenced:
            expected.append(self.fixed)  # no pose relates another sensor frame to it
        for frame in expected:
            if frame and arrived.frame_id != frame:
                return Refusal(
                    "unknown_frame",
                    f"detections are in frame {arrived.frame_id!r}, expected {frame!r}",
                )
        return None

    def take_scan(self, arrived: SensorScan) -> None:
        """Adopt the frame of a scan that is not refused."""
        self.sensor = arrived.frame_id
        if not self.fixed and not self._moves:
            self.fixed = arrived.frame_id

    def take_pose(self, sample: PoseSample) -> Refusal | None:
        """Adopt the frames of own-ship data, or refuse them."""
        frame = sample.frame_id or self.options.fixed_frame
        if not frame:
            return Refusal(
                "own_ship_empty_frame",
                "the frame_id of the own-ship data is empty, and so is fixed_frame",
            )
        self.fixed = self.fixed or frame
        if frame != self.fixed:
            return Refusal(
                "own_ship_frame",
                f"own-ship data is in frame {frame!r}, the fixed frame is {self.fixed!r}",
            )
        self.own_ship = sample.child_frame_id
        return None

    def refuse_report(self, report: TrackerReport) -> Refusal | None:
        """Refuse a downstream tracker's report that is not in the fixed frame, if that is known."""
        if not self.fixed or report.frame_id == self.fixed:
            return None
        return Refusal(
            "tracked_frame",
            f"tracked targets are in frame {report.frame_id!r}, the fixed frame is {self.fixed!r}",
        )

    def mounting_state(self, mounting: Mounting, own_ship_known: bool) -> str:
        """Whether the mounting is given, assumed, not needed or unknown yet."""
        if mounting.given:
            return "given"
        if not self.sensor or not own_ship_known:
            return "unknown"
        return "not needed" if self.own_ship == self.sensor else "assumed"

    def mounting_notice(self, frame_id: str, mounting: Mounting) -> Notice | None:
        """Return a notice of an assumed mounting, once for each pair of frames."""
        pair = self.own_ship, frame_id
        if not self.own_ship or self.own_ship == frame_id or mounting.given:
            return None
        if pair in self._noticed:
            return None
        if len(self._noticed) == MAX_NOTICED:
            self._noticed.clear()
        self._noticed.add(pair)
        return Notice(
            "mounting",
            f"own-ship data is for frame {pair[0]!r}, detections are in {pair[1]!r}: no mounting "
            "is given, so the frames are assumed to coincide",
        )
