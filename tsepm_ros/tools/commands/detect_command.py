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
"""The command `tsepm detect`: sonar images to detections, and a picture of one image."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from tsepm_ros.detector.detector import Stages
from tsepm_ros.detector.image import SonarImage
from tsepm_ros.tools.commands.arguments import CommandFailed, in_folder_argument, seed
from tsepm_ros.tools.replay.image_folder import write_image_folder_detections
from tsepm_ros.tools.replay.recording import DETECTIONS_FILE
from tsepm_ros.tracker.scan import Scan, wrap
from tsepm_ros.whole_files import write_whole_picture

OPTIONS = {
    "false_detections_per_ping": "kept by the threshold; default 5",
    "range_extent": "of an echo, m; default learned",
    "azimuth_extent": "of an echo, rad; default learned",
    "slowest_speed": "of a target that is to be told from what stands, m/s; default 0.1",
    "min_range": "nearest range that is used, m; default 0",
    "max_range": "farthest range that is used, m; default all",
    "azimuth_min": "start of the sector that is used, rad; default all round",
    "azimuth_max": "end of it, counter-clockwise, rad",
}
"""Options of the detector, in place of those in the folder."""


def add_detect_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `tsepm detect`."""
    parser.add_argument("folder", type=Path, help="geometry.yaml, times.csv and the images")
    for name, text in OPTIONS.items():
        parser.add_argument(f"--{name.replace('_', '-')}", type=float, help=text)
    parser.add_argument(
        "--out", type=in_folder_argument, default=Path(DETECTIONS_FILE), help="CSV file"
    )
    parser.add_argument(
        "--picture", type=in_folder_argument, help="picture of an image at its stages"
    )
    parser.add_argument("--image", type=seed, default=20, help="which, from 0; default 20 or last")


def run_detect(options: argparse.Namespace) -> None:
    """Detect in a folder of images, write the detections, and say what was measured.

    Raises
    ------
    ValueError
        If an argument is not allowed, or an image cannot be read.
    CommandFailed
        If there is no image.
    """
    given = {name: value for name in OPTIONS if (value := getattr(options, name)) is not None}
    found, notes, drawn = list[int](), list[str](), None
    outputs = [options.out, options.picture or options.out]
    for k, (detector, image, scan) in enumerate(
        write_image_folder_detections(options.folder, options.out, notes, outputs, **given)
    ):
        found.append(len(scan))
        if k <= options.image and detector.stages is not None:
            drawn = image, detector.stages, scan
    if 0 in found:
        notes.append(
            f"{found.count(0)} of {len(found)} images have no detection and are not in the file; "
            f"tsepm run {options.folder} takes them as empty scans"
        )
    for note in notes:
        print(f"note: {note}", file=sys.stderr)
    if not any(found) or drawn is None:
        raise CommandFailed(f"{options.folder} has no image with an echo")
    if options.picture:
        draw_detect(options.picture, *drawn)
    measured = ", ".join(f"{name} {value:.3g}" for name, value in detector.measured.items())
    print(f"{sum(found)} detections in {options.out}; {measured}", file=sys.stderr)
    stated = f"{detector.options.false_detections_per_ping:g} false ones are stated"
    print(f"a ping: {detector.kinds()}; {stated}", file=sys.stderr)


def draw_detect(path: Path, image: SonarImage, stages: Stages, scan: Scan) -> None:
    """Picture of an image, its background, the smoothed image and the detections.

    Raises
    ------
    ValueError
        If matplotlib is not installed.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError:
        raise ValueError("pictures need matplotlib, see the extra plot") from None
    figure = Figure(figsize=(12, 9), layout="constrained")
    panels = {
        "image": image.intensity,
        "background of the ring and of each cell": stages.background,
        f"smoothed; black: above the threshold {stages.threshold:.2f}": stages.smoothed,
        f"{len(scan)} detections": stages.standardised,
    }
    degrees, all_axes = np.degrees(image.azimuth), figure.subplots(2, 2, sharex=True, sharey=True)
    for axes, (title, values) in zip(all_axes.flat, panels.items(), strict=True):
        low, high = np.nanquantile(values, [0.01, 0.999])
        mesh = axes.pcolormesh(degrees, image.range, values.T, vmin=low, vmax=high, rasterized=True)
        figure.colorbar(mesh, ax=axes)
        axes.set(title=title, xlabel="azimuth, degrees", ylabel="range, m")
    all_axes[1, 0].contour(
        degrees, image.range, stages.smoothed.T, [stages.threshold], colors="black"
    )
    middle = 0.5 * (image.azimuth[0] + image.azimuth[-1])
    azimuth = middle + wrap(scan.azimuth - middle)
    axes.plot(np.degrees(azimuth), scan.range, "o", color="red", fillstyle="none")
    write_whole_picture(path, figure)
    print(f"picture: {path}, of the image at {image.stamp:.10g} s", file=sys.stderr)
