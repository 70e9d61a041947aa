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
"""Sonar images in messages, on stand-ins with the fields of their files."""

from __future__ import annotations

import math
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Vector3
from sensor_msgs.msg import Image
from support import foreign_messages as foreign
from support.image_messages import BEAMS, CELLS, HEADER, TABLE, projected, raw

from msg_adapters import MessageError
from msg_adapters.image_messages import (
    DTYPES,
    grey_image,
    image_side_in_words,
    normalised_image,
    plan_message,
    plan_of,
    read_image,
)
from tsepm_ros.detector.detector import Stages
from tsepm_ros.session.turn import ImagePing
from tsepm_ros.settings.node_options import ImageLayout
from tsepm_ros.tracker.sensor import Coverage, SensorModel

SECTOR = SensorModel(min_range=2.0, max_range=12.0, azimuth_min=-0.6, azimuth_max=0.6)


def read(message, sensor=SECTOR, sound_speed=0.0, **layout):
    return read_image(message, ImageLayout(**layout), sensor, sound_speed)


@pytest.mark.parametrize("kind", DTYPES)
@pytest.mark.parametrize("big", [False, True])
def test_a_projected_image_has_all_beams_of_each_range_in_any_type(kind, big):
    found = read(projected(kind=kind, big=big))
    np.testing.assert_array_equal(found.intensity, TABLE)
    np.testing.assert_allclose(found.azimuth, BEAMS, atol=1e-12)
    np.testing.assert_array_equal(found.range, CELLS)
    assert (found.stamp_ns, found.frame_id) == (1_700_000_000_123_456_789, "sonar")
    assert (found.sound_speed, found.is_part, found.assumptions) == (1480.0, False, ())


def test_a_driver_s_own_order_and_a_cell_at_range_0_are_seen_to():
    np.testing.assert_array_equal(read(projected(TABLE), rows="beams").intensity, TABLE)
    found = read(raw(sample0=0))
    assert found.range[0] > 0.0
    np.testing.assert_array_equal(found.intensity, TABLE[:, 1:])


def test_a_raw_image_has_all_samples_of_each_beam_ranges_by_its_rate_and_delays():
    found = read(raw(tx_delays=[0.0, 0.1, 0.2, 0.3]))
    np.testing.assert_array_equal(found.intensity, TABLE)
    np.testing.assert_allclose(found.azimuth, BEAMS, atol=1e-7)  # angles are to starboard
    np.testing.assert_allclose(found.range, [5.0, 6.0, 7.0])
    np.testing.assert_allclose(found.time_offset, [0.0, 0.1, 0.2, 0.3], atol=1e-7)
    np.testing.assert_array_equal(read(raw(TABLE.T), rows="ranges").intensity, TABLE)


def test_a_sound_speed_that_is_assumed_and_beams_that_look_up_are_said():
    found = read(raw(ping_info=foreign.PingInfo()), sound_speed=1450.0)
    assert found.range[0] == pytest.approx(5.0 * 1450.0 / 1500.0)
    assert "1450 m/s is assumed" in found.assumptions[0]
    assert "not level" in read(projected(up=0.5)).assumptions[0]


def test_an_echo_is_one_bearing_and_spokes_are_a_part_of_a_turn_each_at_its_own_time():
    message = foreign.RadarSector(
        header=HEADER,
        angle_start=1.0,
        angle_increment=-0.01,
        time_increment=Duration(nanosec=2_000_000),
        range_min=0.0,
        range_max=100.0,
        intensities=[foreign.RadarEcho(echoes=row.tolist()) for row in TABLE],
    )
    found = read(message)
    np.testing.assert_allclose(found.azimuth, [1.0, 0.99, 0.98, 0.97])
    np.testing.assert_allclose(found.range, [50.0, 100.0])
    np.testing.assert_array_equal(found.intensity, TABLE[:, 1:])
    np.testing.assert_allclose(found.time_offset, [0.0, 0.002, 0.004, 0.006])
    assert found.is_part
    np.testing.assert_allclose(read(message, clockwise=True).azimuth, -found.azimuth)
    message = foreign.SonarEcho(
        header=HEADER, angle=0.7, range=10, speed_of_sound=1500, intensities=bytes([1, 2, 3, 4, 5])
    )
    found = read(message)
    np.testing.assert_allclose(found.range, [1.0, 3.0, 5.0, 7.0, 9.0])
    np.testing.assert_array_equal(found.intensity, [[1, 2, 3, 4, 5]])
    assert (found.azimuth.tolist(), found.is_part, found.sound_speed) == ([0.7], True, 1500.0)
    assert read(message, clockwise=True).azimuth.tolist() == [-0.7]


@pytest.mark.parametrize("step", [Duration(nanosec=2_000_000), 0.002])
def test_the_time_of_spokes_is_a_duration_or_seconds_as_in_older_definitions(step):
    spokes = [foreign.RadarEcho(echoes=row.tolist()) for row in TABLE]
    message = foreign.RadarSector(
        header=HEADER, range_max=100.0, time_increment=step, intensities=spokes
    )
    np.testing.assert_allclose(read(message).time_offset, [0.0, 0.002, 0.004, 0.006])
    message.time_increment = type(step)()
    assert read(message).time_offset is None


def picture(table, encoding="mono8", kind="u1", pad=0, big=False):
    form = np.dtype(kind).newbyteorder(">" if big else "<")
    rows = np.ascontiguousarray(table, form)
    height, width = rows.shape
    step = width * form.itemsize + pad
    filled = np.zeros((height, step), np.uint8)
    filled[:, : width * form.itemsize] = rows.view(np.uint8).reshape(height, -1)
    return Image(
        header=HEADER,
        height=height,
        width=width,
        encoding=encoding,
        is_bigendian=big,
        step=step,
        data=filled.tobytes(),
    )


@pytest.mark.parametrize(
    ("encoding", "kind", "pad", "big"),
    [
        ("mono8", "u1", 3, False),
        ("MONO8", "u1", 0, False),
        ("mono16", "u2", 0, True),
        ("16SC1", "i2", 2, False),
        ("32FC1", "f4", 4, False),
        ("64FC1", "f8", 0, True),
    ],
)
def test_a_picture_as_it_is_displayed_has_far_ranges_above_and_port_at_the_left(
    encoding, kind, pad, big
):
    displayed = TABLE.T[::-1]  # the last row is the nearest range
    found = read(picture(displayed, encoding, kind, pad, big), near_range=0.05, far_range=4.05)
    np.testing.assert_array_equal(found.intensity, TABLE)
    np.testing.assert_allclose(found.range, [0.05, 2.05, 4.05])  # middles of the rows
    assert found.assumptions == ()
    np.testing.assert_allclose(found.azimuth, [0.45, 0.15, -0.15, -0.45])


def test_a_step_of_0_and_three_equal_channels_are_read_where_they_are_plain():
    message = picture(TABLE)
    message.step = 0
    np.testing.assert_array_equal(read(message, rows="beams", near_first=True).intensity, TABLE)
    message = picture(np.repeat(TABLE, 3, axis=1), "rgb8")
    message.width = 3
    np.testing.assert_array_equal(read(message, rows="beams", near_first=True).intensity, TABLE)


def test_the_blanking_distance_is_no_range_of_a_row_and_without_ranges_this_is_said_or_dropped():
    stated = {"near_range": 0.05, "far_range": 10.05}
    blind = replace(SECTOR, min_range=5.0)
    near, far = read(picture(TABLE.T), **stated), read(picture(TABLE.T), blind, **stated)
    np.testing.assert_array_equal(near.range, far.range)
    unstated = read(picture(TABLE.T))
    np.testing.assert_allclose(unstated.range, 2.0 + 10.0 / 3.0 * np.array([0.5, 1.5, 2.5]))
    assert "all ranges are wrong: give both" in unstated.assumptions[0]
    for some in ({"near_range": 0.05}, {"far_range": 9.0}, {"near_range": 9.0, "far_range": 2.0}):
        with pytest.raises(MessageError, match=r"image\.near_range and, above it") as refused:
            read(picture(TABLE.T), **some)
        assert refused.value.reason == "no_geometry"
    with pytest.raises(MessageError, match="states no geometry"):
        read(picture(TABLE.T), Coverage(min_range=0.5))


@pytest.mark.parametrize("near_first", [False, True])
@pytest.mark.parametrize("port_first", [False, True])
@pytest.mark.parametrize("rows", ["ranges", "beams"])
def test_a_sentence_says_where_the_corners_are(rows, near_first, port_first):
    layout = {"rows": rows, "near_first": near_first, "port_first": port_first}
    corners = np.zeros((4, 3))
    corners[0, 0] = 1.0
    found = read(picture(corners), near_range=1.0, far_range=7.0, **layout)
    (beam, cell) = np.argwhere(found.intensity == 1.0)[0]
    side = "port" if found.azimuth[beam] > 0 else "starboard"
    degrees = abs(np.degrees(found.azimuth[beam]))
    assert (
        f"top left is {found.range[cell]:.4g} m at {degrees:.4g} degrees to {side},"
        in found.corners
    )
    assert "4 rows and 3 columns" in found.corners


def test_a_bearing_is_said_by_the_nearer_side():
    said = [image_side_in_words(math.radians(a)) for a in (358.2, -200.0, 30.0)]
    assert said == [
        "1.8 degrees to starboard",
        "160 degrees to port",
        "30 degrees to port",
    ]


def test_beams_with_z_0_have_x_ahead_which_is_said_and_others_have_z_ahead():
    message = projected()
    message.beam_directions = [Vector3(x=math.cos(a), y=math.sin(a), z=0.0) for a in BEAMS]
    found = read(message)
    np.testing.assert_allclose(found.azimuth, BEAMS, atol=1e-12)
    [said] = found.assumptions
    assert "x is taken as ahead" in said
    abeam = projected()  # z ahead, at right angles: z is 0 but for rounding, and so is x
    abeam.beam_directions = [
        Vector3(x=0.0, y=-math.sin(a), z=math.cos(a)) for a in [math.pi / 2] * 4
    ]
    found = read(abeam)
    assert found.assumptions == ()
    np.testing.assert_allclose(found.azimuth, math.pi / 2)
    turned = projected()  # x ahead, at right angles
    turned.beam_directions = [Vector3(x=math.cos(math.pi / 2), y=1.0, z=0.0)] * 4
    np.testing.assert_allclose(read(turned).azimuth, math.pi / 2)


def test_other_orders_of_a_picture_are_told_by_the_layout():
    near = read(picture(TABLE.T), near_first=True)
    np.testing.assert_array_equal(near.intensity, TABLE)
    by_beam = read(picture(TABLE), rows="beams", near_first=True)
    np.testing.assert_array_equal(by_beam.intensity, TABLE)
    starboard = read(picture(TABLE.T[:, ::-1]), near_first=True, port_first=False)
    np.testing.assert_array_equal(starboard.intensity[::-1], TABLE)
    assert (np.diff(starboard.azimuth) > 0.0).all()


@pytest.mark.parametrize(
    ("sensor", "shape", "apex"),
    [
        (SECTOR, (120, 140), (120.0, 70.0)),
        (SensorModel(max_range=12.0), (200, 240), (100.0, 120.0)),
    ],
)
@pytest.mark.parametrize("azimuth", [0.3, -0.45])
def test_a_fan_is_read_by_inverse_mapping(sensor, shape, apex, azimuth):
    cells = shape[0] if sensor is SECTOR else min(shape) // 2
    pixel = 12.0 / cells
    y, x = np.indices(shape) + 0.5
    ahead, port = (apex[0] - y) * pixel, (apex[1] - x) * pixel
    place = 8.0 * math.cos(azimuth), 8.0 * math.sin(azimuth)
    blob = 200.0 * np.exp(-0.5 * ((ahead - place[0]) ** 2 + (port - place[1]) ** 2) / 0.3**2)
    found = read(picture(blob), sensor=sensor, rows="fan")
    row, column = np.unravel_index(np.nanargmax(found.intensity), found.intensity.shape)
    assert found.azimuth[row] == pytest.approx(azimuth, abs=0.03)
    assert found.range[column] == pytest.approx(8.0, abs=0.15)


@pytest.mark.parametrize(
    ("message", "words"),
    [
        (projected(TABLE[:, :2]), "8 bytes; 4 beams of 3 ranges of 1 bytes have 12"),
        (raw(sample_rate=0.0), "sample_rate must be above 0"),
        (raw(tx_delays=[1.0, 2.0]), "tx_delays has 2 values"),
        (foreign.RadarSector(header=HEADER), "equal numbers of echoes"),
        (
            foreign.RadarSector(
                header=HEADER,
                intensities=[foreign.RadarEcho(echoes=[1.0]), foreign.RadarEcho(echoes=[1.0, 2.0])],
            ),
            "equal numbers of echoes",
        ),
        (foreign.SonarEcho(header=HEADER), "must not be empty"),
        (Image(header=HEADER, encoding="yuv422"), "publish the driver's raw image"),
        (
            Image(
                header=HEADER, encoding="bgr8", height=1, width=2, step=6, data=[1, 1, 1, 1, 2, 1]
            ),
            "no colours, .* take the driver's raw image",
        ),
        (
            Image(header=HEADER, encoding="mono8", height=2, width=3, step=0, data=[0] * 7),
            "too few",
        ),
        (Image(header=HEADER, encoding="mono8", height=2, width=3, step=2), "too few"),
        (Vector3(), "is not supported; supported types are .*SonarImage"),
        (raw(rx_angles=[math.nan] * 4), "must be finite"),
        (projected(cells=[-1.0, 0.0, 0.0]), "no cell has a range above 0"),
        (
            raw(image=foreign.SonarImageData(dtype=77, beam_count=4)),
            "dtype must be from 0 to 9; got 77",
        ),
    ],
)
def test_an_impossible_message_is_refused_with_its_cause(message, words):
    with pytest.raises(MessageError, match=words):
        read(message)


@pytest.mark.parametrize(
    ("begin", "step"), [(5000.0, 1e-3), (32e3, 7.5e-6), (9e7, 1e-3), (9e7, 1e-7)]
)
def test_a_plan_of_a_far_and_fine_window_takes_no_more_memory_than_a_near_one(begin, step):
    image = np.ones((5, 300))
    image[2, 299] = 7.0
    ping = ImagePing(0, "sonar", begin + step * np.arange(300.0), np.linspace(-1, 1, 5), image)
    tracemalloc.start()
    plan = plan_of(ping, Stages(image, image, image, 4.0))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 10e6
    assert plan.levels.max() == 87, "the strongest is shown"
    assert plan.levels[64, 127] == plan.levels.max(), "ahead, all of the window is near"


@pytest.mark.parametrize("whole", [False, True])
def test_a_plan_shows_a_target_to_port_ahead_at_its_place(whole):
    azimuth = np.linspace(-3.1, 3.1, 200) if whole else np.linspace(0.8, -0.8, 60)
    ping = ImagePing(5, "sonar", np.linspace(1.0, 40.0, 400), azimuth, np.zeros((1, 1)))
    smooth = np.full((len(azimuth), 400), 0.4)
    smooth[np.abs(azimuth - 0.5).argmin(), 205] = 8.0  # 21 m
    smooth[0] = np.nan
    plan = plan_of(ping, Stages(smooth, smooth, smooth, 4.0))
    message = plan_message(HEADER, plan)
    levels = np.array(message.data).reshape(128, 128)
    np.testing.assert_array_equal(levels, plan.levels)
    assert message.info.resolution == pytest.approx(80.0 / 128)
    turned = plan_message(HEADER, plan, "sonar").info.origin  # z ahead, y to starboard
    corner = message.info.origin.position.x
    assert [turned.position.x, turned.position.y, turned.position.z] == [0.0, -corner, corner]
    assert turned.orientation.x == turned.orientation.z == pytest.approx(math.sqrt(0.5))
    row, column = np.unravel_index(levels.argmax(), levels.shape)
    cell = message.info.resolution
    x = message.info.origin.position.x + (column + 0.5) * cell
    y = message.info.origin.position.y + (row + 0.5) * cell
    assert np.hypot(x - 21.0 * math.cos(0.5), y - 21.0 * math.sin(0.5)) < 1.5 * cell
    assert (levels.max(), levels[64, 100]) == (100, 5)
    assert (levels[64, 20] == -1) != whole
    assert levels[0, 0] == -1


def test_a_normalised_image_is_written_row_by_row():
    message = normalised_image(HEADER, TABLE)
    values = np.frombuffer(bytes(message.data), "<f4").reshape(message.height, message.width)
    np.testing.assert_array_equal(values, TABLE)


@pytest.mark.parametrize("channels", [1, 3])
def test_cells_that_are_not_measured_are_no_colours(channels):
    shown = np.repeat(
        np.array([[1.0, np.nan], [2.0, 3.0]], np.float32)[..., None], channels, axis=2
    )
    np.testing.assert_array_equal(grey_image(shown), shown[..., 0])
    if channels == 3:
        shown[0, 1, 1] = 5.0
        with pytest.raises(MessageError, match="colours"):
            grey_image(shown)
