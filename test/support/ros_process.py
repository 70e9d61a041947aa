"""The package's executables as processes."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import pytest

DEADLINE = 20.0
"""Longest wait for a process to start, to say something or to end, s."""


def executable(name: str) -> str:
    found = shutil.which(name, path=str(Path(sys.executable).parent))
    assert found, f"{name} is not installed beside {sys.executable}"
    return found


class RosProcess:
    """A running executable, its output in a file.

    With `script`, Python code takes the executable's place.
    """

    def __init__(
        self,
        name: str,
        parameters: Mapping[str, object],
        domain: int,
        output: Path,
        *,
        script: str = "",
        arguments: Sequence[str] = (),
    ) -> None:
        self.name = name
        self._output = output
        command = [sys.executable, "-c", script] if script else [executable(name)]
        command += ["--ros-args", *arguments]
        for key, value in parameters.items():
            text = str(value).lower() if isinstance(value, bool) else str(value)
            command += ["-p", f"{key}:={text}"]
        # The whole environment: the guard variable of the wheels' interpreter and the library path
        # go together.
        environment = {
            **os.environ,
            "ROS_DOMAIN_ID": str(domain),
            "ROS_LOG_DIR": str(output.parent / "log"),
            "RCUTILS_LOGGING_USE_STDOUT": "0",
        }
        with output.open("wb") as file:
            self._process = subprocess.Popen(
                command, env=environment, stdin=subprocess.DEVNULL, stdout=file, stderr=file
            )

    def __enter__(self) -> RosProcess:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.wait()

    @property
    def said(self) -> str:
        """Everything that it has written to stdout and stderr."""
        return self._output.read_text(errors="replace")

    @property
    def running(self) -> bool:
        return self._process.poll() is None

    def until(self, condition: Callable[[], object], what: str) -> None:
        end = time.monotonic() + DEADLINE
        while not condition():
            if time.monotonic() > end or not self.running:
                pytest.fail(f"{self.name}: waited in vain for {what}; it said: {self.said}")
            time.sleep(0.005)

    def until_said(self, text: str) -> None:
        self.until(lambda: text in self.said, repr(text))

    def interrupt(self, number: signal.Signals = signal.SIGINT) -> None:
        self._process.send_signal(number)

    def wait_for(self, seconds: float) -> None:
        """Let it run for some time, or to its end."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(seconds)

    def exit_code(self) -> int:
        """Wait for its end."""
        try:
            return self._process.wait(DEADLINE)
        except subprocess.TimeoutExpired:
            pytest.fail(f"{self.name} does not end; it said: {self.said}")
