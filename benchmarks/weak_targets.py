# Copyright 2026 tsepm_ros developers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""The detector of images and `score` beside a Bernoulli filter on thresholded cells, measured.

A point target of Swerling I appears in Rayleigh clutter. `sonar_detector` and `score` learn its law
and mean; the filter is given both, and that there is one target at most.
Both see the same images. A run counts as found if a track is within a metre of the target in 20
images. The filter's threshold is the one at which it has as many false starts as `score` in the
same images of clutter; after a false start it must fall by a factor of 20 before another counts.

    python benchmarks/weak_targets.py [--numbers 20 100 500] [--runs 40] [--images 1500]
"""

from __future__ import annotations

import argparse
import copy
import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

os.environ["OMP_NUM_THREADS"] = "1"
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import numpy as np
from contenders.bernoulli import RATIOS_DB, BernoulliFilter
from detector import CELLS, SENSOR, SETTLED, STEP, scenario
from result_tables import dashed as text
from result_tables import printed, write_table
from scipy.optimize import minimize

from tsepm_ros import SonarImage, make_detector, make_initiator
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.studies.reproduction.report import ReportLine, ReportPanel, ReportPicture
from tsepm_ros.tools.evaluation.intervals import (
    RESAMPLES,
    TAILS,
    IntervalEstimate,
    mean_count_interval,
    proportion_interval,
)
from tsepm_ros.tools.evaluation.result_files import ResultRunFile, add_result_file, result_code_key
from tsepm_ros.tools.simulation.images import ImageModel, ImageSimulator
from tsepm_ros.tools.simulation.scenario import TargetStrength

MAX_SPEED = 2.0
"""m/s."""
RATE = 100.0
"""Accepted false tracks of `score`, 1/h."""
SEEN = 20
"""Images with the target; one a second."""
NEAR = 1.0
"""m."""
REARMED = math.log(20.0)
FOUND = 0.9
MEAN_POWER = 1.0
"""Of the simulator's clutter."""
HERE = Path(__file__).parent


class Chain:
    """`sonar_detector` and `score` with default options; the sensor's P_D is where it begins."""

    def __init__(self, number: float, detection_probability: float) -> None:
        self.detector = make_detector(
            false_detections_per_ping=number, azimuth_extent=STEP[0], range_extent=STEP[1]
        )
        self.initiator = make_initiator(
            "score",
            sensor=replace(SENSOR, detection_probability=detection_probability),
            max_speed=MAX_SPEED,
            false_tracks_per_hour=RATE,
        )
        self.detections = 0

    def starts(self, image: SonarImage) -> list[FloatArray]:
        """Positions of the tracks that an image confirms."""
        scan = self.detector.process(image)
        self.detections += len(scan)
        return [t.state[0::2] for t in self.initiator.process(scan) if not t.revision]

    def held(self) -> list[FloatArray]:
        """Positions of the tracks held."""
        return [track.state[0::2] for track in self.initiator.current.sure]


def cells_above(image: SonarImage, threshold: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Ranges, azimuths and powers of the cells above a threshold."""
    power = np.square(image.intensity) / MEAN_POWER
    row, column = np.nonzero(power > threshold)
    return image.range[column], image.azimuth[row], power[row, column]


def filter_of(number: float) -> BernoulliFilter:
    """A filter that is given a mean number of false detections an image."""
    threshold = math.log(math.prod(CELLS) / number)
    return BernoulliFilter(SENSOR, STEP, threshold, MAX_SPEED)


def upward(odds: Sequence[float], threshold: float) -> int:
    """How often a sequence rises above a threshold, each time after it fell by `REARMED`."""
    starts, armed = 0, True
    for value in odds:
        if armed and value >= threshold:
            starts, armed = starts + 1, False
        armed = armed or value < threshold - REARMED
    return starts


def quiet(number: float, p_d: float, images: int, seed: int) -> dict[str, Any]:
    """Both on clutter alone: starts of the chain, and the filter's log odds by image."""
    chain, single = Chain(number, p_d), filter_of(number)
    starts, odds = 0, []
    noise = ImageSimulator(scenario(SETTLED + images), ImageModel(), seed)
    for k, (image, _) in enumerate(noise):
        new = len(chain.starts(image))
        single.process(image.stamp, *cells_above(image, single.threshold))
        if k >= SETTLED:
            starts += new
            odds.append(single.log_odds)
        elif k == SETTLED - 1:
            chain.detections = 0
    return {"starts": starts, "odds": odds, "detections": chain.detections / images}


def settled(number: float, p_d: float, seed: int) -> tuple[Chain, BernoulliFilter]:
    """Both after the images of clutter that come before each target."""
    chain, single = Chain(number, p_d), filter_of(number)
    for image, _ in ImageSimulator(scenario(SETTLED), ImageModel(), seed):
        chain.starts(image)
        single.process(image.stamp, *cells_above(image, single.threshold))
    return chain, single


def loud(before: tuple[Chain, BernoulliFilter], ratio_db: float, seed: list[int]) -> dict[str, Any]:
    """One target: whether the chain has a track near it, and the filter's odds where it has."""
    chain, single = copy.deepcopy(before)
    rng = np.random.default_rng(seed)
    range_, azimuth = rng.uniform(8.0, 33.0), rng.uniform(-0.8, 0.8)
    heading, speed = rng.uniform(-np.pi, np.pi), MAX_SPEED * math.sqrt(rng.uniform(0.0, 0.25))
    target = np.array([range_ * np.cos(azimuth), speed * np.cos(heading),
                       range_ * np.sin(azimuth), speed * np.sin(heading)])  # fmt: skip
    scene = scenario(SEEN, targets=(target,), target_strengths=(TargetStrength(ratio_db),))
    found, odds = False, -math.inf
    for image, truth in ImageSimulator(scene, ImageModel(), int(rng.integers(2**31))):
        image = replace(image, stamp=image.stamp + SETTLED)
        chain.starts(image)
        single.process(image.stamp, *cells_above(image, single.threshold))
        place = truth[0, 0::2]
        found |= any(np.hypot(*(each - place)) < NEAR for each in chain.held())
        if np.hypot(*(single.estimate()[0::2] - place)) < NEAR:
            odds = max(odds, single.log_odds)
    return {"found": bool(found), "odds": odds}


def ratio_at(found: FloatArray, share: float = FOUND) -> float:
    """Signal-to-clutter ratio, dB, at a share found, by a logistic law fitted to (runs, ratios)."""
    ratios = np.array(RATIOS_DB)
    mean, runs = found.mean(axis=0), len(found)

    def loss(law: FloatArray) -> float:
        logit = law[0] + np.exp(law[1]) * (ratios - 10.0)
        likelihood = mean * logit - np.logaddexp(0.0, logit)
        # A weak prior keeps the slope finite where all or none are found.
        return float(-runs * likelihood.sum() + 0.1 * law[1] ** 2 + 0.01 * law[0] ** 2)

    middle, slope = minimize(loss, [0.0, 0.0], method="Nelder-Mead").x
    return 10.0 + (math.log(share / (1.0 - share)) - middle) / math.exp(slope)


def ratios_with_interval(
    chain: FloatArray, single: FloatArray
) -> tuple[IntervalEstimate, IntervalEstimate, IntervalEstimate]:
    """Ratios (dB) at which each finds `FOUND`, and the chain's less the filter's."""
    rows = np.random.default_rng(0).integers(0, len(chain), (RESAMPLES // 4, len(chain)))
    values = np.array(
        [
            (one := ratio_at(chain[row]), other := ratio_at(single[row]), one - other)
            for row in (np.arange(len(chain)), *rows)
        ]
    )
    return tuple(
        IntervalEstimate(float(v[0]), *map(float, np.quantile(v[1:], TAILS))) for v in values.T
    )


def table(options: argparse.Namespace, panels: list[ReportPanel]) -> Iterator[Sequence[str]]:
    """A row per number of detections an image, and a panel with the shares found."""
    shares = [f"found at {ratio:g} dB" for ratio in RATIOS_DB]
    yield ["detections an image", "false tracks an hour, `score`", *shares,
           "dB at 0.9, `score`", "dB at 0.9, filter", "difference, dB"]  # fmt: skip
    for number in options.numbers:
        header = {"version": result_code_key(Path(__file__), HERE / "contenders" / "bernoulli.py"),
                  "number": number, "seed": options.seed, "p_d": options.p_d}  # fmt: skip
        clutter = ResultRunFile(options.out, ["quiet", f"{number:g}", f"{options.images}"], header)
        if not clutter.results:
            clutter.append(0, quiet(number, options.p_d, options.images, options.seed))
        noise = clutter.results[0]
        heights = np.unique(noise["odds"])
        threshold = next(
            h for h in (*heights, np.inf) if upward(noise["odds"], h) <= noise["starts"]
        )
        runs, before = ResultRunFile(options.out, ["loud", f"{number:g}"], header), None
        for run in [run for run in range(options.runs) if run not in runs.results]:
            before = before or settled(number, options.p_d, options.seed + 1)
            runs.append(run, [loud(before, ratio, [options.seed, run]) for ratio in RATIOS_DB])
        each = [runs.results[run] for run in range(options.runs)]
        chain = np.array([[one["found"] for one in run] for run in each], float)
        single = np.array([[one["odds"] >= threshold for one in run] for run in each], float)
        lines = [
            ReportLine(
                RATIOS_DB,
                [proportion_interval(int(column.sum()), len(found)) for column in found.T],
                name,
                {"fmt": mark},
            )
            for name, found, mark in (("score", chain, "o-"), ("Bernoulli", single, "s--"))
        ]
        title = {"title": f"{number:g} detections an image", "ylim": (0.0, 1.05)}
        panels.append(ReportPanel(lines, {**title, "xlabel": "dB", "ylabel": "share found"}))
        rate = mean_count_interval([noise["starts"]]) / (options.images / 3600.0)
        both = zip(chain.mean(axis=0), single.mean(axis=0), strict=True)
        one, other, less = ratios_with_interval(chain, single)
        yield [f"{noise['detections']:.0f}", text(rate, ".0f"),
               *(f"{mine:.2f}, {its:.2f}" for mine, its in both),
               text(one, ".1f"), text(other, ".1f"), f"{less:+.1f}"]  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--numbers", type=float, nargs="+", default=[20.0, 100.0, 500.0])
    parser.add_argument("--runs", type=int, default=40, help="targets of each ratio; default 40")
    parser.add_argument("--images", type=int, default=1500, help="of clutter; default 1500")
    parser.add_argument("--p-d", type=float, default=0.9, help="the sensor's; default 0.9")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("build/weak_targets"))
    parser.add_argument("--picture", type=Path, help="also draw the shares found")
    add_result_file(parser)
    options = parser.parse_args(arguments)
    panels: list[ReportPanel] = []
    done = printed(table(options, panels))
    if options.picture:
        caption = "Share of weak targets found in 20 images"
        ReportPicture(options.picture.stem, caption, panels, (12.0, 3.5)).written(
            options.picture.parent
        )
    numbers = " ".join(f"{number:g}" for number in options.numbers)
    line = (
        f"python benchmarks/weak_targets.py --numbers {numbers} --runs {options.runs} "
        f"--images {options.images}" + (f" --p-d {options.p_d:g}" if options.p_d != 0.9 else "")
    )
    write_table(options.result, line, done, seed=options.seed, runs=options.runs)


if __name__ == "__main__":
    main()
