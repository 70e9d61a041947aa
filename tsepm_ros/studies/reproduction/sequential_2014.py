"""Sequential 2014: Figs. 8-11, Table 1, and the methods that it finds unsuitable."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.studies.reproduction import published
from tsepm_ros.studies.reproduction.monte_carlo import (
    ASSUMED,
    CONVENTIONAL,
    DEFAULT_READING,
    MATCHED,
    MATCHINGS,
    hexagon_case,
    hexagon_cases,
    run_conventional,
    run_hexagon,
)
from tsepm_ros.studies.reproduction.report import (
    Cell,
    Line,
    Panel,
    Part,
    Picture,
    Result,
    Setting,
    Table,
)
from tsepm_ros.tools.evaluation.intervals import Estimate, mean, proportion, root, root_mean_square
from tsepm_ros.tools.evaluation.measures import cramer_rao
from tsepm_ros.tools.simulation import Scenario

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
    scenes = hexagon_cases() if scenes is None else scenes
    results = dict(zip(scenes, setting.results(run_hexagon, list(scenes.values())), strict=True))
    counts = [Counts.of(key, reading, runs) for key, runs in results.items() for reading in MATCHED]
    [others] = setting.results(run_conventional, [scenes[MAIN]])
    return [*_start_parts(counts), *_conventional_parts(others), *_error_parts(results)]


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
    shares = [reading.at_least(6) for reading in counts]
    agree = sum(share.low <= published.ALL_SIX <= share.high for share in shares)
    certain = [reading for reading in counts if reading.at_least(4).value == 1.0]
    share = same_share()
    return [
        "### Figs. 8 and 9: targets started",
        f"Six targets on a hexagon of {published.DISTANCE:g} m at {published.TARGET_SPEED:g} m/s, "
        f"a platform at {published.PLATFORM_SPEED:g} m/s round a square of "
        f"{published.SQUARE_SIDE:g} m, {published.CLUTTER} clutter points a scan (here Poisson) in "
        f"{published.MAX_RANGE / 1000:g} km, errors of 1.5 % and 1 degree, two minutes, no delay, "
        "6/10; headings drawn, the platform's square round the hexagon's centre. The readings "
        "differ in p_d, T, sigma in Eq. 7, the track that gets a detection that several tracks "
        "match, and the time of the first scan (here after one interval). A target is started by "
        "a true track. *Off Fig. 9* is the root mean square difference of the five means from the "
        "published.",
        Table(
            "sequential_2014_starts",
            STARTS,
            [PUBLISHED, *map(_row, counts)],
            [PUBLISHED, *(_row(one) for one in _in_main(counts) if one.gate == DEFAULT_READING[0])],
            bounds=False,
            hidden=("T, s", "p_d", "sigma", "... any track", "84 s", "96 s"),
        ),
        f"Shown are T = {MAIN[0]:g} s, p_d = {MAIN[1]:g}, sigma {DEFAULT_READING[0]}. "
        f"The means of Fig. 9 are nearest to those of *{nearest.name}* (off by "
        f"{nearest.distance():.2f} tracks); with the first scan at 0 to those of *{shifted.name}* "
        f"({shifted.distance(earlier=True):.2f}). P(all six) = {published.ALL_SIX} lies in the "
        f"interval of {agree} of {len(counts)} readings. Four or more are started "
        f"in every run by {len(certain)} of {len(counts)} readings.",
        f"P(all six) = {published.ALL_SIX} of independent targets means {share:.3f} for each, and "
        f"P(>= 4) = {four_or_more(share):.3f}: four or more in all of {published.RUNS} runs then "
        f"have the probability {four_or_more(share) ** published.RUNS:.1g}. Whatever the "
        f"dependence, it allows {max_formed():.2f} started targets on average.",
        _starts_picture(counts),
    ]


STARTS = {
    "T, s": "g",
    "p_d": "g",
    "sigma": "",
    "a detection goes to the": "",
    "P(>= 4)": ".3f",
    "P(all six)": ".3f",
    "... any track": ".3f",
    "... first scan at 0": ".3f",
    **{f"{time:g} s": ".2f" for time in TIMES},
    "all tracks, 120 s": ".2f",
    "off Fig. 9": ".2f",
}


def _in_main(readings: Sequence[Counts]) -> list[Counts]:
    """The readings in the main scene."""
    return [one for one in readings if (one.period, one.detection_probability) == MAIN]


def _conventional_parts(runs: list[Result]) -> list[Part]:
    rows: list[list[Cell]] = []
    for name in CONVENTIONAL:
        true, near, every = (
            np.array([run[f"{name}: {kind}"][-2] for run in runs]) for kind in _KINDS
        )
        errors = np.concatenate([run[name] for run in runs])
        figures = [_share_of_at_least(true, number) for number in (4, 6)]
        rows.append([name, *figures, mean(true), mean(near), mean(every), root_mean_square(errors)])
    period, p_d = MAIN
    return [
        "### The conventional methods in this scene",
        "The source says, without numbers: the heuristic and logic-based methods, the Hough "
        "transform and its modification cannot start the real tracks; Hough finds tracks with "
        "large errors by few cells and none by many. TSEPM 2018 calls the start from two points "
        f"inaccurate. T = {period:g} s, p_d = {p_d:g}, {len(runs)} runs, by 120 s.",
        Table(
            "sequential_2014_conventional",
            {
                "method": "",
                "P(>= 4)": ".3f",
                "P(all six)": ".3f",
                "targets with a true track": ".2f",
                "with any track": ".2f",
                "all tracks": ".1f",
                "position, rms, m": ".0f",
            },
            rows,
            bounds=False,
            hidden=("P(>= 4)", "P(all six)", "with any track"),
        ),
    ]


PUBLISHED: list[Cell] = [
    "-",
    "-",
    "-",
    "published",
    published.FOUR_OR_MORE,
    published.ALL_SIX,
    "-",
    "-",
    *FORMED,
    "-",
    "-",
]


def _row(reading: Counts) -> list[Cell]:
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
    numbers = range(1, published.TARGETS + 1)
    marks = {"color": "k", "marker": "x", "ms": 9, "mew": 2}
    left = [Line([4, 6], [published.FOUR_OR_MORE, published.ALL_SIX], style=marks | {"ls": ""})]
    right = [Line(TIMES, FORMED, "published", marks | {"ls": ":"})]
    for reading in _in_main(counts):
        style = {
            "color": f"C{list(MATCHINGS).index(reading.matching)}",
            "ls": "-" if reading.gate == DEFAULT_READING[0] else "--",
            "marker": ".",
        }
        formed = [point.value for point in reading.formed(reading.true)]
        left.append(Line(numbers, [reading.at_least(k).value for k in numbers], style=style))
        right.append(Line(TIMES, formed, f"{reading.matching}, {reading.gate}", style))
    settings = {"xlabel": "targets", "ylabel": "share of runs"}
    return Picture(
        "sequential_2014_figures_8_9",
        f"Figs. 8 and 9 of Sequential 2014, T = {MAIN[0]:g} s and p_d = {MAIN[1]:g}, by who gets a "
        "detection that several tracks match and by sigma",
        [
            Panel(left, settings | {"title": "At least so many are started", "ylim": (0.0, 1.05)}),
            Panel(right, {"xlabel": "time, s", "ylabel": "targets, mean", "ylim": (0.0, 6.5)}),
        ],
    )


def min_speed_error(hits: int, period: float) -> float:
    """Minimum mean absolute speed error (m/s), without bias, from hits in successive scans.

    It follows from the Cramer-Rao bound of the velocity component along the line of sight, the
    smaller component, at the targets' distance.
    """
    positions = np.tile([published.DISTANCE, 0.0], (hits, 1))
    times = np.arange(hits) * period
    sensor = hexagon_case(period, ASSUMED).sensor
    bound = cramer_rao(positions, times, np.zeros(2), sensor, times[-1])
    return float(np.sqrt(2.0 / np.pi * min(bound[1, 1], bound[3, 3])))


def _error_parts(results: dict[tuple[float, float], list[Result]]) -> list[Part]:
    rows: list[list[Cell]] = []
    for name, (position, speed, angle) in published.SEQUENTIAL_TABLE_1.items():
        rows.append(["published", ESTIMATORS[name], position, "-", speed, "-", "-", "-", angle])
    for (period, p_d), runs in results.items():
        rows += [
            [f"T {period:g} s, p_d {p_d:g}", ESTIMATORS[name], *_figures(_stacked(runs, name, 4))]
            for name in ESTIMATORS
        ]
        rows.append([f"T {period:g} s, p_d {p_d:g}", "Cramer-Rao bound", *_bounds(runs)])
    pure = np.concatenate([_stacked(runs, "bound", 3)[:, 2] for runs in results.values()])
    period, p_d = MAIN
    scene = f"T {period:g} s, p_d {p_d:g}"
    six, ten = (min_speed_error(hits, period) for hits in (6, published.SCANS))
    _, speed, angle = published.SEQUENTIAL_TABLE_1["least_squares"]
    across = published.TARGET_SPEED * math.sin(math.radians(angle))
    return [
        "### Table 1, Figs. 10 and 11: errors of the estimators",
        "The three estimators have the same hits: of each target's first track, with sigma that "
        f"of the range and the oldest track served first ({np.mean(pure):.2f} of these tracks have "
        "only its hits). Linear fitting is read as a straight line from the first hit to the "
        "last, the Kalman filter as begun by the first two hits.",
        Table(
            "sequential_2014_table_1",
            {
                "scene": "",
                "estimator": "",
                "position, mean, m": ".1f",
                "position, rms, m": ".1f",
                "speed, mean difference, m/s": ".2f",
                "speed, mean with sign, m/s": ".2f",
                "velocity, mean length, m/s": ".2f",
                "velocity, rms, m/s": ".2f",
                "angle, mean, degrees": ".1f",
            },
            rows,
            [
                ["here" if row[0] == scene else row[0], *row[1:]]
                for row in rows
                if row[0] in ("published", scene) and row[1] in ESTIMATORS.values()
            ],
            bounds=False,
            hidden=("position, rms, m", "velocity, rms, m/s"),
        ),
        f"Least mean size of the speed's error without bias (Cramer-Rao): {six:.2f} m/s by six "
        f"hits in six scans of {period:g} s, {ten:.2f} m/s by ten in ten; published are {speed:g}. "
        f"The {angle:g} degrees beside it alone are {across:.2f} m/s across "
        f"{published.TARGET_SPEED:g} m/s.",
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


def _bounds(runs: list[Result]) -> list[Cell]:
    position, velocity = (root(mean(part)) for part in _stacked(runs, "bound", 3)[:, :2].T)
    return ["-", position.value, "-", "-", "-", velocity.value, "-"]


def _errors_picture(runs: list[Result]) -> Picture:
    panels = []
    for place, top, text in (
        (1, 8.0, "length of the velocity's error, m/s"),
        (3, 90.0, "angle between the velocities, degrees"),
    ):
        bins, lines = np.linspace(0.0, top, 33), []
        for name, label in ESTIMATORS.items():
            values = np.minimum(_stacked(runs, name, 4)[:, place], top)
            share = np.histogram(values, bins)[0] / max(len(values), 1)
            lines.append(Line(bins[:-1], share, label, {"drawstyle": "steps-post"}))
        value = published.SEQUENTIAL_TABLE_1["least_squares"][1 if place == 1 else 2]
        title = f"dashed: least squares, published, {value:g}"
        settings = {"xlabel": text, "ylabel": "share of tracks", "title": title}
        panels.append(Panel(lines, settings, [value]))
    return Picture(
        "sequential_2014_figures_10_11",
        f"Figs. 10 and 11 of Sequential 2014, T = {MAIN[0]:g} s and p_d = {MAIN[1]:g}: errors of "
        "the velocity",
        panels,
    )
