"""The result of one processed scan."""

from __future__ import annotations

from dataclasses import dataclass

from tsepm_ros.initiation.statistics import ScanStatistics
from tsepm_ros.kinematics.track import TrackArrays
from tsepm_ros.sensing.scan import Scan
from tsepm_ros.session.scan_order import Arrival


@dataclass(frozen=True)
class ScanResult:
    """What one processed scan gave.

    Attributes
    ----------
    stamp : float
        The scan's stamp, s.
    stamp_ns : int
        The stamp as received, ns.
    scan : Scan
        The scan as processed, with its sensor pose.
    frame_id : str
        The fixed frame.
    arrival : Arrival
        How the scan followed on; before it, RESTART dropped everything and GAP the potential
        tracks.
    new : TrackArrays
        Newly confirmed tracks.
    current : TrackArrays
        Every track held, at `stamp`.
    ended : list of int
        Ids of the tracks that are held no longer.
    statistics : ScanStatistics
        The initiator's counts.
    core_seconds : float
        Time that the initiator took, s.
    waiting : float
        Time that the scan waited for own-ship data, s; infinite where no time is given.
    """

    stamp: float
    stamp_ns: int
    scan: Scan
    frame_id: str
    arrival: Arrival
    new: TrackArrays
    current: TrackArrays
    ended: list[int]
    statistics: ScanStatistics
    core_seconds: float
    waiting: float
