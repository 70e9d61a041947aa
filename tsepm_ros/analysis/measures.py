"""Measures of a method over many runs, each with its 95 % interval."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from tsepm_ros.analysis.intervals import (
    Estimate,
    mean,
    mean_count,
    proportion,
    quantile,
    rms_ratio,
    root,
    root_mean_square,
)
from tsepm_ros.analysis.run_summary import RunSummary, StartSummary
from tsepm_ros.analysis.truth import Outcome
from tsepm_ros.simulation import Scenario

SECONDS_PER_HOUR = 3600.0


def _shown(heading: str, spec: str) -> dict[str, str]:
    """Metadata of a field: its heading in tables and its number format."""
    return {"heading": heading, "spec": spec}


@dataclass(frozen=True, kw_only=True)
class Measures:
    """Measures of a method over the runs of a scenario.

    *Pure* starts have all hits from one target. Redundant starts are excluded; misplaced starts
    are included, since without them the errors would be cut off at 3 sigma. GOSPA is that of the
    held tracks, over scans and runs; the three parts of its root mean square add up in squares.

    Attributes
    ----------
    runs, scans : int
    detection : Estimate
        P_D: share of (run, target) pairs with a true start by the end of the run.
    detection_by_position : Estimate
        Share of pairs with a start within 3 sigma of the target, whatever its hits.
    detection_corrected : Estimate
        Share of pairs with a true start, or a start that a correction made true. All other measures
        are of starts as first published.
    corrections_per_run : Estimate
    false_per_run, false_density, false_per_hour : Estimate
        False and misplaced starts: per run, per scan and km^2 of coverage, and per hour.
    redundant_per_run : Estimate
    held : Estimate
        Share of targets with a held track within 3 sigma at the end.
    confirmation_time, confirmation_median, confirmation_95 : Estimate
        Time from the first scan to the true starts, s: mean, median and 95 % quantile.
    position_error, velocity_error : Estimate
        Root mean square over the true starts, m and m/s.
    pure_position_error, pure_velocity_error : Estimate
        Root mean square over the pure starts, m and m/s.
    position_to_bound, velocity_to_bound : Estimate
        Errors of the pure starts over the root mean square of their Cramer-Rao bounds.
    nees, pure_nees : Estimate
        Mean over the true and over the pure starts; 4 is ideal.
    gospa_mean, gospa, gospa_localisation, gospa_missed, gospa_false : Estimate
        Mean, root mean square and the parts of the latter, m.
    """

    runs: int
    scans: int
    detection: Estimate = field(metadata=_shown("P_D", ".4f"))
    detection_by_position: Estimate = field(metadata=_shown("P_D by position", ".4f"))
    detection_corrected: Estimate = field(metadata=_shown("P_D with corrections", ".4f"))
    corrections_per_run: Estimate = field(metadata=_shown("corrections per run", ".2f"))
    false_per_run: Estimate = field(metadata=_shown("false + misplaced per run", ".2f"))
    false_density: Estimate = field(metadata=_shown("false + misplaced per scan and km^2", ".3g"))
    false_per_hour: Estimate = field(metadata=_shown("false + misplaced per hour", ".1f"))
    redundant_per_run: Estimate = field(metadata=_shown("redundant per run", ".2f"))
    held: Estimate = field(metadata=_shown("targets held at the end", ".4f"))
    confirmation_time: Estimate = field(metadata=_shown("time to confirm, mean [s]", ".1f"))
    confirmation_median: Estimate = field(metadata=_shown("time to confirm, median [s]", ".0f"))
    confirmation_95: Estimate = field(metadata=_shown("time to confirm, 95 % quantile [s]", ".0f"))
    position_error: Estimate = field(metadata=_shown("position error, RMS [m]", ".1f"))
    velocity_error: Estimate = field(metadata=_shown("velocity error, RMS [m/s]", ".2f"))
    pure_position_error: Estimate = field(
        metadata=_shown("position error of pure starts, RMS [m]", ".1f")
    )
    pure_velocity_error: Estimate = field(
        metadata=_shown("velocity error of pure starts, RMS [m/s]", ".2f")
    )
    position_to_bound: Estimate = field(metadata=_shown("position error / Cramer-Rao bound", ".3f"))
    velocity_to_bound: Estimate = field(metadata=_shown("velocity error / Cramer-Rao bound", ".3f"))
    nees: Estimate = field(metadata=_shown("NEES of true starts (ideal 4)", ".2f"))
    pure_nees: Estimate = field(metadata=_shown("NEES of pure starts (ideal 4)", ".2f"))
    gospa_mean: Estimate = field(metadata=_shown("GOSPA, mean [m]", ".0f"))
    gospa: Estimate = field(metadata=_shown("GOSPA, RMS [m]", ".0f"))
    gospa_localisation: Estimate = field(metadata=_shown("of it localisation [m]", ".0f"))
    gospa_missed: Estimate = field(metadata=_shown("of it missed [m]", ".0f"))
    gospa_false: Estimate = field(metadata=_shown("of it false [m]", ".0f"))

    def text(self, name: str, *, interval: bool = True) -> str:
        """A measure as text in its format, or a dash without a value."""
        text = getattr(self, name).text(SPECS[name])
        return text if interval else text.partition(" ")[0]


HEADINGS, SPECS = (
    {part.name: part.metadata[key] for part in dataclasses.fields(Measures) if part.metadata}
    for key in ("heading", "spec")
)
"""Heading and number format of each measure."""


def measures_of(
    scenario: Scenario, runs: Iterable[RunSummary], scans: int | None = None
) -> Measures:
    """Measures of a method over runs.

    Parameters
    ----------
    scenario : Scenario
    runs : iterable of RunSummary
    scans : int, optional
        Number of scans after which the runs end; the scenario's if not given.
    """
    scans = scenario.scans if scans is None else scans
    runs = [run.first(scans) for run in runs]
    starts = [start for run in runs for start in run.starts]
    true = [start for start in starts if start.outcome is Outcome.TRUE]
    pure = [start for start in starts if start.pure and start.outcome is not Outcome.REDUNDANT]
    times = [start.time for start in true]
    return Measures(
        runs=len(runs),
        scans=scans,
        **_counts(scenario, runs, scans),
        confirmation_time=mean(times),
        confirmation_median=quantile(times, 0.5),
        confirmation_95=quantile(times, 0.95),
        **_errors(true, pure),
        **_gospa(runs),
    )


def _counts(scenario: Scenario, runs: Sequence[RunSummary], scans: int) -> dict[str, Estimate]:
    false = mean_count([run.wrong for run in runs])
    targets = sum(run.targets for run in runs)
    held = [run.scans[-1].held for run in runs]
    corrections = [sum(scan.corrections for scan in run.scans) for run in runs]
    return {
        "detection": proportion(sum(run.count(Outcome.TRUE) for run in runs), targets),
        "detection_by_position": proportion(sum(run.scans[-1].at for run in runs), targets),
        "detection_corrected": proportion(sum(run.scans[-1].right for run in runs), targets),
        "corrections_per_run": mean_count(corrections),
        "false_per_run": false,
        "false_density": false / (scans * scenario.area / 1e6),
        "false_per_hour": false.mapped(lambda v: v * SECONDS_PER_HOUR / (scans * scenario.period)),
        "redundant_per_run": mean_count([run.count(Outcome.REDUNDANT) for run in runs]),
        "held": proportion(sum(held), targets) if min(held) >= 0 else Estimate.unknown(),
    }


def _errors(true: Sequence[StartSummary], pure: Sequence[StartSummary]) -> dict[str, Estimate]:
    bounded = [start for start in pure if not math.isnan(start.position_bound)]
    return {
        "position_error": root_mean_square([start.position_error for start in true]),
        "velocity_error": root_mean_square([start.velocity_error for start in true]),
        "pure_position_error": root_mean_square([start.position_error for start in pure]),
        "pure_velocity_error": root_mean_square([start.velocity_error for start in pure]),
        "position_to_bound": rms_ratio(
            [start.position_error for start in bounded],
            [start.position_bound for start in bounded],
        ),
        "velocity_to_bound": rms_ratio(
            [start.velocity_error for start in bounded],
            [start.velocity_bound for start in bounded],
        ),
        "nees": mean([start.nees for start in true]),
        "pure_nees": mean([start.nees for start in pure]),
    }


def _gospa(runs: Sequence[RunSummary]) -> dict[str, Estimate]:
    """Means over the scans of each run, then over the runs."""
    parts = np.array(
        [[[scan.localisation, scan.missed, scan.false_held] for scan in run.scans] for run in runs]
    )  # (run, scan, part)
    square = parts.sum(axis=-1)
    names = ("gospa_localisation", "gospa_missed", "gospa_false")
    return {
        "gospa_mean": mean(np.sqrt(square).mean(axis=1)),
        "gospa": root(mean(square.mean(axis=1))),
        **{name: root(mean(parts[..., k].mean(axis=1))) for k, name in enumerate(names)},
    }
