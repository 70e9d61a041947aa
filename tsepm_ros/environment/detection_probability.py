"""Detection probability, estimated from the tracks held.

Whether a target was there in a scan in which it was not detected is known once it is detected
again. So the scans from one detection of a held target to its next are counted, and that is one
detection in so many: targets that are gone do not count as missed, however long they are held.
"""

from __future__ import annotations

import math

from tsepm_ros.numerics.arrays import FloatArray

DATA_SHEET_SCANS = 5.0
"""Scans of a target that the data sheet's figure counts for."""
MEMORY = 200.0
"""Scans of a target that count: older ones fade."""
MIN_PROBABILITY, MAX_PROBABILITY = 0.05, 0.999
"""A detection as a miss must stay possible."""


class DetectionProbability:
    """Estimates P_D from D detections in C scans of targets that were covered, both fading.

    ``P_D = (w p_0 + D / P_G) / (w + C)`` with the data sheet's p_0, worth w scans, and the
    probability P_G that a detection falls into the gate: the mean of a beta distribution.
    """

    def __init__(self) -> None:
        self._detected = 0.0
        self._covered = 0.0

    def update(self, detected: FloatArray, scans: FloatArray, gate_probability: float) -> None:
        """Take what a scan says of the tracks that it covers.

        Parameters
        ----------
        detected : (n,) ndarray
            Probability that each track's target exists and was detected.
        scans : (n,) ndarray
            Scans that covered the target since it was detected before, this one included.
        gate_probability : float
            P_G.
        """
        covered = float(detected @ scans)
        keep = math.exp(-covered / MEMORY)
        self._detected = keep * self._detected + float(detected.sum()) / gate_probability
        self._covered = keep * self._covered + covered

    def estimate(self, given: float) -> float:
        """The estimate of P_D, for a data sheet that gives p_0."""
        worth = DATA_SHEET_SCANS
        found = (worth * given + self._detected) / (worth + self._covered)
        return min(max(found, MIN_PROBABILITY), MAX_PROBABILITY)
