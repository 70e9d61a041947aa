"""Recorded messages in rosbag2 bags, sqlite3 or MCAP, read without ROS by the library rosbags."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from msg_adapters import MessageError, supported_types

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

_SUFFIXES = (".mcap", ".db3")


@dataclass(frozen=True)
class BagMessage:
    """A recorded message.

    Attributes
    ----------
    topic, type_name : str
    log_ns : int
        Time of reception, ns.
    data : bytes
        Serialised content, CDR.
    """

    topic: str
    type_name: str
    log_ns: int
    data: bytes


def is_bag(path: Path | str) -> bool:
    """Whether a path names a bag: its folder with metadata.yaml, or its .mcap or .db3 file."""
    path = Path(path)
    return (path / "metadata.yaml").is_file() or path.suffix in _SUFFIXES


class Bag:
    """A bag that is open for reading; closed at the end of its `with` block.

    The bag's own message definitions are used, else those of ROS 2 Jazzy.

    Parameters
    ----------
    path : path
        As for `is_bag`.

    Attributes
    ----------
    topics : dict of str to str
        Message types by topic.
    start_ns, end_ns : int
        Times of the first and last message, ns; equal if the bag has no messages.

    Raises
    ------
    ValueError
        If rosbags is not installed or the bag cannot be read.
    """

    def __init__(self, path: Path | str) -> None:
        self._path = Path(path)
        try:
            from rosbags.highlevel import AnyReader
            from rosbags.typesys import Stores, get_typestore
        except ImportError:
            raise ValueError(
                f"{path} is a bag, which requires the library rosbags; it is not installed: "
                "pip install rosbags (with Python from apt: docs/python_and_command_line.md)"
            ) from None
        self.start_ns = self.end_ns = 0
        self._open = ExitStack()
        with self._reading():
            store = get_typestore(Stores.ROS2_JAZZY)
            self._reader = AnyReader([self._path], default_typestore=store)
            self._reader.open()
            self._open.callback(self._reader.close)
            self.topics = {name: info.msgtype or "" for name, info in self._reader.topics.items()}
            if self._reader.message_count:
                # The reader's end is 1 ns after the last message.
                self.start_ns, self.end_ns = self._reader.start_time, self._reader.end_time - 1

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
        return int(self._reader.topics[topic].msgcount)

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
        connections = [c for c in self._reader.connections if c.topic in topics]
        if not connections:  # the reader would return all topics
            return
        with self._reading():
            for connection, log_ns, data in self._reader.messages(connections, start=start_ns):
                yield BagMessage(connection.topic, connection.msgtype, log_ns, bytes(data))

    def read(self, message: BagMessage) -> Any:
        """Return the content of a message, with the fields of its type as attributes.

        Raises
        ------
        MessageError
            If it is not a message of its type.
        """
        try:
            return self._reader.deserialize(message.data, message.type_name)
        except Exception as error:  # the parser raises errors of many kinds
            raise MessageError(
                "message_corrupt",
                f"a message on {message.topic} is not a valid {message.type_name}: {error}",
            ) from error

    @contextmanager
    def _reading(self) -> Iterator[None]:
        """Convert any exception of rosbags and its storage libraries to a ValueError."""
        try:
            yield
        except Exception as error:
            raise ValueError(
                f"the bag {self._path} cannot be read: {error or type(error).__name__}"
            ) from error


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
        if topics[topic] not in types:
            raise ValueError(
                f"{topic} has the type {topics[topic]}; the type of {role} must be "
                f"{' or '.join(types)}"
            )
        return topic
    candidates = [topic for topic, kind in sorted(topics.items()) if kind in types]
    named = [topic for topic in candidates if _is_called(topic, role)]
    if role in (DETECTIONS, OWN_SHIP) and not named:
        named = [
            topic for topic in candidates if not any(_is_called(topic, name) for name in _OUTPUTS)
        ]
    if len(named) > 1:
        raise ValueError(f"the bag has several topics for {role}: {', '.join(named)}")
    return named[0] if named else ""


def _is_called(topic: str, name: str) -> bool:
    return f"/{topic}".endswith(f"/{name}")
