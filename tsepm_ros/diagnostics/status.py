"""Levels and entries of the diagnostics."""

from __future__ import annotations

import enum
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple


class Level(enum.IntEnum):
    """Level of a status, numbered as in diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


class Finding(NamedTuple):
    """One problem and its level."""

    level: Level
    sentence: str


@dataclass(frozen=True)
class Status:
    """Health of one task.

    Attributes
    ----------
    task : str
    level : Level
    message : str
        One or several sentences, the worst first.
    values : dict of str to object
        Figures.
    """

    task: str
    level: Level
    message: str
    values: Mapping[str, object]


ORDER = (Level.OK, Level.WARN, Level.STALE, Level.ERROR)
"""From the best to the worst: stale is the absence of news, and less than an error."""
OVERALL = "overall"
"""Entry of the worst level, for scripts."""


def overall(statuses: Sequence[Status]) -> Status:
    """The status of all: the worst level, the entry that has it, and the level of each entry."""
    worst = max(statuses, key=lambda status: ORDER.index(status.level))
    message = f"{worst.task}: {worst.message}" if worst.level else "every entry is OK"
    return Status(
        OVERALL, worst.level, message, {status.task: status.level.name for status in statuses}
    )


def status_of(
    task: str, findings: Sequence[Finding], healthy: str, values: Mapping[str, object]
) -> Status:
    """Return the status of a task; `healthy` is the message without findings."""
    if not findings:
        return Status(task, Level.OK, healthy, values)
    worst_first = sorted(findings, key=lambda finding: -finding.level)
    message = "; ".join(finding.sentence for finding in worst_first)
    return Status(task, worst_first[0].level, message, values)
