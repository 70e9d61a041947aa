"""Tracks from the detections that are their hits."""

from __future__ import annotations

import numpy as np

from tsepm_ros.kinematics.track import TrackArrays
from tsepm_ros.numerics.arrays import FloatArray, IntArray
from tsepm_ros.sensing.detection_window import DetectionWindow
from tsepm_ros.stages.paths import NO_HIT


def tracks_from_hits(
    window: DetectionWindow,
    hits: IntArray,
    *,
    stamp: float,
    scan_index: int,
    state: FloatArray,
    covariance: FloatArray,
    evaluation: FloatArray,
    score: FloatArray | None = None,
) -> TrackArrays:
    """Build tracks as a method puts them out.

    Parameters
    ----------
    window : DetectionWindow
        With their hits.
    hits : (n, most) ndarray of int
        Detection ids of the hits of each, oldest first, then NO_HIT; at least one hit.
    stamp : float
        Time of the states, s.
    scan_index : int
        Of the scan at that time.
    state : (n, 4) ndarray
    covariance : (n, 4, 4) ndarray
    evaluation, score : (n,) ndarray
        As in `ConfirmedTrack`; a method without a score gives none.

    Returns
    -------
    TrackArrays
        With their places as ids.
    """
    present = hits != NO_HIT
    count = present.sum(axis=1)
    detections, first = window[hits[present]], window[hits[:, 0]]
    pairs = list(zip(detections["scan"].tolist(), detections["index"].tolist(), strict=True))
    ends = np.cumsum(count)
    return TrackArrays(
        track_id=np.arange(len(hits)),
        stamp=np.full(len(hits), stamp),
        state=state,
        covariance=covariance,
        hits=[
            tuple(pairs[begin:end])
            for begin, end in zip((ends - count).tolist(), ends.tolist(), strict=True)
        ],
        hit_count=count,
        evaluation=evaluation,
        score=np.full(len(hits), np.nan) if score is None else score,
        scan_count=scan_index + 1 - first["scan"].astype(np.int64),
        age=stamp - first["time"],
        stationary_probability=np.full(len(hits), np.nan),
        signal_to_clutter_db=np.full(len(hits), np.nan),
        revision=np.zeros(len(hits), np.int64),
        existence_probability=np.full(len(hits), np.nan),
        time_since_hit=np.zeros(len(hits)),
    )
