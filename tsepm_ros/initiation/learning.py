"""What the detections of a scan teach, beside their density: strengths and errors."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.environment import strength_texture
from tsepm_ros.environment.measurement_errors import MeasurementErrors
from tsepm_ros.environment.secondary_echoes import HeldTargets
from tsepm_ros.environment.target_strength import ScanStrengths
from tsepm_ros.initiation.scan_clutter import ScanClutter
from tsepm_ros.maintenance.held_tracks import HeldTracks
from tsepm_ros.maintenance.track_maintenance import TrackMaintenance
from tsepm_ros.numerics.rows import taken
from tsepm_ros.sensing.conversion import measured_polar
from tsepm_ros.sensing.coverage import EchoPoses
from tsepm_ros.sensing.plot_features import NAMES
from tsepm_ros.sensing.sensor import SensorModel

INTENSITY = NAMES.index("intensity")


def judge_strengths(
    clutter: ScanClutter,
    detections: NDArray[np.void],
    scan_index: int,
    most_hits: int,
) -> ScanStrengths | None:
    """What the strengths of a scan's detections say, by the scans before.

    Their exponents become the field `strength` of the detections.

    Parameters
    ----------
    clutter : ScanClutter
        Without `strengths` these do not count.
    detections : (d,) ndarray of DETECTION
    scan_index : int
    most_hits : int
        Hits that a path may have.

    Returns
    -------
    ScanStrengths or None
        None where they say nothing.
    """
    if clutter.strengths is None:
        return None
    judged = clutter.strengths.judge(
        detections["features"][:, INTENSITY],
        scan_index,
        detections["index"],
        lambda: clutter.rings,
        detections["position"],
    )
    if judged is None:
        return None
    detections["strength"] = judged.extrapolated
    return ScanStrengths.of(judged.exponent, judged.samples, most_hits)


def learn_strengths(clutter: ScanClutter, detections: NDArray[np.void], moved: float) -> None:
    """Learn the law of the strengths of clutter from the scan that was judged.

    Parameters
    ----------
    clutter : ScanClutter
        With the `weight` of each detection.
    detections : (d,) ndarray of DETECTION
    moved : float
        Distance that a target moves at most from scan to scan, m.
    """
    if clutter.strengths is None:
        return
    sigma, error = np.sort(detections["major_sigma"]), 0.0
    if len(sigma):  # three times the median
        error = 1.5 * float(sigma[(len(sigma) - 1) // 2] + sigma[len(sigma) // 2])
    reach = moved * np.arange(strength_texture.LAGS + 1.0) + math.sqrt(2.0) * error
    clutter.strengths.update(clutter.weight, (strength_texture.LAGS + 1.0) * moved + error, reach)


def learn_errors(
    errors: MeasurementErrors,
    maintenance: TrackMaintenance,
    sensor: SensorModel,
    detections: NDArray[np.void],
) -> None:
    """Learn the sensor's errors from held tracks' detections, if these have its errors."""
    track_id, row = maintenance.own_detections
    rows = np.isnan(detections["range_std"][row])
    own = taken(detections, row[rows])
    variance = sensor.range_variance(measured_polar(own)[0])
    errors.update(track_id[rows], own, variance, maintenance.held.tracks.track_id)


def held_targets(held: HeldTracks, poses: EchoPoses) -> HeldTargets:
    """The held tracks in the sensor's frame."""
    range_, azimuth = poses.polar(held.tracks.state[:, 0::2])
    return HeldTargets(held.tracks.track_id, range_, azimuth, held.existence)
