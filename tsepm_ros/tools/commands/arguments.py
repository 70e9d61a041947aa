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
"""What commands share: arguments, and the failure of a command whose arguments are allowed."""

from __future__ import annotations

import argparse
import os
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any


class CommandFailed(Exception):  # noqa: N818
    """A command failed for the reason in the message, which has the remedy."""


Arguments = Mapping[str, Mapping[str, Any]]
"""Options of `add_argument` by the name of an argument."""


def add_arguments(parser: argparse.ArgumentParser, arguments: Arguments) -> None:
    """Add the arguments of a table."""
    for name, options in arguments.items():
        parser.add_argument(name, **options)


def at_least_argument(minimum: int, text: str) -> int:
    """An integer from the command line that is not below a minimum."""
    if not text.strip().lstrip("+-").replace("_", "").isdecimal() or int(text) < minimum:
        raise argparse.ArgumentTypeError(f"must be at least {minimum}, in digits; got {text!r}")
    return int(text)


positive, seed = partial(at_least_argument, 1), partial(at_least_argument, 0)


def in_folder_argument(text: str) -> Path:
    """A path to write to, from the command line, in a folder that exists."""
    path = Path(text)
    if not path.parent.is_dir():
        raise argparse.ArgumentTypeError(f"the folder {path.parent} does not exist")
    return path


def add_runs_arguments(parser: argparse.ArgumentParser, runs: int, meaning: str = "runs") -> None:
    """Add the number of runs, the seed and the number of processes."""
    cores = os.cpu_count() or 1
    for name, kind, default, text in (
        ("--runs", positive, runs, f"{meaning}; default {runs}"),
        ("--seed", seed, 1, "seed of the runs; default 1"),
        ("--workers", positive, cores, "processes; default one per core"),
    ):
        parser.add_argument(name, type=kind, default=default, help=text)


def add_out_argument(parser: argparse.ArgumentParser, folder: str) -> None:
    """Add the folder of the results and of the runs done so far."""
    text = f"folder of the results and of the runs done so far; default {folder}"
    parser.add_argument("--out", type=Path, default=Path(folder), help=text)


def scenario_argument_names() -> str:
    """Names of the shipped scenarios, and the form of another one."""
    from tsepm_ros.tools.simulation import shipped_scenarios

    return f"{', '.join(shipped_scenarios())} or a .yaml file"
