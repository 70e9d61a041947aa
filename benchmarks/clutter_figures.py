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
"""Figures from raw times: summaries, ratios and exponents.

Times are wall time. Ratios and growth are of processor time, which equals wall time on an idle
machine. On a busy machine wall time penalises contenders that run long enough to be interrupted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from contenders import CONTENDERS
from peer_timing import PeerTimes
from scenes import Scene
from scipy.optimize import nnls

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.tools.design import expected_counts
from tsepm_ros.tools.design.expected_counts import Expected, ExpectedGating
from tsepm_ros.tracker.options import CommonOptions

REFERENCE = "tsepm-5/8"
"""Contender that the ratios refer to."""
ORACLE = "oracle-5/8"
SETTLED = max(entry.window for entry in CONTENDERS.values()) - 1
"""First scan at which the window of every rule is full."""
MIN_PAIRS = 5
"""Minimum number of settled scans; with fewer, all scans but the first are used."""


@dataclass(frozen=True, eq=False)
class Timing:
    """All contenders at a named density; the theory is that of contenders with method tsepm."""

    name: str
    scene: Scene
    peers: dict[str, PeerTimes]
    theory: dict[str, Expected]

    @property
    def density(self) -> float:
        """Clutter density, 1/m^2."""
        return self.scene.sea.clutter_density


@dataclass(frozen=True)
class Ratio:
    """Ratio of processor time to the reference's: median, 10 % and 90 % of the scans, and sum."""

    median: float
    low: float
    high: float
    over_run: float
    pairs: int
    settled: bool


@dataclass(frozen=True)
class Summary:
    """Figures of a contender in one timing; times in s, memory in MB."""

    scans: int  # finished
    median: float  # wall time of the settled scans
    p95: float
    mean_cpu: float
    worst: float  # of all scans
    ratio: Ratio | None  # to the reference
    memory: float  # peak
    memory_at_start: float
    mean_counts: dict[str, float]  # of the settled scans
    most: dict[str, int]  # of all scans
    cut: int  # hypotheses, in all scans
    new: int  # tracks, in all scans
    of_target: int
    first_of_target: int  # scan; -1: none
    stopped: str  # reason for an early end; empty if finished


def theory_of(scene: Scene, names: Sequence[str]) -> dict[str, Expected]:
    """Expected counts of the contenders with method tsepm."""
    sea, sensor = scene.sea, scene.sea.sensor()
    speed, probability = sea.max_speed, sea.gate_probability
    gating = ExpectedGating(
        sensor=sensor, max_speed=speed, interval=sea.period, gate_probability=probability
    )
    rules = {name: (CONTENDERS[name].min_hits, CONTENDERS[name].window) for name in names}
    return {
        name: expected_counts.expected(gating, *rule, len(scene.scans))
        for name, rule in rules.items()
        if name.startswith("tsepm")
    }


def settled(scans: int) -> slice:
    """The settled scans, of which medians and means are taken."""
    return slice(SETTLED, scans) if scans >= SETTLED + MIN_PAIRS else slice(1, scans)


def ratio_to(peer: PeerTimes, reference: PeerTimes | None) -> Ratio | None:
    """Ratio over the scans that both finished; None if there are too few."""
    if reference is None:
        return None
    pairs = min(len(peer.seconds), len(reference.seconds))
    if pairs < 2:
        return None
    own, base = np.array(peer.cpu[:pairs]), np.array(reference.cpu[:pairs])
    part = settled(pairs)
    ratios = (own / base)[part]
    low, median, high = np.percentile(ratios, [10, 50, 90])
    return Ratio(
        median, low, high, float(own.sum() / base.sum()), len(ratios), part.start == SETTLED
    )


def summarise(timing: Timing, name: str) -> Summary:
    """Figures of one contender in one timing."""
    peer = timing.peers[name]
    scans = len(peer.seconds)
    part = settled(scans)
    times = np.array(peer.seconds[part]) if scans > 1 else np.full(1, np.nan)
    keys = peer.counts[0] if peer.counts else {}
    targets = [sum(timing.scene.is_target(hits) for hits in new) for new in peer.hits]
    confirming = [scan for scan, count in enumerate(targets) if count]
    return Summary(
        scans=scans,
        median=float(np.median(times)),
        p95=float(np.percentile(times, 95)),
        mean_cpu=float(np.mean(peer.cpu[part])) if scans > 1 else float("nan"),
        worst=max(peer.seconds, default=float("nan")),
        ratio=ratio_to(peer, timing.peers.get(REFERENCE)),
        memory=peer.memory,
        memory_at_start=peer.memory_at_start,
        mean_counts={
            key: float(np.mean([counts[key] for counts in peer.counts[part] or peer.counts]))
            for key in keys
        },
        most={key: max(counts[key] for counts in peer.counts) for key in keys},
        cut=sum(counts.get("cut", 0) for counts in peer.counts),
        new=sum(len(new) for new in peer.hits),
        of_target=sum(targets),
        first_of_target=confirming[0] if confirming else -1,
        stopped=peer.stopped,
    )


def agreement(timings: Sequence[Timing]) -> tuple[int, int, int]:
    """Scans finished by reference and oracle, scans with equal states, and scans with equal hits.

    A merged track's hits are its best member's. Members can tie exactly in f_1, since of five hits
    in five scans the residual of the second does not depend on the fifth; then rounding decides.
    """
    tracks, hits = [], []
    for timing in timings:
        if REFERENCE not in timing.peers or ORACLE not in timing.peers:
            continue
        own, oracle = timing.peers[REFERENCE], timing.peers[ORACLE]
        tracks += [_same_states(*pair) for pair in zip(own.states, oracle.states, strict=False)]
        hits += [sorted(a) == sorted(b) for a, b in zip(own.hits, oracle.hits, strict=False)]
    return len(tracks), sum(tracks), sum(hits)


def _same_states(first: FloatArray | None, second: FloatArray | None) -> bool:
    if first is None or second is None or first.shape != second.shape:
        return False
    in_order = [states[np.argsort(states[:, 0])] for states in (first, second)]
    return bool(np.allclose(*in_order, rtol=1e-9, atol=1e-6))


@dataclass(frozen=True)
class CostModel:
    """Processor time per scan, linear in the counts: fitted coefficients, s, none below 0."""

    scan: float
    detection: float
    potential: float
    raw: float

    def predict(self, detections: float, expected: Expected, part: slice) -> float:
        """Mean time of the scans of a part, from expected counts cut at the limits."""
        limits = CommonOptions()
        potential = np.minimum(expected.potential, limits.max_potential_tracks)[part].mean()
        raw = np.minimum(expected.raw, limits.max_potential_tracks)[part].mean()
        return float(
            self.scan + self.detection * detections + self.potential * potential + self.raw * raw
        )


def fit_cost(timings: Sequence[Timing], name: str) -> CostModel | None:
    """Fit the times of a contender's scans with weights 1/time; None if there are too few."""
    rows, times = [], []
    for timing in timings:
        peer = timing.peers[name]
        for seconds, counts in zip(peer.cpu, peer.counts, strict=True):
            rows.append([1.0, counts["detections"], counts["potential"], counts["raw"]])
            times.append(seconds)
    if len(times) < 2 * len(CostModel.__dataclass_fields__):
        return None
    weight = 1.0 / np.array(times)
    solution, _ = nnls(np.array(rows) * weight[:, None], np.ones(len(times)))
    return CostModel(*solution.tolist())


def exponents(timings: Sequence[Timing]) -> dict[str, list[float]]:
    """Growth d log(value) / d log(lambda) between neighbouring densities, by row.

    Rows are processor times of all contenders (mean of the settled scans) and, for method tsepm,
    measured and theoretical counts. nan where a value is missing or 0.
    """
    names, values = zip(*_grown(timings).items(), strict=True)
    log_density_ratios = np.diff(np.log([timing.density for timing in timings]))
    growth = np.diff(np.log(np.where(np.array(values) > 0.0, values, np.nan))) / log_density_ratios
    return dict(zip(names, growth.tolist(), strict=True))


def _grown(timings: Sequence[Timing]) -> dict[str, list[float]]:
    """Values whose growth is measured, one per timing, by row."""
    rows: dict[str, list[float]] = {}
    for name in timings[0].peers:
        summaries = [summarise(timing, name) for timing in timings]
        rows[f"{name} time"] = [summary.mean_cpu for summary in summaries]
        if not name.startswith("tsepm"):
            continue
        counts = [summary.mean_counts for summary in summaries]
        theory = [
            (timing.theory[name], settled(summary.scans))
            for timing, summary in zip(timings, summaries, strict=True)
        ]
        cost = fit_cost(timings, name)
        if cost is not None:
            rows[f"{name} time, theory"] = [
                cost.predict(mean.get("detections", 0.0), *expected)
                for mean, expected in zip(counts, theory, strict=True)
            ]
        rows[f"{name} potential"] = [mean.get("potential", 0.0) for mean in counts]
        rows[f"{name} potential, theory"] = [
            float(expected.potential[part].mean()) for expected, part in theory
        ]
        rows[f"{name} raw"] = [raw_before_cut(mean) for mean in counts]
        rows[f"{name} raw, theory"] = [
            float(expected.raw[part].mean()) for expected, part in theory
        ]
    return rows


def raw_before_cut(counts: dict[str, float]) -> float:
    """Raw confirmations, those cut by the limit included."""
    return counts.get("raw", 0.0) + counts.get("cut_raw", 0.0)
