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

from support.patience import WAIT

BESIDE_INTERPRETER = Path(sys.executable).parent


def executable(name: str) -> str:
    """Where ROS has it, in lib/tsepm_ros, or else where pip puts it, beside the interpreter."""
    prefixes = filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep))
    places = [Path(prefix) / "lib" / "tsepm_ros" for prefix in prefixes]
    path = shutil.which(name, path=os.pathsep.join(map(str, [*places, BESIDE_INTERPRETER])))
    assert path, f"{name} is in none of {places}, nor in {BESIDE_INTERPRETER}"
    return path


class RosProcess:
    """A running executable, or a script (code, or the path of a file), its output in a file."""

    def __init__(
        self,
        name: str,
        parameters: Mapping[str, object],
        domain: int,
        output: Path,
        *,
        script: str | Path = "",
        arguments: Sequence[str] = (),
    ) -> None:
        self.name = name
        self.provokes = False  # internal errors; else one is a failure
        self._output = output
        if isinstance(script, Path):
            command = [sys.executable, str(script)]
        else:
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

    def __exit__(self, kind: object, *_: object) -> None:
        self._process.kill()
        self._process.wait()
        assert kind or self.provokes or "internal_error" not in self.said, self.said

    @property
    def said(self) -> str:
        """Everything that it has written to stdout and stderr."""
        return self._output.read_text(errors="replace")

    @property
    def running(self) -> bool:
        return self._process.poll() is None

    def until(self, condition: Callable[[], object], what: str) -> None:
        end = time.monotonic() + WAIT
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
            return self._process.wait(WAIT)
        except subprocess.TimeoutExpired:
            pytest.fail(f"{self.name} does not end; it said: {self.said}")
