"""Results of a scan, and the state of a session.

The state of a session, for its diagnostics.

The result of one processed scan.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.own_ship.attitude import exchanged, stated_axes
from tsepm_ros.session.consistency_checks import SensorFigures
from tsepm_ros.session.scan_queue import Arrival
from tsepm_ros.tracker.method import ScanStatistics
from tsepm_ros.tracker.scan import Scan
from tsepm_ros.tracker.tracks import TrackArrays


@dataclass(frozen=True, kw_only=True)
class SessionSnapshot:
    """State of a session.

    Attributes
    ----------
    totals : ScanStatistics
        Sums since the start or the last reset.
    potential_tracks : int
        Number of potential tracks.
    tracks : int
        Number of published tracks that are held.
    states : mapping of str to int
        Number of held tracks by the name of their `Status`.
    ends : mapping of str to int
        Number of tracks that ended since the start or the last reset, by the reason, a key of
        `track_maintenance.ENDS`.
    fixed_echoes : int
        Number of fixed echoes.
    dropped : mapping of str to int
        Drops by reason.
    waiting : int
        Number of scans that wait for own-ship data.
    detection_probability, detection_probability_estimated : float
        The value in use, and the estimate from the held tracks.
    clutter_density : float
        The density in use, mean over `coverage_area`, 1/m^2.
    coverage_area : float
        Area to which that density refers, m^2.
    sensor_findings : mapping of str to str
        Which of the sensor's figures as given do not fit the scans, by subject, in sentences.
    sensor_figures : SensorFigures
        Learned figures beside those that are given.
    own_ship_source : str
    mounting : str
        Whether the mounting is given, assumed, not needed or unknown.
    mounting_yaw : float
        As given, rad.
    own_ship_stamp, scan_stamp : float or None
        Newest stamps, s.
    tracker : str
        State of the downstream tracker: a value of `ExternalTracker`.
    intensity : str
        Whether the strengths of detections count, in words.
    land_area : float
        Area of the land whose detections are left out, m^2.
    sweep : str
        How scans are made of messages, in words.
    sweep_latency : float
        Time from the first message of the last scan to its completion, s.
    """

    totals: ScanStatistics
    potential_tracks: int
    tracks: int
    fixed_echoes: int
    dropped: Mapping[str, int]
    waiting: int
    detection_probability: float
    detection_probability_estimated: float
    clutter_density: float
    coverage_area: float
    sensor_findings: Mapping[str, str] = field(default_factory=dict)
    sensor_figures: SensorFigures = field(default_factory=SensorFigures)
    own_ship_source: str
    mounting: str
    own_ship_stamp: float | None
    scan_stamp: float | None
    tracker: str
    states: Mapping[str, int] = field(default_factory=dict)
    ends: Mapping[str, int] = field(default_factory=dict)
    intensity: str = "not used"
    land_area: float = 0.0
    sweep: str = "a message is a scan"
    sweep_latency: float = 0.0
    mounting_yaw: float = 0.0


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
        if stated_axes(self.frame_id) != "down":
            return self
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
