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
"""Recordings: CSV files of detections, simulated scenarios, and what a path names.

A recording is a CSV file, by default ``detections.csv``, and two optional files beside it:

- ``detections.csv``: a row per detection; columns ``time_s``, ``range_m``, and ``azimuth_rad``
  (counter-clockwise from the sensor's x axis) or ``bearing_rad`` (clockwise); optionally ``scan``
  (consecutive rows with the same number are one scan, at the least of their times, and each
  detection is valid at its own; without it, rows with the same time are one scan),
  ``elevation_rad`` (above the sensor's x-y plane; the range is then the slant range),
  ``range_std_m``, ``azimuth_std_rad``, ``time_offset_s`` (after ``time_s``; or
  ``two_way_travel_time_s``, twice that, which is used if there is no ``time_offset_s``),
  ``intensity``, ``range_width_m``, ``azimuth_width_rad``, ``range_rate_mps`` and ``standing``;
- optionally ``own_ship.csv``: ``time_s``, ``east_m``, ``north_m``; optionally ``east_mps``,
  ``north_mps``, ``heading_rad`` (clockwise from north), ``roll_rad`` (above 0 with the port side
  up), ``pitch_rad`` (above 0 with the bow down), both as in `own_ship.registration`, and ``scan``:
  a scan that appears here and has no detections is then an empty scan;
- optionally ``target.csv``: the truth, with the same columns, and ``target`` if there are several.

The rows of a file, or of a target, are in the order of time. A column of angles may be in degrees:
its name then ends in ``_deg`` in place of ``_rad``.
"""

from __future__ import annotations

import bisect
import csv
import math
import os
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePath

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.numerics.arrays import FloatArray, IntArray
from tsepm_ros.own_ship.pose_history import PoseSample, known_pose_rates
from tsepm_ros.parameters import shown_parameter
from tsepm_ros.settings.parameter_files import load_parameter_file_text
from tsepm_ros.tools.simulation.simulator import Simulator
from tsepm_ros.whole_files import opened_whole, read_whole_csv, read_whole_text

METADATA, DETECTIONS_FILE, TRUTH_FILE = "metadata.yaml", "detections.csv", "truth.csv"
"""Of a bag, of a recording, and what a run writes of the truth."""
MOTION_FILES = OWN_SHIP_FILE, TARGET_FILE = "own_ship.csv", "target.csv"
"""Files that may be beside the detections of a recording."""
GEOMETRY, TIMES = "geometry.yaml", "times.csv"
PICTURES = ".png", ".pgm", ".npy", ".npz"
"""Of a folder of images."""
CSV, MCAP, SQLITE = ".csv", ".mcap", ".db3"
EXPECTED = (
    f"expected a .csv file of detections, a folder with {DETECTIONS_FILE}, a folder of images with "
    f"{GEOMETRY} and {TIMES}, or a bag: its folder with {METADATA}, or its {MCAP} or {SQLITE} file"
)

_EMPTY, _OTHER, _LFS, _ANNEX = "empty", "other", "git LFS", "git-annex"
_STARTS = (
    (b"\x89MCAP0\r\n", MCAP),
    (b"SQLite format 3\0", SQLITE),
    (b"#ROSBAG V", ".bag"),
    (b"\x28\xb5\x2f\xfd", ".zst"),
    (b"\x1f\x8b", ".gz"),
    (b"\x04\x22\x4d\x18", ".lz4"),
    (b"BZh", ".bz2"),
    (b"\xfd7zXZ", ".xz"),
    (b"PK\x03\x04", ".zip"),
    (b"version https://git-lfs", _LFS),
    (b"/annex/objects/", _ANNEX),
)
"""First bytes of files, and the suffix that stands for their kind."""
_TOOLS = {
    **{".zst": "unzstd", ".zstd": "unzstd", ".gz": "gunzip", ".lz4": "unlz4"},
    **{".bz2": "bunzip2", ".xz": "unxz", ".zip": "unzip"},
}
_REMEDIES = {
    ".bag": "is a ROS 1 bag: convert it by rosbags-convert --src {path} --dst {path.stem}",
    **dict.fromkeys(
        _TOOLS,
        "is compressed: unpack it ({tool}), or name the folder of a compressed bag, if it has "
        + METADATA,
    ),
    _EMPTY: "is empty: the recording, or a copy, was interrupted; copy it again",
    _OTHER: "is no bag, whatever its name says: its first bytes are those of another file; "
    + EXPECTED,
    _LFS: "is a pointer of git LFS, and the file itself is not here: run git lfs pull",
    _ANNEX: "is a pointer of git-annex, and the file itself is not here: run git annex get {path}",
}
"""What is said of a file, by its kind, that is not read."""
_MAX_LISTED = 8
"""Most names of a folder's content in a message."""
MAX_ANGLE = 4.0 * math.pi
"""Angle that is asked about, rad: it may be in degrees."""
MAX_TIME = 2.0**31
"""Bound of times, s: stamps of ROS messages have 32-bit seconds."""
MIN_RETURN = 4
"""Pings after which a scan number may come again: the counter has started anew."""
MAX_SAME = 0.25
"""Largest part of the pings with the time of the ping before that is dropped, not refused."""
MAX_SPAN = 3.0
"""Longest time from the first to the last row of a scan, in median intervals of scans."""
LONG_INTERVAL = 100.0
"""Interval of pings that is asked about, s: the times may be in milliseconds."""
STEPS = (60.0, 1.0, 0.1, 0.01)
"""Resolutions of clocks that are asked about, s."""
MOTION = ("time_s", "east_m", "north_m")
MOTION_OF_TARGET = ("time_s", "east_m", "east_mps", "north_m", "north_mps")
ATTITUDE = ("roll_rad", "pitch_rad")
KNOWN_MOTION = (*MOTION, "east_mps", "north_mps", "heading_rad", *ATTITUDE, "scan", "target")
DETECTION_COLUMNS = {
    "range": "range_m",
    "azimuth": "azimuth_rad",
    "bearing": "bearing_rad",
    "elevation": "elevation_rad",
    "range_std": "range_std_m",
    "azimuth_std": "azimuth_std_rad",
    "time_offset": "time_offset_s",
    "two_way_travel_time": "two_way_travel_time_s",
    "intensity": "intensity",
    "range_width": "range_width_m",
    "azimuth_width": "azimuth_width_rad",
    "range_rate": "range_rate_mps",
    "standing": "standing",
}
"""Columns of the detections, by field."""
RECORDED_COLUMNS = {
    # A bad range or angle affects one detection, which its reader drops; a bad time affects a scan.
    DETECTIONS_FILE: (("time_s", "range_m"), ("time_s", "scan"), DETECTION_COLUMNS.values()),
    **dict.fromkeys(MOTION_FILES, (MOTION, KNOWN_MOTION, KNOWN_MOTION)),
}
"""Of each file: columns that it must have, that must be finite, and that are read."""
UNKNOWN_YAW_VARIANCE = 1e6
"""Variance of a heading that is not recorded, rad^2."""
OWN_SHIP_PERIOD = 1.0
"""Time between own-ship poses, s, as in the node `sonar_simulator`."""


def recording_kind_of(path: Path) -> str:
    """Kind of a file by its first bytes, else by its name, as a suffix in lower case; or a word.

    A file with the name of a bag's may be empty, or another file.
    """
    with path.open("rb") as file:
        start = file.read(32)
    named = path.suffix.lower()
    if named in (MCAP, SQLITE):
        named = _OTHER if start else _EMPTY
    return next((kind for first, kind in _STARTS if start.startswith(first)), named)


def recording_source_of(path: Path | str) -> tuple[Path, bool]:
    """Find what a path names.

    Parameters
    ----------
    path : path
        A CSV file of detections, a bag's file, the metadata.yaml of a bag, or a folder.

    Returns
    -------
    source : Path
        The CSV file, or the file or folder of the bag.
    is_bag : bool

    Raises
    ------
    ValueError
        If it is no recording; the message says what was found, what was expected, and the remedy.
    """
    # A launch file's argument is expanded by no shell.
    path = Path(path if os.path.exists(path) else os.path.expanduser(path))
    if path.name == METADATA:
        path = path.parent
    try:
        return _in_folder(path) if path.is_dir() else _file(path)
    except OSError as error:
        raise ValueError(f"{path} cannot be read: {error.strerror}; {EXPECTED}") from None


def _file(path: Path, *others: str) -> tuple[Path, bool]:
    """A file, and whether it is a bag's; refused if it is none of a recording, or of `others`."""
    kind = recording_kind_of(path)
    if kind in (CSV, MCAP, SQLITE, *others):
        return path, kind != CSV
    remedy = _REMEDIES.get(kind, f"is no recording; {EXPECTED}")
    raise ValueError(f"{path} {remedy.format(path=path, tool=f'{_TOOLS.get(kind)} {path}')}")


def recording_bag_files(source: Path) -> tuple[list[Path], list[str]]:
    """Find the files of a bag.

    Parameters
    ----------
    source : Path
        As `recording_source_of` returns it.

    Returns
    -------
    files : list of Path
        In the order of their messages; the folder itself if they are compressed.
    notes : list of str
        A sentence about files that the metadata does not name.

    Raises
    ------
    ValueError
        If a file is missing or cannot be a bag's; the message has the remedy.
    """
    try:
        return ([_file(source)[0]], []) if source.is_file() else _files_of(source)
    except OSError as error:
        raise ValueError(f"{error.filename or source} cannot be read: {error.strerror}") from None


def _files_of(folder: Path) -> tuple[list[Path], list[str]]:
    metadata, _ = _file(folder / METADATA, ".yaml")
    try:
        content = load_parameter_file_text(read_whole_text(metadata))
        stated = content["rosbag2_bagfile_information"]
        named = [PurePath(name).name for name in stated["relative_file_paths"]]
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise ValueError(
            f"{metadata} is no metadata of a bag ({error!r}): write it anew by ros2 bag reindex "
            f"{folder}, or name a file of the bag"
        ) from None
    # A file may have been unpacked since.
    places = [(folder / name, folder / PurePath(name).stem) for name in named]
    files = [next((path for path in both if path.is_file()), both[0]) for both in places]
    present = {path.name for path in folder.iterdir() if path.suffix in (MCAP, SQLITE)}
    others = ", ".join(sorted(present - {path.name for path in files}))
    missing = ", ".join(path.name for path in files if not path.is_file())
    if missing:
        raise ValueError(
            f"{metadata} names {missing}, and there is no such file beside it: copy it there"
            + f", or, if it was renamed, give it its name again, or name {others}" * bool(others)
        )
    packed = [_file(path, ".zst")[0].suffix not in (MCAP, SQLITE) for path in files]
    by_message = str(stated.get("compression_mode")).lower() == "message"
    notes = [f"{METADATA} does not name {others} beside it: not read"] if others else []
    return ([folder] if any(packed) or by_message else files), notes


def description_missing(folder: Path) -> str:
    """Which descriptions of images a folder has not, in words; empty if it has all."""
    return " and ".join(f"no {name}" for name in (GEOMETRY, TIMES) if not (folder / name).exists())


def _in_folder(folder: Path) -> tuple[Path, bool]:
    names = sorted(path.name for path in folder.iterdir() if not path.name.startswith("."))
    whole = [name for name in (METADATA, DETECTIONS_FILE) if name in names]
    if len(whole) == 1:
        return (folder, True) if whole == [METADATA] else _file(folder / DETECTIONS_FILE)
    kinds = {
        path: recording_kind_of(path) for path in map(folder.joinpath, names) if path.is_file()
    }
    recorded = {CSV, MCAP, SQLITE, ".bag", *_TOOLS}
    candidates = [path for path in kinds if {kinds[path], path.suffix.lower()} & recorded]
    if len(candidates) == 1 and CSV not in kinds.values():
        return _file(candidates[0])
    listed = ", ".join(names[:_MAX_LISTED]) + (" ..." if len(names) > _MAX_LISTED else "")
    remedy = "name one of its files" if kinds else "name a folder or a file in it"
    if any(name.lower().endswith(PICTURES) for name in names):
        remedy = (
            f"its images have {missing}"
            if (missing := description_missing(folder))
            else "its images are for tsepm run; tsepm detect writes their detections, to be played"
        )
    if not whole and {MCAP, SQLITE} & set(kinds.values()):
        remedy += f", or write {METADATA} by ros2 bag reindex {folder}"
    raise ValueError(f"{folder} holds {listed or 'nothing'}; {EXPECTED}: {remedy}")


@dataclass(frozen=True)
class RecordedScan:
    """One scan of a recording.

    Attributes
    ----------
    time : float
        s.
    fields : mapping of str to (n,) ndarray
        Detections by field: range, azimuth or bearing, and optional fields; SI and radians.
    sensor : str
        Name of the sensor, of several in a simulated recording.
    """

    time: float
    fields: Mapping[str, FloatArray]
    sensor: str = ""


@dataclass(frozen=True)
class Recording:
    """A recording.

    Attributes
    ----------
    scans : list of RecordedScan
        In order of time.
    own_ship : list of PoseSample
        In order of time; empty if not recorded. A heading that is not recorded has the variance
        `UNKNOWN_YAW_VARIANCE`.
    targets : dict of int to (n, 5) ndarray
        The truth, by target: time (s) and state ``[x, vx, y, vy]``, x east and y north, m and m/s;
        empty if not recorded.
    notes : list of str
        Sentences about files and times that were taken in one of several possible ways.
    """

    scans: list[RecordedScan]
    own_ship: list[PoseSample] = field(default_factory=list)
    targets: dict[int, FloatArray] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    @property
    def span(self) -> tuple[float, float]:
        """First and last recorded time, s."""
        times = [item.time for item in self.scans] + [item.stamp for item in self.own_ship]
        times += [time for path in self.targets.values() for time in path[:, 0].tolist()]
        return (min(times), max(times)) if times else (0.0, 0.0)

    @property
    def truth(self) -> list[FloatArray]:
        """Time (s), x and y (m) of each target, (n, 3)."""
        return [path[:, [0, 1, 3]] for path in self.targets.values()]


def read_recording(path: Path | str) -> Recording:
    """Read a recording.

    Parameters
    ----------
    path : path
        The CSV file of the detections, or a folder with ``detections.csv``.

    Raises
    ------
    ValueError
        If a file is missing or malformed; the message names the file and the column or the line.
    """
    file, is_bag = recording_source_of(path)
    if is_bag:
        raise ValueError(f"{path} is a bag; here a recording of CSV files is needed")
    notes: list[str] = []
    own_ship, targets = (
        _table(file.parent / name, *RECORDED_COLUMNS[name], notes) for name in MOTION_FILES
    )
    detections = _table(file, *RECORDED_COLUMNS[DETECTIONS_FILE], notes)
    if file.name != DETECTIONS_FILE and own_ship:
        notes.append(f"the own ship of {file.name} is read from {OWN_SHIP_FILE} beside it")
    if not len(detections["time_s"]):
        notes.append(f"{file.name} has no detections")
    if not targets and (file.parent / TRUTH_FILE).exists():
        notes.append(f"{TRUTH_FILE} is not read: the truth of a recording is {TARGET_FILE}")
    return Recording(
        scans=_scans(file.name, detections, own_ship, notes),
        own_ship=_poses(own_ship),
        targets=_targets(targets, np.unique(detections["time_s"]), notes) if targets else {},
        notes=notes,
    )


Table = dict[str, FloatArray]


def _table(
    path: Path,
    required: tuple[str, ...],
    finite: tuple[str, ...],
    known: Collection[str],
    notes: list[str],
) -> Table:
    """Columns of a file by name, degrees as radians; none if there is no such file."""
    if not path.exists():
        return {}
    if path.is_file():
        _file(path)
    in_degrees = (f"{name[:-3]}deg" for name in known if name.endswith("_rad"))
    read = {"time_s", "scan", *known, *in_degrees}
    (_, names), *filled = read_whole_csv(path, read)
    if missing := [name for name in required if name not in names]:
        raise ValueError(
            f"{path.name} has no column {missing[0]!r}; it has {shown_parameter(names)}"
        )
    lines = [line for line, _ in filled]
    columns = {name: column for column, name in enumerate(names) if name in read}
    values = [
        recorded_numbers(f"{path.name}, line {line}", [row[k] for k in columns.values()])
        for line, row in filled
    ]
    table = dict(zip(columns, np.reshape(values, (-1, len(columns))).T, strict=True))
    _convert_degrees(path.name, table, notes)
    if unread := sorted({*names} - read - {""}):  # the index of a table has no name
        notes.append(
            f"{path.name}: no use is made of {', '.join(unread)}; the names that are read are "
            f"{', '.join(known)}, and angles also in degrees, as ..._deg"
        )
    for name in finite:
        if len(bad := np.flatnonzero(~np.isfinite(table.get(name, ())))):
            raise ValueError(f"{path.name}, line {lines[bad[0]]}: {name} must be finite")
    check_recording_times(path.name, table, lines)
    return table


def recorded_numbers(place: str, cells: Sequence[str]) -> list[float]:
    """The numbers in cells of a table of a stranger.

    Raises
    ------
    ValueError
        If one is none; the message begins with the place of the row.
    """
    try:
        return [float(cell) for cell in cells]
    except ValueError:
        raise ValueError(
            f"{place}: expected {len(cells)} numbers, got {shown_parameter(cells)}"
            + "; time_s is in seconds, as Unix time is" * (":" in "".join(cells))
        ) from None


def _convert_degrees(file: str, table: Table, notes: list[str]) -> None:
    """Have angles in radians, and note what may be in degrees."""
    for name in [name for name in table if name.endswith("_deg")]:
        table.setdefault(f"{name[:-3]}rad", np.deg2rad(table.pop(name)))
    notes.extend(
        f"{file}: {name} exceeds two turns: if it is in degrees, name the column {name[:-3]}deg"
        for name in ("heading_rad", *ATTITUDE)
        if np.abs(table.get(name, 0.0)).max(initial=0.0) > MAX_ANGLE
    )


def check_recording_times(file: str, table: Table, lines: list[int]) -> None:
    """Refuse times that are no seconds, or that step back by more than one scan."""
    time = table["time_s"]
    if len(beyond := np.flatnonzero(np.abs(time) >= MAX_TIME)):
        value = abs(time[beyond[0]])
        unit = "milli" if value < 1e14 else "micro" if value < 1e17 else "nano"
        raise ValueError(
            f"{file}, line {lines[beyond[0]]}: time_s is {time[beyond[0]]:.0f} s, and stamps must "
            f"be within 32-bit seconds, as in ROS messages: is it in {unit}seconds?"
        )
    target = table.get("target", np.zeros_like(time))
    for rows in (np.flatnonzero(target == value) for value in np.unique(target)):
        starts = _changes(table.get("scan", time)[rows])
        first = np.minimum.reduceat(time[rows], starts)
        scan_of_line = np.unique(first, return_inverse=True)[1]
        if len(late := np.flatnonzero(np.maximum.accumulate(scan_of_line) - scan_of_line > 1)):
            raise ValueError(
                f"{file}, line {lines[rows[starts[late[0]]]]}: time_s steps back to "
                f"{first[late[0]]:.10g} s from {first[: late[0]].max():.10g} s. Rows must be in "
                "the order of time; add 86400 s after midnight if it is a time of day, and after "
                "a restart of the clock the time before"
            )


def _changes(number: FloatArray) -> NDArray[np.intp]:
    """Indices at which a value differs from the one before it, the first included."""
    return np.flatnonzero(np.concatenate([[True], number[1:] != number[:-1]])[: len(number)])


def _scans(file: str, detections: Table, own_ship: Table, notes: list[str]) -> list[RecordedScan]:
    if ("azimuth_rad" in detections) == ("bearing_rad" in detections):
        raise ValueError(f"{file} must have one of the columns azimuth_rad and bearing_rad")
    columns = {
        field: detections[name] for field, name in DETECTION_COLUMNS.items() if name in detections
    }
    time = detections["time_s"]
    pings = _runs(detections)
    starts = np.array([time[rows[0]] for rows in pings])
    if "scan" in detections:
        numbers = [float(detections["scan"][rows[0]]) for rows in pings]
        spans = np.array([np.ptp(time[rows]) for rows in pings])
        _check_scans(file, numbers, starts, spans, notes)
        if spans.any():
            after = np.empty_like(time)
            for start, rows in zip(starts, pings, strict=True):
                after[rows] = time[rows] - start
            columns["time_offset"] = after + columns.get(
                "time_offset", 0.5 * columns.pop("two_way_travel_time", np.zeros_like(time))
            )
            notes.append(
                f"the rows of a scan have times up to {spans.max():g} s apart: each detection is "
                "taken to be valid at its own time"
            )
    _ask_about_times(time, starts, "scan" in detections, notes)
    scans = [
        RecordedScan(float(start), {field: column[rows] for field, column in columns.items()})
        for start, rows in zip(starts, pings, strict=True)
    ]
    if "scan" in own_ship and "scan" in detections:
        scans += [
            RecordedScan(start, dict.fromkeys(columns, np.zeros(0)))
            for start in _empty_scans(own_ship, numbers, starts)
        ]
    return sorted(scans, key=lambda scan: scan.time)


def _runs(table: Table) -> list[NDArray[np.intp]]:
    """Rows of each scan in the order of time: those in a row with one number, or at one time."""
    number = table.get("scan", table["time_s"])
    order = np.lexsort((number, table["time_s"]))
    return np.split(order, _changes(number[order])[1:]) if len(order) else []


def _check_scans(
    file: str, numbers: list[float], starts: FloatArray, spans: FloatArray, notes: list[str]
) -> None:
    """Refuse scan numbers that do not stand for one ping each, and note a counter's restart."""
    remedy = "number the pings, or leave out the column scan if each has one time"
    last: dict[float, int] = {}
    restarts: list[str] = []
    for index, number in enumerate(numbers):
        if index - last.get(number, -MIN_RETURN) < MIN_RETURN:
            raise ValueError(
                f"{file}: scan {number:g} has rows at {starts[last[number]]:.10g} and "
                f"{starts[index]:.10g} s, with other scans between: {remedy}"
            )
        if number in last:
            restarts.append(
                f"the numbers of scan start again at {starts[index]:.10g} s: taken as new pings"
            )
        last[number] = index
    notes += restarts[:1]
    gaps = np.diff(starts)
    longest = MAX_SPAN * float(np.median(gaps)) if len(gaps) else 0.0
    if spans.max(initial=0.0) > longest:
        index = int(np.argmax(spans))
        raise ValueError(
            f"{file}: the rows of scan {numbers[index]:g} have times from {starts[index]:.10g} to "
            f"{starts[index] + spans[index]:.10g} s, "
            f"{'longer than scans are apart' if len(gaps) else 'and it is the only scan'}: {remedy}"
        )
    same = int(np.count_nonzero(gaps == 0.0))
    sentence = (
        f"{same} of {len(starts)} pings have the same time as the ping before: each ping needs a "
        "stamp of its own, finer than the interval of pings"
    )
    if same > MAX_SAME * len(starts):
        raise ValueError(f"{file}: {sentence}")
    if same:
        notes.append(f"{sentence}; these are dropped")


def _ask_about_times(
    time: FloatArray, starts: FloatArray, numbered: bool, notes: list[str]
) -> None:
    """Note intervals of pings that may come from another unit, or from a coarse clock."""
    interval = float(np.median(np.diff(starts))) if len(starts) > 1 else math.nan
    if interval >= LONG_INTERVAL:
        notes.append(f"pings are {interval:g} s apart: is time_s in milliseconds or microseconds?")
    for step in STEPS:
        whole = np.allclose(starts / step, np.round(starts / step), rtol=0.0, atol=1e-3)
        if whole and interval < 1.5 * step and len(time) > len(starts) and not numbered:
            notes.append(
                f"time_s has steps of {step:g} s: the rows of each of {len(starts)} times are "
                "taken as one ping; if several pings have the same time, each needs a stamp of "
                "its own, or a number in the column scan"
            )


def _empty_scans(own_ship: Table, numbers: list[float], starts: FloatArray) -> list[float]:
    """Times of the own ship's scans that have no detections, by number and nearest time."""
    runs = _runs(own_ship)
    times = [float(own_ship["time_s"][rows[0]]) for rows in runs]
    by_number: dict[float, list[int]] = {}
    for index, rows in enumerate(runs):
        by_number.setdefault(float(own_ship["scan"][rows[0]]), []).append(index)
    stamps = {
        min(by_number[number], key=lambda index: abs(times[index] - start))
        for number, start in zip(numbers, starts.tolist(), strict=True)
        if number in by_number
    }
    return [time for index, time in enumerate(times) if index not in stamps]


def _columns(table: Table, names: tuple[str, ...]) -> FloatArray:
    """Columns of a table, (n, k), 0 where it has none, in the order of time."""
    time = table.get("time_s", np.zeros(0))
    return np.stack([table.get(name, np.zeros_like(time)) for name in names], axis=1)[
        np.argsort(time, kind="stable")
    ]


def read_recorded_own_ship(folder: Path, notes: list[str]) -> list[PoseSample]:
    """The poses of a folder's ``own_ship.csv``, and notes on it; none if there is no such file.

    Raises
    ------
    ValueError
        If it is malformed.
    """
    return _poses(_table(folder / OWN_SHIP_FILE, *RECORDED_COLUMNS[OWN_SHIP_FILE], notes))


def _poses(table: Table) -> list[PoseSample]:
    known = "heading_rad" in table
    covariance = None if known else np.diag([0.0, 0.0, UNKNOWN_YAW_VARIANCE])
    rows = _columns(table, (*MOTION, "heading_rad", "east_mps", "north_mps", *ATTITUDE)).tolist()
    return [
        PoseSample(
            *(time, x, y, math.pi / 2 - heading if known else 0.0, covariance),
            *(known_pose_rates(vx, vy, 0.0), roll, pitch),
        )
        for time, x, y, heading, vx, vy, roll, pitch in rows
    ]


def _targets(table: Table, pings: FloatArray, notes: list[str]) -> dict[int, FloatArray]:
    rows = _columns(table, ("target", *MOTION_OF_TARGET))
    times = np.unique(rows[:, 1])
    if len(pings) and ((pings[0] <= times) & (times <= pings[-1])).sum() < min(
        2, len(pings), len(times)
    ):
        notes.append(
            f"{TARGET_FILE} has times from {times[0]:.10g} to {times[-1]:.10g} s, the pings are "
            f"from {pings[0]:.10g} to {pings[-1]:.10g} s: give rows in that time, of the same "
            "clock, in s"
        )
    notes.extend(
        [
            f"{TARGET_FILE} has several rows of one target at one time: give each target a number "
            "of its own in the column target"
        ]
        * (len(np.unique(rows[:, :2], axis=0)) < len(rows))
    )
    return {int(value): rows[rows[:, 0] == value, 1:] for value in np.unique(rows[:, 0])}


def simulated_recording(simulator: Simulator) -> tuple[Recording, list[IntArray]]:
    """Simulate a scenario and record the scans, the own ship's poses and the truth.

    Parameters
    ----------
    simulator : Simulator
        It is iterated once.

    Returns
    -------
    recording : Recording
        The own ship's poses reach beyond the last echo; the truth is at the scans' stamps.
    origins : list of (n,) ndarray of int
        Target of each scan's detections, as in `SimulatedScan`.
    """
    simulated, start = list(simulator), simulator.start
    scans = [
        RecordedScan(
            simulated_scan.scan.stamp,
            {
                name: values
                for name in ("range", "azimuth", "time_offset")
                if (values := getattr(simulated_scan.scan, name)) is not None
            }
            | dict(simulated_scan.scan.features),
            simulated_scan.scan.sensor,
        )
        for simulated_scan in simulated
    ]
    truth = {one.scan.stamp: one.truth for one in simulated if len(one.truth)}  # after the warm-up
    targets = {
        target: np.array([(stamp, *states[target]) for stamp, states in truth.items()])
        for target in range(len(simulator.targets))
    }
    number = math.ceil((simulated[-1].complete - start) / OWN_SHIP_PERIOD) + 1
    pose, rest = simulator.scenario.own_ship.pose, known_pose_rates(0.0, 0.0, 0.0)
    own_ship = [
        PoseSample(start + time, x, y, yaw, rates=rest)
        for time in (OWN_SHIP_PERIOD * np.arange(number)).tolist()
        for x, y, yaw in [pose(time).tolist()]
    ]
    return Recording(scans, own_ship, targets), [
        simulated_scan.origin for simulated_scan in simulated
    ]


def write_simulated_recording(simulator: Simulator, folder: Path) -> None:
    """Simulate the scans of a sensor and write the files of a recording into a folder.

    Own ship's poses are also at the stamps of scans, with their numbers: scans may be empty.
    """
    recording, _ = simulated_recording(simulator)
    stamps, pose = [scan.time for scan in recording.scans], simulator.scenario.own_ship.pose
    own_ship = [
        (time, x, y, math.pi / 2 - yaw, bisect.bisect(stamps, time))
        for time in sorted({*stamps, *(sample.stamp for sample in recording.own_ship)})
        for x, y, yaw in [pose(time - simulator.start).tolist()]
    ]
    detections = [
        (number, scan.time, *row)
        for number, scan in enumerate(recording.scans, start=1)
        for row in zip(*(values.tolist() for values in scan.fields.values()), strict=True)
    ]
    truth = [(name, *row) for name, path in recording.targets.items() for row in path.tolist()]
    columns = [DETECTION_COLUMNS[field] for field in recording.scans[0].fields]
    for file, rows in (
        (DETECTIONS_FILE, [("scan", "time_s", *columns), *detections]),
        (OWN_SHIP_FILE, [(*MOTION, "heading_rad", "scan"), *own_ship]),
        (TARGET_FILE, [("target", *MOTION_OF_TARGET), *truth]),
    ):
        with opened_whole(folder / file) as opened:
            csv.writer(opened, lineterminator="\n").writerows(rows)
