"""The GOSPA metric: errors of position, missed targets and false tracks in one number."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from tsepm_ros.numerics.arrays import FloatArray

POWER = 2.0
"""p of the metric; its alpha is 2, which makes the parts below well defined."""


@dataclass(frozen=True)
class Gospa:
    """The parts of the metric's p-th power, m^2 for p = 2; their sum is that power.

    Attributes
    ----------
    localisation : float
        Part of the targets with an assigned track.
    missed, false : float
        Parts of the targets without a track and of the tracks without a target.
    """

    localisation: float
    missed: float
    false: float

    @property
    def distance(self) -> float:
        """The metric, m."""
        return float((self.localisation + self.missed + self.false) ** (1.0 / POWER))


def gospa(tracks: FloatArray, targets: FloatArray, cutoff: float) -> Gospa:
    """Generalised optimal sub-pattern assignment metric with alpha = 2.

    Over all assignments theta of some tracks to as many targets (Rahmathullah, Garcia-Fernandez,
    Svensson, "Generalized optimal sub-pattern assignment metric", FUSION 2017, Proposition 1)::

        d^p = min_theta [ sum_(i,j) in theta |x_i - y_j|^p + c^p / 2 (n + m - 2 |theta|) ]

    Parameters
    ----------
    tracks : (n, 2) ndarray
        Positions, m.
    targets : (m, 2) ndarray
        True positions, m.
    cutoff : float
        c, m: a track farther from a target than this is not assigned to it.

    Returns
    -------
    Gospa
    """
    offset = tracks[:, None, :] - targets[None, :, :]
    # A pair at the cutoff costs as much as an unassigned track and an unassigned target.
    cost = np.minimum(np.hypot(offset[..., 0], offset[..., 1]), cutoff) ** POWER
    pairs = linear_sum_assignment(cost)
    assigned = cost[pairs][cost[pairs] < cutoff**POWER]
    unassigned_cost = 0.5 * cutoff**POWER
    return Gospa(
        localisation=math.fsum(assigned),
        missed=unassigned_cost * (len(targets) - len(assigned)),
        false=unassigned_cost * (len(tracks) - len(assigned)),
    )
