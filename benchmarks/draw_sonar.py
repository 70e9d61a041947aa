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
"""Draw sonar.png: a clip of a real imaging sonar, tracks of `score` and plain Kalman tracks.

python benchmarks/draw_sonar.py FOLDER

FOLDER is that of the tables (`benchmarks/chain.py --data FOLDER`), with the folder didson; detector
and tracker are as `tsepm init` leaves them. The clip is lamprey1 of a DIDSON
(github.com/safnuk/DIDSON.jl, Apache-2.0). The picture shows what the package made of it and labels
of its own, not the image of the sonar.
"""

from __future__ import annotations

import argparse
import collections
from collections.abc import Sequence
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import chain
import chain_scenes
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from tsepm_ros.session.session import Session
from tsepm_ros.settings.node_options import InitiatorNodeOptions
from tsepm_ros.whole_files import written_whole

PICTURE = Path(__file__).parents[1] / "docs" / "images" / "sonar.png"
COLOURS = {"A": "#0072B2", "B": "#D55E00", "C": "#009E73"}
"""Of the labelled fish."""
OTHER = "0.35"
RATE = 10.0
"""False tracks per hour that are accepted."""
KALMAN = "5/7,0,0.2,8"
"""The best plain Kalman rule on this clip, by `benchmarks/chain.py`."""
TIMES = 3.0
"""Between the marks of time along a track, s."""

Ways = dict[int, list[tuple[float, float, float]]]
"""Of each track the time, s, and position, m to starboard and ahead, in each image."""
Label = tuple[str, float, float, float]
"""A fish, the time, s, and its position, m to starboard and ahead."""


def tracked(
    scene: chain_scenes.ChainScene, pings: Sequence[chain.Ping], kalman: str = ""
) -> tuple[chain.Watch, Ways]:
    """The counts of the whole chain, and the ways of its tracks."""
    _, groups = chain.initialised(scene.answers, RATE)
    session = Session(chain.settings_of(groups, kalman))
    watch = chain.Watch(scene.gate, scene.on_structure, RATE)
    ways: Ways = collections.defaultdict(list)
    for ping, result in chain.tracked(pings, session, groups[InitiatorNodeOptions]):
        watch.take(ping, result)
        for track in result.current.sure:
            x, _, y, _ = track.state
            ways[track.track_id].append((ping.stamp, -y, x))
    return watch, ways


def fish_of(way: Sequence[tuple[float, float, float]], labels: Sequence[Label], near: float) -> str:
    """The fish that a track is near at most labels, else nothing."""
    counts: collections.Counter[str] = collections.Counter()
    places = {stamp: at for stamp, *at in way}
    for fish, stamp, *at in labels:
        if stamp in places and np.linalg.norm(np.subtract(places[stamp], at)) < near:
            counts[fish] += 1
    return counts.most_common(1)[0][0] if counts else ""


def draw_ways(axis: Axes, ways: Ways, labels: Sequence[Label], near: float) -> None:
    """The tracks, with their times along those of the fish."""
    for points in ways.values():
        way = np.array(points)
        fish = fish_of(points, labels, near)
        colour = COLOURS.get(fish, OTHER)
        axis.plot(*way[:, 1:].T, color=colour, lw=2.2 if fish else 1.2)
        axis.plot(*way[-1, 1:], "o", ms=5 if fish else 3, color=colour)
        if not fish:
            continue
        first = np.ceil(way[0, 0] / TIMES) * TIMES
        for mark in np.arange(first, way[-1, 0], TIMES):
            _, *at = way[np.argmin(np.abs(way[:, 0] - mark))]
            axis.plot(*at, "|", ms=9, mew=1.6, color="black")
            axis.annotate(f"{mark:.0f} s", at, (4, -12), textcoords="offset points", size=9)


def main() -> None:
    """Draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="folder of the recordings, with didson in it")
    scene = chain_scenes.clip(parser.parse_args().folder, "lamprey1")
    pings = chain.detected(scene, 1)
    seen = np.concatenate([ping.places() for ping in pings])
    labels = [
        (fish, ping.stamp, -target.place[1], target.place[0])
        for ping in pings
        for fish, target in ping.truth.items()
    ]
    figure, axes = plt.subplots(1, 2, figsize=(9.6, 5.0), sharey=True, layout="constrained")
    for axis, name, kalman in zip(
        axes, ("tsepm_ros", "plain Kalman, 5/7"), ("", KALMAN), strict=True
    ):
        watch, ways = tracked(scene, pings, kalman)
        others = sum(watch.elsewhere())
        axis.set(title=f"{name}: {others} other tracks in the coverage", xlabel="m to starboard")
        axis.set(xlim=(-1.25, 1.3), ylim=(7.1, 9.75), aspect="equal")
        axis.spines[["top", "right"]].set_visible(False)
        axis.plot(-seen[:, 1], seen[:, 0], ".", ms=3.0, color="0.6", mew=0)
        draw_ways(axis, ways, labels, scene.gate)
        for fish, colour in COLOURS.items():
            own = np.array([at for key, _, *at in labels if key == fish])
            axis.plot(*own.T, "o", ms=11, mfc="none", mec=colour, mew=0.9)
            axis.annotate(
                fish,
                own[0],
                (9, 6),
                textcoords="offset points",
                color=colour,
                weight="bold",
                size=13,
            )
    left = axes[0]
    left.set(ylabel="m ahead")
    left.plot([], [], ".", ms=5, color="0.6", mew=0, label="detection, in any image")
    left.plot([], [], "o", ms=10, mfc="none", mec=COLOURS["A"], label="fish, labelled by eye")
    left.plot([], [], "o-", ms=5, lw=2.2, color=COLOURS["A"], label="track of a labelled fish")
    left.plot([], [], "o-", ms=3, lw=1.2, color=OTHER, label="other track")
    left.legend(fontsize=8, loc="upper left")
    figure.supxlabel(
        "DIDSON in a river, 15 s, lampreys (github.com/safnuk/DIDSON.jl, clip lamprey1); "
        "metres are nominal, labels are ours",
        fontsize=8,
        color="0.4",
    )
    with written_whole(PICTURE) as temporary:
        figure.savefig(temporary, dpi=100, format="png")


if __name__ == "__main__":
    main()
