"""Track pruning (TSEPM 2018, Section 3.5): the M/N rule and the evaluation's threshold."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from tsepm_ros.numerics.arrays import BoolArray
from tsepm_ros.numerics.gaussian import gate_factor

READINGS = ("literal", "squared")


def confirmed(hit_count: NDArray[np.int64], min_hits: int) -> BoolArray:
    """Which tracks satisfy the M/N rule: N_v >= M (Step 3).

    N_a <= N holds for every potential track, since `expired` ends it at N_a = N.
    """
    return hit_count >= min_hits


def expired(scan_count: NDArray[np.int64], window: int) -> BoolArray:
    """Which potential tracks the M/N rule ends: N_a >= N (Step 3, pruning rule a).

    A track that can no longer reach M hits still exists, and gates detections, until then.
    """
    return scan_count >= window


def distance_threshold(probability: float, reading: str) -> float:
    """Threshold for `normalized_distance` (Eq. 26).

    ``gamma_TP = sqrt(-2 ln(1 - P_TP))``. Eq. 22 is a squared distance, so the reading ``literal``
    compares it with gamma_TP as printed, ``squared`` with gamma_TP^2.
    """
    gamma = gate_factor(probability)
    return gamma if reading == "literal" else gamma * gamma


def clutter_threshold(size: float, min_hits: int) -> float:
    """Threshold for `clutter_statistic`: the chi-square quantile with 2 M - 2 degrees of freedom.

    `size` is the nominal fraction of clutter tracks that pass. The measured fraction differs: a
    gate truncates the statistic, and split tracks use other points than the nearest.
    """
    return float(chdtri(2 * min_hits - 2, 1.0 - size))


def keep(evaluation: NDArray[np.float64], threshold: float) -> BoolArray:
    """Which evaluations do not exceed the threshold (Step 6, pruning rule b)."""
    return evaluation <= threshold
