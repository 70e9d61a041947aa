"""Folders of sonar images, and the recordings of their detections.

- ``geometry.yaml``: ``range: [first, last]`` (m, centres of the cells) and ``azimuth: [first,
  last]`` (rad, counter-clockwise from the sensor's x axis), or lists of all; optionally ``rows:
  ranges`` where the rows of an image are ranges (default bearings), and options of the detector;
- ``times.csv``: ``time_s`` of each image, and ``file``, its name (.png, .pgm, .npy), or else all
  images are one array (images, rows, columns) in ``images.npy`` or ``images.npz``;
- optionally ``own_ship.csv`` and ``target.csv`` of a recording.
"""

from __future__ import annotations

import csv
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from tsepm_ros.detector.detector import Detector, make_detector
from tsepm_ros.detector.image import ImageCoverage, SonarImage
from tsepm_ros.tools.replay.recording import DETECTIONS_FILE
from tsepm_ros.tools.terminal import with_progress
from tsepm_ros.tracker.scan import Scan
from tsepm_ros.whole_files import opened_whole

GEOMETRY, TIMES, ARRAYS = "geometry.yaml", "times.csv", ("images.npy", "images.npz")
COLUMNS = "scan,time_s,range_m,azimuth_rad,range_std_m,azimuth_std_rad,intensity,range_width_m,"
COLUMNS += "azimuth_width_rad"


def read_images(folder: Path, **options: float) -> tuple[Detector, list[float], Iterator[Any]]:
    """The detector of a folder, the times of its images, s, and the images one by one.

    Parameters
    ----------
    folder : Path
    **options
        Of the detector, in place of those in the folder.

    Raises
    ------
    ValueError
        If a file is missing or malformed; the message names it.
    """
    try:
        geometry = dict(yaml.safe_load((folder / GEOMETRY).read_text(encoding="utf-8")))
        axes = [np.array(geometry.pop(name), float) for name in ("range", "azimuth")]
        transposed = geometry.pop("rows", "bearings") == "ranges"
        with (folder / TIMES).open(newline="", encoding="utf-8-sig") as file:
            rows = list(csv.DictReader(file))
        times = [float(row["time_s"]) for row in rows]
    except (OSError, KeyError, TypeError, ValueError, yaml.YAMLError) as error:
        raise ValueError(f"{folder}: {GEOMETRY} or {TIMES} cannot be read: {error!r}") from None
    arrays = [folder / name for name in ARRAYS if (folder / name).exists()]
    stored = _array(arrays[0]) if arrays else [folder / (row.get("file") or "") for row in rows]
    if len(stored) != len(times):
        raise ValueError(f"{folder} holds {len(stored)} images, {TIMES} {len(times)} times")

    def images() -> Iterator[SonarImage]:
        for time, one in zip(times, stored, strict=True):
            image = _array(one) if isinstance(one, Path) else one
            image = image.T if transposed else image
            distance, azimuth = (
                np.linspace(axis[0], axis[-1], cells) if len(axis) == 2 else axis
                for axis, cells in zip(axes, image.T.shape, strict=False)
            )
            yield SonarImage(time, distance, azimuth, image)

    return make_detector(**{**geometry, **options}), times, images()


def write_detections(
    folder: Path, path: Path, **options: float
) -> Iterator[tuple[Detector, SonarImage, Scan]]:
    """Write the detections of a folder's images as a recording, and give them one by one."""
    detector, times, images = read_images(folder, **options)
    with opened_whole(path) as file:
        file.write(COLUMNS + "\n")
        for number, image in enumerate(with_progress(images, len(times), "detection", "image")):
            scan = detector.process(image)
            columns = [scan.range, scan.azimuth, scan.range_std, scan.azimuth_std]
            columns += [
                scan.features[name] for name in ("intensity", "range_width", "azimuth_width")
            ]
            for row in zip(*columns, strict=True):
                file.write(f"{number},{scan.stamp!r}," + ",".join(f"{v:.7g}" for v in row) + "\n")
            yield detector, image, scan


def detected(folder: Path, into: Path) -> tuple[Path, dict[str, float]]:
    """Write the detections of a folder of images into a recording, with its own ship and truth.

    Returns
    -------
    path : Path
        Of the detections, in the folder `into`.
    coverage : dict of str to float
        Coverage of the images, by its parameters.
    """
    coverage: dict[str, float] = {}
    for path in folder.glob("*.csv"):
        shutil.copy(path, into)
    for _, image, _ in write_detections(folder, into / DETECTIONS_FILE):
        coverage = ImageCoverage(image.range, image.azimuth).values
    values = {f"sensor.{name}": value for name, value in coverage.items()}
    return into / DETECTIONS_FILE, values


def _array(path: Path) -> Any:
    """The array of a file; matplotlib reads pictures."""
    try:
        if path.suffix in (".npy", ".npz"):
            stored = np.load(path)
            return stored[stored.files[0]] if path.suffix == ".npz" else stored
        from matplotlib.image import imread

        return imread(path)
    except (ImportError, OSError, ValueError, SyntaxError) as error:
        raise ValueError(f"{path} cannot be read as images: {error}") from None
