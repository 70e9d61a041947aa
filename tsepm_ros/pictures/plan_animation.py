"""A plan-position animation of a run: a frame per scan."""

from __future__ import annotations

from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.animation import PillowWriter
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.pictures.plan_position import (
    INK_COLOUR,
    TRACK_COLOUR,
    TRUTH_COLOUR,
    draw_own_ship,
    draw_track,
    legend_dots,
    legend_own_ship,
    style_plan,
)
from tsepm_ros.pictures.run_scene import (
    RunScene,
    ScanView,
    own_ship_path,
    position_at,
    velocity_seconds,
)
from tsepm_ros.whole_files import written_whole

NEW_TRACK_COLOUR = "#b5179e"
FADING_SCANS = 8
"""Number of scans for which a detection is shown."""
FRAMES_PER_SECOND = 2
LAST_FRAME_REPEATS = 4
"""Number of times that the last frame is shown."""
MAX_FRAMES = 400
"""Maximum frames of an animation; of a longer run only every n-th scan is shown."""
_MIN_DATE, _MAX_DATE = 1e8, 2.5e11  # stamps between these are dates, s since 1970


def animate(scene: RunScene, path: Path, max_frames: int = MAX_FRAMES) -> int:
    """Write the animation as a GIF.

    Parameters
    ----------
    scene : RunScene
    path : path
        Path of the file.
    max_frames : int, optional

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
    seconds, limits = velocity_seconds(scene), _limits(scene)
    figure, axes = plt.subplots(figsize=(9.5, 10.0), layout="constrained")
    figure.legend(handles=_legend(scene, seconds), loc="outside lower center", ncols=3, fontsize=9)
    writer = PillowWriter(fps=FRAMES_PER_SECOND)
    with written_whole(path) as temporary, writer.saving(figure, str(temporary), dpi=80):
        for index in shown:
            _draw(axes, scene, index, seconds, limits, confirmed_since=index - shown.step + 1)
            for _ in range(LAST_FRAME_REPEATS if index == shown[-1] else 1):
                writer.grab_frame()
    plt.close(figure)
    return shown.step


def shown_scans(scans: int, max_frames: int) -> range:
    """Scans of an animation: evenly spaced, at most max_frames, with the last scan."""
    interval = -(-scans // max_frames)
    return range((scans - 1) % interval, scans, interval)


def _draw(
    axes: Axes,
    scene: RunScene,
    index: int,
    seconds: float,
    limits: FloatArray,
    confirmed_since: int,
) -> None:
    view = scene.scans[index]
    axes.clear()
    style_plan(axes, "box")
    axes.set(xlim=limits[0], ylim=limits[1])
    earlier = scene.scans[max(index - FADING_SCANS + 1, 0) : index]
    for age, earlier_view in enumerate(reversed(earlier), start=1):
        alpha = 0.4 * (1 - age / FADING_SCANS)
        x, y = earlier_view.detections.T
        axes.scatter(x, y, s=6, color=INK_COLOUR, alpha=alpha, linewidths=0)
    x, y = view.detections.T
    axes.scatter(x, y, s=10, color=INK_COLOUR, alpha=0.75, linewidths=0)
    draw_own_ship(axes, own_ship_path(scene.scans[: index + 1]))
    for path in scene.truth:
        axes.plot(*path[:, 1:].T, color=TRUTH_COLOUR, linewidth=1.4, alpha=0.5)
        position = position_at(path, view.stamp)
        if position is not None:
            axes.plot(
                *position, marker="D", color=TRUTH_COLOUR, markersize=6, markerfacecolor="none"
            )
    new_ids = _ids(scene.scans[max(confirmed_since, 0) : index + 1])
    for track in view.held:
        new = track.track_id in new_ids
        x, y = track.position.tolist()
        if new:
            axes.scatter([x], [y], s=900, color=NEW_TRACK_COLOUR, alpha=0.25, linewidths=0)
        draw_track(axes, track, seconds, NEW_TRACK_COLOUR if new else TRACK_COLOUR, 1.0, 2.0)
    axes.set_title(
        f"{scene.title}\n{_time(view.stamp)}, scan {index + 1} of {len(scene.scans)}; "
        f"held tracks: {len(view.held)}, new: {len(new_ids)}",
        loc="left",
        fontsize=11,
    )


def _ids(views: Iterable[ScanView]) -> set[int]:
    return {track_id for view in views for track_id in view.new.track_id.tolist()}


def _time(stamp: float) -> str:
    if not _MIN_DATE <= stamp < _MAX_DATE:
        return f"{stamp:.1f} s"
    return datetime.fromtimestamp(stamp, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")


def _limits(scene: RunScene) -> FloatArray:
    """Square around all points, (2, 2): limits of x and of y, m."""
    points = [view.detections for view in scene.scans] + [path[:, 1:] for path in scene.truth]
    points += [np.reshape(view.held.state[:, 0::2], (-1, 2)) for view in scene.scans]
    everything = np.concatenate([*points, scene.own_ship[:, :2]])
    if not len(everything):
        return np.array([[-1.0, 1.0], [-1.0, 1.0]])
    low, high = everything.min(axis=0), everything.max(axis=0)
    half = 0.52 * max(float((high - low).max()), 100.0)
    middle = 0.5 * (low + high)
    return np.stack([middle - half, middle + half], axis=1)


def _legend(scene: RunScene, seconds: float) -> list[Line2D]:
    handles = [
        legend_dots(INK_COLOUR, f"detections, fading over {FADING_SCANS} scans", markersize=4),
        legend_own_ship(),
        *(
            Line2D([], [], color=colour, marker="o", markersize=4, linewidth=2.0, label=label)
            for colour, label in (
                (TRACK_COLOUR, f"held track (id, velocity over {seconds:g} s, 95 % ellipse)"),
                (NEW_TRACK_COLOUR, "new track, the same"),
            )
        ),
    ]
    if scene.truth:
        truth = legend_dots(TRUTH_COLOUR, "truth", markersize=6, markerfacecolor="none")
        truth.set_marker("D")
        handles.insert(2, truth)
    return handles
