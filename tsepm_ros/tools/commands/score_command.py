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
"""The command `tsepm score`: OSPA, GOSPA and CLEAR-MOT of any two files of positions.

Both files are CSV with a row per time and track, or target:

- the time, s: ``stamp`` or ``time_s``;
- the position, m: ``state_x`` and ``state_y``, ``x`` and ``y``, or ``east_m`` and ``north_m``;
- the identity, any text: ``track_id``, ``target_id`` or ``target``; without it, all rows of the
  truth are of one target.

With a column ``status``, rows that are ``confirmed`` count; with a column ``sensor``, the last row
of a track at a time. Other columns are not read. The rows of each track or target are in the order
of time.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Mapping, Sequence
from itertools import chain, pairwise
from pathlib import Path

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.tools.commands.arguments import Arguments
from tsepm_ros.tools.evaluation.simulated_run import outside_measure
from tsepm_ros.tools.evaluation.tracking_metrics import ClearMot, ClearMotCounts, gospa, ospa
from tsepm_ros.tools.replay.recording import recorded_numbers
from tsepm_ros.tools.terminal import terminal_table
from tsepm_ros.tracker.tracks import TrackStatus
from tsepm_ros.whole_files import read_whole_csv

NAMES = {
    "time": ("stamp", "time_s"),
    "x": ("state_x", "x", "east_m"),
    "y": ("state_y", "y", "north_m"),
    "identity": ("track_id", "target_id", "target"),
}
"""Names of the columns."""
CONFIRMED = TrackStatus.CONFIRMED.name.lower()
"""The ``status`` of rows that count, where a file has this column."""
MOST = 1e12
"""Bound of times (s) and distances (m): beyond it squares and their sums lose all digits."""
LONGEST_INTERVAL = 1.5
"""Longest interval between rows without a gap, in medians of a file."""

Positions = Mapping[str, FloatArray]
"""Time (s), x and y (m) of each track or target, (n, 3), in the order of time."""


def positive_number(text: str) -> float:
    """A number above 0 from the command line."""
    value = float(text)
    if not 0.0 < value < MOST:
        raise argparse.ArgumentTypeError(f"must be a number above 0 and below {MOST:g}")
    return value


ARGUMENTS: Arguments = {
    "tracks": {"type": Path, "help": "CSV file, such as current.csv of tsepm run --out"},
    "truth": {"type": Path, "help": "CSV file, such as truth.csv of tsepm run --out"},
    "--cutoff": {
        "type": positive_number,
        "required": True,
        "help": "distance from which on a track is not the target's, m",
    },
    "--gap": {
        "type": positive_number,
        "help": "a track or target is not there between rows farther apart than this, s; default "
        f"{LONGEST_INTERVAL} times the median interval of its file",
    },
    "--labelled": {
        "action": "store_true",
        "help": "compare only from the first to the last row of the truth; before and after, every "
        "track counts as false",
    },
    "--measure": {
        "action": "append",
        "default": [],
        "metavar": "MODULE:FUNCTION",
        "help": "a measure from outside the package, see tsepm evaluate; may be repeated",
    },
}


def read_positions(path: Path, *, truth: bool = False) -> Positions:
    """Read the positions of a file, by identity.

    Raises
    ------
    ValueError
        If the file is malformed; the message names the file and the column or the line.
    """
    lines = read_whole_csv(path, {"status", *chain.from_iterable(NAMES.values())})
    header = lines[0][1]
    columns = _columns_of_positions(path, header, truth)
    status = header.index("status") if "status" in header else None
    rows: dict[str, dict[float, tuple[float, ...]]] = {}
    for line, row in lines[1:]:
        time, x, y = values = recorded_numbers(
            f"{path}, line {line}", [row[column] for column in columns[:3]]
        )
        if not all(abs(value) < MOST for value in values):
            raise ValueError(
                f"{path}, line {line}: time and position must be finite and below {MOST:g}, got "
                f"{row}"
            )
        if status is not None and row[status].strip() != CONFIRMED:
            continue
        identity = row[columns[3]].strip() if len(columns) == len(NAMES) else ""
        own = rows.setdefault(identity, {})
        last = next(reversed(own), -math.inf)
        if time < last or (time == last and "sensor" not in header):
            raise ValueError(
                f"{path}, line {line}: {identity or 'the target'} is at {time:g} s after "
                f"{last:g} s; the times of each track and target must ascend"
            )
        own[time] = time, x, y
    if not rows:
        cause = f"no row has the status {CONFIRMED}" if lines[1:] else "it has no rows"
        if truth:
            raise ValueError(f"{path} has no target to compare with: {cause}; give another truth")
        print(f"{path}: {cause}, so that every target is missed", file=sys.stderr)
    return {identity: np.array([*own.values()]) for identity, own in rows.items()}


def _columns_of_positions(path: Path, header: list[str], truth: bool) -> list[int]:
    """Columns of time, x, y and identity, if there is one."""
    if "reason" in header:
        raise ValueError(f"{path} has the new tracks alone: give current.csv, which has every scan")
    columns = []
    for part, names in NAMES.items():
        found = [header.index(name) for name in names if name in header]
        if not found and not (truth and part == "identity"):
            raise ValueError(
                f"{path} has no column of the {part} ({' or '.join(names)}); it has "
                f"{', '.join(header)}"
            )
        columns += found[:1]
    return columns


def median_interval(positions: Positions) -> float:
    """Median interval between the rows of a track or target, s; 0 if each has one row."""
    steps = [step for rows in positions.values() for step in np.diff(rows[:, 0]).tolist()]
    return float(np.median(steps)) if steps else 0.0


def positions_at(
    positions: Positions, times: FloatArray, gap: float
) -> list[dict[str, FloatArray]]:
    """Positions (2,) of what is there at each time, between rows on a straight line."""
    scenes: list[dict[str, FloatArray]] = [{} for _ in times]
    for identity, rows in positions.items():
        first = int(np.searchsorted(times, rows[0, 0]))
        at = times[first : np.searchsorted(times, rows[-1, 0], "right")]
        after = np.searchsorted(rows[:, 0], at)
        interval = rows[after, 0] - rows[np.maximum(after - 1, 0), 0]
        place = np.array([np.interp(at, rows[:, 0], rows[:, axis]) for axis in (1, 2)]).T
        for k in np.flatnonzero((rows[after, 0] == at) | (interval <= gap)):
            scenes[first + k][identity] = place[k]
    return scenes


def run_score(options: argparse.Namespace) -> None:
    """Compare tracks with the truth, at the times of both files, and print the measures.

    Raises
    ------
    ValueError
        If a file is malformed or a measure cannot be used.
    """
    measures = {name: outside_measure(name) for name in options.measure}
    files = [
        (options.tracks, read_positions(options.tracks)),
        (options.truth, read_positions(options.truth, truth=True)),
    ]
    _check_common_time(files)
    times, known = (
        np.unique(np.concatenate([rows[:, 0] for _, file in of for rows in file.values()]))
        for of in (files, files[1:])
    )
    inside = (known[0] <= times) & (times <= known[-1])
    if options.labelled:
        times = times[inside]
    elif not inside.all():
        print(
            f"{np.count_nonzero(~inside)} of {len(times)} times are before or after the truth, "
            "where every track counts as false; --labelled leaves them out",
            file=sys.stderr,
        )
    scenes = []
    for path, positions in files:
        gap = options.gap or LONGEST_INTERVAL * median_interval(positions)
        scenes.append(positions_at(positions, times, gap))
        _note_file(path, positions, gap)
    if files[0][1] and not any(tracks and targets for tracks, targets in zip(*scenes, strict=True)):
        print("at no time is there a track and a target: give a longer --gap", file=sys.stderr)
    clear, counts, rows = ClearMot(options.cutoff), [], []
    for tracks, targets in zip(*scenes, strict=True):
        found, true = (np.reshape([*scene.values()], (-1, 2)) for scene in (tracks, targets))
        parts = vars(gospa(found, true, options.cutoff)).values()
        more = (measure(found, true) for measure in measures.values())
        rows.append((ospa(found, true, options.cutoff), *parts, *more))
        counts.append(clear.take(targets, tracks))
    total = ClearMotCounts.total(counts)
    distance, localisation, missed, false, *others = np.array(rows).mean(axis=0)
    squares = {
        "GOSPA, RMS [m]": localisation + missed + false,
        "  localisation [m]": localisation,
        "  missed [m]": missed,
        "  false [m]": false,
    }
    table = [
        ["times", f"{len(times)}"],
        ["OSPA [m]", f"{distance:.2f}"],
        *([name, f"{math.sqrt(square):.2f}"] for name, square in squares.items()),
        ["MOTA", f"{total.mota:.4f}"],
        ["MOTP [m]", f"{total.motp:.2f}"],
        *([f"  {name}", f"{vars(total)[name]}"] for name in vars(total) if name != "distance"),
        *([name, f"{value:.6g}"] for name, value in zip(measures, others, strict=True)),
    ]
    print(terminal_table(["measure", f"cutoff {options.cutoff:g} m"], table))


def _note_file(path: Path, positions: Positions, gap: float) -> None:
    """Say on stderr how often a file has rows, and its gaps."""
    gaps = sum(
        after - before > gap
        for rows in positions.values()
        for before, after in pairwise(rows[:, 0].tolist())
    )
    absent = f"; not there in {gaps} gaps above {gap:g} s" if gaps else ""
    every = f", a row every {median_interval(positions):g} s" if positions else ""
    print(f"{path}: {len(positions)} identities{every}{absent}", file=sys.stderr)


def _check_common_time(files: Sequence[tuple[Path, Positions]]) -> None:
    """Refuse files without a common time: they are of different clocks."""
    spans = [
        (
            path,
            min(rows[0, 0] for rows in file.values()),
            max(rows[-1, 0] for rows in file.values()),
        )
        for path, file in files
        if file
    ]
    if max(first for _, first, _ in spans) > min(last for _, _, last in spans):
        told = ", ".join(f"{path} {first:.10g} to {last:.10g} s" for path, first, last in spans)
        raise ValueError(
            f"the files have no common time: {told}; give files of one run, with times in s, or "
            "add the difference of their clocks to the times of one"
        )
