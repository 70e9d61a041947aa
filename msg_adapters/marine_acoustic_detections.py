"""Detections in marine_acoustic_msgs/SonarDetections and SonarRanges.

The frame of both has z out of the sonar's face, x up and y to starboard. An array is empty if it is
not reported, has one value if it is constant, and otherwise one value per beam.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from msg_adapters.ping import (
    SOUND_SPEED,
    Ping,
    ReadingOptions,
    fitted,
    good_detections,
    intensity_feature,
    register,
    register_writer,
)
from msg_adapters.stamps import MessageError, time_to_ns
from tsepm_ros.numerics.arrays import BoolArray, FloatArray
from tsepm_ros.tracker.scan import Scan

if TYPE_CHECKING:
    from marine_acoustic_msgs.msg import SonarDetections, SonarRanges
    from std_msgs.msg import Header


MIN_SOUND_SPEED, MAX_SOUND_SPEED = 100.0, 10_000.0
"""Accepted sound speeds, m/s; in the message definition, 0 means unknown."""

_MAX_ANGLE = float(np.float32(np.pi / 2))  # the float32 is slightly larger than pi / 2
_ROUNDING = 1e-6  # of the squared sine of a float32 angle


@register("marine_acoustic_msgs/msg/SonarDetections")
def read_sonar_detections(message: SonarDetections, options: ReadingOptions) -> Ping:
    """Read the detections of a multibeam sonar's travel times.

    In addition to the reasons of `good_detections`, a beam may be dropped for ``flagged_bad`` and
    for ``direction_undefined``: angles that are not finite, exceed 90 degrees, or together define
    no direction. A transmit angle that is not reported is 0.

    Parameters
    ----------
    message : marine_acoustic_msgs.msg.SonarDetections
        The range is half of the travel time times the sound speed.
    options : ReadingOptions
        Its sound speed is used if the message has none.

    Returns
    -------
    Ping
        Azimuths from ahead to port.

    Raises
    ------
    MessageError
        If travel times or receive angles are missing, or an array has another length.
    """
    n = _number_of_beams(
        two_way_travel_times=message.two_way_travel_times, rx_angles=message.rx_angles
    )
    travel = _each("two_way_travel_times", message.two_way_travel_times, n)
    rx = _each("rx_angles", message.rx_angles, n)
    tx = _each("tx_angles", message.tx_angles, n)
    with np.errstate(invalid="ignore"):
        up, starboard = np.sin(tx), np.sin(rx)
        ahead = 1.0 - up**2 - starboard**2
        undefined = ~((ahead >= -_ROUNDING) & (abs(rx) <= _MAX_ANGLE) & (abs(tx) <= _MAX_ANGLE))
        direction = np.stack([up, starboard, np.sqrt(np.maximum(ahead, 0.0))], axis=1)
    speed, assumptions = _sound_speed("SonarDetections", message, options)
    return _detections(
        message,
        options,
        slant_range=0.5 * speed * travel,
        half_travel_time=0.5 * travel,
        delay=_each("tx_delays", message.tx_delays, n),
        direction=direction,
        undefined=undefined,
        assumptions=assumptions,
    )


@register("marine_acoustic_msgs/msg/SonarRanges")
def read_sonar_ranges(message: SonarRanges, options: ReadingOptions) -> Ping:
    """Read the detections of a sonar's ranges along beams.

    In addition to the reasons of `good_detections`, a beam may be dropped for ``flagged_bad`` and
    for ``direction_undefined``: a vector that is zero or not finite.

    Parameters
    ----------
    message : marine_acoustic_msgs.msg.SonarRanges
        Its vectors need not be of unit length.
    options : ReadingOptions
        Its sound speed, which determines the times of the echoes, is used if the message has none.

    Returns
    -------
    Ping
        Azimuths from ahead to port.

    Raises
    ------
    MessageError
        If ranges or vectors are missing, or an array has another length.
    """
    n = _number_of_beams(ranges=message.ranges, beam_unit_vec=message.beam_unit_vec)
    slant_range = _each("ranges", message.ranges, n)
    vectors = [(vector.x, vector.y, vector.z) for vector in message.beam_unit_vec]
    beam = _each("beam_unit_vec", vectors, n).reshape(n, 3)
    with np.errstate(all="ignore"):
        largest = np.abs(beam).max(axis=1, initial=0.0, keepdims=True)  # its square may overflow
        direction = beam / largest
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    speed, assumptions = _sound_speed("SonarRanges", message, options)
    return _detections(
        message,
        options,
        slant_range=slant_range,
        half_travel_time=slant_range / speed,
        delay=_each("transmit_delays", message.transmit_delays, n),
        direction=direction,
        undefined=~np.isfinite(direction).all(axis=1),
        assumptions=assumptions,
    )


def _number_of_beams(**arrays: Any) -> int:
    """Return the number of beams of the arrays that give ranges and directions."""
    lengths = {name: len(values) for name, values in arrays.items()}
    missing = [name for name, length in lengths.items() if not length]
    if missing and any(lengths.values()):
        raise MessageError("missing_field", f"{missing[0]} is empty: the beams have no position")
    return max(lengths.values())


def _each(name: str, values: Any, n: int) -> FloatArray:
    """Return one value per beam; zeros if the array is not reported."""
    per_beam = fitted(name, values, n)
    return np.zeros(n) if per_beam is None else per_beam


def _sound_speed(name: str, message: Any, options: ReadingOptions) -> tuple[float, tuple[str, ...]]:
    """Return the sound speed, m/s, and the assumptions about it."""
    speed = float(message.ping_info.sound_speed)
    if MIN_SOUND_SPEED <= speed <= MAX_SOUND_SPEED:
        return speed, ()
    speed = options.sound_speed or SOUND_SPEED
    source = "the parameter sound_speed" if options.sound_speed else "sound_speed is not set"
    return speed, (f"{name} has no sound speed: {speed:g} m/s is assumed; {source}",)


def _detections(
    message: Any,
    options: ReadingOptions,
    *,
    slant_range: FloatArray,
    half_travel_time: FloatArray,
    delay: FloatArray,
    direction: FloatArray,
    undefined: BoolArray,
    assumptions: tuple[str, ...],
) -> Ping:
    """Return the detections of beams: m, s, s after the stamp, unit vectors (n, 3)."""
    n = len(slant_range)
    flags = _each("flags", [flag.flag for flag in message.flags], n)
    features, more = intensity_feature(message.intensities, n)
    up, starboard, ahead = direction.T
    with np.errstate(invalid="ignore"):  # dropped as not finite or direction_undefined
        range = slant_range * np.hypot(starboard, ahead)
        azimuth = np.arctan2(-starboard, ahead)
        height = slant_range * up
        echo = delay + half_travel_time
    return good_detections(
        time_to_ns(message.header.stamp),
        message.header.frame_id,
        options,
        range=range,
        azimuth=azimuth,
        height=height,
        time_offset=echo,
        transmit_offset=delay,
        features=features,
        axes="sonar",
        states={"sound speed (m/s)": float(message.ping_info.sound_speed)},
        faults={"flagged_bad": flags != 0, "direction_undefined": undefined},
        assumptions=(*assumptions, *more),
    )


@register_writer("marine_acoustic_msgs/msg/SonarDetections")
def write_sonar_detections(header: Header, scan: Scan, sound_speed: float) -> SonarDetections:
    """Write the detections ahead; the message has no directions abeam and astern."""
    from marine_acoustic_msgs.msg import SonarDetections

    _check_sound_speed(sound_speed)
    ahead = np.cos(scan.azimuth) > 0.0
    angles = -np.arctan2(np.sin(scan.azimuth), np.cos(scan.azimuth))
    message = SonarDetections()
    message.header = header
    message.ping_info.sound_speed = sound_speed
    message.two_way_travel_times = (2.0 * scan.range[ahead] / sound_speed).tolist()
    message.rx_angles = angles[ahead].tolist()
    return message


@register_writer("marine_acoustic_msgs/msg/SonarRanges")
def write_sonar_ranges(header: Header, scan: Scan, sound_speed: float) -> SonarRanges:
    """Write the detections as beams in the horizontal plane."""
    from geometry_msgs.msg import Vector3
    from marine_acoustic_msgs.msg import SonarRanges

    _check_sound_speed(sound_speed)
    message = SonarRanges()
    message.header = header
    message.ping_info.sound_speed = sound_speed
    message.ranges = scan.range.tolist()
    message.beam_unit_vec = [
        Vector3(y=-math.sin(angle), z=math.cos(angle)) for angle in scan.azimuth.tolist()
    ]
    return message


def _check_sound_speed(sound_speed: float) -> None:
    if sound_speed <= 0.0:
        raise ValueError(
            "sound_speed of the scenario must be above 0: the messages contain travel times"
        )
