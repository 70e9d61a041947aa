"""Two methods at equal footing, and two shares of targets: what differs, and whether it is certain.

Used by `promises.py`.
"""

from __future__ import annotations

import math

from tsepm_ros.analysis.intervals import Estimate
from tsepm_ros.analysis.operating_curve import Comparison
from tsepm_ros.analysis.performance import Evaluated

HOLDS, DOES_NOT, OPEN = "holds", "does not", "cannot tell"
CLOSE = 0.03
"""How near the P_D of `tsepm design` should be to what is measured."""
RANGE_ERROR, AZIMUTH_ERROR = 0.015, math.radians(1.0)


def errors(factor: float) -> dict[str, float]:
    """The box's errors, so many times."""
    return {
        "range_std_fraction": factor * RANGE_ERROR,
        "azimuth_std": factor * AZIMUTH_ERROR,
    }


CHANGED: dict[str, dict[str, float]] = {
    "density 1e-7": {"clutter_density": 1e-7},
    "density 3e-7": {"clutter_density": 3e-7},
    "density 2e-6": {"clutter_density": 2e-6},
    "p_d 0.6": {"detection_probability": 0.6},
    "p_d 0.8": {"detection_probability": 0.8},
    "p_d 1.0": {"detection_probability": 1.0},
    "errors a third": errors(1.0 / 3.0),
    "errors twice": errors(2.0),
    "1e-7, 1.0, a third": {
        "clutter_density": 1e-7,
        "detection_probability": 1.0,
        **errors(1.0 / 3.0),
    },
    "2e-6, 0.6, twice": {
        "clutter_density": 2e-6,
        "detection_probability": 0.6,
        **errors(2.0),
    },
}
"""What the scenes of `equal-footing` change of the box: there 1e-6, 0.9, 1.5 % and 1 degree."""


def footing(one: Evaluated) -> list[str]:
    """The row of a scene after some pings.

    The sweep of `score` ends somewhere: with more false starts allowed than its last point makes it
    finds *at least* what that finds, and a P_D below that of its first costs *at most* what that
    costs. Above its highest P_D, or below its fewest false starts, it is not compared.
    """
    [row] = [row for row in one.comparisons if row.method == "tsepm" and row.other == "score"]
    pairs = list(zip(one.points, one.figures, strict=True))
    [published] = [figures for point, figures in pairs if point.method == "tsepm"]
    false = [figures.false_per_run.value for point, figures in pairs if point.method == "score"]
    found = [figures.detection.value for point, figures in pairs if point.method == "score"]
    beyond = row.false > max(false)
    below = row.detection < found[false.index(min(false))]
    share, cost = f"{row.other_detection:.2f}", f"{row.other_false:.2f}"
    if math.isnan(row.other_detection.value):
        share = f"not reached: {min(false):.2f} or more"
    if math.isnan(row.other_false.value):
        cost = f"not reached: P_D up to {max(found):.2f}"
    return [
        one.scenario.name,
        str(one.scans),
        f"{published.detection:.2f}",
        f"{published.false_per_run:.2f}",
        f"at least {share}" if beyond else share,
        f"at most {cost}" if below else cost,
        footing_verdict(row, beyond=beyond, below=below),
    ]


def footing_verdict(row: Comparison, *, beyond: bool, below: bool) -> str:
    """Whether `score` is the better: in P_D or in false starts, with 95 %, and worse in neither."""
    better = row.gain.high < 0.0 or row.ratio.high < 1.0
    worse = (row.gain.low > 0.0 and not beyond) or (row.ratio.low > 1.0 and not below)
    if better == worse:
        return OPEN
    return HOLDS if better else DOES_NOT


def difference(one: Estimate, other: Estimate) -> Estimate:
    """Of two independent shares, with Newcombe's interval from theirs (Statist. Med. 17, 1998)."""
    gap = one.value - other.value
    down = math.hypot(one.value - one.low, other.high - other.value)
    up = math.hypot(one.high - one.value, other.value - other.low)
    return Estimate(gap, gap - down, gap + up)


def closeness(gap: Estimate) -> str:
    """Whether a difference of P_D is small: all of its interval, none, or some."""
    if gap.low >= -CLOSE and gap.high <= CLOSE:
        return HOLDS
    return DOES_NOT if gap.low > CLOSE or gap.high < -CLOSE else OPEN
