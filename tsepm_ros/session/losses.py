"""Whether half of the last scans, or of their detections, are lost; said with cause and remedy."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Mapping

from tsepm_ros.session.drop_reasons import EXPECTED, reason_of
from tsepm_ros.session.refusal import Notice

LAST, MIN_SCANS, MIN_DETECTIONS = 20, 5, 20
"""Scans over which losses are judged, and least number of scans and of lost detections."""
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
    cause, counted = reason, ""
    if reason in CONSEQUENCES and poses:
        first = max(poses, key=dropped.__getitem__)
        if dropped[first] >= dropped[reason]:
            cause, counted = first, f" after {dropped[first]} {first}"
    described = reason_of(cause)
    sentence = sentences.get(cause) or described.meaning
    return f"{reason}{counted}: {sentence}. Remedy: {described.remedy}"


class Losses:
    """The fates of the last scans and of their detections."""

    def __init__(self) -> None:
        self._scans: deque[str] = deque(maxlen=LAST)
        self._detections: deque[tuple[int, Counter[str]]] = deque(maxlen=LAST)
        self._lost: Counter[str] = Counter()
        self._sentences: dict[str, str] = {}
        self._said: set[str] = set()

    def drop(self, reason: str, sentence: str, number: int, dropped: Counter[str]) -> list[Notice]:
        """Note a drop, with the drops so far; a notice if half of the last scans are lost."""
        self._sentences.setdefault(reason, sentence)
        lost = reason_of(reason).lost
        if lost == "detection" and reason_of(reason).remedy != EXPECTED:
            self._lost[reason] += number
        if lost != "scan":
            return []
        self._scans.extend([reason] * min(number, LAST))
        reasons = Counter(name for name in self._scans if name)
        if len(self._scans) < MIN_SCANS or 2 * reasons.total() < len(self._scans):
            return []
        scans = f"{reasons.total()} of the last {len(self._scans)} scans were dropped"
        return self._say(scans, reasons, dropped)

    def processed(self, detections: int, dropped: Counter[str]) -> list[Notice]:
        """Note a processed scan; a notice if half of the last scans' detections are lost."""
        self._scans.append("")
        self._detections.append((detections, self._lost))
        self._lost = Counter()
        reasons = sum((lost for _, lost in self._detections), Counter[str]())
        number = reasons.total()
        kept = sum(detections for detections, _ in self._detections)
        if number < max(MIN_DETECTIONS, kept) or len(self._detections) < MIN_SCANS:
            return []
        share = f"{100 * number / (number + kept):.0f} % of the detections"
        return self._say(f"{share} of the last scans were dropped", reasons, dropped)

    def _say(self, what: str, reasons: Counter[str], dropped: Counter[str]) -> list[Notice]:
        ((reason, number),) = reasons.most_common(1)
        if reason in self._said:
            return []
        self._said.add(reason)
        why = explained(reason, dropped, self._sentences)
        return [Notice(f"lost {reason}", f"{what}, {number} as {why}")]
