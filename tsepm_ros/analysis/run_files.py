"""Files of runs, with which an interrupted study continues.

A file is JSON lines: a header with what its runs depend on, then a line per run. Its name has a
digest of the header, so that other options, another seed or another version have other files.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tsepm_ros.progress import Progress, silent
from tsepm_ros.whole_files import write_text, written_whole


class RunFile:
    """The finished runs of a study.

    Parameters
    ----------
    folder : Path
        Folder of the file.
    names : sequence of str
        Parts of the file's name.
    header : mapping
        Everything that the runs depend on: numbers, texts, arrays, lists and mappings of these.

    Attributes
    ----------
    path : Path
    results : dict
        Result of each run, as JSON, by the run's index.

    Raises
    ------
    ValueError
        If the existing file has another header or is damaged before its last line.
    """

    def __init__(self, folder: Path, names: Sequence[str], header: Mapping[str, Any]) -> None:
        text = json.dumps(header, default=np.ndarray.tolist)
        code = hashlib.sha256(text.encode()).hexdigest()[:8]
        name = "-".join(re.sub(r"\W+", "_", part) for part in names)
        self.path = folder / f"{name}-{code}.jsonl"
        folder.mkdir(parents=True, exist_ok=True)
        lines = self._whole_lines()
        if not lines:
            write_text(self.path, text + "\n")
        elif self._parsed(lines[0]) != json.loads(text):
            raise ValueError(
                f"{self.path} was made by another version, method, options, scenario or seed"
            )
        self.results: dict[int, Any] = dict(map(self._run, lines[1:]))

    def append(self, index: int, result: Any) -> None:
        """Add a run and write it at once."""
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps([index, result]) + "\n")
        self.results[index] = result

    def _whole_lines(self) -> list[bytes]:
        """The file's lines; an incomplete last line is removed from the file."""
        if not self.path.exists():
            return []
        content = self.path.read_bytes()
        whole = content[: content.rfind(b"\n") + 1]
        if len(whole) < len(content):
            with written_whole(self.path) as temporary:
                temporary.write_bytes(whole)
        return whole.splitlines()

    def _parsed(self, line: bytes) -> Any:
        try:
            return json.loads(line)
        except (ValueError, RecursionError):
            raise self._damage(line) from None

    def _run(self, line: bytes) -> tuple[int, Any]:
        """The index and the result of a run."""
        run = self._parsed(line)
        if not isinstance(run, list) or len(run) != 2 or type(run[0]) is not int:
            raise self._damage(line)
        return run[0], run[1]

    def _damage(self, line: bytes) -> ValueError:
        return ValueError(
            f"{self.path} is damaged: {line[:40]!r} is not a run; remove the line or the file"
        )


def complete(
    files: Sequence[RunFile],
    runs: int,
    results_of: Callable[[list[tuple[int, int]]], Iterable[Any]],
    progress: Progress = silent,
) -> None:
    """Do the missing runs of each file.

    Parameters
    ----------
    files : sequence of RunFile
    runs : int
    results_of : callable
        Results of runs, in the order of the given pairs (index of the file, index of the run).
    progress : callable, optional
        Shows the number of missing runs that are done.
    """
    missing = [
        (row, index)
        for row, file in enumerate(files)
        for index in range(runs)
        if index not in file.results
    ]
    done = progress(results_of(missing), len(missing))
    for (row, index), result in zip(missing, done, strict=True):
        files[row].append(index, result)
