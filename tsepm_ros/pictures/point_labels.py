"""Labels of the points of a picture, without overlap. Needs matplotlib."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patheffects import withStroke
from matplotlib.text import Annotation, Text
from matplotlib.transforms import Bbox

POINTS_PER_INCH = 72.0
LABEL_DISTANCES = (9.0, 15.0, 22.0, 30.0, 40.0, 50.0)
"""Candidate distances of a label from its point, typographic points."""
LABEL_ANGLES = np.radians([40.0, -40.0, 140.0, -140.0, 90.0, -90.0, 65.0, -65.0, 115.0, -115.0])
MARKER_RADIUS = 4.0
"""Half the width of a marker, pixels."""


class PointLabel(NamedTuple):
    """A text for a point in data coordinates."""

    text: str
    x: float
    y: float
    colour: str


def label_points(axes: Axes, labels: Sequence[PointLabel]) -> None:
    """Write a text beside each point without overlap, with a line to the point.

    Parameters
    ----------
    axes : Axes
        Axes of an Agg figure that is otherwise complete.
    labels : sequence of PointLabel
    """
    canvas: Any = axes.figure.canvas
    root: Any = axes.get_figure()
    root.draw_without_rendering()
    renderer = canvas.get_renderer()
    frame = axes.get_window_extent()
    occupied = [_around(*axes.transData.transform((label.x, label.y))) for label in labels]
    for label in labels:
        note = axes.annotate(
            label.text,
            (label.x, label.y),
            textcoords="offset points",
            xytext=(0.0, 0.0),
            ha="center",
            va="center",
            fontsize=8,
            color=label.colour,
            path_effects=[withStroke(linewidth=2.0, foreground="white")],
            arrowprops={"arrowstyle": "-", "color": label.colour, "alpha": 0.4, "linewidth": 0.6},
        )
        note.set_in_layout(False)
        occupied.append(_place(note, occupied, frame, renderer))


def _place(note: Annotation, occupied: Sequence[Bbox], frame: Bbox, renderer: Any) -> Bbox:
    """Move a label to the first free position inside the frame, otherwise to the last."""
    box = Text.get_window_extent(note)
    half_width = 0.5 * box.width * POINTS_PER_INCH / note.figure.dpi
    for offset in _offsets(half_width):
        note.set_position(offset)
        note.update_positions(renderer)
        box = Text.get_window_extent(note)  # without the line
        inside = frame.contains(box.x0, box.y0) and frame.contains(box.x1, box.y1)
        if inside and not box.count_overlaps(occupied):
            break
    return box


def _offsets(half_width: float) -> Iterator[tuple[float, float]]:
    """Candidate positions of a text's centre relative to its point."""
    for distance in LABEL_DISTANCES:
        for angle in LABEL_ANGLES:
            along, up = float(np.cos(angle)), float(np.sin(angle))
            yield along * (distance + half_width), up * distance


def _around(x: float, y: float) -> Bbox:
    return Bbox.from_extents(
        x - MARKER_RADIUS, y - MARKER_RADIUS, x + MARKER_RADIUS, y + MARKER_RADIUS
    )
