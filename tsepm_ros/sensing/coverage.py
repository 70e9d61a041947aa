"""Coverage of a sensor that moves and turns while the echoes arrive."""

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

    def polar(self, positions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Range (m) and azimuth (rad) in the sensor frame of positions (n, 2) in the fixed frame.

        The pose is interpolated at the range from the middle pose.
        """
        pose = self.middle
        if len(self.pose) > 1:
            distance = np.hypot(*(positions - pose[:2]).T)
            pose = np.stack([np.interp(distance, self.range, values) for values in self.pose.T])
        x, y, yaw = pose
        east, north = positions[:, 0] - x, positions[:, 1] - y
        return np.hypot(east, north), np.arctan2(north, east) - yaw
