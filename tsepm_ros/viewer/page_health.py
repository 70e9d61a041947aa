"""Health as the page shows it: levels, tasks and sentences of the diagnostics."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from tsepm_ros.diagnostics.entries import ENTRIES
from tsepm_ros.diagnostics.status import ORDER, Level
from tsepm_ros.session.drop_reasons import DETECTIONS, INITIATION, reason_of
from tsepm_ros.viewer.page_frames import Frame


def health_of_message(message: Any) -> Frame | None:
    """Read a message of ``/diagnostics``.

    Parameters
    ----------
    message : diagnostic_msgs.msg.DiagnosticArray

    Returns
    -------
    dict or None
        ``level``, 0 to 3, the worst of the ``entries`` with their ``task``, ``level``, ``message``
        and ``values``; None if the message is not a track initiator's.
    """
    entries = []
    for status in message.status:
        task = status.name.rpartition(": ")[2]
        if task in ENTRIES:
            level = status.level
            entries.append(
                _entry(
                    task,
                    level[0] if isinstance(level, bytes) else int(level),
                    status.message,
                    ((value.key, value.value) for value in status.values),
                )
            )
    return _health(entries) if entries else None


def health_of_run(scans: int, dropped: Mapping[str, int], notes: Iterable[str]) -> Frame:
    """Health of a finished run offline: what was dropped and noticed.

    Parameters
    ----------
    scans : int
        Number of processed scans.
    dropped : mapping of str to int
        Drops by reason.
    notes : iterable of str
        Other notices.
    """
    entries = [_entry(INITIATION, Level.OK, f"{scans} scans processed")]
    if not scans:
        entries = [_entry(INITIATION, Level.WARN, "no scan was processed")]
    for name, number in sorted(dropped.items()):
        reason = reason_of(name)
        lost = f"{number} {reason.lost}{'' if number == 1 else 's'} dropped"
        remedy = f". Remedy: {reason.remedy}" if reason.remedy else ""
        entries.append(_entry(reason.task, Level.WARN, f"{lost}: {reason.meaning or name}{remedy}"))
    entries += [_entry(DETECTIONS, Level.OK, note) for note in notes]
    return _health(entries)


def _entry(
    task: str, level: int, message: str, values: Iterable[tuple[str, str]] = ()
) -> dict[str, Any]:
    pairs = [[key, value] for key, value in values if value]
    return {"task": task, "level": int(level), "message": message, "values": pairs}


def _health(entries: list[dict[str, Any]]) -> Frame:
    worst = max((entry["level"] for entry in entries), key=ORDER.index)
    return {"level": worst, "entries": entries}
