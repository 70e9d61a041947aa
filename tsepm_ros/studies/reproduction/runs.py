"""Seeded runs of a reproduction, and their paired comparison.

Seeded runs of a reproduction, stored in files so that it can be resumed.

Ratios and differences over paired runs, and verdicts on published claims.
"""

from __future__ import annotations

import dataclasses
import inspect
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.tools.evaluation.intervals import Z_95, Estimate, mean
from tsepm_ros.tools.evaluation.result_files import RunFile, code_key, complete
from tsepm_ros.tools.evaluation.workers import Workers
from tsepm_ros.tools.terminal import Progress, silent

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


MAX_MEAN_WITHOUT_EVENT = -math.log(0.025)
"""Upper bound of a Poisson mean without an event, of the two-sided 95 % interval."""
HOLDS, FAILS, OPEN = "holds", "does not hold", "undecided"


def ratio(part: ArrayLike, whole: ArrayLike) -> Estimate:
    """Ratio of two sums of counts over independent runs, with the interval of the delta method."""
    value, influence = _linear(part, whole)
    if value == 0.0:  # Garwood's bound of no event
        return Estimate(0.0, 0.0, MAX_MEAN_WITHOUT_EVENT / float(np.sum(whole)))
    estimate = _around(value, influence)
    return Estimate(value, max(estimate.low, 0.0), estimate.high)


def ratio_difference(
    one: tuple[ArrayLike, ArrayLike], other: tuple[ArrayLike, ArrayLike]
) -> Estimate:
    """Difference of two ratios, `one` minus `other`, over the same runs."""
    first, influence = _linear(*one)
    second, other_influence = _linear(*other)
    return _around(first - second, influence - other_influence)


def _linear(part: ArrayLike, whole: ArrayLike) -> tuple[float, FloatArray]:
    """Ratio of two sums, and the influence of each run on it."""
    a, b = np.asarray(part, float), np.asarray(whole, float)
    if not b.sum() > 0.0:
        return math.nan, np.zeros(len(b))
    value = float(a.sum() / b.sum())
    return value, (a - value * b) / b.mean()


def _around(value: float, influence: FloatArray) -> Estimate:
    half = math.nan
    if len(influence) > 1:
        half = Z_95 * float(influence.std(ddof=1)) / math.sqrt(len(influence))
    return Estimate(value, value - half, value + half)


def share_difference(one: ArrayLike, other: ArrayLike) -> Estimate:
    """Difference of two shares over the same runs, with Bonett and Price's interval.

    "Adjusted Wald confidence interval for a difference of binomial proportions based on paired
    data", J. Educ. Behav. Stat. 37(4), 2012: one run is added for each kind of difference,
    so that equal runs have an interval too.
    """
    first, second = np.asarray(one, bool), np.asarray(other, bool)
    n = len(first) + 2
    up = (np.count_nonzero(first & ~second) + 1) / n
    down = (np.count_nonzero(~first & second) + 1) / n
    half = Z_95 * math.sqrt((up + down - (up - down) ** 2) / n)
    value = float(first.mean() - second.mean())
    return Estimate(value, max(up - down - half, -1.0), min(up - down + half, 1.0))


def mean_difference(one: ArrayLike, other: ArrayLike) -> Estimate:
    """Difference of two means over the same runs."""
    return mean(np.asarray(one, float) - np.asarray(other, float))


def is_below(difference: Estimate) -> str:
    """Whether a difference is below 0, by its interval."""
    if difference.high < 0.0:
        return HOLDS
    return FAILS if difference.low > 0.0 else OPEN


def is_within(difference: Estimate, tolerance: float) -> str:
    """Whether the size of a difference is within a tolerance, by its interval."""
    if difference.low > -tolerance and difference.high < tolerance:
        return HOLDS
    return FAILS if difference.low > tolerance or difference.high < -tolerance else OPEN


def is_not_below(difference: Estimate, tolerance: float) -> str:
    """Whether a difference is not below 0 by more than a tolerance, by its interval."""
    if difference.low > -tolerance:
        return HOLDS
    return FAILS if difference.high < -tolerance else OPEN


def everywhere(verdicts: Sequence[str]) -> str:
    """Verdict on a claim for all points of a curve, with the number of points where it holds."""
    counts = {verdict: verdicts.count(verdict) for verdict in (FAILS, OPEN, HOLDS)}
    worst = next(verdict for verdict, count in counts.items() if count)
    if counts[worst] == len(verdicts):
        return worst
    return f"{worst} ({counts[HOLDS]} of {len(verdicts)} points hold)"
