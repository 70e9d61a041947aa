"""Registration of a scan in the fixed frame, with its refusals and notices."""

from __future__ import annotations

import math

import numpy as np

from tsepm_ros.own_ship import registration
from tsepm_ros.own_ship.frame_axes import stated_axes
from tsepm_ros.own_ship.registration import SensorScan
from tsepm_ros.sensing.scan import Scan
from tsepm_ros.session.frames import Frames
from tsepm_ros.session.own_ship_input import OwnShipInput
from tsepm_ros.session.refusal import Notice, Refusal, Remark
from tsepm_ros.settings.settings import Settings

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
