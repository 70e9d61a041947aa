"""How far the method `score` is from what the scans tell: beside a search of all states.

The search knows the scene's box and v_max and looks at every position and velocity on a grid. The
likelihood ratio is summed over a square of +-2 sigma about each position: that holds the states of
one target after 3 hits (0.9 sigma) and more, as a newest detection holds the hypotheses that
`score` sums, and in the same units. Peaks of the sum are declared: after the last scan only; or
after each from the third on, where none of before is within 3 sigma, as `score` does. The scene's
target is there from the first scan on; `score` assumes one that may appear at any scan.

False peaks that a target's own echoes make beside it are not explained away, as `score` does by the
hits that it takes; so the search is not strictly the limit.

A peak has no hits. So a start is true here if it is within 3 sigma of the target, and false
elsewhere, for `score` too; its official figures, by its hits, are given beside.

    python benchmarks/exhaustive.py [--runs 600] [--processes 2]

With `--score-only` nothing is searched, which is much quicker: `score` on the same scenes, and its
P_D at the false starts per run that `--at` names.
"""

from __future__ import annotations

import argparse
import json
import os

from tsepm_ros.numerics.arrays import FloatArray

os.environ["OMP_NUM_THREADS"] = "1"
os.environ["OPENBLAS_NUM_THREADS"] = "1"
os.environ["MKL_NUM_THREADS"] = "1"

from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from functools import partial
from math import nan
from pathlib import Path

import numpy as np
from exhaustive_search import SIGMAS, StateGrid
from numpy.typing import NDArray
from tqdm import tqdm

from tsepm_ros.analysis.intervals import mean_count, proportion
from tsepm_ros.analysis.operating_curve import LEAST_FALSE, Comparison, Curve, compare
from tsepm_ros.analysis.operating_points import (
    OperatingPoint,
    digest,
    operating_points,
    package_version,
)
from tsepm_ros.analysis.run_summary import RunSummary, ScanRecord, StartSummary, record
from tsepm_ros.analysis.simulated_run import simulate
from tsepm_ros.analysis.truth import Outcome, measurement_sigma
from tsepm_ros.simulation import Scenario, SimulatedScan, Simulator, load_scenario

BUILD = Path(__file__).resolve().parents[1] / "build"
SCANS = 8
FIRST = 3
"""Scans before the first decision: as many as the fewest hits of a start."""
MAX_SPEED = 10.0
REACH = 2.0
"""Half of the square, sigmas. Tried from 0.75 to 2.5 on 240 runs of another seed: from 0.1 false
starts per run on, smaller ones give the search less, and 2.5 no more than 0.015."""
THRESHOLDS = np.arange(0.5, 10.1, 0.5)
"""Log evidence at which a peak is declared."""
TRUSTED = 3.0
"""Log evidence from which peaks are compared with those at half the steps."""
WISHES = (1.0, 3.0, 10.0, 30.0, 100.0, 300.0)
"""False tracks per hour that `score` is asked for."""
OFFICIAL, BY_POSITION = "score, by hits", "score"
SEARCHES = {"there from the first scan": False, "may appear": True}
ENDS = ("low", "high")
EVERY_SCAN, AT_THE_END = "each scan", "the last scan"

Found = dict[tuple[str, str], RunSummary]
"""A run's starts, by method and label of the operating point."""


@dataclass(frozen=True)
class Row:
    """An operating point of `score` beside a search, starts judged by position.

    Attributes
    ----------
    label, search : str
        The point and the search.
    false, detection : float
        False starts per run and P_D of `score`.
    search_detection, difference : tuple of float
        P_D of the search at as many false starts; that of `score` less it; with 95 % intervals.
    false_ratio : tuple of float
        False starts of the search at the same P_D over those of `score`, with its interval.
    """

    label: str
    search: str
    false: float
    detection: float
    search_detection: tuple[float, float, float]
    difference: tuple[float, float, float]
    false_ratio: tuple[float, float, float]


def one_run(index: int, *, seed: int, step: float, reach: float, search: bool) -> Found:
    """Search a scene if that is wanted, and let `score` start tracks on it."""
    scenario = box()
    simulated = list(Simulator(scenario, [seed, index]))
    truths = [scan.truth[0, 0::2] for scan in simulated]
    found = searched(scenario, simulated, truths, step, reach) if search else {}
    return found | {
        key: one
        for point in score_points()
        for key, one in score_run(scenario, [seed, index], point, truths).items()
    }


def searched(
    scenario: Scenario,
    simulated: Sequence[SimulatedScan],
    truths: Sequence[FloatArray],
    step: float,
    reach: float,
) -> Found:
    """What the searches declare in a scene."""
    grid = StateGrid(scenario, step, MAX_SPEED)
    maps = np.array([grid.scan_map(scan.scan) for scan in simulated])
    found = {}
    for name, appearing in SEARCHES.items():
        evidence = grid.evidence_maps(maps, appearing=appearing)
        peaks = [
            grid.peaks(
                maps[: scan + 1],
                evidence[scan],
                reach=reach,
                least=THRESHOLDS[0],
                appearing=appearing,
            )
            for scan in range(FIRST - 1, SCANS)
        ]
        for threshold in THRESHOLDS:
            label = f"{threshold:g}"
            for when, used in ((EVERY_SCAN, peaks), (AT_THE_END, peaks[-1:])):
                starts = declared(used, threshold, scenario.period)
                offsets = [place - truths[scan - len(used)] for scan, place in starts]
                found[f"{name}, {when}", label] = by_position(scenario, offsets, truths)
    return found


def box() -> Scenario:
    """The scene, as long as it is looked at."""
    return replace(load_scenario("box"), scans=SCANS)


def score_points() -> list[OperatingPoint]:
    """`score` at several wishes."""
    (point,) = operating_points(["score"], {"false_tracks_per_hour": 1.0})
    return [
        replace(
            point, label=f"{wish:g}/h", options={**point.options, "false_tracks_per_hour": wish}
        )
        for wish in WISHES
    ]


def score_run(
    scenario: Scenario, seed: list[int], point: OperatingPoint, truths: Sequence[FloatArray]
) -> Found:
    """The starts of `score`, judged by hits and position, and by position alone."""
    run = simulate(scenario, seed, point)
    offsets = [
        start.state[0::2] - truths[scan]
        for start, scan in zip(run.starts, run.start_scans, strict=True)
    ]
    return {
        (OFFICIAL, point.label): record(run),
        (BY_POSITION, point.label): by_position(scenario, offsets, truths),
    }


def declared(
    peaks: Sequence[NDArray[np.void]], threshold: float, period: float
) -> Iterator[tuple[int, FloatArray]]:
    """Peaks of each scan that reach a threshold, unless declared already.

    What has been declared moves on at its velocity and follows the peaks within 3 sigma of it.

    Parameters
    ----------
    peaks : sequence of (p,) ndarray of PEAK
        The highest first.
    threshold : float
        Log evidence.
    period : float
        s.

    Yields
    ------
    scan : int
    position : (2,) ndarray
        m.
    """
    position, velocity = np.zeros((0, 2)), np.zeros((0, 2))
    for scan, found in enumerate(peaks):
        position = position + period * velocity
        for peak in found[found["evidence"] >= threshold]:
            apart = np.hypot(*(position - peak["position"]).T)
            if apart.min(initial=np.inf) <= SIGMAS * peak["sigma"]:
                nearest = apart.argmin()
                position[nearest], velocity[nearest] = peak["position"], peak["velocity"]
                continue
            position = np.vstack([position, peak["position"]])
            velocity = np.vstack([velocity, peak["velocity"]])
            yield scan, peak["position"]


def by_position(
    scenario: Scenario, offsets: Iterable[FloatArray], truths: Sequence[FloatArray]
) -> RunSummary:
    """Starts judged by their offsets (2,) from the target alone, m."""
    limit = SIGMAS * measurement_sigma(scenario.sensor, truths[-1])
    near = [bool(np.hypot(*offset) <= limit) for offset in offsets]
    start = StartSummary(0, 0.0, Outcome.TRUE, False, nan, nan, nan, nan, nan)
    starts = (start,) if any(near) else ()
    return RunSummary(1, starts, (ScanRecord(near.count(False)),))


def beside(points: dict[tuple[str, str], list[RunSummary]]) -> list[Row]:
    """Every point of `score` by position beside each search's curve."""
    searches = dict.fromkeys(name for name, _ in points if name not in (OFFICIAL, BY_POSITION))
    return [
        Row(
            one.label,
            one.other,
            one.false,
            one.detection,
            _three(one, "other_detection"),
            _three(one, "gain"),
            _three(one, "ratio"),
        )
        for search in searches
        for one in compare({k: v for k, v in points.items() if k[0] in (BY_POSITION, search)})
        if one.method == BY_POSITION
    ]


def _three(one: Comparison, name: str) -> tuple[float, float, float]:
    estimate = getattr(one, name)
    return estimate.value, estimate.low, estimate.high


def figures(points: dict[tuple[str, str], list[RunSummary]]) -> list[dict]:
    """P_D and false starts per run of each point, with intervals."""
    return [
        {
            "method": method,
            "label": label,
            "detection": asdict(proportion(sum(r.count(Outcome.TRUE) for r in runs), len(runs))),
            "false": asdict(mean_count([r.wrong for r in runs])),
        }
        for (method, label), runs in points.items()
    ]


def show(found: list[dict], rows: Sequence[Row]) -> None:
    """Print both tables."""
    print(f"{'method':44} {'point':>6}  P_D, 95 %               false per run, 95 %")
    for one in found:
        d, f = one["detection"], one["false"]
        print(
            f"{one['method']:44} {one['label']:>6}  {d['value']:.3f} ({d['low']:.3f} to "
            f"{d['high']:.3f})  {f['value']:.3f} ({f['low']:.3f} to {f['high']:.3f})"
        )
    if not rows:
        return
    print("\nscore beside a search at the same false starts per run; both by position")
    print(
        f"{'point':>6} {'false':>6} {'P_D':>6}  {'search':40}  P_D, 95 %               "
        "score less that           its false / score's at the same P_D"
    )
    for row in rows:
        search, gain, ratio = row.search_detection, row.difference, row.false_ratio
        print(
            f"{row.label:>6} {row.false:6.3f} {row.detection:6.3f}  {row.search:40}  "
            f"{search[0]:.3f} ({search[1]:.3f} to {search[2]:.3f})  "
            f"{gain[0]:+.3f} ({gain[1]:+.3f} to {gain[2]:+.3f})  "
            f"{ratio[0]:.2f} ({ratio[1]:.2f} to {ratio[2]:.2f})"
        )


def show_curve(found: list[dict], rates: Sequence[float], runs: int) -> None:
    """Print P_D of `score`, by position, at some false starts per run, between its points."""
    ours = [one for one in found if one["method"] == BY_POSITION]
    false, detection = (
        np.array([one[key]["value"] for one in ours]) for key in ("false", "detection")
    )
    curve = Curve.of(np.maximum(false, LEAST_FALSE / runs), detection)
    print("\nP_D of score, by position, at false starts per run:")
    for rate, share in zip(rates, curve.detection_at(np.array(rates)), strict=True):
        print(f"{rate:6.3f}  {share:.3f}")


def draw(found: list[dict], runs: int, path: Path) -> None:
    """Draw P_D against false starts per run."""
    os.environ.setdefault("MPLCONFIGDIR", str(BUILD / "matplotlib"))
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, axis = plt.subplots(figsize=(9.0, 6.5), layout="constrained")
    for method in dict.fromkeys(one["method"] for one in found):
        ours = [one for one in found if one["method"] == method and one["false"]["value"] > 0]
        x, y = ([one[key]["value"] for one in ours] for key in ("false", "detection"))
        bars = [
            [abs(one["detection"][k] - one["detection"]["value"]) for one in ours] for k in ENDS
        ]
        style = "o-" if method.startswith("score") else ".--"
        axis.errorbar(x, y, bars, fmt=style, linewidth=1, elinewidth=0.5, label=method)
    axis.set(xscale="log", xlim=(0.01, 20.0), xlabel="false starts per run", ylabel="P_D")
    axis.set_title(
        f"box, {SCANS} scans, {runs} runs, 95 % intervals of P_D: score beside all states"
    )
    axis.grid(alpha=0.3)
    axis.legend()
    figure.savefig(path, dpi=110)


def finer(seed: int, step: float, reach: float, scenes: int) -> float:
    """Largest change of a declared peak's log evidence where the steps are halved."""
    changes = [0.0]
    for index in range(scenes):
        scans = [one.scan for one in Simulator(box(), [seed, index])]
        coarse, fine = (
            _last_peaks(StateGrid(box(), one, MAX_SPEED), scans, reach) for one in (step, step / 2)
        )
        for peak in coarse[coarse["evidence"] >= TRUSTED]:
            apart = np.hypot(*(fine["position"] - peak["position"]).T)
            changes.append(abs(float(fine["evidence"][apart.argmin()] - peak["evidence"])))
    return max(changes)


def all_runs(options: argparse.Namespace) -> list[Found]:
    """The runs, those of an earlier call with the same code from their file."""
    code = digest([Path(__file__).with_name("exhaustive_search.py")])
    setting = f"{options.seed} {options.step} {options.reach} {code} {package_version()}"
    name = "exhaustive_score" if options.score_only else "exhaustive"
    path = options.output / f"{name}_runs.jsonl"
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    if lines[:1] != [setting]:
        lines = [setting]
        path.write_text(setting + "\n", encoding="utf-8")
    missing = range(len(lines) - 1, options.runs)
    task = partial(
        one_run,
        seed=options.seed,
        step=options.step,
        reach=options.reach,
        search=not options.score_only,
    )
    with path.open("a", encoding="utf-8") as file, ProcessPoolExecutor(options.processes) as pool:
        for found in tqdm(pool.map(task, missing), total=len(missing), unit="run"):
            lines.append(json.dumps([[*key, one.as_json()] for key, one in found.items()]))
            print(lines[-1], file=file, flush=True)
    return [
        {(method, label): RunSummary.from_json(one) for method, label, one in json.loads(line)}
        for line in lines[1 : 1 + options.runs]
    ]


def _last_peaks(grid: StateGrid, scans: list, reach: float) -> NDArray[np.void]:
    maps = np.array([grid.scan_map(scan) for scan in scans])
    evidence = grid.evidence_maps(maps, appearing=False)[-1]
    return grid.peaks(maps, evidence, reach=reach, least=THRESHOLDS[0], appearing=False)


def main() -> None:
    """Run, print, and write exhaustive.json and exhaustive.png."""
    parser = argparse.ArgumentParser(
        description=__doc__.splitlines()[0],
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    parser.add_argument("--runs", type=int, default=600)
    parser.add_argument("--seed", type=int, default=2)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--step", type=float, default=20.0, help="cell, m; per scan: velocity")
    parser.add_argument("--reach", type=float, default=REACH, help="half of the square, sigmas")
    parser.add_argument("--halved", type=int, default=5, help="scenes to repeat at half the step")
    parser.add_argument("--score-only", action="store_true", help="search nothing")
    parser.add_argument("--at", type=float, nargs="*", default=(0.067, 0.29, 1.19))
    parser.add_argument("--output", type=Path, default=BUILD, help="folder for what is written")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    runs = all_runs(options)
    points = {key: [run[key] for run in runs] for key in runs[0]}
    found, rows = figures(points), beside(points)
    show(found, rows)
    show_curve(found, options.at, options.runs)
    if options.score_only:
        return
    content = {
        "runs": options.runs,
        "seed": options.seed,
        "step": options.step,
        "reach": options.reach,
        "points": found,
        "comparisons": [asdict(row) for row in rows],
    }
    if options.halved:
        change = finer(options.seed, options.step, options.reach, options.halved)
        print(f"\nat half the steps a peak's log evidence changes by at most {change:.3f}")
        content["change_at_half_step"] = change
    target = options.output / "exhaustive.json"
    target.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    draw(found, options.runs, target.with_suffix(".png"))
    print(f"written: {target}, {target.with_suffix('.png').name}")


if __name__ == "__main__":
    main()
