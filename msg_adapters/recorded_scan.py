"""Scans of a CSV recording, read as a message of theirs would be."""

from __future__ import annotations

from msg_adapters.detections import (
    DetectionMessage,
    ReadingOptions,
    azimuth_of_bearing,
    good_detections,
)
from msg_adapters.stamps import seconds_to_ns
from tsepm_ros.recording import RecordedScan
from tsepm_ros.scan import FEATURES


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
    reference = ReadingOptions(bearing_reference).bearing_reference
    fields = dict(scan.fields)
    bearing = fields.get("bearing")
    if bearing is not None:
        fields["azimuth"] = azimuth_of_bearing(bearing, reference)
    return good_detections(
        seconds_to_ns(scan.time),
        frame_id,
        range=fields["range"],
        azimuth=fields["azimuth"],
        range_std=fields.get("range_std"),
        azimuth_std=fields.get("azimuth_std"),
        time_offset=fields.get("time_offset"),
        features={name: fields[name] for name in FEATURES if name in fields},
        north_referenced=bearing is not None and reference == "north",
    )
