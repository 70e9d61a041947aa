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
"""A folder of sonar images: pictures and arrays as they are, and what is refused."""

import numpy as np
import pytest
from support.image_folder import GEOMETRY

from msg_adapters.image_messages import located_image
from tsepm_ros.settings.node_options import ImageLayout
from tsepm_ros.tools.commands.cli import main
from tsepm_ros.tools.replay.image_folder import image_folder_detected, read_image_folder


def test_pictures_of_rows_of_ranges_are_read_too(folder, capsys):
    imsave = pytest.importorskip("matplotlib.image").imsave
    with np.load(folder / "images.npz") as stored:
        images = stored["arr_0"]
    (folder / "images.npz").unlink()
    rows = ["time_s,file"]
    for k, image in enumerate(images):
        np.save(folder / f"{k}.npy", image.T)
        rows.append(f"{k},{k}.npy")
    (folder / "times.csv").write_text("\n".join(rows))
    (folder / "geometry.yaml").write_text(GEOMETRY + "rows: ranges\n")
    for _ in range(2):  # a result in the folder is no input
        assert main(["detect", str(folder), "--out", str(folder / "out.csv")]) == 0
    imsave(folder / "0.png", images[0])
    (folder / "times.csv").write_text("time_s,file\n0,1.npy\n1,0.png\n")
    assert main(["detect", str(folder), "--out", str(folder / "out.csv")]) == 2
    assert f"{folder / '0.png'}: a picture must have" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "text", "sentence"),
    [
        ("geometry.yaml", "range: [1, 2]\n", "azimuth must be a list in rad, of first and last"),
        ("geometry.yaml", "range_m: [1, 2]\n", "range, or both near_range and far_range must be"),
        ("geometry.yaml", "far_range: 2\n", "range, or both near_range and far_range must be"),
        ("times.csv", "time_s\n0\n", "holds 12 images, times.csv 1 times"),
        ("times.csv", "time_s\nnoon\n", "cannot be read"),
        ("geometry.yaml", GEOMETRY + "p_fa: 3\n", "p_fa is not a parameter"),
        (
            "geometry.yaml",
            GEOMETRY.replace("-1.0, 1.0", "-60, 60"),
            "(in rad; -60 degrees are -1.047 rad)",
        ),
        ("geometry.yaml", GEOMETRY + "rows: range\n", "rows must be one of auto, ranges, beams"),
        ("geometry.yaml", GEOMETRY + "false_detections_per_ping: many\n", "must be a number"),
        ("geometry.yaml", GEOMETRY + "near_range: 0.5\n", "near_range and far_range must be given"),
        (
            "geometry.yaml",
            GEOMETRY.replace("1.0, 20.9", "1, 5" + "0" * 400),
            "range must be a number",
        ),
        ("geometry.yaml", GEOMETRY.replace("[-1.0, 1.0]", "null"), "azimuth must be a list"),
        ("geometry.yaml", "- 1\n", "expected names and values"),
        ("geometry.yaml", "a: &a [1]\nrange: *a\n", "aliases"),
        ("times.csv", "time_s\n" + "0\n" * 12, "line 3: time_s must be a number, and later"),
        ("times.csv", "time_s\n0\n2\n\n1\n3\n", "times.csv, line 5: time_s must be a number"),
        (
            "times.csv",
            "time_s\n" + "".join(f"{k}\n" for k in range(11)) + "nan\n",
            "line 13: time_s",
        ),
        ("times.csv", "time_ms\n" + "0\n" * 12, "no column 'time_s'; it has ['time_ms']"),
        ("times.csv", "time_s,file\n,0.npy\n", "times.csv, line 2: expected 1 numbers, got ['']"),
        ("times.csv", "time_s\n", "times.csv names no image"),
        ("times.csv", "time_s\n" + "".join(f"{k}e12\n" for k in range(12)), "in milliseconds?"),
        ("times.csv", "\ntime_s\n0\n\n1e12\n", "times.csv, line 5: time_s is"),
        ("times.csv", "time_s\n2026-01-01T12:00:00\n", "line 2: expected 1 numbers"),
        ("geometry.yaml", GEOMETRY.replace("1.0, 20.9", "1, 2, 3"), "image at 0 s: intensity must"),
        ("images.npz", "PK broken", "cannot be read as images"),
        ("images.npy", "version https://git-lfs", "expected b'\\x93NUMPY', got b'versio'"),
    ],
)
def test_a_malformed_folder_is_refused_with_a_sentence(folder, capsys, name, text, sentence):
    (folder / name).write_text(text)
    assert main(["detect", str(folder), "--out", str(folder / "out.csv")]) == 2
    assert sentence in capsys.readouterr().err


def test_pictures_that_the_times_do_not_name_are_said_and_a_column_is_needed(folder, capsys):
    images = np.load(folder / "images.npz")["arr_0"]
    (folder / "images.npz").unlink()
    for k, image in enumerate(images):
        np.save(folder / f"{k}.npy", image)
    (folder / "times.csv").write_text("time_s, file\n0, 0.npy\n1, 1.npy\n")  # as people write
    out = str(folder.parent / "out.csv")
    assert main(["detect", str(folder), "--out", out]) == 0
    assert f"{len(images) - 2} images of {folder} are not in times.csv" in capsys.readouterr().err
    (folder / "times.csv").write_text("time_s\n0\n1\n")
    assert main(["detect", str(folder), "--out", out]) == 2
    assert "times.csv has no column file" in capsys.readouterr().err


def test_a_folder_without_its_geometry_is_refused_with_what_it_must_state(folder, capsys):
    (folder / "geometry.yaml").unlink()
    assert main(["detect", str(folder), "--out", str(folder / "out.csv")]) == 2
    said = capsys.readouterr().err
    assert f"{folder} has no geometry.yaml: geometry.yaml states the ranges" in said
    assert main(["run", str(folder)]) == 2
    assert "a folder of images with geometry.yaml and times.csv" in capsys.readouterr().err


def test_an_image_that_is_sent_again_is_left_out_and_said(folder, capsys):
    with np.load(folder / "images.npz") as stored:
        images = stored["arr_0"]
    found, said = [], []
    for times in (1, 2):
        np.savez(folder / "images.npz", np.repeat(images, times, axis=0))
        stamps = "".join(f"{k / times}\n" for k in range(12 * times))
        (folder / "times.csv").write_text(f"time_s\n{stamps}")
        out = folder.parent / f"{folder.name}_{times}.csv"
        assert main(["detect", str(folder), "--out", str(out)]) == 0
        found.append([line.split(",")[2:7] for line in out.read_text().splitlines()])
        said.append(capsys.readouterr().err)
    assert found[0] == found[1]
    assert "copies" not in said[0]
    assert "12 copies of images or bearings: image left out:" in said[1]


def test_that_no_image_has_noise_is_said_once(folder, capsys):
    with np.load(folder / "images.npz") as stored:
        images = stored["arr_0"]
    np.savez(folder / "images.npz", np.repeat(images[:1], len(images), axis=0))
    assert main(["detect", str(folder), "--out", str(folder / "out.csv")]) == 0
    assert capsys.readouterr().err.count("every image is equal to the one before") == 1


def test_images_have_the_poses_of_own_ship_and_its_mounting(folder):
    rows = ["time_s,east_m,north_m,heading_rad", "0,0,0,0", "11,22,0,0"]
    (folder / "own_ship.csv").write_text("\n".join(rows))
    (folder / "geometry.yaml").write_text(GEOMETRY + "mounting.x: 3.0\n")
    _, times, images = read_image_folder(folder, [])
    poses = [image.sensor_pose.tolist() for image in images]
    expected = [[2.0 * time, 3.0, np.pi / 2] for time in times]
    np.testing.assert_allclose(poses, expected, atol=1e-9)
    said = []
    for text, sentence in (
        ("time_s,east_m,north_m\n0,0,0\n", "has no heading: the"),
        ("time_s,east_m,north_m,heading_rad\n90,0,0,0\n91,0,0,0\n", "poses from 90 to 91 s"),
    ):
        (folder / "own_ship.csv").write_text(text)
        _, _, images = read_image_folder(folder, said)
        assert sentence in said[-1] and len({*(tuple(one.sensor_pose) for one in images)}) == 1
    (folder / "own_ship.csv").write_text("time_s,east_m\n0,0\n")
    with pytest.raises(ValueError, match=r"own_ship.csv has no column 'north_m'"):
        read_image_folder(folder, [])


def test_the_mounting_of_a_folder_is_that_of_its_tracks_unless_another_is_given(folder, tmp_path):
    (folder / "own_ship.csv").write_text("time_s,east_m,north_m,heading_rad\n0,0,0,0\n11,2,0,0")
    (folder / "geometry.yaml").write_text(GEOMETRY + "mounting.x: 3.0\nmounting.y: -1.0\n")
    into = tmp_path / "into"
    into.mkdir()
    _, values = image_folder_detected(folder, into, [], {})
    mounting = {name: values[name] for name in values if name.startswith("mounting.")}
    assert mounting == {"mounting.x": 3.0, "mounting.y": -1.0}
    with pytest.raises(ValueError, match="from -1000 to 1000"):
        image_folder_detected(folder, into, [], {"mounting.x": 5000.0})


@pytest.mark.parametrize(("far", "asks"), [("20.9", False), ("2000", False), ("20900", True)])
def test_ranges_that_no_sound_reaches_between_images_are_asked_about(folder, far, asks):
    (folder / "geometry.yaml").write_text(GEOMETRY.replace("20.9", far))
    notes = []
    read_image_folder(folder, notes)
    assert [note for note in notes if "in mm?" in note] == notes[: int(asks)]


def test_the_mounting_of_a_folder_also_places_a_sonar_that_does_not_move(folder, tmp_path):
    (folder / "geometry.yaml").write_text(GEOMETRY + "mounting.yaw: 0.5\n")
    into = tmp_path / "into"
    into.mkdir()
    _, values = image_folder_detected(folder, into, [], {})
    assert values["mounting.yaw"] == 0.5


def test_the_detections_of_a_folder_are_those_of_its_detector_to_the_bit(folder, tmp_path):
    into = tmp_path / "into"
    into.mkdir()
    recording, _ = image_folder_detected(folder, into, [], {})
    detector, _, images = read_image_folder(folder, [])
    scans = [scan for scan in map(detector.process, images) if len(scan)]
    for recorded, scan in zip(recording.scans, scans, strict=True):
        for name, values in recorded.fields.items():
            live = scan.features[name] if name in scan.features else getattr(scan, name)
            np.testing.assert_array_equal(values, live)


@pytest.mark.parametrize("numbers", ["", ",scan"])
def test_images_without_a_detection_are_empty_scans(folder, tmp_path, capsys, numbers):
    (folder / "geometry.yaml").write_text(GEOMETRY.replace("ping: 5", "ping: 0.5"))
    rows = [f"{k}.5,0,0,0{numbers and f',{k}'}\n" for k in range(12)]
    header = f"time_s,east_m,north_m,heading_rad{numbers}\n"
    (folder / "own_ship.csv").write_text(header + "".join(rows))
    into = tmp_path / "into"
    into.mkdir()
    recording, _ = image_folder_detected(folder, into, [], {})
    assert [scan.time for scan in recording.scans] == [*range(12)]
    numbers = [len(scan.fields["range"]) for scan in recording.scans]
    assert min(numbers) == 0 < max(numbers)
    assert main(["detect", str(folder), "--out", str(tmp_path / "o.csv")]) == 0
    said = f"{numbers.count(0)} of 12 images have no detection and are not in the file"
    assert said in capsys.readouterr().err


def test_the_parameters_of_the_detector_hold_for_a_folder_and_its_layout_stays(folder, tmp_path):
    into = tmp_path / "into"
    into.mkdir()
    given = {"sensor.max_range": 9.0, "false_detections_per_ping": 50.0, "image.rows": "ranges"}
    given["image.far_range"] = 9.0
    recording, values = image_folder_detected(folder, into, [], given)
    ranges = [scan.fields["range"] for scan in recording.scans]
    assert max(map(np.max, ranges)) <= 9.0 == values["sensor.max_range"]
    assert np.mean([*map(len, ranges)]) > 20.0
    unused = (
        "no use is made of image.rows, image.far_range: geometry.yaml states how the images lie"
    )
    assert unused in recording.notes


def huge_array(shape: str) -> bytes:
    """A file .npy whose header promises a shape."""
    head = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head.encode() + b"x" * 100


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("0.npy", huge_array("(1000000, 10000000)")),
        ("0.npy", huge_array("()")),
        ("0.pgm", b"P5\n99999999 99999999\n255\n"),
        ("0.pgm", b"P5\n30 30\n255\n"),
        ("0.png", b"\x89PNG\r\n\x1a\nbroken"),
        ("0.ppm", b"P6\n2 1\n255\n\x01\x01\x01\x01\x02\x01"),
    ],
    ids=["huge array", "no array", "huge picture", "cut picture", "broken picture", "colours"],
)
def test_an_image_that_cannot_be_read_is_refused_whatever_its_header_says(
    tmp_path, capsys, name, content
):
    pytest.importorskip("matplotlib")
    (tmp_path / "geometry.yaml").write_text(GEOMETRY)
    (tmp_path / "times.csv").write_text(f"time_s,file\n0,{name}\n")
    (tmp_path / name).write_bytes(content)
    assert main(["detect", str(tmp_path), "--out", str(tmp_path / "o.csv")]) == 2
    said = capsys.readouterr().err
    assert said.startswith("refused: ") and ("colours" in said or name != "0.ppm")


def test_pictures_of_16_bits_and_of_three_equal_channels_are_as_their_arrays(tmp_path):
    pytest.importorskip("matplotlib")
    rng = np.random.default_rng(2)
    images = rng.rayleigh(4000.0, (3, 30, 90)).astype(np.uint16)
    found = []
    for form in ("npy", "pgm", "ppm"):
        folder = tmp_path / form
        folder.mkdir()
        (folder / "geometry.yaml").write_text(GEOMETRY)
        names = [f"{k}.{form}" for k in range(3)]
        rows = [f"{k},{name}" for k, name in enumerate(names)]
        (folder / "times.csv").write_text("\n".join(["time_s,file", *rows]))
        for name, image in zip(names, images if form != "ppm" else images >> 8, strict=True):
            if form == "npy":
                np.save(folder / name, image)
            elif form == "pgm":
                (folder / name).write_bytes(b"P5\n90 30\n65535\n" + image.astype(">u2").tobytes())
            else:
                three = np.repeat(image.astype(np.uint8), 3)
                (folder / name).write_bytes(b"P6\n90 30\n255\n" + three.tobytes())
        _, _, read = read_image_folder(folder, [])
        found.append([image.intensity for image in read])
    np.testing.assert_array_equal(found[0], images)
    np.testing.assert_array_equal(found[1], images)
    np.testing.assert_array_equal(found[2], images >> 8)


@pytest.mark.parametrize("rows", ["beams", "ranges", "fan"])
def test_a_folder_is_read_as_the_node_reads_the_same_picture(tmp_path, rows):
    image = np.random.default_rng(2).rayleigh(4000.0, (40, 60)).astype(np.uint16)
    np.save(tmp_path / "images.npy", image[None])
    (tmp_path / "times.csv").write_text("time_s\n0\n")
    ends = "range: [12.0, 0.5]" if rows != "fan" else "range: [0.5, 12.0]"
    (tmp_path / "geometry.yaml").write_text(f"{ends}\nazimuth: [0.6, -0.6]\nrows: {rows}\n")
    notes: list[str] = []
    _, _, images = read_image_folder(tmp_path, notes)
    [read] = images
    layout = ImageLayout(rows=rows)  # far first, port first
    range_, azimuth, intensity = located_image(image, layout, (0.5, 12.0), (-0.6, 0.6))
    np.testing.assert_array_equal(read.intensity, intensity)
    np.testing.assert_allclose(read.range, range_)
    half = 0.6 / len(azimuth) if rows != "fan" else 0.0  # of a fan the edges are given
    np.testing.assert_allclose(read.azimuth, azimuth * 0.6 / (0.6 - half))
    assert ("top left" in notes[0]) == (rows != "fan")


def test_images_of_two_values_are_of_0_and_1(tmp_path):
    image = pytest.importorskip("PIL.Image")
    values = np.random.default_rng(2).random((40, 60)) > 0.9
    (tmp_path / "geometry.yaml").write_text(GEOMETRY)
    (tmp_path / "times.csv").write_text("time_s,file\n0,0.npy\n1,1.png\n")
    np.save(tmp_path / "0.npy", values)
    image.fromarray(values).save(tmp_path / "1.png")
    detector, _, images = read_image_folder(tmp_path, [])
    for one in images:
        np.testing.assert_array_equal(one.intensity, values)
        detector.process(one)
