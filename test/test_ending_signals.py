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
"""Ends by SIGINT and SIGTERM: held back while processes start, and an exception otherwise."""

import os
import re
import signal
import subprocess
import sys
import threading
import time
from contextlib import AbstractContextManager
from pathlib import Path
from types import ModuleType

import pytest

from tsepm_ros import ending_signals
from tsepm_ros.ending_signals import (
    ENDING_SIGNALS,
    INTERRUPTED,
    TERMINATED,
    ending_on_termination,
    ending_signals_held,
    ends_at_once,
    handling_ending_signals,
)

ROOT = Path(__file__).parents[1]


def handlers() -> list:
    return [signal.getsignal(number) for number in ENDING_SIGNALS]


@pytest.fixture
def arrived():
    """Signals that arrived at the handlers that were there before."""
    numbers: list[int] = []
    before = handlers()
    for number in ENDING_SIGNALS:
        signal.signal(number, lambda number, _: numbers.append(number))
    yield numbers
    for number, handler in zip(ENDING_SIGNALS, before, strict=True):
        signal.signal(number, handler)


def test_signals_that_are_held_arrive_after_the_block(arrived):
    before = handlers()
    with ending_signals_held():
        for number in ENDING_SIGNALS:
            signal.raise_signal(number)
        assert arrived == []
    assert arrived == list(ENDING_SIGNALS) and handlers() == before


def test_termination_is_an_exception_of_its_code_within_the_block(arrived):
    before = handlers()
    with pytest.raises(SystemExit) as end, ending_on_termination():
        signal.raise_signal(signal.SIGTERM)
    assert (end.value.code, arrived, handlers()) == (TERMINATED, [], before)


@pytest.mark.parametrize(
    "block",
    [ending_signals_held, ending_on_termination, lambda: handling_ending_signals(ends_at_once())],
)
def test_another_thread_leaves_the_handlers_as_they_are(block):
    before, seen = handlers(), []

    def run(context: AbstractContextManager) -> None:
        with context:
            seen.append(handlers())

    thread = threading.Thread(target=run, args=(block(),))
    thread.start()
    thread.join()
    assert seen == [before] and handlers() == before


def entry_points() -> dict[str, str]:
    found = re.findall(r'"(\w+) = ([\w.]+):(\w+)"', (ROOT / "setup.py").read_text())
    assert found and all(name == function for name, _, function in found)
    return {name: module for name, module, _ in found}


def test_what_colcon_installs_is_checked_for_every_executable():
    text = (ROOT / ".ci" / "check_installed.py").read_text(encoding="utf-8")
    (listed,) = re.findall(r"^EXECUTABLES = \[(.*?)\]", text, re.MULTILINE | re.DOTALL)
    assert set(re.findall(r'"(\w+)"', listed)) == set(entry_points())


@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("name", entry_points())
def test_a_signal_during_the_imports_ends_the_process_at_once_with_its_code(name, ending):
    """They begin at once: an interrupt of imports before would be a traceback of Python itself."""
    script = (
        f"import importlib, signal, sys; from {entry_points()[name]} import {name}; "
        "print(*{'numpy', 'scipy', 'rclpy', 'yaml'} & {*sys.modules}, end='', flush=True); "
        f"importlib.import_module = lambda module: (signal.raise_signal({int(ending)}), print(2)); "
        f"sys.exit({name}())"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=60
    )
    codes = {signal.SIGINT: INTERRUPTED, signal.SIGTERM: TERMINATED}
    assert done.returncode == (codes[ending] if name.startswith("tsepm") else 0)
    assert done.stdout == ""
    assert done.stderr == ("interrupted\n" if ending == signal.SIGINT else "")


IMPORTING = """
import sys
from tsepm_ros import ending_signals

class First:
    def find_spec(self, *of):
        sys.meta_path.remove(self)
        print(1, flush=True)

sys.meta_path.insert(0, First())
"""
"""Prints where the first import begins, with the handlers in place."""


def cpu_time(process: subprocess.Popen) -> float:
    """CPU time of a process that runs, s."""
    fields = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@pytest.mark.parametrize("delay", [0.05, 0.2])
@pytest.mark.parametrize("name", ["tsepm", "track_initiator"])
def test_an_executable_that_is_interrupted_in_its_imports_ends_at_once_without_a_traceback(
    name, delay
):
    script = IMPORTING + f"exit(ending_signals.{name}())"
    command = [sys.executable, "-c", script, *(["evaluate", "box"] if name == "tsepm" else [])]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    process.stdout.readline()
    time.sleep(delay)
    before = cpu_time(process)
    process.send_signal(signal.SIGINT)
    said = process.stderr.read()
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    assert process.returncode == (INTERRUPTED if name == "tsepm" else 0)
    assert "Traceback" not in said
    assert used.ru_utime + used.ru_stime - before <= 0.3


@pytest.mark.parametrize(("given", "threads"), [(None, 1), ("3", 3)])
def test_an_executable_computes_by_one_thread_unless_another_number_is_given(
    monkeypatch, given, threads
):
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", given or "")
    if given is None:
        monkeypatch.delenv("OPENBLAS_NUM_THREADS")
    module = ModuleType("an_executable")
    module.main = lambda: int(os.environ["OPENBLAS_NUM_THREADS"])
    monkeypatch.setitem(sys.modules, "an_executable", module)
    with ending_signals.handling_ending_signals(signal.default_int_handler):
        assert ending_signals._executable("an_executable", 0, 0)() == threads
