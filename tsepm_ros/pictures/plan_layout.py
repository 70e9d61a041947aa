"""Layout of plan-position pictures: the whole plan, and beside it each target enlarged."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.pictures.plan_marks import ELLIPSE_FACTOR, FAINT_COLOUR, style_plan, write_beside
from tsepm_ros.pictures.run_scene import RunScene, target_name

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
