"""The result of one processed scan."""

from __future__ import annotations

from dataclasses import dataclass

from tsepm_ros.initiation.statistics import ScanStatistics
from tsepm_ros.kinematics.track import TrackArrays
from tsepm_ros.sensing.scan import Scan
from tsepm_ros.session.scan_order import Arrival


@dataclass(frozen=True)
class ScanResult:
    """The result of one processed scan.

    Attributes
    ----------
    stamp : float
        The scan's stamp, s.
    stamp_ns : int
        The stamp as received, ns.
    scan : Scan
        The registered scan, with its sensor pose.
    frame_id : str
        The fixed frame.
    arrival : Arrival
        Relation to the scans before it; RESTART discarded all tracks, GAP the potential tracks.
    new : TrackArrays
        Newly confirmed tracks.
    current : TrackArrays
        All published tracks that are held, at `stamp`.
    fixed_echoes : TrackArrays
        What stands still, with `min_speed`, at `stamp`.
    ended : list of int
        Ids of the tracks that ended.
    statistics : ScanStatistics
        The initiator's counts.
    core_seconds : float
        Computing time of the initiator, s.
    waiting : float
        Time that the scan waited for own-ship data, s; infinite if `Session.process` got no time.
    """

    stamp: float
    stamp_ns: int
    scan: Scan
    frame_id: str
    arrival: Arrival
    new: TrackArrays
    current: TrackArrays
    fixed_echoes: TrackArrays
    ended: list[int]
    statistics: ScanStatistics
    core_seconds: float
    waiting: float
