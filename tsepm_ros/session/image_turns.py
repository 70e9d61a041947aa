"""Sonar images as they arrive: whole pings, or bearings that are joined to a turn or a pass.

A turn's bearings are put on a grid of even azimuths, since their number differs from turn to turn:
each in the nearest cell, and NaN where there is none. The grid is shifted by the part of a step by
which a turn's bearings lie beside it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.session.turn import MOST_PARTS, TURN, WHOLE_VIEW, Closing, Turn, TurnLearner
from tsepm_ros.tracker.scan import Arc, turned

CHANGED = 0.2
"""Relative change of the step, or of a sector's width, from which on the grid is another."""
WHOLE_GAP = 2.5
"""Steps, at most, that a whole turn lacks."""
NO_RANGES: FloatArray = np.zeros(0)


@dataclass(frozen=True, eq=False)
class ImagePing:
    """What a message says of a ping, or of some of its bearings.

    Attributes
    ----------
    stamp_ns : int
    frame_id : str
    range : (m,) ndarray
        m, ascending, above 0.
    azimuth : (b,) ndarray
        rad, from the sensor's x axis to port.
    intensity : (b, m) ndarray
    time_offset : (b,) ndarray or None
        Transmission of each bearing after the stamp, s.
    sound_speed : float
        m/s; 0 where the message states none.
    is_part : bool
        Whether the bearings are a part of a turn.
    assumptions : tuple of str
        Sentences about what the message does not state.
    """

    stamp_ns: int
    frame_id: str
    range: FloatArray
    azimuth: FloatArray
    intensity: NDArray[Any]
    time_offset: FloatArray | None = None
    sound_speed: float = 0.0
    is_part: bool = False
    assumptions: tuple[str, ...] = ()


class ImageTurns:
    """Joins the bearings of a turn, or of a pass over a sector, to one ping.

    The time of a turn is learned from the first: its bearings are not used.

    Attributes
    ----------
    unused : int
        Messages whose bearings are in no ping: of the first turn, or before a change of ranges.
    """

    def __init__(self) -> None:
        self.unused, self._parts = 0, list[ImagePing]()
        self._start_over()

    def add(self, ping: ImagePing) -> list[ImagePing]:
        """Take a message; returns the pings that are complete by it."""
        low, high = float(ping.azimuth.min()), float(ping.azimuth.max())
        if not ping.is_part or high - low >= WHOLE_VIEW:
            return [ping]
        arc, stamp = Arc(low, high - low, True), 1e-9 * ping.stamp_ns
        other = self._parts and not _same_cells(self._parts[-1], ping)
        back = self._turn is not None and stamp < self._turn.stamp
        if other or back or len(self._parts) >= MOST_PARTS:
            self._start_over()
        if self._turn is None:
            self._learn(ping, stamp, arc)
            return []
        closing = self._turn.take(stamp, arc)
        if closing is None:
            self._parts.append(ping)
            return []
        if closing is not Closing.FULL:
            self._turn.begin(stamp, arc)
        parts, self._parts = self._parts, [ping]
        if closing is Closing.BACK:  # the bearing where it turned is of both passes
            self._parts.insert(0, parts[-1])
        if len(parts) < 2:
            self.unused += 1
            return []
        return [self._joined(parts)]

    def _start_over(self) -> None:
        """Forget the bearings so far: the ranges, or the run, are others."""
        self.unused += len(self._parts)
        self._parts = []
        self._grid: tuple[float, float, int] | None = None  # begin and step, rad, and cells
        self._learner, self._turn = TurnLearner(), None  # type: tuple[TurnLearner, Turn | None]

    def _learn(self, ping: ImagePing, stamp: float, arc: Arc) -> None:
        self.unused += len(self._parts)
        self._parts = [ping]
        learned = self._learner.take(stamp, arc, NO_RANGES)
        if learned is not None:
            self._turn = Turn(learned.seconds)
            self._turn.begin(stamp, arc)

    def _joined(self, parts: Sequence[ImagePing]) -> ImagePing:
        """One ping of the bearings of parts, each at its own time."""
        first = parts[0]
        azimuth = np.unwrap(np.concatenate([one.azimuth for one in parts]))
        time = np.concatenate(
            [
                1e-9 * (one.stamp_ns - first.stamp_ns)
                + (0.0 if one.time_offset is None else one.time_offset) * np.ones(len(one.azimuth))
                for one in parts
            ]
        )
        begin, step, cells = self._grid_of(azimuth)
        place = (azimuth - begin) / step
        shift = float(np.angle(np.exp(2j * math.pi * place).mean())) / (2.0 * math.pi)
        whole = cells * step >= TURN - 1e-9
        row = np.rint(place - shift).astype(np.int64)
        row = row % cells if whole else np.clip(row, 0, cells - 1)
        image = np.full((cells, len(first.range)), np.nan, np.float32)
        image[row] = np.concatenate([one.intensity for one in parts])
        at = np.full(cells, np.nan)
        at[row] = time
        known = np.flatnonzero(np.isfinite(at))
        return replace(
            first,
            azimuth=np.asarray(begin + (np.arange(cells) + shift) * step, float),
            intensity=image,
            time_offset=np.interp(np.arange(cells), known, at[known]),
            is_part=False,
        )

    def _grid_of(self, azimuth: FloatArray) -> tuple[float, float, int]:
        """Begin, step (rad) and cells of the grid: those before, where they fit."""
        low, high = float(azimuth.min()), float(azimuth.max())
        least = (high - low) / (4.0 * len(azimuth))  # else a grid of any size
        step = max(float(np.median(np.abs(np.diff(azimuth)))), least) or 1e-3
        whole = high - low >= TURN - WHOLE_GAP * step
        if self._grid is not None:
            begin, before, cells = self._grid
            end, margin = begin + (cells - 1) * before, 0.5 * before
            within = whole or (low >= begin - margin and high <= end + margin)
            wide = whole or high - low >= (1.0 - CHANGED) * (end - begin)
            if abs(step - before) <= CHANGED * before and within and wide:
                return self._grid
        cells = round(TURN / step) if whole else round((high - low) / step) + 1
        self._grid = (
            (-math.pi, TURN / cells, cells) if whole else (turned(low), step, max(cells, 2))
        )
        return self._grid


def _same_cells(one: ImagePing, other: ImagePing) -> bool:
    """Whether two messages have the same ranges and frame."""
    return one.frame_id == other.frame_id and np.array_equal(one.range, other.range)
