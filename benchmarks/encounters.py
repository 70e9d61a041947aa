"""What the features of plots and the encounter test are worth where association is hard.

Without and with `plot_features`, on scenes of the shipped scenario `encounter`:

- ships that meet: as published, one overtaking the other 20 m abeam with 1.5 m/s more, and two
  courses that cross at 23 degrees; with plots that are unlike, alike, or have no features. Tracks
  held by the method `score` before the encounter are kept, swapped, or lost: not near their ships
  (300 m) afterwards, or one for both;
- a ship that goes through a clutter zone, held by `score`: the track is lost if another or none is
  near the ship at the end; false tracks held are those that are not the nearest to it;
- starts in that zone by the methods that associate scan by scan: whether the ship is started by a
  track most of whose hits are its own, and false starts per run.

With 95 % intervals.

    python benchmarks/encounters.py [--runs 100] [--processes 2]
"""

from __future__ import annotations

import argparse
import math
import os
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from tsepm_ros.numerics.arrays import FloatArray

os.environ["OMP_NUM_THREADS"] = "1"
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import numpy as np

from tsepm_ros import make_initiator
from tsepm_ros.analysis.intervals import mean, mean_count, proportion
from tsepm_ros.analysis.text_tables import text_table
from tsepm_ros.analysis.workers import Workers, with_progress
from tsepm_ros.initiation.initiator import Initiator
from tsepm_ros.simulation import SimulatedScan, Simulator, load_scenario
from tsepm_ros.simulation.scenario import Scenario

NEAR = 300.0
"""Distance from its ship within which a track follows it, m."""
BEFORE = 63.0
"""Time by which the tracks are there, s: the encounters begin later."""
ZONE_LEFT = 240.0
"""Time from which the ship is out of the clutter zone, s."""
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
    """A ship that is 17 km away in the middle of the run, headed so far left of east."""
    middle = 148.5
    velocity = speed * np.array([math.cos(heading), math.sin(heading)])
    x, y = np.array([-2400.0, -17300.0 + abeam]) - middle * velocity
    return np.array([x, velocity[0], y, velocity[1]])


def zone(begin: float = 6400.0) -> Scenario:
    """The ship in the clutter zone, which begins so far east, m."""
    base = load_scenario("encounter")
    patch = base.clutter_patches[0]
    box = (begin, *patch.box[1:])
    return replace(
        base,
        targets=base.targets[2:],
        target_features=base.target_features[2:],
        clutter_patches=(replace(patch, box=box),),
    )


def followed(job: Job) -> Iterator[tuple[SimulatedScan, Initiator]]:
    """The scans of a run, each taken by the method."""
    made = make_initiator(job.method, sensor=job.scenario.sensor, **job.options)
    for scan in Simulator(job.scenario, job.seed):
        made.process(scan.scan)
        yield scan, made


def nearest(truth: FloatArray, made: Initiator) -> int | None:
    """Id of the track held nearest to a ship (4,), if one is near."""
    tracks = made.hold.current
    if not len(tracks):
        return None
    distance = np.hypot(*(tracks.state[:, 0::2] - truth[0::2]).T)
    best = int(distance.argmin())
    return int(tracks.track_id[best]) if distance[best] <= NEAR else None


def encounter_run(job: Job) -> str:
    """What became of the tracks of two ships that met."""
    before: list[int | None] = []
    after: list[int | None] = []
    for scan, made in followed(job):
        after = [nearest(truth, made) for truth in scan.truth]
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
    for scan, made in followed(job):
        after = nearest(scan.truth[0], made)
        if scan.scan.stamp <= BEFORE:
            before = after
        elif scan.scan.stamp < ZONE_LEFT:
            false.append(len(made.hold.current) - (after is not None))
    return before is not None, before is not None and after != before, float(np.mean(false))


def start_run(job: Job) -> tuple[bool, int]:
    """Whether the ship was started, and the false starts."""
    made = make_initiator(job.method, sensor=job.scenario.sensor, **job.options)
    origins = []
    found, false = False, 0
    for scan in Simulator(job.scenario, job.seed):
        origins.append(scan.origin)
        for track in made.process(scan.scan):
            own = sum(origins[index][row] == 0 for index, row in track.hits)
            found |= own > len(track.hits) / 2
            false += own <= len(track.hits) / 2
    return found, false


def jobs(scenario: Scenario, runs: int, method: str = "score", **options: Any) -> list[Job]:
    """Runs of a scene."""
    return [Job(scenario, method, options, seed) for seed in range(1, runs + 1)]


def report(title: str, header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table."""
    print(f"\n{title}\n\n{text_table(header, rows)}", flush=True)


def results(function: Callable[[Job], Any], work: list[Job], processes: int) -> list[Any]:
    """What each run gave."""
    return list(with_progress(Workers(processes=processes).mapped(function, work), len(work)))


def encounter_table(runs: int, processes: int) -> None:
    """Tracks held through an encounter."""
    rows = []
    for name, scenario in encounters().items():
        for features in WITHOUT_AND_WITH:
            work = jobs(scenario, runs, plot_features=features)
            found = Counter(results(encounter_run, work, processes))
            started = runs - found["not started"]
            shares = [proportion(found[what], started) for what in ("kept", "swapped", "lost")]
            rows.append([name, _said(features), str(started), *(f"{one:.2f}" for one in shares)])
    header = ("two ships", "plot_features", "runs", "kept", "swapped", "lost")
    report("Tracks held through an encounter", header, rows)


def zone_table(runs: int, processes: int) -> None:
    """A track held through a clutter zone."""
    rows = []
    for features in WITHOUT_AND_WITH:
        work = jobs(zone(), runs, clutter_density="estimated", plot_features=features)
        found = results(zone_run, work, processes)
        started, lost, false = map(np.array, zip(*found, strict=True))
        share = proportion(int(lost.sum()), int(started.sum()))
        rows.append([_said(features), str(started.sum()), f"{share:.2f}", f"{mean(false):.1f}"])
    header = ("plot_features", "runs", "lost", "false tracks held")
    report("A track held through a clutter zone", header, rows)


def start_table(runs: int, processes: int) -> None:
    """Starts in a clutter zone."""
    rows = []
    scenario = replace(zone(5900.0), scans=40)
    for method in STARTERS:
        for features in WITHOUT_AND_WITH:
            work = jobs(scenario, runs, method, plot_features=features)
            found, false = zip(*results(start_run, work, processes), strict=True)
            share = proportion(sum(found), runs)
            rows.append([method, _said(features), f"{share:.2f}", f"{mean_count(false):.1f}"])
    header = ("method", "plot_features", "ship started", "false starts per run")
    report("Starts in a clutter zone", header, rows)


def main() -> int:
    """Run the scenes and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1)
    given = parser.parse_args()
    for table in (encounter_table, zone_table, start_table):
        table(given.runs, given.processes)
    return 0


def _said(features: bool) -> str:
    return "with" if features else "without"


if __name__ == "__main__":
    sys.exit(main())
