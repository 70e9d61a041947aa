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
"""Held against elsewhere: `score` by its accepted rate and the plain Kalman tracker by its rule.

    python benchmarks/curves.py [--data FOLDER] [--box docs/results/box.json] [--runs 3]
        [--picture docs/images/curves.png] [--json build/curves.json]

A panel a scene: the pool and the clip *lamprey1* of `detector.py` (with `--data FOLDER`, which has
aquascan and didson; 5 detections stated, extent of the pool learned, each detector run once), the
box from a result of `tsepm evaluate`, and the groups of `crowds.py`. Held: share of the labels, or
of the targets' scans, with a confirmed track; in the box the targets found in its scans. Elsewhere:
tracks a minute that never came near a label or target; in the box false ones.
`score` accepts 1 to 3000 false tracks an hour, with its defaults; the Kalman tracker has rules of
2/3 to 5/7, with the other options that suit the scene best.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import crowds
import fixed_threads  # noqa: F401  # before numpy
import matplotlib
import numpy as np
from detector import CLIP_OPTIONS, POOL_OPTIONS, clip_images, clip_parts, pool_images, pool_parts
from groups_scenes import GROUPS
from result_tables import printed

from tsepm_ros import Scan, SensorModel, make_initiator
from tsepm_ros.tools.evaluation.result_files import read_result
from tsepm_ros.whole_files import write_whole_text, written_whole

matplotlib.use("Agg")

import matplotlib.pyplot as plt
from matplotlib.ticker import NullFormatter

RATES = 1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0, 3000.0
RULES = (2, 3), (3, 4), (3, 5), (4, 6), (5, 7)
GROUP_RATES = 1.0, 10.0, 100.0, 1000.0
"""Fewer of the groups, for time."""
STATED = 5.0
"""Detections of an image."""
LEAST = 0.03
"""Tracks a minute, where none were elsewhere."""
COLUMNS = 4
Detected = Sequence[tuple[Scan, Sequence[np.ndarray]]]
"""Scans, and the places (2,) that are labelled."""
Point = tuple[str, str, str, float, float]
"""Scene, method, setting, held and elsewhere."""
Row = Iterator[Point]


def settings(
    rates: Sequence[float], given: Mapping[str, Mapping[str, Any]]
) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Methods, names of settings and options of a scene."""
    for rate in rates:
        yield "score", f"{rate:g}/h", {**given["score"], "false_tracks_per_hour": rate}
    for hits, window in RULES:
        rule = {"min_hits": hits, "window": window}
        yield "kalman", f"{hits}/{window}", {**given["kalman"], **rule}


def followed(
    detected: Detected, near: float, method: str, sensor: SensorModel, **options: Any
) -> tuple[float, float]:
    """Share of labels with a confirmed track within a distance (m), and tracks elsewhere/min."""
    tracker, ids, own = make_initiator(method, sensor=sensor, **options), set(), set()
    held, count = 0, 0
    for scan, labels in detected:
        tracker.process(scan)
        tracks = tracker.current.sure
        ids |= set(tracks.track_id.tolist())
        for place in labels:
            close = np.linalg.norm(tracks.state[:, 0::2] - place, axis=1) < near
            own |= set(tracks.track_id[close].tolist())
            held, count = held + bool(close.any()), count + 1
    minutes = (detected[-1][0].stamp - detected[0][0].stamp) / 60.0
    return held / count, len(ids - own) / minutes


def real(data: Path) -> Row:
    """The pool and a clip."""
    pool, clip = (
        list(pool_images(data / "aquascan")),
        list(clip_images(data / "didson", "lamprey1")),
    )
    parts = {
        "pool": (pool, 1.2, pool_parts(STATED, {}), POOL_OPTIONS),
        "lamprey1": (clip, 0.25, clip_parts(clip[0][0], STATED), CLIP_OPTIONS),
    }
    for name, (images, near, (detector, sensor), given) in parts.items():
        detected = [
            (detector.process(image), [place for _, place, _ in labels]) for image, labels in images
        ]
        for method, setting, options in settings(RATES, given):
            yield name, method, setting, *followed(detected, near, method, sensor, **options)


def box(file: Path) -> Row:
    """The box by an evaluation, after all its scans."""
    measures = read_result(file).measures
    last = max(row["scans"] for row in measures)
    for row in measures:
        if row["scans"] == last and row["method"] in ("score", "kalman"):
            at = row["found"][0], row["false_per_hour"][0] / 60.0
            yield "box", row["method"], row["point"], *at


def groups(runs: int) -> Row:
    """The scenes of `crowds.py`, means over runs."""
    for name, scene in GROUPS.items():
        own = {**crowds.TRACKERS["kalman 3/5"], "process_noise": scene.process_noise}
        for method, setting, options in settings(GROUP_RATES, {"score": {}, "kalman": own}):
            given = argparse.Namespace(runs=runs, seed=1, sure=False)
            watches = crowds.watches_of(
                partial(scene.draw, scene.sensor),
                scene.gate,
                given,
                runs,
                method,
                crowds.GroupWatch,
                sensor=scene.sensor,
                max_speed=scene.max_speed,
                **options,
            )
            table = [watch.figures() for watch in watches]
            minutes = np.mean([watch.minutes for watch in watches])
            held, elsewhere = (
                np.mean([row[key] for row in table]) for key in ("held", "elsewhere")
            )
            yield name, method, setting, float(held), float(elsewhere / minutes)


def drawn(points: Sequence[Point], file: Path) -> None:
    """A panel a scene, a curve a method."""
    scenes = list(dict.fromkeys(point[0] for point in points))
    rows = -(-len(scenes) // COLUMNS)
    figure, axes = plt.subplots(rows, COLUMNS, figsize=(13.0, 2.9 * rows), layout="constrained")
    colours = {"score": "#0072B2", "kalman": "#D55E00"}
    for axis, scene in zip(axes.flat, scenes, strict=False):
        for method, colour in colours.items():
            own = [point for point in points if point[:2] == (scene, method)]
            if not own:
                continue
            at = [max(point[4], LEAST) for point in own], [point[3] for point in own]
            axis.plot(*at, "o-", color=colour, markersize=4, linewidth=1.0, label=method)
            for k in (0, -1):
                axis.annotate(own[k][2], (at[0][k], at[1][k]), fontsize=7, color=colour)
        axis.set(xscale="log", title=scene, xlabel="elsewhere, 1/min", ylabel="held")
        axis.xaxis.set_minor_formatter(NullFormatter())
        axis.legend(fontsize=7)
    for axis in list(axes.flat)[len(scenes) :]:
        axis.remove()
    with written_whole(file) as temporary:
        figure.savefig(temporary, dpi=110, format="png")


def main() -> None:
    """Measure, print, write and draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, help="folder of the real data")
    parser.add_argument("--box", type=Path, help="result file of tsepm evaluate box")
    parser.add_argument("--runs", type=int, default=3, help="of each group; 0: none")
    parser.add_argument("--picture", type=Path, default=Path("docs/images/curves.png"))
    parser.add_argument("--json", type=Path, default=Path("build/curves.json"))
    options = parser.parse_args()
    points: list[Point] = []

    def rows() -> Iterator[list[str]]:
        yield ["scene", "method", "setting", "held", "elsewhere, 1/min"]
        parts = [real(options.data)] if options.data else []
        parts += [box(options.box)] if options.box else []
        for part in [*parts, *([groups(options.runs)] if options.runs else [])]:
            for point in part:
                points.append(point)
                yield [*point[:3], f"{point[3]:.3f}", f"{point[4]:.2f}"]

    printed(rows())
    options.json.parent.mkdir(parents=True, exist_ok=True)
    write_whole_text(options.json, json.dumps(points, indent=1))
    drawn(points, options.picture)


if __name__ == "__main__":
    main()
