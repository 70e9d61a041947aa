"""Invented summaries of runs for the tests."""

import dataclasses
import math
from collections.abc import Iterable

from tsepm_ros.tools.evaluation.measures import RunSummary, ScanSummary, StartSummary
from tsepm_ros.tools.evaluation.simulated_run import Outcome

NOTHING = ScanSummary(false=0, held=0, localisation=0.0, missed=0.0, false_held=0.0)


def start(scan: int, outcome: Outcome = Outcome.TRUE, **more) -> StartSummary:
    """A pure start with 12 s between scans and errors as large as their bounds."""
    summary = StartSummary(scan, 12.0 * scan, outcome, True, 30.0, 2.0, 4.0, 30.0, 2.0)
    if not more.get("pure", True):
        more = {"position_bound": math.nan, "velocity_bound": math.nan, **more}
    return dataclasses.replace(summary, **more)


def run_of(*starts: StartSummary, false=(0, 0, 0, 0), targets: int = 1, **more) -> RunSummary:
    """A run with so many false starts per scan."""
    scans = tuple(dataclasses.replace(NOTHING, false=number, **more) for number in false)
    return RunSummary(targets, starts, scans)


def as_json(summaries: Iterable[RunSummary]) -> list[dict]:
    """The summaries as JSON for comparison, since nan is not equal to itself."""
    return [summary.as_json() for summary in summaries]
