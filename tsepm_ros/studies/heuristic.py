"""The heuristic method: limits of speed and acceleration from hit to hit.

As Sequential 2014, Section 3.1 describes it, after Leung, Hu, Blanchette, "Evaluation of multiple
target track initiation techniques in real radar tracking environments", IEE Proc. RSN 143(4), 1996.

Positions r_i of consecutive scans are a track if they satisfy (Eq. 2)::

    v_min T <= |r_i - r_(i-1)| <= v_max T
    |(r_(i+1) - r_i) - (r_i - r_(i-1))| <= a_max T^2

and, optionally, if the angle between two steps is at most phi (Eqs. 3 and 4). "If there is
more than one return, the one with the minimum acceleration is used to form the new track."

Readings
--------
- T is the time between the detections. Velocities are over each step's own time, the acceleration
  is their difference over the time between the steps' middles: Eq. 2 where the times are equal.
- Any M of N scans: every detection of every scan may be a track's first. A track with a detection
  that satisfies the rules keeps no branch without it; one without waits, with the longer time in
  the limits. With M = N = 3, the default, the rules hold over three scans in a row.
- As printed the rules leave no room for errors, which is why the article finds that they do not
  suit a sonar: `gate_sigmas` widens the limit of the speed by the last hit's error, 0 as printed.
- Of confirmed tracks that share a detection the one with the smallest of the largest accelerations
  is published.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.parameters import parameter
from tsepm_ros.studies.path_following import Displacements, PathFollower
from tsepm_ros.tracker.association import Pairs
from tsepm_ros.tracker.options import MnOptions, hits_option, window_option
from tsepm_ros.tracker.path_fit import Fit


@dataclass(frozen=True, kw_only=True)
class HeuristicOptions(MnOptions):
    """Options of the heuristic method."""

    min_hits: int = hits_option(3, minimum=3)
    window: int = window_option(3, minimum=3)
    min_step_speed: float = parameter(
        0.0, "Minimum speed of a step (v_min)", unit="m/s", minimum=0.0, maximum=1e4
    )
    max_acceleration: float = parameter(
        1.0, "Maximum acceleration (a_max)", unit="m/s^2", positive=True, maximum=1e4
    )
    max_turn: float = parameter(
        math.pi,
        "Maximum angle between two steps (phi); pi: no limit",
        unit="rad",
        positive=True,
        maximum=math.pi,
    )
    gate_sigmas: float = parameter(
        0.0,
        "Margin of the speed limit for errors, in standard deviations of the last hit",
        minimum=0.0,
        maximum=100.0,
    )


class Heuristic(PathFollower):
    """The heuristic method: limits of speed and acceleration over consecutive scans."""

    Options = HeuristicOptions
    options: HeuristicOptions
    operating_points = MappingProxyType(
        {
            f"{hits}/{scans}, {limit:g} m/s^2, {sigmas:g} sigma": {
                "min_hits": hits,
                "window": scans,
                "max_acceleration": limit,
                "gate_sigmas": sigmas,
            }
            for hits, scans, limit, sigmas in (
                (5, 5, 1.0, 0.0),
                (4, 4, 1.0, 0.0),
                (3, 3, 0.3, 0.0),
                (3, 3, 1.0, 0.0),
                (6, 8, 2.0, 2.0),
                (4, 5, 2.0, 2.0),
                (3, 3, 2.0, 2.0),
            )
        }
    )
    every_detection_starts = True

    def pairs(self, detections: NDArray[np.void]) -> tuple[Pairs, int]:
        """The detections that satisfy the rules after each track's last hits, by acceleration."""
        options = self.options
        parent, row, displacements, first, cut = self.displacements(detections, options.gate_sigmas)
        acceleration = np.where(first, 0.0, displacements.acceleration)
        kept = displacements.faster_than(options.min_step_speed)
        kept &= first | (acceleration <= options.max_acceleration)
        kept &= first | (displacements.turn <= options.max_turn)
        return Pairs(parent[kept], row[kept], acceleration[kept]), cut

    def evaluate(self, hits: NDArray[np.void], fitted: Fit) -> FloatArray:
        """Largest acceleration of each track, (n,), m/s^2; 0 of two hits."""
        n, count = hits.shape
        largest = np.zeros(n)
        for last in range(2, count):
            three = hits[:, last - 2 : last + 1]
            displacements = Displacements.of(three["position"], three["time"])
            largest = np.maximum(largest, displacements.acceleration)
        return largest
