"""Options of the likelihood-ratio method."""

from __future__ import annotations

import math
from dataclasses import dataclass

from tsepm_ros.parameters import check_group, parameter
from tsepm_ros.tracker.path_fit import ESTIMATORS

MIN_HITS = 3
"""Hits of a confirmed track, at least: two hits cannot check the velocity."""


@dataclass(frozen=True, kw_only=True)
class ScoreOptions:
    """Options of the likelihood-ratio method.

    Raises
    ------
    ValueError
        Naming the option whose value is not allowed.
    """

    false_tracks_per_hour: float = parameter(
        1.0,
        "Target false-track rate, per hour over the whole coverage; sets the threshold",
        minimum=1e-30,
        maximum=1e6,
    )
    miss_probability: float = parameter(
        0.02,
        "Probability that the correct hypothesis of a target is deleted; sets the "
        "deletion threshold",
        positive=True,
        maximum=0.5,
    )
    window: int = parameter(
        16, "Scans after which an unconfirmed hypothesis ends", minimum=3, maximum=64
    )
    gate_probability: float = parameter(
        0.99,
        "Probability that a detected target falls into the gate",
        positive=True,
        maximum=0.999999,
    )
    process_noise: float = parameter(
        0.001,
        "Spectral density of a target's acceleration: the variance of each velocity component "
        "grows by this per second",
        unit="m^2/s^3",
        minimum=0.0,
        maximum=100.0,
    )
    estimator: str = parameter(
        "weighted",
        "Fit of a confirmed track. weighted: weighted least squares on positions; polar: "
        "maximum likelihood of ranges and azimuths, slower, and equal within 2 % for "
        "azimuth errors up to 3 degrees",
        choices=ESTIMATORS[1:],
    )
    max_per_detection: int = parameter(
        100,
        "Maximum number of hypotheses with the same last detection; the best are kept",
        minimum=1,
    )

    def __post_init__(self) -> None:
        check_group(self)

    @property
    def deletion_threshold(self) -> float:
        """Log-likelihood ratio below which a hypothesis is deleted: ln of the miss probability."""
        return math.log(self.miss_probability)
