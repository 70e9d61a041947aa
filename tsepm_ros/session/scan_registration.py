"""A scan put in the fixed frame, or refused, with what there is to say of it."""

from __future__ import annotations

import math

import numpy as np

from tsepm_ros.own_ship import registration
from tsepm_ros.own_ship.registration import SensorScan
from tsepm_ros.sensing.scan import Scan
from tsepm_ros.session.frames import Frames
from tsepm_ros.session.own_ship_input import OwnShipInput
from tsepm_ros.session.refusal import Notice, Refusal, Remark
from tsepm_ros.settings.settings import Settings

MAX_YAW_VARIANCE = math.pi**2
"""Variance of the heading above which there is none, rad^2."""


def register(
    arrived: SensorScan, own_ship: OwnShipInput, frames: Frames, settings: Settings
) -> tuple[Scan | None, list[Remark | None]]:
    """Put a scan in the fixed frame.

    Parameters
    ----------
    arrived : SensorScan
    own_ship : OwnShipInput
        It has the poses, where the sensor moves.
    frames : Frames
    settings : Settings

    Returns
    -------
    scan : Scan or None
        None where it is refused.
    remarks : list of Refusal, Notice or None
        Of the scan, and of detections that are left out.
    """
    mounting, sensor = settings.mounting, settings.sensor
    remarks: list[Remark | None] = []
    if own_ship.moves:
        remarks.append(frames.mounting_notice(arrived.frame_id, mounting))
    refusal = _refuse_heading(arrived, own_ship, settings)
    if refusal is not None:
        return None, [*remarks, refusal]
    if own_ship.moves:
        sector = not sensor.all_round
        scan = registration.to_fixed_frame(arrived, own_ship.poses, mounting, sector=sector)
        remarks.append(_refuse_vertical(arrived, scan))
    else:
        scan = registration.at_rest(arrived)
    if sensor.range_rate_std:
        remarks.append(_rates_notice(arrived.scan, scan))
    return scan, remarks


def _refuse_heading(
    arrived: SensorScan, own_ship: OwnShipInput, settings: Settings
) -> Refusal | None:
    """Why a scan cannot be placed without a heading, where none is known."""
    # Azimuths from north say where in a sector they are only with the heading.
    sector = not settings.sensor.all_round
    if not own_ship.moves:
        if sector and arrived.north_referenced:
            return Refusal("heading_unknown", "no heading: bearings from north need it in a sector")
        return None
    if not (sector or not arrived.north_referenced or settings.mounting.offset):
        return None
    covariance = own_ship.poses.covariance(arrived.scan.stamp)
    if covariance is None or covariance[2, 2] <= MAX_YAW_VARIANCE:
        return None
    return Refusal("heading_unknown", "the own-ship data has no heading, but it is needed")


def _refuse_vertical(arrived: SensorScan, scan: Scan) -> Refusal | None:
    """Why some detections are not in the registered scan."""
    lost = len(arrived.scan) - len(scan)
    if not lost:
        return None
    return Refusal(
        "no_horizontal_range",
        f"{lost} detections dropped: straight above or below the tilted sensor",
        lost,
    )


def _rates_notice(before: Scan, after: Scan) -> Notice | None:
    """Say where registration took range rates from a scan."""
    known = [
        int(np.isfinite(scan.features.get("range_rate", ())).sum()) for scan in (before, after)
    ]
    unused = known[0] - known[1]
    if unused <= 0:
        return None
    return Notice(
        "range_rate_unused",
        f"{unused} range rates not used: measured too steeply above or below the horizontal, or "
        "the sensor's velocity is not known",
    )
