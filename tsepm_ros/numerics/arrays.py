"""Arrays: their types, tables of equal length, and limits of number and time.

Names of array types: numbers, indices, masks.

Tables: arrays of equal length whose rows belong together.

Limits of number and time: the rows of least cost, and the time of a scan.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

BoolArray = NDArray[np.bool_]
FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

T = TypeVar("T")


def changed(table: T, **columns: Any) -> T:
    """A table (a dataclass without slots) with other columns, or parts.

    As `dataclasses.replace`, without a constructor: a tenth of the time.
    """
    if not columns.keys() <= table.__dict__.keys():
        raise TypeError(f"{type(table).__name__} has no {set(columns) - set(table.__dict__)}")
    new = object.__new__(type(table))
    new.__dict__.update(table.__dict__, **columns)
    return new


def indices(rows: NDArray[np.generic]) -> NDArray[Any]:
    """Rows as indices, given as indices or a mask: several columns take them faster."""
    return rows.nonzero()[0] if rows.dtype == bool else rows


def taken(records: NDArray[np.void], rows: NDArray[np.generic]) -> NDArray[np.void]:
    """Rows of a structured array, as ``records[rows]``: indices of any shape, or a mask (n,).

    Whole records are copied; ``[]`` copies field by field, which takes over ten times as long.
    """
    return records.take(indices(rows), axis=0)


def with_rows(table: T, rows: IntArray, **values: Any) -> T:
    """A table with other values in some rows: of columns, or of the columns of tables in it."""
    columns: dict[str, Any] = {}
    for name, value in values.items():
        column = table.__dict__[name]
        if isinstance(column, np.ndarray):
            columns[name] = column.copy()
            columns[name][rows] = value
        else:
            columns[name] = with_rows(column, rows, **value.__dict__)
    return changed(table, **columns)


@dataclass(frozen=True)
class Rows:
    """Columns of equal length, the fields of a subclass: arrays, or tables of such columns."""

    def __len__(self) -> int:
        """Number of rows."""
        return len(next(iter(self.__dict__.values())))

    def __getitem__(self, rows: NDArray[np.generic] | slice) -> Self:
        """The given rows: indices, a mask, or a slice, which is a view."""
        row = rows if isinstance(rows, slice) else indices(rows)
        new, columns = object.__new__(type(self)), self.__dict__
        for name in self.__dataclass_fields__:
            column = columns[name]
            new.__dict__[name] = (
                column.take(row, axis=0)
                if isinstance(column, np.ndarray) and not isinstance(row, slice)
                else column[row]
            )
        return new

    @classmethod
    def joined(cls, *parts: Self) -> Self:
        """The rows of all parts, in order."""
        if len(parts) == 1:
            return parts[0]
        columns = {}
        for name in cls.__dataclass_fields__:
            of = [getattr(part, name) for part in parts]
            array = isinstance(of[0], np.ndarray)
            columns[name] = np.concatenate(of) if array else type(of[0]).joined(*of)
        return cls(**columns)

    @classmethod
    def placed(
        cls, number: int, *parts: tuple[Self, IntArray | None, NDArray[np.integer] | slice]
    ) -> Self:
        """A number of rows: of each part the given ones, or all, at their places."""
        columns = []
        for name in cls.__dataclass_fields__:
            values = [getattr(table, name) for table, _, _ in parts]
            column = np.empty((number, *values[0].shape[1:]), values[0].dtype)
            for value, (_, rows, place) in zip(values, parts, strict=True):
                column[place] = value if rows is None else value.take(rows, axis=0)
            columns.append(column)
        return cls(*columns)


def keep_best(cost: NDArray[np.float64], limit: int) -> NDArray[np.int64]:
    """Rows of the `limit` smallest costs, in ascending order of rows.

    Ties are kept in the order of their rows: the choice is the same on every machine.

    Parameters
    ----------
    cost : (n,) ndarray
        Smaller is better.
    limit : int
        Number to keep, at least 1.
    """
    if len(cost) <= limit:
        return np.arange(len(cost))
    largest_kept = np.partition(cost, limit - 1)[limit - 1]
    kept = cost < largest_kept
    ties = np.flatnonzero(cost == largest_kept)
    kept[ties[: limit - np.count_nonzero(kept)]] = True
    return np.flatnonzero(kept)


class TimeLimit:
    """Limit of the processing time of a scan.

    Parameters
    ----------
    seconds : float
        Time from now on, s; infinite: no limit.
    """

    def __init__(self, seconds: float = math.inf) -> None:
        self.seconds = seconds
        self._begin = time.perf_counter()

    @property
    def finite(self) -> bool:
        """Whether the time is limited."""
        return self.seconds < math.inf

    @property
    def elapsed(self) -> float:
        """Time used so far, s."""
        return time.perf_counter() - self._begin

    def used(self, share: float) -> bool:
        """Whether a share of the time is over; never without a limit."""
        return self.elapsed > share * self.seconds

    @property
    def left(self) -> float:
        """Time left, s; negative once the limit is exceeded."""
        return self.seconds - self.elapsed
