"""The modified Hough transform: lines through hits that follow each other in time.

Lo, Leung, Bridgewater, Litva, "Multitarget track initiation using a modified Hough transform",
AGARD CP-539, 1994, and Leung, Hu, Blanchette, "Evaluation of multiple target track initiation
techniques in real radar tracking environments", IEE Proc. RSN 143(4), 1996: the references of
Sequential 2014, which names the method without printing it.

A detection at (x, y) is the curve ``rho(theta) = x cos(theta) + y sin(theta)``. The curves of two
detections cross where their difference passes through zero, at the theta of the line through
both, and the difference's slope there is in size their distance and in sign the direction from
the one to the other. Detections of consecutive scans are a track if

- zero crossings that follow each other lie within an angle sigma_theta: one line,
- the slopes have one sign: in the order of the scans,
- the slopes lie within the limits of the speed: ``v_min T <= |slope| <= v_max T``.

By the first two, the directions of two displacements, over the full circle, differ by sigma_theta
at most, and this is how it is computed here: no accumulator, and so no cells, are needed, since
displacements that follow each other share a point and a common theta makes rho common.

Readings
--------
- T is the time between the detections, M of N scans are enough, and a track with a detection that
  satisfies the rules keeps no branch without it.
- Every detection that satisfies them makes a potential track; every detection may be a first one.
- `gate_sigmas` widens the limit of the speed by the last hit's error; 0 as in the literature.
- Of confirmed tracks that share a detection the best fit (f_1 of TSEPM 2018, Eq. 23) is published.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.initiation.mn_options import MnOptions, hits_option, window_option
from tsepm_ros.initiation.path_following import PathFollower
from tsepm_ros.parameters import parameter
from tsepm_ros.stages.association import Pairs


@dataclass(frozen=True, kw_only=True)
class ModifiedHoughOptions(MnOptions):
    """Options of the modified Hough transform."""

    min_hits: int = hits_option(4, minimum=3)
    window: int = window_option(5, minimum=3)
    max_turn: float = parameter(
        0.5,
        "Maximum angle between consecutive zero crossings (sigma_theta)",
        unit="rad",
        positive=True,
        maximum=math.pi / 2,
    )
    min_step_speed: float = parameter(
        0.0, "Minimum speed of a step (v_min)", unit="m/s", minimum=0.0, maximum=1e4
    )
    gate_sigmas: float = parameter(
        0.0,
        "Margin of the speed limit for errors, in standard deviations of the last hit",
        minimum=0.0,
        maximum=100.0,
    )


class ModifiedHough(PathFollower):
    """The modified Hough transform: one line, in the order of the scans, at a possible speed."""

    Options = ModifiedHoughOptions
    options: ModifiedHoughOptions
    operating_points = MappingProxyType(
        {
            f"{hits}/{scans}, {turn:g} rad, {sigmas:g} sigma": {
                "min_hits": hits,
                "window": scans,
                "max_turn": turn,
                "gate_sigmas": sigmas,
            }
            for hits, scans, turn, sigmas in (
                (4, 5, 0.5, 0.0),
                (3, 4, 0.5, 0.0),
                (4, 5, 0.5, 2.0),
                (4, 5, 1.0, 2.0),
                (3, 4, 0.5, 2.0),
                (3, 4, 1.0, 2.0),
            )
        }
    )
    every_detection_starts = True

    def pairs(self, detections: NDArray[np.void]) -> tuple[Pairs, int]:
        """The detections that satisfy the rules after each track's last hits, by the turn."""
        options = self.options
        parent, row, displacements, first, cut = self.displacements(detections, options.gate_sigmas)
        kept = displacements.faster_than(options.min_step_speed)
        turn = np.where(first, 0.0, displacements.turn)
        kept &= turn <= options.max_turn
        return Pairs(parent[kept], row[kept], turn[kept]), cut

    def choose(self, pairs: Pairs) -> Pairs:
        """All pairs: each detection that satisfies the rules makes a potential track."""
        return pairs
