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
    GOOD,
    INK,
    TRUTH,
    draw_own_ship,
    draw_track,
    dress,
    legend_dots,
    legend_own_ship,
)
from tsepm_ros.pictures.run_scene import (
    RunScene,
    ScanView,
    own_ship_path,
    position_at,
    velocity_seconds,
)

NEW = "#b5179e"
FADING = 8
"""Scans for which a detection is seen."""
FRAMES_PER_SECOND = 2
LAST = 4
"""Frames for which the last one stands."""
MOST_FRAMES = 400
"""Frames of an animation; of a longer run it shows every second scan, or every third and so on."""
_FIRST_DATE = 1e8  # a stamp above is a date, s since 1970


def animate(scene: RunScene, path: Path, most_frames: int = MOST_FRAMES) -> int:
    """Write the animation as a GIF.

    Parameters
    ----------
    scene : RunScene
    path : path
        Of the file.
    most_frames : int, optional

    Returns
    -------
    int
        Scans from one frame to the next: 1 unless the run has more than most_frames.

    Raises
    ------
    ValueError
        If the run has no scan.
    """
    if not scene.scans:
        raise ValueError("there is no scan to animate")
    path.parent.mkdir(parents=True, exist_ok=True)
    shown = shown_scans(len(scene.scans), most_frames)
    seconds, limits = velocity_seconds(scene), _limits(scene)
    figure, axes = plt.subplots(figsize=(9.5, 10.0), layout="constrained")
    figure.legend(handles=_legend(scene, seconds), loc="outside lower center", ncols=3, fontsize=9)
    writer = PillowWriter(fps=FRAMES_PER_SECOND)
    with writer.saving(figure, str(path), dpi=80):
        for index in shown:
            _draw(axes, scene, index, seconds, limits, confirmed_since=index - shown.step + 1)
            for _ in range(LAST if index == shown[-1] else 1):
                writer.grab_frame()
    plt.close(figure)
    return shown.step


def shown_scans(scans: int, most_frames: int) -> range:
    """The scans of an animation: evenly spaced, no more than most_frames, the last one included."""
    step = -(-scans // most_frames)
    return range((scans - 1) % step, scans, step)


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
    dress(axes, "box")
    axes.set(xlim=limits[0], ylim=limits[1])
    earlier = scene.scans[max(index - FADING + 1, 0) : index]
    for age, one in enumerate(reversed(earlier), start=1):
        alpha = 0.4 * (1 - age / FADING)
        x, y = one.detections.T
        axes.scatter(x, y, s=6, color=INK, alpha=alpha, linewidths=0)
    x, y = view.detections.T
    axes.scatter(x, y, s=10, color=INK, alpha=0.75, linewidths=0)
    draw_own_ship(axes, own_ship_path(scene.scans[: index + 1]))
    for path in scene.truth:
        axes.plot(*path[:, 1:].T, color=TRUTH, linewidth=1.4, alpha=0.5)
        here = position_at(path, view.stamp)
        if here is not None:
            axes.plot(*here, marker="D", color=TRUTH, markersize=6, markerfacecolor="none")
    new_ids = _ids(scene.scans[max(confirmed_since, 0) : index + 1])
    for track in view.held:
        new = track.track_id in new_ids
        x, y = track.position.tolist()
        if new:
            axes.scatter([x], [y], s=900, color=NEW, alpha=0.25, linewidths=0)
        draw_track(axes, track, seconds, NEW if new else GOOD, 1.0, 2.0)
    axes.set_title(
        f"{scene.title}\n{_time(view.stamp)}, scan {index + 1} of {len(scene.scans)}; "
        f"tracks held: {len(view.held)}, new: {len(new_ids)}",
        loc="left",
        fontsize=11,
    )


def _ids(views: Iterable[ScanView]) -> set[int]:
    return {track_id for view in views for track_id in view.new.track_id.tolist()}


def _time(stamp: float) -> str:
    if stamp < _FIRST_DATE:
        return f"{stamp:.1f} s"
    return datetime.fromtimestamp(stamp, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")


def _limits(scene: RunScene) -> FloatArray:
    """A square around everything, (2, 2): from and to of x and of y, m."""
    points = [view.detections for view in scene.scans] + [path[:, 1:] for path in scene.truth]
    points += [np.reshape(view.held.state[:, 0::2], (-1, 2)) for view in scene.scans]
    every = np.concatenate([*points, scene.own_ship[:, :2]])
    if not len(every):
        return np.array([[-1.0, 1.0], [-1.0, 1.0]])
    low, high = every.min(axis=0), every.max(axis=0)
    half = 0.52 * max(float((high - low).max()), 100.0)
    middle = 0.5 * (low + high)
    return np.stack([middle - half, middle + half], axis=1)


def _legend(scene: RunScene, seconds: float) -> list[Line2D]:
    handles = [
        legend_dots(INK, f"detections, fading over {FADING} scans", markersize=4),
        legend_own_ship(),
        *(
            Line2D([], [], color=colour, marker="o", markersize=4, linewidth=2.0, label=label)
            for colour, label in (
                (GOOD, f"track held (id, velocity over {seconds:g} s, 95 % ellipse)"),
                (NEW, "new track, the same"),
            )
        ),
    ]
    if scene.truth:
        truth = legend_dots(TRUTH, "truth", markersize=6, markerfacecolor="none")
        truth.set_marker("D")
        handles.insert(2, truth)
    return handles
