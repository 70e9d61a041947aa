# Copyright 2026 tsepm_ros developers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""Options of the methods: those common to all, of the rule M/N, and of the likelihood ratio."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

from tsepm_ros.parameters import ParameterGroup, parameter

MAX_HITS, MAX_WINDOW = 32, 64
"""Maxima of M and N."""
GATE_PROBABILITY = 0.99
"""Probability that a detected target falls into the gate of a likelihood."""
MIN_HITS = 3
"""Hits of a confirmed track, at least: two hits cannot check the velocity."""


NO_LONGER = {
    "plots": "no longer used: target_extent above 0 combines the detections of a target from the "
    "first scan, and 0 once they show that targets give several",
}
"""Former options of the tracker, and what there is instead."""


@dataclass(frozen=True, kw_only=True)
class CommonOptions(ParameterGroup):
    """Options that mean the same in every method.

    Raises
    ------
    ValueError
        Naming the option whose value is not allowed.
    """

    max_speed: float = parameter(
        10.0, "Maximum speed of a target", unit="m/s", positive=True, maximum=1e4
    )
    min_speed: float = parameter(
        0.0,
        "Targets slower than this are fixed echoes. A start is published unless it is "
        "probably slower; a published track becomes a fixed echo once it is slower with a "
        "probability of 0.9. 0: every target is published",
        unit="m/s",
        minimum=0.0,
        maximum=1e4,
    )
    target_manoeuvre: float = parameter(
        0.0,
        "Acceleration of targets between turns, a standard deviation on each axis. Above 0 the "
        "covariance of a new track contains it. 0: learned from confirmed tracks, and a new track "
        "counts as straight",
        unit="m/s^2",
        minimum=0.0,
        maximum=100.0,
    )
    limit_speed: str = parameter(
        "auto",
        "on: a new track that is probably faster than max_speed gets a state that fits lower "
        "speeds; off: as the method's source defines it; auto: on with the method score alone",
        choices=("auto", "on", "off"),
    )
    start_standing: str = parameter(
        "off",
        "on: detections that stand (feature standing of 0.5 or more, by sonar_detector) start "
        "tracks; off: with the method score, they only continue tracks",
        choices=("on", "off"),
    )
    max_detections: int = parameter(
        200_000, "Maximum number of detections of a scan; a scan with more is refused", minimum=1
    )
    max_potential_tracks: int = parameter(
        250_000,
        "Maximum number of potential tracks, and of tracks that reach confirmation in one scan; "
        "the worst are cut and counted",
        minimum=1,
    )
    hold_time: float = parameter(
        0.0,
        "Maximum time for which a confirmed track is held without a detection; repeated misses end "
        "it sooner. 0: the time of 50 scans, or 50 s if this is longer",
        unit="s",
        minimum=0.0,
    )
    min_existence: float = parameter(
        0.3,
        "A track stays published while its target exists with at least this probability, and has "
        "not left the coverage; found again, it comes back under its id. 0: every held track is "
        "published",
        minimum=0.0,
        maximum=0.9,
    )
    detection_probability: str = parameter(
        "auto",
        "estimated: from the hits and misses of confirmed tracks, starting from "
        "sensor.detection_probability; given: sensor.detection_probability; auto: estimated with "
        "the method score alone",
        choices=("auto", "estimated", "given"),
    )
    clutter_density: str = parameter(
        "estimated",
        "estimated: counted on a polar grid from scan to scan, starting from "
        "sensor.clutter_density; given: sensor.clutter_density everywhere",
        choices=("estimated", "given"),
    )
    sensor_errors: str = parameter(
        "learned",
        "Errors of detections that state none. given: sensor.range_std, range_std_fraction and "
        "azimuth_std; learned: these, corrected with the method score by what confirmed tracks "
        "show, up to a factor of 4",
        choices=("learned", "given"),
    )
    intensity: str = parameter(
        "auto",
        "Amplitudes of the detections, in any unit, as evidence with the method score. auto: where "
        "detections carry an intensity; off: never",
        choices=("auto", "off"),
    )
    target_extent: float = parameter(
        0.0,
        "Length of the longest target. Above 0: detections of one ping within this distance plus "
        "the sensor's resolution are combined from the first scan on. 0: with the method score, "
        "once targets have shown several detections per ping",
        unit="m",
        minimum=0.0,
        maximum=1e3,
    )
    tracked_timeout: float = parameter(
        60.0,
        "Time without a message on tracked after which the node maintains the downstream tracker's "
        "tracks; also the time within which the tracker must list a new track",
        unit="s",
        positive=True,
        maximum=3600.0,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.min_speed >= self.max_speed:
            raise ValueError(
                f"min_speed must be below max_speed; got {self.min_speed} and {self.max_speed}"
            )

    def resolved(self, learns_from_confirmed: bool) -> CommonOptions:
        """The options of a method, without "auto", and without what it does not use.

        Both depend on whether most of its tracks are true.
        """
        automatic: dict[str, Any] = {
            "detection_probability": "estimated" if learns_from_confirmed else "given",
            "limit_speed": "on" if learns_from_confirmed else "off",
        }
        chosen = {name: value for name, value in automatic.items() if getattr(self, name) == "auto"}
        if not learns_from_confirmed:
            chosen |= {"start_standing": "on", "sensor_errors": "given"}
        return replace(self, **chosen)


def hits_option(
    default: int, *, minimum: int = 2, meaning: str = "Hits that confirm a track (M)"
) -> Any:
    """Make the option `min_hits` with a method's default and minimum."""
    return parameter(default, meaning, minimum=minimum, maximum=MAX_HITS)


def window_option(
    default: int,
    *,
    minimum: int = 2,
    meaning: str = "Scans within which the hits must occur, the first hit's included (N)",
) -> Any:
    """Make the option `window` with a method's default and minimum."""
    return parameter(default, meaning, minimum=minimum, maximum=MAX_WINDOW)


@dataclass(frozen=True, kw_only=True)
class MnOptions(ParameterGroup):
    """Options that every M/N method begins with.

    A method with another default defines `min_hits` or `window` again, by `hits_option` and
    `window_option`; their place in the table stays the first.

    Raises
    ------
    ValueError
        Naming the option whose value is not allowed, or if the window is shorter than the number
        of hits.
    """

    min_hits: int = hits_option(5)
    window: int = window_option(8)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.window < self.min_hits:
            raise ValueError(
                f"window must be at least min_hits; got {self.window} and {self.min_hits}"
            )


@dataclass(frozen=True, kw_only=True)
class ScoreOptions(ParameterGroup):
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
        0.025,
        "Probability that the correct hypothesis of a target is deleted; sets the "
        "deletion threshold",
        positive=True,
        maximum=0.5,
    )
    window: int = parameter(
        16, "Scans after which an unconfirmed hypothesis ends", minimum=3, maximum=64
    )

    @property
    def deletion_threshold(self) -> float:
        """Log-likelihood ratio below which a hypothesis is deleted: ln of the miss probability."""
        return math.log(self.miss_probability)
