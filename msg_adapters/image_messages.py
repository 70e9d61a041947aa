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
"""Sonar images in messages, read and written: intensities over bearing and range.

=============================================== ================================================
message                                         content
=============================================== ================================================
`marine_acoustic_msgs/msg/ProjectedSonarImage`  a ping; rows are ranges, all beams of each
`marine_acoustic_msgs/msg/RawSonarImage`        a ping; rows are beams, all samples of each
`marine_sensor_msgs/msg/RadarSector`            some spokes of a rotation
`ping360_sonar_msgs/msg/SonarEcho`              one bearing
`sensor_msgs/msg/Image`                         a ping, whose geometry parameters state
=============================================== ================================================

A ping, or some of its bearings, is an `ImagePing`. Which axis the rows are differs between drivers
of the same message: `ImageLayout.rows` tells it. Displays take a `Plan`.
"""

from __future__ import annotations

import array
import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates, maximum_filter1d

from msg_adapters import messages
from msg_adapters.nav_messages import turn_plane
from msg_adapters.ping import fitted_to_ping, read_by, stated_sound_speed
from msg_adapters.stamps import MessageError, time_to_ns
from tsepm_ros.detector.detector import Stages
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.session.turn import ImagePing
from tsepm_ros.settings.node_options import ImageLayout
from tsepm_ros.tracker.scan import wrap
from tsepm_ros.tracker.sensor import Coverage

DTYPES = ("u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f4", "f8")
"""Types of marine_acoustic_msgs/SonarImageData by its number."""
ENCODINGS = {
    **{"mono8": ("u1", 1), "8uc1": ("u1", 1), "8sc1": ("i1", 1), "mono16": ("u2", 1)},
    **{"16uc1": ("u2", 1), "16sc1": ("i2", 1), "32sc1": ("i4", 1)},
    **{"32fc1": ("f4", 1), "64fc1": ("f8", 1), "8uc3": ("u1", 3), "8uc4": ("u1", 4)},
    **{"rgb8": ("u1", 3), "bgr8": ("u1", 3), "rgba8": ("u1", 4), "bgra8": ("u1", 4)},
}
"""Types and channels of sensor_msgs/Image by its encoding in small letters."""
BEARINGS = "marine_sensor_msgs/msg/RadarSector", "ping360_sonar_msgs/msg/SonarEcho"
"""Types whose messages are always parts of a turn."""
MOST = 1e4
"""Largest angle of a bearing, rad, and largest time of one after the stamp, s."""
LEVEL = 0.1
"""Elevation of beams from which on an assumption is stated, rad."""
NO_Z = 1e-6
"""Largest z of unit vectors that is 0 but for rounding."""
PLAN_SIDE = 128
"""Cells along a side of a plan."""

Reader = Callable[[Any, ImageLayout, Coverage, float], ImagePing]


def read_image(
    message: Any, layout: ImageLayout, sensor: Coverage, sound_speed: float = 0.0
) -> ImagePing:
    """Read a message of one of `IMAGES`.

    Parameters
    ----------
    message : ROS message
    layout : ImageLayout
    sensor : Coverage
        That of messages without a geometry.
    sound_speed : float, optional
        m/s, where a message states none; 0: 1500 m/s.

    Returns
    -------
    ImagePing
        Without the cells at range 0. All else but bearings is checked by the detector.

    Raises
    ------
    MessageError
        If the type is not supported, an array has another length than the message states, or a
        geometry is impossible; the sentence says what to change.
    """
    ping = read_by(IMAGES, message, layout, sensor, sound_speed)
    first = int((ping.range <= 0.0).sum())
    delays = 0.0 if ping.time_offset is None else ping.time_offset
    if not (np.maximum(np.abs(ping.azimuth), np.abs(delays)) < MOST).all():
        raise MessageError("bad_geometry", "bearings and their times must be finite")
    if first == len(ping.range):
        raise MessageError("bad_geometry", "no cell has a range above 0")
    return replace(ping, range=ping.range[first:], intensity=ping.intensity[:, first:])


def _projected_image(
    message: Any, layout: ImageLayout, _: Coverage, sound_speed: float
) -> ImagePing:
    """ProjectedSonarImage: z ahead, x up, y to starboard; or, with z = 0, x ahead, y to port."""
    beams = np.array([(beam.x, beam.y, beam.z) for beam in message.beam_directions]).reshape(-1, 3)
    range_ = np.array(message.ranges, float)
    speed, assumptions = stated_sound_speed(message, sound_speed)
    largest, axes = np.abs(beams).max(axis=0, initial=0.0), "sonar"
    if largest[2] < min(NO_Z, largest[0]):
        beams, axes = beams[:, ::-1] * (1.0, -1.0, 1.0), ""
        assumptions += ("z of all beam_directions is 0: x is taken as ahead and y as to port",)
    up = np.arctan2(beams[:, 0], np.hypot(beams[:, 1], beams[:, 2]))
    if (np.abs(up) > LEVEL).any():
        assumptions += ("beams are not level: their ranges count as horizontal",)
    return ImagePing(
        time_to_ns(message.header.stamp),
        message.header.frame_id,
        range_,
        np.asarray(np.unwrap(np.arctan2(-beams[:, 1], beams[:, 2])), float),
        _table(message.image, len(beams), len(range_), layout.rows == "beams"),
        sound_speed=speed,
        is_part=len(beams) == 1,
        assumptions=assumptions,
        axes=axes,
    )


def _raw_image(message: Any, layout: ImageLayout, _: Coverage, sound_speed: float) -> ImagePing:
    """RawSonarImage: angles to starboard, samples from the transmission on."""
    angles, samples = np.array(message.rx_angles, float), int(message.samples_per_beam)
    if not message.sample_rate > 0.0:
        raise MessageError("bad_geometry", f"sample_rate must be above 0: {message.sample_rate}")
    table = _table(message.image, len(angles), samples, layout.rows != "ranges")
    speed, assumptions = stated_sound_speed(message, sound_speed)
    delays = fitted_to_ping("tx_delays", message.tx_delays, len(angles))
    return ImagePing(
        time_to_ns(message.header.stamp),
        message.header.frame_id,
        0.5
        * speed
        / message.sample_rate
        * (int(message.sample0) + np.arange(samples, dtype=float)),
        -angles,
        table,
        time_offset=delays if delays is not None and delays.any() else None,
        sound_speed=speed,
        is_part=len(angles) == 1,
        assumptions=assumptions,
        axes="sonar",
    )


def _from_spokes(message: Any, layout: ImageLayout, _: Coverage, sound_speed: float) -> ImagePing:
    """RadarSector: rays to port, each at its own time."""
    rays = [np.asarray(ray.echoes, np.float32) for ray in message.intensities]
    lengths = sorted({len(ray) for ray in rays})
    if len(lengths) != 1 or not lengths[0]:
        raise MessageError("wrong_length", f"rays must have equal numbers of echoes; got {lengths}")
    number = np.arange(len(rays))
    step = message.time_increment  # older versions have seconds
    seconds = float(step if isinstance(step, float) else step.sec + 1e-9 * step.nanosec)
    return ImagePing(
        time_to_ns(message.header.stamp),
        message.header.frame_id,
        np.linspace(message.range_min, message.range_max, lengths[0], dtype=np.float64),
        (message.angle_start + message.angle_increment * number) * (-1 if layout.clockwise else 1),
        np.array(rays),
        time_offset=np.asarray(seconds * number, np.float64) if seconds else None,
        is_part=True,
    )


def _from_echo(message: Any, layout: ImageLayout, _: Coverage, sound_speed: float) -> ImagePing:
    """SonarEcho of a Ping360: one bearing, cells from 0 to the range."""
    intensity = np.frombuffer(bytes(message.intensities), np.uint8)
    if len(intensity) < 2 or not message.range > 0:
        raise MessageError("bad_geometry", "intensities and range must not be empty")
    cells = np.arange(0.5, len(intensity)) * (float(message.range) / len(intensity))
    return ImagePing(
        time_to_ns(message.header.stamp),
        message.header.frame_id,
        np.asarray(cells, float),
        np.array([-message.angle if layout.clockwise else message.angle], float),
        intensity[None],
        sound_speed=float(message.speed_of_sound),
        is_part=True,
    )


def _from_picture(message: Any, layout: ImageLayout, sensor: Coverage, _: float) -> ImagePing:
    """Image: of ranges and beams over the sensor's sector, or a fan in x and y."""
    picture = _pixels(message)
    near, far = layout.near_range, layout.far_range
    assumptions: tuple[str, ...] = ()
    if near < 0.0 and far < 0.0 and sensor.max_range != Coverage.max_range:
        half = 0.5 * (sensor.max_range - sensor.min_range) / picture.shape[layout.rows == "beams"]
        near, far = sensor.min_range + half, sensor.max_range - half
        assumptions = (
            "image.near_range and image.far_range are not given: the rows are taken to reach from "
            "sensor.min_range to sensor.max_range; if the first or the last row has another range, "
            "all ranges are wrong: give both",
        )
    if far < 0.0 or not near < far or (near < 0.0 and layout.rows != "fan"):
        raise MessageError(
            "no_geometry",
            "the message states no geometry: give image.near_range and, above it, image.far_range, "
            "sensor.azimuth_min and sensor.azimuth_max, as in the file of tsepm init --images yes",
        )
    sector = sensor.azimuth_min, sensor.azimuth_max
    range_, azimuth, intensity = located_image(picture, layout, (near, far), sector)
    return ImagePing(
        time_to_ns(message.header.stamp),
        message.header.frame_id,
        range_,
        azimuth,
        intensity,
        assumptions=assumptions,
        corners=image_in_words(picture, layout, range_, azimuth),
    )


def _pixels(message: Any) -> NDArray[Any]:
    """Rows and columns of an Image of one channel, or of equal channels."""
    kind, channels = ENCODINGS.get(message.encoding.lower(), ("", 0))
    if not channels:
        raise MessageError(
            "bad_encoding",
            f"encoding must be one of {', '.join(ENCODINGS)}; got {message.encoding!r}: publish "
            "the driver's raw image",
        )
    form = np.dtype(kind).newbyteorder(">" if message.is_bigendian else "<")
    height, width, step = int(message.height), int(message.width), int(message.step)
    data, row = np.frombuffer(bytes(message.data), np.uint8), width * channels * form.itemsize
    step = row if not step and len(data) == height * row else step
    if row > step or len(data) < height * step or not height * width:
        raise MessageError(
            "wrong_length",
            f"data has {len(data)} bytes and step is {step}: too few for {height} rows of {width} "
            f"{message.encoding} values",
        )
    rows = np.ascontiguousarray(data[: height * step].reshape(height, step)[:, :row])
    return grey_image(
        rows.view(form).astype(form.newbyteorder("=")).reshape(height, width, channels)
    )


def grey_image(picture: NDArray[Any]) -> NDArray[Any]:
    """The one channel of a picture (rows, columns), or (rows, columns, channels) of equal ones.

    Of two values, false and true, it is 0 and 1.

    Raises
    ------
    MessageError
        If it is no picture, or in colours. A fourth channel, opacity, is not used.
    """
    channels = np.atleast_3d(picture)
    first, others = channels[..., :1], channels[..., 1:3]
    alike = np.array_equal(others, np.broadcast_to(first, others.shape), equal_nan=True)
    if picture.ndim not in (2, 3) or not picture.size or not alike:
        raise MessageError(
            "bad_encoding",
            "a picture must have rows and columns, and no colours, which are no intensities: take "
            f"the driver's raw image; got the shape {picture.shape}",
        )
    return first[..., 0].astype(np.uint8) if picture.dtype == bool else first[..., 0]


def image_by_beam(picture: NDArray[Any], layout: ImageLayout) -> NDArray[Any]:
    """Intensities (b, m) of a picture of beams and ranges, from the nearest range on."""
    beams = picture if layout.rows == "beams" else picture.T
    return beams[:, :: 1 if layout.near_first else -1]


def located_image(
    picture: NDArray[Any],
    layout: ImageLayout,
    ends: tuple[float, float],
    sector: tuple[float, float],
) -> tuple[FloatArray, FloatArray, NDArray[Any]]:
    """Ranges, azimuths and intensities (b, m) of a picture.

    Parameters
    ----------
    picture : (rows, columns) ndarray
    layout : ImageLayout
    ends : (float, float)
        Middles of the nearest and the farthest row, m.
    sector : (float, float)
        Its edges, rad.
    """
    if layout.rows == "fan":
        return _unwarped_image(picture, layout, ends, sector)
    intensity = image_by_beam(picture, layout)
    b, m = intensity.shape
    return (
        np.linspace(*ends, m),
        _bearings(sector, b)[:: -1 if layout.port_first else 1],
        intensity,
    )


def image_in_words(
    picture: NDArray[Any], layout: ImageLayout, range_: FloatArray, azimuth: FloatArray
) -> str:
    """A sentence that says where the corners of a picture, or the sides of a fan, are.

    Parameters
    ----------
    picture : (rows, columns) ndarray
    layout : ImageLayout
    range_, azimuth : (m,) and (b,) ndarray
        As read from it.
    """
    height, width = picture.shape
    text = f"the image has {height} rows and {width} columns: "
    if layout.rows == "fan":
        whole, side = np.ptp(azimuth) > math.pi, "port" if layout.port_first else "starboard"
        apex, far = ("highest", "lowest") if layout.near_first else ("lowest", "highest")
        return (
            f"{text}the sonar is in the middle of {'it' if whole else f'its {apex} row'}, its "
            f"{'highest' if whole else far} row is {range_[-1]:.4g} m ahead, and {side} is at the "
            "left"
        )
    ranges = range_[:: 1 if layout.near_first else -1][[0, -1]]
    by_range = ("top left", "top right", "bottom left", "bottom right")
    names = [by_range[k] for k in (0, 2, 1, 3)] if layout.rows == "beams" else by_range
    corners = zip(names, itertools.product(ranges, azimuth[[0, -1]]), strict=True)
    return text + ", ".join(
        f"{name} is {r:.4g} m at {image_side_in_words(a)}" for name, (r, a) in corners
    )


def image_side_in_words(azimuth: float) -> str:
    """A bearing in words, by the nearer side."""
    angle = math.degrees(math.remainder(azimuth, math.tau))
    return f"{abs(angle):.4g} degrees to {'port' if angle >= 0 else 'starboard'}"


def _bearings(sector: tuple[float, float], number: int) -> FloatArray:
    """Middles of beams over the sector, (number,), rad, ascending."""
    part = (np.arange(number) + 0.5) / number
    return np.asarray(sector[0] + (sector[1] - sector[0]) * part, float)


def _unwarped_image(
    picture: NDArray[Any],
    layout: ImageLayout,
    ends: tuple[float, float],
    sector: tuple[float, float],
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """As `located_image`, of a fan, ahead upwards; NaN outside of it.

    The sonar is in the middle of the lowest row, or of all of the picture where the sector is more
    than half a turn.
    """
    height, width = picture.shape
    whole = sector[1] - sector[0] > math.pi + 1e-3
    cells = (min(height, width) + 1) // 2 if whole else height
    pixel = ends[1] / (cells - 0.5)
    range_ = (np.arange(max(math.ceil(ends[0] / pixel - 0.5), 0), cells) + 0.5) * pixel
    beams = round((sector[1] - sector[0]) * cells / 2.0)
    azimuth = _bearings(sector, min(max(beams, 2), 2 * width + 2))
    down = picture[:: -1 if layout.near_first and not whole else 1]
    displayed = down[:, :: 1 if layout.port_first else -1].astype(float)
    ahead, port = (turn(azimuth)[:, None] * range_ / pixel for turn in (np.cos, np.sin))
    cell = (0.5 * height if whole else height) - ahead - 0.5, 0.5 * width - port - 0.5
    return range_, azimuth, map_coordinates(displayed, cell, order=1, cval=np.nan)


def _table(image: Any, beams: int, cells: int, beam_rows: bool) -> NDArray[Any]:
    """Intensities (beams, cells) of a SonarImageData."""
    if not 0 <= image.dtype < len(DTYPES):
        raise MessageError("bad_encoding", f"dtype must be from 0 to 9; got {image.dtype}")
    form = np.dtype(DTYPES[image.dtype]).newbyteorder(">" if image.is_bigendian else "<")
    data = bytes(image.data)
    if len(data) != beams * cells * form.itemsize or not beams * cells:
        raise MessageError(
            "wrong_length",
            f"the image has {len(data)} bytes; {beams} beams of {cells} ranges of {form.itemsize} "
            f"bytes have {beams * cells * form.itemsize}",
        )
    values = np.frombuffer(data, form).astype(form.newbyteorder("="))
    return values.reshape(beams, cells) if beam_rows else values.reshape(cells, beams).T


@dataclass(frozen=True, eq=False)
class Plan:
    """An image in the plane of the sensor, for displays.

    Attributes
    ----------
    stamp_ns : int
    cell : float
        Side of a cell, m.
    levels : (PLAN_SIDE, PLAN_SIDE) ndarray of int8
        0 to 100, the threshold is 50; -1 outside of the image. Rows from starboard to port, columns
        from astern to ahead; the sensor is in the middle.
    """

    stamp_ns: int
    cell: float
    levels: NDArray[Any]


def plan_of(ping: ImagePing, stages: Stages) -> Plan:
    """The plan of an image's smoothed values: the largest near each cell."""
    cell = 2.0 * float(ping.range[-1]) / PLAN_SIDE
    along = (np.arange(PLAN_SIDE) + 0.5 - 0.5 * PLAN_SIDE) * cell
    distance, angle = np.hypot(along, along[:, None]), np.arctan2(along[:, None], along)
    azimuth = wrap(ping.azimuth)
    order = np.argsort(azimuth)
    row = order[np.searchsorted(0.5 * (azimuth[order][1:] + azimuth[order][:-1]), angle)]
    column = np.searchsorted(0.5 * (ping.range[1:] + ping.range[:-1]), distance)
    width = round(cell / float(np.diff(ping.range).mean()))
    width = min(max(width, 1), 2 * len(ping.range))  # from any cell all are near then
    largest = maximum_filter1d(stages.smoothed, width, axis=1)[row, column]
    step = np.ptp(ping.azimuth) / max(len(azimuth) - 1, 1)
    seen = (np.abs(wrap(angle - azimuth[row])) <= step) & (distance <= ping.range[-1])
    levels = np.clip(largest * (50.0 / max(stages.threshold, 1e-3)), 0.0, 100.0)
    levels = np.where(seen & np.isfinite(largest), levels, -1.0)
    return Plan(ping.stamp_ns, cell, levels.astype(np.int8))


def plan_message(header: messages.Header, plan: Plan, axes: str = "") -> messages.OccupancyGrid:
    """Make a grid of a plan, in the frame of the sensor, of axes as in `ImagePing`."""
    message = messages.OccupancyGrid(header=header, data=array.array("b", plan.levels.tobytes()))
    message.info.resolution, message.info.map_load_time = plan.cell, header.stamp
    message.info.width = message.info.height = PLAN_SIDE
    origin, corner = message.info.origin, -0.5 * PLAN_SIDE * plan.cell
    plane = turn_plane(origin.orientation, header.frame_id, axes)
    place = plane @ (corner, corner, 0.0)
    origin.position.x, origin.position.y, origin.position.z = place.tolist()
    return message


def normalised_image(header: messages.Header, image: NDArray[Any]) -> messages.Image:
    """Make an image of numbers (b, m), 32FC1, a row per beam."""
    height, width = image.shape
    return messages.Image(
        header=header,
        height=height,
        width=width,
        encoding="32FC1",
        step=4 * width,
        data=array.array("B", image.astype("<f4").tobytes()),
    )


IMAGES: dict[str, Reader] = {
    "marine_acoustic_msgs/msg/ProjectedSonarImage": _projected_image,
    "marine_acoustic_msgs/msg/RawSonarImage": _raw_image,
    "marine_sensor_msgs/msg/RadarSector": _from_spokes,
    "ping360_sonar_msgs/msg/SonarEcho": _from_echo,
    "sensor_msgs/msg/Image": _from_picture,
}
"""Readers by the message type."""
