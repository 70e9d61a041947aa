"""SIGINT where a shell runs its jobs in the background, which ignore it."""

import signal
import threading


def heed_interrupts() -> None:
    """Undo that SIGINT is ignored: processes that are interrupted later inherit it from this."""
    if (
        signal.getsignal(signal.SIGINT) is signal.SIG_IGN
        and threading.current_thread() is threading.main_thread()
    ):
        signal.signal(signal.SIGINT, signal.default_int_handler)
