"""The improved sequential method: a gate of kinematics and sensor error, M of N (Sequential 2014).

Ji D., Li D., "An improved sequential initiation method for multitarget track in clutter with large
noise measurement", Math. Probl. Eng. 2014, 394297.

A detection continues a potential track whose last hit, k scans ago, it lies near (Eq. 7)::

    |r_(i+k) - r_i| <= v_max k T + 2 sigma

with sigma "the 1 standard error of measurement distance". A detection that was matched is removed,
the others start potential tracks (Steps 3-5); 6 hits within 10 scans are a track, fewer are none
(Section 4.1). The initial state is the least-squares fit (Eq. 11), or one of the two that the
article compares it with (Table 1).

Readings
--------
- k T is the time between the detections. The sensor moves: r is in the fixed frame.
- sigma is the deviation of the range error at the last hit; `gate_error` "major_axis" reads it as
  the larger axis of the position's error, as the papers of 2016 and 2018 do.
- Step 3 does not assign a detection in the gates of several tracks; `matching` has the
  readings. "oldest": the tracks in the order in which Step 5 made them, each with what is nearest
  to it of what is left. Section 4.1 and Figs. 3 and 4 support it: there points outside the gate,
  which start tracks of their own, keep none of the later ones from the track, and "if there are 6
  or more than 6 points which satisfy the threshold, it is considered that a track exists".
  "nearest": the nearest pair of all first, then the nearest of what is left; a track started by an
  echo outside the gate then takes the target's next ones, and the examples depend on where the
  points lie. "shared": each track takes what is nearest to it, and a detection "removed" only
  starts none; the article then starts a target once for each of its tracks, since no displacement
  merges them. Here, as with the other methods, the best of the tracks that share a hit is
  published.
- A track that can no longer reach M hits is deleted when its N scans are over (Section 4.1), not
  as soon as that is known: it matches, and so removes, detections until then.
- A confirmed track no longer matches detections: its target starts anew, as with the other methods.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.initiation import initial_state
from tsepm_ros.initiation.mn_options import MnOptions, hits_option, window_option
from tsepm_ros.initiation.path_following import PathFollower
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.parameters import parameter
from tsepm_ros.sensing.conversion import measured_polar, range_variance_at
from tsepm_ros.stages.association import Pairs, best_of_each, nearest_first, oldest_first
from tsepm_ros.stages.estimation import Fit


@dataclass(frozen=True, kw_only=True)
class SequentialOptions(MnOptions):
    """Options of the improved sequential method; the defaults are the article's."""

    min_hits: int = hits_option(6)
    window: int = window_option(10)
    gate_sigmas: float = parameter(
        2.0,
        "Margin of the gate in standard deviations of the last hit's error (Eq. 7)",
        minimum=0.0,
        maximum=100.0,
    )
    gate_error: str = parameter(
        "range",
        "Error that the margin of the gate refers to: that of the range, or the larger "
        "axis of the position error",
        choices=("range", "major_axis"),
    )
    matching: str = parameter(
        "oldest",
        "Assignment of a detection in the gates of several tracks: to the oldest track, "
        "to the track of the nearest pair (nearest), or to every track (shared)",
        choices=("oldest", "nearest", "shared"),
    )
    estimator: str = parameter(
        "least_squares", "Estimator of the initial state", choices=initial_state.ESTIMATORS
    )
    process_noise: float = parameter(
        0.001,
        "Spectral density of a target's acceleration in the estimator kalman_filter",
        unit="m^2/s^3",
        minimum=0.0,
        maximum=100.0,
    )


class Sequential(PathFollower):
    """The improved sequential method of 2014: 6 of 10, matched detections removed."""

    Options = SequentialOptions
    options: SequentialOptions
    operating_points = MappingProxyType(
        {
            f"{min_hits}/{window}": {"min_hits": min_hits, "window": window}
            for min_hits, window in ((9, 10), (8, 10), (7, 10), (6, 10), (5, 8), (4, 6), (3, 5))
        }
    )

    def pairs(self, detections: NDArray[np.void]) -> tuple[Pairs, int]:
        """The detections in the gate of each potential track, by distance (Eq. 7)."""
        last_hits = self.detections[self.potential.last_hit]
        margin = self.options.gate_sigmas * self._sigma(last_hits)
        parent, row, cut = self.reachable(detections, margin)
        displacement = detections["position"][row] - last_hits["position"][parent]
        return Pairs(parent, row, np.hypot(displacement[:, 0], displacement[:, 1])), cut

    def _sigma(self, hits: NDArray[np.void]) -> FloatArray:
        """Standard deviation of each hit's error, (n,), m."""
        if self.options.gate_error == "major_axis":
            return np.asarray(hits["major_sigma"])
        return np.sqrt(range_variance_at(hits, measured_polar(hits)[0], self.sensor))

    def choose(self, pairs: Pairs) -> Pairs:
        """One detection at most for each track, by the reading of Step 3 that is chosen."""
        if self.options.matching == "shared":
            return best_of_each(pairs)
        if self.options.matching == "oldest":
            return oldest_first(pairs, self.potential.first_scan)
        return nearest_first(pairs)

    def fit(self, hits: NDArray[np.void]) -> Fit:
        """See `HitCounter.fit`."""
        options = self.options
        return initial_state.estimate(
            hits, self.stamp, self.sensor, options.estimator, options.process_noise
        )
