"""Effect of `plot_features`, with its encounter test, where association is hard.

Without and with `plot_features`, on scenes of the shipped scenario `encounter`:

- ships that meet: as published, overtaking at 20 m abeam with 1.5 m/s more, and on courses that
  cross at 23 degrees; plots with different features, the same features, or none. Tracks held by
  the method `score` before the encounter are kept, swapped, or lost: farther than 300 m from their
  ships afterwards, or one track for both;
- a ship in a clutter zone, held by `score`: its track is lost if another or no track is near the
  ship at the end; every held track but the nearest is false;
- starts in that zone by the methods that associate scan by scan: whether a track with most hits
  from the ship starts, and false starts per run.

With 95 % intervals.

    python benchmarks/encounters.py [--runs 100] [--workers 2]
"""

from __future__ import annotations

import argparse
import math
import os
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import fixed_threads  # noqa: F401  # before numpy
import numpy as np

from tsepm_ros import make_initiator
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.tools.commands.arguments import positive, workers_of
from tsepm_ros.tools.evaluation.intervals import mean, mean_count, proportion
from tsepm_ros.tools.evaluation.workers import Workers
from tsepm_ros.tools.simulation import SimulatedScan, Simulator, load_scenario
from tsepm_ros.tools.simulation.scenario import Scenario
from tsepm_ros.tools.terminal import text_table, with_progress
from tsepm_ros.tracker.tracks import TrackArrays

MAX_DISTANCE = 300.0
"""Maximum distance of a track from its ship, m."""
BEFORE = 63.0
"""Time before the encounters at which the tracks must exist, s."""
ZONE_LEFT = 240.0
"""Time at which the ship leaves the clutter zone, s."""
STARTERS = ("sequential", "logic", "heuristic", "multiple_model")
WITHOUT_AND_WITH = (False, True)


@dataclass(frozen=True)
class Job:
    """One run."""

    scenario: Scenario
    method: str
    options: dict[str, Any]
    seed: int


def encounters() -> dict[str, Scenario]:
    """The scenes in which two ships meet, by name."""
    base = load_scenario("encounter")
    sector = replace(base.sensor, azimuth_min=-2.1, azimuth_max=-1.3)
    alone = replace(base, sensor=sector, clutter_patches=())
    unlike = base.target_features[:2]
    plots = {"unlike": unlike, "alike": (unlike[0], unlike[0]), "without features": ({}, {})}
    angle = 0.2
    ships = {
        "as published": base.targets[:2],
        "overtaking": (_passing(5.0, 0.0), _passing(3.5, 0.0, abeam=20.0)),
        "crossing": (_passing(5.0, angle), _passing(5.0, -angle)),
    }
    return {
        f"{name}, plots {how}": replace(alone, targets=pair, target_features=features)
        for name, pair in ships.items()
        for how, features in plots.items()
    }


def _passing(speed: float, heading: float, abeam: float = 0.0) -> FloatArray:
    """A ship at 17 km in the middle of the run; `heading` is counter-clockwise from east."""
    middle = 148.5
    velocity = speed * np.array([math.cos(heading), math.sin(heading)])
    x, y = np.array([-2400.0, -17300.0 + abeam]) - middle * velocity
    return np.array([x, velocity[0], y, velocity[1]])


def zone(begin: float = 6400.0) -> Scenario:
    """The ship in the clutter zone, whose west end is at x = `begin`, m."""
    base = load_scenario("encounter")
    patch = base.clutter_patches[0]
    patches = (replace(patch, box=(begin, *patch.box[1:])),)
    ship = {"targets": base.targets[2:], "target_features": base.target_features[2:]}
    return replace(base, clutter_patches=patches, **ship)


def followed(job: Job) -> Iterator[tuple[SimulatedScan, TrackArrays, TrackArrays]]:
    """The scans of a run, with the tracks held after and started by each."""
    initiator = make_initiator(job.method, sensor=job.scenario.sensor, **job.options)
    for scan in Simulator(job.scenario, job.seed):
        new = initiator.process(scan.scan)
        yield scan, initiator.current, new


def nearest(truth: FloatArray, tracks: TrackArrays) -> int | None:
    """Id of the held track nearest to a ship (4,); None beyond MAX_DISTANCE."""
    if not len(tracks):
        return None
    distance = np.hypot(*(tracks.state[:, 0::2] - truth[0::2]).T)
    best = int(distance.argmin())
    return int(tracks.track_id[best]) if distance[best] <= MAX_DISTANCE else None


def encounter_run(job: Job) -> str:
    """What became of the tracks of two ships that met."""
    before: list[int | None] = []
    after: list[int | None] = []
    for scan, held, _ in followed(job):
        after = [nearest(truth, held) for truth in scan.truth]
        if scan.scan.stamp <= BEFORE:
            before = after
    if None in before or before[0] == before[1]:
        return "not started"
    if after == before:
        return "kept"
    return "swapped" if after == before[::-1] else "lost"


def zone_run(job: Job) -> tuple[bool, bool, float]:
    """Whether the ship was started, whether its track was lost, and the false tracks held."""
    before, after = None, None
    false = []
    for scan, held, _ in followed(job):
        after = nearest(scan.truth[0], held)
        if scan.scan.stamp <= BEFORE:
            before = after
        elif scan.scan.stamp < ZONE_LEFT:
            false.append(len(held) - (after is not None))
    return before is not None, before is not None and after != before, float(np.mean(false))


def start_run(job: Job) -> tuple[bool, int]:
    """Whether the ship was started, and the false starts."""
    origins, started, false = [], False, 0
    for scan, _, new in followed(job):
        origins.append(scan.origin)
        for track in new:
            own = sum(origins[index][row] == 0 for index, row in track.hits)
            started |= own > len(track.hits) / 2
            false += own <= len(track.hits) / 2
    return started, false


def jobs(scenario: Scenario, runs: int, method: str = "score", **options: Any) -> list[Job]:
    """Runs of a scene."""
    return [Job(scenario, method, options, seed) for seed in range(1, runs + 1)]


def results(function: Callable[[Job], Any], work: list[Job], workers: Workers) -> list[Any]:
    """Result of each run."""
    return list(with_progress(workers.mapped(function, work), len(work)))


def encounter_rows(runs: int, workers: Workers) -> Iterator[list[str]]:
    """Tracks held through an encounter."""
    for name, scenario in encounters().items():
        for features in WITHOUT_AND_WITH:
            work = jobs(scenario, runs, plot_features=features)
            ends = Counter(results(encounter_run, work, workers))
            started = runs - ends["not started"]
            shares = [proportion(ends[end], started) for end in ("kept", "swapped", "lost")]
            yield [name, _setting(features), str(started), *(f"{share:.2f}" for share in shares)]


def zone_rows(runs: int, workers: Workers) -> Iterator[list[str]]:
    """A track held through a clutter zone."""
    for features in WITHOUT_AND_WITH:
        work = jobs(zone(), runs, clutter_density="estimated", plot_features=features)
        held = results(zone_run, work, workers)
        started, lost, false = map(np.array, zip(*held, strict=True))
        share = proportion(int(lost.sum()), int(started.sum()))
        yield [_setting(features), str(started.sum()), f"{share:.2f}", f"{mean(false):.1f}"]


def start_rows(runs: int, workers: Workers) -> Iterator[list[str]]:
    """Starts in a clutter zone."""
    scenario = replace(zone(5900.0), scans=40)
    for method in STARTERS:
        for features in WITHOUT_AND_WITH:
            work = jobs(scenario, runs, method, plot_features=features)
            started, false = zip(*results(start_run, work, workers), strict=True)
            share = proportion(sum(started), runs)
            yield [method, _setting(features), f"{share:.2f}", f"{mean_count(false):.1f}"]


TABLES = {
    encounter_rows: ("two ships", "plot_features", "runs", "kept", "swapped", "lost"),
    zone_rows: ("plot_features", "runs", "lost", "false tracks held"),
    start_rows: ("method", "plot_features", "ship started", "false starts per run"),
}


def main() -> None:
    """Run the scenes and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=positive, default=100)
    parser.add_argument("--workers", type=positive, default=os.cpu_count() or 1)
    options = parser.parse_args()
    for rows, header in TABLES.items():
        table = text_table(header, rows(options.runs, workers_of(options)))
        print(f"\n{str(rows.__doc__).rstrip('.')}\n\n{table}", flush=True)


def _setting(features: bool) -> str:
    return "with" if features else "without"


if __name__ == "__main__":
    main()
