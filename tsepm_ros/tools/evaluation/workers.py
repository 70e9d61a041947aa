"""Execution of runs by processes of this machine or by a scheduler's workers."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from typing import TypeVar

from tsepm_ros.ending_signals import signals_held

Job = TypeVar("Job")
Result = TypeVar("Result")

WATCH_PERIOD = 0.5
"""Time between a worker's checks of its parent, s."""


def _attach_to_parent() -> None:
    """Prepare a worker process, which ends with the process that started it.

    An interrupt from the terminal reaches all processes; the starting process ends the others. If
    it is killed, nobody does, so each worker watches it.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    threading.Thread(target=_end_with_parent, args=(os.getppid(),), daemon=True).start()


def _end_with_parent(process: int) -> None:
    """End this process once its parent, whose id is given, has ended."""
    parent = multiprocessing.parent_process()
    while os.getppid() == process and parent is not None and parent.is_alive():
        time.sleep(WATCH_PERIOD)
    os._exit(1)


@dataclass(frozen=True, kw_only=True)
class Workers:
    """Processes that do the runs.

    Attributes
    ----------
    processes : int
        Number of processes on this machine; 1 means this process alone.
    scheduler : str, optional
        Address of a `dask.distributed` scheduler whose workers do the runs instead. It needs the
        extra `distributed`.
    connect_time : float
        Time limit for the scheduler's answer, s.
    """

    processes: int = 1
    scheduler: str | None = None
    connect_time: float = 10.0

    def mapped(
        self, function: Callable[[Job], Result], jobs: Sequence[Job], chunk: int = 1
    ) -> Generator[Result, None, None]:
        """Results of a function for each job, in their order; closed early, no more are done.

        Parameters
        ----------
        function : callable
            A function that can be imported by its name.
        jobs : sequence
        chunk : int, optional
            Jobs per message to a process.

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
            pool = ProcessPoolExecutor(self.processes, initializer=_attach_to_parent)
            try:
                with signals_held():  # the first job starts the processes
                    results = pool.map(function, jobs, chunksize=chunk)
                yield from results
            finally:
                pool.shutdown(cancel_futures=True)

    def _distributed(
        self, function: Callable[[Job], Result], jobs: Sequence[Job], scheduler: str
    ) -> Iterator[Result]:
        """Do the jobs by a scheduler's workers; the jobs of a lost worker are repeated."""
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
