"""The command `tsepm reproduce`, and its sources.

TSEPM 2018: Table 1 and Figs. 5-8.

The sources that can be reproduced. A new source is a module here and a row in this table.

The command `tsepm reproduce`: arguments and written files.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass

import tsepm_ros
from tsepm_ros.studies.reproduction import (
    environment_2018,
    figures_5_to_8,
    sequential_2014,
    split_merge_2016,
    table_1,
)
from tsepm_ros.studies.reproduction.document import Part, write
from tsepm_ros.studies.reproduction.runs import Setting
from tsepm_ros.tools.commands.arguments import add_out, add_runs, workers_of
from tsepm_ros.tools.terminal import with_progress


def reproduce(setting: Setting) -> list[Part]:
    """Parts of the source's chapter."""
    return [*table_1.parts(setting), *figures_5_to_8.parts(setting)]


@dataclass(frozen=True)
class Source:
    """A publication.

    Attributes
    ----------
    title : str
    reproduce : callable
        Returns the parts of its chapter.
    """

    title: str
    reproduce: Callable[[Setting], list[Part]]


SOURCES = {
    "tsepm_2018": Source("TSEPM 2018", reproduce),
    "split_merge_2016": Source("Split-merge 2016", split_merge_2016.reproduce),
    "sequential_2014": Source("Sequential 2014", sequential_2014.reproduce),
    "environment_2018": Source("Environment 2018", environment_2018.reproduce),
}

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
