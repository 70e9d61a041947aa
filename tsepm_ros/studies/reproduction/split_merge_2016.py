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
"""Split-merge 2016: the merging conditions on Table I, and the scene with four targets."""

from __future__ import annotations

import numpy as np
from scipy.sparse.csgraph import connected_components

from tsepm_ros.methods import shared_hits
from tsepm_ros.methods.tsepm import Candidates
from tsepm_ros.numerics.arrays import BoolArray, IntArray, rows_of_groups
from tsepm_ros.studies.reproduction.monte_carlo import AS_GIVEN, MonteCarloStarts
from tsepm_ros.studies.reproduction.report import (
    Cell,
    Part,
    ReportSetting,
    ReportTable,
    Result,
    report_column,
    report_text,
)
from tsepm_ros.studies.split_merge import SplitMerge, SplitMergeOptions
from tsepm_ros.tools.evaluation.intervals import mean_count_interval, proportion_interval
from tsepm_ros.tools.evaluation.simulated_run import SimulatedScene
from tsepm_ros.tools.simulation import Scenario, load_scenario
from tsepm_ros.tracker.options import CommonOptions
from tsepm_ros.tracker.tracker import Tracker
from tsepm_ros.tracker.tracks import TrackArrays

RUNS = 400
"""On the page."""
TABLE_I_RULE = (5, 8)
TABLE_I = {  # (scan, measurement) of each track
    1: ((1, 4), (2, 7), (3, 6), (4, 2), (5, 1)),
    2: ((1, 2), (2, 9), (3, 6), (4, 2), (5, 1)),
    3: ((1, 4), (2, 9), (3, 6), (4, 2), (5, 1)),
    4: ((1, 4), (2, 7), (3, 6), (4, 2), (5, 6)),
    5: ((1, 2), (2, 9), (3, 6), (4, 2), (5, 6)),
    6: ((1, 4), (2, 9), (3, 6), (4, 2), (5, 6)),
    7: ((1, 2), (2, 8), (3, 5), (5, 2), (7, 1)),
    8: ((1, 1), (3, 3), (5, 5), (6, 3), (8, 5)),
    9: ((1, 3), (3, 3), (5, 5), (6, 3), (8, 5)),
    10: ((2, 1), (3, 5), (5, 2), (7, 1), (8, 6)),
    11: ((1, 1), (3, 4), (5, 5), (6, 3), (8, 5)),
    12: ((2, 4), (3, 5), (5, 2), (7, 1), (8, 6)),
    13: ((1, 5), (2, 3), (4, 4), (5, 9), (8, 10)),
}
TRUE_TRACK = 3
TABLE_II = (1, 2, 3, 4, 5, 6)
"""Tracks near the target; the others are Table III's."""
SAID_TO_MERGE = ((2, 3), (1, 4), (5, 6), (8, 9), (8, 11), (10, 12))
SAID_NOT_TO_MERGE = ((5, 7),)
AFTER_SPLITTING = 13
AFTER_MERGING = 8
AREA_SIDE = 3000.0
"""Side of the area of interest, [4000 4000 7000 7000], m."""


TRACK_IDS: IntArray = np.array(
    [[100 * scan + row for scan, row in track] for track in TABLE_I.values()]
)
"""Detection ids of Table I's tracks, (13, 5)."""
CONFIRMED_IN: IntArray = TRACK_IDS[:, -1] // 100
"""Scan in which each track of Table I is confirmed, (13,)."""
SHARED_HITS: IntArray = (TRACK_IDS[:, None, :, None] == TRACK_IDS[None, :, None, :]).sum(
    axis=(2, 3)
)
"""Number of measurements that each pair of tracks shares, (13, 13)."""


def may_merge(first_track: int, second_track: int) -> bool:
    """Whether two tracks of Table I, by their indices there, meet conditions (i) and (iii).

    Condition (ii), close states, needs the positions, which are not printed.
    """
    first, second = np.array([first_track - 1]), np.array([second_track - 1])
    same_scan = CONFIRMED_IN[first] == CONFIRMED_IN[second]
    return bool(same_scan[0] and shared_hits.overlap(TRACK_IDS, first, second)[0])


def table_i_groups() -> list[tuple[int, ...]]:
    """Groups of Table I's tracks by the package's merging, if all states are close."""
    groups = []
    index = np.array(list(TABLE_I))
    for scan in np.unique(CONFIRMED_IN):
        rows = np.flatnonzero(scan == CONFIRMED_IN)
        states, covariances = np.zeros((len(rows), 4)), np.tile(np.eye(4), (len(rows), 1, 1))
        labels = shared_hits.groups(TRACK_IDS[rows], states, covariances, 0.9)
        for members in rows_of_groups(labels):
            groups.append(tuple(index[rows[members]].tolist()))
    return groups


def disjoint_pairs() -> list[tuple[int, int]]:
    """Pairs that the text merges, in its order, without pairs that share a track."""
    used: set[int] = set()
    pairs = []
    for pair in SAID_TO_MERGE:
        if not used & set(pair):
            used |= set(pair)
            pairs.append(pair)
    return pairs


def chained() -> int:
    """Number of tracks of Table I after chaining of the text's pairs to groups."""
    pairs = np.zeros((len(TABLE_I), len(TABLE_I)))
    pairs[tuple(np.array(SAID_TO_MERGE).T - 1)] = 1.0
    return int(connected_components(pairs, directed=False)[0])


class SplitOnly2016(SplitMerge):
    """Split-merge 2016 without merging: every confirmed track is an output."""

    def merge(self, candidates: Candidates) -> TrackArrays:
        """One track per candidate."""
        return self.tracks(candidates)


def run_four_targets(scenario: Scenario, seed: list[int]) -> Result:
    """Count tracks after splitting and after merging.

    Returns after each stage, for the coverage: tracks, and targets found; for the area of interest
    round each target: all tracks, and tracks that have more than half of their hits from the
    target.
    """
    scene = SimulatedScene.drawn(scenario, seed)
    min_hits, window = TABLE_I_RULE
    options = SplitMergeOptions(min_hits=min_hits, window=window)
    results: Result = {}
    for name, method_class in (("split", SplitOnly2016), ("merged", SplitMerge)):
        initiator = Tracker(method_class(scenario.sensor, CommonOptions(**AS_GIVEN), options))
        started = MonteCarloStarts.on(scene, initiator, scenario.scans)
        results[name] = [float(len(started.tracks)), float(started.counts()[0])]
        near = started.from_targets()
        inside = [_inside(started, target) for target in range(len(scene.simulator.targets))]
        results[f"{name} areas"] = [float(rows.sum()) for rows in inside]
        results[f"{name} near"] = [float((rows & near).sum()) for rows in inside]
    return results


def _inside(started: MonteCarloStarts, target: int) -> BoolArray:
    """Tracks all of whose hits lie in the area of interest round a target in mid run."""
    scene = started.scene
    x, y = scene.simulator.truth(0.5 * scene.scenario.duration)[target, 0::2]
    inside = [
        (np.abs(scan.range * np.cos(scan.azimuth) - x) <= 0.5 * AREA_SIDE)
        & (np.abs(scan.range * np.sin(scan.azimuth) - y) <= 0.5 * AREA_SIDE)
        for scan in scene.scans
    ]
    return np.asarray(started.of_hits(inside).all(axis=1))


def reproduce(setting: ReportSetting) -> list[Part]:
    """Parts of the source's chapter."""
    scenario = load_scenario("four_targets", {"scans": TABLE_I_RULE[1]})
    [runs] = setting.results(run_four_targets, [scenario], RUNS)
    return [*_table_i_parts(), *_scene_parts(runs)]


def _table_i_parts() -> list[Part]:
    shared = 2 * SHARED_HITS[:, TRUE_TRACK - 1] > TABLE_I_RULE[0]
    repeated = [t for t in TABLE_II if shared[t - 1] and t != TRUE_TRACK]
    return [
        "### Table I: thirteen tracks of one run",
        "The table has no positions. The merging conditions (i), the same scan, and (iii), more "
        "than M/2 shared measurements, can be checked; (ii), close states, cannot. Of the pairs "
        "that the text merges, "
        f"{sum(may_merge(*pair) for pair in SAID_TO_MERGE)} of {len(SAID_TO_MERGE)} meet (i) and "
        "(iii); of the pairs that it does not merge, "
        f"{sum(may_merge(*pair) for pair in SAID_NOT_TO_MERGE)} of {len(SAID_NOT_TO_MERGE)}. If "
        "each track merges in one pair only, "
        f"{AFTER_SPLITTING - len(disjoint_pairs())} tracks are left (published: {AFTER_MERGING}). "
        f"If pairs with a common track merge as one group, {chained()} are left. The package's "
        f"groups (connected components) leave {len(table_i_groups())} if all states are close.",
        f"The tracks {', '.join(map(str, repeated))} of Table II repeat the true track "
        f"{TRUE_TRACK}: they share more than half of its hits.",
    ]


def _scene_parts(runs: list[Result]) -> list[Part]:
    split, merged = (
        np.array([run[f"{name} areas"] for run in runs]) for name in ("split", "merged")
    )
    near = [np.array([run[f"{name} near"] for run in runs]) for name in ("split", "merged")]
    targets = split.shape[1]
    detected = [int(report_column(runs, name, 1).sum()) for name in ("split", "merged")]
    rows: list[list[Cell]] = []
    for quantity, published, counts in (
        ("after splitting", AFTER_SPLITTING, split),
        ("after merging", AFTER_MERGING, merged),
        ("mostly the target's, after splitting", len(TABLE_II), near[0]),
        ("mostly the target's, after merging", 3, near[1]),
    ):
        low, high = np.quantile(counts, (0.05, 0.95))
        # The areas of one run are not independent.
        average = mean_count_interval(counts.mean(axis=1) * targets) / targets
        rows.append(
            [
                quantity,
                published,
                average,
                f"{low:.0f} to {high:.0f}",
                "agrees" if low <= published <= high else "differs",
            ]
        )
    return [
        "### The scene with four targets",
        f"The means are of {len(runs)} runs of *four_targets* over {TABLE_I_RULE[1]} scans with "
        "the rule 5/8. A track counts if all its hits lie in the 3 km square of interest round a "
        f"target. The published {len(TABLE_II)} tracks that are mostly the target's are those of "
        "Table II; the text's pairs merge them to 3.",
        ReportTable(
            "split_merge_2016_scene",
            {
                "tracks": "",
                "published, one run": "",
                "mean": ".2f",
                "5 % to 95 % of the squares": "",
                "verdict": "",
            },
            rows,
        ),
        f"Of {len(runs) * targets} targets, "
        + " and ".join(
            f"{report_text(proportion_interval(number, len(runs) * targets), '.3f')} {text}"
            for text, number in zip(
                ("are found before merging,", "after merging"), detected, strict=True
            )
        )
        + ".",
    ]
