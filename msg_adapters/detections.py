"""From any supported detection message to one form.

An adapter is a function of a message and :class:`ReadingOptions` that returns a
:class:`DetectionMessage`. Each message family has its own module, which registers its adapter under
the message's type name::

    @register("sensor_msgs/msg/LaserScan")
    def read_laser_scan(scan, options): ...
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from msg_adapters.errors import MessageError
from tsepm_ros.scan import LARGEST, SMALLEST

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

BEARING_REFERENCES = ("bow", "north")
"""What a `bearing` may be measured from, clockwise."""


@dataclass(frozen=True, eq=False)
class DetectionMessage:
    """The good detections of one message: what every adapter returns.

    Attributes
    ----------
    stamp_ns : int
        Stamp of the message, ns.
    frame_id : str
        The sensor's frame.
    range : (n,) ndarray
        m, finite and above 0.
    azimuth : (n,) ndarray
        rad, finite, not wrapped: counter-clockwise from the sensor's x axis, or from east where
        `north_referenced`.
    range_std, azimuth_std : (n,) ndarray or None
        Standard deviations, m and rad, finite and above 0, where the message has them.
    time_offset : (n,) ndarray or None
        Time after the stamp for which each position is valid, s, finite, where the message says.
    features : dict of str to (n,) ndarray
        Further measurements by the names of `tsepm_ros.Scan`; their values may be nan or infinite.
    north_referenced : bool
        The azimuth comes from true bearings: it is measured in the axes of the fixed ENU frame,
        counter-clockwise from east, and the own ship's heading must not be applied to it.
    dropped : dict of str to int
        How many detections of the message were left out, by reason.
    index : (n,) ndarray of int
        Index of each detection in the message.
    """

    stamp_ns: int
    frame_id: str
    range: FloatArray
    azimuth: FloatArray
    range_std: FloatArray | None = None
    azimuth_std: FloatArray | None = None
    time_offset: FloatArray | None = None
    features: dict[str, FloatArray] = field(default_factory=dict)
    north_referenced: bool = False
    dropped: dict[str, int] = field(default_factory=dict)
    index: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))

    def __len__(self) -> int:
        """Return the number of good detections."""
        return len(self.range)


@dataclass(frozen=True)
class ReadingOptions:
    """What a message does not say about itself.

    Parameters
    ----------
    bearing_reference : {"bow", "north"}
        What a field `bearing` is measured from, clockwise.

    Raises
    ------
    ValueError
        If a value is not allowed.
    """

    bearing_reference: str = "bow"

    def __post_init__(self) -> None:
        if self.bearing_reference not in BEARING_REFERENCES:
            raise ValueError(
                f"bearing_reference must be one of {', '.join(BEARING_REFERENCES)}; "
                f"got {self.bearing_reference!r}"
            )


Adapter = Callable[[Any, ReadingOptions], DetectionMessage]

_adapters: dict[str, Adapter] = {}


def register(type_name: str) -> Callable[[Adapter], Adapter]:
    """Register the decorated adapter for a message type.

    Parameters
    ----------
    type_name : str
        As ROS names it, for example ``sensor_msgs/msg/PointCloud2``.
    """

    def decorate(adapter: Adapter) -> Adapter:
        _adapters[type_name] = adapter
        return adapter

    return decorate


def supported_types() -> tuple[str, ...]:
    """Return the names of the message types that `read_detections` takes, sorted."""
    return tuple(sorted(_adapters))


def read_detections(message: Any, *, bearing_reference: str = "bow") -> DetectionMessage:
    """Read a detection message of any supported type.

    Single bad detections are left out and counted; an unusable message is an error.

    Parameters
    ----------
    message : ROS message
        Of one of `supported_types`. Only its attributes are used, so the messages of a bag library
        do as well if they name their type in ``__msgtype__``.
    bearing_reference : {"bow", "north"}, optional
        What a field `bearing` is measured from, clockwise. An azimuth is always counter-clockwise
        from the sensor's x axis.

    Returns
    -------
    DetectionMessage

    Raises
    ------
    MessageError
        If the type is not supported or the message is malformed.
    ValueError
        If `bearing_reference` is not one of its values.
    """
    options = ReadingOptions(bearing_reference)
    return _adapter(_type_name(message))(message, options)


def message_class(type_name: str) -> type:
    """Import the class of a supported message type.

    Parameters
    ----------
    type_name : str
        One of `supported_types`.

    Raises
    ------
    MessageError
        If the type is not supported, or its package is not installed.
    """
    _adapter(type_name)
    package, _, name = type_name.split("/")
    try:
        found: type = getattr(importlib.import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError) as error:
        raise MessageError(
            "package_not_installed",
            f"message type {type_name!r} needs the package {package!r}, which is not installed "
            f"here or too old ({error})",
        ) from error
    return found


def _type_name(message: Any) -> str:
    kind = type(message)
    declared: str | None = getattr(kind, "__msgtype__", None)
    return declared or f"{kind.__module__.partition('.')[0]}/msg/{kind.__name__}"


def _adapter(type_name: str) -> Adapter:
    try:
        return _adapters[type_name]
    except KeyError:
        raise MessageError(
            "unknown_type",
            f"message type {type_name!r} is not known; known are {', '.join(supported_types())}",
        ) from None


def azimuth_of_bearing(bearing: FloatArray, reference: str) -> FloatArray:
    """Return the azimuth from the bow, or from east for bearings from north."""
    return np.pi / 2 - bearing if reference == "north" else -bearing


def good_detections(
    stamp_ns: int,
    frame_id: str,
    *,
    range: FloatArray,
    azimuth: FloatArray,
    range_std: FloatArray | None = None,
    azimuth_std: FloatArray | None = None,
    time_offset: FloatArray | None = None,
    features: Mapping[str, FloatArray] | None = None,
    north_referenced: bool = False,
) -> DetectionMessage:
    """Leave out the bad detections of a message and count them: every adapter's last step.

    The reasons are ``range_not_finite``, ``range_not_positive``, ``azimuth_not_finite``,
    ``range_std_not_positive`` and ``azimuth_std_not_positive`` (also for nan and infinity),
    ``time_offset_not_finite``, and ``<field>_too_large`` and ``<field>_too_small`` for what is
    beyond `tsepm_ros.scan.LARGEST` or below `tsepm_ros.scan.SMALLEST`. A detection counts once,
    under the first that applies.

    Parameters
    ----------
    stamp_ns : int
        Stamp of the message, ns.
    frame_id : str
        Its frame.
    range, azimuth, range_std, azimuth_std, time_offset, features, north_referenced
        As in :class:`DetectionMessage`, (n,) each, with any values.

    Returns
    -------
    DetectionMessage
    """
    kept = np.ones(len(range), bool)
    dropped: dict[str, int] = {}
    for reason, bad in _faults(range, azimuth, range_std, azimuth_std, time_offset):
        count = int(np.count_nonzero(bad & kept))
        if count:
            dropped[reason] = count
            kept &= ~bad

    def good(values: FloatArray) -> FloatArray:
        return values[kept] if dropped else values

    def good_or_none(values: FloatArray | None) -> FloatArray | None:
        return None if values is None else good(values)

    return DetectionMessage(
        stamp_ns=stamp_ns,
        frame_id=frame_id,
        range=good(range),
        azimuth=good(azimuth),
        range_std=good_or_none(range_std),
        azimuth_std=good_or_none(azimuth_std),
        time_offset=good_or_none(time_offset),
        features={name: good(values) for name, values in (features or {}).items()},
        north_referenced=north_referenced,
        dropped=dropped,
        index=np.flatnonzero(kept),
    )


def _faults(
    range: FloatArray,
    azimuth: FloatArray,
    range_std: FloatArray | None,
    azimuth_std: FloatArray | None,
    time_offset: FloatArray | None,
) -> Iterator[tuple[str, BoolArray]]:
    """Yield each reason to leave detections out, with those that it applies to."""
    yield "range_not_finite", ~np.isfinite(range)
    yield "range_not_positive", range <= 0
    yield "range_too_small", range < SMALLEST["range"]
    yield "range_too_large", range > LARGEST["range"]
    yield "azimuth_not_finite", ~np.isfinite(azimuth)
    for name, deviation in (("range_std", range_std), ("azimuth_std", azimuth_std)):
        if deviation is not None:
            yield f"{name}_not_positive", ~(np.isfinite(deviation) & (deviation > 0))
            yield f"{name}_too_small", deviation < SMALLEST[name]
            yield f"{name}_too_large", deviation > LARGEST[name]
    if time_offset is not None:
        yield "time_offset_not_finite", ~np.isfinite(time_offset)
        yield "time_offset_too_large", np.abs(time_offset) > LARGEST["time_offset"]
