"""Sequential 2014: its simulated runs, Figs. 8-11 and Table 1.

The simulated runs of Sequential 2014: six targets on a hexagon, a platform on a square.

Sequential 2014: Figs. 8-11 and Table 1.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.studies import sequential
from tsepm_ros.studies.reproduction import published as published
from tsepm_ros.studies.reproduction.document import Column, Part, Picture, Table
from tsepm_ros.studies.reproduction.monte_carlo import AS_GIVEN, Started
from tsepm_ros.studies.reproduction.runs import Result, Setting
from tsepm_ros.studies.sequential import Sequential, SequentialOptions
from tsepm_ros.tools.evaluation.intervals import Estimate, mean, proportion, root, root_mean_square
from tsepm_ros.tools.evaluation.measures import cramer_rao
from tsepm_ros.tools.evaluation.simulated_run import Judged, Outcome, SimulatedScene
from tsepm_ros.tools.simulation import Scenario
from tsepm_ros.tools.simulation.scenario import WaypointMotion
from tsepm_ros.tracker.measurement import convert
from tsepm_ros.tracker.options import CommonOptions
from tsepm_ros.tracker.sensor import SensorModel
from tsepm_ros.tracker.tracker import Tracker
from tsepm_ros.tracker.tracks import ConfirmedTrack

DETECTION_PROBABILITIES = (1.0, 0.9, 0.8)
ASSUMED = 0.9
"""Detection probability of the scene with the listed interval."""
TURN_RADIUS = 1.0
"""Turn radius of the platform at a corner, m; the published platform turns on the spot."""


MATCHINGS = {
    "nearest pair first": "nearest",
    "oldest track first": "oldest",
    "by several tracks": "shared",
}
"""Values of `SequentialOptions.matching`, in the words of the tables."""
GATES = ("range", "major_axis")
READINGS = tuple(itertools.product(GATES, MATCHINGS))
"""Meaning of sigma in Eq. 7, and track of a detection that several tracks match (Step 3)."""
DEFAULT_READING = (GATES[0], "oldest track first")
"""The default reading of the method."""


def case(period: float, detection_probability: float) -> Scenario:
    """The scene of Section 5, from time 0 to two minutes; every run draws the targets' headings.

    Parameters
    ----------
    period : float
        s.
    detection_probability : float
    """
    half = 0.5 * published.SQUARE_SIDE
    corners = ((-half, -half), (half, -half), (half, half), (-half, half))
    sensor = SensorModel(
        range_std_fraction=published.SEQUENTIAL_RANGE_ERROR_FRACTION,
        azimuth_std=math.radians(published.ANGLE_ERROR_DEG),
        max_range=published.MAX_RANGE,
        detection_probability=detection_probability,
        clutter_density=published.CLUTTER / (math.pi * published.MAX_RANGE**2),
    )
    return Scenario(
        "sequential_2014",
        scans=1 + int(published.DURATION // period),
        period=period,
        sensor=sensor,
        own_ship=WaypointMotion(
            corners, published.PLATFORM_SPEED, published.PLATFORM_SPEED / TURN_RADIUS, True
        ),
    )


def hexagon(rng: np.random.Generator) -> tuple[FloatArray, ...]:
    """States of the targets, with headings drawn."""
    azimuth = np.arange(published.TARGETS) * 2.0 * np.pi / published.TARGETS
    heading = rng.uniform(-np.pi, np.pi, published.TARGETS)
    x, y = published.DISTANCE * np.array([np.cos(azimuth), np.sin(azimuth)])
    vx, vy = published.TARGET_SPEED * np.array([np.cos(heading), np.sin(heading)])
    return tuple(np.stack([x, vx, y, vy], axis=1))


def cases() -> dict[tuple[float, float], Scenario]:
    """Scenes by interval (s) and p_d; the source leaves both open."""
    text_period, list_period = published.PERIODS
    keys = [(text_period, p_d) for p_d in DETECTION_PROBABILITIES]
    return {key: case(*key) for key in (*keys, (list_period, ASSUMED))}


def run_hexagon(scenario: Scenario, seed: list[int]) -> Result:
    """Start tracks by every reading.

    Returns cumulative counts per reading and scan: targets with a true track; targets with a track
    that has more than half of its hits from the target; all tracks. For the second kind of tracks
    of the default reading it also returns the errors of each estimator, and the bounds.
    """
    targets = hexagon(np.random.default_rng([*seed, 1]))
    scene = SimulatedScene.drawn(dataclasses.replace(scenario, targets=targets), seed)
    results: Result = {}
    for gate, matching in READINGS:
        method = Sequential(
            scenario.sensor,
            CommonOptions(max_speed=published.SEQUENTIAL_MAX_SPEED, **AS_GIVEN),
            SequentialOptions(gate_error=gate, matching=MATCHINGS[matching]),
        )
        started = Started.on(scene, Tracker(method), scenario.scans)
        judged = started.judged()
        true = [judgement for judgement in judged if judgement.outcome is Outcome.TRUE]
        for name, stamps in (
            ("true", [judgement.track.stamp for judgement in true]),
            ("near", [judgement.track.stamp for judgement in _first_of_each(judged)]),
            ("all", started.tracks.stamp.tolist()),
        ):
            scan = np.round(np.array(stamps) / scenario.period)
            counts = np.histogram(scan, np.arange(scenario.scans + 1) - 0.5)[0]
            results[f"{gate}, {matching}: {name}"] = np.cumsum(counts).astype(float).tolist()
        if (gate, matching) == DEFAULT_READING:
            results |= errors(started, _first_of_each(judged))
    return results


def _first_of_each(judged: list[Judged]) -> list[Judged]:
    first: dict[int, Judged] = {}
    for judgement in judged:
        first.setdefault(judgement.target, judgement)
    return list(first.values())


def errors(started: Started, judged: list[Judged]) -> Result:
    """Errors of the estimators on the same hits, and their Cramer-Rao bounds.

    Returns
    -------
    dict
        Per estimator: distance (m), length of the velocity's error (m/s), speed less the true one
        (m/s), angle between the velocities (degrees), of each track in turn; and of each track the
        Cramer-Rao bounds of mean square distance (m^2) and velocity error (m^2/s^2), and whether
        all hits are the target's.
    """
    scene = started.scene
    results: Result = {name: [] for name in (*sequential.ESTIMATORS, "bound")}
    for judgement in judged:
        truth = scene.simulator.truth(judgement.track.stamp)[judgement.target]
        for name in sequential.ESTIMATORS:
            results[name] += _errors(_estimated(scene, judgement.track, name) - truth, truth)
        results["bound"] += [*_bound(scene, judgement), float(judgement.pure)]
    return results


def _estimated(scene: SimulatedScene, track: ConfirmedTrack, estimator: str) -> FloatArray:
    sensor = scene.scenario.sensor
    hits = np.array([convert(scene.scans[scan], sensor, scan)[row] for scan, row in track.hits])
    noise = SequentialOptions().process_noise
    return sequential.estimate(hits[None], track.stamp, sensor, estimator, noise).state[0]


def _errors(error: FloatArray, truth: FloatArray) -> list[float]:
    true, estimated = truth[1::2], truth[1::2] + error[1::2]
    angle = math.atan2(true[0] * estimated[1] - true[1] * estimated[0], float(true @ estimated))
    return [
        float(np.hypot(error[0], error[2])),
        float(np.hypot(error[1], error[3])),
        float(np.hypot(*estimated) - np.hypot(*true)),
        abs(math.degrees(angle)),
    ]


def _bound(scene: SimulatedScene, judgement: Judged) -> list[float]:
    """Bounds of the mean square errors at the hits' times, all taken as the target's."""
    stamps = np.array([scene.scans[scan].stamp for scan, _ in judgement.track.hits])
    scenario = scene.scenario
    positions = np.array([scene.simulator.truth(t)[judgement.target, 0::2] for t in stamps])
    own_ship = np.array([scenario.own_ship.pose(t)[:2] for t in stamps])
    bound = cramer_rao(positions, stamps, own_ship, scenario.sensor, judgement.track.stamp)
    return [float(np.trace(bound[place::2, place::2])) for place in (0, 1)]


TIMES = np.array(list(published.FORMED))
FORMED = np.array(list(published.FORMED.values()))
Scenes = Mapping[tuple[float, float], Scenario]
"""Scenes by interval (s) and p_d."""
MAIN = (published.PERIODS[0], ASSUMED)
"""The scene of Table 1's errors and of the pictures."""
ESTIMATORS = {
    "least_squares": "least squares",
    "linear_fitting": "linear fitting",
    "kalman_filter": "Kalman filter",
}


@dataclass(frozen=True)
class Counts:
    """Tracks started by a reading in the runs of a scene.

    Attributes
    ----------
    period, detection_probability : float
    gate, matching : str
    true, near, every : (runs, scans) ndarray
        Counts by the end of each scan: targets with a true track; targets with a track that has
        more than half of its hits from the target; all tracks.
    """

    period: float
    detection_probability: float
    gate: str
    matching: str
    true: FloatArray
    near: FloatArray
    every: FloatArray

    @classmethod
    def of(cls, key: tuple[float, float], reading: tuple[str, str], runs: list[Result]) -> Counts:
        """Counts of a reading in the runs of a scene, given by interval and p_d."""
        name = ", ".join(reading)
        counts = (np.array([run[f"{name}: {kind}"] for run in runs]) for kind in _KINDS)
        return cls(*key, *reading, *counts)

    @property
    def name(self) -> str:
        """The reading in words."""
        return (
            f"T {self.period:g} s, p_d {self.detection_probability:g}, "
            f"sigma {self.gate}, {self.matching}"
        )

    def place(self, time: float, earlier: bool = False) -> int:
        """Index of the last scan by a time (s); the first scan is after an interval, or at 0."""
        return int(time // self.period) - (0 if earlier else 1)

    def formed(self, counts: FloatArray, earlier: bool = False) -> list[Estimate]:
        """Means at the times of Fig. 9."""
        return [mean(counts[:, self.place(time, earlier)]) for time in TIMES]

    def at_least(self, number: int, earlier: bool = False) -> Estimate:
        """Share of the runs with at least this number of targets started within two minutes."""
        return _share_of_at_least(self.true[:, self.place(published.DURATION, earlier)], number)

    def distance(self, earlier: bool = False) -> float:
        """Root mean square difference from Fig. 9, tracks."""
        means = np.array([estimate.value for estimate in self.formed(self.true, earlier)])
        return float(np.sqrt(np.square(means - FORMED).mean()))


_KINDS = ("true", "near", "all")


def _share_of_at_least(counts: FloatArray, number: int) -> Estimate:
    return proportion(int(np.count_nonzero(counts >= number)), len(counts))


def reproduce(setting: Setting, scenes: Scenes | None = None) -> list[Part]:
    """The parts of its chapter, by default of all scenes."""
    scenes = cases() if scenes is None else scenes
    results = dict(zip(scenes, setting.results(run_hexagon, list(scenes.values())), strict=True))
    counts = [
        Counts.of(key, reading, runs) for key, runs in results.items() for reading in READINGS
    ]
    return [*_start_parts(counts), *_error_parts(results)]


def same_share() -> float:
    """Probability p of each target, started independently, with p^6 as published."""
    return float(published.ALL_SIX ** (1.0 / published.TARGETS))


def four_or_more(share: float) -> float:
    """Probability that four or more of six targets are started, each independently."""
    n = published.TARGETS
    return sum(math.comb(n, k) * share**k * (1.0 - share) ** (n - k) for k in range(4, n + 1))


def max_formed() -> float:
    """Maximum mean number of tracks, one per target, at the published P(all six)."""
    n = published.TARGETS
    return n * published.ALL_SIX + (n - 1) * (1.0 - published.ALL_SIX)


def closest(counts: Sequence[Counts], earlier: bool = False) -> Counts:
    """The reading whose means are nearest to Fig. 9."""
    return min(counts, key=lambda reading: reading.distance(earlier))


def _start_parts(counts: list[Counts]) -> list[Part]:
    nearest, shifted = closest(counts), closest(counts, earlier=True)
    agree = [reading.name for reading in counts if _within(published.ALL_SIX, reading.at_least(6))]
    certain = [reading for reading in counts if reading.at_least(4).value == 1.0]
    certain_in_main = [
        reading for reading in certain if (reading.period, reading.detection_probability) == MAIN
    ]
    share = same_share()
    return [
        "### Figs. 8 and 9: targets started",
        f"Six targets on a hexagon of {published.DISTANCE:g} m at {published.TARGET_SPEED:g} m/s, "
        f"a platform at {published.PLATFORM_SPEED:g} m/s round a square of "
        f"{published.SQUARE_SIDE:g} m, {published.CLUTTER} clutter points a scan (here Poisson) in "
        f"{published.MAX_RANGE / 1000:g} km, errors of 1.5 % and 1 degree, two minutes, no delay, "
        "6/10. Not said: p_d; T (8 s in the list, 12 s in the text); the targets' headings (here "
        "drawn in every run); where on the square the platform starts (here a corner, the square "
        "round the hexagon's centre); what sigma in Eq. 7 is (the range's, or the larger axis); "
        "which track gets a detection that several match (Step 3); when the first scan is (here "
        "after one interval, so that 72 s is the sixth of 12 s; else at 0: the seventh); when a "
        "target counts as started (here a track within 3 sigma of which it gave more than half of "
        "the hits; else any such track). *Off Fig. 9* is the root mean square difference of the "
        "five means from the published.",
        Table(
            "sequential_2014_starts",
            [
                Column("T, s", "g"),
                Column("p_d", "g"),
                Column("sigma"),
                Column("a detection goes to the"),
                Column("P(>= 4)", ".3f"),
                Column("P(all six)", ".3f"),
                Column("... any track", ".3f"),
                Column("... first scan at 0", ".3f"),
                *(Column(f"{time:g} s", ".2f") for time in TIMES),
                Column("all tracks, 120 s", ".2f"),
                Column("off Fig. 9", ".2f"),
            ],
            [_published_row(), *map(_row, counts)],
        ),
        f"The means of Fig. 9 are nearest to those of *{nearest.name}* (off by "
        f"{nearest.distance():.2f} tracks); with the first scan at 0 to those of *{shifted.name}* "
        f"({shifted.distance(earlier=True):.2f}). P(all six) = {published.ALL_SIX} lies in the "
        f"interval of: {'; '.join(agree) or 'none'}. Four or more are started in every run by "
        f"{len(certain)} of {len(counts)} readings; with T {MAIN[0]:g} s and p_d {MAIN[1]:g}: "
        f"{_listed(certain_in_main) or 'none'}. No reading "
        "was chosen by these figures.",
        "Where the nearest pair is matched first, an echo outside its target's gate starts a "
        "second track, which is nearer to the next echoes: the hits are divided between the two, "
        "and fewer targets are started by the seventh to ninth scans. Where the oldest track is "
        "served first, that track continues.",
        "The published figures are inconsistent. If the targets are started independently, "
        f"P(all six) = {published.ALL_SIX} means {share:.3f} for each, and P(>= 4) = "
        f"{four_or_more(share):.3f}: that four or more be started in all of {published.RUNS} runs "
        f"then has the probability {four_or_more(share) ** published.RUNS:.1g}. Whatever the "
        f"dependence, P(all six) = {published.ALL_SIX} allows {max_formed():.2f} started targets "
        "on average, not the 5.8 and 6.0 of Fig. 9, which therefore counts something else, such "
        "as all tracks.",
        _starts_picture(counts),
    ]


def _listed(readings: Sequence[Counts]) -> str:
    return "; ".join(f"sigma {reading.gate}, {reading.matching}" for reading in readings)


def _within(value: float, interval: Estimate) -> bool:
    return interval.low <= value <= interval.high


def _published_row() -> list[Any]:
    return [
        "published",
        "-",
        "-",
        "-",
        published.FOUR_OR_MORE,
        published.ALL_SIX,
        "-",
        "-",
        *FORMED,
        "-",
        "-",
    ]


def _row(reading: Counts) -> list[Any]:
    last = reading.place(published.DURATION)
    return [
        reading.period,
        reading.detection_probability,
        reading.gate,
        reading.matching,
        reading.at_least(4),
        reading.at_least(6),
        _share_of_at_least(reading.near[:, last], 6),
        reading.at_least(6, earlier=True),
        *reading.formed(reading.true),
        mean(reading.every[:, last]),
        reading.distance(),
    ]


def _starts_picture(counts: list[Counts]) -> Picture:
    shown = [
        reading for reading in counts if (reading.period, reading.detection_probability) == MAIN
    ]

    def draw(figure: Any) -> None:
        left, right = figure.subplots(1, 2)
        numbers = range(1, published.TARGETS + 1)
        for reading in shown:
            style = {
                "color": f"C{list(MATCHINGS).index(reading.matching)}",
                "linestyle": "-" if reading.gate == DEFAULT_READING[0] else "--",
                "marker": ".",
                "label": f"{reading.matching}, {reading.gate}",
            }
            left.plot(numbers, [reading.at_least(k).value for k in numbers], **style)
            right.plot(TIMES, [point.value for point in reading.formed(reading.true)], **style)
        marks = {"color": "k", "marker": "x", "ms": 9, "mew": 2, "label": "published"}
        left.plot([4, 6], [published.FOUR_OR_MORE, published.ALL_SIX], linestyle="", **marks)
        right.plot(TIMES, FORMED, linestyle=":", **marks)
        left.set(xlabel="targets", ylabel="share of runs", title="At least so many are started")
        right.set(xlabel="time, s", ylabel="targets", title="Started by a time, mean")
        for axis in (left, right):
            axis.set_ylim(bottom=0.0)
            axis.grid(alpha=0.3)
        right.legend(fontsize=8)

    return Picture(
        "sequential_2014_figures_8_9",
        f"Figs. 8 and 9 of Sequential 2014, T = {MAIN[0]:g} s and p_d = {MAIN[1]:g}, by who gets a "
        "detection that several tracks match and by sigma",
        draw,
    )


def min_speed_error(hits: int, period: float) -> float:
    """Minimum mean absolute speed error (m/s), without bias, from hits in successive scans.

    It follows from the Cramer-Rao bound of the velocity component along the line of sight, the
    smaller component, at the targets' distance.
    """
    positions = np.tile([published.DISTANCE, 0.0], (hits, 1))
    times = np.arange(hits) * period
    sensor = case(period, ASSUMED).sensor
    bound = cramer_rao(positions, times, np.zeros(2), sensor, times[-1])
    return float(np.sqrt(2.0 / np.pi * min(bound[1, 1], bound[3, 3])))


def _error_parts(results: dict[tuple[float, float], list[Result]]) -> list[Part]:
    rows: list[list[Any]] = []
    for name, (position, speed, angle) in published.SEQUENTIAL_TABLE_1.items():
        rows.append(["published", ESTIMATORS[name], position, "-", speed, "-", "-", "-", angle])
    for (period, p_d), runs in results.items():
        rows += [
            [f"T {period:g} s, p_d {p_d:g}", ESTIMATORS[name], *_figures(_stacked(runs, name, 4))]
            for name in ESTIMATORS
        ]
        rows.append([f"T {period:g} s, p_d {p_d:g}", "Cramer-Rao bound", *_bounds(runs)])
    pure = np.concatenate([_stacked(runs, "bound", 3)[:, 2] for runs in results.values()])
    period, _ = MAIN
    six, ten = (min_speed_error(hits, period) for hits in (6, published.SCANS))
    _, speed, angle = published.SEQUENTIAL_TABLE_1["least_squares"]
    across = published.TARGET_SPEED * math.sin(math.radians(angle))
    return [
        "### Table 1, Figs. 10 and 11: errors of the estimators",
        "The three estimators on the same hits: of each target's first track, with sigma that of "
        f"the range and the oldest track served first. {np.mean(pure):.2f} of these tracks have "
        "only hits of their target. The article prints least squares only (Eq. 11); its linear "
        "fitting is read as a straight line run along from the first hit to the last, its Kalman "
        "filter as begun by the first two hits. Nor does it say what is averaged; "
        "Fig. 10's caption has the length of the velocity's error, Table 1 an error of speed.",
        Table(
            "sequential_2014_table_1",
            [
                Column("scene"),
                Column("estimator"),
                Column("position, mean, m", ".1f"),
                Column("position, rms, m", ".1f"),
                Column("speed, mean difference, m/s", ".2f"),
                Column("speed, mean with sign, m/s", ".2f"),
                Column("velocity, mean length, m/s", ".2f"),
                Column("velocity, rms, m/s", ".2f"),
                Column("angle, mean, degrees", ".1f"),
            ],
            rows,
        ),
        f"The published {speed:g} m/s of least squares is out of reach of these errors, if it is "
        f"the mean size of the speed's error: without bias, six hits in six scans of {period:g} s "
        f"leave {six:.2f} m/s at least, ten in ten {ten:.2f} m/s (Cramer-Rao, Gaussian). A mean "
        "with its sign could be so small. If it is the length of the velocity's error, as the "
        "caption of Fig. 10 has it, it is inconsistent with "
        f"the {angle:g} degrees beside it, which alone are {across:.2f} m/s across "
        f"{published.TARGET_SPEED:g} m/s. The published Kalman filter errs by more than the "
        "targets' speed, so that a state at rest has a smaller error; a Kalman filter from two "
        "hits with little process noise equals least squares.",
        _errors_picture(results[MAIN]),
    ]


def _stacked(runs: list[Result], name: str, width: int) -> FloatArray:
    return np.concatenate([np.reshape(run[name], (-1, width)) for run in runs])


def _figures(errors: FloatArray) -> list[Estimate]:
    position, velocity, speed, angle = errors.T
    return [
        mean(position),
        root_mean_square(position),
        mean(np.abs(speed)),
        mean(speed),
        mean(velocity),
        root_mean_square(velocity),
        mean(angle),
    ]


def _bounds(runs: list[Result]) -> list[Any]:
    position, velocity = (root(mean(part)) for part in _stacked(runs, "bound", 3)[:, :2].T)
    return ["-", position.value, "-", "-", "-", velocity.value, "-"]


def _errors_picture(runs: list[Result]) -> Picture:
    def draw(figure: Any) -> None:
        axes = figure.subplots(1, 2)
        errors = {name: _stacked(runs, name, 4) for name in ESTIMATORS}
        for axis, place, top, text in (
            (axes[0], 1, 8.0, "length of the velocity's error, m/s"),
            (axes[1], 3, 90.0, "angle between the velocities, degrees"),
        ):
            bins = np.linspace(0.0, top, 33)
            for (name, label), line in zip(ESTIMATORS.items(), ("-", "-", "--"), strict=True):
                values = np.minimum(errors[name][:, place], top)
                weights = np.full(len(values), 1.0 / max(len(values), 1))
                axis.hist(values, bins, weights=weights, histtype="step", ls=line, label=label)
            value = published.SEQUENTIAL_TABLE_1["least_squares"][1 if place == 1 else 2]
            axis.axvline(value, color="k", ls=":", label=f"least squares, published: {value:g}")
            axis.set(xlabel=text, ylabel="share of tracks", title="the last bar: or more")
            axis.legend(fontsize=8)

    return Picture(
        "sequential_2014_figures_10_11",
        f"Figs. 10 and 11 of Sequential 2014, T = {MAIN[0]:g} s and p_d = {MAIN[1]:g}: errors of "
        "the velocity",
        draw,
    )
