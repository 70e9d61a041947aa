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
"""Recorded messages in rosbag2 bags, sqlite3 or MCAP, read by rosbag2_py or the library rosbags."""

from __future__ import annotations

import re
import shutil
import sqlite3
from collections.abc import Collection, Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from msg_adapters import MessageError, message_class, supported_types
from msg_adapters.detections import installed_class
from msg_adapters.image_messages import IMAGES
from msg_adapters.ping import present_name
from tsepm_ros.tools.replay.recording import MCAP, SQLITE, recording_bag_files, recording_kind_of
from tsepm_ros.whole_files import naming_file

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
_REPAIRS = {
    MCAP: "mcap recover FILE -o NEW.mcap",
    SQLITE: "sqlite3 FILE .recover | sqlite3 NEW.db3",
}
"""Commands that save what is whole of a bag's file."""
_CAUSES = {
    "Profile is not": "the MCAP file is not of ROS 2: record by ros2 bag record -s mcap",
    "missing tables": "the database is no bag's, or a -wal file that belongs to it is missing",
}
"""What causes some errors of the libraries, by words of them."""
_FORMATS = {"ros2msg": "MSG", "ros2idl": "IDL", "omgidl": "IDL"}
"""Formats of definitions, as rosbags calls them, by the encodings of files."""
_IDL, _NAME = re.compile(r"^={80}\nIDL: .*\n", re.MULTILINE), re.compile(r"'(\w+/msg/\w+)'")
"""Heads of the parts of an IDL definition, and names of types."""
_UNKNOWN = "FROM message_definitions WHERE encoding NOT IN ('ros2msg', 'ros2idl')"
"""Definitions of a database that rosbags does not know."""
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


class Bag(ExitStack):
    """A bag that is open for reading; closed at the end of its `with` block, or by `close`.

    Where ROS is sourced, rosbag2_py reads it; else, and where that cannot, such as message types
    that are not installed, the library rosbags. The definitions of the messages that are read are
    the bag's own, else those of ROS 2 Jazzy and `LAYOUTS`. No file of the bag is changed.

    Parameters
    ----------
    path : path
        As `recording_source_of` returns it: a folder with metadata.yaml, or the file of a bag.

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
        super().__init__()
        self._path = Path(path)
        self._files, self.notes = recording_bag_files(self._path)
        with self._reading():
            try:
                self._storage: _Rosbag2Storage | _RosbagsStorage = _Rosbag2Storage(self._path)
            except Exception:  # rosbags reads more, with errors of its own
                self._storage = _RosbagsStorage(self._files, self, self.notes)
        self.topics = {name: present_name(kind) for name, (kind, _) in self._storage.topics.items()}
        self.start_ns, self.end_ns = self._storage.span_ns
        self._fitting: set[str] = set()
        self.notes += [
            f"the bag has no definition of {name}: its messages are read by a layout of this "
            "package"
            for name in sorted(self._storage.undefined)
            if present_name(name) in LAYOUTS
        ]

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
        # Of no topics the libraries would return all.
        if known := [topic for topic in topics if topic in self.topics]:
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
        name, _ = self._storage.topics[message.topic]
        if message.data.startswith(b"\x28\xb5\x2f\xfd"):  # zstd, no CDR
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
        except Exception as error:
            first = self._files[0] if self._files else self._path
            repair = _REPAIRS.get(
                recording_kind_of(first) if first.is_file() else "", "unpack it by unzstd"
            )
            damaged = (
                "a file of it is damaged, or its end is missing: copy it again, or save what is "
                f"whole: {repair}"
            )
            causes = (cause for words, cause in _CAUSES.items() if words in str(error))
            remedy = "" if isinstance(error, OSError) else f" ({next(causes, damaged)})"
            raise ValueError(
                f"the bag {self._path} cannot be read: {error or type(error).__name__}{remedy}"
            ) from error


class _Rosbag2Storage:
    """A bag read by ROS itself; its messages are those of the installed packages."""

    def __init__(self, path: Path) -> None:
        # By name: nothing here imports ROS unless it is sourced.
        self._library = import_module("rosbag2_py")
        self._deserialize = import_module("rclpy.serialization").deserialize_message
        # A folder's metadata name the storage.
        storage = (
            {MCAP: "mcap", SQLITE: "sqlite3"}[recording_kind_of(path)] if path.is_file() else ""
        )
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
        reader = (
            self._library.SequentialCompressionReader()
            if self._compressed
            else self._library.SequentialReader()
        )
        reader.open(self._options, self._library.ConverterOptions("", ""))
        reader.set_filter(self._library.StorageFilter(topics=topics))
        if start_ns is not None:
            reader.seek(start_ns)
        while reader.has_next():
            topic, data, log_ns = reader.read_next()
            yield BagMessage(topic, log_ns, bytes(data))

    def deserialize(self, data: bytes, type_name: str) -> Any:
        return self._deserialize(data, installed_class(present_name(type_name)))


class _RosbagsStorage:
    """A bag read by the library rosbags, without ROS, file by file."""

    def __init__(self, files: list[Path], stack: ExitStack, notes: list[str]) -> None:
        try:
            from rosbags.rosbag2 import Reader, storage_mcap
        except ImportError:
            raise ImportError(
                "which ROS here, if any, does not read: that requires the packages of its message "
                "types and a whole bag. The library rosbags is not installed: pip install rosbags "
                "(with Python from apt: docs/python_and_command_line.md)"
            ) from None
        # A topic that nobody reads refuses no bag, whatever its definition is.
        vars(storage_mcap).update(get_msgdef=_definition, read_string=_bag_text)
        readers = [stack.enter_context(Reader(_readable(path, stack, notes))) for path in files]
        # Of many files, `ros2 bag reindex` may name the tenth before the second.
        self._readers = sorted(readers, key=lambda reader: reader.start_time)
        self._known, self._standard = message_types()
        connections = [
            connection
            for reader in self._readers
            for connection in reader.connections
            if getattr(connection.ext, "serialization_format", "cdr") == "cdr"
        ]
        self.topics = {
            one.topic: (one.msgtype, sum(c.msgcount for c in connections if c.topic == one.topic))
            for one in connections
        }
        self._definitions = {one.msgtype: one.msgdef for one in connections if one.msgdef.data}
        kinds = {one.msgtype for one in connections}
        self.undefined = kinds - self._definitions.keys() - self._standard
        some = [reader for reader in self._readers if reader.message_count]
        # A reader's end is 1 ns after the last message.
        self.span_ns: tuple[int, int] = (
            min((reader.start_time for reader in some), default=0),
            max((reader.end_time - 1 for reader in some), default=0),
        )
        self._stores: dict[str, tuple[Any, str]] = {}

    def messages(self, topics: list[str], start_ns: int | None) -> Iterator[BagMessage]:
        for reader in self._readers:
            connections = [c for c in reader.connections if c.topic in topics]
            stored = reader.messages(connections, start=start_ns) if connections else ()
            for connection, log_ns, data in stored:
                yield BagMessage(connection.topic, log_ns, bytes(data))

    def deserialize(self, data: bytes, type_name: str) -> Any:
        if type_name not in self._stores:
            self._stores[type_name] = self._store_of(type_name)
        store, name = self._stores[type_name]
        return store.deserialize_cdr(data, name)

    def _store_of(self, type_name: str) -> tuple[Any, str]:
        """Types for messages of one type, by its own definition if that can be read; its name."""
        from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

        own: dict[str, Any] = {}
        with suppress(Exception):  # the parsers raise errors of many kinds
            definition = self._definitions[type_name]
            is_idl = definition.format.name == "IDL"
            for part in filter(str.strip, _IDL.split(definition.data)):
                own |= get_types_from_idl(part) if is_idl else get_types_from_msg(part, type_name)
        if type_name not in own:
            self.undefined |= {type_name} - self._standard
            known = type_name in self._known.fielddefs
            return self._known, type_name if known else present_name(type_name)
        store = get_typestore(Stores.EMPTY)
        is_whole = {*re.findall(_NAME, repr(own))} <= own.keys()
        store.register(own if is_whole else {**self._known.fielddefs, **own})
        return store, type_name


def _definition(schema: Any) -> Any:
    """The definition of a schema of an MCAP file, as rosbags has it; none of another encoding."""
    from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat

    form = _FORMATS.get(schema.encoding) if schema else None
    return MessageDefinition(MessageDefinitionFormat[form or "NONE"], schema.data if form else "")


def _bag_text(file: Any) -> str:
    """A text of an MCAP file: its length and the text, which need not be UTF-8."""
    return str(file.read(int.from_bytes(file.read(4), "little")), errors="replace")


def _readable(path: Path, stack: ExitStack, notes: list[str]) -> Path:
    """A file of a bag under a name by which rosbags reads all of it, and as it is.

    What a database does not have yet, and other files have, is put into a copy, as SQLite does; so
    are definitions left out that rosbags does not know.
    """
    kind = recording_kind_of(path) if path.is_file() else ""
    if kind not in (MCAP, SQLITE):  # the folder of a compressed bag
        return path
    copy_path = Path(stack.enter_context(TemporaryDirectory()), f"bag{kind}")
    beside = [Path(f"{path}{end}") for end in ("-wal", "-journal") if kind == SQLITE]
    beside = [file for file in beside if file.is_file() and file.stat().st_size]
    address = f"{path.resolve().as_uri()}?immutable=1"
    if kind == MCAP or not (beside or _answers(address, f"SELECT 1 {_UNKNOWN}")):
        copy_path.symlink_to(path.resolve())
        return copy_path
    for file in (path, *beside):
        shutil.copyfile(file, f"{copy_path}{file.name.removeprefix(path.name)}")
    _answers(copy_path.as_uri(), f"PRAGMA journal_mode = DELETE; DELETE {_UNKNOWN}")
    notes += [f"{file.name} belongs to {path.name} and is read with it" for file in beside]
    return copy_path


def _answers(address: str, commands: str) -> list[Any]:
    """What a database answers, up to a command about a table that it does not have."""
    answers: list[Any] = []
    base = sqlite3.connect(address, uri=True, isolation_level=None)
    with closing(base), suppress(sqlite3.OperationalError):
        for command in commands.split(";"):
            answers += base.execute(command)
    return answers


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
        self._path = path
        self._topics: dict[str, Any] = {}
        self._ros: Any = None
        with suppress(ImportError):
            self._ros = import_module("rosbag2_py")
        try:
            if self._ros:
                self._writer = self._ros.SequentialWriter()
                options = self._ros.StorageOptions(uri=str(path), storage_id="mcap")
                self._writer.open(options, self._ros.ConverterOptions("", ""))
            else:
                self._writer = mcap_bag_writer(path)
                self._writer.open()
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
        with naming_file(self._path):
            self._writer.write(self._topics[topic], *given)

    def close(self) -> None:
        """Write what is left, and close the bag."""
        with naming_file(self._path):
            self._writer.close()


def mcap_bag_writer(path: Path) -> Any:
    """A writer of the library rosbags for an MCAP bag in a new folder; ImportError without it."""
    from rosbags.rosbag2 import StoragePlugin, Writer

    return Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)


def find_bag_topics(
    topics: Mapping[str, str], given: Mapping[str, str], sensor: str = ""
) -> dict[str, str]:
    """Find the topics of a bag that a run needs.

    Parameters
    ----------
    topics : mapping of str to str
        Message types by topic, as in `Bag`.
    given : mapping of str to str
        Topics by role (one of ROLES). An empty or missing topic is replaced by the topic with the
        role's name, in any namespace; else, for detections and the own ship, by the only topic of
        a supported type.
    sensor : str, optional
        Of several sensors, the one whose detections, or images, are in the namespace of its name.

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
    near = f"/{sensor}/" if sensor and not given.get(DETECTIONS) else ""
    own = {name: kind for name, kind in topics.items() if near in f"/{name}"}
    by_role = {
        role: _find_topic(own if role == DETECTIONS else topics, role, given.get(role, ""))
        for role in ROLES
    }
    if not by_role[DETECTIONS]:
        available = ", ".join(f"{name} ({kind})" for name, kind in sorted(topics.items()))
        of_sensor = f" in the namespace {sensor}" * bool(sensor)
        raise ValueError(
            f"the bag has no topic of detections{of_sensor}; it has {available or 'no topics'}"
        )
    return {role: topic for role, topic in by_role.items() if topic}


def bag_moving_frames(topics: Mapping[str, str]) -> str:
    """The topic of a bag with transforms that may move, by its type; empty if there is none."""
    return next(
        (
            topic
            for topic, kind in sorted(topics.items())
            if kind == TRANSFORMS and not _is_topic_called(topic, "tf_static")
        ),
        "",
    )


def _find_topic(topics: Mapping[str, str], role: str, given: str) -> str:
    types = {DETECTIONS: supported_types(), OWN_SHIP: (ODOMETRY,), LAND: (GRID,)}.get(
        role, (POINTS,)
    )
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
    named = _topic_candidates(topics, role, types)
    # First detections: images may be a camera's.
    named = named or _topic_candidates(topics, role, IMAGES if role == DETECTIONS else ())
    if len(named) > 1:
        raise ValueError(f"the bag has several topics for {role}: {', '.join(named)}")
    return named[0] if named else ""


def _topic_candidates(topics: Mapping[str, str], role: str, types: Collection[str]) -> list[str]:
    """Topics of some types with the role's name; of detections and own ship else all inputs."""
    candidates = [topic for topic, kind in sorted(topics.items()) if kind in types]
    named = [topic for topic in candidates if _is_topic_called(topic, role)]
    inputs = candidates if role in (DETECTIONS, OWN_SHIP) else []
    return named or [
        topic for topic in inputs if not any(_is_topic_called(topic, name) for name in _OUTPUTS)
    ]


def _is_topic_called(topic: str, name: str) -> bool:
    return f"/{topic}".endswith(f"/{name}")
