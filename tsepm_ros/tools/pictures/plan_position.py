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
"""Plan-position picture of a run: why each track was started, and what became of it.

Where the starts are judged by truth, the first targets are enlarged beside the plan. It needs
matplotlib.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba_array
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Ellipse, Rectangle
from matplotlib.path import Path as MarkerPath
from matplotlib.patheffects import withStroke
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.tools.pictures.run_scene import (
    RunScene,
    scene_headline,
    scene_target_name,
    scene_velocity_seconds,
)
from tsepm_ros.tracker.tracks import ConfirmedTrack
from tsepm_ros.whole_files import write_whole_picture

HITS_SHOWN = 12
"""Largest number of starts of a picture without panels whose hits are drawn."""
MAX_PANELS = 4
PANEL_MARGIN = 1.15
MIN_PANEL = 0.03
"""Smallest width of an enlarged part, as a part of the plan."""
MARGIN = 0.03
"""Space around the data, as a part of its extent."""
RINGS = 4
"""Range rings up to the edge of the picture, about."""

POINTS_PER_INCH = 72.0
LABEL_DISTANCES = (9.0, 15.0, 22.0, 30.0, 40.0, 50.0)
"""Candidate distances of a label from its point, typographic points."""
LABEL_ANGLES = np.radians([40.0, -40.0, 140.0, -140.0, 90.0, -90.0, 65.0, -65.0, 115.0, -115.0])
MARKER_RADIUS = 4.0
"""Half the width of a marker, pixels."""

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
MISSED_LINE: Any = (0, (3.0, 1.5))
"""Line style of a track without a detection, dashed."""


class PointLabel(NamedTuple):
    """A text for a point in data coordinates."""

    text: str
    x: float
    y: float
    colour: str


def label_points(axes: Axes, labels: Sequence[PointLabel]) -> None:
    """Write a text beside each point without overlap, with a line to the point.

    A text is at the first free candidate inside the frame, otherwise at the last one.

    Parameters
    ----------
    axes : Axes
        Axes of a figure that is otherwise complete.
    labels : sequence of PointLabel
    """
    figure: Any = axes.get_figure()
    figure.draw_without_rendering()
    frame, scale = axes.get_window_extent(), figure.dpi / POINTS_PER_INCH
    points = [axes.transData.transform((label.x, label.y)) for label in labels]
    occupied = [Bbox([point - MARKER_RADIUS, point + MARKER_RADIUS]) for point in points]
    distances, angles = np.repeat(LABEL_DISTANCES, len(LABEL_ANGLES)), LABEL_ANGLES
    directions = np.tile([np.cos(angles), np.sin(angles)], len(LABEL_DISTANCES)).T
    for label, point in zip(labels, points, strict=True):
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
        half = 0.5 * np.array(Text.get_window_extent(note).size)  # without the line
        reaches = np.stack([distances + half[0] / scale, distances], axis=1)
        for offset in directions * reaches:
            centre = point + scale * offset
            box = Bbox([centre - half, centre + half])
            inside = frame.contains(*box.min) and frame.contains(*box.max)
            if inside and not box.count_overlaps(occupied):
                break
        note.set_position(offset)
        occupied.append(box)


def draw(scene: RunScene) -> Figure:
    """Draw a whole run: detections, truth, starts with their hits, confirmed tracks as trails.

    Where the starts are judged by truth, each of the first four targets is enlarged beside the
    plan, and its hits are numbered by their scans.

    Parameters
    ----------
    scene : RunScene

    Returns
    -------
    matplotlib.figure.Figure
    """
    limits, seconds = plan_limits(scene), scene_velocity_seconds(scene)
    targets = 0 if scene.judged is None else min(len(scene.truth), MAX_PANELS)
    figure, plan, panels = _layout(targets, limits)
    style_plan(plan, limits)
    _draw_run(plan, scene, seconds, detailed=not panels)
    for target, axes in enumerate(panels):
        _draw_run(axes, scene, seconds, detailed=True)
        axes.plot(*scene.true_places.T, **TRUE_PLACE)
        _enlarge(plan, axes, scene, target, MIN_PANEL * float(np.ptp(limits, axis=1).max()))
    way = scene.own_ship if len(scene.own_ship) else np.array([[0.0, 0.0, np.nan]])
    x, y, heading = way[-1].tolist()
    draw_rings(plan, (x, y), limits)
    plan.plot(*way[:, :2].T, color=INK_COLOUR, linewidth=1.2)
    known = math.isfinite(heading)
    plan.plot(x, y, marker=ship(heading) if known else "o", color=INK_COLOUR, markersize=11)
    figure.suptitle(scene_headline(scene), x=0.01, ha="left", fontsize=16, fontweight="bold")
    below = f"{scene.title}; {len(scene.scans)} pings, {len(scene.detections)} detections"
    plan.set_title(below, loc="left", fontsize=10)
    figure.legend(
        handles=_legend(scene, seconds, bool(panels)),
        loc="outside lower center",
        ncols=4 if panels else 2,
        fontsize=9,
    )
    for target, axes in enumerate(panels):  # after all other elements are placed
        if target in scene.true_starts:
            hits = scene.hits[scene.true_starts[target].track.track_id]
            label_points(axes, [PointLabel(f"{n:.0f}", x, y, INK_COLOUR) for n, x, y in hits])
    return figure


def save(scene: RunScene, path: Path) -> None:
    """Draw the picture into a file; the suffix gives the format."""
    figure = draw(scene)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole_picture(path, figure)


def plan_limits(scene: RunScene) -> FloatArray:
    """Limits around all points, (2, 2) m: x and y; neither is much narrower."""
    held = [np.reshape(view.held.state[:, 0::2], (-1, 2)) for view in scene.scans]
    truth = [path[:, 1:] for path in scene.truth]
    everything = np.concatenate([scene.detections, *truth, *held, scene.own_ship[:, :2]])
    if not len(everything):
        return np.array([[-1.0, 1.0], [-1.0, 1.0]])
    extent = np.ptp(everything, axis=0)
    extent = np.maximum(extent, 0.4 * float(extent.max()) or 1.0)
    return _limits_around(everything, (0.5 + MARGIN) * extent)


def _panel_limits(scene: RunScene, target: int, least: float) -> FloatArray:
    """A square around a target's way, its true start with ellipse and hits, and its trail."""
    points = [scene.truth[target][:, 1:]]
    if target in scene.true_starts:
        track = scene.true_starts[target].track
        sigma = ELLIPSE_FACTOR * np.sqrt(np.diag(track.position_covariance))
        points += [track.position + np.stack([sigma, -sigma]), scene.hits[track.track_id][:, 1:]]
        points += [scene.ways()[track.track_id][:, :2]]
    everything = np.concatenate(points)
    extent = np.nanmax(everything, axis=0) - np.nanmin(everything, axis=0)
    return _limits_around(everything, 0.5 * max(least, PANEL_MARGIN * float(extent.max())))


def _limits_around(points: FloatArray, half: FloatArray | float) -> FloatArray:
    """Limits, (2, 2) m, of the half extent around the middle of points, (n, 2) m or nan."""
    middle = 0.5 * (np.nanmin(points, axis=0) + np.nanmax(points, axis=0))
    return np.stack([middle - half, middle + half], axis=1)


def _layout(targets: int, limits: FloatArray) -> tuple[Figure, Axes, list[Axes]]:
    """A figure, its plan, and beside it the axes of each enlarged target."""
    width, height = (limits[:, 1] - limits[:, 0]).tolist()
    plan_width, columns = 8.6 if targets else 9.5, (targets + 1) // 2
    plan_height = min(max(plan_width * height / width, 4.0), 11.0)
    ratios = [plan_width, *[0.5 * plan_height] * columns]
    figure = Figure(figsize=(sum(ratios), plan_height + 1.4), layout="constrained")
    grid = figure.add_gridspec(min(targets, 2) or 1, 1 + columns, width_ratios=ratios)
    plan = figure.add_subplot(grid[:, 0])
    places = [divmod(target, columns) for target in range(targets)]
    return figure, plan, [figure.add_subplot(grid[row, 1 + column]) for row, column in places]


def style_plan(axes: Axes, limits: FloatArray) -> None:
    """Set background, scale, labels, grid and limits, (2, 2) m, of a plan's axes."""
    axes.set(xlim=limits[0], ylim=limits[1], xlabel="east, m", ylabel="north, m")
    axes.set(facecolor=BACKGROUND_COLOUR, aspect="equal", axisbelow=True)
    axes.grid(color="#e2e8f0", linewidth=0.6)


def _enlarge(plan: Axes, axes: Axes, scene: RunScene, target: int, least: float) -> None:
    """Set limits, grid and title of a target's axes, and mark its part in the plan."""
    limits = _panel_limits(scene, target, least)
    style_plan(axes, limits)
    axes.set_xlabel("east, m", fontsize=8)
    axes.set_ylabel("north, m", fontsize=8)
    axes.tick_params(labelsize=8)
    axes.locator_params(nbins=5)
    name, start = f"target {scene_target_name(target)}", scene.true_starts.get(target)
    title = f"{name}: no track"
    if start is not None:
        track, scan = start.track, scene.start_scans[start.track.track_id]
        after = f"after {scan} pings, {track.stamp - scene.scans[0].stamp:.3g} s"
        title = f"{name}: track {track.track_id}\n{after}, by {len(track.hits)} hits"
    axes.set_title(title, loc="left", fontsize=10)
    (x, _), (y, top) = limits.tolist()
    width = float(np.ptp(limits[0]))
    frame = Rectangle((x, y), width, width, fill=False, color=FAINT_COLOUR, linewidth=0.9)
    plan.add_patch(frame)
    corner = np.array([x + 0.5 * width, top])
    write_beside_point(plan, name, corner, np.array([0.0, 1.0]), TRUTH_COLOUR)


def _draw_run(axes: Axes, scene: RunScene, seconds: float, detailed: bool) -> None:
    """Draw everything in the fixed frame; `detailed` also the hits of the starts."""
    numbers = np.array([len(view.detections) for view in scene.scans], int)
    ages = np.repeat(np.linspace(0.15, 0.65, len(scene.scans)), numbers)
    colours = to_rgba_array([INK_COLOUR] * len(ages), ages)
    x, y = scene.detections.T
    axes.scatter(x, y, s=6.0, c=colours, linewidths=0)
    for path in scene.truth:  # a circle where it begins, a square where it ends
        axes.plot(*path[:, 1:].T, color=TRUTH_COLOUR, linewidth=2.4, alpha=0.6)
        axes.plot(*path[0, 1:], **plan_points(TRUTH_COLOUR, "o", 6.0, hollow=True))
        axes.plot(*path[-1, 1:], **plan_points(TRUTH_COLOUR, "s", 6.0))
    ended = scene.ways()
    for track_id in scene.scans[-1].held.track_id.tolist() if scene.scans else []:
        draw_trail(axes, ended.pop(track_id))
    for trail in ended.values():
        draw_trail(axes, trail, FAINT_COLOUR)
    if scene.scans:
        axes.plot(*scene.scans[-1].fixed_echoes.T, **FIXED_ECHOES)
    for track in scene.starts_by(true=False):
        draw_track(axes, track, seconds, FAINT_COLOUR, 0.7, 0.9)
    true_starts = scene.starts_by(true=True)
    if detailed and (scene.judged is not None or len(true_starts) <= HITS_SHOWN):
        for track in true_starts:  # a line joins the hits in order
            _, x, y = scene.hits[track.track_id].T
            axes.plot(x, y, color=INK_COLOUR, linewidth=0.7, alpha=0.5)
            axes.plot(x, y, **plan_points(INK_COLOUR, "s", 6.5, hollow=True))
    for track in true_starts:
        draw_track(axes, track, seconds, TRACK_COLOUR, 1.0, 1.6)


def draw_rings(axes: Axes, centre: tuple[float, float], limits: FloatArray) -> None:
    """Draw range rings round the sonar, with their ranges, as far as the limits, (2, 2) m."""
    corners = np.array([[x, y] for x in limits[0] for y in limits[1]]) - centre
    reach = 0.75 * float(np.hypot(*corners.T).max())
    step = _round_step(reach / RINGS)
    for number in range(1, math.ceil(1.4 * reach / step)):
        radius = number * step
        axes.add_patch(
            Circle(
                centre,
                radius,
                facecolor="none",
                edgecolor="#a0aec0",
                linewidth=0.7,
                zorder=0.6,
            )
        )
        label = f"{radius / 1000:g} km" if step >= 500.0 else f"{radius:g} m"
        axes.text(
            centre[0],
            centre[1] + radius,
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


def ship(heading: float) -> MarkerPath:
    """Return a marker that points to a heading, rad counter-clockwise from the x axis."""
    sine, cosine = np.sin(heading - np.pi / 2), np.cos(heading - np.pi / 2)
    return MarkerPath(SHIP_OUTLINE @ np.array([[cosine, sine], [-sine, cosine]]))


def draw_trail(axes: Axes, way: FloatArray, colour: str = TRACK_COLOUR) -> None:
    """Draw the way of a confirmed track, see `RunScene.ways`: dashed where it was missed."""
    for line, left_out in ((MISSED_LINE, False), ("-", way[:, 2] > 0.0)):
        axes.plot(
            *np.where(left_out, np.nan, way[:, :2].T),
            color=colour,
            linewidth=1.5,
            alpha=0.8,
            linestyle=line,
        )


def plan_points(colour: str, marker: Any, size: float, hollow: bool = False) -> dict[str, Any]:
    """Style of points without a line."""
    style = {"color": colour, "marker": marker, "markersize": size, "linestyle": ""}
    return {**style, "markerfacecolor": "white" if hollow else colour}


FIXED_ECHOES = plan_points(FIXED_COLOUR, "X", 6.0)
TRUE_PLACE = plan_points(TRUTH_COLOUR, "D", 6.0, hollow=True)
"""Style of fixed echoes, and of where a target is at one time."""


def draw_track(
    axes: Axes,
    track: ConfirmedTrack,
    velocity_seconds: float,
    colour: str,
    alpha: float,
    width: float,
) -> None:
    """Draw a track: position, id, velocity over some seconds as an arrow, and 95 % ellipse.

    Arrow and ellipse are dashed without a detection in its scan.
    """
    line: Any = MISSED_LINE if track.time_since_hit > 0.0 else "-"
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
    speed = float(np.hypot(*track.velocity))
    ahead = track.velocity / speed if speed > 0.0 else np.array([0.0, 1.0])
    abeam = np.array([ahead[1], -ahead[0]]) * (1.0 if ahead[1] > 0 else -1.0)
    half = ELLIPSE_FACTOR * float(np.sqrt(abeam @ track.position_covariance @ abeam))
    write_beside_point(axes, str(track.track_id), start + half * abeam, abeam, colour, alpha)


def write_beside_point(
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


entry_of = partial(Line2D, [], [])
"""Makes an entry of a legend."""


def _legend(scene: RunScene, seconds: float, panels: bool) -> list[Line2D]:
    last = scene.scans[-1] if scene.scans else None
    held = set() if last is None else set(last.held.track_id.tolist())
    hits = f"hits of a new track in order{', with the number of the ping' if panels else ''}"
    kind = "new track" if scene.judged is None else "track on a target"
    start = f"{kind} at its start: id, 95 % ellipse, arrow: {seconds:g} s of travel"
    true_label, other = "true place when the track started", "false, misplaced or redundant track"
    few = panels or len(scene.starts_by(true=True)) <= HITS_SHOWN
    missed = any(view.held.time_since_hit.any() for view in scene.scans)
    dashed = {"label": "trail where no detection came", "linestyle": MISSED_LINE}
    ink, truth, track, faint = INK_COLOUR, TRUTH_COLOUR, TRACK_COLOUR, FAINT_COLOUR
    entries: list[tuple[Any, Line2D]] = [
        (True, entry_of(label="detections, fading with age", **plan_points(ink, "o", 3.0))),
        (True, _legend_sonar(scene.own_ship)),
        (
            scene.truth,
            entry_of(label="true way begins", **plan_points(truth, "o", 6.0, hollow=True)),
        ),
        (scene.truth, entry_of(label="true way ends", **plan_points(truth, "s", 6.0))),
        (few, entry_of(label=hits, **plan_points(ink, "s", 6.5, hollow=True))),
        (panels, entry_of(label=true_label, **TRUE_PLACE)),
        (True, entry_of(label=start, color=track, marker=">", markersize=6, linewidth=1.6)),
        (
            scene.starts_by(true=False),
            entry_of(label=other, color=faint, marker=">", markersize=4),
        ),
        (held, entry_of(label="held to the end: its trail", color=track)),
        (
            scene.ways().keys() - held,
            entry_of(label="ended or coasting: its trail", color=faint),
        ),
        (missed, entry_of(color=ink, **dashed)),
        (
            last is not None and len(last.fixed_echoes),
            entry_of(label="fixed echo", **FIXED_ECHOES),
        ),
    ]
    return [entry for shown, entry in entries if shown]


def _legend_sonar(path: FloatArray) -> Line2D:
    """The entry of the sonar: own ship with its way if it moves, else a place."""
    known = len(path) > 0 and bool(np.isfinite(path[-1, 2]))
    style = plan_points(INK_COLOUR, ship(np.pi / 2) if known else "o", 10.0)
    if len(path) and np.ptp(path[:, :2], axis=0).any():
        return entry_of(label="own ship and its way", **{**style, "linestyle": "-"})
    return entry_of(label="sonar", **style)
