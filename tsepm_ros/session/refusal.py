"""What the rooms of a session tell it: why something is refused, and what else to report."""

from __future__ import annotations

from typing import NamedTuple

FAILURES = (ArithmeticError, LookupError, MemoryError, ValueError)
"""What a scan may bring about; it is lost then, and the next one is processed."""


class Refusal(NamedTuple):
    """Why something cannot be used: the session counts and reports it.

    Attributes
    ----------
    reason : str
        A name of `drop_reasons.DROP_REASONS`.
    sentence : str
        For people.
    number : int
        How many are dropped for it.
    """

    reason: str
    sentence: str
    number: int = 1


class Notice(NamedTuple):
    """Something that is reported, though nothing is dropped for it.

    Attributes
    ----------
    subject : str
        Notices of one subject are of one kind.
    sentence : str
        For people.
    """

    subject: str
    sentence: str


Remark = Refusal | Notice
