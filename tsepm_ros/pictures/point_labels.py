"""Labels beside the points of a picture that do not lie on each other. Needs matplotlib."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patheffects import withStroke
from matplotlib.text import Annotation, Text
from matplotlib.transforms import Bbox

POINTS_PER_INCH = 72.0
DISTANCES = (9.0, 15.0, 22.0, 30.0, 40.0, 50.0)
"""Distances from its point at which a label is tried, points."""
ANGLES = np.radians([40.0, -40.0, 140.0, -140.0, 90.0, -90.0, 65.0, -65.0, 115.0, -115.0])
CLEAR = 4.0
"""What a marker takes around its centre, pixels."""


class PointLabel(NamedTuple):
    """A text for a point in data coordinates."""

    text: str
    x: float
    y: float
    colour: str


def label_points(axes: Axes, labels: Sequence[PointLabel]) -> None:
    """Write a text beside each point, where there is room, with a line to the point.

    Parameters
    ----------
    axes : Axes
        Of an Agg figure that is complete but for this.
    labels : sequence of PointLabel
    """
    canvas: Any = axes.figure.canvas
    canvas.draw()
    renderer = canvas.get_renderer()
    frame = axes.get_window_extent()
    taken = [_around(*axes.transData.transform((label.x, label.y))) for label in labels]
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
        taken.append(_place(note, taken, frame, renderer))


def _place(note: Annotation, taken: Sequence[Bbox], frame: Bbox, renderer: Any) -> Bbox:
    """Move a label to the first place that is free and inside the frame, or else the last."""
    box = Text.get_window_extent(note)
    half_width = 0.5 * box.width * POINTS_PER_INCH / note.figure.dpi
    for offset in _offsets(half_width):
        note.set_position(offset)
        note.update_positions(renderer)
        box = Text.get_window_extent(note)  # without the line
        inside = frame.contains(box.x0, box.y0) and frame.contains(box.x1, box.y1)
        if inside and not box.count_overlaps(taken):
            break
    return box


def _offsets(half_width: float) -> Iterator[tuple[float, float]]:
    """Where a text of some width may have its middle, beside the point or above and below it."""
    for distance in DISTANCES:
        for angle in ANGLES:
            along, up = float(np.cos(angle)), float(np.sin(angle))
            yield along * (distance + half_width), up * distance


def _around(x: float, y: float) -> Bbox:
    return Bbox.from_extents(x - CLEAR, y - CLEAR, x + CLEAR, y + CLEAR)
