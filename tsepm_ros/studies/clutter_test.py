"""Track splitting with Kennedy's test for clutter: the reference of TSEPM 2018, Section 5.

Kennedy H. L., "Clutter-based test statistics for automatic track initiation", Acta Automatica
Sinica 34(3), 266-273, 2008, as TSEPM 2018 describes it: "a tentative track is confirmed when the
track-is-on-clutter hypothesis is rejected".

The tree of splits, the M/N rule and the least-squares fit are those of `tsepm`. With lambda the
clutter density and d_k the distance of a hit from the one before, the statistic (Eqs. 24 and 25) ::

    f_2 = 2 lambda sum_k pi d_k^2

(with `clutter_density` "estimated" lambda_k, the density at each hit, in place of one lambda) is
chi-square distributed with 2 M - 2 degrees of freedom for nearest points of pure clutter, and
small for a target: tracks at or below the quantile of the test's size are published. There is no
merging.

Readings
--------
- Small values indicate a target (Sections 3.4 and 3.5 contradict each other).
- V(k) is the area out to the associated point, not the gate's.
- Where a limit cuts confirmations, those of smaller f_2 are kept.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import ClassVar

from tsepm_ros.methods.tsepm import Candidates, Tsepm
from tsepm_ros.parameters import parameter
from tsepm_ros.tracker.options import MnOptions
from tsepm_ros.tracker.path_fit import ESTIMATORS
from tsepm_ros.tracker.tracks import TrackArrays


@dataclass(frozen=True, kw_only=True)
class ClutterTestOptions(MnOptions):
    """Options of the clutter test."""

    evaluation: ClassVar[str] = "clutter_statistic"

    gate_probability: float = parameter(
        0.9,
        "Probability P that a detected target falls into the gate (Eq. 5)",
        positive=True,
        maximum=0.999999,
    )
    clutter_test_size: float = parameter(
        0.05,
        "Nominal fraction of clutter tracks that pass the test",
        positive=True,
        maximum=0.999999,
    )
    estimator: str = parameter("unweighted", "Fit of a track, as with tsepm", choices=ESTIMATORS)


class ClutterTest(Tsepm):
    """Track splitting with Kennedy's test for clutter, without merging."""

    Options = ClutterTestOptions  # type: ignore[assignment]
    options: ClutterTestOptions  # type: ignore[assignment]
    operating_points = MappingProxyType(
        {
            f"size {size:g}": {"clutter_test_size": size}
            for size in (0.001, 0.003, 0.01, 0.03, 0.05, 0.1, 0.2)
        }
    )

    def merge(self, candidates: Candidates) -> tuple[TrackArrays, int]:
        """Every candidate is a track of its own."""
        return self.tracks(candidates), 0
