"""Holding confirmed tracks for those who come late."""

from __future__ import annotations

from collections.abc import Sequence

from tsepm_ros.track import ConfirmedTrack, TrackArrays


class TrackHold:
    """Carries confirmed tracks forward for a while after their confirmation.

    Parameters
    ----------
    hold_time : float
        Time, s, for which a track is held; it ends at the first scan after that.
    """

    def __init__(self, hold_time: float) -> None:
        self.hold_time = hold_time
        self._tracks = TrackArrays.of([])

    def update(self, stamp: float, new: Sequence[ConfirmedTrack]) -> list[int]:
        """Take the tracks newly confirmed at `stamp` (s); returns the ids of those that end."""
        held = self._tracks.stamp >= stamp - self.hold_time
        ended: list[int] = self._tracks.track_id[~held].tolist()
        kept = self._tracks if held.all() else self._tracks.where(held)
        self._tracks = kept.joined(TrackArrays.of(new)) if len(new) else kept
        return ended

    def current(self, stamp: float) -> TrackArrays:
        """Every track held, carried to `stamp` (s) at constant velocity."""
        return self._tracks.predicted(stamp)

    def clear(self) -> list[int]:
        """End every track; returns their ids."""
        ended: list[int] = self._tracks.track_id.tolist()
        self._tracks = TrackArrays.of([])
        return ended
