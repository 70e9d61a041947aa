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
"""From messages of sonar images to detections, and what the first images show."""

from __future__ import annotations

import math

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from scipy import ndimage
from sensor_msgs.msg import Image
from std_msgs.msg import Header
from support import foreign_messages as foreign
from support.image_messages import CELLS, TABLE, projected, raw

from msg_adapters import odometry_message
from msg_adapters.sonar_images import FirstLook, ImageInput, content_in_question
from tsepm_ros.own_ship.pose_history import PoseSample
from tsepm_ros.session.turn import ImagePing
from tsepm_ros.settings.settings import SONAR_DETECTOR, make_groups


def test_a_reader_of_images_counts_what_it_cannot_read_and_says_its_assumptions():
    options = make_groups(SONAR_DETECTOR, {})
    drops, said = [], []
    images = ImageInput(options, lambda *why: drops.append(why), said.append)
    for message in (
        raw(sample_rate=0.0),
        raw(ping_info=foreign.PingInfo()),
        raw(TABLE + 1, ping_info=foreign.PingInfo()),
    ):
        list(images.take(message))
    [(reason, sentence)] = drops
    assert reason == "bad_geometry" and "sample_rate" in sentence
    assert len(said) == 2 and len({*said}) == 1, "the node logs it once"
    detector = images.detector
    images.configure(options)
    assert images.detector is detector, "nothing has changed"
    images.configure(make_groups(SONAR_DETECTOR, {"false_detections_per_ping": 8.0}))
    assert images.detector is not detector


@pytest.mark.parametrize("turn, asked", [(360.0, True), (400.0, True), (2.0 * math.pi, False)])
def test_bearings_in_degrees_or_gradians_are_asked_about_once_with_their_figure(turn, asked):
    said: list[str] = []
    images = ImageInput(make_groups(SONAR_DETECTOR, {}), lambda *_: None, said.append)
    for k in range(8):
        angles = turn * (np.array([0.2, 0.25, 0.3, 0.35]) + 0.01 * k)
        list(images.take(raw(rx_angles=angles.tolist())))
    said = [sentence for sentence in said if "gradians" in sentence]
    assert len(said) == asked
    assert not asked or f"up to {0.35 * turn:.4g}: are they in degrees" in said[0]


def test_a_coverage_counts_where_it_stays():
    """One sentence and a count where the ranges alternate from image to image."""
    said = []
    images = ImageInput(make_groups(SONAR_DETECTOR, {}), lambda *_: None, said.append)
    held = []
    for number, far in enumerate([4.0, 4.0, *[8.0, 4.0] * 10, 8.0, 8.0, 8.0]):
        message = projected(TABLE.T + number, cells=far / 4.0 * CELLS)
        assert len(list(images.take(message))) == 1
        held.append(images.coverage.values["max_range"])
    assert held == [4.25] * 23 + [8.5] * 2
    assert images.coverage_changes == 21
    assert len({*said}) == 1 and "differ from those of the image before" in said[0]


def posed(monkeypatch, odometry, stamp=1_700_000_000.123, **parameters):
    """Poses of an image at a stamp, after odometry (after it, s, x, y and yaw); drops and notes."""
    drops, said = [], []
    options = make_groups(SONAR_DETECTOR, {"own_ship_source": "odometry", **parameters})
    images = ImageInput(options, lambda *why: drops.append(why[0]), said.append)
    for after, x, y, yaw in odometry:
        sample = PoseSample(stamp + after, x, y, yaw)
        images.take_own_ship(odometry_message(sample))
    taken = []
    process = images.detector.process
    monkeypatch.setattr(
        images.detector,
        "process",
        lambda image: (taken.append(image.sensor_pose), process(image))[1],
    )
    list(images.take(projected()))
    return taken[0], drops, said


def test_an_image_has_the_pose_of_the_sensor_between_and_beyond_those_of_the_vessel(monkeypatch):
    turning = [(-1.0, 0.0, 0.0, 0.0), (1.0, 4.0, 2.0, 1.0)]
    pose, drops, said = posed(monkeypatch, turning)
    np.testing.assert_allclose(pose, [2.0, 1.0, 0.5], atol=1e-3)
    assert drops == said == []
    mounted = {"mounting.x": 2.0, "mounting.yaw": 0.25}
    pose, *_ = posed(monkeypatch, turning, **mounted)
    expected = [2.0 + 2.0 * math.cos(0.5), 1.0 + 2.0 * math.sin(0.5), 0.75]
    np.testing.assert_allclose(pose, expected, atol=1e-3)
    pose, *_ = posed(monkeypatch, turning, **mounted, **{"mounting.roll": 3.1416})
    np.testing.assert_allclose(pose, np.multiply(expected, (1.0, -1.0, -1.0)), atol=1e-3)
    pose, *_ = posed(monkeypatch, [(-1.5, 0.0, 0.0, 0.0), (-0.5, 1.0, 0.0, 0.0)])
    np.testing.assert_allclose(pose, [1.5, 0.0, 0.0], atol=1e-3)
    assert posed(monkeypatch, [])[0].tolist() == [0.0, 0.0, 0.0]


def test_poses_of_another_clock_are_said_and_an_invalid_one_counts(monkeypatch):
    pose, drops, [said] = posed(monkeypatch, [(-900.0, 5.0, 0.0, 0.0), (-899.0, 6.0, 0.0, 0.0)])
    assert "more than 5 s apart" in said and np.isfinite(pose).all()
    _, drops, _ = posed(monkeypatch, [(0.0, math.nan, 0.0, 0.0)])
    assert drops == ["own_ship_invalid"]


def test_poses_of_a_clock_that_starts_again_are_taken(monkeypatch):
    again = [(100.0, 9.0, 9.0, 0.0), *((0.5 * k - 6.0, 1.0, 2.0, 0.0) for k in range(14))]
    pose, *_ = posed(monkeypatch, again)
    np.testing.assert_allclose(pose, [1.0, 2.0, 0.0], atol=1e-3)


@pytest.mark.parametrize("ahead", [1.0, 30.0])
def test_a_pose_stamped_ahead_is_left_out_and_places_no_image(monkeypatch, ahead):
    sailed = [(0.1 * k, 0.2 * k, 0.0, 0.0) for k in range(-20, 4)]
    _, x, *rest = sailed[15]
    stamped_ahead = [*sailed[:15], (ahead, x, *rest), *sailed[16:]]
    pose, drops, said = posed(monkeypatch, stamped_ahead)
    np.testing.assert_allclose(pose, [0.0, 0.0, 0.0], atol=1e-3)
    assert drops == ["own_ship_outlier"] and said == []


def look_at(images, rows="ranges", azimuth=1.0):
    """Sentences about the first images, (b, m) each."""
    look, said = FirstLook(), []
    for image in images:
        b, m = image.shape
        axes = np.linspace(1.0, 20.0, m), np.linspace(-azimuth, azimuth, b)
        said += look.add(ImagePing(0, "sonar", *axes, image), rows)
    return said


def speckle(*shape, number=12):
    return np.random.default_rng(4).rayleigh(20.0, (number, *shape)).clip(0, 255).astype(np.uint8)


def test_what_looks_transposed_is_asked_about_with_the_other_rows():
    [said] = look_at(speckle(200, 60))
    assert "200 bearings of 60 ranges look transposed" in said and "give beams for rows" in said
    assert look_at(speckle(200, 60), azimuth=3.1) == [], "a turn has many bearings"
    fading = (speckle(60, 60, number=12) * np.linspace(3.0, 0.3, 60)[:, None]).astype(np.uint8)
    [said] = look_at(fading, rows="beams")
    assert "give ranges for rows" in said
    assert look_at(fading.transpose(0, 2, 1)) == look_at(speckle(200, 60), rows="") == []


@pytest.mark.parametrize("half", [0.3, 0.8, 1.4])
def test_a_fan_that_is_read_as_bearings_and_ranges_is_asked_about(half):
    height, width = 100, round(200 * math.sin(half))
    y, x = np.indices((height, width)) + 0.5
    ahead, port = height - y, 0.5 * width - x
    outside = (np.hypot(ahead, port) > height) | (np.abs(np.arctan2(port, ahead)) > half)
    images = np.where(outside, 0, speckle(height, width, number=10) + 1)
    for read_as in (images.transpose(0, 2, 1)[:, :, ::-1], images.transpose(0, 2, 1), images):
        [said] = look_at(read_as)
        assert "give fan for rows" in said
    assert look_at(images, rows="fan") == []


def rayleigh(*shape):
    return np.random.default_rng(6).rayleigh(1.0, shape)


def depth_image(rows=120, columns=160, noise=0.003):
    """A wall that slants, a box before it and the floor, as a depth camera sends them, in m."""
    rng, y, x = np.random.default_rng(5), *np.mgrid[:rows, :columns]
    depth = np.minimum(3.0 + 0.01 * x, 8.0 * rows / (y + 20.0))
    depth[40:80, 50:90] = 1.5
    depth *= 1.0 + noise * rng.standard_normal(depth.shape)
    depth[:4, :60] = np.nan
    return depth.astype(np.float32)


@pytest.mark.parametrize("kind", [np.float32, np.uint16])
@pytest.mark.parametrize("noise", [0.0005, 0.003, 0.006])
def test_distances_in_place_of_intensities_are_asked_about(kind, noise):
    depth = depth_image(noise=noise)
    values = depth if kind is np.float32 else np.nan_to_num(1e3 * depth).astype(kind)
    assert "depth camera" in content_in_question(values, False)
    assert content_in_question(values, True) == "", "a message of a sonar's driver"


def smooth(values, times):
    """Values as a display draws them: enlarged, and smoothed."""
    return ndimage.zoom(values, times, order=1).astype(np.float32)


ECHOES = {
    "speckle": rayleigh(80, 100),
    "bytes": (20.0 * rayleigh(80, 100)).clip(0, 255).astype(np.uint8),
    "decibels": (20.0 * np.log10(rayleigh(80, 100) + 1e-3) + 60.0).astype(np.float32),
    "falls_off": (rayleigh(80, 100) / np.linspace(0.1, 40.0, 100) ** 2).astype(np.float32),
    "beam_three_cells_wide": smooth(rayleigh(80, 100), (3, 1)),
    "enlarged_four_times": smooth(rayleigh(40, 60), 4),
    "above_an_offset": (2048.0 + 10.0 * rayleigh(80, 100)).astype(np.float32),
    "without_noise": np.pad(np.full((3, 4), 9.0), ((40, 40), (50, 50)), constant_values=0.5),
    "above_a_threshold": np.where(rayleigh(80, 100) > 3.0, rayleigh(80, 100), 0.0),
}


@pytest.mark.parametrize("name", ECHOES)
def test_images_of_echoes_are_asked_about_nothing(name):
    assert content_in_question(ECHOES[name], False) == ""


@pytest.mark.parametrize(
    ("value", "said"), [(0, "the value 0"), (77.0, "the value 77"), (np.nan, "no number")]
)
def test_images_that_hold_nothing_are_said_while_they_do_and_are_said_once_for_long(value, said):
    sentences = []
    given = {"image.near_range": 0.5, "image.far_range": 40.0}
    sector = {"sensor.azimuth_min": -1.0, "sensor.azimuth_max": 1.0}
    options = make_groups(SONAR_DETECTOR, given | sector)
    reader = ImageInput(options, print, sentences.append)
    rng = np.random.default_rng(3)
    for number in range(30):
        values = rng.rayleigh(1.0, (60, 40)).astype(np.float32)
        is_empty = 5 <= number < 20 or number == 25
        if is_empty:
            values[:] = value
        list(reader.take(picture(values, number)))
        assert (said in reader.content) == is_empty
    assert len([one for one in sentences if said in one]) == 1


def picture(values, number):
    """A sensor_msgs/Image of numbers."""
    rows, columns = values.shape
    return Image(
        header=Header(stamp=Time(sec=1000 + number), frame_id="sonar"),
        height=rows,
        width=columns,
        step=4 * columns,
        encoding="32FC1",
        data=values.tobytes(),
    )
