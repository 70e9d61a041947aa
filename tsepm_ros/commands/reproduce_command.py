"""The command `tsepm reproduce`: arguments and written files."""

from __future__ import annotations

import argparse

import tsepm_ros
from tsepm_ros.commands.arguments import add_out, add_runs, workers_of
from tsepm_ros.progress import with_progress
from tsepm_ros.reproduction.document import Part, write
from tsepm_ros.reproduction.runs import Setting
from tsepm_ros.reproduction.sources import SOURCES

RUNS = 300


def add_reproduction_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of a reproduction."""
    parser.add_argument(
        "source", nargs="*", metavar="SOURCE", help=f"{', '.join(SOURCES)}; default all"
    )
    add_runs(parser, RUNS)
    add_out(parser, "build/reproduction")


def run_reproduction(options: argparse.Namespace) -> None:
    """Regenerate the published results and write the report.

    Parameters
    ----------
    options : argparse.Namespace
        From `add_reproduction_arguments`, and `line`, the command line.

    Raises
    ------
    ValueError
        If a source is unknown.
    """
    names = list(dict.fromkeys(options.source or SOURCES))
    for name in names:
        if name not in SOURCES:
            raise ValueError(f"source must be one of {', '.join(SOURCES)}; got {name!r}")
    setting = Setting(
        folder=options.out / "runs",
        runs=options.runs,
        seed=options.seed,
        workers=workers_of(options),
        progress=with_progress,
    )
    parts: list[Part] = [
        "# Reproduction of the published results",
        f"`{options.line}`\n\n{options.runs} runs, seed {options.seed}, 95 % intervals, "
        f"tsepm_ros {tsepm_ros.__version__}.",
    ]
    for name in names:
        print(f"{name}: {SOURCES[name].title}", flush=True)
        parts += [f"## {SOURCES[name].title}", *SOURCES[name].reproduce(setting)]
    written = write(parts, options.out / "report.md")
    print("written: " + ", ".join(map(str, written)))
