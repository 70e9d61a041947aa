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
"""TSEPM 2018 with a learned evaluation: a small network classifies the branches that reach M hits.

Splitting, rule and merging are the paper's; only the evaluation of Steps 5 and 6 differs. The
network has figures of a branch's fit, speed, clutter and hits, one hidden layer, and a logit for
"more than half of the hits are one target's". It is trained on simulated scenes like the box, of
other seeds and of targets with all velocities up to the limit:

    python benchmarks/contenders/learned_starter.py [--runs 300]     train it again
    (cd benchmarks; tsepm evaluate box --method contenders.learned_starter:LearnedStarter)
"""

from __future__ import annotations

import argparse
import dataclasses
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.methods import tsepm
from tsepm_ros.methods.tsepm import Candidates, Tsepm, TsepmOptions
from tsepm_ros.numerics.arrays import FloatArray, IntArray
from tsepm_ros.numerics.gaussian import squared_mahalanobis_distance
from tsepm_ros.parameters import parameter
from tsepm_ros.tools.evaluation.simulated_run import SimulatedScene
from tsepm_ros.tools.simulation import Scenario, load_scenario
from tsepm_ros.tracker import motion
from tsepm_ros.tracker.initial_state import Fit, fit_states
from tsepm_ros.tracker.options import CommonOptions
from tsepm_ros.tracker.tracker import Tracker
from tsepm_ros.tracker.tracks import TrackArrays
from tsepm_ros.whole_files import write_whole_text

WEIGHTS = Path(__file__).with_suffix(".json")
HIDDEN = 16
TRAINING_SEED = 1000
"""Of the scenes of the training; those of evaluations begin with other numbers."""


@dataclass(frozen=True, kw_only=True)
class LearnedOptions(TsepmOptions):
    """Options of the paper's method, and the smallest logit."""

    logit: float = parameter(0.0, "Smallest logit of a kept branch", minimum=-50.0, maximum=50.0)


class LearnedStarter(Tsepm):
    """The method with the network's logit, negated, in place of f_1."""

    Options = LearnedOptions
    options: LearnedOptions
    files: ClassVar[tuple[Path, ...]] = (WEIGHTS,)
    operating_points = MappingProxyType(
        {f"logit {value:g}": {"logit": value} for value in (1.0, 0.0, -1.0, -2.0)}
    )

    def forget(self) -> None:
        """See `Method.forget`."""
        super().forget()
        self._network = {k: np.array(v) for k, v in json.loads(WEIGHTS.read_text()).items()}

    def estimated(self, ids: IntArray) -> Candidates:
        """See `Tsepm.estimated`."""
        candidates = super().estimated(ids)
        if ids.shape[1] < self.options.min_hits:  # a potential track for display
            return candidates
        figures = self.figures(ids)
        return dataclasses.replace(candidates, evaluation=-logit(self._network, figures))

    def figures(self, ids: IntArray) -> FloatArray:
        """What the network is given of branches of some hits, (n, m), (n, k)."""
        hits = self.detections[ids]
        return branch_figures(
            hits, fit_states(hits, self.stamp, self.sensor, "weighted"), self.common
        )

    @property
    def threshold(self) -> float:
        """See `Tsepm.threshold`."""
        return -self.options.logit


def branch_figures(hits: NDArray[np.void], fit: Fit, common: CommonOptions) -> FloatArray:
    """Figures of branches of hits (n, m), (n, k), all near 1 in size."""
    after = fit.time_after_state
    residual = hits["position"] - motion.position_after(fit.state[:, None], after)
    distance = squared_mahalanobis_distance(residual, fit.hit_covariance)
    speed = np.hypot(fit.state[:, 1], fit.state[:, 3]) / common.max_speed
    error = np.sqrt(fit.covariance[:, 1, 1] + fit.covariance[:, 3, 3]) / common.max_speed
    density = hits["clutter_density"]
    elapsed = np.diff(after, axis=1)
    area = density.mean(axis=1) * np.sqrt(np.linalg.det(fit.hit_covariance)).mean(axis=1)
    step = np.hypot(*np.moveaxis(np.diff(hits["position"], axis=1), 2, 0))
    return np.stack(
        [
            np.log1p(distance.sum(axis=1)),
            np.log1p(distance.max(axis=1)),
            np.log1p(distance[:, 0]),
            np.log1p(distance[:, -1]),
            speed,
            np.maximum(speed - 1.0, 0.0),
            np.log(error),
            np.log(tsepm.clutter_statistic(hits["position"], density)),
            np.log(area),
            (step / (common.max_speed * elapsed)).max(axis=1),
            (after[:, -1] - after[:, 0]) / elapsed.min(axis=1).clip(1e-9) / hits.shape[1],
        ],
        axis=1,
    )


def logit(network: dict[str, FloatArray], figures: FloatArray) -> FloatArray:
    """The network's logit of some figures (n, k), (n,)."""
    scaled = (figures - network["mean"]) / network["scale"]
    return np.tanh(scaled @ network["in"] + network["bias"]) @ network["out"] + network["offset"]


class Recorder(LearnedStarter):
    """Keeps the figures and hits of all branches, before pruning and merging."""

    def forget(self) -> None:
        """See `Method.forget`."""
        Tsepm.forget(self)
        self.seen: list[tuple[FloatArray, TrackArrays]] = []

    def estimated(self, ids: IntArray) -> Candidates:
        """See `Tsepm.estimated`."""
        candidates = Tsepm.estimated(self, ids)
        if ids.shape[1] == self.options.min_hits:
            self.seen.append((self.figures(ids), self.tracks(candidates)))
        return candidates


def branches(scenario: Scenario, seed: list[int]) -> tuple[FloatArray, FloatArray]:
    """Figures (n, k) of the branches of a drawn scene, and which are the target's, (n,)."""
    rng = np.random.default_rng(seed)
    speed, heading = 10.0 * np.sqrt(rng.uniform()), rng.uniform(-np.pi, np.pi)
    x, y = scenario.targets[0][0::2]
    target = np.array([x, speed * np.cos(heading), y, speed * np.sin(heading)])
    scene = SimulatedScene.drawn(dataclasses.replace(scenario, targets=(target,)), seed)
    method = Recorder(scenario.sensor, CommonOptions(max_speed=10.0), LearnedOptions())
    initiator = Tracker(method)
    for scan in scene.scans:
        initiator.process(scan)
    figures, own = [np.zeros((0, 11))], [np.zeros(0)]
    for some, tracks in method.seen:
        figures.append(some)
        shares = [np.mean([scene.origins[s][d] == 0 for s, d in hits]) for hits in tracks.hits]
        own.append(np.array(shares, float) > 0.5)
    return np.concatenate(figures), np.concatenate(own)


def trained(figures: FloatArray, own: FloatArray, seed: int = 0) -> dict[str, FloatArray]:
    """A network that minimises the cross entropy, by Adam (Kingma, Ba 2015)."""
    rng = np.random.default_rng(seed)
    mean, scale = figures.mean(axis=0), figures.std(axis=0) + 1e-9
    x = (figures - mean) / scale
    share = own.mean()
    weights = {
        "in": rng.normal(0.0, 0.3, (x.shape[1], HIDDEN)),
        "bias": np.zeros(HIDDEN),
        "out": rng.normal(0.0, 0.3, HIDDEN),
        "offset": np.array(np.log(share / (1.0 - share))),
    }
    first = {name: np.zeros_like(w) for name, w in weights.items()}
    second = {name: np.zeros_like(w) for name, w in weights.items()}
    for step in range(1, 6001):
        rows = rng.integers(0, len(x), 512)
        hidden = np.tanh(x[rows] @ weights["in"] + weights["bias"])
        error = 1.0 / (1.0 + np.exp(-(hidden @ weights["out"] + weights["offset"]))) - own[rows]
        back = error[:, None] * weights["out"] * (1.0 - hidden**2)
        gradient: dict[str, Any] = {
            "in": x[rows].T @ back / len(rows),
            "bias": back.mean(axis=0),
            "out": hidden.T @ error / len(rows),
            "offset": error.mean(),
        }
        for name in weights:
            first[name] = 0.9 * first[name] + 0.1 * gradient[name]
            second[name] = 0.999 * second[name] + 0.001 * gradient[name] ** 2
            rate = 3e-3 * min(1.0, 6.0 * (1.0 - step / 6000.0)) * (1.0 - 0.999**step) ** 0.5
            rate /= 1.0 - 0.9**step
            weights[name] = weights[name] - rate * first[name] / (np.sqrt(second[name]) + 1e-8)
    return {"mean": mean, "scale": scale, **weights}


def main(arguments: Sequence[str] | None = None) -> None:
    """Train the network and write its weights."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=300, help="scenes; default 300")
    options = parser.parse_args(arguments)
    box = load_scenario("box")
    drawn = [branches(box, [TRAINING_SEED, run]) for run in range(options.runs)]
    figures, own = (np.concatenate(parts) for parts in zip(*drawn, strict=True))
    network = trained(figures, own)
    values = logit(network, figures)
    order = np.argsort(np.concatenate([values[own > 0.5], values[own < 0.5]]))
    positive = int(own.sum())
    ranks = np.flatnonzero(order < positive) + 1
    area = (ranks.sum() - positive * (positive + 1) / 2) / (positive * (len(own) - positive))
    print(f"{len(own)} branches, {positive} of the target; area under the curve {area:.4f}")
    rounded = {name: np.round(weight, 5).tolist() for name, weight in network.items()}
    write_whole_text(WEIGHTS, json.dumps(rounded) + "\n")


if __name__ == "__main__":
    main()
