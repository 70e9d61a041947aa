"""Frames, and the registration of scans in the fixed frame.

The names of the fixed frame, the sensor frame and the vessel's frame.

Registration of a scan in the fixed frame, with its refusals and notices.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from tsepm_ros.own_ship import registration
from tsepm_ros.own_ship.attitude import stated_axes, without_suffix
from tsepm_ros.own_ship.mounting import Mounting
from tsepm_ros.own_ship.pose_history import PoseSample
from tsepm_ros.own_ship.registration import SensorScan
from tsepm_ros.session.drop_reasons import Notice, Refusal, Remark
from tsepm_ros.session.inputs import OwnShipInput
from tsepm_ros.settings.node_options import SessionOptions
from tsepm_ros.settings.settings import Settings
from tsepm_ros.tracker.maintenance.external_tracker import TrackerReport
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

    def named(self, arrived: SensorScan) -> SensorScan:
        """Return a scan with its frame; an empty frame becomes the frame of the options, if any."""
        given = self.options.sensor_frame or ("" if self._moves else self.options.fixed_frame)
        return dataclasses.replace(arrived, frame_id=arrived.frame_id or given.lstrip("/"))

    def refuse_scan(self, arrived: SensorScan) -> Refusal | None:
        """Refuse a scan whose frame cannot be used."""
        if not arrived.frame_id:
            return Refusal(
                "empty_frame", "the frame_id of the detections is empty, and so is sensor_frame"
            )
        expected = [(self.sensor, [arrived.frame_id])]
        if not self._moves and not arrived.north_referenced:
            # No pose relates another sensor frame to it.
            expected.append((self.fixed, [arrived.frame_id, without_suffix(arrived.frame_id)]))
        for frame, names in expected:
            if frame and frame not in names:
                return Refusal(
                    "unknown_frame",
                    f"detections are in frame {arrived.frame_id!r}, expected {frame!r}",
                )
        return None

    def take_scan(self, arrived: SensorScan) -> None:
        """Adopt the frame of a scan that is not refused."""
        self.sensor = arrived.frame_id
        if not self.fixed and not self._moves:
            self.fixed = without_suffix(arrived.frame_id)

    def take_pose(self, sample: PoseSample) -> Refusal | None:
        """Adopt the frames of own-ship data, or refuse them."""
        frame = sample.frame_id or self.options.fixed_frame.lstrip("/")
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


MAX_YAW_VARIANCE = math.pi**2
"""Variance of the heading above which the heading is unknown, rad^2."""


def register(
    arrived: SensorScan, own_ship: OwnShipInput, frames: Frames, settings: Settings
) -> tuple[Scan | None, list[Remark | None]]:
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
    remarks : list of Refusal, Notice or None
        Of the scan, and of detections that are left out.
    """
    mounting, sensor = settings.mounting, settings.sensor
    remarks: list[Remark | None] = [*frames.notices(mounting)]
    refusal = _refuse_heading(arrived, own_ship, settings)
    if refusal is not None:
        return None, [*remarks, refusal]
    if own_ship.moves:
        sector = not sensor.all_round
        try:
            scan = registration.to_fixed_frame(arrived, own_ship.poses, mounting, sector=sector)
        except registration.PosesJumpError as error:
            return None, [*remarks, Refusal("own_ship_jump", str(error))]
        remarks.append(_refuse_vertical(arrived, scan))
    else:
        scan = registration.at_rest(arrived)
        if stated_axes(frames.fixed) == "down" and not arrived.north_referenced:
            scan = scan.replaced(sensor_pose=np.array([0.0, 0.0, 0.5 * math.pi]))
    if sensor.range_rate_std:
        remarks.append(_rates_notice(arrived.scan, scan))
    return scan, remarks


def _refuse_heading(
    arrived: SensorScan, own_ship: OwnShipInput, settings: Settings
) -> Refusal | None:
    """Refuse a scan that needs a heading if the heading is unknown."""
    # The sector is relative to the bow, so azimuths from north need the heading.
    sector = not settings.sensor.all_round
    if not own_ship.moves:
        if sector and arrived.north_referenced:
            return Refusal(
                "heading_unknown", "bearings from north need a heading if the coverage is a sector"
            )
        return None
    if not (sector or not arrived.north_referenced or settings.mounting.offset):
        return None
    covariance = own_ship.poses.covariance(arrived.scan.stamp)
    if covariance is None or covariance[2, 2] <= MAX_YAW_VARIANCE:
        return None
    return Refusal(
        "heading_unknown", "the detections need a heading, which the own-ship data does not have"
    )


def _refuse_vertical(arrived: SensorScan, scan: Scan) -> Refusal | None:
    """Refuse detections without a horizontal range, which registration left out."""
    lost = len(arrived.scan) - len(scan)
    if not lost:
        return None
    return Refusal(
        "no_horizontal_range",
        f"{lost} detections dropped: vertically above or below the tilted sensor",
        lost,
    )


def _rates_notice(before: Scan, after: Scan) -> Notice | None:
    """Return a notice of range rates that registration removed."""
    known = [
        int(np.isfinite(scan.features.get("range_rate", ())).sum()) for scan in (before, after)
    ]
    unused = known[0] - known[1]
    if unused <= 0:
        return None
    return Notice(
        "range_rate_unused",
        f"{unused} range rates not used: the line of sight is too steep, or the sensor's velocity "
        "is unknown",
    )
