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
        self._scans: list[tuple[float, TrackArrays]] = []

    def update(self, stamp: float, new: Sequence[ConfirmedTrack]) -> list[int]:
        """Take the tracks newly confirmed at `stamp` (s); returns the ids of those that end."""
        oldest = stamp - self.hold_time
        ended = [tracks for confirmed, tracks in self._scans if confirmed < oldest]
        self._scans = [scan for scan in self._scans if scan[0] >= oldest]
        if len(new):
            self._scans.append((stamp, TrackArrays.of(new)))
        return _ids(ended)

    def current(self, stamp: float) -> TrackArrays:
        """Every track held, carried to `stamp` (s) at constant velocity."""
        return TrackArrays.of([]).joined(*(tracks for _, tracks in self._scans)).predicted(stamp)

    def clear(self) -> list[int]:
        """End every track; returns their ids."""
        ended = _ids([tracks for _, tracks in self._scans])
        self._scans = []
        return ended


def _ids(parts: list[TrackArrays]) -> list[int]:
    return [track_id for tracks in parts for track_id in tracks.track_id.tolist()]
