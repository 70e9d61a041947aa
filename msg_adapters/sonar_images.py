"""Sonar images in messages: intensities over bearing and range, of whole pings or single bearings.

=============================================== ================================================
message                                         content
=============================================== ================================================
`marine_acoustic_msgs/msg/ProjectedSonarImage`  a ping; rows are ranges, all beams of each
`marine_acoustic_msgs/msg/RawSonarImage`        a ping; rows are beams, all samples of each
`marine_sensor_msgs/msg/RadarSector`            some spokes of a rotation
`ping360_sonar_msgs/msg/SonarEcho`              one bearing
`sensor_msgs/msg/Image`                         a ping, whose geometry parameters state
=============================================== ================================================

Which axis the rows are differs between drivers of one message: `ImageLayout.rows` tells it.
"""

from __future__ import annotations

import array
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates, maximum_filter1d

from msg_adapters import messages
from msg_adapters.ping import fitted, read_by, stated_sound_speed
from msg_adapters.stamps import MessageError, time_to_ns
from tsepm_ros.detector.detector import Detector, Stages
from tsepm_ros.detector.image import DetectorOptions, ImageCoverage, SonarImage
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.session.turn import ImagePing, ImageTurns
from tsepm_ros.settings.node_options import ImageLayout, SonarDetectorNodeOptions
from tsepm_ros.tracker.scan import Scan
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
PLAN_SIDE = 128
"""Cells along a side of a plan."""
PLAN_PERIOD = 0.5
"""Least time between two plans, s."""
MOST_PLANS = 500
"""Most plans of an offline run."""
MOST_NAMED = 8
"""Most bearings, or ranges, of a sentence."""
ALL_ROUND = 6.0
"""Bearings from which on more of them than ranges are nothing strange, rad."""
MOST = 1e4
"""Largest angle of a bearing, rad, and largest time of one after the stamp, s."""
LEVEL = 0.1
"""Elevation of beams from which on an assumption is stated, rad."""
NO_Z = 1e-6
"""Largest z of unit vectors that is 0 but for rounding."""
LOOKS = 10
"""Images of one shape that are looked at before a question is asked."""
BRIGHT = 0.95
"""Share of an image's cells below a level that most cells of a bright line are above."""


ALTERNATES = (
    "the ranges or the bearings of an image differ from those of the image before: the detector "
    "learns anew at each change, and the coverage follows where the next image has it too"
)


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
    first, delays = int((ping.range <= 0.0).sum()), ping.time_offset
    of_bearings = ping.azimuth if delays is None else np.concatenate([ping.azimuth, delays])
    if not (np.abs(of_bearings) < MOST).all():
        raise MessageError("bad_geometry", "bearings and their times must be finite")
    if first == len(ping.range):
        raise MessageError("bad_geometry", "no cell has a range above 0")
    return replace(ping, range=ping.range[first:], intensity=ping.intensity[:, first:])


def _projected(message: Any, layout: ImageLayout, _: Coverage, sound_speed: float) -> ImagePing:
    """ProjectedSonarImage: z ahead, x up, y to starboard; or, with z = 0, x ahead, y to port."""
    beams = np.array([(one.x, one.y, one.z) for one in message.beam_directions]).reshape(-1, 3)
    range_ = np.array(message.ranges, float)
    speed, assumptions = stated_sound_speed(message, sound_speed)
    largest = np.abs(beams).max(axis=0, initial=0.0)
    if largest[2] < min(NO_Z, largest[0]):
        beams = beams[:, ::-1] * (1.0, -1.0, 1.0)
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
    )


def _raw(message: Any, layout: ImageLayout, _: Coverage, sound_speed: float) -> ImagePing:
    """RawSonarImage: angles to starboard, samples from the transmission on."""
    angles, samples = np.array(message.rx_angles, float), int(message.samples_per_beam)
    if not message.sample_rate > 0.0:
        raise MessageError("bad_geometry", f"sample_rate must be above 0: {message.sample_rate}")
    table = _table(message.image, len(angles), samples, layout.rows != "ranges")
    speed, assumptions = stated_sound_speed(message, sound_speed)
    delays = fitted("tx_delays", message.tx_delays, len(angles))
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
    )


def _spokes(message: Any, layout: ImageLayout, _: Coverage, sound_speed: float) -> ImagePing:
    """RadarSector: rays to port, each at its own time."""
    rays = [np.asarray(one.echoes, np.float32) for one in message.intensities]
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


def _echo(message: Any, layout: ImageLayout, _: Coverage, sound_speed: float) -> ImagePing:
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


def _picture(message: Any, layout: ImageLayout, sensor: Coverage, _: float) -> ImagePing:
    """Image: of ranges and beams over the sensor's sector, or a fan in x and y."""
    picture = _pixels(message)
    sector, near, far = (
        (sensor.azimuth_min, sensor.azimuth_max),
        layout.near_range,
        layout.far_range,
    )
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
    range_, azimuth, intensity = located(picture, layout, (near, far), sector)
    return ImagePing(
        time_to_ns(message.header.stamp),
        message.header.frame_id,
        range_,
        azimuth,
        intensity,
        assumptions=assumptions,
        corners=in_words(picture, layout, range_, azimuth),
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
    return grey(rows.view(form).astype(form.newbyteorder("=")).reshape(height, width, channels))


def grey(picture: NDArray[Any]) -> NDArray[Any]:
    """The one channel of a picture (rows, columns), or (rows, columns, channels) of equal ones.

    Raises
    ------
    MessageError
        If it is no picture, or in colours. A fourth channel, opacity, is not used.
    """
    channels = np.atleast_3d(picture)
    colours = channels[..., :3]
    if picture.ndim not in (2, 3) or not picture.size or (colours != colours[..., :1]).any():
        raise MessageError(
            "bad_encoding",
            "a picture must have rows and columns, and no colours, which are no intensities: take "
            f"the driver's raw image; got the shape {picture.shape}",
        )
    return channels[..., 0]


def by_beam(picture: NDArray[Any], layout: ImageLayout) -> NDArray[Any]:
    """Intensities (b, m) of a picture of beams and ranges, from the nearest range on."""
    beams = picture if layout.rows == "beams" else picture.T
    return beams[:, :: 1 if layout.near_first else -1]


def located(
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
        return _unwarped(picture, layout, ends, sector)
    intensity = by_beam(picture, layout)
    b, m = intensity.shape
    return np.linspace(*ends, m), _bearings(sector, b)[:: -1 if layout.port_first else 1], intensity


def in_words(
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
        far, apex = ("lowest", "highest") if layout.near_first else ("highest", "lowest")
        whole, side = np.ptp(azimuth) > math.pi, "port" if layout.port_first else "starboard"
        return (
            f"{text}the sonar is in the middle of {'it' if whole else f'its {apex} row'}, its "
            f"{'highest' if whole else far} row is {range_[-1]:.4g} m ahead, and {side} is at the "
            "left"
        )
    ranges, sides = range_[:: 1 if layout.near_first else -1][[0, -1]], azimuth[[0, -1]]
    of_beams = layout.rows == "beams"
    corners = (
        ((r, a) for r in ranges for a in sides)
        if not of_beams
        else ((r, a) for a in sides for r in ranges)
    )
    names = ("top left", "top right", "bottom left", "bottom right")
    return text + ", ".join(
        f"{name} is {r:.4g} m at {to_side(a)}" for name, (r, a) in zip(names, corners, strict=True)
    )


def to_side(azimuth: float) -> str:
    """A bearing in words."""
    return f"{abs(math.degrees(azimuth)):.4g} degrees to {'port' if azimuth >= 0 else 'starboard'}"


def _bearings(sector: tuple[float, float], number: int) -> FloatArray:
    """Middles of beams over the sector, (number,), rad, ascending."""
    part = (np.arange(number) + 0.5) / number
    return np.asarray(sector[0] + (sector[1] - sector[0]) * part, float)


def _unwarped(
    picture: NDArray[Any],
    layout: ImageLayout,
    ends: tuple[float, float],
    sector: tuple[float, float],
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """As `located`, of a fan, ahead upwards; NaN outside of it.

    The sonar is in the middle of the lowest row, or of all of the picture where the sector is more
    than half a turn.
    """
    height, width = picture.shape
    span = sector[1] - sector[0]
    whole = span > math.pi + 1e-3
    cells = (min(height, width) + 1) // 2 if whole else height
    pixel = ends[1] / (cells - 0.5)
    range_ = (np.arange(max(math.ceil(ends[0] / pixel - 0.5), 0), cells) + 0.5) * pixel
    azimuth = _bearings(sector, min(max(round(span * cells / 2.0), 2), 2 * width + 2))
    ahead = np.cos(azimuth)[:, None] * range_ / pixel
    port = np.sin(azimuth)[:, None] * range_ / pixel
    apex = 0.5 * height if whole else float(height)
    row = apex - ahead if not layout.near_first or whole else ahead
    column = 0.5 * width - port if layout.port_first else 0.5 * width + port
    places = np.stack([row - 0.5, column - 0.5])
    return range_, azimuth, map_coordinates(picture.astype(float), places, order=1, cval=np.nan)


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


class FirstLook:
    """What the first images of a shape show that is no echo, or that another layout explains.

    Parameters
    ----------
    looks : int, optional
        Images in each of which it must be.
    """

    def __init__(self, looks: int = LOOKS) -> None:
        self._looks, self._left, self._always = looks, 0, np.zeros(0, bool)

    def add(self, ping: Any, rows: str = "") -> list[str]:
        """Take an image; the sentences, with the last of the first images.

        Parameters
        ----------
        ping : ImagePing or SonarImage
        rows : str, optional
            Of the layout by which a picture was read; empty: the message states its geometry.
        """
        b, m = ping.intensity.shape
        if len(self._always) != b + m + 2:
            self._left, self._always = self._looks, np.ones(b + m + 2, bool)
        if self._left <= 0:
            return []
        there = np.isfinite(ping.intensity)
        low = np.where(there, ping.intensity, ping.intensity.min(initial=0.0, where=there))
        middle, bright = np.quantile(low, [0.5, BRIGHT], method="lower")
        levels = [np.quantile(low, 0.5, axis=axis, method="lower") for axis in (1, 0)]
        spread = [float(np.ptp(np.quantile(one, [0.1, 0.9]))) for one in levels]
        varies = spread[0] > 2.0 * spread[1] + 0.2 * (float(bright) - float(middle))
        swapped = varies or (b > m and np.ptp(ping.azimuth) < ALL_ROUND)
        fan, asked = _is_fan(low) or _is_fan(low.T), rows not in ("", "fan")
        self._always &= np.append(np.concatenate(levels) > bright, [swapped and not fan, fan])
        self._left -= 1
        beams, cells = np.flatnonzero(self._always[:b]), np.flatnonzero(self._always[b:-2])
        named = ", ".join(f"{k} ({to_side(ping.azimuth[k])})" for k in beams[:MOST_NAMED])
        span = ping.range[cells].min(initial=np.inf), ping.range[cells].max(initial=0.0)
        always = f"brighter, at least by half, than {BRIGHT:.0%} of each of the first images"
        other = ("ranges", "beams") if rows == "beams" else ("beams", "ranges")
        sentences = {
            f"{len(beams)} of {b} bearings are {always}; numbers, from 0: {named}. Bytes of gain "
            "before each row, and lines of a display, count as bearings and shift the others: cut "
            "them off the image": len(beams),
            f"{len(cells)} of {m} ranges are {always}, from {span[0]:.4g} to {span[1]:.4g} m. If "
            "that is the ring of the transmission, give sensor.min_range beyond it": len(cells),
            f"{b} bearings of {m} ranges look transposed: if the rows of the image are {other[0]}, "
            f"not {other[1]}, give {other[0]} for rows (image.rows)": asked and self._always[-2],
            "the corners of the image are blank as around a fan, and it is read as bearings and "
            "ranges: if it is a picture in x and y, give fan for rows (image.rows)": asked
            and self._always[-1],
        }
        return [one for one, holds in sentences.items() if holds and not self._left]


def _is_fan(values: NDArray[Any]) -> bool:
    """Whether (b, m) values are blank at both sides, the less so the farther from an end."""
    b, m = values.shape
    filled = values != values[0, -1]
    run = np.where(filled.any(axis=0), [filled.argmax(axis=0), filled[::-1].argmax(axis=0)], b)
    ends = run[:, [m // 20, m // 10]], run[:, [-1 - m // 20, -1 - m // 10]]
    return any(
        0.5 * b > one[:, 0].min() > one[:, 1].max() >= one[:, 1].min() > 0.02 * b
        and np.ptp(one, axis=0).max() <= 0.02 * b + 2.0
        for one in ends
    )


class ImageInput:
    """From arriving messages of images to detections, for the node and offline runs.

    Parameters
    ----------
    options : mapping of type to options
        Of the groups of SONAR_DETECTOR.
    drop : callable
        Called with a reason and a sentence for an image that is not used.
    say : callable
        Called with each sentence about what a message does not state.

    Attributes
    ----------
    detector : Detector
    turns : ImageTurns
    in_parts : bool
        Whether the last message was of some bearings of a turn.
    coverage : ImageCoverage or None
        Of the images, within the detector's: of the first, then of two in a row.
    coverage_changes : int
        Images with another coverage than the one before.
    plans : list of Plan or None
        Of the images, where a display needs them: at most one in `PLAN_PERIOD`, and `MOST_PLANS`.
    """

    def __init__(
        self,
        options: Mapping[type[Any], Any],
        drop: Callable[[str, str], None],
        say: Callable[[str], None],
    ) -> None:
        self._options, self._drop, self._say = options, drop, say
        self.plans: list[Plan] | None = None
        self.in_parts, self._look = False, FirstLook()
        self.turns = ImageTurns(drop, say)
        self.detector = Detector(options[DetectorOptions], options[Coverage])
        self.coverage: ImageCoverage | None = None
        self.coverage_changes, self._other = 0, None  # type: int, ImageCoverage | None

    def configure(self, options: Mapping[type[Any], Any]) -> None:
        """Take changed options; what the detector learned stays unless its own changed."""
        if any(options[one] != self._options[one] for one in (DetectorOptions, Coverage)):
            self.detector = Detector(options[DetectorOptions], options[Coverage])
        self._options, self._look = options, FirstLook()

    def take(
        self, message: Any, is_late: Callable[[ImagePing], bool] = lambda turn: False
    ) -> Iterator[tuple[ImagePing, Scan]]:
        """Take a message; the pings that it completes and the detections of each.

        Turns of bearings that are late are passed over.
        """
        given: SonarDetectorNodeOptions = self._options[SonarDetectorNodeOptions]
        layout: ImageLayout = self._options[ImageLayout]
        try:
            ping = read_image(message, layout, self._options[Coverage], given.sound_speed)
        except MessageError as error:
            self._drop(error.reason, f"image dropped: {error}")
            return
        for assumption in ping.assumptions:
            self._say(assumption)
        self.in_parts = ping.is_part
        for whole in self.turns.add(ping):
            if ping.is_part and is_late(whole):
                continue
            try:
                image = SonarImage(
                    1e-9 * whole.stamp_ns,
                    whole.range,
                    whole.azimuth,
                    whole.intensity,
                    time_offset=whole.time_offset,
                )
                scan = self.detector.process(image)
            except ValueError as error:
                self._drop("bad_image", f"image dropped: {error}")
                continue
            for sentence in self._look.add(whole, layout.rows if whole.corners else ""):
                self._say(sentence)
            self._cover(whole)
            self._draw(whole)
            yield replace(whole, sound_speed=whole.sound_speed or given.sound_speed), scan

    def _cover(self, ping: ImagePing) -> None:
        """Note the coverage of an image; another one counts where the next image has it too."""
        now = ImageCoverage(ping.range, ping.azimuth, self._options[Coverage])
        before, self._other = self._other, now
        values = list(now.values.values())
        is_same = before is None or before.agrees(values)
        self.coverage_changes += not is_same
        if not is_same:
            self._say(ALTERNATES)
        elif self.coverage is None or not self.coverage.agrees(values):
            self.coverage = now

    def _draw(self, ping: ImagePing) -> None:
        """Keep the plan of an image, where these are kept."""
        stages, plans = self.detector.stages, self.plans
        if stages is None or plans is None or len(plans) >= MOST_PLANS:
            return
        if not plans or abs(ping.stamp_ns - plans[-1].stamp_ns) >= 1e9 * PLAN_PERIOD:
            plans.append(plan_of(ping, stages))


def detection_fields(ping: ImagePing, scan: Scan) -> dict[str, Any]:
    """What a message of a ping's detections has: fields of `detections_cloud`, (n,) each.

    Each echo has the time of its bearing and that of its travel, 0 where no sound speed is known.
    """
    sent = np.zeros(len(scan)) if scan.time_offset is None else scan.time_offset
    travel = 2.0 * scan.range / (ping.sound_speed or np.inf)
    times = {"time_offset": sent + 0.5 * travel, "two_way_travel_time": travel}
    names = ("range", "azimuth", "range_std", "azimuth_std")
    return {name: getattr(scan, name) for name in names} | times | dict(scan.features)


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
    wrapped = np.angle(np.exp(1j * ping.azimuth))
    order = np.argsort(wrapped)
    row = order[np.searchsorted(0.5 * (wrapped[order][1:] + wrapped[order][:-1]), angle)]
    column = np.searchsorted(0.5 * (ping.range[1:] + ping.range[:-1]), distance)
    width = max(round(cell / float(np.diff(ping.range).mean())), 1)
    width = min(width, 2 * len(ping.range))  # from any cell all are near then
    largest = maximum_filter1d(stages.smoothed, width, axis=1)[row, column]
    step = np.ptp(ping.azimuth) / max(len(ping.azimuth) - 1, 1)
    aside = np.abs(np.angle(np.exp(1j * (angle - wrapped[row]))))
    seen = (aside <= step) & (distance <= ping.range[-1]) & np.isfinite(largest)
    levels = np.clip(largest * (50.0 / max(stages.threshold, 1e-3)), 0.0, 100.0)
    return Plan(ping.stamp_ns, cell, np.where(seen, np.nan_to_num(levels), -1).astype(np.int8))


def plan_message(header: messages.Header, plan: Plan) -> messages.OccupancyGrid:
    """Make a grid of a plan, in the frame of the sensor."""
    message = messages.OccupancyGrid(header=header, data=array.array("b", plan.levels.tobytes()))
    message.info.resolution, message.info.map_load_time = plan.cell, header.stamp
    message.info.width = message.info.height = PLAN_SIDE
    message.info.origin.position.x = message.info.origin.position.y = -0.5 * PLAN_SIDE * plan.cell
    message.info.origin.orientation.w = 1.0
    return message


IMAGES: dict[str, Reader] = {
    "marine_acoustic_msgs/msg/ProjectedSonarImage": _projected,
    "marine_acoustic_msgs/msg/RawSonarImage": _raw,
    "marine_sensor_msgs/msg/RadarSector": _spokes,
    "ping360_sonar_msgs/msg/SonarEcho": _echo,
    "sensor_msgs/msg/Image": _picture,
}
"""Readers by the message type."""
BEARINGS = "marine_sensor_msgs/msg/RadarSector", "ping360_sonar_msgs/msg/SonarEcho"
"""Types whose messages are always parts of a turn."""


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
