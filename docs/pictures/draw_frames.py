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
"""Draw the pictures of docs/time_and_frames.md.

python docs/pictures/draw_frames.py
"""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import FancyArrowPatch, Polygon

from tsepm_ros.whole_files import written_whole

FOLDER = Path(__file__).parent
INK, HULL, SENSOR, TARGET, FIXED = "#222222", "#9aa5b1", "#1f6fb4", "#c0392b", "#2e7d32"
EAST, NORTH = 0.0, math.pi / 2

HEADING = math.radians(120.0)
"""Of the vessel, counter-clockwise from east."""
MOUNTING = math.radians(35.0)
"""Yaw of the sensor in the vessel's frame."""
PLACE = np.array([1.2, 0.0])
"""Of the sensor in the vessel's frame."""
SIGHT = math.radians(20.0)
"""Direction of the target, counter-clockwise from east."""

Point = np.ndarray


def unit(angle: float) -> Point:
    """Direction of an angle, (2,)."""
    return np.array([math.cos(angle), math.sin(angle)])


def arrow(axes: Axes, begin: Point, end: Point, color: str) -> None:
    """Draw an arrow."""
    style = {"arrowstyle": "-|>", "mutation_scale": 13, "shrinkA": 0, "shrinkB": 0, "lw": 1.6}
    axes.add_patch(FancyArrowPatch(tuple(begin), tuple(end), color=color, **style))


def label(axes: Axes, at: Point, text: str, color: str) -> None:
    """Write on white."""
    box = {"fc": "white", "ec": "none", "pad": 1.0}
    axes.text(at[0], at[1], text, color=color, ha="center", va="center", fontsize=10, bbox=box)


def axis(axes: Axes, begin: Point, angle: float, length: float, color: str, name: str) -> None:
    """Draw an axis of a frame, its name beyond its end."""
    arrow(axes, begin, begin + length * unit(angle), color)
    label(axes, begin + (length + 0.5) * unit(angle), name, color)


def angle(
    axes: Axes,
    centre: Point,
    radius: float,
    ends: tuple[float, float],
    color: str,
    name: str,
    out: float = 0.0,
) -> None:
    """Draw an angle that is measured from the first end to the last, its name on it or outside."""
    first, last = ends
    angles = np.linspace(first, last, 90)
    line = centre + radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    axes.plot(*line[:-4].T, color=color, lw=1.6)
    arrow(axes, line[-5], line[-1], color)
    label(axes, centre + (radius + out) * unit(0.5 * (first + last)), name, color)


def dotted(axes: Axes, begin: Point, angle: float, length: float, color: str) -> None:
    """Draw a direction that something is measured from."""
    axes.plot(*np.array([begin, begin + length * unit(angle)]).T, color=color, lw=1.1, ls=":")


def draw_vessel(axes: Axes) -> None:
    """Where the sensor is: fixed frame, vessel, sensor."""
    origin = np.zeros(2)
    turn = np.array([unit(HEADING), unit(HEADING + math.pi / 2)]).T
    hull = np.array([[2.2, 0], [1.2, 0.6], [-1.6, 0.6], [-1.6, -0.6], [1.2, -0.6]])
    axes.add_patch(Polygon(hull @ turn.T, fc="#eef1f4", ec=HULL, lw=1.5, zorder=0))
    corner = np.array([-3.4, -2.9])
    axis(axes, corner, EAST, 1.3, FIXED, "x east")
    axis(axes, corner, NORTH, 1.3, FIXED, "y north")
    label(axes, corner + np.array([0.8, -0.45]), "fixed frame (ENU)", FIXED)
    axis(axes, origin, HEADING, 3.4, INK, "x ahead (bow)")
    axis(axes, origin, HEADING + math.pi / 2, 1.7, INK, "y to\nport")
    dotted(axes, origin, EAST, 2.0, FIXED)
    angle(axes, origin, 1.75, (EAST, HEADING), INK, "heading,\nyaw of the vessel")
    sensor = turn @ PLACE
    axis(axes, sensor, HEADING + MOUNTING, 2.75, SENSOR, "x of the\nsensor")
    angle(axes, sensor, 1.5, (HEADING, HEADING + MOUNTING), SENSOR, "mounting", 0.6)
    axes.plot(*sensor, "o", color=SENSOR, ms=7)
    axes.set_title("where the sensor is", fontsize=11)


def draw_target(axes: Axes) -> None:
    """Where a target is, seen from the sensor."""
    sensor = np.array([-1.6, -2.6])
    target = sensor + 5.3 * unit(SIGHT)
    axis(axes, sensor, HEADING + MOUNTING, 2.2, SENSOR, "x of the\nsensor")
    for direction, length, color, name in (
        (HEADING, 3.7, INK, "ahead (bow)"),
        (NORTH, 4.6, FIXED, "north"),
    ):
        dotted(axes, sensor, direction, length, color)
        label(axes, sensor + (length + 0.25) * unit(direction), name, color)
    axes.plot(*np.array([sensor, target]).T, color=TARGET, lw=1.4)
    axes.plot(*target, "s", color=TARGET, ms=8)
    label(axes, target + np.array([0.0, 0.45]), "target", TARGET)
    label(axes, sensor + 3.4 * unit(SIGHT), "range", TARGET)
    angle(axes, sensor, 1.4, (HEADING + MOUNTING, SIGHT), SENSOR, "azimuth\n(here negative)")
    angle(axes, sensor, 2.75, (HEADING, SIGHT), INK, "bearing\nfrom the bow")
    angle(axes, sensor, 4.05, (NORTH, SIGHT), FIXED, "bearing\nfrom north")
    axes.plot(*sensor, "o", color=SENSOR, ms=7)
    axes.set_title("where a target is", fontsize=11)


def draw_frames() -> None:
    """Frames and angles, from above."""
    figure, both = plt.subplots(1, 2, figsize=(10.5, 5.4))
    draw_vessel(both[0])
    draw_target(both[1])
    for axes in both:
        axes.set_aspect("equal")
        axes.set_xlim(-4.2, 4.2)
        axes.set_ylim(-3.7, 3.9)
        axes.axis("off")
    figure.text(
        0.5,
        0.03,
        "heading, yaw, mounting and azimuth are positive counter-clockwise, bearings clockwise",
        ha="center",
    )
    figure.subplots_adjust(left=0.01, right=0.99, top=0.94, bottom=0.08, wspace=0.02)
    with written_whole(FOLDER / "frames.png") as temporary:
        figure.savefig(temporary, dpi=100)
    plt.close(figure)


INSTANTS = (
    (0.0, 0.0, "stamp\nstart of transmit", "the sonar's place, one end\nstate of the tracks"),
    (1.0, 1.0, "stamp + time_offset\n= stamp + r / c", "the detection's\nposition is valid"),
    (
        2.0,
        0.06,
        "stamp + 2 time_offset\n= stamp + 2 r / c",
        "the sonar's place, other end\nheading of the bearing",
    ),
)
"""Time and height in the picture, name, and what is of then."""


def draw_echo() -> None:
    """The way of one echo over time."""
    figure, axes = plt.subplots(figsize=(9.0, 4.6))
    span = np.array([-0.3, 2.35])
    axes.plot(span, 1.0 + 0.10 * (span - 1.0), color=TARGET, lw=2)
    axes.plot(span, 0.03 * span, color=INK, lw=2)
    axes.text(-0.28, 0.91, "target", color=TARGET, va="bottom")
    axes.text(-0.28, 0.03, "sonar", color=INK, va="bottom")
    for begin, end in itertools.pairwise(INSTANTS):
        arrow(axes, np.array(begin[:2]), np.array(end[:2]), SENSOR)
    axes.text(0.44, 0.52, "sound goes out", color=SENSOR, ha="right")
    axes.text(1.56, 0.56, "and comes back", color=SENSOR, ha="left")
    for time, height, name, belongs in INSTANTS:
        axes.plot([time, time], [-0.14, height], color=INK, lw=0.9, ls=":")
        axes.plot(time, height, "o", color=INK, ms=6)
        axes.text(time, -0.17, name, ha="center", va="top", fontsize=10)
        box = {"fc": "#f4f6f8", "ec": HULL, "boxstyle": "round,pad=0.4"}
        axes.text(time, -0.5, belongs, ha="center", va="top", fontsize=10, bbox=box)
    text = "range r = half of the travel time × sound speed c: the mean of the two legs"
    axes.text(1.0, 1.22, text, ha="center", color=INK)
    axes.set_xlim(-0.55, 2.55)
    axes.set_ylim(-0.8, 1.32)
    axes.axis("off")
    figure.subplots_adjust(left=0.01, right=0.99, top=0.99, bottom=0.01)
    with written_whole(FOLDER / "echo_times.png") as temporary:
        figure.savefig(temporary, dpi=100)
    plt.close(figure)


if __name__ == "__main__":
    draw_frames()
    draw_echo()
