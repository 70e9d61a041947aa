"""The detection message types that are read and written, by name.

An adapter is a function of a message and :class:`ReadingOptions` that returns a :class:`Ping`. Each
message family has its own module, which registers its adapter under the message's type name, and a
writer that makes such a message of a scan, for simulations::

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
from msg_adapters.ping import Ping
from msg_adapters.reading_options import ReadingOptions
from tsepm_ros.sensing.scan import Scan

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
        As ROS names it, for example ``sensor_msgs/msg/PointCloud2``.
    """

    def decorate(adapter: Adapter) -> Adapter:
        adapters[type_name] = adapter
        return adapter

    return decorate


def register_writer(type_name: str) -> Callable[[Writer], Writer]:
    """Register the decorated function as what `write_detections` calls for a message type."""

    def decorate(writer: Writer) -> Writer:
        _writers[type_name] = writer
        return writer

    return decorate


def supported_types() -> tuple[str, ...]:
    """Return the names of the message types that `read_detections` takes, sorted."""
    return tuple(sorted(adapters))


def read_detections(
    message: Any, *, bearing_reference: str = "bow", sound_speed: float = 0.0
) -> Ping:
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
    Ping

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
        return adapter(message, options)
    except AttributeError as error:  # the installed package has another version of the type
        raise MessageError(
            "missing_field", f"this {name} has not the fields of the type that is known: {error}"
        ) from error


def write_detections(type_name: str, header: Header, scan: Scan, *, sound_speed: float) -> Any:
    """Make a message of any supported type, as a sonar's driver would.

    What a type cannot say is left out: see the writer of its module.

    Parameters
    ----------
    type_name : str
        One of `supported_types`.
    header : std_msgs.msg.Header
        Stamp of the scan and the sensor's frame.
    scan : Scan
        Its ranges, azimuths and features are written; the stamp is the header's.
    sound_speed : float
        m/s; 0: the echoes arrive at once.

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
        return adapters[type_name]
    except KeyError:
        raise MessageError(
            "unknown_type",
            f"message type {type_name!r} is not known; known are {', '.join(supported_types())}",
        ) from None
