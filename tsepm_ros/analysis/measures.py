"""The figures of many runs, each with its 95 % interval."""

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
    """How a field is shown: its heading in tables and its number format."""
    return {"heading": heading, "spec": spec}


@dataclass(frozen=True, kw_only=True)
class Measures:
    """Figures of a method over the runs of a scenario.

    *Pure* starts are those of which every hit is one target's, redundant ones left out and
    misplaced ones not: without these the errors would be cut off at 3 sigma. GOSPA is that of the
    held tracks, over scans and runs; the three parts of its root mean square add up in squares.

    Attributes
    ----------
    runs, scans : int
    detection : Estimate
        P_D: share of (run, target) pairs with a true start by the end of the run.
    false_per_run, false_density, false_per_hour : Estimate
        False and misplaced starts per run, per scan and km^2 of coverage, and per hour.
    redundant_per_run : Estimate
    held : Estimate
        Share of targets within 3 sigma of which a track is held at the end.
    confirmation_time, confirmation_median, confirmation_95 : Estimate
        Time from the first scan to the true starts, s: mean, median and 95 % quantile.
    position_error, velocity_error : Estimate
        Root mean square over the true starts, m and m/s.
    pure_position_error, pure_velocity_error : Estimate
        The same over the pure starts.
    position_to_bound, velocity_to_bound : Estimate
        These over the root mean square of their Cramer-Rao bounds.
    nees, pure_nees : Estimate
        Mean over the true and over the pure starts; 4 is ideal.
    gospa_mean, gospa, gospa_localisation, gospa_missed, gospa_false : Estimate
        Mean, root mean square and its parts, m.
    """

    runs: int
    scans: int
    detection: Estimate = field(metadata=_shown("P_D", ".4f"))
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
        """A figure as a text in its format, a dash where there is none."""
        text = getattr(self, name).text(SPECS[name])
        return text if interval else text.partition(" ")[0]


HEADINGS = {
    one.name: one.metadata["heading"] for one in dataclasses.fields(Measures) if one.metadata
}
"""What each figure is called in a table."""
SPECS = {one.name: one.metadata["spec"] for one in dataclasses.fields(Measures) if one.metadata}


def measures_of(
    scenario: Scenario, records: Iterable[RunSummary], scans: int | None = None
) -> Measures:
    """Sum up runs.

    Parameters
    ----------
    scenario : Scenario
    records : iterable of RunRecord
    scans : int, optional
        Scans after which the runs end, if not the scenario's.
    """
    scans = scenario.scans if scans is None else scans
    records = [record.first(scans) for record in records]
    starts = [start for record in records for start in record.starts]
    true = [start for start in starts if start.outcome is Outcome.TRUE]
    pure = [start for start in starts if start.pure and start.outcome is not Outcome.REDUNDANT]
    return Measures(
        runs=len(records),
        scans=scans,
        **_counts(scenario, records, scans),
        **_times([start.time for start in true]),
        **_errors(true, pure),
        **_gospa(records),
    )


def _counts(scenario: Scenario, records: Sequence[RunSummary], scans: int) -> dict[str, Estimate]:
    false = mean_count([record.wrong for record in records])
    targets = sum(record.targets for record in records)
    held = [record.scans[-1].held for record in records]
    return {
        "detection": proportion(sum(record.count(Outcome.TRUE) for record in records), targets),
        "false_per_run": false,
        "false_density": false / (scans * scenario.area / 1e6),
        "false_per_hour": false.mapped(lambda v: v * SECONDS_PER_HOUR / (scans * scenario.period)),
        "redundant_per_run": mean_count([record.count(Outcome.REDUNDANT) for record in records]),
        "held": proportion(sum(held), targets) if min(held) >= 0 else Estimate.unknown(),
    }


def _times(times: Sequence[float]) -> dict[str, Estimate]:
    return {
        "confirmation_time": mean(times),
        "confirmation_median": quantile(times, 0.5),
        "confirmation_95": quantile(times, 0.95),
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


def _gospa(records: Sequence[RunSummary]) -> dict[str, Estimate]:
    """Means over the scans of each run, then over the runs."""
    parts = np.array(
        [
            [[scan.localisation, scan.missed, scan.false_held] for scan in record.scans]
            for record in records
        ]
    )  # (run, scan, part)
    square = parts.sum(axis=-1)
    names = ("gospa_localisation", "gospa_missed", "gospa_false")
    return {
        "gospa_mean": mean(np.sqrt(square).mean(axis=1)),
        "gospa": root(mean(square.mean(axis=1))),
        **{name: root(mean(parts[..., k].mean(axis=1))) for k, name in enumerate(names)},
    }
