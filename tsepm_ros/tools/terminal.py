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
"""Terminal: progress of long work, and tables as text and in Markdown.

Every command shows its progress by these functions; nothing is shown in a pipe or a file.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Sequence
from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any, TextIO

try:
    from tqdm import tqdm
except ImportError:  # no bars then
    tqdm = None

Progress = Callable[[Iterable[Any], int], Iterable[Any]]
"""Passes an iterable of a given length through and shows its progress."""

MIN_UPDATE_TIME = 0.2
"""Minimum time between two updates of a bar, s."""


def silent_terminal(results: Iterable[Any], total: int) -> Iterable[Any]:
    """Pass the results through without showing progress."""
    return results


def terminal_progress_bar(
    total: int | None, label: str | None, unit: str, keep: bool = False
) -> Any:
    """A bar on the standard error, if that is a terminal and tqdm is installed.

    Parameters
    ----------
    total : int or None
        Number of steps; None if it is not known.
    label : str or None
    unit : str
        Name of a step.
    keep : bool, optional
        The finished bar stays on the terminal.
    """
    if tqdm is None:
        ignore = lambda *_, **__: None  # noqa: E731
        return nullcontext(SimpleNamespace(n=0, update=ignore, set_postfix_str=ignore))
    return tqdm(
        total=total,
        desc=label,
        unit=unit,
        leave=keep,
        disable=None,
        dynamic_ncols=True,
        mininterval=MIN_UPDATE_TIME,
    )


def terminal_progress(
    results: Iterable[Any], total: int | None, label: str | None = None, unit: str = "run"
) -> Iterable[Any]:
    """Pass the results through and show their number; a bar with a label is gone when it is done.

    Parameters
    ----------
    results : iterable
    total : int or None
        Number of results; None if it is not known.
    label : str, optional
        Name of the work.
    unit : str, optional
        Name of a result.
    """
    with terminal_progress_bar(total, label, unit, keep=label is None) as bar:
        for result in results:
            yield result
            bar.update()


def named_terminal_progress(label: str) -> Progress:
    """Progress of a part of the work by its name, as `terminal_progress`; gone when it is done."""
    return functools.partial(terminal_progress, label=label)


def write_terminal_line(text: str, file: TextIO) -> None:
    """Write a line at once, above the bars of the same terminal."""
    (print if tqdm is None else tqdm.write)(text, file=file)
    file.flush()


def terminal_table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Align the columns of a table, the first to the left and the others to the right."""
    lines = [list(header), *(list(row) for row in rows)]
    widths = [max(len(line[column]) for line in lines) for column in range(len(header))]
    texts = [
        "  ".join(
            cell.ljust(width) if column == 0 else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(line, widths, strict=True))
        ).rstrip()
        for line in lines
    ]
    return "\n".join([texts[0], "-" * len(texts[0]), *texts[1:]])


def terminal_markdown_table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Format a table in Markdown."""
    head, *lines = [f"| {' | '.join(line)} |" for line in (header, *rows)]
    return "\n".join([head, f"|{'---|' * len(header)}", *lines])
