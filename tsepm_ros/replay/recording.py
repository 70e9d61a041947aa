"""Recorded detections in CSV files.

A recording is a folder with

- ``detections.csv``: a row per detection; columns ``time_s``, ``range_m``, and ``azimuth_rad``
  (counter-clockwise from the sensor's x axis) or ``bearing_rad`` (clockwise); optionally ``scan``
  (rows with the same number are one scan; without it, rows with the same time are one scan),
  ``elevation_rad`` (above the sensor's x-y plane; the range is then the slant range),
  ``range_std_m``, ``azimuth_std_rad``, ``time_offset_s`` (after ``time_s``; or
  ``two_way_travel_time_s``, twice that, which is used if there is no ``time_offset_s``),
  ``intensity``, ``range_width_m``, ``azimuth_width_rad`` and ``range_rate_mps``;
- optionally ``own_ship.csv``: ``time_s``, ``east_m``, ``north_m``; optionally ``east_mps``,
  ``north_mps``, ``heading_rad`` (clockwise from north), ``roll_rad`` (above 0 with the port side
  up), ``pitch_rad`` (above 0 with the bow down), both as in `own_ship.attitude`, and ``scan``:
  a scan that appears here and has no detections is then an empty scan;
- optionally ``target.csv``: the truth, with the same columns, and ``target`` if there are several.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.parameters import shown

DETECTION_COLUMNS = {
    "range_m": "range",
    "azimuth_rad": "azimuth",
    "bearing_rad": "bearing",
    "elevation_rad": "elevation",
    "range_std_m": "range_std",
    "azimuth_std_rad": "azimuth_std",
    "time_offset_s": "time_offset",
    "two_way_travel_time_s": "two_way_travel_time",
    "intensity": "intensity",
    "range_width_m": "range_width",
    "azimuth_width_rad": "azimuth_width",
    "range_rate_mps": "range_rate",
}
"""Columns of ``detections.csv`` and the corresponding fields."""


@dataclass(frozen=True)
class RecordedScan:
    """One scan of a recording.

    Attributes
    ----------
    time : float
        s.
    fields : mapping of str to (n,) ndarray
        Detections by field: range, azimuth or bearing, and optional fields; SI and radians.
    """

    time: float
    fields: Mapping[str, FloatArray]


@dataclass(frozen=True)
class RecordedMotion:
    """Recorded position, velocity and attitude at one time.

    Attributes
    ----------
    time : float
        s.
    state : (4,) ndarray
        ``[x, vx, y, vy]``, x east and y north, m and m/s.
    yaw : float or None
        Heading, rad, counter-clockwise from east; None if not recorded.
    roll, pitch : float
        Attitude, rad, as in `tsepm_ros.own_ship.attitude`; 0 if not recorded.
    """

    time: float
    state: FloatArray
    yaw: float | None = None
    roll: float = 0.0
    pitch: float = 0.0


@dataclass(frozen=True)
class Recording:
    """A recording.

    Attributes
    ----------
    scans : list of RecordedScan
        In order of time.
    own_ship : list of RecordedMotion
        In order of time; empty if not recorded.
    targets : dict of int to list of RecordedMotion
        The truth, by target; empty if not recorded.
    """

    scans: list[RecordedScan]
    own_ship: list[RecordedMotion] = field(default_factory=list)
    targets: dict[int, list[RecordedMotion]] = field(default_factory=dict)

    @property
    def span(self) -> tuple[float, float]:
        """First and last recorded time, s."""
        times = [scan.time for scan in self.scans]
        times += [
            motion.time for path in (self.own_ship, *self.targets.values()) for motion in path
        ]
        return (min(times), max(times)) if times else (0.0, 0.0)


def read_recording(path: Path | str) -> Recording:
    """Read a recording.

    Parameters
    ----------
    path : path
        The folder, or its ``detections.csv``.

    Raises
    ------
    ValueError
        If a file is missing or malformed; the message names the file and the column or the line.
    """
    folder = Path(path)
    if folder.is_file():
        folder = folder.parent
    own_ship = _motion_table(folder / "own_ship.csv")
    targets = _motion_table(folder / "target.csv")
    # A bad range or angle affects one detection, which its reader drops; a bad time affects a scan.
    detections = _table(folder / "detections.csv", ("time_s", "range_m"), ("time_s", "scan"))
    return Recording(
        scans=_scans(detections, own_ship),
        own_ship=_motions(own_ship),
        targets=_targets(targets),
    )


Table = dict[str, FloatArray]


MOTION = ("time_s", "east_m", "north_m")
ATTITUDE = ("roll_rad", "pitch_rad")
FINITE_MOTION = (*MOTION, "east_mps", "north_mps", "heading_rad", *ATTITUDE, "scan", "target")


def _table(path: Path, required: tuple[str, ...], finite: tuple[str, ...]) -> Table:
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = [row for row in csv.reader(file) if row]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ValueError(f"{path.name} cannot be read: {error}") from None
    names = [name.strip() for name in rows[0]] if rows else []
    missing = [name for name in required if name not in names]
    if missing:
        raise ValueError(f"{path.name} has no column {missing[0]!r}; it has {shown(names)}")
    values = np.empty((len(rows) - 1, len(names)))
    for number, row in enumerate(rows[1:]):
        try:
            if len(row) != len(names):
                raise ValueError
            values[number] = [float(cell) for cell in row]
        except ValueError:
            raise ValueError(
                f"{path.name}, line {number + 2}: expected {len(names)} numbers, got {shown(row)}"
            ) from None
    for name in names:
        if name in finite and not np.isfinite(values[:, names.index(name)]).all():
            raise ValueError(f"{path.name}: {name} must be finite")
    return {name: values[:, column] for column, name in enumerate(names)}


def _motion_table(path: Path) -> Table | None:
    return _table(path, MOTION, FINITE_MOTION) if path.exists() else None


def _scans(detections: Table, own_ship: Table | None) -> list[RecordedScan]:
    if ("azimuth_rad" in detections) == ("bearing_rad" in detections):
        raise ValueError("detections.csv must have one of the columns azimuth_rad and bearing_rad")
    columns = {
        field: detections[name] for name, field in DETECTION_COLUMNS.items() if name in detections
    }
    key = detections.get("scan", detections["time_s"])
    scans = []
    for value in np.unique(key):
        rows = np.flatnonzero(key == value)
        fields = {field: column[rows] for field, column in columns.items()}
        scans.append(RecordedScan(float(detections["time_s"][rows[0]]), fields))
    if own_ship is not None and "scan" in own_ship and "scan" in detections:
        empty = ~np.isin(own_ship["scan"], key)
        no_detections = {field: np.zeros(0) for field in columns}
        scans += [RecordedScan(float(time), no_detections) for time in own_ship["time_s"][empty]]
    return sorted(scans, key=lambda scan: scan.time)


def _motions(table: Table | None) -> list[RecordedMotion]:
    if table is None:
        return []
    zero = np.zeros_like(table["time_s"])
    states = np.stack(
        [
            table["east_m"],
            table.get("east_mps", zero),
            table["north_m"],
            table.get("north_mps", zero),
        ],
        axis=1,
    )
    headings = table.get("heading_rad")
    yaws = [None] * len(zero) if headings is None else (math.pi / 2 - headings).tolist()
    attitudes = (table.get(name, zero).tolist() for name in ATTITUDE)
    motions = [
        RecordedMotion(*row)
        for row in zip(table["time_s"].tolist(), states, yaws, *attitudes, strict=True)
    ]
    return sorted(motions, key=lambda motion: motion.time)


def _targets(table: Table | None) -> dict[int, list[RecordedMotion]]:
    if table is None:
        return {}
    target = table.get("target", np.zeros_like(table["time_s"]))
    return {
        int(value): _motions({name: column[target == value] for name, column in table.items()})
        for value in np.unique(target)
    }
