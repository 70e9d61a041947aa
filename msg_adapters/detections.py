"""From any supported detection message to one form.

An adapter is a function of a message and :class:`ReadingOptions` that returns a
:class:`DetectionMessage`. Each message family has its own module, which registers its adapter under
the message's type name, and a writer that makes such a message, for simulations::

    @register("sensor_msgs/msg/LaserScan")
    def read_laser_scan(scan, options): ...

    @register_writer("sensor_msgs/msg/LaserScan")
    def write_laser_scan(header, range, azimuth, sound_speed): ...
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from msg_adapters.errors import MessageError
from tsepm_ros.numerics.arrays import BoolArray, FloatArray
from tsepm_ros.sensing.scan import LARGEST, SMALLEST

if TYPE_CHECKING:
    from std_msgs.msg import Header


BEARING_REFERENCES = ("bow", "north")
"""What a `bearing` may be measured from, clockwise."""

SOUND_SPEED = 1500.0
"""Speed of sound where nobody says, m/s."""


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
        In the plane of the sensor's ahead and port, m, finite and above 0: the slant range times
        the cosine of the elevation.
    azimuth : (n,) ndarray
        In that plane, rad, finite, not wrapped: counter-clockwise from ahead, or from east where
        `north_referenced`.
    height : (n,) ndarray or None
        Above that plane, m, finite: the slant range times the sine of the elevation; None where
        the message has no elevation: 0. It counts where the sensor does not stand level.
    range_std, azimuth_std : (n,) ndarray or None
        Standard deviations, m and rad, finite and above 0, where the message has them.
    time_offset : (n,) ndarray or None
        Time after the stamp for which each position is valid, s, finite, where the message says.
    transmit_offset : (n,) ndarray or None
        Time after the stamp at which each detection's ping left, s, finite; None: at the stamp.
    features : dict of str to (n,) ndarray
        Further measurements by the names of `tsepm_ros.Scan`; their values may be nan or infinite.
    north_referenced : bool
        The azimuth comes from true bearings: it is measured in the axes of the fixed ENU frame,
        counter-clockwise from east, and the own ship's heading must not be applied to it.
    axes : str
        Which of the sensor frame's axes are ahead, port and up, see `attitude.AXES`.
    dropped : dict of str to int
        How many detections of the message were left out, by reason.
    index : (n,) ndarray of int
        Index of each detection in the message.
    assumptions : tuple of str
        Sentences that say what was taken to be so because the message does not say it. The same
        ones for every message of a driver.
    """

    stamp_ns: int
    frame_id: str
    range: FloatArray
    azimuth: FloatArray
    height: FloatArray | None = None
    range_std: FloatArray | None = None
    azimuth_std: FloatArray | None = None
    time_offset: FloatArray | None = None
    transmit_offset: FloatArray | None = None
    features: dict[str, FloatArray] = field(default_factory=dict)
    north_referenced: bool = False
    axes: str = "body"
    dropped: dict[str, int] = field(default_factory=dict)
    index: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, np.int64))
    assumptions: tuple[str, ...] = ()

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
    sound_speed : float
        m/s, where a message gives neither times nor, if it has a place for it, the sound speed; 0:
        not known.

    Raises
    ------
    ValueError
        If a value is not allowed.
    """

    bearing_reference: str = "bow"
    sound_speed: float = 0.0

    def __post_init__(self) -> None:
        if self.bearing_reference not in BEARING_REFERENCES:
            raise ValueError(
                f"bearing_reference must be one of {', '.join(BEARING_REFERENCES)}; "
                f"got {self.bearing_reference!r}"
            )
        if not 0.0 <= self.sound_speed < math.inf:
            raise ValueError(f"sound_speed must be finite and not negative; got {self.sound_speed}")


Adapter = Callable[[Any, ReadingOptions], DetectionMessage]

Writer = Callable[..., Any]

_adapters: dict[str, Adapter] = {}
_writers: dict[str, Writer] = {}
_written_features: dict[str, tuple[str, ...]] = {}


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


def register_writer(
    type_name: str, *, features: tuple[str, ...] = ()
) -> Callable[[Writer], Writer]:
    """Register the decorated function as what `write_detections` calls for a message type.

    It is called with header, range, azimuth and sound_speed, and by name with those of the
    features that it takes and that are given.
    """

    def decorate(writer: Writer) -> Writer:
        _writers[type_name] = writer
        _written_features[type_name] = features
        return writer

    return decorate


def supported_types() -> tuple[str, ...]:
    """Return the names of the message types that `read_detections` takes, sorted."""
    return tuple(sorted(_adapters))


def read_detections(
    message: Any, *, bearing_reference: str = "bow", sound_speed: float = 0.0
) -> DetectionMessage:
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
    sound_speed : float, optional
        m/s. Where it is not 0, the echoes of a message that gives no times are those of a ping sent
        at the stamp: `time_offset` is range / sound_speed. It also counts for messages that have a
        place for the sound speed and do not give it; for these 0 is SOUND_SPEED.

    Returns
    -------
    DetectionMessage

    Raises
    ------
    MessageError
        If the type is not supported or the message is malformed.
    ValueError
        If an option is not one of its values.
    """
    options = ReadingOptions(bearing_reference, sound_speed)
    name = _type_name(message)
    adapter = _adapter(name)
    try:
        return with_echo_times(adapter(message, options), sound_speed)
    except AttributeError as error:  # the installed package has another version of the type
        raise MessageError(
            "missing_field", f"this {name} has not the fields of the type that is known: {error}"
        ) from error


def with_echo_times(detections: DetectionMessage, sound_speed: float) -> DetectionMessage:
    """Detections whose times are those of echoes of a ping sent at the stamp, if they have none.

    Parameters
    ----------
    detections : DetectionMessage
    sound_speed : float
        m/s; 0: detections without times are of the stamp.
    """
    if detections.time_offset is not None or sound_speed <= 0.0:
        return detections
    slant = (
        detections.range
        if detections.height is None
        else np.hypot(detections.range, detections.height)
    )
    return replace(detections, time_offset=slant / sound_speed)


def write_detections(
    type_name: str,
    header: Header,
    *,
    range: FloatArray,
    azimuth: FloatArray,
    sound_speed: float,
    features: Mapping[str, FloatArray] = MappingProxyType({}),
) -> Any:
    """Make a message of any supported type, as a sonar's driver would.

    What a type cannot say is left out: see the writer of its module.

    Parameters
    ----------
    type_name : str
        One of `supported_types`.
    header : std_msgs.msg.Header
        Stamp of the scan and the sensor's frame.
    range : (n,) ndarray
        m.
    azimuth : (n,) ndarray
        rad, counter-clockwise from ahead.
    sound_speed : float
        m/s; 0: the echoes arrive at once.
    features : mapping of str to (n,) ndarray, optional
        As in `tsepm_ros.sensing.scan.FEATURES`; those that the type has no place for are left out.

    Returns
    -------
    ROS message

    Raises
    ------
    MessageError
        If the type is not supported, or its package is not installed.
    ValueError
        If the type cannot carry echoes that arrive at once.
    """
    message_class(type_name)
    taken = {name: features[name] for name in _written_features[type_name] if name in features}
    return _writers[type_name](header, range, azimuth, sound_speed, **taken)


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


def fitted(name: str, values: Sequence[Any] | NDArray[Any], n: int) -> FloatArray | None:
    """Values of an array that a message need not give, one for each of its n detections.

    Parameters
    ----------
    name : str
        Name of the field.
    values : (0,), (1,) or (n,) or (0, k), (1, k) or (n, k) array_like
        None given, one for all, or one each.
    n : int
        Number of detections.

    Returns
    -------
    (n,) or (n, k) ndarray or None
        None if no values are given.

    Raises
    ------
    MessageError
        If there are more or fewer.
    """
    array = np.asarray(values, np.float64)
    if len(array) == 0:
        return None
    if len(array) not in (1, n):
        raise MessageError("wrong_length", f"{name} has {len(array)} values for {n} detections")
    return np.broadcast_to(array, (n, *array.shape[1:]))


def intensity_feature(
    values: Sequence[float], n: int
) -> tuple[dict[str, FloatArray], tuple[str, ...]]:
    """The feature `intensity` of n detections; they are good without it, too.

    Parameters
    ----------
    values : (0,), (1,) or (n,) array_like
        As for `fitted`.
    n : int
        Number of detections.

    Returns
    -------
    features : dict of str to (n,) ndarray
        Empty where no values are given, or another number of them.
    assumptions : tuple of str
        Says so where it is another number.
    """
    try:
        found = fitted("intensities", values, n)
    except MessageError:
        return {}, ("intensities are not as many as detections: they are not used",)
    return ({} if found is None else {"intensity": found}), ()


def azimuth_of_bearing(bearing: FloatArray, reference: str) -> FloatArray:
    """Return the azimuth from the bow, or from east for bearings from north."""
    return np.pi / 2 - bearing if reference == "north" else -bearing


def in_plane(slant_range: FloatArray, elevation: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return range and height of detections at elevations (rad) above the sensor's x-y plane."""
    with np.errstate(invalid="ignore"):  # ends as range_not_finite or elevation_not_finite
        return slant_range * np.cos(elevation), slant_range * np.sin(elevation)


def good_detections(
    stamp_ns: int,
    frame_id: str,
    *,
    range: FloatArray,
    azimuth: FloatArray,
    height: FloatArray | None = None,
    range_std: FloatArray | None = None,
    azimuth_std: FloatArray | None = None,
    time_offset: FloatArray | None = None,
    transmit_offset: FloatArray | None = None,
    features: Mapping[str, FloatArray] | None = None,
    north_referenced: bool = False,
    axes: str = "body",
    faults: Mapping[str, BoolArray] | None = None,
    nothing: BoolArray | None = None,
    assumptions: tuple[str, ...] = (),
) -> DetectionMessage:
    """Leave out the bad detections of a message and count them: every adapter's last step.

    The reasons are ``range_not_finite``, ``range_not_positive``, ``azimuth_not_finite``,
    ``range_std_not_positive`` and ``azimuth_std_not_positive`` (also for nan and infinity),
    ``time_offset_not_finite`` and ``transmit_offset_not_finite``, and ``<field>_too_large`` and
    ``<field>_too_small`` for what is beyond `tsepm_ros.sensing.scan.LARGEST` or below
    `tsepm_ros.sensing.scan.SMALLEST`. A detection counts once, under the first that applies.

    Parameters
    ----------
    stamp_ns : int
        Stamp of the message, ns.
    frame_id : str
        Its frame.
    range, azimuth, height, range_std, azimuth_std, time_offset, transmit_offset, features
        As in :class:`DetectionMessage`, (n,) each, with any values. A height that is not finite or
        too large, though the place in the plane is not, counts as 0: as one that is not measured.
    north_referenced, axes, assumptions
        As in :class:`DetectionMessage`.
    faults : mapping of str to (n,) ndarray of bool, optional
        The adapter's own reasons and those they apply to; they come before the others.
    nothing : (n,) ndarray of bool, optional
        Places of the message that say that nothing was detected: left out without a count.

    Returns
    -------
    DetectionMessage
    """
    kept = np.ones(len(range), bool) if nothing is None else ~nothing
    dropped: dict[str, int] = {}
    common = _faults(range, azimuth, range_std, azimuth_std, time_offset, transmit_offset)
    for reason, bad in chain((faults or {}).items(), common):
        count = int(np.count_nonzero(bad & kept))
        if count:
            dropped[reason] = count
            kept &= ~bad

    whole = bool(kept.all())
    if height is not None:
        height = np.where(np.abs(height) <= LARGEST["range"], height, 0.0)[kept]

    def good(values: FloatArray) -> FloatArray:
        return values if whole else values[kept]

    def good_or_none(values: FloatArray | None) -> FloatArray | None:
        return None if values is None else good(values)

    return DetectionMessage(
        stamp_ns=stamp_ns,
        frame_id=frame_id,
        range=good(range),
        azimuth=good(azimuth),
        height=height,
        range_std=good_or_none(range_std),
        azimuth_std=good_or_none(azimuth_std),
        time_offset=good_or_none(time_offset),
        transmit_offset=good_or_none(transmit_offset),
        features={name: good(values) for name, values in (features or {}).items()},
        north_referenced=north_referenced,
        axes=axes,
        dropped=dropped,
        index=np.flatnonzero(kept),
        assumptions=assumptions,
    )


def _faults(
    range: FloatArray,
    azimuth: FloatArray,
    range_std: FloatArray | None,
    azimuth_std: FloatArray | None,
    time_offset: FloatArray | None,
    transmit_offset: FloatArray | None,
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
    for name, offset in (("time_offset", time_offset), ("transmit_offset", transmit_offset)):
        if offset is not None:
            yield f"{name}_not_finite", ~np.isfinite(offset)
            yield f"{name}_too_large", np.abs(offset) > LARGEST["time_offset"]
