"""Sonar images in messages, on stand-ins with the fields of their files."""

from __future__ import annotations

import math

import numpy as np
import pytest
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Vector3
from sensor_msgs.msg import Image
from support import foreign_messages as foreign

from msg_adapters import MessageError, make_header
from msg_adapters.sonar_images import (
    DTYPES,
    ImageInput,
    normalised_image,
    plan_message,
    plan_of,
    read_image,
)
from tsepm_ros.detector.detector import Stages
from tsepm_ros.session.turn import ImagePing
from tsepm_ros.settings.node_options import ImageLayout
from tsepm_ros.settings.settings import SONAR_DETECTOR, make_groups
from tsepm_ros.tracker.sensor import SensorModel

HEADER = make_header(1_700_000_000_123_456_789, "sonar")
SECTOR = SensorModel(min_range=2.0, max_range=12.0, azimuth_min=-0.6, azimuth_max=0.6)
BEAMS, CELLS = np.array([0.5, 0.1, -0.05, -0.4]), np.array([2.5, 3.0, 4.0])  # port to starboard
TABLE = np.arange(12).reshape(4, 3)  # beam by beam


def read(message, sensor=SECTOR, sound_speed=0.0, **layout):
    return read_image(message, ImageLayout(**layout), sensor, sound_speed)


def data(table, kind="u1", big=False):
    form = np.dtype(kind).newbyteorder(">" if big else "<")
    return foreign.SonarImageData(
        is_bigendian=big,
        dtype=DTYPES.index(kind),
        beam_count=4,
        data=np.ascontiguousarray(table).astype(form).tobytes(),
    )


def projected(table=TABLE.T, speed=1480.0, cells=CELLS, up=0.0, **image):
    directions = [Vector3(x=up, y=-math.sin(a), z=math.cos(a)) for a in BEAMS]
    return foreign.ProjectedSonarImage(
        header=HEADER,
        ping_info=foreign.PingInfo(sound_speed=speed),
        beam_directions=directions,
        ranges=list(cells),
        image=data(table, **image),
    )


def raw(table=TABLE, **fields):
    values = {
        "header": HEADER,
        "ping_info": foreign.PingInfo(sound_speed=1500.0),
        "sample_rate": 750.0,
        "samples_per_beam": 3,
        "sample0": 5,
        "rx_angles": (-BEAMS).tolist(),
        "image": data(table),
    }
    return foreign.RawSonarImage(**(values | fields))


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
    images.configure(make_groups(SONAR_DETECTOR, {"false_detections_per_ping": 5.0}))
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
    [("mono8", "u1", 3, False), ("mono16", "u2", 0, True), ("32FC1", "f4", 4, False)],
)
def test_a_picture_as_it_is_displayed_has_far_ranges_above_and_port_at_the_left(
    encoding, kind, pad, big
):
    displayed = TABLE.T[::-1]  # the last row is the nearest range
    found = read(picture(displayed, encoding, kind, pad, big))
    np.testing.assert_array_equal(found.intensity, TABLE)
    np.testing.assert_allclose(found.range, 2.0 + 10.0 / 3.0 * np.array([0.5, 1.5, 2.5]))
    np.testing.assert_allclose(found.azimuth, [0.45, 0.15, -0.15, -0.45])


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
        (Image(header=HEADER, encoding="bgr8"), "publish the driver's raw image"),
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
