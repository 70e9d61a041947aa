"""Coverage of a sensor that moves and turns while the echoes arrive."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.numerics.arrays import BoolArray, FloatArray
from tsepm_ros.sensing.scan import Scan
from tsepm_ros.sensing.sensor import SensorModel

EDGE_DEVIATIONS = 3.0
"""Standard deviations by which a target's detection may lie beyond the edge of the coverage."""
TURNS = 3
"""Rounds of `PosesByAzimuth`: each divides the error by the ratio of the two rates."""


def inside(scan: Scan, sensor: SensorModel) -> NDArray[np.bool_]:
    """Which detections (n,) may be of a target in the coverage, given their errors.

    The sensor detects no target outside the coverage: detections beyond are false.
    """
    range_std = scan.range_std
    if range_std is None:
        range_std = np.sqrt(sensor.range_variance(scan.range))
    azimuth_std = sensor.azimuth_std if scan.azimuth_std is None else scan.azimuth_std
    return sensor.covers(
        scan.range, scan.azimuth, EDGE_DEVIATIONS * range_std, EDGE_DEVIATIONS * azimuth_std
    )


@dataclass(frozen=True)
class PosesByRange:
    """Poses of the sensor as a function of the range of the echoes.

    Echoes arrive in the order of their ranges: the range determines the pose, whatever the order
    of the detections in their message.

    Attributes
    ----------
    range : (k,) ndarray
        Ascending, m.
    pose : (k, 3) ndarray
        x, y, yaw; the yaw is unwrapped.
    """

    range: FloatArray
    pose: FloatArray

    @classmethod
    def of(cls, scan: Scan) -> PosesByRange | None:
        """The poses of a scan; None for a pose per detection without detections."""
        pose = np.reshape(scan.sensor_pose, (-1, 3))
        if len(pose) < 2:
            return cls(np.zeros(1), pose) if len(pose) else None
        order = np.lexsort((*pose.T, scan.range))
        pose = pose[order]
        pose[:, 2] = np.unwrap(pose[:, 2])
        return cls(scan.range[order], pose)

    @property
    def middle(self) -> FloatArray:
        """The pose of the echo of median range, (3,)."""
        return self.pose[len(self.pose) // 2]

    def of_echoes_from(self, positions: FloatArray) -> FloatArray:
        """Pose (3,), or poses (3, n), at the echoes from positions (n, 2) in the fixed frame.

        The pose is interpolated at the range from the middle pose.
        """
        pose = self.middle
        if len(self.pose) > 1:
            distance = _range(positions, pose)
            pose = np.stack([np.interp(distance, self.range, values) for values in self.pose.T])
        return pose

    def polar(self, positions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Range (m) and azimuth (rad) in the sensor frame of positions (n, 2)."""
        return _polar(positions, self.of_echoes_from(positions))


@dataclass(frozen=True)
class PosesByAzimuth:
    """Poses of the sensor as a function of the azimuth of the echoes: a beam that turns.

    Attributes
    ----------
    azimuth : (k,) ndarray
        Ascending over less than a turn from the sweep's seam, rad.
    pose : (k, 3) ndarray
        x, y, yaw; the yaw is unwrapped.
    """

    azimuth: FloatArray
    pose: FloatArray

    @property
    def middle(self) -> FloatArray:
        """The pose of the echo of median azimuth, (3,)."""
        return self.pose[len(self.pose) // 2]

    def of_echoes_from(self, positions: FloatArray) -> FloatArray:
        """Poses (3, n) at the echoes from positions (n, 2) in the fixed frame.

        The azimuth determines the pose, and the pose the azimuth: `TURNS` rounds from the middle
        pose solve for both, since the beam turns much faster than the sensor.
        """
        pose = self.middle
        for _ in range(TURNS):
            from_seam = np.mod(_polar(positions, pose)[1] - self.azimuth[0], 2 * np.pi)
            beam = self.azimuth - self.azimuth[0]
            # Beyond the last echo begins the seam, which the first follows.
            pose = np.stack([np.interp(from_seam, beam, values) for values in self.pose.T])
        return pose

    def polar(self, positions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Range (m) and azimuth (rad) in the sensor frame of positions (n, 2)."""
        return _polar(positions, self.of_echoes_from(positions))


EchoPoses = PosesByRange | PosesByAzimuth
"""Poses of the sensor at the echoes of a scan."""


def echo_poses_of(scan: Scan) -> EchoPoses | None:
    """The poses of a scan, as a function of what determines the time of its echoes.

    That is the range in a ping, and the azimuth in a sweep, by which the times in order vary less
    (`PosesByRange.of`; None as there).
    """
    pose, time = np.asarray(scan.sensor_pose), scan.time_offset
    if pose.ndim == 1 or len(pose) < 3 or time is None:
        return PosesByRange.of(scan)
    along = np.lexsort((*pose.T, scan.range))
    around = np.argsort(scan.azimuth, kind="stable")
    jumps = np.abs(np.diff(time[around], append=time[around[0]]))
    around = np.roll(around, -1 - int(np.argmax(jumps)))
    if np.abs(np.diff(time[along])).sum() <= np.abs(np.diff(time[around])).sum():
        return PosesByRange.of(scan)
    azimuth = scan.azimuth[around]
    azimuth = azimuth[0] + np.mod(azimuth - azimuth[0], 2 * np.pi)
    pose = pose[around]
    pose[:, 2] = np.unwrap(pose[:, 2])
    return PosesByAzimuth(azimuth, pose)


def looked_at(
    scan: Scan, sensor: SensorModel, poses: EchoPoses, positions: FloatArray
) -> BoolArray:
    """Whether a scan looked at positions (n, 2) in the fixed frame: coverage, and arc swept."""
    pose = poses.of_echoes_from(positions)
    swept = None if scan.swept is None else tuple(scan.swept)
    if sensor.all_round and swept is None:
        return sensor.covers(_range(positions, pose), 0.0)
    range_, azimuth = _polar(positions, pose)
    return sensor.covers(range_, azimuth) & _in_arc(swept, azimuth)


def _in_arc(arc: tuple[float, ...] | None, azimuth: FloatArray) -> BoolArray:
    """Whether azimuths (n,) are of an arc, its start and width; None for all around."""
    if arc is None:
        return np.ones(len(azimuth), bool)
    start, width = arc
    return np.asarray(np.mod(azimuth - start, 2 * np.pi) <= width)


class View(NamedTuple):
    """What a scan looked at.

    Attributes
    ----------
    sensor : SensorModel
    pose : tuple of float
        Of the sensor: x, y, yaw.
    swept : tuple of float or None
        Start and width of the arc, rad; None for all that is in the coverage.
    """

    sensor: SensorModel
    pose: tuple[float, float, float]
    swept: tuple[float, float] | None

    @classmethod
    def of(cls, scan: Scan, sensor: SensorModel, pose: FloatArray) -> View:
        """That of a scan at a pose (3,)."""
        x, y, yaw = map(float, pose)
        swept = None
        if scan.swept is not None:
            swept = float(scan.swept[0]), float(scan.swept[1])
        return cls(sensor, (x, y, yaw), swept)

    def covers(self, positions: FloatArray) -> BoolArray:
        """Whether positions (n, 2) in the fixed frame were looked at."""
        range_, azimuth = _polar(positions, np.array(self.pose))
        return self.sensor.covers(range_, azimuth) & _in_arc(self.swept, azimuth)


def _range(positions: FloatArray, pose: FloatArray) -> FloatArray:
    """Range of positions (n, 2) from a pose (3,) or poses (3, n)."""
    return np.hypot(positions[:, 0] - pose[0], positions[:, 1] - pose[1])


def _polar(positions: FloatArray, pose: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Range and azimuth of positions (n, 2) from a pose (3,) or poses (3, n)."""
    x, y, yaw = pose
    east, north = positions[:, 0] - x, positions[:, 1] - y
    return np.hypot(east, north), np.arctan2(north, east) - yaw
