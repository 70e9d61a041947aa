"""First estimate of a design: from the plan of the threshold, without a simulated scene."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from tsepm_ros.design import search
from tsepm_ros.design.design_case import Case
from tsepm_ros.methods.score.score_options import ScoreOptions
from tsepm_ros.numerics.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class FirstEstimate:
    """Threshold of `score` and P_D, of targets without clutter about them.

    Attributes
    ----------
    window : int
        Window of `score`, scans.
    threshold : float
        Log-likelihood ratio.
    found : (scans,) ndarray
        P_D by each scan.
    """

    window: int
    threshold: float
    found: FloatArray

    @property
    def detection(self) -> float:
        """P_D within all scans."""
        return float(self.found[-1])

    def scans_until(self, share: float) -> int | None:
        """Scans within which a share of the targets is found; None if it is not."""
        reached = self.found >= share
        return int(np.argmax(reached)) + 1 if reached[-1] else None


def first_estimate(case: Case, options: ScoreOptions, *, given_window: bool) -> FirstEstimate:
    """The estimate of a case, at the design's window unless the given window is kept."""
    if not given_window:
        options = dataclasses.replace(options, window=search.score_window(case, options))
    [(threshold, found)] = search.passages(case, options, [options.window])
    return FirstEstimate(options.window, threshold, found[: case.scans])
