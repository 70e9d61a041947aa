"""A downstream tracker: its status, the tracks that it lists, and those of them that are usable."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.numerics.arrays import BoolArray, FloatArray
from tsepm_ros.tracker.scan import MAX_MAGNITUDE, MIN_MAGNITUDE
from tsepm_ros.tracker.tracks import TrackArrays

MAX_STATE = MAX_MAGNITUDE["sensor_pose"]
"""Largest accepted magnitude of a state component, m and m/s."""
MIN_SIGMA = MIN_MAGNITUDE["range_std"]
"""Smallest accepted standard deviation, m and m/s."""
MAX_ASYMMETRY = 1e-6
"""Largest accepted difference of two correlations that should be equal."""
MIN_EIGENVALUE = 1e-12
"""Smallest accepted eigenvalue of the correlations; below, it is due to rounding."""

LISTED = -math.inf
"""Value of the time since which a track is unlisted, for a listed track."""


class ExternalTracker(enum.Enum):
    """Status of a downstream tracker."""

    NONE = "none"
    ALIVE = "alive"
    SILENT = "silent"


@dataclass(frozen=True)
class DownstreamTracker:
    """Whether a downstream tracker is heard.

    Attributes
    ----------
    status : ExternalTracker
    last_report : float
        Stamp of its last report, s.
    """

    status: ExternalTracker = ExternalTracker.NONE
    last_report: float = -math.inf

    def at(self, stamp: float, timeout: float) -> DownstreamTracker:
        """The tracker at a time (s): silent if its last report is more than a timeout (s) away."""
        if self.status is ExternalTracker.ALIVE and abs(stamp - self.last_report) > timeout:
            return replace(self, status=ExternalTracker.SILENT)
        return self

    def keeps(self, since: FloatArray) -> BoolArray:
        """Which tracks, unlisted since times (n,), s, it keeps: those listed while it is heard."""
        return (
            since == LISTED if self.status is ExternalTracker.ALIVE else np.zeros(len(since), bool)
        )


@dataclass(frozen=True, eq=False)
class TrackerReport:
    """Everything that a downstream tracker tracks at a time.

    Attributes
    ----------
    stamp : float
        s.
    frame_id : str
        Frame of the states.
    tracks : TrackArrays
        With stamps of their own.
    """

    stamp: float
    frame_id: str
    tracks: TrackArrays


def usable(tracks: TrackArrays) -> tuple[TrackArrays, dict[str, int]]:
    """The tracks that can be held, and the number of the dropped tracks by reason.

    Parameters
    ----------
    tracks : TrackArrays

    Returns
    -------
    tracks : TrackArrays
        With symmetric covariances.
    dropped : dict of str to int
        ``tracked_not_finite``: stamp, state or covariance is not finite, or beyond `MAX_STATE`;
        ``tracked_bad_covariance``: not symmetric and positive definite, or a standard deviation
        below `MIN_SIGMA`; ``tracked_duplicate_id``: of several with an id the first is kept.
    """
    state, covariance = tracks.state, tracks.covariance
    finite = np.isfinite(tracks.stamp) & (np.abs(state) <= MAX_STATE).all(axis=1)
    finite &= (np.abs(covariance) <= MAX_STATE**2).all(axis=(1, 2))
    valid = finite.copy()
    valid[finite] = _proper(covariance[finite])
    _, first = np.unique(tracks.track_id[valid], return_index=True)
    kept = np.flatnonzero(valid)[np.sort(first)]
    counts = {
        "tracked_not_finite": (~finite).sum(),
        "tracked_bad_covariance": finite.sum() - valid.sum(),
        "tracked_duplicate_id": valid.sum() - len(kept),
    }
    usable_tracks = tracks.where(kept)
    symmetric = 0.5 * (usable_tracks.covariance + np.swapaxes(usable_tracks.covariance, 1, 2))
    dropped = {reason: int(number) for reason, number in counts.items() if number}
    return replace(usable_tracks, covariance=symmetric), dropped


def _proper(covariance: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which of the finite matrices (n, 4, 4) are covariances."""
    variance = np.diagonal(covariance, axis1=1, axis2=2)
    sigma = np.sqrt(np.maximum(variance, MIN_SIGMA**2))
    correlation = covariance / (sigma[:, :, None] * sigma[:, None, :])
    skew = np.abs(correlation - np.swapaxes(correlation, 1, 2)).max(axis=(1, 2))
    least = np.linalg.eigvalsh(correlation).min(axis=1)
    proper = (variance >= MIN_SIGMA**2).all(axis=1)
    return np.asarray(proper & (skew <= MAX_ASYMMETRY) & (least > MIN_EIGENVALUE))
