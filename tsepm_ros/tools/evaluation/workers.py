"""Execution of runs by processes of this machine."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Generator, Sequence
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
    """

    processes: int = 1

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
        """
        if self.processes == 1:
            yield from map(function, jobs)
        else:
            pool = ProcessPoolExecutor(self.processes, initializer=_attach_to_parent)
            try:
                with signals_held():  # the first job starts the processes
                    results = pool.map(function, jobs, chunksize=chunk)
                yield from results
            finally:
                pool.shutdown(cancel_futures=True)
