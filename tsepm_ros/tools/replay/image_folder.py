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
"""A folder of sonar images, whose detections become a recording.

- ``geometry.yaml``: ``range: [first, last]`` (m, middles of the cells; or ``near_range`` and
  ``far_range``) and ``azimuth: [first, last]`` (rad, counter-clockwise from the sensor's x axis),
  or lists of all; optionally ``rows``: ``ranges``, ``fan`` or ``beams`` (default), ``near_first``
  and ``port_first``, as the parameters ``image.*`` of `sonar_detector`, and options of the
  detector. Of a fan, ``azimuth`` has the edges; else its order, and that of ``range``, say what is
  first if the parameters do not;
- ``times.csv``: ``time_s`` of each image, ascending, and ``file``, its name (.png, .pgm, .npy), or
  else all images are one array (images, rows, columns) in ``images.npy`` or ``images.npz``;
- optionally ``own_ship.csv`` and ``target.csv`` of a recording.
"""

from __future__ import annotations

import dataclasses
import shutil
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msg_adapters import seconds_to_ns
from msg_adapters.image_messages import grey_image, image_by_beam, image_in_words, located_image
from msg_adapters.sonar_images import FirstLook
from msg_adapters.stamps import refusing
from tsepm_ros.detector.bright_lines import LOOKS
from tsepm_ros.detector.detector import Detector
from tsepm_ros.detector.image import DetectorOptions, ImageCoverage, SonarImage
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.own_ship.pose_history import PoseHistory
from tsepm_ros.own_ship.registration import Mounting
from tsepm_ros.parameters import WHOLE_TURN, Parameter, shown_parameter
from tsepm_ros.session.turn import ImagePing, TurnRepeats
from tsepm_ros.settings.node_options import ImageLayout
from tsepm_ros.settings.parameter_files import load_parameter_file_text
from tsepm_ros.settings.settings import Groups, make_groups, settings_table
from tsepm_ros.tools.replay.recording import (
    DETECTION_COLUMNS,
    DETECTIONS_FILE,
    GEOMETRY,
    MOTION_FILES,
    OWN_SHIP_FILE,
    TIMES,
    RecordedScan,
    Recording,
    check_recording_times,
    description_missing,
    read_recorded_own_ship,
    read_recording,
    recorded_numbers,
)
from tsepm_ros.tools.terminal import terminal_progress
from tsepm_ros.tracker.scan import ECHO_FEATURES, Scan
from tsepm_ros.tracker.sensor import Coverage
from tsepm_ros.whole_files import (
    opened_whole,
    read_whole_csv,
    read_whole_text,
    refuse_overwriting_inputs,
)

ARRAYS = "images.npy", "images.npz"
IMAGE_FIELDS = "range", "azimuth", "range_std", "azimuth_std", *ECHO_FEATURES, "standing"
"""Of the detections of images, in the order of their columns."""
FOLDER: Groups = (
    *(("", group) for group in (DetectorOptions, Coverage, ImageLayout)),
    ("mounting.", Mounting),
)
"""Parameters that ``geometry.yaml`` may have."""
MAX_GAP = 5.0
"""Time of images without poses from which on it is said, s."""
AXES = (
    Parameter("range", 0.0, "", unit="m", minimum=0.0, maximum=1e8),
    Parameter("azimuth", 0.0, "", unit="rad", minimum=-WHOLE_TURN, maximum=WHOLE_TURN),
)
"""What the numbers of its lists must be."""


def read_image_folder(
    folder: Path, notes: list[str], outputs: Sequence[Path] = (), **options: Any
) -> tuple[Detector, FloatArray, Iterator[SonarImage]]:
    """The detector of a folder, the times of its images, s, and the images one by one.

    Parameters
    ----------
    folder : Path
    notes : list of str
        Gets what the geometry says, and questions about it, as images are read.
    outputs : sequence of Path, optional
        Files that will be written: none may be read here.
    **options
        Of the detector, in place of those in the folder; and own_ship_delay, s.

    Raises
    ------
    ValueError
        If a file is missing or malformed; the message names it.
    """
    delay = float(options.pop("own_ship_delay", 0.0))
    _check(folder)
    geometry = read_whole_text(folder / GEOMETRY)
    try:
        values, axes = _geometry(geometry)
        groups = make_groups(FOLDER, {**values, **options})
        (_, header), *lines = read_whole_csv(folder / TIMES, ("time_s", "file"))
        rows = [dict(zip(header, map(str.strip, row), strict=True)) for _, row in lines]
        times = np.array(
            [
                recorded_numbers(f"{TIMES}, line {line}", [row.get("time_s", "nan")])[0]
                for (line, _), row in zip(lines, rows, strict=True)
            ]
        )
        rises = np.diff(times, prepend=-np.inf) > 0.0  # a nan does not
        if not rises.all() or not lines:
            raise ValueError(
                f"{TIMES} has no column 'time_s'; it has {shown_parameter(header)}"
                if "time_s" not in header
                else f"{TIMES}, line {lines[rises.argmin()][0]}: time_s must be a number, and "
                f"later than that of the image before; got {times[rises.argmin()]:.10g}"
                if lines
                else f"{TIMES} names no image"
            )
        check_recording_times(TIMES, {"time_s": times}, [line for line, _ in lines])
    except ValueError as error:
        raise ValueError(f"{folder}: {GEOMETRY} or {TIMES} cannot be read: {error}") from None
    arrays = [folder / name for name in ARRAYS if (folder / name).exists()]
    stored = np.atleast_1d(_stored(arrays[0])) if arrays else _listed(folder, rows, notes)
    if len(stored) != len(times):
        raise ValueError(f"{folder} holds {len(stored)} images, {TIMES} {len(times)} times")
    refuse_overwriting_inputs(
        [*map(folder.joinpath, (GEOMETRY, TIMES, *MOTION_FILES)), *(arrays or stored)], outputs
    )
    layout: ImageLayout = groups[ImageLayout]
    mounting: Mounting = groups[Mounting]
    poses = PoseHistory(min_span=np.inf)
    recorded = read_recorded_own_ship(folder, notes)
    for sample in recorded:
        if sample.covariance is None:  # its heading is known
            poses.add(dataclasses.replace(sample, stamp=sample.stamp - delay))
    first, last = (recorded[0].stamp, recorded[-1].stamp) if recorded else (times[0], times[-1])
    if recorded and not poses:
        notes.append(f"{OWN_SHIP_FILE} has no heading: the background is that of a sonar at rest")
    elif max(times[-1] - last, first - times[0]) > MAX_GAP:
        notes.append(
            f"{OWN_SHIP_FILE} has poses from {first:g} to {last:g} s, images are from "
            f"{times[0]:g} to {times[-1]:g} s: beyond its poses the sonar counts as at rest"
        )
    sound = axes[0][-1] / 750.0  # s, to the farthest range and back at 1500 m/s
    question = (
        f"sound takes {sound:.3g} s to {axes[0][-1]:g} m and back, and more than ten images come "
        f"meanwhile: are the ranges of {GEOMETRY} in mm? They are read as m; a radar's may be right"
    )
    notes.extend([question] * bool(sound * (len(times) - 1) > 10.0 * (times[-1] - times[0]) > 0.0))
    look = FirstLook(min(LOOKS, len(times)))

    def images() -> Iterator[SonarImage]:
        for time, one in zip(times.tolist(), stored, strict=True):
            values, place = (
                (_stored(one), f"{one}:")
                if isinstance(one, Path)
                else (one, f"{folder}, image at {time:g} s:")
            )
            pose = mounting.image_poses(poses.held_poses(np.array([time])))[0] if poses else None
            with refusing("bad_image", place):
                picture = grey_image(np.asarray(values))
                image = SonarImage(time, *_placed(picture, layout, axes), sensor_pose=pose)
            words = image_in_words(picture, layout, image.range, image.azimuth)
            notes.extend([words] * (words not in notes))
            notes.extend(look.add(image, layout.rows))
            yield image

    return Detector(groups[DetectorOptions], groups[Coverage]), times, images()


def _check(folder: Path) -> None:
    """Say what a folder that lacks its description must hold."""
    if folder.is_dir() and (missing := description_missing(folder)):
        raise ValueError(
            f"{folder} has {missing}: {GEOMETRY} states the ranges and azimuths of the images "
            "(range: [first, last] in m, azimuth: [first, last] in rad), "
            f"{TIMES} their times and names (columns time_s, file)"
        )


def _listed(folder: Path, rows: Sequence[dict[str, str]], notes: list[str]) -> list[Path]:
    """The files of the images, as the times name them."""
    if "file" not in rows[0]:
        raise ValueError(f"{TIMES} has no column file, and {folder} no {' or '.join(ARRAYS)}")
    files = [folder / (row["file"] or "") for row in rows]
    kinds = {file.suffix for file in files}
    number = sum(file.suffix in kinds for file in {*folder.iterdir()} - {*files})
    notes.extend([f"{number} images of {folder} are not in {TIMES}"] * bool(number))
    return files


def _geometry(text: str) -> tuple[dict[str, Any], list[FloatArray]]:
    """Parameters of a geometry, and its ranges and azimuths: first and last, or all."""
    content = load_parameter_file_text(text)
    if not isinstance(content, dict):
        raise ValueError(f"expected names and values, got {shown_parameter(content)}")
    values = {"rows": "beams"} | {str(name): value for name, value in content.items()}
    values["rows"] = "beams" if values["rows"] in ("auto", "bearings") else values["rows"]
    ends, axes = [values.get("near_range"), values.get("far_range")], list[FloatArray]()
    if ends.count(None) != (2 if "range" in values else 0):
        raise ValueError("range, or both near_range and far_range must be given")
    for row, default, first in zip(AXES, (ends, None), ("near_first", "port_first"), strict=True):
        given = values.pop(row.name, default)
        if not isinstance(given, list) or not given:
            raise ValueError(
                f"{row.name} must be a list in {row.unit}, of first and last or all; got "
                f"{shown_parameter(given)}"
            )
        turned = row.name == "azimuth" and values.get("clockwise") is True
        axis = np.array([row.check(one) for one in given]) * (-1.0 if turned else 1.0)
        descends = bool(axis[0] > axis[-1])
        if given is not ends and values["rows"] != "fan":
            values.setdefault(first, descends == (first == "port_first"))
        axes.append(axis[::-1] if descends else axis)
    return values, axes


def _placed(
    picture: NDArray[Any], layout: ImageLayout, axes: list[FloatArray]
) -> tuple[FloatArray, FloatArray, NDArray[Any]]:
    """Ranges above 0, azimuths and intensities (b, m) of a picture."""
    if layout.rows == "fan":
        ends, sector = ((float(axis[0]), float(axis[-1])) for axis in axes)
        distance, azimuth, table = located_image(picture, layout, ends, sector)
    else:
        table = image_by_beam(picture, layout)
        distance, azimuth = (
            np.linspace(axis[0], axis[-1], cells) if len(axis) == 2 else axis
            for axis, cells in zip(axes, table.T.shape, strict=True)
        )
        azimuth = azimuth[:: -1 if layout.port_first else 1]
    first = int((distance <= 0.0).sum())
    return distance[first:], azimuth, table[:, first:]


def write_image_folder_detections(
    folder: Path, path: Path, notes: list[str], outputs: Sequence[Path] = (), **options: Any
) -> Iterator[tuple[Detector, SonarImage, Scan]]:
    """Write the detections of a folder's images as a recording, and give them one by one.

    Other arguments are those of `read_image_folder`. As live, an image that equals the one before
    to the bit is left out.
    """
    detector, times, images = read_image_folder(folder, notes, outputs, **options)
    copies = list[str]()
    repeats = TurnRepeats(
        lambda _, said: copies.append(said), lambda said: notes.extend([said] * (said not in notes))
    )
    with opened_whole(path) as file:
        file.write(f"scan,time_s,{','.join(map(DETECTION_COLUMNS.__getitem__, IMAGE_FIELDS))}\n")
        for number, image in enumerate(terminal_progress(images, len(times), "detection", "image")):
            stated = image.range, image.azimuth, image.intensity
            ping = repeats.new_in(ImagePing(seconds_to_ns(image.stamp), "", *stated))
            if ping is None:
                continue
            scan = detector.process(dataclasses.replace(image, intensity=ping.intensity))
            notes.extend(one for one in detector.notes if one not in notes)
            fields = {**vars(scan), **scan.features}
            for row in zip(*map(fields.__getitem__, IMAGE_FIELDS), strict=True):
                values = ",".join(repr(float(value)) for value in row)  # a replay has the same bits
                file.write(f"{number},{scan.stamp!r},{values}\n")
            yield detector, image, scan
    notes.extend(f"{len(copies)} copies of images or bearings: {said}" for said in copies[:1])


def image_folder_detected(
    folder: Path, into: Path, outputs: Sequence[Path], given: Mapping[str, Any]
) -> tuple[Recording, dict[str, Any]]:
    """The recording of a folder's images, with its own ship and truth.

    As live, an image without a detection is an empty scan.

    Parameters
    ----------
    folder : Path
    into : Path
        An empty folder, for the files of the recording.
    outputs : sequence of Path
        As for `read_image_folder`.
    given : mapping of str to value
        Parameters of `sonar_detector`, in place of those in the folder, which states the layout.

    Returns
    -------
    recording : Recording
    values : dict of str to value
        Coverage of the images, and the mounting that the folder states, by their parameters.
    """
    for path in filter(Path.is_file, folder.glob("*.csv")):
        shutil.copy(path, into)
    options = {
        row.name: given[name]
        for row in settings_table(FOLDER)
        for name in (row.name, f"sensor.{row.name}")
        if name in given
    }
    unused = ", ".join(name for name in given if name.startswith("image."))
    notes = [f"no use is made of {unused}: {GEOMETRY} states how the images lie"] * bool(unused)
    empty = list[RecordedScan]()  # in place of those by the numbers of own ship's file
    for detector, image, scan in write_image_folder_detections(  # noqa: B007 (the last are used)
        folder,
        into / DETECTIONS_FILE,
        notes,
        outputs,
        own_ship_delay=given.get("own_ship_delay", 0.0),
        **options,
    ):
        if not len(scan):
            empty.append(RecordedScan(scan.stamp, dict.fromkeys(IMAGE_FIELDS, scan.range)))
    recording = read_recording(into / DETECTIONS_FILE)
    recording.scans[:] = sorted(
        [*(scan for scan in recording.scans if len(scan.fields["range"])), *empty],
        key=lambda one: one.time,
    )
    recording.notes.extend(notes)
    coverage = ImageCoverage(image.range, image.azimuth, detector.coverage)  # that of all images
    values = {f"sensor.{name}": value for name, value in coverage.values.items()}
    stated, _ = _geometry(read_whole_text(folder / GEOMETRY))
    values |= {name: value for name, value in stated.items() if name.startswith("mounting.")}
    return recording, values


def _stored(path: Path) -> Any:
    """The array of a file; Pillow reads pictures."""
    try:
        if path.suffix in (".npy", ".npz"):
            return (
                np.lib.format.open_memmap(path, mode="r")  # a header may promise more than memory
                if path.suffix == ".npy"
                else next(iter(np.load(path).values()))
            )
        from PIL import Image

        with Image.open(path, formats=("PNG", "PPM", "TIFF", "BMP", "JPEG")) as picture:
            is_grey = picture.mode in ("1", "L", "I", "F") or picture.mode.startswith("I;")
            return np.asarray(picture if is_grey else picture.convert("RGB"))
    except Exception as error:  # readers of broken files raise any
        raise ValueError(f"{path} cannot be read as images: {error or repr(error)}") from None
