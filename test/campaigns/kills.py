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
"""Commands, or their workers, that are killed, or run out of disk, and commands started again.

What they leave under a result's name is that result, whole, as an undisturbed call writes it; the
same call again ends with 0 and the results of an undisturbed call, and no temporary file is left.
"""

import functools
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import campaign
import numpy as np
from campaign import Tried
from invariants import require
from support.bag_files import PARAMETERS, simulated, small_scenario, write_bag

WAIT = 300.0
CALLS = {
    "run": ["run", "{folder}/bag", "--out", "{out}", *(x for p in PARAMETERS for x in ("-p", p))],
    "run pages": ["run", "four_targets", "--html", "{out}/page.html", "--picture", "{out}/p.png"],
    "evaluate": [
        *("evaluate", "box", "--method", "heuristic", "--method", "tsepm", "--runs", "3"),
        *("--scans", "6", "--workers", "2", "--out", "{out}"),
    ],
    "reproduce": [
        "reproduce",
        "split_merge_2016",
        *("--runs", "2", "--workers", "1", "--out", "{out}"),
    ],
}
VOLATILE = (".png", ".svg")
"""Files that name the time of their making; they are read instead of compared."""


@functools.cache
def undisturbed(call: str) -> tuple[Path, float]:
    """Folder of the results of a call, and the time that it takes, s."""
    folder = Path(tempfile.mkdtemp(prefix="tsepm_whole_"))
    write_bag(folder / "bag", simulated(small_scenario(scans=30)), "mcap")
    (folder / "out").mkdir()
    begin = time.monotonic()
    code, error = _wait(_start(call, folder))
    require(code == 0, f"{call} fails undisturbed: {error}")
    return folder, time.monotonic() - begin


def _start(call: str, folder: Path, largest: int | None = None) -> subprocess.Popen[str]:
    """Start a call whose results go to the folder `out`."""

    def limit() -> None:
        if largest is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (largest, largest))

    words = [word.format(folder=folder, out="out") for word in CALLS[call]]
    return subprocess.Popen(
        [sys.executable, "-m", "tsepm_ros.tools.commands.cli", *words],
        cwd=folder,
        env={
            **os.environ,
            "PYTHONPATH": f"{campaign.ROOT}{os.pathsep}{os.environ.get('PYTHONPATH', '')}",
            "PYTHONDONTWRITEBYTECODE": "1",  # a compiled module that is cut would stay
        },
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=limit,
        start_new_session=True,
    )


def _workers(process: int) -> list[int]:
    """Processes that a process has started."""
    children = Path(f"/proc/{process}/task/{process}/children")
    return [*map(int, children.read_text().split())] if children.exists() else []


def _wait(process: subprocess.Popen[str]) -> tuple[int, str]:
    _, error = process.communicate(timeout=WAIT)
    return process.returncode, error


def content(path: Path) -> object:
    """What of a file must be equal."""
    data = path.read_bytes()
    if path.suffix in VOLATILE:
        return data[:8], data[-8:]
    if path.suffix == ".jsonl":
        return sorted(data.splitlines())
    return re.sub(rb"/tmp/tsepm_\w+", b"", data)


def check_whole(call: str, out: Path, *, complete: bool) -> None:
    """The results in a folder are those of the undisturbed call; all of them, if complete."""
    expected = undisturbed(call)[0] / "out"
    for path in out.rglob("*"):
        if path.is_dir() or ".part" in str(path.relative_to(out)):
            continue
        other = expected / path.relative_to(out)
        require(other.exists(), f"{call}: {path.name} is no result")
        if path.suffix == ".jsonl" and not complete:  # a line for each run, as it is done
            lines = path.read_bytes().rpartition(b"\n")[0].splitlines()
            require(set(lines) <= set(other.read_bytes().splitlines()), f"{call}: {path.name}")
            continue
        require(content(path) == content(other), f"{call}: {path.name} is not whole")
    if complete:
        names = [{path.relative_to(f) for path in f.rglob("*")} for f in (out, expected)]
        require(names[0] == names[1], f"{call}: {names[0] ^ names[1]} differ")


def case(number: int, rng: np.random.Generator) -> Tried:
    """A call that is killed once to three times, or that fills the disk, and is done at last."""
    call = list(CALLS)[number % len(CALLS)]
    original, seconds = undisturbed(call)
    full = number // len(CALLS) % 4 == 3
    tried: Tried = Counter()
    with tempfile.TemporaryDirectory(prefix="tsepm_killed_") as name:
        folder = Path(name)
        shutil.copytree(original / "bag", folder / "bag")
        (folder / "out").mkdir()
        if call == "evaluate" and number // len(CALLS) % 2:
            process = _start(call, folder)
            time.sleep(float(rng.uniform(0.3, 1.0) * seconds))
            for worker in _workers(process.pid)[: int(rng.integers(1, 3))]:
                os.kill(worker, signal.SIGKILL)
                tried["workers killed"] += 1
            code, error = _wait(process)
            require(code == 0, f"{call}, workers killed: code {code}, {error[-800:]}")
            check_whole(call, folder / "out", complete=True)
        elif full:
            sizes = [
                path.stat().st_size for path in (original / "out").rglob("*") if path.is_file()
            ]
            largest = int(rng.uniform(0, max(sizes)))
            code, error = _wait(_start(call, folder, largest))
            require(
                code in (0, 1, 2), f"{call}, full at {largest} bytes: code {code}, {error[-800:]}"
            )
            require("Traceback" not in error, f"{call}, full at {largest} bytes: {error[-2000:]}")
            check_whole(call, folder / "out", complete=code == 0)
            tried[f"{call}, full disk"] += 1
        else:
            for _ in range(int(rng.integers(1, 4))):
                process = _start(call, folder)
                time.sleep(float(rng.uniform(0.0, 1.1 * seconds)))
                os.kill(process.pid, signal.SIGKILL)
                _wait(process)
                check_whole(call, folder / "out", complete=False)
                tried[f"{call}, kills"] += 1
        code, error = _wait(_start(call, folder))
        require(code == 0, f"{call}, again: code {code}, {error[-800:]}")
        check_whole(call, folder / "out", complete=True)
    tried["calls"] += 1
    return tried


if __name__ == "__main__":
    sys.exit(campaign.main("kills", __doc__, case))
