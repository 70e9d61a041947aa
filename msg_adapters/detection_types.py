"""The registry of supported detection message types.

An adapter is a function of a message and :class:`ReadingOptions` that returns a :class:`Ping`. Each
message family has its own module. It registers an adapter under the message's type name, and a
writer that converts a scan to that message, for simulations::

    @register("sensor_msgs/msg/LaserScan")
    def read_laser_scan(scan, options): ...

    @register_writer("sensor_msgs/msg/LaserScan")
    def write_laser_scan(header, scan, sound_speed): ...
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from msg_adapters.errors import MessageError
from msg_adapters.ping import Ping, ReadingOptions
from tsepm_ros.tracker.scan import Scan
from tsepm_ros.tracker.sensor import SensorModel

if TYPE_CHECKING:
    from std_msgs.msg import Header


Adapter = Callable[[Any, ReadingOptions], Ping]
Writer = Callable[["Header", Scan, float], Any]

adapters: dict[str, Adapter] = {}
"""Every adapter, by the message type that it reads."""
_writers: dict[str, Writer] = {}


def register(type_name: str) -> Callable[[Adapter], Adapter]:
    """Register the decorated adapter for a message type.

    Parameters
    ----------
    type_name : str
        ROS name of the type, for example ``sensor_msgs/msg/PointCloud2``.
    """

    def decorate(adapter: Adapter) -> Adapter:
        adapters[type_name] = adapter
        return adapter

    return decorate


def register_writer(type_name: str) -> Callable[[Writer], Writer]:
    """Register the decorated function as the writer of a message type."""

    def decorate(writer: Writer) -> Writer:
        _writers[type_name] = writer
        return writer

    return decorate


def supported_types() -> tuple[str, ...]:
    """Return the sorted names of the message types that `read_detections` supports."""
    return tuple(sorted(adapters))


def read_detections(
    message: Any,
    *,
    bearing_reference: str = "bow",
    sound_speed: float = 0.0,
    sensor: SensorModel | None = None,
) -> Ping:
    """Read a detection message of any supported type.

    Bad detections are left out and counted; an unusable message is an error.

    Parameters
    ----------
    message : ROS message
        Of one of `supported_types`. Only its attributes are used, so messages of a bag library are
        possible if their ``__msgtype__`` is the name of the type.
    bearing_reference : {"bow", "north"}, optional
        Reference direction of a field `bearing`, which is positive clockwise. An azimuth is always
        counter-clockwise from the sensor's x axis.
    sound_speed : float, optional
        m/s. If it is not 0 and a message has no times, the ping is assumed to leave at the stamp:
        `time_offset` is range / sound_speed. It also applies to messages with an unset field for
        the sound speed; for these, 0 means SOUND_SPEED.
    sensor : SensorModel, optional
        Its range errors, by which the rays of one object in a `LaserScan` differ.

    Returns
    -------
    Ping

    Raises
    ------
    MessageError
        If the type is not supported or the message is malformed.
    ValueError
        If an option has a value that is not allowed.
    """
    options = ReadingOptions(bearing_reference, sound_speed, sensor)
    name = _type_name(message)
    adapter = _adapter(name)
    try:
        return adapter(message, options)
    except AttributeError as error:  # the installed package has another version of the type
        raise MessageError(
            "missing_field",
            f"this {name} does not have the fields of the supported version: {error}",
        ) from error


def write_detections(type_name: str, header: Header, scan: Scan, *, sound_speed: float) -> Any:
    """Make a message of any supported type, like a sonar driver.

    Data without a field in the type is left out: see the writer of its module.

    Parameters
    ----------
    type_name : str
        One of `supported_types`.
    header : std_msgs.msg.Header
        Stamp of the scan and the sensor's frame.
    scan : Scan
        Its ranges, azimuths and features are written; the stamp is that of the header.
    sound_speed : float
        m/s; 0: the echoes arrive without delay.

    Returns
    -------
    ROS message

    Raises
    ------
    MessageError
        If the type is not supported, or its package is not installed.
    ValueError
        If the type needs a travel time and the sound speed is 0.
    """
    message_class(type_name)
    return _writers[type_name](header, scan, sound_speed)


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
        message_type: type = getattr(importlib.import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError) as error:
        raise MessageError(
            "package_not_installed",
            f"message type {type_name!r} needs the package {package!r}, which is not installed "
            f"or too old ({error})",
        ) from error
    return message_type


def _type_name(message: Any) -> str:
    kind = type(message)
    declared: str | None = getattr(kind, "__msgtype__", None)
    return declared or f"{kind.__module__.partition('.')[0]}/msg/{kind.__name__}"


def _adapter(type_name: str) -> Adapter:
    try:
        return adapters[type_name]
    except KeyError:
        raise MessageError(
            "unknown_type",
            f"message type {type_name!r} is not supported; supported types are "
            f"{', '.join(supported_types())}",
        ) from None
