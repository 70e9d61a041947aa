"""Scans of a CSV recording, read as a cloud of theirs would be."""

from __future__ import annotations

from msg_adapters.detections import DetectionMessage, ReadingOptions
from msg_adapters.point_cloud_detections import detections_of_fields
from msg_adapters.stamps import seconds_to_ns
from tsepm_ros.replay.recording import RecordedScan


def read_recorded_scan(
    scan: RecordedScan, frame_id: str, *, bearing_reference: str = "bow"
) -> DetectionMessage:
    """Read a recorded scan, leaving out and counting its bad detections.

    Parameters
    ----------
    scan : RecordedScan
    frame_id : str
        The sensor's frame.
    bearing_reference : {"bow", "north"}, optional
        What a recorded bearing is measured from, clockwise.

    Returns
    -------
    DetectionMessage

    Raises
    ------
    ValueError
        If `bearing_reference` is not allowed.
    """
    options = ReadingOptions(bearing_reference)
    return detections_of_fields(seconds_to_ns(scan.time), frame_id, scan.fields, options)
