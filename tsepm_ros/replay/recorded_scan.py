"""Scans of a CSV recording, read like a point cloud with the same fields."""

from __future__ import annotations

from msg_adapters.ping import Ping
from msg_adapters.point_cloud_detections import detections_of_fields
from msg_adapters.reading_options import ReadingOptions
from msg_adapters.stamps import seconds_to_ns
from tsepm_ros.replay.recording import RecordedScan


def read_recorded_scan(
    scan: RecordedScan, frame_id: str, *, bearing_reference: str = "bow", sound_speed: float = 0.0
) -> Ping:
    """Read a recorded scan; bad detections are left out and counted.

    Parameters
    ----------
    scan : RecordedScan
    frame_id : str
        The sensor's frame.
    bearing_reference : {"bow", "north"}, optional
        Reference direction of recorded bearings, which are positive clockwise.
    sound_speed : float, optional
        Sound speed, m/s. Detections without times are valid range / sound_speed after the stamp;
        0: at the stamp.

    Returns
    -------
    Ping

    Raises
    ------
    ValueError
        If an option is not allowed.
    """
    options = ReadingOptions(bearing_reference, sound_speed)
    return detections_of_fields(seconds_to_ns(scan.time), frame_id, scan.fields, options)
