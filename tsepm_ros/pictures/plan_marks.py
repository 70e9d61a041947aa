"""Marks of a plan-position picture: tracks, hits, truth, rings, own ship, fixed echoes."""

from __future__ import annotations

import math
from typing import Any

import matplotlib

from tsepm_ros.numerics.arrays import FloatArray

matplotlib.use("Agg")

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Ellipse
from matplotlib.path import Path as MarkerPath
from matplotlib.patheffects import withStroke

from tsepm_ros.kinematics.track import ConfirmedTrack

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
    colours = np.tile([*_rgb(INK_COLOUR), 1.0], (len(points), 1))
    colours[:, 3] = alpha
    axes.scatter(points[:, 0], points[:, 1], s=size, c=colours, linewidths=0)


def _rgb(colour: str) -> list[float]:
    return [int(colour[start : start + 2], 16) / 255.0 for start in (1, 3, 5)]


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


def draw_fixed_echoes(axes: Axes, points: FloatArray) -> None:
    """Draw fixed echoes, (n, 2) m."""
    axes.plot(*points.T, **_points(FIXED_COLOUR, "X", 6.0))


def draw_truth(axes: Axes, path: FloatArray) -> None:
    """Draw a target's way, (m, 2) m: a circle where it begins, a square where it ends."""
    axes.plot(*path.T, color=TRUTH_COLOUR, linewidth=2.4, alpha=0.6)
    axes.plot(*path[0], **_points(TRUTH_COLOUR, "o", 6.0, hollow=True))
    axes.plot(*path[-1], **_points(TRUTH_COLOUR, "s", 6.0))


def draw_true_place(axes: Axes, position: FloatArray) -> None:
    """Draw where a target is at one time, (2,) m."""
    axes.plot(*position, **_points(TRUTH_COLOUR, "D", 6.0, hollow=True))


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
    axes.plot(hits[:, 1], hits[:, 2], **_points(INK_COLOUR, "s", 6.5, hollow=True))


def _points(colour: str, marker: str, size: float, hollow: bool = False) -> dict[str, Any]:
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


def legend_points(
    colour: str, marker: Any, label: str, size: float, hollow: bool = False
) -> Line2D:
    """Return the legend entry of points."""
    return Line2D([], [], label=label, **_points(colour, marker, size, hollow))


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
