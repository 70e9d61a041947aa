"""Arguments that several commands have."""

from __future__ import annotations

import argparse
import os
from pathlib import Path

from tsepm_ros.analysis.workers import Workers
from tsepm_ros.simulation import shipped_scenarios


def positive(text: str) -> int:
    """An integer above 0, from the command line."""
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError("must be at least 1")
    return value


def add_runs(parser: argparse.ArgumentParser, runs: int, what: str = "runs") -> None:
    """Add how many runs are done, with which seed, and by how many processes."""
    parser.add_argument("--runs", type=positive, default=runs, help=f"{what}; default {runs}")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--workers", type=positive, default=os.cpu_count() or 1, help="processes; default all"
    )


def workers_of(options: argparse.Namespace) -> Workers:
    """Who does the runs, from `add_runs` and a scheduler where the command has one."""
    scheduler = getattr(options, "scheduler", None)
    return Workers(processes=options.workers, scheduler=scheduler)


def add_values(
    parser: argparse.ArgumentParser,
    *names: str,
    help: str = "parameter as of the node track_initiator",
) -> None:
    """Add an argument that gives a value to a name, and may be repeated; -p if not named."""
    names = names or ("-p", "--parameter")
    parser.add_argument(*names, action="append", default=[], metavar="NAME:=VALUE", help=help)


def add_out(parser: argparse.ArgumentParser, folder: str) -> None:
    """Add the folder of the runs done so far and of what is written."""
    text = f"folder of the runs done so far and of what is written; default {folder}"
    parser.add_argument("--out", type=Path, default=Path(folder), help=text)


def scenario_names() -> str:
    """What may be given as a scenario."""
    return f"{', '.join(shipped_scenarios())} or a .yaml file"
