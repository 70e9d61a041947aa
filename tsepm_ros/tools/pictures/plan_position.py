"""Plan-position picture of a run, and its animation with a frame per scan.

The picture has why each track was started, and what became of it.
"""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from PIL import Image

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
    own_ship_path,
    position_at,
    target_name,
    velocity_seconds,
)
from tsepm_ros.tools.terminal import Progress, silent
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


def _panel_title(scene: RunScene, target: int, index: int | None = None) -> str:
    """The track of a target, or that it has none; of those started by a scan, if it is given."""
    name, start = f"target {target_name(target)}", scene.true_starts.get(target)
    scan = 0 if start is None else scene.start_scans[start.track.track_id]
    if start is None or (index is not None and scan > index + 1):
        return f"{name}: no track" if index is None else f"{name}\nno track yet"
    track = start.track
    if index is not None:
        return f"{name}: track {track.track_id}\nstarted in ping {scan}"
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
    other = "false, misplaced or redundant track" if scene.judged else "track elsewhere"
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


NEW_TRACK_COLOUR = "#b5179e"
FADING_SCANS = 8
"""Number of scans for which a detection is shown."""
FRAME_TIME, LAST_FRAME_TIME = 500, 2500
"""Time of a frame, and of the last frame, ms."""
DOTS_PER_INCH = 60
COLOURS = 64
MAX_FRAMES = 400
"""Maximum frames of an animation; of a longer run only every n-th scan is shown."""
_MIN_DATE, _MAX_DATE = 1e8, 2.5e11  # stamps between these are dates, s since 1970


def animate(
    scene: RunScene,
    path: Path,
    max_frames: int = MAX_FRAMES,
    progress: Progress = silent,
) -> int:
    """Write the animation as a GIF.

    Parameters
    ----------
    scene : RunScene
    path : path
        Path of the file.
    max_frames : int, optional
    progress : callable, optional
        Shows the number of frames that are done.

    Returns
    -------
    int
        Interval of the frames, scans: 1 unless the run has more than max_frames.

    Raises
    ------
    ValueError
        If the run has no scan.
    """
    if not scene.scans:
        raise ValueError("there is no scan to animate")
    path.parent.mkdir(parents=True, exist_ok=True)
    shown = shown_scans(len(scene.scans), max_frames)
    seconds, layout = velocity_seconds(scene), PlanLayout.of(scene)
    columns = 4 if layout.panels else 2
    layout.figure.legend(
        handles=_frame_legend(scene, seconds), loc="outside lower center", ncols=columns, fontsize=9
    )
    layout.figure.set_dpi(DOTS_PER_INCH)
    frames = []
    for index in progress(shown, len(shown)):
        _draw_frame(layout, scene, index, seconds, confirmed_since=index - shown.step + 1)
        frames.append(_image(layout.figure))
    plt.close(layout.figure)
    times = [FRAME_TIME] * (len(frames) - 1) + [LAST_FRAME_TIME]
    with written_whole(path) as temporary:
        frames[0].save(
            temporary,
            format="GIF",
            save_all=True,
            append_images=frames[1:],
            duration=times,
            loop=0,
            optimize=True,
        )
    return shown.step


def _image(figure: Figure) -> Image.Image:
    """The figure as an image of few colours, which keeps the file small."""
    canvas: Any = figure.canvas
    canvas.draw()
    pixels = np.asarray(canvas.buffer_rgba())[:, :, :3]
    image = Image.fromarray(np.ascontiguousarray(pixels))
    # By coverage of the colours, not by their number of pixels: a track has few.
    return image.quantize(COLOURS, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)


def shown_scans(scans: int, max_frames: int) -> range:
    """Scans of an animation: evenly spaced, at most max_frames, with the last scan."""
    interval = -(-scans // max_frames)
    return range((scans - 1) % interval, scans, interval)


def _draw_frame(
    layout: PlanLayout, scene: RunScene, index: int, seconds: float, confirmed_since: int
) -> None:
    view = scene.scans[index]
    views = scene.scans[max(confirmed_since, 0) : index + 1]
    new_ids = {track_id for one in views for track_id in one.new.track_id.tolist()}
    for axes, enlarged in layout.axes():
        axes.clear()
        _draw_scan(axes, scene, index, seconds, new_ids)
        if enlarged:
            for track_id in view.held.track_id.tolist():
                if track_id in scene.hits:
                    draw_hits(axes, scene.hits[track_id])
    path = own_ship_path(scene.scans[: index + 1])
    path = path if len(path) else np.array([[0.0, 0.0, np.nan]])
    draw_rings(layout.plan, path[-1, :2], layout.limits)
    draw_own_ship(layout.plan, path)
    layout.style({target: _panel_title(scene, target, index) for target in layout.panels})
    layout.headline(
        f"{_time(view.stamp)}, ping {index + 1} of {len(scene.scans)}: "
        f"{len(view.held)} track{'' if len(view.held) == 1 else 's'} held",
        scene.title,
    )


def _draw_scan(axes: Axes, scene: RunScene, index: int, seconds: float, new_ids: set[int]) -> None:
    view = scene.scans[index]
    shown = scene.scans[max(index - FADING_SCANS + 1, 0) : index + 1]
    ages = np.repeat(range(len(shown))[::-1], [len(one.detections) for one in shown])
    alpha = np.where(ages == 0, 0.8, 0.4 * (1 - ages / FADING_SCANS))
    draw_detections(axes, np.concatenate([one.detections for one in shown]), alpha, 8.0)
    axes.plot(*view.fixed_echoes.T, **FIXED_ECHOES)
    for path in scene.truth:
        axes.plot(*path[:, 1:].T, color=TRUTH_COLOUR, linewidth=1.4, alpha=0.5)
        position = position_at(path, view.stamp)
        if position is not None:
            axes.plot(*position, **TRUE_PLACE)
    ways = scene.ways(index + 1)
    for track in view.held:
        new = track.track_id in new_ids
        x, y = track.position.tolist()
        if new:
            axes.scatter([x], [y], s=1200, color=NEW_TRACK_COLOUR, alpha=0.3, linewidths=0)
        draw_trail(axes, ways[track.track_id])
        draw_track(axes, track, seconds, NEW_TRACK_COLOUR if new else TRACK_COLOUR, 1.0, 2.0)


def _time(stamp: float) -> str:
    if not _MIN_DATE <= stamp < _MAX_DATE:
        return f"{stamp:.1f} s"
    return datetime.fromtimestamp(stamp, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")


def _frame_legend(scene: RunScene, seconds: float) -> list[Line2D]:
    arrow = {"marker": ">", "markersize": 6, "linewidth": 2.0}
    label = f"track: id, 95 % ellipse, arrow: {seconds:g} s of travel"
    coasting = "the same, not detected in this ping"
    fading = f"detections, fading over {FADING_SCANS} pings"
    entries: list[tuple[Any, Line2D]] = [
        (True, legend_points(INK_COLOUR, "o", fading, 4.0)),
        (True, legend_sonar(scene.own_ship)),
        (scene.truth, legend_points(TRUTH_COLOUR, "D", "true place", 6.0, hollow=True)),
        (
            scene.judged is not None,
            legend_points(INK_COLOUR, "s", "hits of a track", 6.5, hollow=True),
        ),
        (True, legend_line(TRACK_COLOUR, label, **arrow)),
        (True, legend_line(NEW_TRACK_COLOUR, "the same, new", **arrow)),
        (
            any(view.held.time_since_hit.any() for view in scene.scans),
            legend_line(TRACK_COLOUR, coasting, ls=COASTING_LINE),
        ),
        (
            any(len(view.fixed_echoes) for view in scene.scans),
            legend_points(FIXED_COLOUR, "X", "fixed echo", 6.0),
        ),
    ]
    return [entry for shown, entry in entries if shown]
