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
"""Recordings and bags of images through a session: poses, echo times, and the nodes' tracks."""

from __future__ import annotations

import base64
import gzip
import json
import re
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from msg_adapters.ping import ReadingOptions
from tsepm_ros import Scan, SensorModel, SonarImage, make_detector, make_initiator
from tsepm_ros.own_ship.pose_history import PoseSample, known_pose_rates
from tsepm_ros.own_ship.registration import UnregisteredScan
from tsepm_ros.session.session import Session
from tsepm_ros.session.shared_picture import share_picture
from tsepm_ros.settings.node_options import SessionOptions
from tsepm_ros.settings.settings import Settings
from tsepm_ros.tools.commands.cli import main
from tsepm_ros.tools.replay.offline import (
    offline_recording_results,
    process_recording,
)
from tsepm_ros.tools.replay.recording import UNKNOWN_YAW_VARIANCE, RecordedScan, Recording

MOVING = Settings(session=SessionOptions(own_ship_source="odometry"))


def scans(number: int, angle: str = "azimuth") -> list[RecordedScan]:
    """One target that stands still ahead of a sensor that does."""
    return [
        RecordedScan(12.0 * k, {"range": np.array([2000.0]), angle: np.array([0.0])})
        for k in range(number)
    ]


def own_ship(seconds: float, period: float = 1.0, yaw: float | None = 0.0):
    covariance = np.diag([0.0, 0.0, UNKNOWN_YAW_VARIANCE]) if yaw is None else None
    return [
        PoseSample(period * k, 100.0, 200.0, yaw or 0.0, covariance)
        for k in range(int(seconds / period) + 1)
    ]


@pytest.mark.parametrize("angle", ["azimuth", "bearing"])
def test_scans_that_need_a_heading_are_dropped_where_none_was_recorded(angle):
    recording = Recording(scans(8, angle), own_ship(100.0, yaw=None))
    results, dropped = process_recording(recording, MOVING, "bow")
    assert results == []
    assert dropped == {"heading_unknown": 8}


@pytest.mark.parametrize(("north", "dropped"), [(0.0, {}), (500.0, {"own_ship_outlier": 1})])
def test_a_scan_that_a_pose_in_doubt_would_place_has_the_next_one_as_live(north, dropped):
    """Of a vessel at rest, a pose that comes late may have a bad stamp; another is elsewhere."""
    ship = own_ship(100.0)
    ship[40] = replace(ship[40], y=ship[40].y + north)
    recording = Recording([replace(scan, time=scan.time + 3.9) for scan in scans(8)], ship)
    del ship[39]
    results, lost = process_recording(recording, MOVING, "bow")
    assert (len(results), lost) == (8, dropped)
    np.testing.assert_allclose(
        [result.scan.sensor_pose for result in results], [[100.0, 200.0, 0.0]] * 8
    )


def test_recorded_echoes_without_times_are_of_range_over_sound_speed():
    recording = Recording(scans(8), own_ship(100.0))
    (at_stamp, *_), _ = process_recording(recording, MOVING, "bow")
    (result, *_), dropped = process_recording(recording, MOVING, "bow", 1500.0)
    assert at_stamp.scan.time_offset is None
    np.testing.assert_allclose(result.scan.time_offset, [2000.0 / 1500.0])
    assert result.scan.sensor_pose.shape == (1, 3)
    assert not dropped


MODELS = {
    "near": SensorModel(max_range=500.0, range_std=2.0, range_std_fraction=0.0),
    "far": SensorModel(max_range=3000.0, range_std=9.0, range_std_fraction=0.0),
}


def recordings_of_two(near: float) -> dict[str, Recording]:
    """Two sensors at the origin that see a boat, and false detections, at intervals of their own;
    the near one is silent for a while, and the stamps of some scans are equal."""
    rng, recorded = np.random.default_rng(5), {}
    for name, interval in (("near", near), ("far", 2.5)):
        stamps = np.arange(0.0, 90.0, interval)
        if name == "near":
            stamps = stamps[(stamps < 20.0) | (stamps > 60.0)]
        recorded[name] = Recording(
            [
                RecordedScan(
                    stamp,
                    {
                        "range": np.append(rng.uniform(50.0, 450.0, 2), 200.0 + stamp),
                        "azimuth": np.append(rng.uniform(-3.0, 3.0, 2), 0.2),
                    },
                )
                for stamp in stamps.tolist()
            ]
        )
    return recorded


def sessions_of_two(**changes: str) -> dict[str, Session]:
    return {
        name: Session(
            Settings(sensor=model, session=SessionOptions(method=changes.get(name, "score")))
        )
        for name, model in MODELS.items()
    }


@pytest.mark.parametrize("interval", [1.0, 3.0])
def test_recordings_of_two_sensors_make_the_picture_of_the_tracker(interval):
    recorded, sessions = recordings_of_two(interval), sessions_of_two()
    share_picture(sessions)
    parts = [(recorded[name], sessions[name], ReadingOptions()) for name in MODELS]
    results = list(offline_recording_results(parts))
    tracker = make_initiator("score", sensor=MODELS)
    each = [(scan, name) for name, one in recorded.items() for scan in one.scans]
    for result, (scan, name) in zip(
        results, sorted(each, key=lambda pair: pair[0].time), strict=True
    ):
        tracker.process(Scan(scan.time, **scan.fields, sensor=name))
        assert (result.scan.sensor, result.stamp) == (name, scan.time)
        np.testing.assert_array_equal(result.current.state, tracker.current.state)
    assert len(tracker.current)
    assert not sum((session.dropped for session in sessions.values()), Counter())


def test_a_scan_before_another_sensors_last_is_dropped_and_counted():
    sessions = sessions_of_two()
    share_picture(sessions)
    for name, stamp in (("far", 10.0), ("near", 9.0)):
        scan = Scan(stamp, np.array([200.0]), np.array([0.1]))
        sessions[name].add_scan(UnregisteredScan(scan, "sensor", False, int(1e9 * stamp)), -np.inf)
        assert len(list(sessions[name].process(last=True))) == (name == "far")
    assert sessions["near"].dropped == {"scan_late": 1}


def test_sensors_of_one_picture_have_its_options_and_a_method_for_several():
    with pytest.raises(ValueError, match="method is of the whole picture, and near and far"):
        share_picture(sessions_of_two(far="tsepm"))
    with pytest.raises(ValueError, match="'tsepm' takes one sensor"):
        share_picture(sessions_of_two(near="tsepm", far="tsepm"))


def rated(stamp: float) -> RecordedScan:
    values = {"range": [2000.0], "azimuth": [0.0], "range_rate": [1.0], "time_offset": [1.3]}
    return RecordedScan(stamp, {name: np.array(value) for name, value in values.items()})


def test_a_recorded_velocity_of_the_own_ship_is_the_sensor_s():
    noise = np.random.default_rng(1).normal(0.0, 1.0, 30)
    ship = [
        PoseSample(float(k), x, 0.0, 0.0, rates=known_pose_rates(3.0 + k, -1.0, 0.0))
        for k, x in enumerate(noise.tolist())
    ]
    (result,), _ = process_recording(Recording([rated(10.5)], ship), MOVING, "bow")
    np.testing.assert_allclose(result.scan.sensor_velocity, [[3.0 + 11.8, -1.0]])


@pytest.mark.parametrize("period", [0.001, 0.005, 0.1])
def test_a_scan_is_placed_as_by_a_session_that_has_all_of_the_odometry(period):
    noise = np.random.default_rng(2).normal(0.0, 1.0, round(20.0 / period)).tolist()
    ship = [PoseSample(period * k, x, -x, 0.0) for k, x in enumerate(noise)]
    (found,), _ = process_recording(Recording([rated(4.0004)], ship), MOVING, "bow")
    one = Session(MOVING)
    for k, x in enumerate(noise):
        one.add_own_ship(PoseSample(period * k, x, -x, 0.0, frame_id="odom"))
    one.add_scan(UnregisteredScan(found.scan, "sonar"), 0.0)
    (expected,) = one.process()
    for name in ("sensor_pose", "sensor_velocity"):
        np.testing.assert_array_equal(getattr(found.scan, name), getattr(expected.scan, name))


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
    bag_files = pytest.importorskip("support.bag_files")
    entries = []
    for k, picture in enumerate(images):
        shown = np.ascontiguousarray(picture[::-1].T[::-1])  # as displayed
        message = bag_files.STORE.types[IMAGE](
            header=bag_files.header(1000.0 + 0.2 * k, "sonar"),
            height=CELLS,
            width=BEAMS,
            encoding="mono8",
            is_bigendian=0,
            step=BEAMS,
            data=shown.ravel(),
        )
        entries.append(bag_files.Entry(1000.0 + 0.2 * k, "/sonar/image", IMAGE, message))
    return bag_files.write_bag(folder / "bag", entries)


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
    from tsepm_ros.tools.replay.bag import find_bag_topics

    topics = {"/detections": "sensor_msgs/msg/PointCloud2", "/camera/image_raw": IMAGE}
    assert find_bag_topics(topics, {}) == {"detections": "/detections"}
    assert find_bag_topics({"/sonar/image": IMAGE}, {}) == {"detections": "/sonar/image"}
    both = {"/boat/port/image": IMAGE, "/boat/starboard/image": IMAGE}
    assert find_bag_topics(both, {}, "starboard") == {"detections": "/boat/starboard/image"}
    assert find_bag_topics(topics, {"detections": "/camera/image_raw"})["detections"] == (
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
