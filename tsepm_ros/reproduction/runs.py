"""Seeded runs of a reproduction, kept in files to which an interrupted one comes back."""

from __future__ import annotations

import hashlib
import inspect
import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tsepm_ros.analysis.operating_points import digest, package_version
from tsepm_ros.analysis.pool import mapped

Progress = Callable[[Iterable[Any], int], Iterable[Any]]
"""Passes an iterable through, given its length, and shows how far it is."""
Result = dict[str, list[float]]
"""What a run gave: some numbers by name."""
RunFunction = Callable[[Any, list[int]], Result]
"""Does one run of a case, a dataclass, with a seed; importable by its name."""

JUDGES = tuple(
    Path(__file__).parents[1] / name
    for name in (
        "analysis/truth.py",
        "reproduction/scene.py",
        "reproduction/published_tsepm_2018.py",
        "reproduction/published_split_merge_2016.py",
    )
)
"""Modules that decide what is counted, besides the one of the run's function."""


@dataclass(frozen=True, kw_only=True)
class Setting:
    """How much is done, and by whom.

    Attributes
    ----------
    folder : Path
        Where the runs are kept.
    runs, seed : int
        Run i is seeded with (seed, i), whoever does it.
    processes : int
    progress : callable
        Shows how many of the missing runs are done.
    """

    folder: Path
    runs: int
    seed: int = 1
    processes: int = 1
    progress: Progress = lambda runs, total: runs

    def results(self, function: RunFunction, cases: Sequence[Any]) -> list[list[Result]]:
        """Do the runs of some cases that are not in the folder yet.

        Parameters
        ----------
        function : callable
        cases : sequence
            Dataclasses whose text says all that a run depends on.

        Returns
        -------
        list of list of dict
            Per case its runs, in order.
        """
        self.folder.mkdir(parents=True, exist_ok=True)
        paths = [self._path(function, case) for case in cases]
        kept = [_read(path) for path in paths]
        missing = [
            (place, _Job(function, cases[place], self.seed, index))
            for place in range(len(cases))
            for index in range(self.runs)
            if index not in kept[place]
        ]
        done = mapped(_do, [job for _, job in missing], self.processes)
        for (place, job), result in zip(missing, self.progress(done, len(missing)), strict=True):
            kept[place][job.index] = result
            with paths[place].open("a", encoding="utf-8") as file:
                file.write(json.dumps([job.index, result]) + "\n")
        return [[runs[index] for index in range(self.runs)] for runs in kept]

    def _path(self, function: RunFunction, case: Any) -> Path:
        """File of a case's runs: another case, seed or version has another one."""
        code = digest([*JUDGES, Path(inspect.getfile(function))])
        with np.printoptions(threshold=10**6, precision=17):
            content = [package_version(), code, function.__name__, repr(case), self.seed]
        name = hashlib.sha256(json.dumps(content).encode()).hexdigest()[:12]
        return self.folder / f"{function.__name__}-{name}.jsonl"


@dataclass(frozen=True)
class _Job:
    function: RunFunction
    case: Any
    seed: int
    index: int


def _do(job: _Job) -> Result:
    return job.function(job.case, [job.seed, job.index])


def _read(path: Path) -> dict[int, Result]:
    return dict(_whole_lines(path)) if path.exists() else {}


def _whole_lines(path: Path) -> Iterator[tuple[int, Result]]:
    """The runs of a file; a last line that was cut off is removed from it."""
    content = path.read_bytes()
    whole = content[: content.rfind(b"\n") + 1]
    if len(whole) < len(content):
        path.write_bytes(whole)
    for line in whole.splitlines():
        index, result = json.loads(line)
        yield index, result


def column(runs: Sequence[Result], name: str, place: int) -> np.ndarray:
    """One number of every run, (runs,)."""
    return np.array([run[name][place] for run in runs], float)
