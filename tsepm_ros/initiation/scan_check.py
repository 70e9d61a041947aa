"""Whether a scan may be the next of an initiator."""

from __future__ import annotations

from tsepm_ros.sensing.scan import Scan


def check_scan(scan: Scan, last_stamp: float | None, max_detections: int) -> None:
    """Raise an error for what no scan may be.

    Parameters
    ----------
    scan : Scan
    last_stamp : float or None
        Of the scan before, s.
    max_detections : int

    Raises
    ------
    ValueError
        If the stamp is not later than the last one, or the scan has too many detections.
    """
    if not isinstance(scan, Scan):
        raise ValueError(f"scan must be a tsepm_ros.Scan; got {type(scan).__name__}")
    if last_stamp is not None and scan.stamp <= last_stamp:
        raise ValueError(
            f"stamp must be later than the last scan's; got {scan.stamp!r} after {last_stamp!r}"
        )
    if len(scan) > max_detections:
        raise ValueError(
            f"range has {len(scan)} detections, more than max_detections = {max_detections}"
        )
