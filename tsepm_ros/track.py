"""What comes out: confirmed tracks."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class ConfirmedTrack:
    """A confirmed track with the state that a tracker can start from.

    Attributes
    ----------
    track_id : int
        Unique for the life of the initiator that made it; a reset does not start again.
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
        The method's own figure.
    score : float
        Log-likelihood ratio; nan where the method has none.
    scan_count : int
        Scans since the first hit, inclusive, at confirmation (N_a).
    age : float
        Time since the first hit, s, at `stamp`.
    """

    track_id: int
    stamp: float
    state: NDArray[np.float64]
    covariance: NDArray[np.float64]
    hits: tuple[tuple[int, int], ...]
    evaluation: float
    score: float = math.nan
    scan_count: int = 0
    age: float = 0.0

    @property
    def position(self) -> NDArray[np.float64]:
        """Position (x, y), m."""
        return self.state[[0, 2]]

    @property
    def velocity(self) -> NDArray[np.float64]:
        """Velocity (vx, vy), m/s."""
        return self.state[[1, 3]]

    @property
    def position_covariance(self) -> NDArray[np.float64]:
        """Covariance of the position, (2, 2), m^2."""
        return self.covariance[np.ix_([0, 2], [0, 2])]

    def predicted(self, stamp: float) -> ConfirmedTrack:
        """The track carried to another time (s) at constant velocity."""
        return TrackArrays.of([self]).predicted(stamp)[0]


@dataclass(frozen=True, eq=False)
class TrackArrays(Sequence[ConfirmedTrack]):
    """Tracks as arrays, a row each: a sequence of `ConfirmedTrack` that is quick in numbers.

    Attributes
    ----------
    track_id, stamp, evaluation, score, scan_count, age : (n,) ndarray
    state : (n, 4) ndarray
    covariance : (n, 4, 4) ndarray
    hits : list
        The hits of each track.
    """

    track_id: NDArray[np.int64]
    stamp: NDArray[np.float64]
    state: NDArray[np.float64]
    covariance: NDArray[np.float64]
    hits: list[tuple[tuple[int, int], ...]]
    evaluation: NDArray[np.float64]
    score: NDArray[np.float64]
    scan_count: NDArray[np.int64]
    age: NDArray[np.float64]

    @classmethod
    def of(cls, tracks: Sequence[ConfirmedTrack]) -> TrackArrays:
        """The arrays of some tracks; those of arrays are themselves."""
        if isinstance(tracks, cls):
            return tracks
        return cls(
            np.array([track.track_id for track in tracks], np.int64),
            np.array([track.stamp for track in tracks]),
            np.array([track.state for track in tracks]).reshape(-1, 4),
            np.array([track.covariance for track in tracks]).reshape(-1, 4, 4),
            [track.hits for track in tracks],
            np.array([track.evaluation for track in tracks]),
            np.array([track.score for track in tracks]),
            np.array([track.scan_count for track in tracks], np.int64),
            np.array([track.age for track in tracks]),
        )

    def __len__(self) -> int:
        """Number of tracks."""
        return len(self.track_id)

    def __getitem__(self, row: Any) -> Any:
        """One track, or the tracks of a slice."""
        if isinstance(row, slice):
            return [self[index] for index in range(*row.indices(len(self)))]
        return ConfirmedTrack(
            int(self.track_id[row]),
            float(self.stamp[row]),
            self.state[row],
            self.covariance[row],
            self.hits[row],
            float(self.evaluation[row]),
            float(self.score[row]),
            int(self.scan_count[row]),
            float(self.age[row]),
        )

    def where(self, rows: NDArray[np.bool_]) -> TrackArrays:
        """The tracks that a mask selects."""
        return TrackArrays(
            self.track_id[rows],
            self.stamp[rows],
            self.state[rows],
            self.covariance[rows],
            list(itertools.compress(self.hits, rows)),
            self.evaluation[rows],
            self.score[rows],
            self.scan_count[rows],
            self.age[rows],
        )

    def joined(self, other: TrackArrays) -> TrackArrays:
        """These tracks and then others."""
        return TrackArrays(
            np.concatenate([self.track_id, other.track_id]),
            np.concatenate([self.stamp, other.stamp]),
            np.concatenate([self.state, other.state]),
            np.concatenate([self.covariance, other.covariance]),
            self.hits + other.hits,
            np.concatenate([self.evaluation, other.evaluation]),
            np.concatenate([self.score, other.score]),
            np.concatenate([self.scan_count, other.scan_count]),
            np.concatenate([self.age, other.age]),
        )

    def predicted(self, stamp: float) -> TrackArrays:
        """The tracks carried to one time at constant velocity.

        Parameters
        ----------
        stamp : float
            Time to carry them to, s.

        Returns
        -------
        TrackArrays
            The same tracks with state F x and covariance F P F', F being Eq. 17's transition matrix
            over the time step.
        """
        steps = stamp - self.stamp
        transition = np.zeros((len(self), 4, 4))
        transition[:, range(4), range(4)] = 1.0
        transition[:, 0, 1] = transition[:, 2, 3] = steps
        return replace(
            self,
            stamp=np.full(len(self), stamp),
            state=(transition @ self.state[..., None])[..., 0],
            covariance=transition @ self.covariance @ transition.transpose(0, 2, 1),
            age=self.age + steps,
        )
