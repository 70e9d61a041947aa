"""The gates of a scan: paths that share a last hit share its gate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.initiation.path_counts import PathCounts
from tsepm_ros.numerics.arrays import IntArray
from tsepm_ros.stages import splitting
from tsepm_ros.stages.paths import starting


@dataclass(frozen=True)
class Gates:
    """The gates of a scan.

    Attributes
    ----------
    last_hits : (g,) ndarray of int
        Detection id of the hit that each gate surrounds, ascending.
    gated : Gated
        Detections in each gate.
    ids : (d,) ndarray of int
        Ids of the scan's detections.
    """

    last_hits: IntArray
    gated: splitting.Gated
    ids: IntArray

    def of(self, last_hit: IntArray) -> IntArray:
        """Row of the gate that each path uses, (n,)."""
        return np.searchsorted(self.last_hits, last_hit)

    def missed(self, gate_of_path: IntArray) -> NDArray[np.bool_]:
        """Which paths, by their gates (n,), have no detection in them, (n,)."""
        missed: NDArray[np.bool_] = self.gated.count[gate_of_path] == 0
        return missed

    def left_out(self, scan_index: int) -> PathCounts:
        """Detections that the gating limit left out of every gate: they gate as a start would."""
        rows = splitting.left_out(self.gated)
        if not len(rows):
            return PathCounts.none()
        return PathCounts.of_paths(starting(self.ids[rows], scan_index, 1))

    def children(self, paths: PathCounts) -> PathCounts:
        """Paths that extend these by each of their gated detections."""
        return paths.children(self.of(paths.last_hit), self.gated, self.ids)
