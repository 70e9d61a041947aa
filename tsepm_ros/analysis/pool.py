"""Work shared out to the processes of this machine."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import TypeVar

Job = TypeVar("Job")
Result = TypeVar("Result")


def mapped(
    function: Callable[[Job], Result], jobs: Sequence[Job], processes: int, chunk: int = 1
) -> Iterator[Result]:
    """Results of a function for each job, in their order.

    Parameters
    ----------
    function : callable
        Importable by its name.
    jobs : sequence
    processes : int
        1: this process.
    chunk : int, optional
        Jobs that are handed out together.
    """
    if processes == 1:
        yield from map(function, jobs)
        return
    # An interrupt from the terminal reaches all processes: this one ends the others.
    ignored = (signal.SIGINT, signal.SIG_IGN)
    with ProcessPoolExecutor(processes, initializer=signal.signal, initargs=ignored) as pool:
        yield from pool.map(function, jobs, chunksize=chunk)
