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
"""What every campaign shares: cases by number, a time limit, resumption, counts and findings.

A case depends on its number and on a generator seeded with (seed, number): it repeats alone.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
import time
import traceback
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
BUILD = ROOT / "build" / "campaigns"
for folder in (ROOT, ROOT / "test"):  # the package as it is here, and what its tests share
    if str(folder) not in sys.path:
        sys.path.insert(0, str(folder))

# Messages with values that cannot be sent are refused by rclpy's classes only if they are asked to.
os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"
for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[name] = "1"

# Nothing leaves this machine, and nothing is written to the home directory.
os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
os.environ.setdefault("ROS_LOG_DIR", str(BUILD / "ros_log"))
os.environ.setdefault("FASTRTPS_DEFAULT_PROFILES_FILE", str(ROOT / "test/support/fastdds.xml"))

from support.interrupts import heed_interrupts

from tsepm_ros.ending_signals import ending_on_termination
from tsepm_ros.whole_files import write_whole_text

SAVING_PERIOD = 5.0
"""Time between two writings of the state, s."""
MAX_FINDINGS = 100
"""Findings after which a campaign ends: one fault must not fill the disk."""

CASE_LIMIT = 300
"""Time of a case that is taken for a hang, s; a hundred times what it takes on a quiet machine."""

Tried = Counter[str]
Case = Callable[[int, np.random.Generator], Tried]


class Finding(Exception):
    """A requirement that does not hold."""


@dataclass
class State:
    """What a campaign has done: the number of the next case, counts by name, findings, time (s)."""

    following: int = 0
    tried: Counter[str] = field(default_factory=Counter)
    findings: list[str] = field(default_factory=list)
    seconds: float = 0.0

    @classmethod
    def of(cls, path: Path) -> State:
        """The state in a file, or a new one if there is no file."""
        if not path.exists():
            return cls()
        content = json.loads(path.read_text())
        return cls(**{**content, "tried": Counter(content["tried"])})

    def write(self, path: Path) -> None:
        """Write the state whole."""
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole_text(path, json.dumps(vars(self), indent=1) + "\n")


def main(
    name: str,
    description: str,
    case: Case,
    *,
    arguments: list[str] | None = None,
    folder: Path = BUILD,
) -> int:
    """Run cases of a campaign; 1 if it, or an earlier call that it continues, has findings."""
    options = _options(description, arguments)
    heed_interrupts()
    with ending_on_termination():  # a case ends the processes that it has started
        if options.case is not None:
            print(_listed(case(options.case, _generator(options.seed, options.case))))
            return 0
        return _all_cases(name, case, options, folder)


def _all_cases(name: str, case: Case, options: argparse.Namespace, folder: Path) -> int:
    """Run the cases that follow those of earlier calls, until the time or the cases end."""
    path = folder / f"{name}-{options.seed}.json"
    if options.fresh:
        path.unlink(missing_ok=True)
    state = State.of(path)
    begin = written = time.monotonic()
    before = state.seconds
    while (
        state.following < options.cases
        and len(state.findings) < MAX_FINDINGS
        and time.monotonic() - begin < options.seconds
    ):
        _one(case, options.seed, state, f"python test/campaigns/{name}.py")
        state.seconds = before + time.monotonic() - begin
        if time.monotonic() - written > SAVING_PERIOD:
            state.write(path)
            written = time.monotonic()
    state.write(path)
    print(f"{name}, seed {options.seed}: cases 0 to {state.following - 1} in {state.seconds:.0f} s")
    print(_listed(state.tried))
    print(f"{len(state.findings)} findings; {path}")
    return 1 if state.findings else 0


def _one(case: Case, seed: int, state: State, command: str) -> None:
    """Do the next case, and note what it tried or found."""
    number = state.following
    signal.signal(signal.SIGALRM, _too_long)
    signal.alarm(CASE_LIMIT)
    try:
        state.tried.update(case(number, _generator(seed, number)))
    except (KeyboardInterrupt, SystemExit):
        raise
    except BaseException as error:  # pytest's failures are no Exceptions
        where = "" if isinstance(error, Finding) else f"\n{traceback.format_exc(limit=-6)}"
        found = f"--seed {seed} --case {number}: {type(error).__name__}: {str(error)[:2000]}{where}"
        state.findings.append(found)
        print(f"FOUND, {command} {found}", flush=True)
    finally:
        signal.alarm(0)
    state.following += 1


def _too_long(*_: object) -> None:
    raise TimeoutError(f"the case takes more than {CASE_LIMIT} s")


def _generator(seed: int, number: int) -> np.random.Generator:
    return np.random.default_rng((seed, number))


def _listed(tried: Counter[str]) -> str:
    return "\n".join(f"  {number:>9} {what}" for what, number in sorted(tried.items()))


def _options(description: str, arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=60.0, help="no case begins after these")
    parser.add_argument("--cases", type=int, default=sys.maxsize, help="no case from this on")
    parser.add_argument("--case", type=int, help="only this case, and its traceback")
    parser.add_argument("--fresh", action="store_true", help="from case 0 again")
    return parser.parse_args(arguments)
