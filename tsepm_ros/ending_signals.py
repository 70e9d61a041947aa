"""Ends of a command by SIGINT and SIGTERM: by an exception, and not while processes start."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

INTERRUPTED = 130
"""Exit code of a process that was ended by an interrupt."""
TERMINATED = 143
"""Exit code of a process that was ended by SIGTERM."""
ENDING_SIGNALS = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def ending_on_termination() -> Iterator[None]:
    """End by an exception at SIGTERM: temporary files are removed, and other processes end."""

    def end(number: int, _: object) -> None:
        raise SystemExit(TERMINATED)

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


@contextmanager
def signals_held() -> Iterator[None]:
    """Hold SIGINT and SIGTERM back until the end of the block, which starts processes.

    The exception of a signal handler is lost if it is raised in the functions that Python calls
    around a fork, and elsewhere would leave a process behind that nobody ends. A forked process
    inherits the handler until it sets its own.
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # the main thread alone runs handlers
        return
    held: list[int] = []
    before = [
        signal.signal(number, lambda number, _: held.append(number)) for number in ENDING_SIGNALS
    ]
    try:
        yield
    finally:
        for number, handler in zip(ENDING_SIGNALS, before, strict=True):
            signal.signal(number, handler)
        for arrived in held:
            signal.raise_signal(arrived)
