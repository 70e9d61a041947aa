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
"""Peer timing: all contenders on the same scans, each in its own process, in turn.

Only one contender works at a time, so contenders do not disturb each other. The times of a scan are
measured shortly after each other, so their ratios are robust to drifts of the machine's speed. Run
as a program, the module is a contender's process: scans on standard input, answers on standard
output.
"""

from __future__ import annotations

import os
import pickle
import select
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from contenders import Hits, RawScan, Sea, make_contender

from tsepm_ros.numerics.arrays import FloatArray

if TYPE_CHECKING:  # a contender's process needs no scenes
    from scenes import Scene

MAX_START_TIME = 120.0  # s, for the imports

Limits = tuple[float, float]
"""Time limits of a contender for one scan and for all scans of a scene, s."""


@dataclass
class PeerTimes:
    """Results of a contender in a scene; lists have an item per finished scan."""

    seconds: list[float] = field(default_factory=list)  # wall time
    cpu: list[float] = field(default_factory=list)
    counts: list[dict[str, int]] = field(default_factory=list)
    hits: list[list[Hits]] = field(default_factory=list)  # of each new track
    states: list[FloatArray | None] = field(default_factory=list)  # of the new tracks, (n, 4)
    memory: float = float("nan")  # peak, MB; nan if unknown
    memory_at_start: float = float("nan")
    stopped: str = ""  # reason for an early end; empty if finished


class PeerProcess:
    """The process of a named contender for the parameters of a scene."""

    def __init__(self, name: str, sea: Sea, limits: Limits) -> None:
        self.times = PeerTimes()
        self._limits = limits
        self._process = subprocess.Popen(
            [sys.executable, __file__], stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )
        answer = self._ask((name, sea), MAX_START_TIME)
        if answer is None:
            self._stop("did not start")
        elif "missing" in answer:
            self._stop(f"not installed: {answer['missing']}")
        self.times.memory_at_start = self.times.memory

    def step(self, scan: RawScan) -> None:
        """Process one scan unless the contender was stopped."""
        if self.times.stopped:
            return
        longest, total = self._limits
        left = total - sum(self.times.seconds)
        answer = self._ask(scan, min(longest, left))
        if answer is None:
            over = f"{total:g} s in all" if left < longest else f"{longest:g} s for one scan"
            number, code = len(self.times.seconds), self._process.poll()
            died = f"died in scan {number}, exit code {code}"
            self._stop(f"stopped in scan {number}: over {over}" if code is None else died)
            return
        for name, value in answer.items():
            getattr(self.times, name).append(value)

    def close(self) -> None:
        """End the process."""
        if self._process.poll() is None:
            self._process.kill()
        self._process.communicate()

    def _ask(self, message: object, timeout: float) -> dict[str, Any] | None:
        """Send a message and return the answer; None if there is none in time."""
        assert self._process.stdin is not None and self._process.stdout is not None
        try:
            pickle.dump(message, self._process.stdin)
            self._process.stdin.flush()
            if not select.select([self._process.stdout], [], [], timeout)[0]:
                return None
            answer: dict[str, Any] = pickle.load(self._process.stdout)
        except (EOFError, BrokenPipeError):
            return None
        finally:
            self.times.memory = peak_memory(self._process.pid, self.times.memory)
        return answer

    def _stop(self, reason: str) -> None:
        self.times.stopped = reason
        self.close()


def peak_memory(process_id: int, default: float) -> float:
    """Peak resident memory of a living process, MB (Linux).

    The count of the memory image (VmHWM). The count of the process would start at the parent's
    memory at the fork.
    """
    try:
        status = Path(f"/proc/{process_id}/status").read_text(encoding="ascii")
    except OSError:
        return default
    peaks = [line for line in status.splitlines() if line.startswith("VmHWM:")]
    return int(peaks[0].split()[1]) / 1024.0 if peaks else default


def time_peers(
    scene: Scene, names: Sequence[str], limits: Limits, block: int = 1
) -> dict[str, PeerTimes]:
    """Let the named contenders process a scene in turn; the first contender changes every turn.

    A turn has `block` scans. With 1 the processor's caches are cold, as on a computer with other
    work between two pings; with more they are warm, as in a study.
    """
    processes: dict[str, PeerProcess] = {}
    try:
        for name in names:
            processes[name] = PeerProcess(name, scene.sea, limits)
        for turn, begin in enumerate(range(0, len(scene.scans), block)):
            first = turn % len(names)
            for name in [*names[first:], *names[:first]]:
                for scan in scene.scans[begin : begin + block]:
                    processes[name].step(scan)
    finally:
        for process in processes.values():
            process.close()
    return {name: process.times for name, process in processes.items()}


def serve() -> None:
    """Make the contender named first on standard input, then process a scan per message."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # output of libraries must not mix with the answers

    def answer(**values: Any) -> None:
        pickle.dump(values, answers)
        answers.flush()

    name, sea = pickle.load(sys.stdin.buffer)
    try:
        contender = make_contender(name, sea)
    except ImportError as error:
        answer(missing=str(error))
        return
    answer()
    while (scan := pickle.load(sys.stdin.buffer)) is not None:
        cpu, begin = time.process_time(), time.perf_counter()
        new = contender.process(scan)
        seconds, cpu = time.perf_counter() - begin, time.process_time() - cpu
        counts = {"detections": len(scan), **contender.counts(), "confirmed": new}
        hits, states = contender.hits(), contender.states()
        answer(seconds=seconds, cpu=cpu, counts=counts, hits=hits, states=states)


if __name__ == "__main__":
    serve()
