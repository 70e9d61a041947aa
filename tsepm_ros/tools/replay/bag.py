"""Recorded messages in rosbag2 bags, sqlite3 or MCAP, read by rosbag2_py or the library rosbags."""

from __future__ import annotations

import re
import shutil
import sqlite3
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from msg_adapters import MessageError, message_class, supported_types
from msg_adapters.detections import installed_class
from msg_adapters.ping import present_name
from msg_adapters.sonar_images import IMAGES
from tsepm_ros.tools.replay.recording import MCAP, SQLITE, bag_files, kind_of

DETECTIONS, OWN_SHIP, TRACKED, TRUTH = "detections", "own_ship/odometry", "tracked", "ground_truth"
LAND = "land"
"""Roles of a bag's topics, named after the topics of the nodes."""

ROLES = (DETECTIONS, OWN_SHIP, TRACKED, TRUTH, LAND)

POINTS, ODOMETRY = "sensor_msgs/msg/PointCloud2", "nav_msgs/msg/Odometry"
GRID = "nav_msgs/msg/OccupancyGrid"
TRANSFORMS = "tf2_msgs/msg/TFMessage"
_OUTPUTS = (
    *(TRACKED, TRUTH, "tracks", "tracks/current", "tracks/odometry"),
    *("potential_tracks", "fixed_echoes"),
)
"""Topics that are never taken for the topic of a driver."""
_CDR, _PACKED = "cdr", b"\x28\xb5\x2f\xfd"
"""Encoding of the messages of ROS, and the first bytes of a message that is compressed."""
_REPAIRS = {
    MCAP: "mcap recover FILE -o NEW.mcap",
    SQLITE: "sqlite3 FILE .recover | sqlite3 NEW.db3",
}
"""Commands that save what is whole of a bag's file."""
_BESIDE = "-wal", "-journal"
"""Ends of the names of files that belong to an SQLite file while it is not closed."""


@dataclass(frozen=True)
class BagMessage:
    """A recorded message.

    Attributes
    ----------
    topic : str
    log_ns : int
        Time of reception, ns.
    data : bytes
        Serialised content, CDR.
    """

    topic: str
    log_ns: int
    data: bytes


class Bag:
    """A bag that is open for reading; closed at the end of its `with` block.

    Where ROS is sourced, rosbag2_py reads it; else, and where that cannot, such as message types
    that are not installed, the library rosbags. The definitions of the messages that are read are
    the bag's own, else those of ROS 2 Jazzy and `LAYOUTS`. No file of the bag is changed.

    Parameters
    ----------
    path : path
        As `source_of` returns it: a folder with metadata.yaml, or the file of a bag.

    Attributes
    ----------
    topics : dict of str to str
        Message types by topic, under their present names.
    start_ns, end_ns : int
        Times of the first and last message, ns; equal if the bag has no messages.
    notes : list of str
        Sentences about what the bag lacks and what is assumed instead.

    Raises
    ------
    ValueError
        If no library can read bags, or this bag cannot be read.
    """

    def __init__(self, path: Path | str) -> None:
        self._path = Path(path)
        self._open = ExitStack()
        self._files, self.notes = bag_files(self._path)
        with self._reading():
            try:
                self._storage: _Rosbag2Storage | _RosbagsStorage = _Rosbag2Storage(self._path)
            except Exception as error:  # rosbags reads more
                if not (isinstance(error, (ImportError, MessageError)) or find_spec("rosbags")):
                    raise
                self._storage = _RosbagsStorage(self._files, self._open, self.notes)
        self._kinds = {name: kind for name, (kind, _) in self._storage.topics.items()}
        self.topics = {name: present_name(kind) for name, kind in self._kinds.items()}
        self.start_ns, self.end_ns = self._storage.span_ns
        self._fitting: set[str] = set()
        self.notes += [
            f"the bag has no definition of {name}: its messages are read by a layout of this "
            "package"
            for name in sorted(self._storage.undefined)
            if present_name(name) in LAYOUTS
        ]

    def __enter__(self) -> Bag:
        """Return the bag itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close it."""
        self.close()

    def close(self) -> None:
        """Close the bag; no more messages can be read."""
        self._open.close()

    @property
    def duration(self) -> float:
        """Time from the first to the last message, s."""
        return 1e-9 * (self.end_ns - self.start_ns)

    def count(self, topic: str) -> int:
        """Return the number of messages of a topic."""
        return self._storage.topics[topic][1]

    def messages(
        self, topics: Collection[str], start_ns: int | None = None
    ) -> Iterator[BagMessage]:
        """Iterate over the messages of some topics in the order of reception.

        Parameters
        ----------
        topics : collection of str
        start_ns : int, optional
            Leave out messages received before this time, ns.

        Raises
        ------
        ValueError
            If the bag is damaged.
        """
        known = [topic for topic in topics if topic in self.topics]
        if not known:  # the libraries would return all topics
            return
        with self._reading():
            yield from self._storage.messages(known, start_ns)

    def read(self, message: BagMessage) -> Any:
        """Return the content of a message, with the fields of its type as attributes.

        Raises
        ------
        MessageError
            If it is not a message of its type.
        ValueError
            If the bag has no definition of its type, and no known layout fits.
        """
        name = self._kinds[message.topic]
        if message.data.startswith(_PACKED):
            raise ValueError(
                f"the messages of {self._path} are compressed: name the bag's folder, which has "
                "metadata.yaml, in place of the file"
            )
        try:
            content = self._storage.deserialize(message.data, name)
        except Exception as error:  # the parsers raise errors of many kinds
            if name in self._storage.undefined - self._fitting:
                raise ValueError(
                    f"the bag {self._path} has no definition of {name} that can be read, and its "
                    "messages do not have a layout that this package knows: convert the bag to "
                    f"MCAP by ros2 bag convert on a machine with {name.partition('/')[0]}"
                ) from error
            raise MessageError(
                "message_corrupt",
                f"a message on {message.topic} is not a valid {name}: {error}",
            ) from error
        self._fitting.add(name)
        return content

    @contextmanager
    def _reading(self) -> Iterator[None]:
        """Convert any exception of the libraries and their storages to a ValueError."""
        try:
            yield
        except ImportError as error:
            raise ValueError(f"{self._path} is a bag, {error}") from None
        except OSError as error:
            raise ValueError(f"the bag {self._path} cannot be read: {error}") from error
        except Exception as error:
            repair = _REPAIRS.get(kind_of(self._files[0]) if self._files[0].is_file() else "")
            raise ValueError(
                f"the bag {self._path} cannot be read: {error or type(error).__name__} (a file of "
                "it is damaged, or its end is missing: copy it again"
                + (f", or save what is whole by {repair})" if repair else ")")
            ) from error


class _Rosbag2Storage:
    """A bag read by ROS itself; its messages are those of the installed packages."""

    def __init__(self, path: Path) -> None:
        # By name: nothing here imports ROS unless it is sourced.
        self._library = import_module("rosbag2_py")
        self._deserialize = import_module("rclpy.serialization").deserialize_message
        # A folder's metadata name the storage.
        storage = {MCAP: "mcap", SQLITE: "sqlite3"}[kind_of(path)] if path.is_file() else ""
        self._options = self._library.StorageOptions(uri=str(path), storage_id=storage)
        information = self._library.Info().read_metadata(str(path), storage)
        self._compressed = bool(information.compression_mode)
        self.topics: dict[str, tuple[str, int]] = {
            topic.topic_metadata.name: (topic.topic_metadata.type, topic.message_count)
            for topic in information.topics_with_message_count
        }
        self.undefined: frozenset[str] = frozenset()
        readable = {*supported_types(), *IMAGES}
        for name in {present_name(kind) for kind, _ in self.topics.values()} & readable:
            message_class(name, readable)
        start_ns = information.starting_time.nanoseconds if information.message_count else 0
        self.span_ns: tuple[int, int] = start_ns, start_ns + information.duration.nanoseconds

    def messages(self, topics: list[str], start_ns: int | None) -> Iterator[BagMessage]:
        kind = "SequentialCompressionReader" if self._compressed else "SequentialReader"
        reader = getattr(self._library, kind)()
        reader.open(self._options, self._library.ConverterOptions("", ""))
        reader.set_filter(self._library.StorageFilter(topics=topics))
        if start_ns is not None:
            reader.seek(start_ns)
        while reader.has_next():
            topic, data, log_ns = reader.read_next()
            yield BagMessage(topic, log_ns, bytes(data))

    def deserialize(self, data: bytes, type_name: str) -> Any:
        return self._deserialize(data, installed_class(present_name(type_name)))


_FORMATS = {"ros2msg": "MSG", "ros2idl": "IDL", "omgidl": "IDL"}
"""Formats of definitions, as rosbags calls them, by the encodings of files."""
_NO_TEXT = "", ""
_IDL = re.compile(r"^={80}\nIDL: .*\n", re.MULTILINE)
"""Heads of the parts of an IDL definition."""


class _Topic(NamedTuple):
    """A topic of a file: its number there, and the format and text of its messages' definition."""

    number: int
    name: str
    kind: str
    definition: tuple[str, str]
    number_of_messages: int


class _SqliteFile:
    """A file of a bag, an SQLite database; it is not changed."""

    def __init__(self, path: Path, stack: ExitStack, notes: list[str]) -> None:
        beside = [path.with_name(path.name + end) for end in _BESIDE]
        beside = [file for file in beside if file.is_file() and file.stat().st_size]
        address = f"{path.resolve().as_uri()}?mode=ro&immutable=1"
        if beside:  # SQLite puts them into the file: a copy
            folder = Path(stack.enter_context(TemporaryDirectory()))
            for file in (path, *beside):
                shutil.copyfile(file, folder / file.name)
            address = (folder / path.name).as_uri()
            names = ", ".join(file.name for file in beside)
            notes.append(f"{path.name} was not closed by its recorder: {names} is read with it")
        base = sqlite3.connect(address, uri=True, check_same_thread=False)
        self._base = stack.enter_context(closing(base))
        base.text_factory = lambda text: text.decode(errors="replace")
        tables = {name for (name,) in base.execute("SELECT name FROM sqlite_master")}
        if not {"topics", "messages"} <= tables:
            raise ValueError(f"{path.name} is a database without the tables of a bag")
        query = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions"
        stored = base.execute(query) if "message_definitions" in tables else ()
        definitions = {kind: (_FORMATS.get(form, ""), text) for kind, form, text in stored}
        query = "SELECT topic_id, count(*), min(timestamp), max(timestamp) FROM messages GROUP BY 1"
        counts = {topic: row for topic, *row in base.execute(query)}
        query = "SELECT id, name, type FROM topics WHERE serialization_format = ?"
        self.topics = [
            _Topic(number, name, kind, definitions.get(kind, _NO_TEXT), counts.get(number, [0])[0])
            for number, name, kind in base.execute(query, (_CDR,))
        ]
        self.times = [time for _, *times in counts.values() for time in times]

    def messages(self, numbers: list[int], start_ns: int | None) -> Iterator[tuple[Any, ...]]:
        query = (
            "SELECT topic_id, timestamp, data FROM messages WHERE timestamp >= ? AND topic_id IN "
            f"({','.join('?' * len(numbers))}) ORDER BY timestamp, id"
        )
        yield from self._base.execute(query, (start_ns or -(2**63), *numbers))


class _RosbagsFile:
    """A file of a bag, MCAP, or the folder of a compressed bag, read by rosbags."""

    def __init__(self, path: Path, stack: ExitStack) -> None:
        from rosbags.rosbag2 import Reader, storage_mcap

        # A topic that nobody reads refuses no bag, whatever its definition is.
        vars(storage_mcap).update(get_msgdef=_definition, read_string=_text)
        if path.is_file() and path.suffix != MCAP:  # rosbags goes by the suffix
            link = Path(stack.enter_context(TemporaryDirectory()), f"bag{MCAP}")
            link.symlink_to(path.resolve())
            path = link
        self._reader = Reader(path)
        self._reader.open()
        stack.callback(self._reader.close)
        self.topics = [
            _Topic(c.id, c.topic, c.msgtype, (c.msgdef.format.name, c.msgdef.data), c.msgcount)
            for c in self._reader.connections
            if c.ext.serialization_format == _CDR
        ]
        some = self._reader.message_count
        # The reader's end is 1 ns after the last message.
        self.times = [self._reader.start_time, self._reader.end_time - 1] if some else []

    def messages(self, numbers: list[int], start_ns: int | None) -> Iterator[tuple[Any, ...]]:
        connections = [c for c in self._reader.connections if c.id in numbers]
        for connection, log_ns, data in self._reader.messages(connections, start=start_ns):
            yield connection.id, log_ns, data


def _definition(schema: Any) -> Any:
    """The definition of a schema of an MCAP file, as rosbags has it; none of another encoding."""
    from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat

    form = _FORMATS.get(schema.encoding) if schema else None
    return MessageDefinition(MessageDefinitionFormat[form or "NONE"], schema.data if form else "")


def _text(file: Any) -> str:
    """A text of an MCAP file: its length and the text, which need not be UTF-8."""
    length = int.from_bytes(file.read(4), "little")
    return str(file.read(length), errors="replace")


class _RosbagsStorage:
    """A bag read by the library rosbags, without ROS."""

    def __init__(self, files: list[Path], stack: ExitStack, notes: list[str]) -> None:
        try:
            self._known, self._standard = message_types()
        except ImportError:
            raise ImportError(
                "which requires ROS with the packages of its message types, or the library "
                "rosbags; it is not installed: pip install rosbags (with Python from apt: "
                "docs/python_and_command_line.md)"
            ) from None
        self._files = [
            _SqliteFile(path, stack, notes)
            if path.is_file() and kind_of(path) == SQLITE
            else _RosbagsFile(path, stack)
            for path in files
        ]
        topics = [topic for file in self._files for topic in file.topics]
        counts = Counter[str]()
        for topic in topics:
            counts[topic.name] += topic.number_of_messages
        self.topics = {topic.name: (topic.kind, counts[topic.name]) for topic in topics}
        self._definitions = {one.kind: one.definition for one in topics if all(one.definition)}
        self.undefined = {one.kind for one in topics} - self._definitions.keys() - self._standard
        times = [time for file in self._files for time in file.times]
        self.span_ns: tuple[int, int] = (min(times), max(times)) if times else (0, 0)
        self._stores: dict[str, tuple[Any, str]] = {}

    def messages(self, topics: list[str], start_ns: int | None) -> Iterator[BagMessage]:
        for file in self._files:
            names = {topic.number: topic.name for topic in file.topics if topic.name in topics}
            for number, log_ns, data in file.messages(list(names), start_ns) if names else ():
                yield BagMessage(names[number], log_ns, bytes(data))

    def deserialize(self, data: bytes, type_name: str) -> Any:
        if type_name not in self._stores:
            self._stores[type_name] = self._store_of(type_name)
        store, name = self._stores[type_name]
        return store.deserialize_cdr(data, name)

    def _store_of(self, type_name: str) -> tuple[Any, str]:
        """Types for messages of one type, by its own definition if that can be read; its name."""
        from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

        form, text = self._definitions.get(type_name, _NO_TEXT)
        own: dict[str, Any] = {}
        with suppress(Exception):  # the parsers raise errors of many kinds
            for part in filter(str.strip, _IDL.split(text) if form == "IDL" else [text]):
                types = get_types_from_idl(part) if form == "IDL" else {}
                own |= types or get_types_from_msg(part, type_name)
        if type_name not in own:
            self.undefined |= {type_name} - self._standard
        store = get_typestore(Stores.EMPTY)
        store.register({**self._known.fielddefs, **own})
        return store, type_name if type_name in store.fielddefs else present_name(type_name)


def message_types() -> tuple[Any, set[str]]:
    """Message types of rosbags: those of ROS and `LAYOUTS`, and the names of those of ROS."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    standard = set(store.fielddefs)
    for name, text in LAYOUTS.items():
        store.register(get_types_from_msg(text, name))
    return store, standard


class BagWriter:
    """Writes an MCAP bag by rosbag2_py where ROS is sourced, else by the library rosbags.

    Parameters
    ----------
    path : Path
        Folder of the bag, which must not exist.

    Raises
    ------
    ValueError
        If no library can write bags, or the folder cannot be made.
    """

    def __init__(self, path: Path) -> None:
        if path.exists():
            raise ValueError(f"{path} exists; give a new folder for the bag")
        self._topics: dict[str, Any] = {}
        self._ros: Any = None
        with suppress(ImportError):
            self._ros = import_module("rosbag2_py")
        try:
            self._writer = self._opened(path)
        except ImportError:
            raise ValueError(
                "to write a bag needs rosbag2_py of a sourced ROS, or the library rosbags: "
                "pip install rosbags"
            ) from None
        except Exception as error:  # the libraries raise errors of many kinds
            raise ValueError(f"the bag {path} cannot be written: {error}") from error

    def add(self, topic: str, kind: str) -> None:
        """Add a topic of a message type; a ValueError if rosbags has no definition of it."""
        if self._ros:
            self._writer.create_topic(
                self._ros.TopicMetadata(id=0, name=topic, type=kind, serialization_format="cdr")
            )
            self._topics[topic] = topic
            return
        store, _ = message_types()
        if kind not in store.fielddefs:
            raise ValueError(f"rosbags has no definition of {kind}; ros2 bag record writes it")
        self._topics[topic] = self._writer.add_connection(topic, kind, typestore=store)

    def write(self, topic: str, log_ns: int, data: bytes) -> None:
        """Write a serialised message of an added topic, with its time of reception, ns."""
        given = (data, log_ns) if self._ros else (log_ns, data)
        self._writer.write(self._topics[topic], *given)

    def close(self) -> None:
        """Write what is left, and close the bag."""
        self._writer.close()

    def _opened(self, path: Path) -> Any:
        if self._ros:
            writer = self._ros.SequentialWriter()
            options = self._ros.StorageOptions(uri=str(path), storage_id="mcap")
            writer.open(options, self._ros.ConverterOptions("", ""))
            return writer
        writer = mcap_writer(path)
        writer.open()
        return writer


def mcap_writer(path: Path) -> Any:
    """A writer of the library rosbags for an MCAP bag in a new folder; ImportError without it."""
    from rosbags.rosbag2 import StoragePlugin, Writer

    return Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)


LAYOUTS = {
    "marine_acoustic_msgs/msg/PingInfo": "float32 frequency\nfloat32 sound_speed\n"
    "float32[] tx_beamwidths\nfloat32[] rx_beamwidths\n",
    "marine_acoustic_msgs/msg/DetectionFlag": "uint8 flag\n",
    "marine_acoustic_msgs/msg/SonarDetections": "std_msgs/Header header\nPingInfo ping_info\n"
    "DetectionFlag[] flags\nfloat32[] two_way_travel_times\nfloat32[] tx_delays\n"
    "float32[] intensities\nfloat32[] tx_angles\nfloat32[] rx_angles\n",
    "marine_acoustic_msgs/msg/SonarRanges": "std_msgs/Header header\nPingInfo ping_info\n"
    "DetectionFlag[] flags\nfloat32[] transmit_delays\nfloat32[] intensities\n"
    "geometry_msgs/Vector3[] beam_unit_vec\nfloat32[] ranges\n",
    "radar_msgs/msg/RadarReturn": "float32 range\nfloat32 azimuth\nfloat32 elevation\n"
    "float32 doppler_velocity\nfloat32 amplitude\n",
    "radar_msgs/msg/RadarScan": "std_msgs/Header header\nRadarReturn[] returns\n",
    "vision_msgs/msg/ObjectHypothesis": "string class_id\nfloat64 score\n",
    "vision_msgs/msg/ObjectHypothesisWithPose": "ObjectHypothesis hypothesis\n"
    "geometry_msgs/PoseWithCovariance pose\n",
    "vision_msgs/msg/BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size\n",
    "vision_msgs/msg/Detection3D": "std_msgs/Header header\nObjectHypothesisWithPose[] results\n"
    "BoundingBox3D bbox\nstring id\n",
    "vision_msgs/msg/Detection3DArray": "std_msgs/Header header\nDetection3D[] detections\n",
}
"""Definitions of the supported message types that ROS itself does not have, for bags without."""


def find_topics(topics: Mapping[str, str], given: Mapping[str, str]) -> dict[str, str]:
    """Find the topics of a bag that a run needs.

    Parameters
    ----------
    topics : mapping of str to str
        Message types by topic, as in `Bag`.
    given : mapping of str to str
        Topics by role (one of ROLES). An empty or missing topic is replaced by the topic with the
        role's name, in any namespace; else, for detections and the own ship, by the only topic of
        a supported type.

    Returns
    -------
    dict of str to str
        Topics by role; roles without a topic are missing.

    Raises
    ------
    ValueError
        If a given topic is missing or has another type, if a role has several candidates, or if
        the detections have none; the message names them.
    """
    by_role = {role: _find(topics, role, given.get(role, "")) for role in ROLES}
    if not by_role[DETECTIONS]:
        available = ", ".join(f"{name} ({kind})" for name, kind in sorted(topics.items()))
        raise ValueError(f"the bag has no topic of detections; it has {available or 'no topics'}")
    return {role: topic for role, topic in by_role.items() if topic}


def moving_frames(topics: Mapping[str, str]) -> str:
    """The topic of a bag with transforms that may move, by its type; empty if there is none."""
    moving = (
        topic
        for topic, kind in sorted(topics.items())
        if kind == TRANSFORMS and not _is_called(topic, "tf_static")
    )
    return next(moving, "")


def _find(topics: Mapping[str, str], role: str, given: str) -> str:
    others = {DETECTIONS: supported_types(), OWN_SHIP: (ODOMETRY,), LAND: (GRID,)}
    types = others.get(role, (POINTS,))
    if given:
        topic = given if given in topics else f"/{given}"
        if topic not in topics:
            available = ", ".join(sorted(topics))
            raise ValueError(f"the bag has no topic {given}; it has {available or 'no topics'}")
        if topics[topic] not in types and not (role == DETECTIONS and topics[topic] in IMAGES):
            raise ValueError(
                f"{topic} has the type {topics[topic]}; the type of {role} must be "
                f"{' or '.join(types)}"
            )
        return topic
    named = _candidates(topics, role, types)
    if role == DETECTIONS and not named:  # first detections: images may be a camera's
        named = _candidates(topics, role, tuple(IMAGES))
    if len(named) > 1:
        raise ValueError(f"the bag has several topics for {role}: {', '.join(named)}")
    return named[0] if named else ""


def _candidates(topics: Mapping[str, str], role: str, types: tuple[str, ...]) -> list[str]:
    """Topics of some types with the role's name; of detections and own ship else all inputs."""
    candidates = [topic for topic, kind in sorted(topics.items()) if kind in types]
    named = [topic for topic in candidates if _is_called(topic, role)]
    if role in (DETECTIONS, OWN_SHIP) and not named:
        return [
            topic for topic in candidates if not any(_is_called(topic, name) for name in _OUTPUTS)
        ]
    return named


def _is_called(topic: str, name: str) -> bool:
    return f"/{topic}".endswith(f"/{name}")
