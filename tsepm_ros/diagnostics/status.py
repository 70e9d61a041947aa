"""Levels and entries of the diagnostics."""

from __future__ import annotations

import enum
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field


class Level(enum.IntEnum):
    """Level of a status, numbered as in diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


@dataclass(frozen=True)
class Status:
    """Health of one task.

    Attributes
    ----------
    task : str
    level : Level
    message : str
        A sentence, or several with the worst first.
    values : dict of str to object
        Figures.
    """

    task: str
    level: Level
    message: str
    values: Mapping[str, object]


@dataclass(frozen=True)
class Latency:
    """Time that a scan took, s.

    Attributes
    ----------
    to_tracks, to_all : float
        From the entry of the callback that processed it until `tracks`, and until everything, was
        published.
    waiting : float
        Before that, for own-ship data.
    core : float
        The initiator's part.
    publishing : float
        Making and publishing messages.
    """

    to_tracks: float = 0.0
    to_all: float = 0.0
    waiting: float = 0.0
    core: float = 0.0
    publishing: float = 0.0

    @property
    def total(self) -> float:
        """From arrival until everything was published, s."""
        return self.waiting + self.to_all


@dataclass(frozen=True)
class Connections:
    """What the middleware tells.

    Attributes
    ----------
    subscribed : bool
        Whether a publisher of detections was found.
    unread : sequence of str
        Types other than that subscribed to as which the detections are published.
    mismatches_heard : mapping of str to int
        Events of qualities of service that do not fit, by topic.
    mismatches : sequence of str
        The topics on which there is such an endpoint now.
    unused_own_ship : str
        Topic on which own-ship data is published that is not listened to.
    """

    subscribed: bool = True
    unread: Sequence[str] = ()
    mismatches_heard: Mapping[str, int] = field(default_factory=dict)
    mismatches: Sequence[str] = ()
    unused_own_ship: str = ""


Finding = tuple[Level, str]
