"""The report of a reproduction: texts, tables and pictures, as Markdown, CSV and PNG."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tsepm_ros.tools.evaluation.intervals import Estimate
from tsepm_ros.tools.terminal import markdown_table
from tsepm_ros.whole_files import opened_whole, write_text, written_whole

Cell = str | int | float | Estimate
DOTS_PER_INCH = 100


@dataclass(frozen=True)
class Column:
    """A column of a table.

    Attributes
    ----------
    heading : str
    spec : str
        Number format of its cells.
    """

    heading: str
    spec: str = ""

    def text(self, cell: Cell) -> str:
        """Text of a cell, a dash for nan."""
        if isinstance(cell, str):
            return cell.replace("|", "\\|")
        if isinstance(cell, Estimate):
            return cell.text(self.spec)
        return "-" if math.isnan(cell) else format(cell, self.spec)


@dataclass(frozen=True)
class Table:
    """A table in the report, also written as a CSV file.

    Attributes
    ----------
    name : str
        Name of its file, without suffix.
    columns : sequence of Column
    rows : sequence of sequence of Cell
    """

    name: str
    columns: Sequence[Column]
    rows: Sequence[Sequence[Any]]

    def markdown(self) -> str:
        """The table in Markdown."""
        rows = [
            [column.text(cell) for column, cell in zip(self.columns, row, strict=True)]
            for row in self.rows
        ]
        return markdown_table([column.heading for column in self.columns], rows)

    def write_csv(self, path: Path) -> None:
        """Write the numbers; a number with an interval has three columns."""
        has_interval = [
            any(isinstance(row[index], Estimate) for row in self.rows)
            for index in self._column_indices
        ]
        with opened_whole(path) as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(
                heading
                for index in self._column_indices
                for heading in _headings(self.columns[index].heading, has_interval[index])
            )
            for row in self.rows:
                writer.writerow(
                    value
                    for index in self._column_indices
                    for value in _values(row[index], has_interval[index])
                )

    @property
    def _column_indices(self) -> range:
        return range(len(self.columns))


def _headings(heading: str, has_interval: bool) -> list[str]:
    return [heading, f"{heading}, low", f"{heading}, high"] if has_interval else [heading]


def _values(cell: Cell, has_interval: bool) -> list[str | float]:
    if isinstance(cell, Estimate):
        return [cell.value, cell.low, cell.high]
    return [cell, "", ""] if has_interval else [cell]


@dataclass(frozen=True)
class Picture:
    """A picture.

    Attributes
    ----------
    name : str
        Name of its file, without suffix.
    caption : str
    draw : callable
        Draws it on an empty matplotlib figure.
    size : (float, float)
        Width and height, inches.
    """

    name: str
    caption: str
    draw: Callable[[Any], None]
    size: tuple[float, float] = (9.0, 4.5)


Part = str | Table | Picture
"""A part of a chapter; a text is a paragraph in Markdown."""


def write(parts: Sequence[Part], report: Path) -> list[Path]:
    """Write a report, and its tables and pictures beside it.

    Parameters
    ----------
    parts : sequence of Part
    report : Path
        The report's file.

    Returns
    -------
    list of Path
        All written files. Without matplotlib the report has a note in place of each picture.
    """
    report.parent.mkdir(parents=True, exist_ok=True)
    texts, written = [], [report]
    for part in parts:
        if isinstance(part, Table):
            texts.append(part.markdown())
            written.append(report.parent / f"{part.name}.csv")
            part.write_csv(written[-1])
        elif isinstance(part, Picture):
            path = report.parent / f"{part.name}.png"
            drawn = _draw(part, path)
            written += [path] * drawn
            texts.append(_picture_text(part, path, drawn))
        else:
            texts.append(part)
    write_text(report, "\n\n".join(texts) + "\n")
    return written


def _picture_text(picture: Picture, path: Path, drawn: bool) -> str:
    if drawn:
        return f"![{picture.caption}]({path.name})\n\n*{picture.caption}*"
    return f"*{picture.caption}: not drawn, since it needs matplotlib (the extra plot)*"


def _draw(picture: Picture, path: Path) -> bool:
    """Draw a picture, if matplotlib is installed; returns whether it was drawn."""
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError:
        return False
    figure = Figure(figsize=picture.size, layout="constrained")
    FigureCanvasAgg(figure)
    picture.draw(figure)
    with written_whole(path) as temporary:
        figure.savefig(temporary, dpi=DOTS_PER_INCH)
    return True
