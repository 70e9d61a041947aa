"""The result of one processed scan."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tsepm_ros.initiation.statistics import ScanStatistics
from tsepm_ros.kinematics.track import TrackArrays
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.own_ship.frame_axes import exchanged
from tsepm_ros.sensing.scan import Scan
from tsepm_ros.session.scan_order import Arrival


@dataclass(frozen=True)
class ScanResult:
    """The result of one processed scan: scan and tracks in east and north, see `in_frame`.

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
    revised : TrackArrays
        Held tracks whose starts were corrected, under their ids.
    current : TrackArrays
        All published tracks that are held, at `stamp`.
    fixed_echoes : TrackArrays
        Fixed echoes, with `min_speed`, at `stamp`.
    ended : dict of int to str
        Tracks that ended: their ids, and the reason of each, see `track_maintenance.ENDS`.
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
    revised: TrackArrays
    current: TrackArrays
    fixed_echoes: TrackArrays
    ended: dict[int, str]
    statistics: ScanStatistics
    core_seconds: float
    waiting: float

    @property
    def starts(self) -> TrackArrays:
        """New tracks and corrected ones, as they go out on the topic `tracks`."""
        return self.new.joined(self.revised) if len(self.revised) else self.new

    def in_frame(self) -> ScanResult:
        """The result with tracks in the axes of the fixed frame, for everything that names it."""
        return replace(
            self,
            new=exchanged(self.new, self.frame_id),
            revised=exchanged(self.revised, self.frame_id),
            current=exchanged(self.current, self.frame_id),
            fixed_echoes=exchanged(self.fixed_echoes, self.frame_id),
        )


def vessel_pose(scan: Scan, mounting_yaw: float | None) -> FloatArray | None:
    """Position of the sensor at the nearest echo, and the heading of the vessel.

    Parameters
    ----------
    scan : Scan
        Registered in the fixed frame.
    mounting_yaw : float or None
        Angle from the bow to the sensor's azimuth 0, rad; None if the detections need no heading
        and the poses have none.

    Returns
    -------
    (3,) ndarray or None
        x, y (m) and heading (rad), nan if unknown; None without a sensor pose.
    """
    poses = np.reshape(scan.sensor_pose, (-1, 3))
    if not len(poses):
        return None
    nearest = 0
    if len(poses) > 1 and scan.time_offset is not None:
        nearest = int(np.argmin(scan.time_offset))
    yaw = np.nan if mounting_yaw is None else mounting_yaw
    pose: FloatArray = poses[nearest] - [0.0, 0.0, yaw]
    return pose
