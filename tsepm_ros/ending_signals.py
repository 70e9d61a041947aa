# Copyright 2026 tsepm_ros developers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""Ends by SIGINT and SIGTERM: at once during imports, later by an exception, held at a fork.

The executables begin here, before the imports that take their time.
"""

import importlib
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any

INTERRUPTED = 130
"""Exit code of a process that was ended by an interrupt."""
TERMINATED = 143
"""Exit code of a process that was ended by SIGTERM."""
ENDING_SIGNALS = (signal.SIGINT, signal.SIGTERM)
Handler = Callable[[int, Any], Any]


@contextmanager
def handling_ending_signals(
    handler: Handler, numbers: Sequence[int] = ENDING_SIGNALS
) -> Iterator[None]:
    """Handle signals until the end of the block; in the main thread, which alone runs handlers."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = [signal.signal(number, handler) for number in numbers]
    try:
        yield
    finally:
        for number, handler_before in zip(numbers, before, strict=True):
            signal.signal(number, handler_before)


@contextmanager
def ending_on_termination() -> Iterator[None]:
    """End by an exception, also at SIGTERM: temporary files are removed, other processes end."""
    with (
        handling_ending_signals(lambda number, _: sys.exit(TERMINATED), [signal.SIGTERM]),
        handling_ending_signals(signal.default_int_handler, [signal.SIGINT]),
    ):
        yield


@contextmanager
def ending_signals_held() -> Iterator[None]:
    """Hold SIGINT and SIGTERM back until the end of the block, which starts processes.

    The exception of a signal handler is lost if it is raised in the functions that Python calls
    around a fork, and elsewhere would leave a process behind that nobody ends. A forked process
    inherits the handler until it sets its own.
    """
    held: list[int] = []
    try:
        with handling_ending_signals(lambda number, _: held.append(number)):
            yield
    finally:
        for arrived in held:
            signal.raise_signal(arrived)


def ends_at_once(interrupted: int = INTERRUPTED, terminated: int = TERMINATED) -> Handler:
    """A handler that ends the process with a code, for imports.

    Imports take seconds of a busy machine, and leave nothing to clean up. An exception would not
    do: extension modules print the traceback of an exception that interrupts them, or lose it.
    """

    def end(number: int, _: object) -> None:
        if number == signal.SIGINT:
            with suppress(OSError):
                os.write(2, b"interrupted\n")
        os._exit(interrupted if number == signal.SIGINT else terminated)

    return end


def _executable(module: str, interrupted: int, terminated: int) -> Callable[[], int]:
    """The function of an executable: the `main` of a module, imported when it is called.

    A signal before the module has its own handlers ends the executable with the given code.
    """

    def main() -> int:
        for number in ENDING_SIGNALS:
            signal.signal(number, ends_at_once(interrupted, terminated))
        # Threads of numpy's library wait for each other busily: that takes more time than it saves,
        # and takes it from all else.
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        try:
            imported = importlib.import_module(module)
        except ModuleNotFoundError as error:
            sys.exit(f"failed: {error}, which is needed: package.xml names its package")
        return int(imported.main())

    return main


tsepm = _executable("tsepm_ros.tools.commands.cli", INTERRUPTED, TERMINATED)
tsepm_demo = _executable("tsepm_ros.tools.demo", INTERRUPTED, TERMINATED)
track_initiator = _executable("tsepm_ros.nodes.track_initiator", 0, 0)
sonar_simulator = _executable("tsepm_ros.tools.players.sonar_simulator", 0, 0)
scan_player = _executable("tsepm_ros.tools.players.scan_player", 0, 0)
track_viewer = _executable("tsepm_ros.tools.viewer.track_viewer", 0, 0)
track_bridge = _executable("tsepm_ros.tools.bridge.track_bridge", 0, 0)
sonar_detector = _executable("tsepm_ros.nodes.sonar_detector", 0, 0)
