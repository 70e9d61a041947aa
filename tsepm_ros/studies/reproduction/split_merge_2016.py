"""Split-merge 2016: the merging conditions on Table I, and the scene with four targets."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.numerics.arrays import IntArray, members_of_groups
from tsepm_ros.studies.reproduction.monte_carlo import run_four_targets
from tsepm_ros.studies.reproduction.published import (
    AFTER_MERGING,
    AFTER_SPLITTING,
    SAID_NOT_TO_MERGE,
    SAID_TO_MERGE,
    SAID_TO_SPLIT,
    TABLE_I,
    TABLE_I_RULE,
    TABLE_II,
    TRUE_TRACK,
)
from tsepm_ros.studies.reproduction.report import (
    Cell,
    Line,
    Panel,
    Part,
    Picture,
    Result,
    Setting,
    Table,
    column,
)
from tsepm_ros.tools.evaluation.intervals import mean_count, proportion
from tsepm_ros.tools.simulation import load_scenario
from tsepm_ros.tracker import merging

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
    return bool(same_scan[0] and merging.overlap(TRACK_IDS, first, second)[0])


def table_i_groups() -> list[tuple[int, ...]]:
    """Groups of Table I's tracks by the package's merging, if all states are close."""
    groups = []
    index = np.array(list(TABLE_I))
    for scan in np.unique(CONFIRMED_IN):
        rows = np.flatnonzero(scan == CONFIRMED_IN)
        states, covariances = np.zeros((len(rows), 4)), np.tile(np.eye(4), (len(rows), 1, 1))
        labels, _ = merging.groups(TRACK_IDS[rows], states, covariances, 0.9)
        for members in members_of_groups(labels):
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
    label = {track: track for track in TABLE_I}
    for first, second in SAID_TO_MERGE:
        kept, merged = label[first], label[second]
        label = {track: kept if name == merged else name for track, name in label.items()}
    return len(set(label.values()))


def reproduce(setting: Setting) -> list[Part]:
    """Parts of the source's chapter."""
    scenario = load_scenario("four_targets", {"scans": TABLE_I_RULE[1]})
    [runs] = setting.results(run_four_targets, [scenario])
    return [*_table_i_parts(), *_scene_parts(runs)]


def _table_i_parts() -> list[Part]:
    groups = table_i_groups()
    claims = [*((pair, "merge") for pair in SAID_TO_MERGE)]
    claims += [(pair, "do not merge") for pair in SAID_NOT_TO_MERGE]
    rows: list[list[Cell]] = [
        [
            f"{first}, {second}",
            verdict,
            int(SHARED_HITS[first - 1, second - 1]),
            f"{CONFIRMED_IN[first - 1]}, {CONFIRMED_IN[second - 1]}",
            "may merge" if may_merge(first, second) else "do not merge",
        ]
        for (first, second), verdict in claims
    ]
    left = AFTER_SPLITTING - len(disjoint_pairs())
    majority = [t for t in TABLE_II if 2 * SHARED_HITS[t - 1, TRUE_TRACK - 1] > TABLE_I_RULE[0]]
    return [
        "### Table I: thirteen tracks of one run",
        "The table has labels, not positions: of the conditions, the same scan (i) and more than "
        "M/2 shared measurements (iii) can be checked, close states (ii) cannot. "
        f"{sum(may_merge(*pair) for pair in SAID_TO_MERGE)} of {len(SAID_TO_MERGE)} pairs that the "
        f"text merges meet (i) and (iii), {sum(may_merge(*pair) for pair in SAID_NOT_TO_MERGE)} of "
        f"{len(SAID_NOT_TO_MERGE)} that it does not merge.",
        Table(
            "split_merge_2016_pairs",
            {
                "tracks": "",
                "the text says": "",
                "shared measurements": "d",
                "confirmed in scans": "",
                "conditions (i) and (iii)": "",
            },
            rows,
            reported=(),
        ),
        f"Disjoint pairs leave the published {AFTER_MERGING} tracks, the text's pairs chained to "
        f"groups {chained()}, the package's groups (connected components), all states close, "
        f"{len(groups)}.",
        Table(
            "split_merge_2016_left",
            {"reading": "", "tracks left": "d", "groups": ""},
            [
                ["published", AFTER_MERGING, "not listed"],
                [
                    "the text's pairs, each track in one pair at most",
                    left,
                    "; ".join(f"{a}, {b}" for a, b in disjoint_pairs()),
                ],
                ["the text's pairs, chained to groups", chained(), "8, 9, 11 are one"],
                [
                    "the package's groups (connected components), all states close",
                    len(groups),
                    "; ".join(", ".join(map(str, group)) for group in groups),
                ],
            ],
            reported=(),
        ),
        "Of the tracks that the text lets split, "
        + "; ".join(_split_text(*pair) for pair in SAID_TO_SPLIT)
        + f". Of Table II's tracks {', '.join(map(str, majority))} share more than half of their "
        f"hits with the true track {TRUE_TRACK}: they are its repetitions.",
        _shared_picture(),
    ]


def _split_text(first: int, second: int) -> str:
    pairs = zip(TABLE_I[first], TABLE_I[second], strict=True)
    place = next(place for place, (hit, other) in enumerate(pairs) if hit != other)
    if place == 0:
        return f"{first} and {second} have different first measurements, so they never were one"
    return f"{first} and {second} split at hit {place + 1}"


def _shared_picture() -> Picture:
    pairs = itertools.permutations(TABLE_I, 2)
    merging_pairs = [pair for pair in pairs if may_merge(*pair)]
    places = np.array(merging_pairs).T - 1
    dots = Line(places[0], places[1], "conditions (i) and (iii) hold", {"ls": "", "marker": "o"})
    names = list(TABLE_I)
    ticks = {"xticks": range(len(names)), "yticks": range(len(names))}
    settings = ticks | {"xticklabels": names, "yticklabels": names}
    return Picture(
        "split_merge_2016_table_i",
        "Table I of Split-merge 2016: measurements that its thirteen tracks share",
        [Panel([dots], settings | {"title": "Measurements shared"}, image=SHARED_HITS)],
        (6.0, 5.0),
    )


def _scene_parts(runs: list[Result]) -> list[Part]:
    split, merged = (
        np.array([run[f"{name} areas"] for run in runs]) for name in ("split", "merged")
    )
    near = [np.array([run[f"{name} near"] for run in runs]) for name in ("split", "merged")]
    targets = split.shape[1]
    detected = [int(column(runs, name, 1).sum()) for name in ("split", "merged")]
    rows: list[list[Cell]] = []
    for what, published, counts in (
        ("after splitting", AFTER_SPLITTING, split),
        ("after merging", AFTER_MERGING, merged),
        ("mostly the target's, after splitting", len(TABLE_II), near[0]),
        ("mostly the target's, after merging", 3, near[1]),
        ("others, after splitting", AFTER_SPLITTING - len(TABLE_II), split - near[0]),
        ("others, after merging", AFTER_MERGING - 3, merged - near[1]),
    ):
        low, high = np.quantile(counts, (0.05, 0.95))
        # The areas of one run are not independent.
        average = mean_count(counts.mean(axis=1) * targets) / targets
        rows.append([what, published, average, f"{low:.0f} to {high:.0f}"])
    disc: list[list[Cell]] = [
        [f"whole coverage, {text}", "-", mean_count(column(runs, name, 0)), "-"]
        for name, text in (("split", "after splitting"), ("merged", "after merging"))
    ]
    return [
        "### The scene with four targets",
        f"The shipped scenario *four_targets* with {TABLE_I_RULE[1]} scans, rule 5/8; in the 3 km "
        "square of interest round each target (a track counts if all its hits lie in it). The "
        "published share near the target after merging is by the text's pairs.",
        Table(
            "split_merge_2016_scene",
            {
                "tracks": "",
                "published, one run": "",
                "mean": ".2f",
                "5 % to 95 % of the squares": "",
            },
            [*rows, *disc],
            rows[:4],
            bounds=False,
        ),
        f"Targets found of {len(runs) * targets}: "
        + ", ".join(
            f"{text} {proportion(number, len(runs) * targets):.3f}"
            for text, number in zip(("before merging", "after it"), detected, strict=True)
        )
        + ".",
        _counts_picture(split, merged),
    ]


def _counts_picture(split: NDArray[np.float64], merged: NDArray[np.float64]) -> Picture:
    panels = []
    for counts, published, text in (
        (split, AFTER_SPLITTING, "after splitting"),
        (merged, AFTER_MERGING, "after merging"),
    ):
        top = int(np.quantile(counts, 0.98)) + 2
        share = np.bincount(np.minimum(counts.ravel(), top).astype(int), minlength=top + 1)
        bars = Line(np.arange(top + 1), share / counts.size, style={"drawstyle": "steps-mid"})
        settings = {
            "title": f"Tracks {text}; dashed: published, {published}",
            "xlabel": "tracks in the square of interest (the last: that many or more)",
            "ylabel": "share of squares",
        }
        panels.append(Panel([bars], settings, [published]))
    return Picture(
        "split_merge_2016_counts",
        "Split-merge 2016: tracks in the 3 km square round a target, and those of the published "
        "run",
        panels,
    )
