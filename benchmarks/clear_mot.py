"""Identity switches by CLEAR-MOT."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import linear_sum_assignment

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.tracker.tracks import TrackArrays

Truth = dict[int, FloatArray]
"""State (4,) of each target at a scan; nan where it is not there."""


@dataclass
class ClearMot:
    """Identity switches: a target keeps its track while that is within the gate (m).

    Bernardin and Stiefelhagen, "Evaluating multiple object tracking performance: the CLEAR MOT
    metrics", EURASIP Journal on Image and Video Processing 2008. The others are assigned one to
    one, with the least sum of distances.

    Attributes
    ----------
    gate : float
    last, now : dict of int to int
        Track of each target, the last one, and in the last scan.
    matches : dict of int to list
        Track of each target scan by scan.
    switches : int
    """

    gate: float
    last: dict[int, int] = field(default_factory=dict)
    now: dict[int, int] = field(default_factory=dict)
    matches: dict[int, list[int | None]] = field(default_factory=dict)
    switches: int = 0

    def take(self, truth: Truth, tracks: TrackArrays) -> None:
        """Take a scan."""
        ids = tracks.track_id.tolist()
        places = tracks.state[:, 0::2]
        near = {target: np.hypot(*(places - state[0::2]).T) for target, state in truth.items()}
        matched: dict[int, int] = {}
        for target in sorted(near, key=lambda target: target not in self.now):
            track = self.last.get(target)
            if track is None or track not in ids or track in matched.values():
                continue
            if near[target][ids.index(track)] <= self.gate:
                matched[target] = track
        targets = [target for target in near if target not in matched]
        free = [row for row, track in enumerate(ids) if track not in matched.values()]
        if targets and free:
            cost = np.array([near[target][free] for target in targets])
            cost = np.where(cost <= self.gate, cost, 1e9)
            for one, other in zip(*linear_sum_assignment(cost), strict=True):
                if cost[one, other] <= self.gate:
                    matched[targets[one]] = ids[free[other]]
        for target in near:
            track, before = matched.get(target), self.last.get(target)
            self.switches += None not in (track, before) and track != before
            self.matches.setdefault(target, []).append(track)
        self.last |= matched
        self.now = matched

    def held(self) -> tuple[int, int]:
        """Scans with a track of its own, and all, of each target from its first track on."""
        found = [0, 0]
        for tracks in self.matches.values():
            first = next((k for k, track in enumerate(tracks) if track is not None), len(tracks))
            found[0] += sum(track is not None for track in tracks[first:])
            found[1] += len(tracks) - first
        return found[0], found[1]
