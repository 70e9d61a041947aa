"""What adapters read from a detection message, and the options for it.

Options for reading detection messages: properties that a message does not contain.

The good detections of a message, with its drops and assumptions.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from msg_adapters.stamps import ns_to_seconds
from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from tsepm_ros.own_ship.attitude import stated_axes
from tsepm_ros.own_ship.registration import MessageFacts, SensorScan
from tsepm_ros.tracker.scan import MAX_MAGNITUDE, MIN_MAGNITUDE, Arc, Scan, arc_of, wrap
from tsepm_ros.tracker.sensor import SensorModel

BEARING_REFERENCES = ("bow", "north")
"""Reference directions of a `bearing`, which is positive clockwise."""

SOUND_SPEED = 1500.0
"""Default speed of sound, m/s."""


@dataclass(frozen=True)
class ReadingOptions:
    """Properties that a message does not contain.

    Parameters
    ----------
    bearing_reference : {"bow", "north"}
        Reference direction of a field `bearing`, which is positive clockwise.
    sound_speed : float
        m/s, for messages without times, or with an unset field for the sound speed; 0: unknown.
    sensor : SensorModel, optional
        Its range errors, by which rays of one object differ.

    Raises
    ------
    ValueError
        If a value is not allowed.
    """

    bearing_reference: str = "bow"
    sound_speed: float = 0.0
    sensor: SensorModel | None = None

    def __post_init__(self) -> None:
        if self.bearing_reference not in BEARING_REFERENCES:
            raise ValueError(
                f"bearing_reference must be one of {', '.join(BEARING_REFERENCES)}; "
                f"got {self.bearing_reference!r}"
            )
        if not 0.0 <= self.sound_speed < math.inf:
            raise ValueError(f"sound_speed must be finite and not negative; got {self.sound_speed}")


MAX_TURN = 2.5 * np.pi
"""Largest angle of a driver that counts from any axis and does not wrap, rad: a turn from there."""


@dataclass(frozen=True, eq=False)
class Ping:
    """The good detections of one message, which every adapter returns.

    Attributes
    ----------
    sensor_scan : SensorScan
        Input for a session.
    dropped : dict of str to int
        Number of detections that were left out, by reason.
    index : (n,) ndarray of int
        Index of each detection in the message.
    assumptions : tuple of str
        Sentences about data that the message does not have and that was assumed; equal for all
        messages of a driver.
    """

    sensor_scan: SensorScan
    dropped: dict[str, int]
    index: NDArray[np.int64]
    assumptions: tuple[str, ...] = ()

    @property
    def scan(self) -> Scan:
        """The detections in the sensor's own axes."""
        return self.sensor_scan.scan

    def __len__(self) -> int:
        """Return the number of good detections."""
        return len(self.index)


def good_detections(
    stamp_ns: int,
    frame_id: str,
    options: ReadingOptions,
    *,
    range: FloatArray,
    azimuth: FloatArray,
    height: FloatArray | None = None,
    range_std: FloatArray | None = None,
    azimuth_std: FloatArray | None = None,
    time_offset: FloatArray | None = None,
    transmit_offset: FloatArray | None = None,
    features: Mapping[str, FloatArray] | None = None,
    group: IntArray | None = None,
    north_referenced: bool = False,
    axes: str = "",
    faults: Mapping[str, BoolArray] | None = None,
    nothing: Mapping[str, BoolArray] | None = None,
    states: Mapping[str, float] | None = None,
    assumptions: tuple[str, ...] = (),
    beams: Arc | None = None,
) -> Ping:
    """Leave out the bad detections of a message and count them; the last step of every adapter.

    The reasons are ``range_not_finite``, ``range_not_positive``, ``azimuth_not_finite``,
    ``range_std_not_positive`` and ``azimuth_std_not_positive`` (also for nan and infinity),
    ``time_offset_not_finite`` and ``transmit_offset_not_finite``, and ``<field>_too_large`` and
    ``<field>_too_small`` for values above `tsepm_ros.tracker.scan.MAX_MAGNITUDE` or below
    `tsepm_ros.tracker.scan.MIN_MAGNITUDE`. A detection counts once, under the first reason that
    applies.

    Parameters
    ----------
    stamp_ns : int
        Stamp of the message, ns.
    frame_id : str
        Its frame.
    options : ReadingOptions
        If its sound speed is not 0 and there is no `time_offset`, the ping is assumed to leave at
        the stamp.
    range : (n,) ndarray
        In the plane of the sensor's ahead and port axes, m: the slant range times the cosine of the
        elevation. Like all following arrays it may have any values.
    azimuth : (n,) ndarray
        In that plane, rad, counter-clockwise from ahead, or from east if `north_referenced`.
    height : (n,) ndarray, optional
        Above that plane, m: the slant range times the sine of the elevation. A height that is not
        finite or too large is replaced by 0, like an unmeasured height.
    range_std, azimuth_std : (n,) ndarray, optional
        Standard deviations, m and rad.
    time_offset : (n,) ndarray, optional
        Time after the stamp for which each position is valid, s.
    transmit_offset : (n,) ndarray, optional
        Time after the stamp at which the ping of each detection left, s; 0 if not given.
    features : mapping of str to (n,) ndarray, optional
        Further measurements by the names of `tsepm_ros.Scan`.
    group : (n,) ndarray of int, optional
        Neighbouring detections of one object, as in `tsepm_ros.Scan`.
    north_referenced, axes
        As in `tsepm_ros.own_ship.registration.SensorScan`; by default the axes that the name of the
        frame states.
    faults : mapping of str to (n,) ndarray of bool, optional
        The adapter's own reasons and the detections to which they apply; they precede the others.
    nothing : mapping of str to (n,) ndarray of bool, optional
        Elements of the message without a detection, which are no drops, by the value that says so,
        in words.
    states : mapping of str to float, optional
        As in `tsepm_ros.own_ship.registration.MessageFacts`.
    assumptions : tuple of str, optional
        As in :class:`Ping`.
    beams : Arc, optional
        The azimuths of all beams; by default those of the elements of the message, good or bad.

    Returns
    -------
    Ping
    """
    if height is not None:
        height = np.where(np.abs(height) <= MAX_MAGNITUDE["range"], height, 0.0)
    if time_offset is None and options.sound_speed > 0.0:
        with np.errstate(over="ignore", invalid="ignore"):  # dropped as range_not_finite
            slant = range if height is None else np.hypot(range, height)
            time_offset = slant / options.sound_speed
    kept = np.ones(len(range), bool)
    no_return = _left_out((nothing or {}).items(), kept)
    common = _faults(range, azimuth, range_std, azimuth_std, time_offset, transmit_offset)
    dropped = _left_out(chain((faults or {}).items(), common), kept)

    def selected(values: FloatArray) -> FloatArray:
        return np.asarray(values, np.float64)[
            kept
        ]  # always a copy, independent of the message's buffer

    def selected_or_none(values: FloatArray | None) -> FloatArray | None:
        return None if values is None else selected(values)

    scan = Scan.trusted(
        stamp=ns_to_seconds(stamp_ns),
        range=selected(range),
        azimuth=wrap(selected(azimuth)),
        range_std=selected_or_none(range_std),
        azimuth_std=selected_or_none(azimuth_std),
        time_offset=selected_or_none(time_offset),
        features={name: selected(values) for name, values in (features or {}).items()},
        group=None if group is None else group[kept],
    )
    sensor_scan = SensorScan(
        scan=scan,
        frame_id=frame_id.lstrip("/"),  # as tf2
        north_referenced=north_referenced,
        stamp_ns=stamp_ns,
        transmit_offset=selected_or_none(transmit_offset),
        height=selected_or_none(height),
        axes=axes or stated_axes(frame_id),
        beams=beams or arc_of(azimuth),
        facts=MessageFacts(
            beyond_turn=int(np.count_nonzero(np.abs(azimuth[kept]) > MAX_TURN)),
            rays=len(range),
            no_return=no_return,
            states=states or {},
        ),
    )
    return Ping(sensor_scan, dropped, np.flatnonzero(kept), assumptions)


def _left_out(causes: Iterable[tuple[str, BoolArray]], kept: BoolArray) -> dict[str, int]:
    """Remove elements from those that are kept, and return their numbers by the first cause."""
    numbers: dict[str, int] = {}
    for cause, bad in causes:
        count = int(np.count_nonzero(bad & kept))
        if count:
            numbers[cause] = count
            kept &= ~bad
    return numbers


def _faults(
    range: FloatArray,
    azimuth: FloatArray,
    range_std: FloatArray | None,
    azimuth_std: FloatArray | None,
    time_offset: FloatArray | None,
    transmit_offset: FloatArray | None,
) -> Iterator[tuple[str, BoolArray]]:
    """Yield each reason and the detections to which it applies."""
    yield "range_not_finite", ~np.isfinite(range)
    yield "range_not_positive", range <= 0
    yield "range_too_small", range < MIN_MAGNITUDE["range"]
    yield "range_too_large", range > MAX_MAGNITUDE["range"]
    yield "azimuth_not_finite", ~np.isfinite(azimuth)
    for name, deviation in (("range_std", range_std), ("azimuth_std", azimuth_std)):
        if deviation is not None:
            yield f"{name}_not_positive", ~(np.isfinite(deviation) & (deviation > 0))
            yield f"{name}_too_small", deviation < MIN_MAGNITUDE[name]
            yield f"{name}_too_large", deviation > MAX_MAGNITUDE[name]
    for name, offset in (("time_offset", time_offset), ("transmit_offset", transmit_offset)):
        if offset is not None:
            yield f"{name}_not_finite", ~np.isfinite(offset)
            yield f"{name}_too_large", np.abs(offset) > MAX_MAGNITUDE["time_offset"]
