"""Time of a ping with strengths, learning or plots over that without, in one run.

Two initiators of the method `score` process the same scans in turn, the order alternating: one of
them with an option, the other without. Processor time, of the scans after the first `WARM_UP`. The
strengths of targets are those of clutter, so that both have the same hypotheses but for chance, or
10 dB more. The ratio is that of the mean times, with the 95 % interval over blocks of scans, and
that of the medians, in which the rare simulation of a threshold's plan does not count.

    python benchmarks/option_cost.py [strengths|learning|all] [--scans 600] [--result FILE]
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import fixed_threads  # noqa: F401  # before numpy
import numpy as np

from tsepm_ros import SensorModel, make_initiator
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.tools.evaluation.intervals import Estimate, rms_ratio
from tsepm_ros.tools.evaluation.result_files import add_result, printed, write_table
from tsepm_ros.tools.simulation import Scenario, Simulator
from tsepm_ros.tools.simulation.scenario import ClutterStrength, TargetArea, TargetStrength

WARM_UP = 40
"""First scans, whose times do not count."""
BLOCK = 20
"""Scans of a block: times of neighbouring scans are alike."""
DISC = SensorModel(
    range_std_fraction=0.015, azimuth_std=np.deg2rad(1.0), max_range=9000.0, min_range=500.0
)
RADAR = SensorModel(range_std=6.0, azimuth_std=np.deg2rad(1.5), max_range=600.0)
Options = dict[str, Any]
GIVEN = {"clutter_density": "given", "detection_probability": "given"}
ESTIMATED = {"clutter_density": "estimated", "detection_probability": "estimated"}
PLAIN = {"plots": "off", "intensity": "off"}
CHOICES: dict[str, tuple[Options, Options]] = {
    "strengths": ({"intensity": "off"}, {"intensity": "auto"}),
    "learning": (PLAIN | GIVEN, PLAIN | ESTIMATED),
    "all": (PLAIN, {"plots": "auto", "intensity": "auto", "min_speed": 0.1}),
}
"""Options without and with: the strength of echoes; density and P_D learned; plots, fixed echoes
and strengths together."""
LIKE_CLUTTER = -30.0
"""Ratio of a target whose echoes are as strong as clutter's, dB."""


@dataclass(frozen=True)
class Sea:
    """A scene: a sensor, its clutter and its targets.

    Attributes
    ----------
    sensor : SensorModel
    period : float
        Time between scans, s.
    clutter : float
        Mean number of false detections a scan.
    targets : int
        Targets, which are held for nearly the whole run.
    """

    sensor: SensorModel
    period: float
    clutter: float
    targets: int

    def scenario(self, scans: int, ratio_db: float) -> Scenario:
        """The scene with strengths."""
        density = self.clutter / self.sensor.coverage_area
        far = 0.95 * self.sensor.max_range
        area = TargetArea(
            self.targets,
            (max(0.1 * far, self.sensor.min_range), far),
            (-np.pi, np.pi),
            0.05 * far / (scans * self.period),
            strength=TargetStrength(ratio_db),
        )
        return Scenario(
            name="sea",
            scans=scans,
            period=self.period,
            sensor=replace(self.sensor, clutter_density=density),
            areas=(area,),
            clutter_strength=ClutterStrength(),
        )


SEAS = {
    "9 detections": Sea(DISC, 12.0, 8.0, 1),
    "25 detections, ten of held targets": Sea(DISC, 12.0, 16.0, 10),
    "254 detections": Sea(DISC, 12.0, 253.0, 1),
    "4 detections, small radar": Sea(RADAR, 2.5, 3.0, 1),
}


def times_of(scenario: Scenario, seed: list[int], choice: str) -> FloatArray:
    """Processor time of each scan without an option and with it, (n, 2), s."""
    both = [
        make_initiator("score", sensor=scenario.sensor, **options) for options in CHOICES[choice]
    ]
    times = np.zeros((scenario.scans, 2))
    for index, simulated in enumerate(Simulator(scenario, seed)):
        for column in (0, 1) if index % 2 else (1, 0):
            begin = time.process_time()
            both[column].process(simulated.scan)
            times[index, column] = time.process_time() - begin
    return times[WARM_UP:]


def ratio_of(times: FloatArray) -> Estimate:
    """Ratio of the mean times (n, 2), with its interval over blocks."""
    blocks = times[: len(times) // BLOCK * BLOCK].reshape(-1, BLOCK, 2).sum(axis=1)
    return rms_ratio(*np.sqrt(blocks.T[::-1])).mapped(lambda root: root**2)


def table(options: argparse.Namespace) -> Iterator[Sequence[str]]:
    """The rows of the table."""
    yield "scene", "target", "ms without", "ms with", "ratio of means", "ratio of medians"
    without_strengths = options.option == "learning"
    for name, sea in SEAS.items():
        for ratio_db in (LIKE_CLUTTER,) if without_strengths else (LIKE_CLUTTER, 10.0):
            scenario = sea.scenario(options.scans, ratio_db)
            times = np.concatenate(
                [
                    times_of(scenario, [options.seed, repeat], options.option)
                    for repeat in range(options.repeats)
                ]
            )
            strength = "as clutter" if ratio_db == LIKE_CLUTTER else f"{ratio_db:g} dB"
            without, with_ = 1e3 * times.mean(axis=0)
            medians = np.divide(*np.median(times, axis=0)[::-1])
            ratios = f"{ratio_of(times):.2f}", f"{medians:.2f}"
            yield name, strength, f"{without:.2f}", f"{with_:.2f}", *ratios


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("option", nargs="?", choices=CHOICES, default="strengths")
    parser.add_argument("--scans", type=int, default=600)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--seed", type=int, default=1)
    add_result(parser)
    options = parser.parse_args(arguments)
    command = "python benchmarks/option_cost.py " + " ".join(arguments or sys.argv[1:])
    measured = printed(table(options))
    write_table(options.result, command, measured, seed=options.seed, runs=options.repeats)


if __name__ == "__main__":
    main()
