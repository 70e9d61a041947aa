"""Plan-position picture of a run.

The picture has why each track was started, and what became of it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from tsepm_ros.tools.pictures.plan_marks import (
    COASTING_LINE,
    FAINT_COLOUR,
    FIXED_COLOUR,
    FIXED_ECHOES,
    INK_COLOUR,
    TRACK_COLOUR,
    TRUE_PLACE,
    TRUTH_COLOUR,
    PlanLayout,
    PointLabel,
    draw_detections,
    draw_hits,
    draw_own_ship,
    draw_rings,
    draw_track,
    draw_trail,
    draw_truth,
    label_points,
    legend_line,
    legend_points,
    legend_sonar,
)
from tsepm_ros.tools.pictures.run_scene import (
    RunScene,
    headline,
    target_name,
    velocity_seconds,
)
from tsepm_ros.whole_files import written_whole

HITS_SHOWN = 12
"""Largest number of starts of a picture without panels whose hits are drawn."""


def draw(scene: RunScene) -> Figure:
    """Draw a whole run: detections, truth, starts with their hits, held tracks as trails.

    Where the starts are judged by truth, each of the first four targets is enlarged beside the
    plan, and its hits are numbered by their scans.

    Parameters
    ----------
    scene : RunScene

    Returns
    -------
    matplotlib.figure.Figure
    """
    layout = PlanLayout.of(scene)
    seconds = velocity_seconds(scene)
    for axes, enlarged in layout.axes():
        _draw_run(axes, scene, seconds, enlarged or not layout.panels)
    for axes in layout.panels.values():
        for place in scene.true_places:
            axes.plot(*place, **TRUE_PLACE)
    layout.style({target: _panel_title(scene, target) for target in layout.panels})
    own_ship = scene.own_ship
    centre = own_ship[-1, :2] if len(own_ship) else np.zeros(2)
    draw_rings(layout.plan, centre, layout.limits)
    draw_own_ship(layout.plan, own_ship if len(own_ship) else np.array([[0.0, 0.0, np.nan]]))
    number = sum(len(view.detections) for view in scene.scans)
    layout.headline(
        headline(scene), f"{scene.title}; {len(scene.scans)} pings, {number} detections"
    )
    layout.figure.legend(
        handles=_legend(scene, seconds, bool(layout.panels)),
        loc="outside lower center",
        ncols=4 if layout.panels else 2,
        fontsize=9,
    )
    _number_hits(layout, scene)
    return layout.figure


def save(scene: RunScene, path: Path) -> None:
    """Draw the picture into a file; the suffix gives the format."""
    figure = draw(scene)
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        with written_whole(path) as temporary:
            figure.savefig(temporary, dpi=100)
    finally:
        plt.close(figure)


def _draw_run(axes: Axes, scene: RunScene, seconds: float, detailed: bool) -> None:
    """Draw everything in the fixed frame; `detailed` also the hits of the starts."""
    ages = np.linspace(0.15, 0.65, max(len(scene.scans), 1))
    numbers = [len(view.detections) for view in scene.scans]
    points = np.concatenate([np.zeros((0, 2)), *(view.detections for view in scene.scans)])
    draw_detections(axes, points, np.repeat(ages, numbers) if numbers else ages[:0], 6.0)
    for path in scene.truth:
        draw_truth(axes, path[:, 1:])
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
        for track in true_starts:
            draw_hits(axes, scene.hits[track.track_id])
    for track in true_starts:
        draw_track(axes, track, seconds, TRACK_COLOUR, 1.0, 1.6)


def _panel_title(scene: RunScene, target: int) -> str:
    """The track of a target, or that it has none."""
    name, start = f"target {target_name(target)}", scene.true_starts.get(target)
    if start is None:
        return f"{name}: no track"
    track, scan = start.track, scene.start_scans[start.track.track_id]
    after = f"after {scan} pings, {track.stamp - scene.scans[0].stamp:.3g} s"
    return f"{name}: track {track.track_id}\n{after}, by {len(track.hits)} hits"


def _number_hits(layout: PlanLayout, scene: RunScene) -> None:
    """Write the number of the scan beside each hit of the enlarged targets' starts."""
    for target, axes in layout.panels.items():
        if target in scene.true_starts:
            hits = scene.hits[scene.true_starts[target].track.track_id]
            label_points(axes, [PointLabel(f"{n:.0f}", x, y, INK_COLOUR) for n, x, y in hits])


def _legend(scene: RunScene, seconds: float, panels: bool) -> list[Line2D]:
    judged, last = scene.judged is not None, scene.scans[-1] if scene.scans else None
    held = set() if last is None else set(last.held.track_id.tolist())
    begin = legend_points(TRUTH_COLOUR, "o", "true way begins", 6.0, hollow=True)
    end = legend_points(TRUTH_COLOUR, "s", "true way ends", 6.0)
    hits = f"hits of a new track in order{', with the number of the ping' if panels else ''}"
    place = legend_points(TRUTH_COLOUR, "D", "true place when the track started", 6.0, hollow=True)
    kind = "track on a target" if judged else "new track"
    label = f"{kind} at its start: id, 95 % ellipse, arrow: {seconds:g} s of travel"
    start = legend_line(TRACK_COLOUR, label, marker=">", markersize=6, linewidth=1.6)
    other = "false, misplaced or redundant track"
    ended = set(scene.trails()) - held if scene.scans else set()
    coasting = legend_line(INK_COLOUR, "trail where no detection came", linestyle=COASTING_LINE)
    few = panels or len(scene.starts_by(true=True)) <= HITS_SHOWN
    entries: list[tuple[Any, Line2D]] = [
        (True, legend_points(INK_COLOUR, "o", "detections, fading with age", 3.0)),
        (True, legend_sonar(scene.own_ship)),
        (scene.truth, begin),
        (scene.truth, end),
        (few, legend_points(INK_COLOUR, "s", hits, 6.5, hollow=True)),
        (panels, place),
        (True, start),
        (scene.starts_by(true=False), legend_line(FAINT_COLOUR, other, marker=">", markersize=4)),
        (held, legend_line(TRACK_COLOUR, "held to the end: its trail")),
        (ended, legend_line(FAINT_COLOUR, "ended or withheld: its trail")),
        (any(view.held.time_since_hit.any() for view in scene.scans), coasting),
        (
            last is not None and len(last.fixed_echoes),
            legend_points(FIXED_COLOUR, "X", "fixed echo", 6.0),
        ),
    ]
    return [entry for shown, entry in entries if shown]
