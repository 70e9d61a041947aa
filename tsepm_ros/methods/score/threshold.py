"""The threshold of the evidence that gives the target false-track rate.

Every detection starts a hypothesis. The target false-track rate over the starts per hour is the
share of starts that may be confirmed falsely. `threshold_plan` gives the threshold that at most
this share of the starts from clutter passes::

    share         = false tracks per hour / (detections per scan * 3600 s / scan interval)
    A             = -ln(share) - the mean jump over it
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace
from functools import lru_cache

import numpy as np

from tsepm_ros.initiation.common_options import CommonOptions
from tsepm_ros.initiation.observation import Observation
from tsepm_ros.methods.score import threshold_plan
from tsepm_ros.methods.score.score_options import MIN_HITS, ScoreOptions
from tsepm_ros.sensing import range_rates
from tsepm_ros.sensing.sensor import SensorModel

MAX_SCANS_REMEMBERED = 50
"""Scans over which the mean of the detections is taken."""
SECONDS_PER_HOUR = 3600.0


class Threshold:
    """The threshold, from the scan rate and the number of detections so far."""

    def __init__(self) -> None:
        self._counts: deque[int] = deque(maxlen=MAX_SCANS_REMEMBERED)
        self._last: Observation | None = None

    def observe(self, observed: Observation) -> None:
        """Count a scan's detections."""
        self._counts.append(len(observed.detections))
        self._last = observed

    @property
    def interval(self) -> float:
        """Median interval of the scans, s; 0 while unknown."""
        return self._last.median_interval if self._last is not None else 0.0

    def false_share(self, false_tracks_per_hour: float) -> float | None:
        """Share of the starts from clutter that may be confirmed; None while the rate is unknown.

        The starts per scan are the mean of the detections, or those of the last scan if more.
        """
        interval = self.interval
        if not interval:
            return None
        detections = max(sum(self._counts) / len(self._counts), self._counts[-1], 1e-3)
        starts_per_hour = detections * SECONDS_PER_HOUR / interval
        return min(false_tracks_per_hour / starts_per_hour, 1.0)

    def value(self, sensor: SensorModel, common: CommonOptions, options: ScoreOptions) -> float:
        """The log-likelihood ratio that confirms; infinite while the scan rate is unknown.

        Parameters
        ----------
        sensor : SensorModel
            As given.
        common : CommonOptions
            With the properties that are estimated.
        options : ScoreOptions
            With the target false-track rate.
        """
        share = self.false_share(options.false_tracks_per_hour)
        if share is None or self._last is None:
            return math.inf
        plan = threshold_plan.score_plan(
            coarse_sensor(sensor, self._last, common),
            max_speed=common.max_speed,
            interval=threshold_plan.rounded(self.interval),
            window=options.window,
            gate_probability=options.gate_probability,
            process_noise=options.process_noise,
            deletion=options.deletion_threshold,
            min_hits=MIN_HITS,
            strengths=self._last.strengths is not None,
        )
        return plan.threshold(share)

    def value_if_near(
        self, evidence: float, sensor: SensorModel, common: CommonOptions, options: ScoreOptions
    ) -> float:
        """As `value`; infinite, without a plan, where the evidence is below any threshold."""
        share = self.false_share(options.false_tracks_per_hour)
        if share is None or evidence < threshold_plan.min_threshold(share):
            return math.inf
        return self.value(sensor, common, options)


def coarse_sensor(sensor: SensorModel, observed: Observation, common: CommonOptions) -> SensorModel:
    """The sensor of a plan; estimates are rounded, so that similar estimates share a plan.

    The detection probability goes in steps of 0.1, the median of the clutter density in steps of
    half a decade, the farthest range of clutter and its range rate by factors of 2. Range rates
    count only where the scan has any.

    Parameters
    ----------
    sensor : SensorModel
        As given.
    observed : Observation
        The last scan, with the estimates.
    common : CommonOptions
        With the properties that are estimated.
    """
    changes: dict[str, float] = {}
    if common.detection_probability == "estimated":
        changes["detection_probability"] = max(round(observed.detection_probability_in_use, 1), 0.1)
    detections = observed.detections
    if common.clutter_density == "estimated" and len(detections):
        density = float(np.median(detections["clutter_density"]))
        half = 2.0 ** round(math.log2(observed.clutter_sensor.clutter_range_rate))
        farthest = sensor.max_range * 2.0 ** math.ceil(
            math.log2(observed.seen_extent.max_range / sensor.max_range) - 0.1
        )
        changes |= {
            "clutter_density": 10.0 ** (0.5 * round(2.0 * math.log10(density))),
            "clutter_range_rate": half,
            "max_range": farthest,
            "min_range": min(sensor.min_range, 0.5 * farthest),
        }
    if not range_rates.measured(detections).any():
        changes["range_rate_std"] = 0.0
    return _changed(sensor, tuple(changes.items()))


@lru_cache(maxsize=64)
def _changed(sensor: SensorModel, changes: tuple[tuple[str, float], ...]) -> SensorModel:
    """The sensor with changes, which repeat from scan to scan."""
    return replace(sensor, **dict(changes))
