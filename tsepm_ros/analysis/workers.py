"""Who does the runs, the processes of this machine or others, and how far they are."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from typing import Any, TypeVar

Job = TypeVar("Job")
Result = TypeVar("Result")

Progress = Callable[[Iterable[Any], int], Iterable[Any]]
"""Passes an iterable through, given its length, and shows how far it is."""


def silent(results: Iterable[Any], total: int) -> Iterable[Any]:
    """Show nothing."""
    return results


def with_progress(results: Iterable[Any], total: int) -> Iterable[Any]:
    """Show a progress bar where tqdm is installed and somebody is looking."""
    try:
        from tqdm import tqdm
    except ImportError:
        return results
    return tqdm(results, total=total, unit="run", disable=None)


@dataclass(frozen=True, kw_only=True)
class Workers:
    """Who does the runs.

    Attributes
    ----------
    processes : int
        Processes on this machine; 1: this one.
    scheduler : str, optional
        Address of a `dask.distributed` scheduler whose workers do the runs instead; needs the
        extra `distributed`.
    connect_time : float
        Time in which the scheduler must answer, s.
    """

    processes: int = 1
    scheduler: str | None = None
    connect_time: float = 10.0

    def mapped(
        self, function: Callable[[Job], Result], jobs: Sequence[Job], chunk: int = 1
    ) -> Iterator[Result]:
        """Results of a function for each job, in their order.

        Parameters
        ----------
        function : callable
            Importable by its name.
        jobs : sequence
        chunk : int, optional
            Jobs that are handed out to a process together.

        Raises
        ------
        ValueError
            If the scheduler cannot be reached.
        """
        if self.scheduler is not None:
            yield from self._distributed(function, jobs, self.scheduler)
        elif self.processes == 1:
            yield from map(function, jobs)
        else:
            # An interrupt from the terminal reaches all processes: this one ends the others.
            ignored = (signal.SIGINT, signal.SIG_IGN)
            with ProcessPoolExecutor(self.processes, None, signal.signal, ignored) as pool:
                yield from pool.map(function, jobs, chunksize=chunk)

    def _distributed(
        self, function: Callable[[Job], Result], jobs: Sequence[Job], scheduler: str
    ) -> Iterator[Result]:
        """Let the workers of a scheduler do the jobs; those of a lost worker are done again."""
        try:
            from distributed import Client
        except ImportError:
            raise ValueError(
                "a scheduler needs the package distributed, which is missing"
            ) from None
        try:
            client = Client(scheduler, timeout=self.connect_time)
        except OSError as error:
            raise ValueError(f"scheduler {scheduler} cannot be reached: {error}") from None
        with client:
            for future in client.map(function, jobs, pure=False):
                yield future.result()
