"""Fill the pages' tables from the result files, check that they are, and renew the files.

    python docs/figures.py          fill the tables of README.md and docs/ from docs/results/, and
                                    write the pages that are made from the code
    python docs/figures.py check    fail if a page does not show its result files
    python docs/figures.py renew    run the commands of the stale result files, and fill

A table stands between `<!-- figures NAME -->` or `<!-- figures NAME.VIEW -->` and
`<!-- end of figures -->`; NAME is a file of docs/results/. A result file is stale if it was
measured with other golden outputs than those of test/golden/. Stale files fail the check of a
release only: where the changelog has nothing under "Unreleased".
"""

from __future__ import annotations

import argparse
import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from tsepm_ros.settings.parameter_files import as_page
from tsepm_ros.settings.settings import NODES
from tsepm_ros.tools import diagnostics_page
from tsepm_ros.tools.evaluation.result_files import Result, Row, goldens_digest, read_result
from tsepm_ros.tools.terminal import markdown_table
from tsepm_ros.whole_files import write_text

DOCS = Path(__file__).resolve().parent
ROOT = DOCS.parent
RESULTS = DOCS / "results"
PAGES = sorted([ROOT / "README.md", *DOCS.rglob("*.md")])
BLOCK = re.compile(
    r"(?P<begin><!-- figures (?P<name>[\w-]+)(?:\.(?P<view>[\w-]+))? -->\n)"
    r".*?(?P<end><!-- end of figures -->)",
    re.DOTALL,
)
UNRELEASED = re.compile(r"^## \[Unreleased\]\n(.*?)(?=^## )", re.MULTILINE | re.DOTALL)
BUILD = ROOT / "build" / "figures"
PICTURES = {
    "box": (BUILD / "box_operating_curve.png", DOCS / "pictures" / "operating_curve.png"),
}
"""Pictures that the command of a result file draws, and their places on the pages."""
FROM_CODE = {
    DOCS / "diagnostics.md": diagnostics_page.as_page,
    DOCS / "parameters.md": lambda: as_page(NODES),
}
"""Pages that are made from the code."""
RENEW = "python docs/figures.py renew"


def curve(result: Result, points: Sequence[str] = ()) -> str:
    """Operating points of an evaluation: pings, detection and false tracks side by side.

    Parameters
    ----------
    result : Result
    points : sequence of str, optional
        Methods and labels to show; all if empty.
    """
    horizons = sorted({row["scans"] for row in result.measures})
    rows = {
        scans: {
            f"`{row['method']}` {row['point']}": row
            for row in result.measures
            if row["scans"] == scans
        }
        for scans in horizons
    }
    header = ["method and setting"]
    for scans in horizons:
        header += [f"targets found in {scans} pings", "false tracks per hour"]
    lines = [
        [name, *(cell for scans in horizons for cell in _cells(rows[scans][name]))]
        for name in rows[horizons[0]]
        if not points or name in points
    ]
    return markdown_table(header, lines)


def _cells(row: Row) -> list[str]:
    return [_share(row["detection"]), _rate(row["false_per_hour"])]


def _share(estimate: Sequence[float]) -> str:
    value, low, high = (f"{100 * part:.0f}" for part in estimate)
    return f"{value} % ({low}-{high})"


def _rate(estimate: Sequence[float]) -> str:
    value, low, high = (f"{part:.2g}" if part < 10 else f"{part:.0f}" for part in estimate)
    return f"{value} ({low}-{high})"


def short_curve(result: Result) -> str:
    """The points of the README."""
    return curve(result, ["`score` 1/h", "`score` 10/h", "`score` 100/h", "`tsepm` 5/8"])


def with_peers(result: Result) -> str:
    """`score` beside other trackers, at comparable rates of false tracks."""
    rules = [f"`{peer}` {rule}" for peer in ("stonesoup", "norfair") for rule in ("6/8", "5/8")]
    targets = [f"`score` {rate}/h" for rate in (1, 10, 30, 100)]
    return curve(result, [*targets, *(f"`jipda` {share}" for share in (0.9, 0.7, 0.5)), *rules])


MEASURES = {
    "detection": ("targets with a true track", "{:.3f}"),
    "false_per_run": ("false and misplaced tracks per run", "{:.2f}"),
    "redundant_per_run": ("redundant tracks per run", "{:.2f}"),
    "nees": ("NEES of true tracks (ideal 4)", "{:.1f}"),
    "position_error": ("position error, RMS, m", "{:.0f}"),
    "velocity_error": ("velocity error, RMS, m/s", "{:.1f}"),
    "confirmation_time": ("time to a true track, mean, s", "{:.0f}"),
}
"""Measures of a comparison: their names and number formats."""


def compared(result: Result) -> str:
    """Measures of an evaluation after all its scans, a column for each point."""
    last = max(row["scans"] for row in result.measures)
    rows = [row for row in result.measures if row["scans"] == last]
    header = [f"after {last} pings", *(f"`{row['method']}`" for row in rows)]
    lines = []
    for name, (text, spec) in MEASURES.items():
        cells = [[spec.format(part) for part in row[name]] for row in rows]
        lines.append([text, *(f"{value} ({low} to {high})" for value, low, high in cells)])
    return markdown_table(header, lines)


def as_printed(result: Result) -> str:
    """The table that the command prints."""
    return markdown_table(result.header, result.rows)


VIEWS: dict[str, Callable[[Result], str]] = {
    "": as_printed,
    "curve": curve,
    "short-curve": short_curve,
    "compared": compared,
    "with-peers": with_peers,
}


def source(result: Result) -> str:
    """The line below a table: what was run, and with which version."""
    runs = f"{result.runs} runs, seed {result.seed}" if result.runs > 1 else f"seed {result.seed}"
    if any("(" in cell for row in result.rows for cell in row):
        runs += "; 95 % intervals in brackets"
    return f"`{result.command}`: {runs}. Version {result.version}."


def filled(text: str) -> str:
    """A page with its tables made from the result files.

    Raises
    ------
    ValueError
        If a table has no result file or no such view.
    """

    def table(block: re.Match[str]) -> str:
        name, view = block["name"], block["view"] or ""
        path = RESULTS / f"{name}.json"
        if not path.exists() or view not in VIEWS:
            raise ValueError(f"no {path.name} in docs/results, or no view {view!r}")
        result = read_result(path)
        body = f"{VIEWS[view](result)}\n\n{source(result)}\n"
        return f"{block['begin']}\n{body}\n{block['end']}"

    return BLOCK.sub(table, text)


def stale() -> list[Path]:
    """Result files that were measured with other golden outputs than these."""
    now = goldens_digest()
    return [path for path in sorted(RESULTS.glob("*.json")) if read_result(path).goldens != now]


def is_release() -> bool:
    """Whether this source tree is a release: all that changed stands under a version."""
    changes = UNRELEASED.search((ROOT / "CHANGELOG.md").read_text("utf-8"))
    return changes is not None and not changes[1].strip()


def made(page: Path) -> str:
    """What a page should be."""
    if page in FROM_CODE:
        return FROM_CODE[page]()
    return filled(page.read_text("utf-8"))


def unfilled() -> list[Path]:
    """Pages that are not what the result files and the code make of them."""
    return [page for page in PAGES if made(page) != page.read_text("utf-8")]


def problems() -> list[str]:
    """What is out of date, each with the command that mends it."""
    found = [
        f"{path.relative_to(ROOT)} was not measured with the outputs of this release: "
        f"{RENEW} {path.stem}"
        for path in (stale() if is_release() else [])
    ]
    return found + [
        f"{page.relative_to(ROOT)} is out of date: python docs/figures.py" for page in unfilled()
    ]


def fill() -> None:
    """Fill every page's tables."""
    for page in unfilled():
        write_text(page, made(page))
        print(f"filled: {page.relative_to(ROOT)}")


def renew(names: Sequence[str]) -> None:
    """Run the commands of the named result files, of all stale ones if none is named."""
    for path in [RESULTS / f"{name}.json" for name in names] or stale():
        command = read_result(path).command
        print(f"{path.stem}: {command}", flush=True)
        arguments = shlex.split(command)
        module = {"tsepm": ["-m", "tsepm_ros.tools.commands.cli"], "python": []}[arguments[0]]
        line = [sys.executable, *module, *arguments[1:], "--result", str(path)]
        if path.stem in PICTURES:
            line += ["--out", str(BUILD)]
        environment = os.environ | {"PYTHONPATH": str(ROOT)}  # this source tree, not another one
        subprocess.run(line, check=True, cwd=ROOT, env=environment, stdout=subprocess.DEVNULL)
        if path.stem in PICTURES:
            shutil.copyfile(*PICTURES[path.stem])
    fill()


def main(arguments: Sequence[str] | None = None) -> int:
    """Fill, check or renew."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("action", nargs="?", default="fill", choices=("fill", "check", "renew"))
    parser.add_argument("name", nargs="*", help="result files to renew; all stale ones if none")
    options = parser.parse_args(arguments)
    if options.action == "renew":
        renew(options.name)
    elif options.action == "fill":
        fill()
    for problem in (found := problems()):
        print(problem, file=sys.stderr)
    return 1 if found else 0


if __name__ == "__main__":
    raise SystemExit(main())
