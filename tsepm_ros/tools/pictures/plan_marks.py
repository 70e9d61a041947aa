"""Marks, labels and layout of plan-position pictures; needs matplotlib.

The layout is the whole plan, and beside it each target enlarged.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba_array
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Ellipse, Rectangle
from matplotlib.path import Path as MarkerPath
from matplotlib.patheffects import withStroke
from matplotlib.text import Annotation, Text
from matplotlib.transforms import Bbox

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.tools.pictures.run_scene import RunScene, target_name
from tsepm_ros.tracker.tracks import ConfirmedTrack

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
    points = (axes.transData.transform((label.x, label.y)) for label in labels)
    radius = MARKER_RADIUS
    occupied = [Bbox.from_extents(*(point - radius), *(point + radius)) for point in points]
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


matplotlib.use("Agg")


ELLIPSE_FACTOR = 2.447746830680816
"""Axes of the 95 % ellipse of a bivariate Gaussian, in standard deviations."""

SHIP_OUTLINE = np.array([[0.0, 1.0], [0.6, -0.8], [0.0, -0.4], [-0.6, -0.8], [0.0, 1.0]])
"""Outline of the own ship's symbol, bow up."""

BACKGROUND_COLOUR, INK_COLOUR, TRUTH_COLOUR, TRACK_COLOUR, FAINT_COLOUR, FIXED_COLOUR = (
    "#f7fafc",
    "#1a202c",
    "#2b6cb0",
    "#c05621",
    "#718096",
    "#2f855a",
)
COASTING_LINE: Any = (0, (3.0, 1.5))
"""Line style of a track that coasts, dashed."""
RINGS = 4
"""Range rings up to the edge of the picture, about."""


def style_plan(axes: Axes, limits: FloatArray) -> None:
    """Set background, scale, labels, grid and limits, (2, 2) m, of a plan's axes."""
    axes.set_facecolor(BACKGROUND_COLOUR)
    axes.set_aspect("equal", adjustable="box")
    axes.set(xlim=limits[0], ylim=limits[1], xlabel="east, m", ylabel="north, m")
    axes.grid(color="#e2e8f0", linewidth=0.6)
    axes.set_axisbelow(True)


def draw_detections(axes: Axes, points: FloatArray, alpha: FloatArray, size: float) -> None:
    """Draw detections, (n, 2) m, with an opacity each."""
    colours = to_rgba_array([INK_COLOUR] * len(points), alpha)
    axes.scatter(points[:, 0], points[:, 1], s=size, c=colours, linewidths=0)


def draw_rings(axes: Axes, centre: FloatArray, limits: FloatArray) -> None:
    """Draw range rings round the sonar, with their ranges, as far as the limits, (2, 2) m."""
    corners = np.array([[x, y] for x in limits[0] for y in limits[1]]) - centre
    reach = 0.75 * float(np.hypot(*corners.T).max())
    step = _round_step(reach / RINGS)
    for number in range(1, math.ceil(1.4 * reach / step)):
        radius = number * step
        axes.add_patch(
            Circle(
                (float(centre[0]), float(centre[1])),
                radius,
                facecolor="none",
                edgecolor="#a0aec0",
                linewidth=0.7,
                zorder=0.6,
            )
        )
        label = f"{radius / 1000:g} km" if step >= 500.0 else f"{radius:g} m"
        axes.text(
            float(centre[0]),
            float(centre[1] + radius),
            label,
            color=FAINT_COLOUR,
            fontsize=8,
            ha="center",
            va="center",
            clip_on=True,
            path_effects=[withStroke(linewidth=2.5, foreground=BACKGROUND_COLOUR)],
        )


def _round_step(wanted: float) -> float:
    """The largest of 1, 2, 5, 10, ... that is at most the wanted step."""
    decade = 10.0 ** math.floor(math.log10(max(wanted, 1e-9)))
    return decade * max(part for part in (1.0, 2.0, 5.0) if part * decade <= wanted * 1.0001)


def draw_own_ship(axes: Axes, path: FloatArray) -> None:
    """Draw the own ship's way, (m, 3), and the ship at its end, a dot without a heading."""
    axes.plot(*path[:, :2].T, color=INK_COLOUR, linewidth=1.2)
    for x, y, heading in path[-1:].tolist():
        known = np.isfinite(heading)
        axes.plot(x, y, marker=ship(heading) if known else "o", color=INK_COLOUR, markersize=11)


def ship(heading: float) -> MarkerPath:
    """Return a marker that points to a heading, rad counter-clockwise from the x axis."""
    sine, cosine = np.sin(heading - np.pi / 2), np.cos(heading - np.pi / 2)
    return MarkerPath(SHIP_OUTLINE @ np.array([[cosine, sine], [-sine, cosine]]))


def draw_truth(axes: Axes, path: FloatArray) -> None:
    """Draw a target's way, (m, 2) m: a circle where it begins, a square where it ends."""
    axes.plot(*path.T, color=TRUTH_COLOUR, linewidth=2.4, alpha=0.6)
    axes.plot(*path[0], **points(TRUTH_COLOUR, "o", 6.0, hollow=True))
    axes.plot(*path[-1], **points(TRUTH_COLOUR, "s", 6.0))


def draw_trail(axes: Axes, way: FloatArray, colour: str = TRACK_COLOUR) -> None:
    """Draw the way of a held track, see `RunScene.ways`: dashed where it coasts."""
    for line, left_out in ((COASTING_LINE, False), ("-", way[:, 2] > 0.0)):
        axes.plot(
            *np.where(left_out, np.nan, way[:, :2].T),
            color=colour,
            linewidth=1.5,
            alpha=0.8,
            linestyle=line,
        )


def draw_hits(axes: Axes, hits: FloatArray) -> None:
    """Draw the hits of a start, (m, 3): number of the scan, x, y. A line joins them in order."""
    axes.plot(hits[:, 1], hits[:, 2], color=INK_COLOUR, linewidth=0.7, alpha=0.5)
    axes.plot(hits[:, 1], hits[:, 2], **points(INK_COLOUR, "s", 6.5, hollow=True))


def points(colour: str, marker: Any, size: float, hollow: bool = False) -> dict[str, Any]:
    """Style of points without a line."""
    style = {"color": colour, "marker": marker, "markersize": size, "linestyle": ""}
    return {**style, "markerfacecolor": "white" if hollow else colour}


def draw_track(
    axes: Axes,
    track: ConfirmedTrack,
    velocity_seconds: float,
    colour: str,
    alpha: float,
    width: float,
) -> None:
    """Draw a track: position, id, velocity over some seconds as an arrow, and 95 % ellipse.

    Arrow and ellipse are dashed while the track coasts, without a detection in its scan.
    """
    line: Any = COASTING_LINE if track.time_since_hit > 0.0 else "-"
    start = track.position
    end = start + track.velocity * velocity_seconds
    style = {"arrowstyle": "-|>", "color": colour, "alpha": alpha, "linewidth": width, "ls": line}
    axes.annotate(
        "",
        xy=(float(end[0]), float(end[1])),
        xytext=(float(start[0]), float(start[1])),
        arrowprops={**style, "shrinkA": 0.0, "shrinkB": 0.0, "mutation_scale": 6.0 + 4.0 * width},
        annotation_clip=True,
    )
    axes.plot(*start, marker="o", color=colour, alpha=alpha, markersize=2.5 * width)
    values, vectors = np.linalg.eigh(track.position_covariance)
    axes.add_patch(
        Ellipse(
            (float(start[0]), float(start[1])),
            *(2 * ELLIPSE_FACTOR * np.sqrt(np.maximum(values, 0.0))),
            angle=float(np.degrees(np.arctan2(vectors[1, 0], vectors[0, 0]))),
            facecolor="none",
            edgecolor=colour,
            alpha=alpha,
            linewidth=width,
            linestyle=line,
        )
    )
    # Abeam and outside the ellipse, clear of the velocity arrow and of the target's way.
    ahead = direction(track.velocity)
    abeam = np.array([ahead[1], -ahead[0]]) * (1.0 if ahead[1] > 0 else -1.0)
    half = ELLIPSE_FACTOR * float(np.sqrt(abeam @ track.position_covariance @ abeam))
    write_beside(axes, str(track.track_id), start + half * abeam, abeam, colour, alpha)


def direction(vector: FloatArray) -> FloatArray:
    """Unit vector; up for a zero vector."""
    length = float(np.hypot(*vector))
    return vector / length if length > 0 else np.array([0.0, 1.0])


def write_beside(
    axes: Axes, text: str, at: FloatArray, away: FloatArray, colour: str, alpha: float = 1.0
) -> None:
    """Write a text beside a point, in the direction of a unit vector from it."""
    side = "left" if away[0] > 0.3 else "right" if away[0] < -0.3 else "center"
    axes.annotate(
        text,
        (float(at[0]), float(at[1])),
        tuple((7.0 * away).tolist()),
        textcoords="offset points",
        ha=side,
        va="center" if side != "center" else "bottom" if away[1] > 0 else "top",
        color=colour,
        alpha=alpha,
        fontsize=11,
        fontweight="bold",
        annotation_clip=True,
        path_effects=[withStroke(linewidth=2.5, foreground=BACKGROUND_COLOUR)],
    )


FIXED_ECHOES = points(FIXED_COLOUR, "X", 6.0)
TRUE_PLACE = points(TRUTH_COLOUR, "D", 6.0, hollow=True)
"""Style of fixed echoes, and of where a target is at one time."""


def legend_points(
    colour: str, marker: Any, label: str, size: float, hollow: bool = False
) -> Line2D:
    """Return the legend entry of points."""
    return Line2D([], [], label=label, **points(colour, marker, size, hollow))


def legend_line(colour: str, label: str, **style: Any) -> Line2D:
    """Return the legend entry of a line."""
    return Line2D([], [], color=colour, label=label, **style)


def legend_sonar(path: FloatArray) -> Line2D:
    """Return the legend entry of the sonar: own ship with its way if it moves, else a place."""
    heading = len(path) > 0 and bool(np.isfinite(path[-1, 2]))
    marker = ship(np.pi / 2) if heading else "o"
    if len(path) and np.ptp(path[:, :2], axis=0).any():
        entry = legend_points(INK_COLOUR, marker, "own ship and its way", 10.0)
        entry.set_linestyle("-")
        return entry
    return legend_points(INK_COLOUR, marker, "sonar", 10.0)


MAX_PANELS = 4
PANEL_MARGIN = 1.15
MIN_PANEL = 0.03
"""Smallest width of an enlarged part, as a part of the plan."""
MARGIN = 0.03
"""Space around the data, as a part of its extent."""


@dataclass
class PlanLayout:
    """Axes of a picture and what each of them shows.

    Attributes
    ----------
    figure : Figure
    plan : Axes
        The whole plan.
    limits : (2, 2) ndarray
        Limits of the plan: of x and of y, m.
    panels : dict of int to Axes
        The enlarged targets, by their index.
    panel_limits : dict of int to (2, 2) ndarray
    """

    figure: Figure
    plan: Axes
    limits: FloatArray
    panels: dict[int, Axes]
    panel_limits: dict[int, FloatArray]

    @classmethod
    def of(cls, scene: RunScene) -> PlanLayout:
        """Lay out the picture of a run: the first four targets are enlarged, if judged."""
        limits = plan_limits(scene)
        size = limits[:, 1] - limits[:, 0]
        targets = range(len(scene.insets[:MAX_PANELS]))
        plan_width = 8.6 if targets else 9.5
        height = float(np.clip(plan_width * size[1] / size[0], 4.0, 11.0))
        columns = (len(targets) + 1) // 2
        width = plan_width + 0.5 * height * columns
        figure = plt.figure(figsize=(width, height + 1.4), layout="constrained")
        ratios = [plan_width, *[0.5 * height] * columns]
        rows = min(len(targets), 2) or 1
        grid = figure.add_gridspec(rows, 1 + columns, width_ratios=ratios)
        return cls(
            figure,
            figure.add_subplot(grid[:, 0]),
            limits,
            {
                target: figure.add_subplot(grid[target // columns, 1 + target % columns])
                for target in targets
            },
            {target: _panel_limits(scene, target, limits) for target in targets},
        )

    def style(self, titles: dict[int, str]) -> None:
        """Set limits, grids and the panels' titles, and mark the enlarged parts in the plan."""
        style_plan(self.plan, self.limits)
        for target, axes in self.panels.items():
            limits = self.panel_limits[target]
            style_plan(axes, limits)
            axes.set_xlabel("east, m", fontsize=8)
            axes.set_ylabel("north, m", fontsize=8)
            axes.tick_params(labelsize=8)
            axes.locator_params(nbins=5)
            axes.set_title(titles[target], loc="left", fontsize=10)
            (x, _), (y, top) = limits.tolist()
            width = float(np.ptp(limits[0]))
            frame = Rectangle((x, y), width, width, fill=False, color=FAINT_COLOUR, linewidth=0.9)
            self.plan.add_patch(frame)
            corner = np.array([x + 0.5 * width, top])
            write_beside(
                self.plan, f"target {target_name(target)}", corner, np.array([0.0, 1.0]), "#2b6cb0"
            )

    def axes(self) -> Iterator[tuple[Axes, bool]]:
        """Every axes, and whether it is an enlarged part."""
        yield self.plan, False
        yield from ((axes, True) for axes in self.panels.values())

    def headline(self, text: str, below: str) -> None:
        """Write the result in large letters, and a line below it."""
        self.figure.suptitle(text, x=0.01, ha="left", fontsize=16, fontweight="bold")
        self.plan.set_title(below, loc="left", fontsize=10)


def plan_limits(scene: RunScene) -> FloatArray:
    """Limits around all points, (2, 2) m: x and y; neither is much narrower."""
    points = [view.detections for view in scene.scans] + [path[:, 1:] for path in scene.truth]
    points += [np.reshape(view.held.state[:, 0::2], (-1, 2)) for view in scene.scans]
    everything = np.concatenate([*points, scene.own_ship[:, :2], np.zeros((0, 2))])
    if not len(everything):
        return np.array([[-1.0, 1.0], [-1.0, 1.0]])
    low, high = everything.min(axis=0), everything.max(axis=0)
    extent = np.maximum(high - low, 0.4 * float((high - low).max()) or 1.0)
    half = (0.5 + MARGIN) * extent
    middle = 0.5 * (low + high)
    return np.stack([middle - half, middle + half], axis=1)


def _panel_limits(scene: RunScene, target: int, plan: FloatArray) -> FloatArray:
    """A square around a target's way, its true start with ellipse and hits, and its trail."""
    points = [scene.truth[target][:, 1:]]
    start = scene.true_starts.get(target)
    if start is not None:
        track = start.track
        sigma = ELLIPSE_FACTOR * np.sqrt(np.diag(track.position_covariance))
        points += [track.position + sigma, track.position - sigma]
        points += [scene.hits[track.track_id][:, 1:], scene.trails()[track.track_id]]
    everything = np.concatenate([np.reshape(part, (-1, 2)) for part in points])
    low, high = everything.min(axis=0), everything.max(axis=0)
    least = MIN_PANEL * float(np.ptp(plan, axis=1).max())
    half = 0.5 * max(least, PANEL_MARGIN * float((high - low).max()))
    middle = 0.5 * (low + high)
    return np.stack([middle - half, middle + half], axis=1)
