"""First estimate of a design: from the plan of the threshold, without a simulated scene."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from tsepm_ros.design import search
from tsepm_ros.design.design_case import Case
from tsepm_ros.methods.score.score_options import ScoreOptions


@dataclass(frozen=True)
class FirstEstimate:
    """Threshold of `score` and P_D, of targets without clutter about them.

    Attributes
    ----------
    window : int
        Window of `score`, scans.
    threshold : float
        Log-likelihood ratio.
    detection : float
        P_D within the case's scans.
    scans : int or None
        Scans within which half of the targets are found; None if fewer are found in time.
    """

    window: int
    threshold: float
    detection: float
    scans: int | None


def first_estimate(case: Case, options: ScoreOptions, *, given_window: bool) -> FirstEstimate:
    """The estimate of a case, at the design's window unless the given window is kept."""
    if not given_window:
        options = dataclasses.replace(options, window=search.score_window(case, options))
    [(threshold, passed)] = search.passages(case, options, [options.window])
    within = passed[: case.scans]
    half = int(np.argmax(within >= 0.5)) + 1 if within[-1] >= 0.5 else None
    return FirstEstimate(options.window, threshold, float(within[-1]), half)
