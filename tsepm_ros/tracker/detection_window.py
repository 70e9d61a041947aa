"""The detections to which current potential tracks may refer."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.numerics.arrays import taken
from tsepm_ros.tracker.measurement import DETECTION

_BLOCK = np.dtype((np.void, DETECTION.itemsize))


class DetectionWindow:
    """Detections of the recent scans, addressed by ids that never change.

    Ids count from 0 in order of arrival. Removing old scans leaves the other ids unchanged:
    hypotheses refer to detections by integers, and the window bounds the memory.

    Attributes
    ----------
    first_id : int
        Id of the oldest detection that is not forgotten.
    """

    def __init__(self) -> None:
        self._detections = np.zeros(0, DETECTION)
        self._not_held = np.zeros(0)
        self.first_id = 0

    def append(self, detections: NDArray[np.void]) -> NDArray[np.int64]:
        """Add a scan's detections, (n,) of DETECTION, and return their ids, (n,)."""
        first = self.first_id + len(self._detections)
        # As blocks of bytes, which is many times faster than field by field.
        parts = [part.view(_BLOCK) for part in (self._detections, detections)]
        self._detections = np.concatenate(parts).view(DETECTION)
        self._not_held = np.concatenate([self._not_held, np.ones(len(detections))])
        return np.arange(first, first + len(detections))

    def forget(self, before_scan: int) -> None:
        """Remove the detections of the scans before the given scan index."""
        old = int(np.searchsorted(self._detections["scan"], before_scan))
        self._detections = self._detections[old:]
        self._not_held = self._not_held[old:]
        self.first_id += old

    def __getitem__(self, ids: NDArray[np.int64]) -> NDArray[np.void]:
        """Detections with the given ids, in the ids' shape."""
        return taken(self._detections, ids - self.first_id)

    def note_held(self, ids: NDArray[np.int64], probability: NDArray[np.float64]) -> None:
        """Note the probabilities that detections belong to confirmed tracks, (n,) each."""
        np.multiply.at(self._not_held, ids - self.first_id, 1.0 - np.minimum(probability, 1.0))

    def held_probability(self, ids: NDArray[np.int64]) -> NDArray[np.float64]:
        """Probability that the detections with the given ids belong to a confirmed track, (...).

        The probabilities of different tracks count as independent.
        """
        probability: NDArray[np.float64] = 1.0 - self._not_held[ids - self.first_id]
        return probability

    def find(self, hits: Sequence[tuple[int, int]]) -> NDArray[np.int64]:
        """Ids of the detections with the given scan and detection indices, those still here.

        Parameters
        ----------
        hits : sequence of (int, int)
            As in `ConfirmedTrack.hits`, oldest first.

        Returns
        -------
        (h,) ndarray of int
            In the order of the hits; hits that are forgotten are left out.
        """
        ids: list[int] = []
        if not hits or not len(self) or hits[-1][0] < self._detections["scan"][0]:
            return np.array(ids, np.int64)
        scans = np.ascontiguousarray(self._detections["scan"])
        for scan, index in hits:
            first, last = np.searchsorted(scans, [scan, scan + 1])
            row = first + np.flatnonzero(self._detections["index"][first:last] == index)
            ids += (self.first_id + row).tolist()
        return np.array(ids, np.int64)

    def positions(self, ids: NDArray[np.int64]) -> NDArray[np.float64]:
        """Positions of the detections with the given ids, (..., 2), m."""
        positions: NDArray[np.float64] = self._detections["position"][ids - self.first_id]
        return positions

    def clutter_densities(self, ids: NDArray[np.int64]) -> NDArray[np.float64]:
        """Clutter densities at the detections with the given ids, (...), 1/m^2."""
        densities: NDArray[np.float64] = self._detections["clutter_density"][ids - self.first_id]
        return densities

    def __len__(self) -> int:
        """Number of detections in the window."""
        return len(self._detections)
