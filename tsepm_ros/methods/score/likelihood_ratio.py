"""Evidence for a target against clutter: log-likelihood ratios.

Each hypothesis assigns certain detections, at most one a scan, to a target. Its score is the
log-likelihood ratio of this assignment against clutter only (Sittler 1964; Bar-Shalom, Blackman,
Fitzgerald, "Dimensionless score function for multiple hypothesis tracking", IEEE Trans. Aerosp.
Electron. Syst. 43(1), 2007). In clutter alone, the mean of the ratio over all hypotheses of a start
is a martingale of mean 1: the probability that it ever reaches A is at most 1 / A (Ville 1939, Wald
1945). This bound does not hold for the best hypothesis alone.
"""

from __future__ import annotations

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.sensing.sensor import MIN_CLUTTER_DENSITY

MAX_DETECTION_PROBABILITY = 0.999
"""A miss must stay possible: targets fade, also where P_D is given as 1."""


def hit_increment(
    log_density: FloatArray, detection_probability: float | FloatArray, clutter: FloatArray
) -> FloatArray:
    """Score increment of a hit: ``ln(P_D N(z; H x, S) / lambda)``.

    Parameters
    ----------
    log_density : (n,) ndarray
        ln N, the density of the detection under the hypothesis, in the coordinates of the clutter
        density.
    detection_probability : float or (n,) ndarray
        P_D where the hypothesis expects its target; where it is 0, the increment is -inf.
    clutter : (n,) ndarray
        lambda at the detection: the density of its other possible causes, 1/m^2.

    Returns
    -------
    (n,) ndarray
    """
    probability = np.minimum(detection_probability, MAX_DETECTION_PROBABILITY)
    with np.errstate(divide="ignore"):
        ratio = np.log(probability / np.maximum(clutter, MIN_CLUTTER_DENSITY))
    increment: FloatArray = log_density + ratio
    return increment


def miss_increment(detection_probability: FloatArray, gate_probability: float) -> FloatArray:
    """Score increment, below 0, of a miss: ``ln(1 - P_D P_G)``; 0 where nothing can be detected.

    Parameters
    ----------
    detection_probability : (n,) ndarray
        P_D.
    gate_probability : float
        P_G: a detection outside the gate is missed too.

    Returns
    -------
    (n,) ndarray
    """
    increment: FloatArray = np.log1p(
        -np.minimum(detection_probability, MAX_DETECTION_PROBABILITY) * gate_probability
    )
    return increment
