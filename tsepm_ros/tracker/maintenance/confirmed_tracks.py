"""The table of held tracks: a row for each track."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray, changed, indices
from tsepm_ros.tracker.maintenance.external_tracker import LISTED
from tsepm_ros.tracker.maintenance.stationary import StraightFits
from tsepm_ros.tracker.measurement import Histories, major_sigma
from tsepm_ros.tracker.motion import InteractingModels
from tsepm_ros.tracker.tracks import TrackArrays

UNPROVEN = 0.005
"""Probability that a new track's target exists, by which the detection probability is learned.

In clutter alone a track is ever proven with this probability at most (Ville): the scans after a
false start say nothing of targets, whatever their number. A choice.
"""

T = TypeVar("T", bound=np.generic)


class Status(IntEnum):
    """What becomes of a held track: published, withheld while it is vague, or a fixed echo."""

    PUBLISHED = 0
    WITHHELD = 1
    FIXED = 2


@dataclass(frozen=True, eq=False)
class HeldTracks:
    """Held tracks, a row each.

    Attributes
    ----------
    tracks : TrackArrays
        Their states are the means over the modes of motion.
    models : InteractingModels
        State and probability of each mode.
    histories : Histories
        Features of the plots so far.
    fits : StraightFits
        Fits of constant velocity, by which it is judged whether the target stands still.
    existence : (n,) ndarray
        Probability r that the target exists.
    proven : (n,) ndarray
        The same for any P_D, from `UNPROVEN` at the start: by the scans since alone.
    visible : (n,) ndarray
        Probability s that the target, if it exists, is visible: not faded.
    covered_scans : (n,) ndarray
        Scans that covered the target since its last detection, each weighted by the probability
        that the last detection was before it.
    last_detected : (n,) ndarray
        Stamp of the last scan in which the target was probably detected, s.
    agreeing_scans : (n,) ndarray of int
        Scans in a row in which the track agreed with an older track.
    unlisted_since : (n,) ndarray
        Time since which the downstream tracker has not listed the track, s; or `LISTED`.
    status : (n,) ndarray of int
        Whether the track is published: a value of `Status`.
    announced : (n,) ndarray of bool
        Whether the track was ever published.
    hit_sigma : (n,) ndarray
        Standard deviation of the last detection, along its major axis, m; of a new track its own.
    strength_hits, strength_total : (n,) ndarray
        Detections with a strength so far, each weighted by the probability that it is the track's,
        and the sum of their exponents.
    """

    tracks: TrackArrays
    models: InteractingModels
    histories: Histories
    fits: StraightFits
    existence: FloatArray
    proven: FloatArray
    visible: FloatArray
    covered_scans: FloatArray
    last_detected: FloatArray
    agreeing_scans: IntArray
    unlisted_since: FloatArray
    status: IntArray
    announced: BoolArray
    hit_sigma: FloatArray
    strength_hits: FloatArray
    strength_total: FloatArray

    @classmethod
    def of(
        cls,
        tracks: TrackArrays,
        existence: float | FloatArray,
        histories: Histories | None = None,
        misfit: float | FloatArray = 1.0,
        strengths: tuple[FloatArray, FloatArray] | None = None,
        hit_sigma: FloatArray | None = None,
    ) -> HeldTracks:
        """Rows of new tracks, whose targets exist with a probability, a number or (n,).

        Without histories no feature of their hits is known, nor without `strengths` these: their
        number and the sum of their exponents. The covariances are too small for the
        hits by factors `misfit`, a number or (n,), which counts in the fits. The last hits had the
        errors `hit_sigma`, by default those of the tracks.
        """
        n = len(tracks)
        strength_hits, strength_total = strengths or (np.zeros(n), np.zeros(n))
        return cls(
            tracks=tracks,
            models=InteractingModels.of(tracks.state, tracks.covariance),
            histories=Histories.of(np.zeros((n, 0, 3))) if histories is None else histories,
            fits=StraightFits.of(
                tracks.state, tracks.covariance * np.broadcast_to(misfit, n)[:, None, None]
            ),
            existence=np.array(np.broadcast_to(existence, n), float),
            proven=np.full(n, UNPROVEN),
            visible=np.ones(n),
            covered_scans=np.zeros(n),
            last_detected=tracks.stamp,
            agreeing_scans=np.zeros(n, np.int64),
            unlisted_since=tracks.stamp,
            status=np.full(n, Status.PUBLISHED, np.int64),
            announced=np.ones(n, bool),
            hit_sigma=major_sigma(tracks.covariance[:, 0::2, 0::2])
            if hit_sigma is None
            else hit_sigma,
            strength_hits=strength_hits,
            strength_total=strength_total,
        )

    @classmethod
    def none(cls) -> HeldTracks:
        """No rows."""
        return cls.of(TrackArrays.of([]), 0.0)

    def __len__(self) -> int:
        """Number of tracks."""
        return len(self.existence)

    def where(self, rows: NDArray[np.generic]) -> HeldTracks:
        """The given rows (indices or a mask)."""
        rows, columns = indices(rows), self.__dict__
        return HeldTracks(
            tracks=self.tracks.where(rows),
            models=self.models.where(rows),
            histories=self.histories[rows],
            fits=self.fits[rows],
            **{name: columns[name][rows] for name in _COLUMNS},
        )

    def joined(self, other: HeldTracks) -> HeldTracks:
        """These rows and then others."""
        columns: dict[str, Any] = {
            name: np.concatenate([getattr(self, name), getattr(other, name)]) for name in _COLUMNS
        }
        return HeldTracks(
            tracks=self.tracks.joined(other.tracks),
            models=self.models.joined(other.models),
            histories=Histories.joined(self.histories, other.histories),
            fits=StraightFits.joined(self.fits, other.fits),
            **columns,
        )

    def predicted(self, stamp: float, max_speed: float, stays: BoolArray) -> HeldTracks:
        """The rows at the stamp of a scan (s), before its detections.

        A target that turns has a velocity that is unknown up to `max_speed`, m/s. Rows that stay
        (n,) are remembered as they are.
        """
        time_step = np.where(stays, 0.0, stamp - self.tracks.stamp)
        models = self.models.predicted(time_step, max_speed)
        state, covariance = models.combined()
        return changed(
            self,
            tracks=changed(
                self.tracks,
                stamp=np.full(len(self), stamp),
                state=state,
                covariance=covariance,
                age=self.tracks.age + stamp - self.tracks.stamp,
            ),
            models=models,
            fits=self.fits.predicted(time_step),
        )

    def modes(self) -> tuple[FloatArray, FloatArray]:
        """States (3, n, 4) and covariances (3, n, 4, 4): the filter's two modes, then the fit."""
        models, fits = self.models, self.fits
        return (
            np.concatenate([models.state, fits.state[None]]),
            np.concatenate([models.covariance, fits.covariance[None]]),
        )

    def revised(self, corrected: TrackArrays, existence: FloatArray | None = None) -> HeldTracks:
        """The rows with the starts of tracks, by their ids, that were corrected.

        Each goes on from the corrected state, as its next revision. Its target exists as before, or
        with a given probability if it was just found again: then its age stays, since
        the first hit of all. Its hits are those of the start, by which it is judged.
        """
        tracks = self.tracks
        _, row, place = np.intersect1d(tracks.track_id, corrected.track_id, return_indices=True)
        new = corrected.where(place)
        hits = list(tracks.hits)
        for to, of in zip(row, new.hits, strict=True):
            hits[to] = of
        if existence is not None:
            new = changed(new, age=np.maximum(new.age, tracks.age[row]))
        names = ("state", "covariance", "hit_count", "evaluation", "score", "scan_count", "age")
        figures: dict[str, Any] = {
            name: _put(getattr(tracks, name), row, getattr(new, name)) for name in names
        }
        revision = _put(tracks.revision, row, tracks.revision[row] + 1)
        found: dict[str, Any] = {}
        if existence is not None:
            found = {
                "existence": _put(self.existence, row, existence[place]),
                "proven": _put(self.proven, row, np.maximum(self.proven[row], UNPROVEN)),
                "hit_sigma": _put(self.hit_sigma, row, major_sigma(new.covariance[:, 0::2, 0::2])),
                "visible": _put(self.visible, row, 1.0),
                "covered_scans": _put(self.covered_scans, row, 0.0),
                "last_detected": _put(self.last_detected, row, new.stamp),
                "status": _put(self.status, row, Status.PUBLISHED),
                "announced": _put(self.announced, row, True),
                "agreeing_scans": _put(self.agreeing_scans, row, 0),
            }
        return changed(
            self,
            **found,
            tracks=changed(tracks, hits=hits, revision=revision, **figures),
            models=self.models.with_rows(row, InteractingModels.of(new.state, new.covariance)),
            fits=self.fits.with_rows(row, StraightFits.of(new.state, new.covariance)),
        )

    def listed(self, reported: TrackArrays, existence: float) -> HeldTracks:
        """The rows with the states that a downstream tracker reports of tracks with their ids.

        Their targets exist with a probability; hits and evaluation stay as they are.
        """
        tracks = self.tracks
        _, row, place = np.intersect1d(tracks.track_id, reported.track_id, return_indices=True)
        reported = reported.where(place)
        return changed(
            self,
            tracks=changed(
                tracks,
                stamp=_put(tracks.stamp, row, reported.stamp),
                state=_put(tracks.state, row, reported.state),
                covariance=_put(tracks.covariance, row, reported.covariance),
                age=_put(tracks.age, row, tracks.age[row] + reported.stamp - tracks.stamp[row]),
            ),
            models=self.models.with_rows(
                row, InteractingModels.of(reported.state, reported.covariance)
            ),
            fits=self.fits.with_rows(row, StraightFits.of(reported.state, reported.covariance)),
            existence=_put(self.existence, row, existence),
            proven=_put(self.proven, row, existence),
            last_detected=_put(
                self.last_detected, row, np.maximum(self.last_detected[row], reported.stamp)
            ),
            unlisted_since=_put(self.unlisted_since, row, LISTED),
            status=_put(self.status, row, Status.PUBLISHED),
            announced=_put(self.announced, row, True),
        )


_COLUMNS = (
    "existence",
    "proven",
    "visible",
    "covered_scans",
    "last_detected",
    "agreeing_scans",
    "unlisted_since",
    "status",
    "announced",
    "hit_sigma",
    "strength_hits",
    "strength_total",
)
"""The fields of `HeldTracks` that are plain arrays."""


def _put(array: NDArray[T], row: IntArray, values: NDArray[T] | float) -> NDArray[T]:
    """A copy of an array with other values in some rows."""
    array = array.copy()
    array[row] = values
    return array
