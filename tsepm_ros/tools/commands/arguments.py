"""What commands share: arguments, and their failure.

The failure of a command whose arguments are allowed.

Arguments that several commands share.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from tsepm_ros.tools.evaluation.workers import Workers
from tsepm_ros.tools.simulation import shipped_scenarios


class CommandFailed(Exception):  # noqa: N818
    """A command failed for the reason in the message, which has the remedy."""


def positive(text: str) -> int:
    """An integer above 0, from the command line."""
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError("must be at least 1")
    return value


def seed(text: str) -> int:
    """A seed of random numbers, from the command line."""
    value = int(text)
    if value < 0:
        raise argparse.ArgumentTypeError("must be at least 0")
    return value


def in_folder(text: str) -> Path:
    """A path to write to, from the command line, in a folder that exists."""
    path = Path(text)
    if not path.parent.is_dir():
        raise argparse.ArgumentTypeError(f"the folder {path.parent} does not exist")
    return path


def add_runs(parser: argparse.ArgumentParser, runs: int, meaning: str = "runs") -> None:
    """Add the number of runs, the seed and the number of processes."""
    parser.add_argument("--runs", type=positive, default=runs, help=f"{meaning}; default {runs}")
    parser.add_argument("--seed", type=seed, default=1, help="seed of the runs; default 1")
    parser.add_argument(
        "--workers",
        type=positive,
        default=os.cpu_count() or 1,
        help="processes; default one per core",
    )


def workers_of(options: argparse.Namespace) -> Workers:
    """Workers of the runs, from `add_runs` and the option `scheduler`, if the command has it."""
    scheduler = getattr(options, "scheduler", None)
    return Workers(processes=options.workers, scheduler=scheduler)


def add_out(parser: argparse.ArgumentParser, folder: str) -> None:
    """Add the folder of the results and of the runs done so far."""
    text = f"folder of the results and of the runs done so far; default {folder}"
    parser.add_argument("--out", type=Path, default=Path(folder), help=text)


def scenario_names() -> str:
    """Names of the shipped scenarios, and the form of another one."""
    return f"{', '.join(shipped_scenarios())} or a .yaml file"
