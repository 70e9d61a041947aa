"""All tracks that a method starts in the scans of a scene, as arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np

from tsepm_ros.analysis.simulated_run import SimulatedScene
from tsepm_ros.analysis.truth import Judged, Outcome
from tsepm_ros.initiation.initiator import Initiator
from tsepm_ros.kinematics.track import TrackArrays
from tsepm_ros.numerics.arrays import IntArray
from tsepm_ros.simulation import CLUTTER

AS_GIVEN: Mapping[str, Any] = MappingProxyType(
    {
        "clutter_density": "given",
        "detection_probability": "given",
        "plots": "off",
        "limit_speed": False,
    }
)
"""Options with which the published methods are reproduced: nothing is learned."""


@dataclass(frozen=True)
class Started:
    """Tracks started in a scene, with equal numbers of hits.

    Attributes
    ----------
    scene : SimulatedScene
    tracks : TrackArrays
    """

    scene: SimulatedScene
    tracks: TrackArrays

    @classmethod
    def on(cls, scene: SimulatedScene, initiator: Initiator, scans: int) -> Started:
        """The tracks that a method starts in the first scans."""
        parts = [initiator.process(scan) for scan in scene.scans[:scans]]
        return cls(scene, TrackArrays.of([]).joined(*map(TrackArrays.of, parts)))

    @property
    def hits(self) -> IntArray:
        """(scan, detection) of each track's hits, (n, m, 2)."""
        count = int(self.tracks.hit_count.max(initial=0))
        return np.array(self.tracks.hits, np.int64).reshape(len(self.tracks), count, 2)

    def origins(self) -> IntArray:
        """Target of each track's hits, (n, m)."""
        offsets = np.cumsum([0, *map(len, self.scene.origins)])
        hits = self.hits
        origin = np.concatenate([*self.scene.origins, np.zeros(0, np.int64)])
        return origin[offsets[hits[..., 0]] + hits[..., 1]]

    def from_targets(self) -> IntArray:
        """Rows of the tracks that have more than half of their hits from one target."""
        origins = self.origins()
        same = (origins[:, :, None] == origins[:, None, :]).sum(axis=2)
        max_hits = np.where(origins == CLUTTER, 0, same).max(axis=1, initial=0)
        return np.flatnonzero(2 * max_hits > origins.shape[1])

    def judged(self) -> list[Judged]:
        """Judgements of the tracks from targets; all other tracks are false."""
        return self.scene.judge([self.tracks[int(row)] for row in self.from_targets()])

    def counts(self) -> tuple[int, int]:
        """Targets found, and false and misplaced tracks."""
        outcomes = [judgement.outcome for judgement in self.judged()]
        wrong = len(self.tracks) - len(outcomes) + outcomes.count(Outcome.MISPLACED)
        return outcomes.count(Outcome.TRUE), wrong
