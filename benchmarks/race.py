"""The race: all contenders on the same scans, each in its own process, in turn.

A contender waits while another one works, so none disturbs the other, and the times of one scan
are taken within moments of each other: their ratios hold where the machine's speed drifts.
"""

from __future__ import annotations

import pickle
import select
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from contenders import FloatArray, Hits, RawScan, Sea
from scenes import Scene

WORKER = Path(__file__).resolve().parent / "worker.py"
START_LIMIT = 120.0  # s, for the imports


@dataclass(frozen=True)
class Limits:
    """When a contender is stopped, s.

    Attributes
    ----------
    scan : float
        Time for one scan.
    total : float
        Time for all scans of a scene.
    """

    scan: float
    total: float


@dataclass
class Lane:
    """What one contender did in one scene; lists have an item per scan it finished.

    Attributes
    ----------
    seconds, cpu : list of float
        Wall and processor time, s.
    counts : list of dict
    hits : list of list of Hits
        Of the new tracks.
    states : list of (n, 4) ndarray or None
        Of the new tracks.
    memory, memory_at_start : float
        Peak resident memory of the process, MB; nan where the system does not tell.
    stopped : str
        Why it did not finish; empty if it did.
    """

    seconds: list[float] = field(default_factory=list)
    cpu: list[float] = field(default_factory=list)
    counts: list[dict[str, int]] = field(default_factory=list)
    hits: list[list[Hits]] = field(default_factory=list)
    states: list[FloatArray | None] = field(default_factory=list)
    memory: float = float("nan")
    memory_at_start: float = float("nan")
    stopped: str = ""


class Runner:
    """A contender's process, seen from outside.

    Parameters
    ----------
    name : str
        A name from `contenders.CONTENDERS`.
    sea : Sea
        The scene's figures.
    limits : Limits
        When to stop it.
    """

    def __init__(self, name: str, sea: Sea, limits: Limits) -> None:
        self.lane = Lane()
        self._limits = limits
        self._process = subprocess.Popen(
            [sys.executable, str(WORKER)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )
        answer = self._ask((name, sea), START_LIMIT)
        if answer is None:
            self._stop("did not start")
        elif "missing" in answer:
            self._stop(f"not installed: {answer['missing']}")
        self.lane.memory_at_start = self.lane.memory

    def step(self, scan: RawScan) -> None:
        """Let the contender process one scan, unless it was stopped."""
        if self.lane.stopped:
            return
        left = self._limits.total - sum(self.lane.seconds)
        answer = self._ask(scan, min(self._limits.scan, left))
        if answer is None:
            self._stop(self._reason(left))
            return
        self.lane.seconds.append(answer["seconds"])
        self.lane.cpu.append(answer["cpu"])
        self.lane.counts.append(answer["counts"])
        self.lane.hits.append(answer["hits"])
        self.lane.states.append(answer["states"])

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
            self.lane.memory = peak_memory(self._process.pid, self.lane.memory)
        return answer

    def _reason(self, left: float) -> str:
        scan = len(self.lane.seconds)
        if self._process.poll() is not None:
            return f"died in scan {scan}, exit code {self._process.returncode}"
        if left < self._limits.scan:
            return f"stopped in scan {scan}: over {self._limits.total:g} s in all"
        return f"stopped in scan {scan}: over {self._limits.scan:g} s for one scan"

    def _stop(self, reason: str) -> None:
        self.lane.stopped = reason
        self.close()


def peak_memory(process_id: int, otherwise: float) -> float:
    """Peak resident memory of a living process, MB (Linux).

    The system's count for the memory image, not for the process: that one would start at what the
    parent had when it forked.
    """
    try:
        status = Path(f"/proc/{process_id}/status").read_text(encoding="ascii")
    except OSError:
        return otherwise
    for line in status.splitlines():
        if line.startswith("VmHWM:"):
            return int(line.split()[1]) / 1024.0
    return otherwise


def run_race(scene: Scene, names: Sequence[str], limits: Limits, block: int = 1) -> dict[str, Lane]:
    """Let the named contenders process a scene in turn.

    Parameters
    ----------
    scene : Scene
        The scans.
    names : sequence of str
        Names from `contenders.CONTENDERS`. Who is first changes from scan to scan.
    limits : Limits
        When a contender is stopped.
    block : int
        Scans that a contender processes in a row before it is the next one's turn. With 1 the
        processor's caches are cold, as they are on a computer that does other things between two
        pings; with more they are warm, as in a study.

    Returns
    -------
    dict of str to Lane
        In the order of the names.
    """
    runners: dict[str, Runner] = {}
    try:
        for name in names:
            runners[name] = Runner(name, scene.sea, limits)
        for turn, begin in enumerate(range(0, len(scene.scans), block)):
            first = turn % len(names)
            for name in [*names[first:], *names[:first]]:
                for scan in scene.scans[begin : begin + block]:
                    runners[name].step(scan)
    finally:
        for runner in runners.values():
            runner.close()
    return {name: runner.lane for name, runner in runners.items()}
