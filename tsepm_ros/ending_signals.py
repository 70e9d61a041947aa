"""Ends of a command by SIGINT and SIGTERM: by an exception, and not while processes start.

The executables begin here, before the imports that take their time.
"""

import importlib
import signal
import sys
import threading
from collections.abc import Callable, Iterator
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
    """Hold SIGINT and SIGTERM back until the end of the block, which imports or starts processes.

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


def _executable(module: str, interrupted: int, terminated: int) -> Callable[[], int]:
    """The function of an executable: the `main` of a module, imported when it is called.

    A signal before the module has its own handlers ends the executable with the given code.
    """

    def main() -> int:
        signal.signal(signal.SIGTERM, lambda number, _: sys.exit(terminated))
        try:
            with signals_held():  # extension modules print tracebacks of what interrupts them
                imported = importlib.import_module(module)
            return imported.main()
        except KeyboardInterrupt:  # during the imports; afterwards the module has its own way
            print("interrupted", file=sys.stderr)
            return interrupted
        except ModuleNotFoundError as error:
            sys.exit(f"failed: {error}, which is needed: package.xml names its package")

    return main


tsepm = _executable("tsepm_ros.tools.commands.cli", INTERRUPTED, TERMINATED)
tsepm_demo = _executable("tsepm_ros.tools.demo", INTERRUPTED, TERMINATED)
track_initiator = _executable("tsepm_ros.nodes.track_initiator", 0, 0)
sonar_simulator = _executable("tsepm_ros.tools.players.sonar_simulator", 0, 0)
scan_player = _executable("tsepm_ros.tools.players.scan_player", 0, 0)
track_viewer = _executable("tsepm_ros.tools.viewer.track_viewer", 0, 0)
track_bridge = _executable("tsepm_ros.tools.bridge.track_bridge", 0, 0)
sonar_detector = _executable("tsepm_ros.nodes.sonar_detector", 0, 0)
