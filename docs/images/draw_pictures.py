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
"""Draw demo.png and demo.gif of the pages, and joyride.png where its recording is.

python docs/images/draw_pictures.py [--recording FOLDER OF joyride]
"""

from __future__ import annotations

import argparse
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from PIL import Image

from tsepm_ros.tools.commands.run_command import add_run_source_arguments, open_run
from tsepm_ros.tools.demo import demo_target_rows
from tsepm_ros.tools.evaluation.result_files import Result, add_result_file, write_result
from tsepm_ros.tools.pictures import plan_position
from tsepm_ros.tools.pictures.run_scene import RunScene, SceneScan
from tsepm_ros.tools.terminal import terminal_progress

IMAGES = Path(__file__).parent
SEED = 2
RADAR = ["bearing_reference:=north", "max_speed:=15.0"]
RADAR += ["sensor.range_std:=15.0", "sensor.range_std_fraction:=0.0"]


def scene_of(*arguments: str) -> RunScene:
    """A run as `tsepm run` draws it, with the same arguments."""
    parser = argparse.ArgumentParser()
    add_run_source_arguments(parser)
    with ExitStack() as stack:
        run = open_run(parser.parse_args(arguments), stack)
        scene = RunScene(run.title, truth=run.truth)
        for result in terminal_progress(run.results, run.scans, "scans", "scan"):
            view = SceneScan.of(result, run.session.settings.sensor, run.mounting_yaw)
            scene.scans.append(view)
        run.judge(scene)
    return scene


def animate(scene: RunScene, path: Path) -> None:
    """Draw a judged run as a GIF: the picture of the scans so far, each for half a second."""
    frames, size = [], plan_position.draw(scene).get_size_inches()
    for number in terminal_progress(range(1, len(scene.scans) + 1), len(scene.scans), "frames"):
        judged = [one for one in scene.judged if scene.start_scans[one.track.track_id] <= number]
        figure = plan_position.draw(replace(scene, scans=scene.scans[:number], judged=judged))
        figure.set(size_inches=size, dpi=60)
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        drawn = Image.fromarray(np.asarray(canvas.buffer_rgba())[:, :, :3].copy())
        # By coverage of the colours, not by their number of pixels: a track has few.
        palette = {"method": Image.Quantize.MAXCOVERAGE, "dither": Image.Dither.NONE}
        frames.append(drawn.quantize(64, **palette))
    times = [500] * (len(frames) - 1) + [2500]
    frames[0].save(path, save_all=True, append_images=frames[1:], duration=times, loop=0)


def main() -> None:
    """Draw, and write the demo's table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--recording", help="folder of the recording joyride")
    add_result_file(parser)
    options = parser.parse_args()
    demo = scene_of("four_targets", "--seed", str(SEED))
    plan_position.save(demo, IMAGES / "demo.png")
    animate(demo, IMAGES / "demo.gif")
    if options.recording:
        values = [part for value in RADAR for part in ("-p", value)]
        plan_position.save(scene_of(options.recording, *values), IMAGES / "joyride.png")
    header, *rows = demo_target_rows(demo)
    line = "python docs/images/draw_pictures.py"
    if options.result:
        write_result(
            options.result, Result(command=line, seed=SEED, runs=1, header=header, rows=rows)
        )


if __name__ == "__main__":
    main()
