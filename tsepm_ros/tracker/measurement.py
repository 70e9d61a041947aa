# Copyright 2026 tsepm_ros developers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""Measured detections: from polar measurements to positions with a covariance, and their window.

The conversion is that of TSEPM 2018, Eqs. 6-11.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tsepm_ros.numerics.arrays import FloatArray, IntArray, RecordArray, rows_of
from tsepm_ros.tracker import range_rates
from tsepm_ros.tracker.scan import Scan
from tsepm_ros.tracker.sensor import RangeErrors, SensorModel

MAX_INTENSITY = 1e100
"""Magnitude from which an intensity counts as not measured: its square could overflow."""


DETECTION = np.dtype(
    [
        ("scan", np.int64),  # scan index
        ("sensor", np.int64),  # number of the sensor
        ("index", np.int64),  # detection index within its scan
        ("time", np.float64),  # s, at which the position is valid
        ("position", np.float64, (2,)),  # m, fixed frame
        ("covariance", np.float64, (2, 2)),  # m^2, at the measured position
        ("major_sigma", np.float64),  # m, major axis of that covariance (sigma_Rmax)
        ("range_std", np.float64),  # m; nan: the sensor model's
        ("azimuth_std", np.float64),  # rad
        ("least_across", np.float64),  # variance across over that along, at least
        ("sensor_pose", np.float64, (3,)),  # x, y, yaw in the fixed frame
        ("sensor_pose_covariance", np.float64, (3, 3)),
        ("sensor_velocity", np.float64, (2,)),  # m/s, fixed frame
        ("clutter_velocity", np.float64, (2,)),  # m/s, drift of clutter, fixed frame
        ("range_rate", np.float64),  # m/s, against the moving sensor
        ("range_rate_std", np.float64),  # m/s; 0: no range rate
        ("clutter_density", np.float64),  # 1/m^2, at its position
        ("intensity", np.float64),  # in any unit; nan: not measured
        ("amplitude", np.float64),  # normalised, without an end; nan: not known
    ]
)
"""A converted detection, with the fields for re-evaluating its covariance elsewhere."""


HIT_KEYS = 2**32
"""Detections of a scan that a number of a hit tells apart."""
LEAST_ACROSS = 1.0
"""Variance across the line of sight, at least, over that along it: of detections without an azimuth
error of their own, for confirmed tracks and methods whose likelihoods take errors as they are.

A target's extent and errors of own ship's position act on both axes. The stated range error covers
them; across, the azimuth error falls below them at short range.
"""
MIN_VARIANCE_SHARE = 1e-11
"""Smallest variance of a position as a share of the largest: axes of 3e-6 to 1."""


def unbiased_position(range: ArrayLike, azimuth: ArrayLike, azimuth_std: ArrayLike) -> FloatArray:
    """Convert range and azimuth to a Cartesian position without bias.

    ``E[cos(a + e)] = exp(-s^2/2) cos(a)`` for Gaussian e of deviation s, so dividing by that factor
    removes the bias exactly.

    Parameters
    ----------
    range, azimuth, azimuth_std : (...) array_like
        m, rad, rad.

    Returns
    -------
    (..., 2) ndarray
        Position in the axes in which the azimuth is measured, m.
    """
    unbiased_range = np.asarray(range) * np.exp(0.5 * np.square(azimuth_std))
    return np.stack([unbiased_range * np.cos(azimuth), unbiased_range * np.sin(azimuth)], axis=-1)


def measured_polar(detections: RecordArray) -> tuple[FloatArray, FloatArray]:
    """Measured range and azimuth, the inverse of `unbiased_position`.

    Parameters
    ----------
    detections : (...) ndarray of DETECTION
        Detections.

    Returns
    -------
    range : (...) ndarray
        m.
    azimuth : (...) ndarray
        In the fixed frame's axes, rad.
    """
    offset = detections["position"] - detections["sensor_pose"][..., :2]
    unbiased_range = np.hypot(offset[..., 0], offset[..., 1])
    range_ = unbiased_range * np.exp(-0.5 * np.square(detections["azimuth_std"]))
    return range_, np.arctan2(offset[..., 1], offset[..., 0])


def measurement_covariance(
    range: ArrayLike,
    azimuth: ArrayLike,
    range_variance: ArrayLike,
    azimuth_std: ArrayLike,
    least_across: ArrayLike = 0.0,
) -> FloatArray:
    """Covariance of `unbiased_position`, exact for a target at this range and azimuth.

    With ``b = exp(-s^2/2)``, along and across the line of sight::

        along  = (r^2 + s_r^2) (1 + b^4) / (2 b^2) - r^2
        across = max((r^2 + s_r^2) (1 - b^4) / (2 b^2), least_across along)

    rotated by the azimuth. Neither is below `MIN_VARIANCE_SHARE` of the other.

    Parameters
    ----------
    range, azimuth, range_variance, azimuth_std : (...) array_like
        m, rad, m^2, rad. The true range and azimuth, or their best estimates.
    least_across : (...) array_like, optional
        0: the azimuth error is all; see `LEAST_ACROSS`.

    Returns
    -------
    (..., 2, 2) ndarray
        m^2.
    """
    along, across = _variances(
        np.square(range), np.asarray(range_variance), azimuth_std, least_across
    )
    return rotated_covariance(along, across, np.cos(azimuth), np.sin(azimuth))


def _variances(
    square: FloatArray,
    range_variance: FloatArray,
    azimuth_std: ArrayLike,
    least_across: ArrayLike,
) -> tuple[FloatArray, FloatArray]:
    """Variances along and across the line of sight, of squared ranges.

    See `measurement_covariance`.
    """
    angle_variance = np.square(azimuth_std)
    # (1 +- b^4) / (2 b^2) = cosh(s^2), sinh(s^2), and cosh(u) - 1 = 2 sinh(u/2)^2: small s
    # costs no digits.
    along = 2.0 * square * np.sinh(0.5 * angle_variance) ** 2
    along = along + range_variance * np.cosh(angle_variance)
    across = np.maximum((square + range_variance) * np.sinh(angle_variance), least_across * along)
    # Beyond this ratio the rotation and sums of covariances lose the smaller to rounding.
    least = MIN_VARIANCE_SHARE * np.maximum(along, across)
    return np.maximum(along, least), np.maximum(across, least)


def rotated_covariance(
    along: FloatArray, across: FloatArray, cosine: FloatArray, sine: FloatArray
) -> FloatArray:
    """Covariance (..., 2, 2) of variances (...) along and across a direction.

    The direction is given by its cosine and sine (...).
    """
    covariance = np.empty((*np.shape(along), 2, 2))
    covariance[..., 0, 0] = along * cosine**2 + across * sine**2
    covariance[..., 1, 1] = along * sine**2 + across * cosine**2
    covariance[..., 0, 1] = covariance[..., 1, 0] = (along - across) * cosine * sine
    return covariance


def covariance_of_pose(offset: FloatArray, pose_covariance: FloatArray) -> FloatArray:
    """Position covariance that an uncertain sensor pose adds: J C J', to first order.

    Parameters
    ----------
    offset : (..., 2) ndarray
        Position relative to the sensor, in the fixed frame's axes, m.
    pose_covariance : (..., 3, 3) ndarray
        Covariance C of the sensor's x, y, yaw.

    Returns
    -------
    (..., 2, 2) ndarray
        m^2. The error is common to the detections of a scan. Hits of a track come from different
        scans, so within a track these errors count as independent.
    """
    jacobian = np.zeros((*offset.shape[:-1], 2, 3))
    jacobian[..., 0, 0] = jacobian[..., 1, 1] = 1.0
    jacobian[..., 0, 2] = -offset[..., 1]
    jacobian[..., 1, 2] = offset[..., 0]
    return jacobian @ pose_covariance @ np.swapaxes(jacobian, -1, -2)


def major_sigma(covariance: FloatArray) -> FloatArray:
    """Standard deviation along the major axis of each (..., 2, 2) covariance, m."""
    half_sum = 0.5 * (covariance[..., 0, 0] + covariance[..., 1, 1])
    half_difference = 0.5 * (covariance[..., 0, 0] - covariance[..., 1, 1])
    return np.sqrt(half_sum + np.hypot(half_difference, covariance[..., 0, 1]))


def convert_measurements(
    scan: Scan,
    sensor: SensorModel,
    scan_index: int,
    least_across: ArrayLike = 0.0,
    number: int = 0,
) -> RecordArray:
    """Convert a scan to detections in the fixed frame (Step 1; Eqs. 6-11).

    Parameters
    ----------
    scan : Scan
        The n detections as measured.
    sensor : SensorModel
        Errors of measurements for which the scan has none.
    scan_index : int
        Index stored with each detection.
    least_across : (n,) array_like, optional
        See `measurement_covariance`.
    number : int, optional
        Of the sensor.

    Returns
    -------
    (n,) ndarray of DETECTION
    """
    detections = np.zeros(len(scan.range), dtype=DETECTION)
    if not len(detections):
        return detections
    detections["scan"], detections["sensor"] = scan_index, number
    detections["index"] = np.arange(len(detections))
    detections["time"] = scan.stamp + (0.0 if scan.time_offset is None else scan.time_offset)
    detections["range_std"] = np.nan if scan.range_std is None else scan.range_std
    detections["azimuth_std"] = sensor.azimuth_std if scan.azimuth_std is None else scan.azimuth_std
    detections["least_across"] = least_across
    detections["sensor_pose"] = scan.sensor_pose
    yaw = detections["sensor_pose"][:, 2]
    offset = unbiased_position(scan.range, scan.azimuth + yaw, detections["azimuth_std"])
    detections["position"] = detections["sensor_pose"][:, :2] + offset
    covariance = measurement_covariance(
        scan.range,
        scan.azimuth + yaw,
        sensor.range_variance(scan.range) if scan.range_std is None else scan.range_std**2,
        detections["azimuth_std"],
        least_across,
    )
    if scan.sensor_pose_covariance is not None:
        detections["sensor_pose_covariance"] = scan.sensor_pose_covariance
        covariance += covariance_of_pose(offset, detections["sensor_pose_covariance"])
    detections["covariance"] = covariance
    detections["major_sigma"] = major_sigma(covariance)
    range_rates.take(detections, scan, sensor)
    detections["clutter_density"] = sensor.clutter_density
    intensity = scan.features.get("intensity", np.nan)
    detections["intensity"] = np.where(np.abs(intensity) < MAX_INTENSITY, intensity, np.nan)
    detections["amplitude"] = np.nan
    return detections


def covariance_at(
    detections: RecordArray, positions: FloatArray, sensor: SensorModel | RangeErrors
) -> FloatArray:
    """Re-evaluate the detections' covariances for targets at other positions.

    A fitted position gives a better range-dependent error, and a better direction of the error
    ellipse, than the measured position (design: R at the fit).

    Parameters
    ----------
    detections : (...) ndarray of DETECTION
        Detections.
    positions : (..., 2) ndarray
        Position of each target, fixed frame, m.
    sensor : SensorModel or RangeErrors
        Range errors of detections without their own.

    Returns
    -------
    (..., 2, 2) ndarray
        m^2.
    """
    offset = positions - detections["sensor_pose"][..., :2]
    x, y = offset[..., 0], offset[..., 1]
    range_ = np.hypot(x, y)
    range_variance = range_variance_at(detections, range_, sensor)
    along, across = _variances(
        range_**2, range_variance, detections["azimuth_std"], detections["least_across"]
    )
    away = range_ > 0.0
    cosine = np.divide(x, range_, out=np.ones(range_.shape), where=away)
    sine = np.divide(y, range_, out=np.zeros(range_.shape), where=away)
    covariance = rotated_covariance(along, across, cosine, sine)
    if not detections["sensor_pose_covariance"].any():
        return covariance
    return covariance + covariance_of_pose(offset, detections["sensor_pose_covariance"])


def range_variance_at(
    detections: RecordArray, range: FloatArray, sensor: SensorModel | RangeErrors
) -> FloatArray:
    """Variance of the detections' ranges for targets at the given ranges, (...), m^2.

    A detection's own deviation does not depend on the range.
    """
    own = detections["range_std"]
    return np.where(np.isnan(own), sensor.range_variance(range, detections["sensor"]), own**2)


def hit_keys(detections: RecordArray) -> IntArray:
    """A number of each detection, of its scan and its index there, (...)."""
    return np.asarray(detections["scan"] * HIT_KEYS + detections["index"], np.int64)


class MeasurementWindow:
    """Detections of the recent scans, addressed by ids that never change.

    Ids count from 0 in order of arrival. Removing old scans leaves the other ids unchanged:
    hypotheses refer to detections by integers, and the window bounds the memory.

    Attributes
    ----------
    first_id : int
        Id of the oldest detection that is not forgotten.
    """

    def __init__(self) -> None:
        self._detections = np.zeros(0, DETECTION)
        # The same as blocks of bytes, with room for more behind them: not to copy all in each scan.
        self._room = self._detections.view((np.void, DETECTION.itemsize))
        self.first_id = 0

    def append(self, detections: RecordArray) -> IntArray:
        """Add a scan's detections, (n,) of DETECTION, and return their ids, (n,)."""
        held, blocks = len(self._detections), detections.view(self._room.dtype)
        total = held + len(blocks)
        if not total <= len(self._room) <= 4 * total:
            before, self._room = self._room[:held], np.empty(2 * total, blocks.dtype)
            self._room[:held] = before
        self._room[held:total] = blocks
        self._detections = self._room[:total].view(DETECTION)
        return self.first_id + np.arange(held, total)

    def forget(self, before_scan: int) -> None:
        """Remove the detections of the scans before the given scan index."""
        old = int(np.searchsorted(self._detections["scan"], before_scan))
        self._detections, self._room = self._detections[old:], self._room[old:]
        self.first_id += old

    def __getitem__(self, ids: IntArray) -> RecordArray:
        """Detections with the given ids, in the ids' shape."""
        return rows_of(self._detections, ids - self.first_id)

    def find(
        self, hits: Sequence[Sequence[tuple[int, int]]] | NDArray[np.object_]
    ) -> tuple[IntArray, IntArray]:
        """The detections with the scan and detection indices of n tracks, those still here.

        Parameters
        ----------
        hits : sequence of sequence of (int, int)
            As in `ConfirmedTrack.hits`.

        Returns
        -------
        track, ids : (h,) ndarray of int
            Track of each hit, and id of its detection, in the order of the hits.
        """
        track = np.arange(len(hits)).repeat(np.array([len(path) for path in hits], np.int64))
        if not len(track) or not len(self):
            return track[:0], track[:0]
        wanted = np.array([hit for path in hits for hit in path], np.int64) @ (HIT_KEYS, 1)
        keys = hit_keys(self._detections)
        order = np.argsort(keys, kind="stable")
        row = order[np.minimum(np.searchsorted(keys, wanted, sorter=order), len(keys) - 1)]
        found = keys[row] == wanted
        return track[found], self.first_id + row[found]

    def column(self, name: str, ids: IntArray) -> FloatArray:
        """A field of the detections with the given ids, in the ids' shape."""
        return np.asarray(self._detections[name][ids - self.first_id])

    def __len__(self) -> int:
        """Number of detections in the window."""
        return len(self._detections)
