"""What of a scan lies in the sensor's coverage, which moves and turns while the echoes come in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.sensing.scan import Scan
from tsepm_ros.sensing.sensor import SensorModel

EDGE_DEVIATIONS = 3.0
"""Standard deviations by which a target's detection may lie beyond the edge of the coverage."""


def inside(scan: Scan, sensor: SensorModel) -> NDArray[np.bool_]:
    """Which detections (n,) may be of a target in the coverage, with the errors that they have.

    A sensor that covers no more detects no target elsewhere: a detection there is false.
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
    """Poses of the sensor over the range of the echoes that they place.

    The farther away, the later an echo comes in: the range tells the pose, whatever the order of
    the detections in their message.

    Attributes
    ----------
    range : (k,) ndarray
        Rising, m.
    pose : (k, 3) ndarray
        x, y, yaw, the yaw without jumps.
    """

    range: FloatArray
    pose: FloatArray

    @classmethod
    def of(cls, scan: Scan) -> PosesByRange | None:
        """The poses of a scan; None where it has one for each detection, but no detections."""
        pose = np.reshape(scan.sensor_pose, (-1, 3))
        if len(pose) < 2:
            return cls(np.zeros(1), pose) if len(pose) else None
        order = np.lexsort((*pose.T, scan.range))
        pose = pose[order]
        pose[:, 2] = np.unwrap(pose[:, 2])
        return cls(scan.range[order], pose)

    @property
    def middle(self) -> FloatArray:
        """The pose of the echo in the middle, (3,)."""
        return self.pose[len(self.pose) // 2]

    def polar(self, positions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Range (m) and azimuth (rad), against the sensor, of positions (n, 2) in the fixed frame.

        The pose is interpolated at the range from the middle one.
        """
        pose = self.middle
        if len(self.pose) > 1:
            distance = np.hypot(*(positions - pose[:2]).T)
            pose = np.stack([np.interp(distance, self.range, along) for along in self.pose.T])
        x, y, yaw = pose
        east, north = positions[:, 0] - x, positions[:, 1] - y
        return np.hypot(east, north), np.arctan2(north, east) - yaw
