"""Running recordings through a session, without ROS."""

from __future__ import annotations

from collections import Counter, deque

import numpy as np

from msg_adapters import read_recorded_scan, sensor_scan
from tsepm_ros.own_ship import PoseSample
from tsepm_ros.recording import RecordedMotion, RecordedScan, Recording
from tsepm_ros.session import ScanResult, Session, Settings

FRAME = "recording"
UNKNOWN_YAW_VARIANCE = 1e6
"""Variance of a heading that was not recorded, rad^2."""


def process_recording(
    recording: Recording, settings: Settings, bearing_reference: str
) -> tuple[list[ScanResult], Counter[str]]:
    """Process every scan of a recording.

    Parameters
    ----------
    recording : Recording
    settings : Settings
    bearing_reference : {"bow", "north"}
        What a recorded bearing is measured from, clockwise.

    Returns
    -------
    results : list of ScanResult
    dropped : Counter
        What could not be used, by reason.
    """
    session = Session(settings)
    results: list[ScanResult] = []
    motions = deque(recording.own_ship)
    for recorded in recording.scans:
        # As live: what the scan's echoes need has arrived, not what comes long after.
        until = recorded.time + _longest_echo(recorded)
        last = session.own_ship_stamp
        while motions and (last is None or last < until):
            last = motions[0].time
            session.add_own_ship(_pose(motions.popleft()), FRAME)
        detections = read_recorded_scan(recorded, FRAME, bearing_reference=bearing_reference)
        session.dropped.update(detections.dropped)
        session.add_scan(sensor_scan(detections), now=0.0)
        results.extend(session.process())
    return results, session.dropped


def _longest_echo(recorded: RecordedScan) -> float:
    """Time from the transmit to the arrival of the last echo, s."""
    offsets = recorded.fields.get("time_offset", np.zeros(0))
    good = offsets[np.isfinite(offsets)]
    return max(2.0 * float(good.max()), 0.0) if len(good) else 0.0


def _pose(motion: RecordedMotion) -> PoseSample:
    x, _, y, _ = motion.state.tolist()
    if motion.yaw is not None:
        return PoseSample(motion.time, x, y, motion.yaw)
    return PoseSample(motion.time, x, y, 0.0, np.diag([0.0, 0.0, UNKNOWN_YAW_VARIANCE]))
