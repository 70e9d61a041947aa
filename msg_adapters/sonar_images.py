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
from tsepm_ros.tracker.sensor import SensorModel

DTYPES = ("u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f4", "f8")
"""Types of marine_acoustic_msgs/SonarImageData by its number."""
ENCODINGS = {"mono8": "u1", "8UC1": "u1", "mono16": "u2", "16UC1": "u2", "32FC1": "f4"}
"""Types of sensor_msgs/Image by its encoding."""
PLAN_SIDE = 128
"""Cells along a side of a plan."""
PLAN_PERIOD = 0.5
"""Least time between two plans, s."""
MOST_PLANS = 500
"""Most plans of an offline run."""
MOST = 1e4
"""Largest angle of a bearing, rad, and largest time of one after the stamp, s."""
LEVEL = 0.1
"""Elevation of beams from which on an assumption is stated, rad."""


ALTERNATES = (
    "the ranges or the bearings of an image differ from those of the image before: the detector "
    "learns anew at each change, and the coverage follows where the next image has it too"
)


Reader = Callable[[Any, ImageLayout, SensorModel, float], ImagePing]


def read_image(
    message: Any, layout: ImageLayout, sensor: SensorModel, sound_speed: float = 0.0
) -> ImagePing:
    """Read a message of one of `IMAGES`.

    Parameters
    ----------
    message : ROS message
    layout : ImageLayout
    sensor : SensorModel
        Its coverage is that of messages without a geometry.
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


def _projected(message: Any, layout: ImageLayout, _: SensorModel, sound_speed: float) -> ImagePing:
    """ProjectedSonarImage: z ahead, x up, y to starboard."""
    beams = np.array([(one.x, one.y, one.z) for one in message.beam_directions]).reshape(-1, 3)
    range_ = np.array(message.ranges, float)
    speed, assumptions = stated_sound_speed(message, sound_speed)
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


def _raw(message: Any, layout: ImageLayout, _: SensorModel, sound_speed: float) -> ImagePing:
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


def _spokes(message: Any, layout: ImageLayout, _: SensorModel, sound_speed: float) -> ImagePing:
    """RadarSector: rays to port, each at its own time."""
    rays = [np.asarray(one.echoes, np.float32) for one in message.intensities]
    lengths = sorted({len(ray) for ray in rays})
    if len(lengths) != 1 or not lengths[0]:
        raise MessageError("wrong_length", f"rays must have equal numbers of echoes; got {lengths}")
    number = np.arange(len(rays))
    step = message.time_increment.sec + 1e-9 * message.time_increment.nanosec
    return ImagePing(
        time_to_ns(message.header.stamp),
        message.header.frame_id,
        np.linspace(message.range_min, message.range_max, lengths[0], dtype=np.float64),
        (message.angle_start + message.angle_increment * number) * (-1 if layout.clockwise else 1),
        np.array(rays),
        time_offset=step * number if step else None,
        is_part=True,
    )


def _echo(message: Any, layout: ImageLayout, _: SensorModel, sound_speed: float) -> ImagePing:
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


def _picture(message: Any, layout: ImageLayout, sensor: SensorModel, _: float) -> ImagePing:
    """Image: of ranges and beams over the sensor's coverage, or a fan in x and y."""
    kind = ENCODINGS.get(message.encoding)
    if kind is None:
        raise MessageError(
            "bad_encoding",
            f"encoding must be one of {', '.join(ENCODINGS)}; got {message.encoding!r}: colours "
            "are no intensities, so publish the driver's raw image",
        )
    form = np.dtype(kind).newbyteorder(">" if message.is_bigendian else "<")
    height, width, step = int(message.height), int(message.width), int(message.step)
    data = np.frombuffer(bytes(message.data), np.uint8)
    if width * form.itemsize > step or len(data) < height * step or not height * width:
        raise MessageError(
            "wrong_length",
            f"data has {len(data)} bytes and step is {step}: too few for {height} rows of {width} "
            f"{message.encoding} values",
        )
    rows = data[: height * step].reshape(height, step)[:, : width * form.itemsize]
    picture = np.ascontiguousarray(rows).view(form).astype(form.newbyteorder("="))
    if sensor.max_range == SensorModel.max_range:
        raise MessageError(
            "no_geometry",
            "the message states no geometry: give sensor.max_range, min_range, azimuth_min and "
            "azimuth_max of the image, as in the file of tsepm init --images yes",
        )
    if layout.rows == "fan":
        range_, azimuth, intensity = _unwarped(picture, layout, sensor)
    else:
        by_beam = picture if layout.rows == "beams" else picture.T
        intensity = by_beam[:, :: 1 if layout.near_first else -1]
        b, m = intensity.shape
        range_ = sensor.min_range + (np.arange(m) + 0.5) * (
            (sensor.max_range - sensor.min_range) / m
        )
        azimuth = _bearings(sensor, b)[:: -1 if layout.port_first else 1]
    return ImagePing(
        time_to_ns(message.header.stamp), message.header.frame_id, range_, azimuth, intensity
    )


def _bearings(sensor: SensorModel, number: int) -> FloatArray:
    """Middles of beams over the sector, (number,), rad, ascending."""
    part = (np.arange(number) + 0.5) / number
    return np.asarray(sensor.azimuth_min + (sensor.azimuth_max - sensor.azimuth_min) * part, float)


def _unwarped(
    picture: NDArray[Any], layout: ImageLayout, sensor: SensorModel
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Ranges, azimuths and intensities (b, m) of a fan, ahead upwards; NaN outside of it."""
    height, width = picture.shape
    whole = sensor.azimuth_max - sensor.azimuth_min > math.pi + 1e-3
    cells = (min(height, width) + 1) // 2 if whole else height
    pixel = sensor.max_range / cells
    range_ = (np.arange(math.ceil(sensor.min_range / pixel - 0.5), cells) + 0.5) * pixel
    span = sensor.azimuth_max - sensor.azimuth_min
    azimuth = _bearings(sensor, min(max(round(span * cells / 2.0), 2), 2 * width + 2))
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
    coverage : ImageCoverage or None
        Of the images, without the detector's blanking distance: of the first, then of two in a row.
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
        self.turns, self.detector = ImageTurns(drop, say), Detector(options[DetectorOptions])
        self.coverage: ImageCoverage | None = None
        self.coverage_changes, self._other = 0, None  # type: int, ImageCoverage | None

    def configure(self, options: Mapping[type[Any], Any]) -> None:
        """Take changed options; what the detector learned stays unless its own changed."""
        if options[DetectorOptions] != self._options[DetectorOptions]:
            self.detector = Detector(options[DetectorOptions])
        self._options = options

    def take(self, message: Any) -> Iterator[tuple[ImagePing, Scan]]:
        """Take a message; the pings that it completes and the detections of each."""
        given: SonarDetectorNodeOptions = self._options[SonarDetectorNodeOptions]
        try:
            ping = read_image(
                message, self._options[ImageLayout], self._options[SensorModel], given.sound_speed
            )
        except MessageError as error:
            self._drop(error.reason, f"image dropped: {error}")
            return
        for assumption in ping.assumptions:
            self._say(assumption)
        for whole in self.turns.add(ping):
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
            self._cover(whole)
            self._draw(whole)
            yield replace(whole, sound_speed=whole.sound_speed or given.sound_speed), scan

    def _cover(self, ping: ImagePing) -> None:
        """Note the coverage of an image; another one counts where the next image has it too."""
        now = ImageCoverage(ping.range, ping.azimuth, self._options[SensorModel].min_range)
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
