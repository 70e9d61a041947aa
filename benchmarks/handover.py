"""Loss of a filter that starts without the covariance between position and velocity.

The Kalman filter of `examples/nearest_neighbour.py` follows every true start of a method in
simulated runs for some pings. It starts with

- full: the start's full covariance, as on `tracks`;
- blocks: the covariances of position and of velocity, as on `tracks/odometry`;
- doubled: twice these blocks, an upper bound for any correlation between them: for any errors a
  and b, ``2 a a'`` and ``2 b b'`` on the diagonal exceed ``(a, b) (a, b)'``;
- diagonal: the variances alone.

Each start is predicted without detections: NEES of the position, ideally 2. It is filtered with its
target's own detections, whatever their distance, so that differences are due to the start: errors,
and NEES of the state, ideally 4. The same filters associate detections in clutter: the share of
false detections, and the share of lost targets, whose filter ended or is more than 3 sigma of the
measurement error off after the last ping. Targets keep their velocity, and the filter has no
process noise unless it is given.

    python benchmarks/handover.py [--runs 160] [--noise 0.0] [--workers 2]
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import astuple, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import fixed_threads
import numpy as np
from numpy.typing import NDArray

sys.path.append(str(Path(__file__).resolve().parents[1] / "examples"))

from nearest_neighbour import GATE, NearestNeighbourTracker, Target

from tsepm_ros import ConfirmedTrack
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.tools.commands.arguments import add_runs, workers_of
from tsepm_ros.tools.evaluation import intervals
from tsepm_ros.tools.evaluation.intervals import Estimate, error_bars, mean, proportion
from tsepm_ros.tools.evaluation.simulated_run import (
    SIGMAS,
    OperatingPoint,
    Outcome,
    SimulatedRun,
    measurement_sigma,
    nees,
    simulate,
)
from tsepm_ros.tools.simulation import load_scenario
from tsepm_ros.tools.terminal import text_table, with_progress
from tsepm_ros.tracker.measurement import convert
from tsepm_ros.whole_files import written_whole

METHODS = ("score", "tsepm")
SCENARIO, SCANS = "four_targets", 16
AFTER = 10
"""Number of pings after the start."""
PINGS = (1, 2, 3, 5, 10)
"""Pings after the start in the tables."""
AHEAD, NEES_OF_STATE, POSITION, VELOCITY = range(4)
TITLES = (
    "predicted position, NEES (ideal 2)",
    "filtered, NEES (ideal 4)",
    "position error, RMS [m]",
    "velocity error, RMS [m/s]",
)
DIGITS = (2, 2, 1, 3)
IDEAL = {AHEAD: 2.0, NEES_OF_STATE: 4.0}
STYLES = (("#000000", "o"), ("#D55E00", "s"), ("#009E73", "^"), ("#56B4E9", "D"))
"""Colours distinct for colour-blind readers (Okabe and Ito), and markers."""


def blocks(covariance: FloatArray) -> FloatArray:
    """A covariance (4, 4) without the covariance between position and velocity."""
    return covariance * np.tile(np.eye(2), (2, 2))


VARIANTS: dict[str, Callable[[FloatArray], FloatArray]] = {
    "full": lambda covariance: covariance,
    "blocks": blocks,
    "doubled": lambda covariance: 2.0 * blocks(covariance),
    "diagonal": lambda covariance: np.diag(np.diag(covariance)),
}
"""Start covariance of a filter from the full covariance; the variants keep this order below."""


@dataclass
class Followed:
    """Starts s followed by v variants of the filter; shares are nan without detections.

    The figures after each ping, the start's ping included, are NEES of the predicted position, and
    with the target's own detections NEES, position error, m, and velocity error, m/s.
    """

    figures: FloatArray  # (s, v, AFTER + 1, 4)
    outside: FloatArray  # (s, v), share of the target's own detections outside the gate
    false: FloatArray  # (s, v), share of associated detections in clutter from other sources
    lost: FloatArray  # (s, v), 1 if the target was lost in clutter

    @classmethod
    def of(cls, parts: Sequence[Followed]) -> Followed:
        """The concatenation of several parts."""
        return cls(*map(np.concatenate, zip(*(astuple(part) for part in parts), strict=True)))


@dataclass(frozen=True)
class Start:
    """A true start: its track, its target and the scan that confirmed it."""

    track: ConfirmedTrack
    target: int
    scan: int


@dataclass(frozen=True)
class Scene:
    """A simulated run, its detections in the fixed frame, and its true starts."""

    run: SimulatedRun
    detections: list[NDArray[np.void]]
    starts: list[Start]

    @classmethod
    def of(cls, run: SimulatedRun) -> Scene:
        """The scene of a run with the starts of the first SCANS scans."""
        sensor = run.scenario.sensor
        return cls(
            run,
            [convert(scan, sensor, index) for index, scan in enumerate(run.scans)],
            [
                Start(judged.track, judged.target, scan)
                for judged, scan in zip(run.judged(), run.start_scans, strict=True)
                if judged.outcome is Outcome.TRUE and scan < SCANS
            ],
        )

    def truth(self, start: Start, ping: int) -> FloatArray:
        """State of a start's target some pings later, (4,)."""
        return self.run.simulator.truth(self.run.scans[start.scan + ping].stamp)[start.target]

    def measured(self, index: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Positions of a scan's detections, their covariances and times after the stamp, s."""
        rows = self.detections[index]
        return rows["position"], rows["covariance"], rows["time"] - self.run.scans[index].stamp

    def own(self, start: Start, ping: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """`measured` for the detection, if any, of a start's target some pings later."""
        index = start.scan + ping
        position, R, elapsed = self.measured(index)
        own = self.run.origins[index] == start.target
        return position[own], R[own], elapsed[own]


def follow(seed: Sequence[int], method: str, noise: float) -> Followed:
    """Follow the true starts of one run."""
    scenario = load_scenario(SCENARIO, {"scans": SCANS + AFTER})
    scene = Scene.of(simulate(scenario, list(seed), OperatingPoint(method)))
    shape = len(scene.starts), len(VARIANTS)
    followed = Followed(np.zeros((*shape, AFTER + 1, 4)), *(np.zeros(shape) for _ in range(3)))
    for place, variant in enumerate(VARIANTS.values()):
        for row, start in enumerate(scene.starts):
            ahead, own = (
                Target(start.track.state, variant(start.track.covariance)) for _ in range(2)
            )
            followed.figures[row, place, :, AHEAD] = predicted(scene, start, ahead, noise)
            figures, followed.outside[row, place] = filtered(scene, start, own, noise)
            followed.figures[row, place, :, NEES_OF_STATE:] = figures
        followed.false[:, place], followed.lost[:, place] = in_clutter(scene, variant, noise)
    return followed


def predicted(scene: Scene, start: Start, target: Target, noise: float) -> list[float]:
    """NEES of the position after each ping, predicted without detections."""
    figures = []
    for ping in range(AFTER + 1):
        if ping:
            target.predict(scene.run.scenario.period, noise)
        error = target.state - scene.truth(start, ping)
        figures.append(nees(error[0::2], target.covariance[0::2, 0::2]))
    return figures


def filtered(
    scene: Scene, start: Start, target: Target, noise: float
) -> tuple[list[tuple[float, float, float]], float]:
    """Figures after each ping with the target's own detections, and the share outside the gate."""
    figures, outside = [], []
    for ping in range(AFTER + 1):
        if ping:
            target.predict(scene.run.scenario.period, noise)
            position, R, elapsed = scene.own(start, ping)
            for innovation, S in zip(*target.innovations(position, R, elapsed), strict=True):
                outside.append(nees(innovation, S) >= GATE)
                target.update(innovation, S, elapsed[0])
        x, vx, y, vy = error = target.state - scene.truth(start, ping)
        figures.append((nees(error, target.covariance), np.hypot(x, y), np.hypot(vx, vy)))
    return figures, float(np.mean(outside)) if outside else np.nan


def in_clutter(
    scene: Scene, variant: Callable[[FloatArray], FloatArray], noise: float
) -> tuple[list[float], list[bool]]:
    """Share of false detections associated with each start, and whether its target is lost."""
    tracker = NearestNeighbourTracker(noise)
    is_false: dict[int, list[bool]] = {start.track.track_id: [] for start in scene.starts}
    targets = {start.track.track_id: start.target for start in scene.starts}
    lost = {}
    for index, scan in enumerate(scene.run.scans):
        for name, column in tracker.step(scan.stamp, *scene.measured(index)).items():
            is_false[name].append(scene.run.origins[index][column] != targets[name])
        for start in scene.starts:
            name = start.track.track_id
            if start.scan == index:
                tracker.start([replace(start.track, covariance=variant(start.track.covariance))])
            if start.scan == index - AFTER:
                target = tracker.targets.pop(name, None)
                lost[name] = target is None or is_off(scene, start, target)
    shares = [float(np.mean(flags)) if flags else np.nan for flags in is_false.values()]
    return shares, [lost[name] for name in is_false]


def is_off(scene: Scene, start: Start, target: Target) -> bool:
    """Whether a filter is more than 3 sigma from its target after the last ping."""
    truth = scene.truth(start, AFTER)[0::2]
    stamp = scene.run.scans[start.scan + AFTER].stamp
    sigma = measurement_sigma(scene.run.scenario.sensor, truth - scene.run.sensor_position(stamp))
    return bool(np.hypot(*(target.state[0::2] - truth)) > SIGMAS * sigma)


def by_ping(followed: Followed, figure: int, place: int) -> list[Estimate]:
    """A figure of a variant after each ping: mean NEES, or RMS error."""
    summary = mean if figure in IDEAL else intervals.root_mean_square
    return [summary(followed.figures[:, place, ping, figure]) for ping in range(AFTER + 1)]


def overall(followed: Followed, place: int) -> list[str]:
    """Figures of a variant over all pings."""
    squares = np.square(followed.figures[:, :, 1:, POSITION:]).mean(axis=2)
    errors = np.sqrt(squares)
    ratios = [intervals.rms_ratio(errors[:, place, k], errors[:, 0, k]) for k in (0, 1)]
    outside, false = (
        mean(share[~np.isnan(share)])
        for share in (followed.outside[:, place], followed.false[:, place])
    )
    lost = proportion(int(followed.lost[:, place].sum()), len(followed.lost))
    return [f"{estimate:.3f}" for estimate in (*ratios, outside, false, lost)]


def tables(followed: Followed) -> str:
    """The tables of a method."""
    parts = [
        text_table(
            [title, *(f"{ping} ping{'s' * (ping > 1)}" for ping in PINGS)],
            [
                [name, *(f"{by_ping(followed, figure, place)[ping]:.{digits}f}" for ping in PINGS)]
                for place, name in enumerate(VARIANTS)
            ],
        )
        for figure, (title, digits) in enumerate(zip(TITLES, DIGITS, strict=True))
    ]
    header = ["10 pings", "position / full", "velocity / full", "outside gate", "false", "lost"]
    rows = [[name, *overall(followed, place)] for place, name in enumerate(VARIANTS)]
    return "\n\n".join([*parts, text_table(header, rows)])


def draw(results: dict[str, Followed], path: Path) -> None:
    """Draw the figures by ping, a row for each method."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    shape, size = (len(results), len(TITLES)), (15, 4 * len(results))
    figure, axes = plt.subplots(*shape, figsize=size, squeeze=False, layout="constrained")
    for (method, followed), row in zip(results.items(), axes, strict=True):
        for kind, axis in enumerate(row):
            _draw_figure(axis, followed, kind)
        row[0].set_ylabel(f"{method}: {len(followed.lost)} starts")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
    path.parent.mkdir(parents=True, exist_ok=True)
    with written_whole(path) as temporary:
        figure.savefig(temporary, dpi=80)
    plt.close(figure)


def _draw_figure(axis: Any, followed: Followed, kind: int) -> None:
    """Draw one figure of all variants, with intervals and the ideal value."""
    for place, (name, (color, marker)) in enumerate(zip(VARIANTS, STYLES, strict=True)):
        values = by_ping(followed, kind, place)
        centre = np.array([estimate.value for estimate in values])
        pings = np.arange(AFTER + 1) + 0.08 * (place - 1.5)  # side by side
        style = {"color": color, "marker": marker, "ms": 4, "lw": 1.2, "elinewidth": 0.8}
        axis.errorbar(pings, centre, error_bars(centre, values), label=name, **style)
    if kind in IDEAL:
        axis.axhline(IDEAL[kind], color="grey", linestyle="--", lw=1)
    axis.set(ylim=(0, None), title=TITLES[kind], xlabel="pings after the start")
    axis.grid(alpha=0.3)


def main(arguments: Iterable[str] | None = None) -> None:
    """Compare, print and draw."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    add_runs(parser, 160)
    parser.add_argument("--noise", type=float, default=0.0, help="process noise, m^2/s^3")
    parser.add_argument("--picture", type=Path, default=fixed_threads.BUILD / "handover.png")
    options = parser.parse_args(arguments)
    seeds = [(options.seed, run) for run in range(options.runs)]
    results = {}
    workers = workers_of(options)
    for method in METHODS:
        job = partial(follow, method=method, noise=options.noise)
        parts = with_progress(workers.mapped(job, seeds, chunk=4), len(seeds))
        results[method] = Followed.of(list(parts))
        print(
            f"method {method} (defaults), scenario {SCENARIO}, {options.runs} runs, seed "
            f"{options.seed}: {len(results[method].lost)} true starts in the first {SCANS} scans; "
            f"process noise {options.noise:g} m^2/s^3; 95 % intervals\n"
        )
        print(tables(results[method]) + "\n")
    draw(results, options.picture)
    print(f"picture: {options.picture}")


if __name__ == "__main__":
    main()
