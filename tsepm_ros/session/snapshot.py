"""The state of a session, for its diagnostics."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from tsepm_ros.initiation.statistics import ScanStatistics
from tsepm_ros.session.sensor_check import SensorFigures


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
    own_ship_stamp, scan_stamp : float or None
        Newest stamps, s.
    tracker : str
        State of the downstream tracker: a value of `Tracker`.
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
