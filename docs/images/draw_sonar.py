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
"""Draw sonar.png: detections, tracks and own labels of a clip of a real imaging sonar.

python docs/images/draw_sonar.py FOLDER OF didson

The clip is lamprey1 of a DIDSON (github.com/safnuk/DIDSON.jl, Apache-2.0). The picture shows what
the package made of it and labels of its own, not the image of the sonar.
"""

from __future__ import annotations

import argparse
import collections
import csv
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from tsepm_ros import SensorModel, SonarImage, make_detector, make_initiator
from tsepm_ros.whole_files import written_whole

PICTURE = Path(__file__).parent / "sonar.png"
COLOURS = {"A": "#0072B2", "B": "#D55E00", "C": "#009E73"}
"""Of the labelled fish."""
OTHER = "0.35"
NEAR = 0.25
"""Distance of a track from a label of its fish, m."""


def place(azimuth: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """Positions, (n, 2): to starboard and ahead, m."""
    return np.stack([-distance * np.sin(azimuth), distance * np.cos(azimuth)], axis=-1)


def processed(data: Any) -> tuple[np.ndarray, dict[int, list[np.ndarray]]]:
    """All detections (n, 2), and of each track the image and position, (3,), in each image."""
    azimuth, ranges = data["azimuth_rad"], data["range_m"]
    step = abs(azimuth[1] - azimuth[0]), ranges[1] - ranges[0]
    detector = make_detector(
        false_detections_per_ping=5.0, azimuth_extent=3 * step[0], range_extent=5 * step[1]
    )
    sensor = SensorModel(
        range_std=2 * step[1],
        range_std_fraction=0.0,
        azimuth_std=step[0],
        min_range=ranges[0],
        max_range=ranges[-1],
        azimuth_min=azimuth.min(),
        azimuth_max=azimuth.max(),
    )
    initiator = make_initiator("score", sensor=sensor, max_speed=2.0)
    seen, tracks = [], collections.defaultdict(list)
    for index, (stamp, image) in enumerate(zip(data["time_s"], data["image"], strict=True)):
        scan = detector.process(SonarImage(float(stamp), ranges, azimuth, image))
        initiator.process(scan)
        seen.append(place(scan.azimuth, scan.range))
        for track in initiator.current.sure:
            x, _, y, _ = track.state
            tracks[track.track_id].append(np.array([index, -y, x]))
    return np.concatenate(seen), tracks


def labelled(path: Path) -> dict[str, np.ndarray]:
    """Image and position, (n, 3), of each labelled fish."""
    rows = collections.defaultdict(list)
    with path.open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            at = place(np.array(float(row["azimuth_rad"])), np.array(float(row["range_m"])))
            rows[row["fish"]].append([int(row["frame"]), *at])
    return {fish: np.array(values) for fish, values in rows.items()}


def fish_of(way: np.ndarray, labels: dict[str, np.ndarray]) -> str:
    """The fish that a track is near in most images of labels, else nothing."""
    counts: collections.Counter[str] = collections.Counter()
    for fish, rows in labels.items():
        for image, *at in rows:
            here = way[way[:, 0] == image, 1:]
            counts[fish] += bool(len(here)) and bool(np.linalg.norm(here[0] - at) < NEAR)
    [(fish, number)] = counts.most_common(1)
    return fish if number else ""


def draw_sector(axis: Axes, azimuth: np.ndarray, ranges: np.ndarray) -> None:
    """The edges of the images, and an axis in metres."""
    edge = np.linspace(azimuth.min(), azimuth.max(), 50)
    rim = [place(edge, np.full(50, distance)) for distance in (ranges[0], ranges[-1])]
    outline = np.concatenate([rim[0], rim[1][::-1], rim[0][:1]])
    axis.plot(*outline.T, color="0.6", lw=0.8)
    axis.set(aspect="equal", xlabel="m to starboard")
    axis.spines[["top", "right"]].set_visible(False)


def main() -> None:
    """Draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="folder with lamprey1.npz, lamprey1_fish.csv")
    folder = parser.parse_args().folder
    data, labels = np.load(folder / "lamprey1.npz"), labelled(folder / "lamprey1_fish.csv")
    seen, tracks = processed(data)
    figure, (whole, near) = plt.subplots(
        1, 2, figsize=(9.0, 5.6), width_ratios=(1.0, 2.1), layout="constrained"
    )
    draw_sector(whole, data["azimuth_rad"], data["range_m"])
    whole.set(ylabel="m ahead", title=f"{len(seen)} detections, {len(tracks)} tracks")
    near.set(title="the fish, enlarged", xlabel="m to starboard", aspect="equal")
    near.set(xlim=(-1.3, 1.7), ylim=(7.15, 9.75))
    for axis, size in ((whole, 1.5), (near, 3.0)):
        axis.plot(*seen.T, ".", ms=size, color="0.55", mew=0)
        for points in tracks.values():
            way = np.array(points)
            fish = fish_of(way, labels)
            colour = COLOURS.get(fish, OTHER)
            axis.plot(*way[:, 1:].T, color=colour, lw=2.2 if fish else 1.2)
            axis.plot(*way[-1, 1:], "o", ms=5 if fish else 3, color=colour)
    for fish, rows in labels.items():
        style = {"color": COLOURS[fish], "weight": "bold", "size": 13}
        near.plot(*rows[:, 1:].T, "o", ms=11, mfc="none", mec=COLOURS[fish], mew=0.9)
        near.annotate(fish, rows[0, 1:], (9, 6), textcoords="offset points", **style)
    near.plot([], [], ".", ms=5, color="0.55", mew=0, label="detection, in any of 150 images")
    near.plot([], [], "o", ms=10, mfc="none", mec=COLOURS["A"], label="fish, labelled by eye")
    near.plot([], [], "o-", ms=5, lw=2.2, color=COLOURS["A"], label="track of a labelled fish")
    near.plot([], [], "o-", ms=3, lw=1.2, color=OTHER, label="other track")
    near.legend(fontsize=9, loc="lower right")
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
