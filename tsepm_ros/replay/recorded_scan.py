"""Scans of a CSV recording, read as a cloud of theirs would be."""

from __future__ import annotations

from msg_adapters.ping import Ping
from msg_adapters.point_cloud_detections import detections_of_fields
from msg_adapters.reading_options import ReadingOptions
from msg_adapters.stamps import seconds_to_ns
from tsepm_ros.replay.recording import RecordedScan


def read_recorded_scan(
    scan: RecordedScan, frame_id: str, *, bearing_reference: str = "bow", sound_speed: float = 0.0
) -> Ping:
    """Read a recorded scan, leaving out and counting its bad detections.

    Parameters
    ----------
    scan : RecordedScan
    frame_id : str
        The sensor's frame.
    bearing_reference : {"bow", "north"}, optional
        What a recorded bearing is measured from, clockwise.
    sound_speed : float, optional
        Where no times are recorded, echoes are of range / sound_speed after the stamp, m/s; 0: of
        the stamp.

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
