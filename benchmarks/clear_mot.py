"""CLEAR-MOT of states and tracks."""

from __future__ import annotations

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.tools.evaluation import tracking_metrics
from tsepm_ros.tracker.tracks import TrackArrays

Truth = dict[int, FloatArray]
"""State (4,) of each target at a scan; nan where it is not there."""


class ClearMot(tracking_metrics.ClearMot):
    """Identity switches, from states."""

    def take_states(self, truth: Truth, tracks: TrackArrays) -> None:
        """Take a scan."""
        places = zip(tracks.track_id.tolist(), tracks.state[:, 0::2], strict=True)
        self.take({target: state[0::2] for target, state in truth.items()}, dict(places))

    def held(self) -> tuple[int, int]:
        """Scans with a track of its own, and all, of each target from its first track on."""
        found = [0, 0]
        for tracks in self.matches.values():
            first = next((k for k, track in enumerate(tracks) if track is not None), len(tracks))
            found[0] += sum(track is not None for track in tracks[first:])
            found[1] += len(tracks) - first
        return found[0], found[1]
