"""Changes of a sonar that may raise P_D, and the P_D with each."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

from tsepm_ros.analysis.intervals import Estimate
from tsepm_ros.analysis.workers import Workers
from tsepm_ros.design.design_case import Case
from tsepm_ros.design.prediction import target_statistics
from tsepm_ros.design.search import Labelled, known_within, score_window
from tsepm_ros.methods.score.score_options import ScoreOptions

REMEDY_HALF_WIDTH = 0.09
"""Half the width of the interval of P_D at which the simulation of a change ends."""


def remedies(case: Case) -> list[tuple[str, Case]]:
    """Changes that may raise P_D, each with the changed case."""
    sensor = case.sensor

    def changed(**values: float) -> Case:
        return dataclasses.replace(case, sensor=dataclasses.replace(sensor, **values))

    range_errors = {
        name: 0.5 * getattr(sensor, name) for name in ("range_std", "range_std_fraction")
    }
    farthest = max(0.7 * sensor.max_range, 0.5 * (sensor.min_range + sensor.max_range))
    changes = [
        ("twice as many pings", dataclasses.replace(case, scans=2 * case.scans)),
        ("half the sector", changed(azimuth_max=sensor.azimuth_min + 0.5 * sensor.sector_width)),
        ("half the bearing error", changed(azimuth_std=0.5 * sensor.azimuth_std)),
        ("half the range error", changed(**range_errors)),
        ("half the clutter", changed(clutter_density=0.5 * sensor.clutter_density)),
    ]
    if case.target_range is None:
        changes.append((f"a range of {farthest:.0f} m", changed(max_range=farthest)))
    return changes


def remedied_detection(
    case: Case,
    score: ScoreOptions,
    *,
    given_window: bool,
    runs: int,
    seed: int,
    workers: Workers,
    progress: Labelled,
) -> Iterator[tuple[str, Estimate]]:
    """P_D of the method `score` with each change, and at a larger false-track rate.

    Parameters
    ----------
    case : Case
    score : ScoreOptions
    given_window : bool
        Whether the window of `score` is kept.
    runs, seed, workers, progress
        As in `candidates`; P_D is determined within `REMEDY_HALF_WIDTH`.
    """
    more = dataclasses.replace(score, false_tracks_per_hour=10.0 * score.false_tracks_per_hour)
    cases = [(text, changed, score) for text, changed in remedies(case)]
    cases.append(("ten times as many false tracks", case, more))
    jobs = [(changed, options, given_window, runs, seed) for _, changed, options in cases]
    found = progress("possible changes")(workers.mapped(_remedied, jobs), len(jobs))
    for (text, _, _), detection in zip(cases, found, strict=True):
        yield text, detection


def _remedied(job: tuple[Case, ScoreOptions, bool, int, int]) -> Estimate:
    """P_D of a changed case, by this process alone."""
    case, score, given_window, runs, seed = job
    window = score.window if given_window else score_window(case, score)
    options = {**dataclasses.asdict(case.common), **dataclasses.asdict(score), "window": window}
    return target_statistics(
        case,
        "score",
        options,
        runs=runs,
        seed=seed,
        enough=lambda found: known_within(found, REMEDY_HALF_WIDTH),
    ).detection
