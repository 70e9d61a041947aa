"""A plan-position picture of a run: detections, truth and confirmed tracks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import matplotlib

from tsepm_ros.numerics.arrays import FloatArray

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse
from matplotlib.path import Path as MarkerPath
from matplotlib.patheffects import withStroke

from tsepm_ros.kinematics.track import ConfirmedTrack
from tsepm_ros.pictures.run_scene import RunScene, velocity_seconds
from tsepm_ros.whole_files import written_whole

ELLIPSE_FACTOR = 2.447746830680816
"""Axes of the 95 % ellipse of a bivariate Gaussian, in standard deviations."""

SHIP_OUTLINE = np.array([[0.0, 1.0], [0.6, -0.8], [0.0, -0.4], [-0.6, -0.8], [0.0, 1.0]])
"""Outline of the own ship's symbol, bow up."""

BACKGROUND_COLOUR, INK_COLOUR, TRUTH_COLOUR, TRACK_COLOUR, FAINT_COLOUR = (
    "#f7fafc",
    "#1a202c",
    "#2b6cb0",
    "#c05621",
    "#718096",
)


@dataclass
class PlanPicture:
    """Content of a plan-position picture, in the fixed frame, m.

    Attributes
    ----------
    title : str
    detections : list of (n, 2) ndarray
        Positions per scan, oldest first.
    truth : list of (m, 2) ndarray
        A path per target.
    on_target, off_target : list of ConfirmedTrack
        Tracks drawn in full; tracks drawn faintly.
    own_ship : (m, 3) ndarray, optional
        Path of the sensor: x, y (m) and heading (rad, nan if unknown).
    velocity_seconds : float
        Length of the velocity lines, s of travel.
    on_target_label, off_target_label : str
        Legend of the tracks, completed by their number; no entry if empty.
    """

    title: str
    detections: list[FloatArray] = field(default_factory=list)
    truth: list[FloatArray] = field(default_factory=list)
    on_target: list[ConfirmedTrack] = field(default_factory=list)
    off_target: list[ConfirmedTrack] = field(default_factory=list)
    own_ship: FloatArray | None = None
    velocity_seconds: float = 120.0
    on_target_label: str = "true starts (id, velocity, 95 % ellipse)"
    off_target_label: str = "false starts"


def picture_of(scene: RunScene) -> PlanPicture:
    """Return the picture of a whole run: every detection, every start, the truth where known."""
    seconds = velocity_seconds(scene)
    judged = scene.judged is not None
    return PlanPicture(
        title=scene.title,
        detections=[view.detections for view in scene.scans],
        truth=[path[:, 1:] for path in scene.truth],
        on_target=scene.starts_by(true=True),
        off_target=scene.starts_by(true=False),
        own_ship=scene.own_ship,
        velocity_seconds=seconds,
        on_target_label=f"{'true starts' if judged else 'new tracks'} "
        f"(id, velocity over {seconds:g} s, 95 % ellipse)",
        off_target_label="false, misplaced and redundant starts" if judged else "",
    )


def draw(picture: PlanPicture, insets: Sequence[FloatArray] = ()) -> Figure:
    """Draw the picture.

    Parameters
    ----------
    picture : PlanPicture
    insets : sequence of (2,) ndarray
        Points around which the scene is also drawn enlarged, up to four.

    Returns
    -------
    matplotlib.figure.Figure
    """
    columns = 2 if insets else 0
    rows = (len(insets) + 1) // 2 if insets else 1
    figure = plt.figure(figsize=(15.5 if columns else 9.5, 9.0), layout="constrained")
    grid = figure.add_gridspec(max(rows, 1), 2 + columns)
    main = figure.add_subplot(grid[:, :2])
    _scene(main, picture)
    main.set_title(picture.title, loc="left")
    main.legend(handles=_legend(picture), loc="upper right", framealpha=0.95, fontsize=9)
    reach = _inset_reach(picture, insets)
    for number, centre in enumerate(insets[:4]):
        axes = figure.add_subplot(grid[number // 2, 2 + number % 2])
        _scene(axes, picture, inset=True)
        low, high = centre - reach, centre + reach
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="", ylabel="")
        axes.set_title(f"target {number}", loc="left", fontsize=10)
    return figure


def save(picture: PlanPicture, path: Path, insets: Sequence[FloatArray] = ()) -> None:
    """Draw the picture into a file; the suffix gives the format."""
    figure = draw(picture, insets)
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        with written_whole(path) as temporary:
            figure.savefig(temporary, dpi=110)
    finally:
        plt.close(figure)


def _scene(axes: Axes, picture: PlanPicture, inset: bool = False) -> None:
    ages = np.linspace(0.12, 0.6, max(len(picture.detections), 1))
    for alpha, points in zip(ages, picture.detections, strict=False):
        axes.scatter(points[:, 0], points[:, 1], s=5, color=INK_COLOUR, alpha=alpha, linewidths=0)
    if picture.own_ship is not None:
        draw_own_ship(axes, picture.own_ship)
    for track in picture.off_target:
        draw_track(axes, track, picture.velocity_seconds, FAINT_COLOUR, 0.55, 0.7)
    for number, path in enumerate(picture.truth):
        axes.plot(*path.T, color=TRUTH_COLOUR, linewidth=2.2)
        axes.plot(*path[0], marker="o", color=TRUTH_COLOUR, markersize=4)
        if not inset:  # before the start of the path, clear of tracks
            _label(axes, f"target {number}", path[0], _direction(path[0] - path[-1]), TRUTH_COLOUR)
    for track in picture.on_target:
        draw_track(axes, track, picture.velocity_seconds, TRACK_COLOUR, 1.0, 1.6)
    style_plan(axes, "box" if inset else "datalim")


def draw_own_ship(axes: Axes, path: FloatArray) -> None:
    """Draw the own ship's path, (m, 3), and the ship at its end, a dot without a heading."""
    axes.plot(*path[:, :2].T, color=INK_COLOUR, linewidth=1.2)
    for x, y, heading in path[-1:].tolist():
        known = np.isfinite(heading)
        axes.plot(x, y, marker=ship(heading) if known else "o", color=INK_COLOUR, markersize=11)


def ship(heading: float) -> MarkerPath:
    """Return a marker that points to a heading, rad counter-clockwise from the x axis."""
    sine, cosine = np.sin(heading - np.pi / 2), np.cos(heading - np.pi / 2)
    return MarkerPath(SHIP_OUTLINE @ np.array([[cosine, sine], [-sine, cosine]]))


def style_plan(axes: Axes, adjustable: Literal["box", "datalim"]) -> None:
    """Set background, scale, labels and grid of a plan's axes."""
    axes.set_facecolor(BACKGROUND_COLOUR)
    axes.set_aspect("equal", adjustable=adjustable)
    axes.set(xlabel="east, m", ylabel="north, m")
    axes.grid(color="#e2e8f0", linewidth=0.6)
    axes.set_axisbelow(True)


def draw_track(
    axes: Axes,
    track: ConfirmedTrack,
    velocity_seconds: float,
    colour: str,
    alpha: float,
    width: float,
) -> None:
    """Draw a track: position, id, velocity over some seconds, and 95 % ellipse."""
    start = track.position
    end = start + track.velocity * velocity_seconds
    axes.plot([start[0], end[0]], [start[1], end[1]], color=colour, alpha=alpha, linewidth=width)
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
        )
    )
    # Abeam and outside the ellipse, clear of the velocity line and of the target's path.
    ahead = _direction(track.velocity)
    abeam = np.array([ahead[1], -ahead[0]]) * (1.0 if ahead[1] > 0 else -1.0)
    half = ELLIPSE_FACTOR * float(np.sqrt(abeam @ track.position_covariance @ abeam))
    _label(axes, str(track.track_id), start + half * abeam, abeam, colour, alpha)


def _direction(vector: FloatArray) -> FloatArray:
    """Unit vector; up for a zero vector."""
    length = float(np.hypot(*vector))
    return vector / length if length > 0 else np.array([0.0, 1.0])


def _label(
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
        fontsize=10,
        path_effects=[withStroke(linewidth=2.5, foreground=BACKGROUND_COLOUR)],
    )


def _legend(picture: PlanPicture) -> list[Line2D]:
    number = sum(len(points) for points in picture.detections)
    handles = [
        legend_dots(INK_COLOUR, f"detections, fading with age ({number})", markersize=3, alpha=0.6)
    ]
    if picture.own_ship is not None and len(picture.own_ship):
        handles.append(legend_own_ship())
    if picture.truth:
        handles.append(Line2D([], [], color=TRUTH_COLOUR, linewidth=2.2, label="truth"))
    tracks = Line2D([], [], color=TRACK_COLOUR, marker="o", markersize=4)
    tracks.set_label(f"{picture.on_target_label}: {len(picture.on_target)}")
    handles.append(tracks)
    if picture.off_target_label:
        tracks = Line2D([], [], color=FAINT_COLOUR, marker="o", markersize=2, alpha=0.7)
        tracks.set_label(f"{picture.off_target_label}: {len(picture.off_target)}")
        handles.append(tracks)
    return handles


def legend_own_ship() -> Line2D:
    """Return the legend entry of the own ship."""
    entry = legend_dots(INK_COLOUR, "own ship", markersize=11)
    entry.set_marker(ship(np.pi / 2))
    return entry


def legend_dots(colour: str, label: str, **style: Any) -> Line2D:
    """Return the legend entry of points."""
    return Line2D([], [], color=colour, marker="o", linestyle="", label=label, **style)


def _inset_reach(picture: PlanPicture, insets: Sequence[FloatArray]) -> float:
    """Half the width of an inset: wide enough for the paths and ellipses in it."""
    reach = 300.0
    for track in picture.on_target:
        reach = max(
            reach, 2.0 * ELLIPSE_FACTOR * float(np.sqrt(np.trace(track.position_covariance)))
        )
    for path in picture.truth:
        reach = max(reach, 0.9 * float(np.linalg.norm(path[-1] - path[0])))
    return reach
