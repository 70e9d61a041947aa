"""Content of a plan-position picture or animation of a run, by scan."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from tsepm_ros.analysis.truth import Judged, Outcome
from tsepm_ros.kinematics.track import ConfirmedTrack, TrackArrays
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.replay.recording import RecordedMotion
from tsepm_ros.sensing.conversion import convert
from tsepm_ros.sensing.sensor import SensorModel
from tsepm_ros.session.result import ScanResult, vessel_pose


@dataclass(frozen=True)
class ScanView:
    """One scan in the fixed frame.

    Attributes
    ----------
    stamp : float
        s.
    detections : (n, 2) ndarray
        Positions, m.
    sensor : (3,) ndarray or None
        Position of the sensor at the nearest echo, m, and the heading of the vessel, rad, nan if
        unknown; None without a sensor pose.
    new, held : TrackArrays
        Tracks confirmed in this scan; all held tracks after it.
    """

    stamp: float
    detections: FloatArray
    sensor: FloatArray | None
    new: TrackArrays
    held: TrackArrays

    @classmethod
    def of(
        cls, result: ScanResult, sensor: SensorModel, mounting_yaw: float | None = 0.0
    ) -> ScanView:
        """View of a processed scan.

        `mounting_yaw` is that of `vessel_pose`.
        """
        return cls(
            stamp=result.stamp,
            detections=convert(result.scan, sensor, 0)["position"],
            sensor=vessel_pose(result.scan, mounting_yaw),
            new=result.new,
            held=result.current,
        )


@dataclass
class RunScene:
    """A whole run.

    Attributes
    ----------
    title : str
    scans : list of ScanView
        In the order in which they were processed.
    truth : list of (m, 3) ndarray
        Time (s), x and y (m) of each target.
    judged : list of Judged, optional
        Outcome of each start, if the origin of the detections is known.
    """

    title: str
    scans: list[ScanView] = field(default_factory=list)
    truth: list[FloatArray] = field(default_factory=list)
    judged: list[Judged] | None = None

    @property
    def starts(self) -> list[ConfirmedTrack]:
        """All confirmed tracks, with their states at confirmation."""
        return [track for view in self.scans for track in view.new]

    def starts_by(self, true: bool) -> list[ConfirmedTrack]:
        """True starts, or those with another outcome; starts without judgement count as true."""
        if self.judged is None:
            return self.starts if true else []
        return [
            judgement.track
            for judgement in self.judged
            if (judgement.outcome is Outcome.TRUE) is true
        ]

    @property
    def insets(self) -> list[FloatArray]:
        """Points to enlarge, (2,) m: the targets' mid-run positions, if the starts are judged."""
        if self.judged is None:
            return []
        return [path[len(path) // 2, 1:] for path in self.truth]

    @property
    def own_ship(self) -> FloatArray:
        """Path of the sensor, (m, 3): x, y (m) and heading (rad, nan if unknown)."""
        return own_ship_path(self.scans)


def own_ship_path(scans: Iterable[ScanView]) -> FloatArray:
    """Positions of the sensor in some scans, with headings, (m, 3)."""
    return np.array([view.sensor for view in scans if view.sensor is not None]).reshape(-1, 3)


def truth_paths(targets: Mapping[int, Sequence[RecordedMotion]]) -> list[FloatArray]:
    """Time (s), x and y (m) of recorded targets, (m, 3) each."""
    return [
        np.array([(motion.time, motion.state[0], motion.state[2]) for motion in path])
        for path in targets.values()
    ]


def position_at(path: FloatArray, stamp: float) -> FloatArray | None:
    """Position of a target at a time (s), (2,) m; None outside of the path."""
    if not path[0, 0] <= stamp <= path[-1, 0]:
        return None
    return np.array([np.interp(stamp, path[:, 0], path[:, axis]) for axis in (1, 2)])


def velocity_seconds(scene: RunScene) -> float:
    """Time for which velocities are drawn, s: a fast track's line is a 25th of the scene."""
    points = [view.detections for view in scene.scans] + [path[:, 1:] for path in scene.truth]
    everything = np.concatenate([*points, np.zeros((0, 2))])
    speeds = [float(np.hypot(*track.velocity)) for track in scene.starts]
    if not len(everything) or not speeds:
        return 60.0
    extent = float(np.ptp(everything, axis=0).max())
    duration = 0.04 * extent / max(float(np.quantile(speeds, 0.9)), 1e-3)
    return float(f"{duration:.0e}") or 1.0
