"""Bags of sonar images: as the nodes process them live."""

from __future__ import annotations

import base64
import gzip
import json
import re

import numpy as np
import pytest
from support.bag_files import STORE, Entry, header, write_bag

from tsepm_ros import Scan, SensorModel, SonarImage, make_detector, make_initiator
from tsepm_ros.tools.commands.cli import main

BEAMS, CELLS = 48, 150
IMAGE = "sensor_msgs/msg/Image"
COVERAGE = {"min_range": 0.5, "max_range": 30.5, "azimuth_min": -0.8, "azimuth_max": 0.8}


def pictures(number: int) -> list[np.ndarray]:
    """A target at 1 m/s in speckle, (beams, cells), near first and from starboard."""
    rng, found = np.random.default_rng(5), []
    y, x = np.ogrid[:BEAMS, :CELLS]
    for k in range(number):
        field = rng.rayleigh(1.0, (BEAMS, CELLS))
        column = (10.0 + 0.2 * k - 0.5) / 30.0 * CELLS - 0.5
        field += 14.0 * np.exp(-0.5 * ((y - 30.0) ** 2 + ((x - column) / 2.0) ** 2))
        found.append(np.minimum(field * 15.0, 255.0).astype(np.uint8))
    return found


def bag(folder, images):
    entries = []
    for k, picture in enumerate(images):
        shown = np.ascontiguousarray(picture[::-1].T[::-1])  # as displayed
        message = STORE.types[IMAGE](
            header=header(1000.0 + 0.2 * k, "sonar"),
            height=CELLS,
            width=BEAMS,
            encoding="mono8",
            is_bigendian=0,
            step=BEAMS,
            data=shown.ravel(),
        )
        entries.append(Entry(1000.0 + 0.2 * k, "/sonar/image", IMAGE, message))
    return write_bag(folder / "bag", entries)


def parameters(folder):
    """The detector's coverage; the tracker's follows the images."""
    values = {f"sensor.{name}": value for name, value in COVERAGE.items()}
    values |= {"false_detections_per_ping": 10.0, "sound_speed": 1500.0}
    rows = "".join(f"    {name}: {value}\n" for name, value in values.items())
    file = folder / "detector.yaml"
    tracker = "/**/track_initiator:\n  ros__parameters:\n    max_speed: 3.0\n"
    file.write_text(f"/**/sonar_detector:\n  ros__parameters:\n{rows}{tracker}")
    return ["--params-file", str(file)]


def test_a_bag_of_images_has_the_tracks_of_the_detector_and_the_initiator(tmp_path, capsys):
    images = pictures(50)
    given = [*parameters(tmp_path), "--out", str(tmp_path / "o")]
    assert main(["run", str(bag(tmp_path, images)), *given]) == 0
    assert "coverage" not in capsys.readouterr().err
    rows = (tmp_path / "o" / "tracks.csv").read_text().splitlines()[1:]
    detector = make_detector(false_detections_per_ping=10.0)
    initiator = make_initiator("score", sensor=SensorModel(**COVERAGE), max_speed=3.0)
    azimuth = -0.8 + (np.arange(BEAMS) + 0.5) * 1.6 / BEAMS
    range_ = 0.5 + (np.arange(CELLS) + 0.5) * 30.0 / CELLS
    expected = []
    for k, picture in enumerate(images):
        image = SonarImage(1000.0 + 0.2 * k, range_, azimuth[::-1], picture[::-1])
        found = detector.process(image)
        names = ("range", "azimuth", "range_std", "azimuth_std")
        fields = {name: getattr(found, name) for name in names}
        scan = Scan(
            found.stamp, **fields, features=found.features, time_offset=found.range / 1500.0
        )
        expected += list(initiator.process(scan))
    assert len(expected) >= 1
    assert len(rows) == len(expected)
    for row, track in zip(rows, expected, strict=True):
        state = [float(value) for value in row.split(",")[2:6]]
        assert state == pytest.approx(track.state.tolist(), abs=1e-6)


def test_a_bag_with_detections_and_a_camera_uses_the_detections(tmp_path):
    from tsepm_ros.tools.replay.bag import find_topics

    topics = {"/detections": "sensor_msgs/msg/PointCloud2", "/camera/image_raw": IMAGE}
    assert find_topics(topics, {}) == {"detections": "/detections"}
    assert find_topics({"/sonar/image": IMAGE}, {}) == {"detections": "/sonar/image"}
    assert find_topics(topics, {"detections": "/camera/image_raw"})["detections"] == (
        "/camera/image_raw"
    )


def test_one_file_has_the_parameters_of_both_and_a_page_has_the_images(tmp_path):
    shared = "".join(f"    sensor.{name}: {value}\n" for name, value in COVERAGE.items())
    file, page = tmp_path / "sonar.yaml", tmp_path / "run.html"
    file.write_text(
        f"/**/sonar_detector:\n  ros__parameters:\n    image.near_first: false\n{shared}"
        f"/**/track_initiator:\n  ros__parameters:\n    max_speed: 3.0\n{shared}"
    )
    path = bag(tmp_path, pictures(12))
    assert main(["run", str(path), "--params-file", str(file), "--html", str(page)]) == 0
    [data] = re.findall(r'id="recording">([^<]+)<', page.read_text())
    images = json.loads(gzip.decompress(base64.b64decode(data)))["images"]
    assert len(images) == 4, "of 2.2 s, one in 0.5 s or more"
    levels = np.frombuffer(base64.b64decode(images[-1]["levels"]), np.int8).reshape(128, 128)
    row, column = np.unravel_index(levels.argmax(), levels.shape)
    assert row > 64 and column > 64, "ahead, to port"
