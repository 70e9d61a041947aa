"""Whether half of the last scans, or of their detections, are lost; said with cause and remedy."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Mapping

from tsepm_ros.session.drop_reasons import EXPECTED, reason_of
from tsepm_ros.session.refusal import Notice

LAST, MIN_SCANS, MIN_DETECTIONS = 20, 5, 40
"""Scans over which losses are judged, and least number of scans, and of detections."""
CONSEQUENCES = "own_ship_missing", "own_ship_stale"
"""Reasons of scans whose own-ship data may have arrived and been dropped."""


def explained(reason: str, dropped: Mapping[str, int], sentences: Mapping[str, str]) -> str:
    """A drop reason with its first cause, in words, and the remedy of that.

    Parameters
    ----------
    reason : str
    dropped : mapping of str to int
        Drops by reason.
    sentences : mapping of str to str
        First sentence by reason.
    """
    poses = [name for name in dropped if reason_of(name).lost == "pose"]
    cause = max([reason, *poses], key=dropped.__getitem__) if reason in CONSEQUENCES else reason
    counted = "" if cause == reason else f" after {dropped[cause]} {cause}"
    sentence = sentences.get(cause) or reason_of(cause).meaning
    return f"{reason}{counted}: {sentence}. Remedy: {reason_of(cause).remedy}"


class Losses:
    """The fates of the last scans and of their detections."""

    def __init__(self) -> None:
        self._last: deque[tuple[str, int, Counter[str]]] = deque(maxlen=LAST)
        self._lost: Counter[str] = Counter()
        self._sentences: dict[str, str] = {}
        self._said: set[str] = set()

    def drop(self, reason: str, sentence: str, number: int, dropped: Counter[str]) -> list[Notice]:
        """Note a drop, with the drops so far; a notice if half of the last scans are lost."""
        self._sentences.setdefault(reason, sentence)
        described = reason_of(reason)
        if described.lost == "detection" and described.remedy != EXPECTED:
            self._lost[reason] += number
        if described.lost != "scan":
            return []
        self._last.extend([(reason, 0, Counter())] * min(number, LAST))
        return self._judge(dropped)

    def processed(self, detections: int, dropped: Counter[str]) -> list[Notice]:
        """Note a processed scan; a notice if half of the last scans' detections are lost."""
        self._last.append(("", detections, self._lost))
        self._lost = Counter()
        return self._judge(dropped)

    def _judge(self, dropped: Counter[str]) -> list[Notice]:
        names, numbers, losses = zip(*self._last, strict=True)
        scans, detections = Counter(filter(None, names)), sum(losses, Counter[str]())
        share = detections.total() / max(detections.total() + sum(numbers), MIN_DETECTIONS)
        said = []
        for reasons, half, lost in (
            (scans, 2 * scans.total() >= len(names), f"{scans.total()} of the last {len(names)}"),
            (detections, 2.0 * share >= 1.0, f"{100 * share:.0f} % of the detections of the last"),
        ):
            ((reason, number),) = reasons.most_common(1) or [("", 0)]
            if half and reason not in {*self._said, ""} and len(names) >= MIN_SCANS:
                self._said.add(reason)
                why = explained(reason, dropped, self._sentences)
                told = f"{lost} scans were dropped, {number} as {why}"
                said.append(Notice(f"lost {reason}", told))
        return said
