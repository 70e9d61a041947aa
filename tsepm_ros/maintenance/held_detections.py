"""Detections of a scan that are, or may be, held tracks'."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray, IntArray


class HeldAssociation(NamedTuple):
    """Detections of a scan that may be held tracks'.

    Attributes
    ----------
    row : (p,) ndarray of int
        Detection of each pair.
    probability : (p,) ndarray
        That the track's target exists and the detection is its: ``r_i beta_ij``.
    """

    row: IntArray
    probability: FloatArray

    def joined(self, further: FloatArray, clutter: FloatArray) -> HeldAssociation:
        """With detections that tracks may have beside their own.

        Parameters
        ----------
        further, clutter : (d,) ndarray
            Density of these, and of clutter, at each detection, 1/m^2.
        """
        rows = np.flatnonzero(further)
        share = further[rows] / (further[rows] + clutter[rows])
        return HeldAssociation(np.append(self.row, rows), np.append(self.probability, share))


class OwnDetections(NamedTuple):
    """Detections of a scan that are held tracks', with more than some probability.

    Attributes
    ----------
    track_id, row : (k,) ndarray of int
        Id of the track, and detection.
    """

    track_id: IntArray
    row: IntArray


NO_OWN_DETECTIONS = OwnDetections(np.zeros(0, np.int64), np.zeros(0, np.int64))
NO_ASSOCIATION = HeldAssociation(np.zeros(0, np.int64), np.zeros(0))
