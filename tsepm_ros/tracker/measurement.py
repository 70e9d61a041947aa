"""Measured detections: positions with a covariance, features, and the window of the last scans.

Features of plots, and whether a plot resembles those of a track (Environment 2018, Section 2).

Shen Y., "The target tracking algorithm based on environment technology", ICOI 2018. A target's
plots resemble each other in intensity, range width and azimuth width, and differ from clutter's and
from another target's. With u the mean of a track's n plots so far (Eq. 10) and u' the mean with one
more, the decision function is ``J = sum_p |u'_p - u_p|^2`` (Eq. 11), small for a plot of its own.

Readings
--------
- As printed, J adds squares of unlike units, and falls with ``1 / (n + 1)^2`` as the history grows,
  so that no threshold fits two tracks. `decision` reproduces the source's Table 1; no method uses
  it. Association uses the distance of the plot from the mean in units of the track's own standard
  deviation, ``t_p^2 = (z_p - u_p)^2 / (s_p^2 (1 + 1 / n_p))`` with the variance s_p^2 of the
  track's n_p plots. For a plot of the track with Gaussian features it has an F distribution with
  1 and n_p - 1 degrees of freedom. The chi-square quantile of its probability replaces each t_p^2:
  the gate of the sum then also holds for short histories.
- "The point track and track interval are used as feature distances" where a plot fits several
  tracks: the distance in position is added to J.

From polar measurements to Cartesian positions with a covariance (TSEPM 2018, Eqs. 6-11).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import chdtri, fdtrc

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray, Rows, appended, taken
from tsepm_ros.tracker import range_rates
from tsepm_ros.tracker.scan import Scan
from tsepm_ros.tracker.sensor import SensorModel

NAMES = ("intensity", "range_width", "azimuth_width")
"""The features, in the order of their columns."""
GATE_PROBABILITY = 0.99
"""Probability that a plot of the target passes the gate of its features."""
MAX_PLOT_COUNT = 30
"""Number of plots averaged, K of Eq. 10: the aspect changes, and older plots fade."""
MIN_RELATIVE_STD = 0.01
"""Smallest standard deviation of a feature, as a fraction of its mean: sensors round."""
MAX_FEATURE = 1e100
"""Magnitude from which a feature counts as not measured: its square could overflow."""
MIN_TAIL_PROBABILITY = 1e-300
"""Floor of a tail probability, which keeps its quantile finite."""


def measured_features(scan: Scan) -> FloatArray:
    """Features of a scan's detections, (n, 3); nan where not measured."""
    columns = [scan.features.get(name, np.full(len(scan), np.nan)) for name in NAMES]
    values = np.stack(columns, axis=1)
    return np.where(np.abs(values) < MAX_FEATURE, values, np.nan)


def decision(history: FloatArray, candidate: FloatArray) -> FloatArray:
    """The decision function as printed (Eqs. 10 and 11).

    Parameters
    ----------
    history : (..., n, p) ndarray
        Features of a track's plots.
    candidate : (..., p) ndarray
        Features of the plot that may be the track's next.

    Returns
    -------
    (...) ndarray
        J, small for a plot of the same target.
    """
    n = history.shape[-2]
    mean = history.mean(axis=-2)
    after = (n * mean + candidate) / (n + 1)
    return np.asarray(np.square(after - mean).sum(axis=-1))


@dataclass(frozen=True)
class Histories(Rows):
    """Statistics of the features of tracks' plots, a row for each track.

    Attributes
    ----------
    count : (n, 3) ndarray
        Number of plots with each feature.
    mean : (n, 3) ndarray
        Eq. 10.
    square : (n, 3) ndarray
        Sum of the squared deviations from the mean.
    """

    count: FloatArray
    mean: FloatArray
    square: FloatArray

    @classmethod
    def of(cls, features: FloatArray) -> Self:
        """Histories of plots (n, m, 3); nan: no plot, or not measured."""
        has = np.isfinite(features)
        values = np.where(has, features, 0.0)
        count = has.sum(axis=1).astype(float)
        mean = values.sum(axis=1) / np.maximum(count, 1.0)
        square = np.where(has, np.square(values - mean[:, None]), 0.0).sum(axis=1)
        return cls(count, mean, square)

    def with_plots(self, rows: IntArray, features: FloatArray) -> Self:
        """The histories after a further plot, (p, 3), of the rows (p,), each at most once."""
        updated = type(self)(self.count.copy(), self.mean.copy(), self.square.copy())
        has = np.isfinite(features)
        fading = np.minimum(1.0, (MAX_PLOT_COUNT - 1.0) / np.maximum(self.count[rows], 1.0))
        count = np.where(has, self.count[rows] * fading + 1.0, self.count[rows])
        deviation = np.where(has, features - self.mean[rows], 0.0)
        mean_change = deviation / np.maximum(count, 1.0)
        updated.count[rows] = count
        updated.mean[rows] += mean_change
        kept = np.where(has, fading, 1.0) * self.square[rows]
        updated.square[rows] = kept + deviation * (deviation - mean_change)
        return updated

    def dissimilarity(self, features: FloatArray) -> FloatArray:
        """Distance of each plot's features (n, 3) from those of its track, (n,).

        Chi-square distributed for plots of the same target; the number of comparable features
        (`known`) is the degrees of freedom.
        """
        known = self.known(features)
        freedom = np.where(known, self.count - 1.0, 1.0)
        variance = self.square / freedom
        variance = np.maximum(variance, np.square(MIN_RELATIVE_STD * self.mean))
        variance = variance * (1.0 + 1.0 / np.maximum(self.count, 1.0))
        squared_deviation = np.where(known, np.square(features - self.mean), 0.0)
        # A variance of 0: the distance is infinite for a different feature, 0 for an equal one.
        at_no_variance = np.where(squared_deviation > 0.0, np.inf, 0.0)
        with np.errstate(over="ignore"):
            distance = np.divide(
                squared_deviation, variance, out=at_no_variance, where=variance > 0.0
            )
        probability = np.maximum(fdtrc(1.0, freedom, distance), MIN_TAIL_PROBABILITY)
        return np.asarray(chdtri(1.0, probability).sum(axis=1))

    def known(self, features: FloatArray) -> BoolArray:
        """Which features of plots (n, 3) are comparable: measured, and twice in the track."""
        return np.isfinite(features) & (self.count >= 2.0)

    def resembled_by(self, features: FloatArray) -> BoolArray:
        """Whether plots (n, 3) resemble those of their tracks; true without comparable features."""
        freedom = self.known(features).sum(axis=1)
        gate = chdtri(np.maximum(freedom, 1), 1.0 - GATE_PROBABILITY)
        return np.asarray((self.dissimilarity(features) <= gate) | (freedom == 0))


DETECTION = np.dtype(
    [
        ("scan", np.int64),  # scan index
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
        ("range_rate", np.float64),  # m/s, against the moving sensor
        ("range_rate_std", np.float64),  # m/s; 0: no range rate
        ("clutter_density", np.float64),  # 1/m^2, at its position
        ("features", np.float64, (3,)),  # as in plot_features; nan: not measured
        ("strength", np.float64),  # exponent among clutter, without an end; nan: not known
    ]
)
"""A converted detection, with the fields for re-evaluating its covariance elsewhere."""


LEAST_ACROSS = 1.0
"""Variance across the line of sight, at least, over that along it: of detections without an azimuth
error of their own, for held tracks and methods whose likelihoods take errors as they are.

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


def measured_polar(detections: NDArray[np.void]) -> tuple[FloatArray, FloatArray]:
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


def position_covariance(
    range: ArrayLike,
    azimuth: ArrayLike,
    range_variance: ArrayLike,
    azimuth_std: ArrayLike,
    least_across: ArrayLike = 0.0,
) -> FloatArray:
    """Covariance of `unbiased_position`, exact for a target at the given range and azimuth.

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
    return rotated(along, across, np.cos(azimuth), np.sin(azimuth))


def _variances(
    square: FloatArray,
    range_variance: FloatArray,
    azimuth_std: ArrayLike,
    least_across: ArrayLike,
) -> tuple[FloatArray, FloatArray]:
    """Variances along and across the line of sight, of squared ranges.

    See `position_covariance`.
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


def rotated(
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


def unscented(detections: NDArray[np.void], sensor: SensorModel) -> NDArray[np.void]:
    """Convert the detections as Split-merge 2016 does, with R by the unscented transform.

    The position is ``r (cos a, sin a)`` (Eq. 4), with the bias that `unbiased_position` removes.
    The sigma points are (r, a), (r +- sqrt(3) s_r, a) and (r, a +- sqrt(3) s_a), with the weights
    1/3 and 1/6 (Julier, Uhlmann 1997, n + kappa = 3). The variances along and across the line of
    sight are::

        along  = s_r^2 + 2/9 r^2 (1 - cos(sqrt(3) s_a))^2
        across = 1/3 r^2 sin(sqrt(3) s_a)^2

    Parameters
    ----------
    detections : (...) ndarray of DETECTION
        From `convert`.
    sensor : SensorModel
        Range errors of detections without their own.

    Returns
    -------
    (...) ndarray of DETECTION
    """
    converted = detections.copy()
    range_, azimuth = measured_polar(detections)
    cosine, sine = np.cos(azimuth), np.sin(azimuth)
    offset = range_[..., None] * np.stack([cosine, sine], axis=-1)
    angle = math.sqrt(3.0) * detections["azimuth_std"]
    along = range_variance_at(detections, range_, sensor)
    along = along + 2.0 / 9.0 * np.square(range_ * (1.0 - np.cos(angle)))
    across = np.square(range_ * np.sin(angle)) / 3.0
    converted["position"] = detections["sensor_pose"][..., :2] + offset
    converted["covariance"] = rotated(along, across, cosine, sine) + pose_error_covariance(
        offset, detections["sensor_pose_covariance"]
    )
    converted["major_sigma"] = major_sigma(converted["covariance"])
    return converted


def pose_error_covariance(offset: FloatArray, pose_covariance: FloatArray) -> FloatArray:
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


def convert(
    scan: Scan, sensor: SensorModel, scan_index: int, least_across: ArrayLike = 0.0
) -> NDArray[np.void]:
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
        See `position_covariance`.

    Returns
    -------
    (n,) ndarray of DETECTION
    """
    detections = np.zeros(len(scan.range), dtype=DETECTION)
    detections["scan"] = scan_index
    detections["index"] = np.arange(len(detections))
    detections["time"] = scan.stamp
    if scan.time_offset is not None:
        detections["time"] += scan.time_offset
    detections["range_std"] = np.nan if scan.range_std is None else scan.range_std
    detections["azimuth_std"] = sensor.azimuth_std if scan.azimuth_std is None else scan.azimuth_std
    detections["least_across"] = least_across
    detections["sensor_pose"] = scan.sensor_pose
    yaw = detections["sensor_pose"][:, 2]
    offset = unbiased_position(scan.range, scan.azimuth + yaw, detections["azimuth_std"])
    detections["position"] = detections["sensor_pose"][:, :2] + offset
    covariance = position_covariance(
        scan.range,
        scan.azimuth + yaw,
        sensor.range_variance(scan.range) if scan.range_std is None else scan.range_std**2,
        detections["azimuth_std"],
        least_across,
    )
    if scan.sensor_pose_covariance is not None:
        detections["sensor_pose_covariance"] = scan.sensor_pose_covariance
        covariance += pose_error_covariance(offset, detections["sensor_pose_covariance"])
    detections["covariance"] = covariance
    detections["major_sigma"] = major_sigma(covariance)
    range_rates.take(detections, scan, sensor)
    detections["clutter_density"] = sensor.clutter_density
    detections["features"] = measured_features(scan)
    detections["strength"] = np.nan
    return detections


def covariance_at(
    detections: NDArray[np.void], positions: FloatArray, sensor: SensorModel
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
    sensor : SensorModel
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
    covariance = rotated(along, across, cosine, sine)
    if not detections["sensor_pose_covariance"].any():
        return covariance
    return covariance + pose_error_covariance(offset, detections["sensor_pose_covariance"])


def range_variance_at(
    detections: NDArray[np.void], range: FloatArray, sensor: SensorModel
) -> FloatArray:
    """Variance of the detections' ranges for targets at the given ranges, (...), m^2.

    A detection's own deviation does not depend on the range.
    """
    own = detections["range_std"]
    return np.where(np.isnan(own), sensor.range_variance(range), own**2)


class DetectionWindow:
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
        self._not_held = np.zeros(0)
        self.first_id = 0

    def append(self, detections: NDArray[np.void]) -> NDArray[np.int64]:
        """Add a scan's detections, (n,) of DETECTION, and return their ids, (n,)."""
        first = self.first_id + len(self._detections)
        self._detections = appended(self._detections, detections)
        self._not_held = np.concatenate([self._not_held, np.ones(len(detections))])
        return np.arange(first, first + len(detections))

    def forget(self, before_scan: int) -> None:
        """Remove the detections of the scans before the given scan index."""
        old = int(np.searchsorted(self._detections["scan"], before_scan))
        self._detections = self._detections[old:]
        self._not_held = self._not_held[old:]
        self.first_id += old

    def __getitem__(self, ids: NDArray[np.int64]) -> NDArray[np.void]:
        """Detections with the given ids, in the ids' shape."""
        return taken(self._detections, ids - self.first_id)

    def note_held(self, ids: NDArray[np.int64], probability: NDArray[np.float64]) -> None:
        """Note the probabilities that detections belong to confirmed tracks, (n,) each."""
        np.multiply.at(self._not_held, ids - self.first_id, 1.0 - np.minimum(probability, 1.0))

    def held_probability(self, ids: NDArray[np.int64]) -> NDArray[np.float64]:
        """Probability that the detections with the given ids belong to a confirmed track, (...).

        The probabilities of different tracks count as independent.
        """
        return np.asarray(1.0 - self._not_held[ids - self.first_id])

    def find(self, hits: Sequence[tuple[int, int]]) -> NDArray[np.int64]:
        """Ids of the detections with the given scan and detection indices, those still here.

        Parameters
        ----------
        hits : sequence of (int, int)
            As in `ConfirmedTrack.hits`, oldest first.

        Returns
        -------
        (h,) ndarray of int
            In the order of the hits; hits that are forgotten are left out.
        """
        ids: list[int] = []
        if not hits or not len(self) or hits[-1][0] < self._detections["scan"][0]:
            return np.array(ids, np.int64)
        scans = np.ascontiguousarray(self._detections["scan"])
        for scan, index in hits:
            first, last = np.searchsorted(scans, [scan, scan + 1])
            row = first + np.flatnonzero(self._detections["index"][first:last] == index)
            ids += (self.first_id + row).tolist()
        return np.array(ids, np.int64)

    def column(self, name: str, ids: NDArray[np.int64]) -> NDArray[np.float64]:
        """A field of the detections with the given ids, in the ids' shape."""
        return np.asarray(self._detections[name][ids - self.first_id])

    def __len__(self) -> int:
        """Number of detections in the window."""
        return len(self._detections)
