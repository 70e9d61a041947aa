"""The tree of hypotheses after a scan, before it is pruned."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from tsepm_ros.methods.score.hypotheses import Hypotheses
from tsepm_ros.numerics import grouped
from tsepm_ros.numerics.arrays import FloatArray, IntArray

PRIOR_TARGET_ODDS = 0.001
"""Prior odds, for the clutter map, that a detection is of a target that began in a given scan."""


@dataclass(frozen=True)
class Grown:
    """The tree after a scan, not yet pruned.

    Attributes
    ----------
    ended : Hypotheses
        Those that end in a detection of the scan.
    missed : Hypotheses
        Those that leave the scan out.
    ids : (d,) ndarray of int
        Ids of the scan's detections, ascending.
    """

    ended: Hypotheses
    missed: Hypotheses
    ids: IntArray

    @cached_property
    def newest(self) -> IntArray:
        """Place in the scan of the last hit of each of `ended`, (n,)."""
        return self.ended.last_hit - (self.ids[0] if len(self.ids) else 0)

    @cached_property
    def evidence(self) -> FloatArray:
        """``ln sum_i exp(s_i)`` over the hypotheses that end in each detection, (d,)."""
        return grouped.summed(self.ended.score, self.newest, len(self.ids))

    @property
    def target_probability(self) -> FloatArray:
        """Probability that each detection is that of a target not confirmed yet, (d,)."""
        odds = self.evidence + math.log(PRIOR_TARGET_ODDS)
        probability: FloatArray = np.exp(-np.logaddexp(0.0, -odds))
        return probability

    @property
    def number(self) -> int:
        """Number of hypotheses."""
        return len(self.ended) + len(self.missed)

    def of_each(self, change: Callable[[Hypotheses], Hypotheses]) -> Grown:
        """The tree with both of its parts changed."""
        return replace(self, ended=change(self.ended), missed=change(self.missed))
