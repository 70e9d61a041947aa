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
"""Scenes of `amplitude.py`: clutter and targets with amplitudes, and runs of `score` on them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from tsepm_ros import Scan, make_initiator
from tsepm_ros.tools.evaluation.simulated_run import Outcome, judge_simulated_starts
from tsepm_ros.tools.simulation import Scenario, Simulator, load_scenario
from tsepm_ros.tools.simulation.scenario import ClutterStrength, TargetStrength

BOX = load_scenario("box")
WARM_UP = 16
"""Pings of clutter alone before the target appears."""
PINGS = 8
"""Pings within which it is to be found."""
CLUTTER_PINGS = 60
"""Pings of a run of clutter alone."""
GAIN_AT = 30
"""Ping from which the gain is 20 dB higher, in the runs of that name."""
AS_CLUTTER = -30.0
"""Ratio of a target whose echoes are as strong as clutter, dB."""

Change = Callable[[np.ndarray, Scan, int], np.ndarray]
"""The amplitudes as a sensor gives them, from those simulated, the scan and its index."""


def as_drawn(amplitude: np.ndarray, scan: Scan, index: int) -> np.ndarray:
    """The amplitudes as they are drawn."""
    return amplitude


def of_8_bits(amplitude: np.ndarray, scan: Scan, index: int) -> np.ndarray:
    """Steps of a twentieth of the mean, up to 255."""
    return np.clip(np.floor(20.0 * amplitude) + 1.0, 1.0, 255.0)


def with_a_step(amplitude: np.ndarray, scan: Scan, index: int) -> np.ndarray:
    """10 dB more beyond 7 km."""
    return np.where(scan.range > 7000.0, 10.0 * amplitude, amplitude)


def with_a_gain(amplitude: np.ndarray, scan: Scan, index: int) -> np.ndarray:
    """20 dB more from `GAIN_AT` on."""
    return 100.0 * amplitude if index >= GAIN_AT else amplitude


def all_equal(amplitude: np.ndarray, scan: Scan, index: int) -> np.ndarray:
    """One value for all."""
    return np.full(len(amplitude), 7.0)


def falling(amplitude: np.ndarray, scan: Scan, index: int) -> np.ndarray:
    """Of targets and clutter alike, with the fourth power of the range."""
    return amplitude * (5000.0 / scan.range) ** 4


NO_AMPLITUDE = "no amplitude"
CLUTTER: dict[str, tuple[ClutterStrength | None, Change]] = {
    NO_AMPLITUDE: (None, as_drawn),
    "Rayleigh": (ClutterStrength(), as_drawn),
    "K, shape 0.5": (ClutterStrength("k", 0.5), as_drawn),
    "K, texture of 500 m and 3 min": (ClutterStrength("k", 0.5, 500.0, 180.0), as_drawn),
    "log-normal": (ClutterStrength("log_normal", 1.0), as_drawn),
    "8 bits": (ClutterStrength(), of_8_bits),
    "falling with range": (ClutterStrength(), falling),
    "step of 10 dB at 7 km": (ClutterStrength(), with_a_step),
    "gain of 20 dB in the middle": (ClutterStrength(), with_a_gain),
}
"""Laws of the amplitude of clutter, and the sensor's change of it."""
TARGETS: dict[str, tuple[float | None, Change]] = {
    NO_AMPLITUDE: (None, as_drawn),
    "all equal": (0.0, all_equal),
    "as clutter": (AS_CLUTTER, as_drawn),
    "as clutter, both falling with range": (AS_CLUTTER, falling),
    **{f"{ratio:g} dB": (ratio, as_drawn) for ratio in (0.0, 3.0, 6.0, 10.0)},
}
"""Ratios of the target, dB, and the sensor's change of its echoes."""


@dataclass(frozen=True)
class Job:
    """A run.

    Attributes
    ----------
    scene : Scenario
    change : callable
    seed : list of int
    rate : float
        Target false-track rate, per hour.
    """

    scene: Scenario
    change: Change
    seed: list[int]
    rate: float


@dataclass(frozen=True)
class Outcomes:
    """Starts of a run.

    Attributes
    ----------
    found : bool
        Whether the target has a true start.
    wrong : int
        False and misplaced starts.
    nees : tuple of float
        Of the true starts.
    """

    found: bool
    wrong: int
    nees: tuple[float, ...]


def run(job: Job) -> Outcomes:
    """Run `score` on a scene."""
    simulator = Simulator(job.scene, job.seed)
    initiator = make_initiator("score", sensor=job.scene.sensor, false_tracks_per_hour=job.rate)
    tracks, origins = [], []
    for index, simulated in enumerate(simulator):
        scan = simulated.scan
        if job.scene.clutter_strength is not None:
            amplitude = job.change(scan.features["intensity"], scan, index)
            scan = replace(scan, features={"intensity": amplitude})
        tracks += list(initiator.process(scan))
        origins.append(simulated.origin)
    judged = judge_simulated_starts(simulator, tracks, origins)
    true = [one for one in judged if one.outcome is Outcome.TRUE]
    wrong = [one for one in judged if one.outcome in (Outcome.FALSE, Outcome.MISPLACED)]
    return Outcomes(bool(true), len(wrong), tuple(one.nees for one in true))


def with_target(ratio_db: float | None) -> Scenario:
    """The box after pings of clutter alone; the target appears where the scenario begins."""
    scene = replace(BOX, warm_up=WARM_UP, scans=PINGS)
    if ratio_db is None:
        return scene
    return replace(
        scene,
        clutter_strength=ClutterStrength(),
        target_strengths=(TargetStrength(ratio_db),),
    )


def clutter_alone(law: ClutterStrength | None) -> Scenario:
    """The box without a target."""
    return replace(BOX, scans=CLUTTER_PINGS, targets=(), clutter_strength=law)
