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
"""Confirmed tracks, and tracks made from their hits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from datetime import UTC, datetime, timedelta
from enum import IntEnum
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.numerics.arrays import FloatArray, IntArray, Rows, replaced
from tsepm_ros.numerics.gaussian import proper_covariance
from tsepm_ros.tracker.initial_state import NO_HIT
from tsepm_ros.tracker.measurement import MeasurementWindow
from tsepm_ros.tracker.motion import predict

UNIX_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
NEW_TRACK_EXISTENCE = 0.99
"""Probability that a confirmed track's target exists, where the method estimates none: a choice."""
EVEN_PROBABILITY, SURE_PROBABILITY = 0.5, 0.9
"""Probabilities above which something is more probable than not, and from which on it counts as
sure: a choice."""
MIN_EXISTENCE = 1e-5
"""Probability of existence below which a track ends."""


class TrackStatus(IntEnum):
    """The state of a confirmed track.

    It coasts while its target probably exists no more, or its place is not known well enough to be
    recognised; with a `min_speed` it may stand still, as a fixed echo.
    """

    CONFIRMED = 0
    COASTING = 1
    STANDS_STILL = 2


@dataclass(frozen=True, eq=False)
class ConfirmedTrack:
    """A confirmed track with the initial state for a tracker.

    Attributes
    ----------
    track_id : int
        Unique for the life of its initiator, across resets.
    stamp : float
        Time of the state, s.
    state : (4,) ndarray
        ``[x, vx, y, vy]``, m and m/s, in the fixed frame.
    covariance : (4, 4) ndarray
        Covariance of `state`, same order.
    hits : tuple of (int, int)
        (scan index, detection index) of each hit, oldest first. Scans count from 0 since the last
        reset. For a merged track: the hits of its best member.
    evaluation : float
        Evaluation of the track by the method.
    score : float
        Log-likelihood ratio; nan if the method computes none.
    scan_count : int
        Scans since the first hit, inclusive, at confirmation (N_a).
    age : float
        Time since the first hit, s, at `stamp`.
    stationary_probability : float
        Probability that the target stands still; nan where it is not known.
    signal_to_clutter_db : float
        Ratio of the target's mean amplitude to clutter's, dB, where detections have an intensity;
        nan where it is not known.
    revision : int
        0 as first published; one more for each correction of the hits, and each time that the track
        was no longer published.
    existence_probability : float
        Probability that the target exists; nan where it is not known.
    time_since_hit : float
        Time since the last scan in which the target was probably detected, s.
    status : int
        A value of `TrackStatus`.
    """

    track_id: int
    stamp: float
    state: FloatArray
    covariance: FloatArray
    hits: tuple[tuple[int, int], ...]
    evaluation: float
    score: float = math.nan
    scan_count: int = 0
    age: float = 0.0
    stationary_probability: float = math.nan
    signal_to_clutter_db: float = math.nan
    revision: int = 0
    existence_probability: float = math.nan
    time_since_hit: float = 0.0
    status: int = TrackStatus.CONFIRMED

    @property
    def since(self) -> float:
        """Time of the first hit, s."""
        return self.stamp - self.age

    @property
    def position(self) -> FloatArray:
        """Position (x, y), m."""
        return self.state[[0, 2]]

    @property
    def velocity(self) -> FloatArray:
        """Velocity (vx, vy), m/s."""
        return self.state[[1, 3]]

    @property
    def position_covariance(self) -> FloatArray:
        """Covariance of the position, (2, 2), m^2."""
        return self.covariance[np.ix_([0, 2], [0, 2])]

    def __repr__(self) -> str:
        x, vx, y, vy = self.state
        hits = f"{len(self.hits)} hit{'' if len(self.hits) == 1 else 's'}"
        return (
            f"ConfirmedTrack({self.track_id}, {self.stamp:.12g} s, position ({x:.0f}, {y:.0f}) m, "
            f"velocity ({vx:.1f}, {vy:.1f}) m/s, {hits})"
        )

    def as_stonesoup(self, epoch: datetime = UNIX_EPOCH) -> Any:
        """The track as Stone Soup's `GaussianState`, the start of a Stone Soup track.

        Parameters
        ----------
        epoch : datetime, optional
            Time of the stamp 0, by default 1970-01-01 UTC. It is aware of its time zone or not as
            the timestamps of the detections are, since Python does not compare the two.

        Returns
        -------
        stonesoup.types.state.GaussianState
            With ``[x, vx, y, vy]``, its covariance and its timestamp.

        Raises
        ------
        ImportError
            If Stone Soup is not installed.
        """
        try:
            from stonesoup.types.state import GaussianState
        except ImportError as error:
            raise ImportError(
                f"as_stonesoup needs Stone Soup: pip install stonesoup ({error})"
            ) from error
        timestamp = epoch + timedelta(seconds=self.stamp)
        return GaussianState(self.state.copy(), self.covariance.copy(), timestamp=timestamp)

    def as_filterpy(self, *, order_by_dim: bool = True) -> tuple[FloatArray, FloatArray]:
        """State and covariance for a filter of filterpy: ``kf.x, kf.P = track.as_filterpy()``.

        Parameters
        ----------
        order_by_dim : bool, optional
            As in filterpy's `Q_discrete_white_noise`. True: ``[x, vx, y, vy]``; False:
            ``[x, y, vx, vy]``.

        Returns
        -------
        x : (4, 1) ndarray
        P : (4, 4) ndarray
            Copies, which a filter may change.
        """
        order = [0, 1, 2, 3] if order_by_dim else [0, 2, 1, 3]
        return self.state[order, None], self.covariance[np.ix_(order, order)]

    def predicted(self, stamp: float) -> ConfirmedTrack:
        """The track predicted to another time (s) at constant velocity."""
        return TrackArrays.from_tracks([self]).predicted(stamp)[0]


@dataclass(frozen=True, eq=False, kw_only=True)
class TrackArrays(Rows, Sequence[ConfirmedTrack]):
    """Tracks as arrays, a row each: a sequence of `ConfirmedTrack` for many tracks at once.

    Attributes
    ----------
    track_id, stamp, evaluation, score, scan_count, age, stationary_probability,
    signal_to_clutter_db, revision, existence_probability, time_since_hit, status : (n,) ndarray
        As in `ConfirmedTrack`.
    state : (n, 4) ndarray
    covariance : (n, 4, 4) ndarray
    hits : list
        The hits of each track.
    hit_count : (n,) ndarray of int
        Number of hits of each track.
    """

    track_id: IntArray
    stamp: FloatArray
    state: FloatArray
    covariance: FloatArray
    hits: NDArray[np.object_]
    hit_count: IntArray
    evaluation: FloatArray
    score: FloatArray
    scan_count: IntArray
    age: FloatArray
    stationary_probability: FloatArray
    signal_to_clutter_db: FloatArray
    revision: IntArray
    existence_probability: FloatArray
    time_since_hit: FloatArray
    status: IntArray

    @classmethod
    def from_tracks(cls, tracks: Sequence[ConfirmedTrack]) -> TrackArrays:
        """The arrays of the given tracks; `TrackArrays` are returned as they are."""
        if isinstance(tracks, cls):
            return tracks
        numbers: dict[str, Any] = {
            name: np.array([getattr(track, name) for track in tracks], kind)
            for name, kind in _KINDS.items()
        }
        numbers["state"] = numbers["state"].reshape(-1, 4)
        numbers["covariance"] = numbers["covariance"].reshape(-1, 4, 4)
        hits = np.fromiter([track.hits for track in tracks], object)
        return cls(hits=hits, hit_count=np.array(list(map(len, hits)), np.int64), **numbers)

    @property
    def sure(self) -> TrackArrays:
        """The tracks that neither coast nor stand still."""
        return self.where(self.status == TrackStatus.CONFIRMED)

    def proper(self) -> TrackArrays:
        """The tracks with positive definite covariances, see `gaussian.proper_covariance`."""
        covariance = proper_covariance(self.covariance) if len(self) else self.covariance
        return self if covariance is self.covariance else replaced(self, covariance=covariance)

    def __repr__(self) -> str:
        return f"TrackArrays({list(self[:3])}{f', {len(self)} in all' if len(self) > 3 else ''})"

    @overload
    def __getitem__(self, row: int) -> ConfirmedTrack: ...
    @overload
    def __getitem__(self, row: slice | NDArray[np.generic]) -> TrackArrays: ...
    def __getitem__(self, row: int | slice | NDArray[np.generic]) -> ConfirmedTrack | TrackArrays:
        """One track, or the tracks of a slice, of indices or of a mask."""
        if isinstance(row, np.ndarray):
            return self.where(row)
        if isinstance(row, slice):
            return Rows.__getitem__(self, row)
        numbers = {name: self.__dict__[name][row].item() for name in _SCALARS}
        return ConfirmedTrack(
            state=self.state[row], covariance=self.covariance[row], hits=self.hits[row], **numbers
        )

    def where(self, rows: NDArray[np.generic]) -> TrackArrays:
        """The tracks in the given rows (indices or a mask)."""
        return Rows.__getitem__(self, rows)

    def numbered(self, track_id: IntArray) -> TrackArrays:
        """The same tracks with other ids, (n,)."""
        return replaced(self, track_id=track_id)

    def predicted(self, stamp: float) -> TrackArrays:
        """The tracks predicted to a common time at constant velocity.

        Parameters
        ----------
        stamp : float
            Time of the prediction, s.

        Returns
        -------
        TrackArrays
            The same tracks with state F x and covariance F P F', F being Eq. 17's transition matrix
            over the time elapsed.
        """
        elapsed = stamp - self.stamp
        state, covariance = predict(self.state, self.covariance, elapsed)
        return replaced(
            self,
            stamp=np.full(len(self), stamp),
            state=state,
            covariance=covariance,
            age=self.age + elapsed,
            time_since_hit=self.time_since_hit + elapsed,
        )


_KINDS = {
    field.name: np.int64 if field.type == "int" else np.float64
    for field in fields(ConfirmedTrack)
    if field.name != "hits"
}
_SCALARS = tuple(name for name in _KINDS if name not in ("state", "covariance"))
NO_TRACKS = TrackArrays.from_tracks([])


def tracks_from_hits(
    window: MeasurementWindow,
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
    window : MeasurementWindow
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
        hits=np.fromiter(
            [
                tuple(pairs[begin:end])
                for begin, end in zip((ends - count).tolist(), ends.tolist(), strict=True)
            ],
            object,
        ),
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
        status=np.full(len(hits), TrackStatus.CONFIRMED, np.int64),
    )
