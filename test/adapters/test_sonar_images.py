"""From messages of sonar images to detections, and what the first images show."""

from __future__ import annotations

import math

import numpy as np
import pytest
from support import foreign_messages as foreign
from support.image_messages import CELLS, TABLE, projected, raw

from msg_adapters.sonar_images import FirstLook, ImageInput
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
