"""Seeded runs of a reproduction, stored in files so that it can be resumed."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from tsepm_ros.analysis.code_version import code_key
from tsepm_ros.analysis.run_files import RunFile, complete
from tsepm_ros.analysis.workers import Workers
from tsepm_ros.progress import Progress, silent

Result = dict[str, list[float]]
"""Result of a run: numbers by name."""
RunFunction = Callable[[Any, list[int]], Result]
"""Performs one run of a case, a dataclass, with a seed; importable by its name."""


@dataclass(frozen=True, kw_only=True)
class Setting:
    """Number, seeds, storage and workers of the runs.

    Attributes
    ----------
    folder : Path
        Folder of the stored runs.
    runs, seed : int
        Run i is seeded with (seed, i) on every worker.
    workers : Workers
    progress : callable
        Shows the progress of the missing runs.
    """

    folder: Path
    runs: int
    seed: int = 1
    workers: Workers = field(default_factory=Workers)
    progress: Progress = silent

    def results(self, function: RunFunction, cases: Sequence[Any]) -> list[list[Result]]:
        """Perform the runs of some cases that are not stored yet.

        Parameters
        ----------
        function : callable
        cases : sequence
            Dataclasses whose values determine a run, with its seed.

        Returns
        -------
        list of list of dict
            Per case its runs, in order.
        """
        files = [self._file(function, case) for case in cases]

        def results_of(missing: list[tuple[int, int]]) -> Iterator[Result]:
            jobs = [(function, cases[place], [self.seed, index]) for place, index in missing]
            return self.workers.mapped(_run, jobs)

        complete(files, self.runs, results_of, self.progress)
        return [[file.results[index] for index in range(self.runs)] for file in files]

    def _file(self, function: RunFunction, case: Any) -> RunFile:
        header = {
            "version": code_key(Path(inspect.getfile(function))),
            "function": function.__name__,
            "case": dataclasses.asdict(case),
            "seed": self.seed,
        }
        return RunFile(self.folder, [function.__name__], header)


def _run(job: tuple[RunFunction, Any, list[int]]) -> Result:
    function, case, seed = job
    return function(case, seed)


def column(runs: Sequence[Result], name: str, place: int) -> np.ndarray:
    """One number of every run, (runs,)."""
    return np.array([run[name][place] for run in runs], float)
