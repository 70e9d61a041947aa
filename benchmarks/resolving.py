"""How one target's hypotheses become one start of `score`: rules beside each other on a scene.

Every rule has the hypotheses of `score`, their scores, its threshold and its hold. `waiting`
compares values of `RESOLVED`, the probability that more than half of the hits are the target's, for
which a start waits; at 0 none waits. `rules` compares what is tested and what starts:

- summed evidence: as `score` does;
- best path alone: the largest score of a hypothesis is tested, not the evidence of all with the
  same newest detection; the rest is as `score` does;
- weighted independent set: of all hypotheses that reach the threshold and are no held track's, the
  set of the greatest summed score in which no two share a detection. Each is a start at once, with
  its own hits and its own fit.

    python benchmarks/resolving.py waiting [--runs 400] [--processes 2]
    python benchmarks/resolving.py rules
"""

from __future__ import annotations

import argparse
import os

os.environ["OMP_NUM_THREADS"] = "1"
os.environ["OPENBLAS_NUM_THREADS"] = "1"

from collections.abc import Iterable, Mapping
from functools import partial
from typing import Any
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import Bounds, LinearConstraint, milp

from tsepm_ros.analysis.measures import Measures, measures_of
from tsepm_ros.analysis.operating_points import OperatingPoint
from tsepm_ros.analysis.pool import mapped
from tsepm_ros.analysis.run_summary import RunSummary, record
from tsepm_ros.analysis.simulated_run import simulate
from tsepm_ros.analysis.terminal_tables import text_table
from tsepm_ros.initiation.common_options import CommonOptions
from tsepm_ros.kinematics.track import TrackArrays
from tsepm_ros.methods.score import method, options
from tsepm_ros.methods.score.hypotheses import Hypotheses
from tsepm_ros.numerics import grouped
from tsepm_ros.simulation import Scenario, load_scenario
from tsepm_ros.stages.paths import NO_HIT

SCENE = "box"
PINGS = (8, 16)
BUILT = method.RESOLVED
SETTINGS = {
    "waiting": [("summed evidence", 20.0, share) for share in (0.0, 0.8, BUILT, 0.95, 0.97)],
    "rules": [
        ("summed evidence", 20.0, BUILT),
        ("best path alone", 100.0, BUILT),
        ("weighted independent set", 100.0, BUILT),
        ("summed evidence", 5.0, BUILT),
        ("best path alone", 20.0, BUILT),
        ("weighted independent set", 20.0, BUILT),
    ],
}
"""Rule, wish in false tracks per hour, `RESOLVED`. What is tested alone is less than a sum, and
passes less often: it takes a larger wish for as many false tracks."""


Confirmed = tuple[TrackArrays, list[Any]]


class BestPath(method.Score):
    """The largest score of a hypothesis is tested instead of the sum."""

    def _confirm(
        self, updated: Hypotheses, missed: Hypotheses, ids: NDArray[np.int64]
    ) -> Confirmed:
        with patch.object(evidence, "summed", grouped.largest_of):
            return super()._confirm(updated, missed, ids)


class IndependentSet(method.Score):
    """The hypotheses of the best set without shared detections, each a start."""

    def _confirm(
        self, updated: Hypotheses, missed: Hypotheses, ids: NDArray[np.int64]
    ) -> Confirmed:
        threshold = self._threshold_if_near(updated.score.max(initial=-np.inf))
        found = updated[updated.score >= threshold]
        found = found[self._spread_in_time(found, options.MIN_HITS)]
        share = self._claimed_share(found, np.arange(len(found)), len(found))
        found = found[share <= method.CLAIMED]
        found = found[best_set(found)]
        hits = [path[path != NO_HIT] for path in found.hits]
        for ids_of_one in hits:
            self._window.claim(ids_of_one, np.ones(len(ids_of_one)))
        state, covariance = self._estimate(found)
        tracks = self._tracks(hits, state, covariance, found.score, threshold)
        return tracks.numbered(self._take_track_ids(len(tracks))), []


def best_set(paths: Hypotheses) -> NDArray[np.int64]:
    """Rows of the greatest summed score in which no two share a detection."""
    if len(paths) <= 1:
        return np.arange(len(paths))
    used = np.array([np.isin(np.unique(paths.hits[paths.hits != NO_HIT]), p) for p in paths.hits])
    once = LinearConstraint(used.T.astype(float), ub=1.0)
    whole = np.ones(len(paths))
    solved = milp(-paths.score, constraints=once, integrality=whole, bounds=Bounds(0.0, 1.0))
    return np.flatnonzero(solved.x > 0.5)


RULES: dict[str, type[method.Score]] = {
    "summed evidence": method.Score,
    "best path alone": BestPath,
    "weighted independent set": IndependentSet,
}


def make(scenario: Scenario, rule: str, options: Mapping[str, Any]) -> method.Score:
    """Make a rule for a scenario's sensor."""
    return RULES[rule](scenario.sensor, CommonOptions(), options.ScoreOptions(**options))


def one_run(run: int, *, seed: int, rule: str, wish: float, resolved: float) -> RunSummary:
    """One run by one rule, judged."""
    point = OperatingPoint(rule, options={"false_tracks_per_hour": wish}, factory=make)
    with patch.object(score, "RESOLVED", resolved):
        return record(simulate(load_scenario(SCENE), [seed, run], point))


def cells(figures: Iterable[Measures]) -> list[str]:
    """P_D, wrong and redundant starts per run of each, with their intervals."""
    return [
        f"{getattr(one, name):.3f}"
        for one in figures
        for name in ("detection", "false_per_run", "redundant_per_run")
    ]


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("compared", choices=tuple(SETTINGS))
    parser.add_argument("--runs", type=int, default=400)
    parser.add_argument("--seed", type=int, default=11)
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args()
    titles = ("P_D in {} pings", "false + misplaced per run", "redundant per run")
    header = ["rule", "wish", "RESOLVED", *(one.format(n) for n in PINGS for one in titles)]
    rows = []
    for rule, wish, resolved in SETTINGS[options.compared]:
        job = partial(one_run, seed=options.seed, rule=rule, wish=wish, resolved=resolved)
        runs = list(mapped(job, range(options.runs), options.processes, chunk=4))
        figures = [measures_of(load_scenario(SCENE), runs, pings) for pings in PINGS]
        rows.append([rule, f"{wish:g}", f"{resolved:g}", *cells(figures)])
        print(", ".join(rows[-1]), flush=True)
    print(f"\n{SCENE}, {options.runs} runs, seed {options.seed}; 95 % intervals\n")
    print(text_table(header, rows))


if __name__ == "__main__":
    main()
