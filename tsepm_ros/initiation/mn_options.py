"""The rule M/N as options: M hits within N scans confirm a track."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from tsepm_ros.parameters import check_group, parameter

MAX_HITS = 32
"""Maximum of M."""
MAX_WINDOW = 64
"""Maximum of N."""


def hits_option(
    default: int, *, minimum: int = 2, meaning: str = "Hits that confirm a track (M)"
) -> Any:
    """Make the option `min_hits` with a method's default and minimum."""
    return parameter(default, meaning, minimum=minimum, maximum=MAX_HITS)


def window_option(
    default: int,
    *,
    minimum: int = 2,
    meaning: str = "Scans within which the hits must occur, the first hit's included (N)",
) -> Any:
    """Make the option `window` with a method's default and minimum."""
    return parameter(default, meaning, minimum=minimum, maximum=MAX_WINDOW)


@dataclass(frozen=True, kw_only=True)
class MnOptions:
    """Options that every M/N method begins with.

    A method with another default defines `min_hits` or `window` again, by `hits_option` and
    `window_option`; their place in the table stays the first.

    Raises
    ------
    ValueError
        Naming the option whose value is not allowed, or if the window is shorter than the number
        of hits.
    """

    min_hits: int = hits_option(5)
    window: int = window_option(8)

    def __post_init__(self) -> None:
        check_group(self)
        if self.window < self.min_hits:
            raise ValueError(
                f"window must be at least min_hits; got {self.window} and {self.min_hits}"
            )
