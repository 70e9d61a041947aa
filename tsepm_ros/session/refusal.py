"""Refusals and notices, which the parts of a session return and the session reports."""

from __future__ import annotations

from typing import NamedTuple

FAILURES = (ArithmeticError, LookupError, MemoryError, ValueError)
"""Exceptions in the processing of a scan: the scan is dropped, and the next scan is processed."""


MAX_SENTENCE = 500
"""Characters of a reported sentence. The names in a message may be as long as the message."""
CUT = " ... "


def shortened(sentence: str) -> str:
    """A sentence without its middle if it is longer than `MAX_SENTENCE`."""
    if len(sentence) <= MAX_SENTENCE:
        return sentence
    end = (MAX_SENTENCE - len(CUT)) // 2
    return sentence[: MAX_SENTENCE - len(CUT) - end] + CUT + sentence[-end:]


class Refusal(NamedTuple):
    """A drop with its reason, which the session counts and reports.

    Attributes
    ----------
    reason : str
        A name of `drop_reasons.DROP_REASONS`.
    sentence : str
        Message for the log; empty where drops are expected, and only counted.
    number : int
        Number of drops.
    """

    reason: str
    sentence: str
    number: int = 1


class Notice(NamedTuple):
    """An event that is reported without a drop.

    Attributes
    ----------
    subject : str
        Kind of the notice.
    sentence : str
        Message for the log.
    """

    subject: str
    sentence: str


Remark = Refusal | Notice
