"""Detection probability, estimated from the held tracks.

A missed target was present if it is detected again. Therefore the scans from each detection of a
held target to its next detection count as one detection in their number: a target that has left is
not counted as missed, however long its track is held. A track counts as far as the scans after its
start prove that its target exists: the detections of false tracks are not those of targets.
"""

from __future__ import annotations

import math

from tsepm_ros.numerics.arrays import FloatArray

DATA_SHEET_SCANS = 5.0
"""Weight of the data sheet's probability, as a number of scans of a target."""
DETECTION_MEMORY = 200.0
"""Time constant, in scans of a target, with which older scans fade."""
MIN_PROBABILITY, MAX_PROBABILITY = 0.05, 0.999
"""Bounds of the estimate: both a detection and a miss stay possible."""

MAX_GAP = 100.0
"""Scans from a detection to the next one that outlive a restart, on average at most."""


class DetectionProbability:
    """Estimates P_D from D detections in C scans of covered targets, both fading.

    ``P_D = (w p_0 + D / P_G) / (w + C)`` with the data sheet's p_0 worth w scans, and the
    probability P_G that a detection falls into the gate: the mean of a beta distribution.
    """

    def __init__(self) -> None:
        self._detected = 0.0
        self._covered = 0.0

    def update(self, detected: FloatArray, scans: FloatArray, gate_probability: float) -> None:
        """Update the estimate with the tracks covered by a scan.

        Parameters
        ----------
        detected : (n,) ndarray
            Probability that each track's target exists, by the scans since its start alone, and was
            detected.
        scans : (n,) ndarray
            Scans that covered the target since its previous detection, the present scan included.
        gate_probability : float
            P_G.
        """
        covered = float(detected @ scans)
        keep = math.exp(-covered / DETECTION_MEMORY)
        self._detected = keep * self._detected + float(detected.sum()) / gate_probability
        self._covered = keep * self._covered + covered

    @property
    def memory(self) -> tuple[float, float]:
        """D / P_G and C, both fading; C as of gaps of at most `MAX_GAP`."""
        return self._detected, min(self._covered, MAX_GAP * self._detected)

    def remember(self, detected: float, covered: float) -> None:
        """Begin with the memory of another estimate."""
        self._detected, self._covered = detected, covered

    def estimate(self, given: float) -> float:
        """The estimate of P_D, with `given` as the data sheet's."""
        weight = DATA_SHEET_SCANS
        estimate = (weight * given + self._detected) / (weight + self._covered)
        return min(max(estimate, MIN_PROBABILITY), MAX_PROBABILITY)
