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
"""The detector: sonar images to detections, with a stated number of those that do not stand.

Every image passes through the same stages: standardised by a profile over range, streaks taken
away; less what the past of each cell predicts; normalised by the ring around each cell; smoothed
over the extent of an echo; scaled by the past deviations of the cell; compared with a learned
threshold; the peaks above it are measured.
"""

from __future__ import annotations

import copy
import math
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from tsepm_ros.detector import cfar
from tsepm_ros.detector.background import MEMORY, PRIOR_IMAGES, SETTLED_IMAGES, Background
from tsepm_ros.detector.bright_lines import BrightLines
from tsepm_ros.detector.fixed_frame import FixedGrid, PosedCells
from tsepm_ros.detector.image import DetectorOptions, SonarImage
from tsepm_ros.detector.range_profile import (
    Image,
    Profile,
    above_black,
    standardised,
    without_streaks,
)
from tsepm_ros.detector.range_scale import RangeScale
from tsepm_ros.numerics.arrays import BoolArray, FloatArray, IntArray
from tsepm_ros.parameters import parameter_table
from tsepm_ros.tracker.scan import MIN_STANDING, Scan, wrap
from tsepm_ros.tracker.sensor import Coverage

SCALES = ((3, 5), (1, 1), (5, 15))
"""Bearings and ranges of an echo of unknown extent, the one to begin with first."""
TRIAL = 20
"""Pings after which one of the scales is chosen."""
SMALL_SCALE_SHARE = 0.85
"""Part of the most recurring detections with which a smaller scale is chosen."""
MIN_RECURRING = 0.5
"""Recurring detections a ping without which nothing is known of the extent."""
TRIALS = np.array([2.0, 4.0, 8.0])
"""False detections a ping at which recurring ones are counted, whatever number is stated: at a low
threshold walls and clutter recur at every scale."""
MIN_CELLS = 10.0
"""Independent cells of a scale that may be chosen, per false detection."""
KEPT_FROM = 10, 1.0
"""Images, and seconds that are looked at, after which the stated number is kept."""
LONGEST_PAUSE = 600.0
"""Longest step of the stamps that counts as time without an image, s."""
SAME_CELLS = 0.02
"""Relative change of their size up to which as many cells are the same as before."""
LEARNED_ANEW = (
    "the ranges or the bearings of an image differ from those of the image before: the detector "
    "begins to learn again; the coverage of the tracker changes with the second of these images"
)
BEGINS_AGAIN = (
    "the ranges or the bearings of the images changed {} times, each time before the stated number "
    "was kept, and the detector began to learn again: nothing is known of what stands. Do two "
    "settings of a sonar, or two sonars, alternate on one topic?"
)
RESCALED = (
    "at {:.3f} s, what stands lies at {:.2g} times its ranges in the images before: if the sonar's "
    "range was changed, to {:.2g} of that before, give the new ranges (image.near_range and "
    "far_range), as a picture does not state them; until then, positions are wrong by this factor"
)
AS_STATED = (
    "at {0:.3f} s, images no longer show that what stands lies at {3:.2g} times its ranges before"
)
YOUNG_BACKGROUND = 60, 2.0
"""Images, and times that the slowest target leaves its place, up to which the background removes
nothing: it flags."""
MIN_REMOVING_SHARE = 0.3
"""Share of the background from which on it is looked for what it removes."""
REMOVED_SHARE = 0.25
"""Part of the threshold by which the background lowers what it removes."""
OTHER_BACKGROUND_PERIOD = 4
"""Images of which the background that is not used is asked of one."""
CHANCE_SHARE = 0.15
"""Part of an image that a background of the ground may explain with poses that are wrong, as it is
sought where the image fits."""
MIN_BEARINGS = 3
"""Bearings of an image without which it has no background of the ground."""
MAX_DRAWN_BOXES = 0.5
"""Boxes from an echo to its centroid from which on another thing is measured."""
FULL_TURN_GAP = 2.5
"""Largest gap between the last and the first bearing of a full turn, in spacings."""
MEAN_OVER_DEVIATION = math.sqrt(math.pi / (4.0 - math.pi))
"""Of Rayleigh amplitudes, 1.91."""


Moved = Callable[[FloatArray], FloatArray]
"""Fractional cells (n, 2) of the image before to those of the same places in this one."""


class Stages(NamedTuple):
    """An image at its stages, (b, m) each, and the threshold of the smoothed one."""

    standardised: Image
    background: Image
    smoothed: Image
    threshold: float


class _Scale:
    """The stages from the background to the measured echoes, for one box of an echo.

    `cells` are those of the images; `leaves` is the time in which the slowest target leaves its
    place at each range, (m,), s; `wraps`: the last bearing is the neighbour of the first.
    """

    def __init__(
        self, box: cfar.Box, number: float, cells: PosedCells, leaves: FloatArray, wraps: bool
    ) -> None:
        self.box, self._images, self._best = box, 0, Background(cells, math.prod(box))
        self._leaves, self._number, self._wraps = leaves, number, wraps
        self._time = self._interval = self._passed = 0.0
        self._edge: deque[tuple[FloatArray, float]] = deque(maxlen=MEMORY)
        self.backgrounds = [self._best]
        self.threshold, self._plain = cfar.CfarThreshold(number), cfar.CfarThreshold(number)
        self.trials = [cfar.CfarThreshold(few) for few in TRIALS.tolist()]
        self.recurring = np.zeros(len(TRIALS))

    def detect(
        self,
        x: Image,
        defined: BoolArray,
        black: BoolArray,
        trial: bool,
        motion: Moved | None,
        time: float,
    ) -> tuple[cfar.Echoes, FloatArray, Stages]:
        """Echoes above what the past of each cell predicts; before that is known, all.

        With each, how far it stands: the share of the time with a detection at its place, 1 where
        the background takes the echo for what stands, nan where it is not known.
        """
        self._images, self._interval, self._time = self._images + 1, time - self._time, time
        self._passed = self._interval / float(self._leaves.min())
        asked, past = self._predict(x)
        of_ground = self._best is not self.backgrounds[0]
        self._follow(motion if of_ground else None, trial)
        y, ring, z = self._smoothed(x - past, defined)
        even = self._shown(self._best.scaled(z), defined, black)
        for each in asked:
            each.learn(x, z, defined, min(self._passed, 1.0 / cfar.MIN_LOOKS))
        peaks, cell = cfar.peaks(even, defined, self.box, self._wraps, self.threshold.kept)
        level, high, standing = self._compare(even, peaks, cell)
        found, standing = cell[high], standing[high]
        echoes = cfar.echoes(y, found, self.box, self._wraps)
        if of_ground:
            beside = cfar.beside_structure(x - past, past, found, self.box, self._wraps)
            standing[beside] = 1.0
        if self._removes():
            whole, _, w = self._smoothed(x, defined)
            shown = self._shown(w, defined, black)
            peaks, cell = cfar.peaks(shown, defined, self.box, self._wraps, self.threshold.kept)
            removed = self._removed(peaks, cell, (w - z)[tuple(cell.T)], found)
            standing = np.append(standing, np.ones(len(removed)))
            echoes = self._measured_whole(whole, found, removed, echoes)
        self._try(peaks, cell, self.trials if trial else [])
        return echoes, standing, Stages(x, ring + past, even, level)

    def _shown(self, z: Image, defined: BoolArray, black: BoolArray) -> Image:
        """Values, and 0 where the box of an echo is black: there is none."""
        if not black.any():
            return z
        lit = (defined & ~black).astype(np.float32)
        return np.asarray(z * cfar.over_boxes(np.maximum, lit, self.box, self._wraps))

    def _predict(self, x: Image) -> tuple[list[Background], Image]:
        """The backgrounds that learn an image, and what the best of them predicts of it."""
        asked = [
            each
            for each in self.backgrounds
            if each is self._best
            or each.images <= YOUNG_BACKGROUND[0]
            or self._images % OTHER_BACKGROUND_PERIOD == 0
        ]
        pasts = [each.expected(x) for each in asked]
        self._best = max(
            asked,
            key=lambda each: each.explained - CHANCE_SHARE * (each is not self.backgrounds[0]),
        )
        return asked, pasts[asked.index(self._best)]

    def _smoothed(self, x: Image, defined: BoolArray) -> tuple[Image, Image, Image]:
        """Values normalised by the ring around each cell, the ring, and these smoothed."""
        y, ring = cfar.normalised(x, defined, self._best.shadow, self.box, self._wraps)
        return y, ring, cfar.smoothed(y, self.box, self._wraps)

    def _compare(
        self, even: Image, peaks: cfar.Peaks, cell: IntArray
    ) -> tuple[float, BoolArray, FloatArray]:
        """The threshold, which peaks are above it, and how far each stands, (n,)."""
        background, leaves = self._best, self._leaves[cell[:, 1]]
        (looks, part), settled = (
            background.looks(tuple(cell.T)),
            background.images > SETTLED_IMAGES,
        )
        # What is still there stands only if a target would have left its place.
        first = not settled and self._passed > 1.0
        if not background.images or (first and self._images == 2):  # all is learned anew
            self.threshold.forget()
        new = settled & (looks < PRIOR_IMAGES)  # cells that came into view
        aside = (
            cfar.along_line(even, cfar.LINE_LIMITS[0] * peaks.median, cell, self.box)
            if first
            else new
        )
        level, standing = self.threshold.update(peaks, self._time, leaves, aside, first)
        self._edge.append((peaks.height[new], settled * part))
        high = peaks.height > level
        if new.any():  # these have no spread of their own
            high[new] = peaks.height[new] > cfar.edge_threshold(self._edge, self._number)
        # Looks are means over the cells of the grid: what is short of half an image is rounding.
        asked = np.minimum(leaves / max(self._interval, 1e-9), MEMORY)
        standing[settled & (looks < np.maximum(asked - 0.5, 0.5 * asked))] = np.nan
        return level, high, standing

    def _removes(self) -> bool:
        """Whether echoes that the background removes are looked for: they are flagged."""
        background = self._best
        return background.share > MIN_REMOVING_SHARE and (
            background.images <= YOUNG_BACKGROUND[0] or background.age <= YOUNG_BACKGROUND[1]
        )

    def _removed(
        self, peaks: cfar.Peaks, cell: IntArray, lowered: FloatArray | Image, found: IntArray
    ) -> IntArray:
        """Cells (k, 2) of the peaks that the background has lowered, away from those found."""
        least, _ = self._plain.update(peaks, self._time, self._leaves[cell[:, 1]])
        apart = np.abs(peaks.place[:, None] - found / (np.array(self.box) + 1.0)).max(axis=2)
        lower = (peaks.height > least) & (lowered > REMOVED_SHARE * least)
        return np.asarray(cell[lower & (apart >= 1.0).all(axis=1)])

    def _measured_whole(
        self, whole: Image, found: IntArray, removed: IntArray, own: cfar.Echoes
    ) -> cfar.Echoes:
        """Echoes as they are, but for those found where what stands would be measured."""
        echoes = cfar.echoes(whole, np.append(found, removed, 0), self.box, self._wraps)
        moved = np.abs(echoes.cell[: len(found)] - found) / np.array(self.box)
        drawn = np.flatnonzero(moved.max(axis=1, initial=0.0) > MAX_DRAWN_BOXES)
        for field, of_own in zip(echoes, own, strict=True):
            field[drawn] = of_own[drawn]
        return echoes

    def _try(self, peaks: cfar.Peaks, cell: IntArray, trials: Sequence[cfar.CfarThreshold]) -> None:
        """Count what recurs in this box, at the number of each trial."""
        for number, threshold in enumerate(trials):
            threshold.update(peaks, self._time, self._leaves[cell[:, 1]])
            self.recurring[number] += _distinct(threshold.evidence, cell)

    def _follow(self, moved: Moved | None, trial: bool) -> None:
        """Places of the images before as they lie in this one, where the sensor has moved."""
        if moved is None:
            return
        gate = np.array(self.box) + 1.0
        for threshold in (self.threshold, self._plain, *(self.trials if trial else ())):
            threshold.follow(lambda place: moved(place * gate) / gate)


class Detector:
    """Makes a scan of detections of each image; see `make_detector`.

    Attributes
    ----------
    measured : dict of str to float
        images; empty (images of which no cell has statistics: nothing but NaN, or one value);
        detections that do not stand, which the stated number is of, and standing ones, each a ping
        over the last `MEMORY` pings; pings_left_out of those that the threshold is learned of,
        since they have another statistic; independent_cells (peaks: the most detections that there
        could be); range_extent (m) and azimuth_extent (rad), stated or learned.
    notes : list of str
        What images show that is no echo, and that all is learned anew: each sentence once.
    stages : Stages or None
        Of the last image; None if it was empty.
    factor : float
        How far what stands lies, over its distance when the ranges were given; 1: no change is
        known.
    """

    def __init__(self, options: DetectorOptions, coverage: Coverage | None = None) -> None:
        self.options, self.coverage = options, coverage or Coverage()
        self.reset()

    def reset(self) -> None:
        """Forget all images."""
        self.measured: dict[str, float] = {"images": 0, "empty": 0}
        self.notes: list[str] = []
        self.stages: Stages | None = None
        self.factor, self._leaps = 1.0, False
        self._axes, self._begin, self._beginnings = np.zeros(6), 0, 0
        self._since = self._time = self._stamp = 0.0
        self._profile: Profile | None = None
        self._grid: PosedCells
        self._displaced = np.zeros(3)
        self._bright, self._scales = BrightLines(0, 0), list[_Scale]()

    def process(self, image: SonarImage) -> Scan:
        """Detections of an image.

        Parameters
        ----------
        image : SonarImage

        Returns
        -------
        Scan
            With `range_std`, `azimuth_std` and the features intensity (dB above the background),
            range_width, azimuth_width and standing. Empty if no cell of the image has statistics.

            standing is how much of the echo the past of its place predicts, 0 (nothing) to 1 (all):
            the share of the time with an echo there, or 1 where the background explains it. The
            time is twice that in which a target of `slowest_speed` leaves the place, at least five
            images; nan: not known, since the place was not looked at for half of it. From
            `MIN_STANDING` on it stands.

        Raises
        ------
        ValueError
            If no cell of the image is in the coverage.
        """
        spacing = self._prepare(image)
        self._follow_clock(image.stamp)
        covered = self.coverage.covers(
            image.range, image.azimuth[:, None], 0.5 * spacing[1], 0.5 * spacing[0]
        )
        if not covered.any():
            raise ValueError(
                "no cell of the image is in the coverage, which min_range, max_range, azimuth_min "
                f"and azimuth_max limit: {self.coverage}"
            )
        if not image.states_ranges:
            self._compare_ranges(image)
        self._say(self._bright.add(image.intensity, image.azimuth, image.range, covered))
        there = np.isfinite(image.intensity) & covered
        there &= ~(self._bright.bearings[:, None] | self._bright.ranges)
        values = image.intensity if there.all() else np.where(there, image.intensity, 0.0)
        scaled = np.asarray(
            values / (max(float(values.max()), -float(values.min())) or 1.0), np.float32
        )
        amplitude, black = above_black(scaled, there, int(self.measured["images"]))
        self._profile, x, defined = standardised(self._profile, amplitude, there)
        x = without_streaks(x, defined, self._wraps)
        moved, trial = self._moved(image, x, spacing), len(self._scales) > 1
        tried = [
            scale.detect(x, defined, black, trial, moved, self._time) for scale in self._scales
        ]
        scale, (echoes, standing, stages) = [*zip(self._scales, tried, strict=True)][self._best()]
        # Peaks of one thing are measured as one echo: the highest counts.
        first = np.sort(np.unique(echoes.cell @ (1.0, 1.0j), return_index=True)[1])
        echoes, standing = cfar.Echoes(*(field[first] for field in echoes)), standing[first]
        self.stages = stages if defined.any() else None
        self._measure(scale, standing, spacing)
        if self.measured["images"] - self._begin >= TRIAL:
            self._scales = [scale]
        return _scan_of(image, echoes, standing)

    def _measure(self, scale: _Scale, standing: FloatArray, spacing: tuple[float, float]) -> None:
        """Count an image and its detections."""
        images = int(self.measured["images"]) + 1
        rate = 1.0 / min(images, MEMORY)
        stand = int(np.count_nonzero(standing >= MIN_STANDING))
        self.measured = {
            "images": images,
            "empty": self.measured["empty"] + (self.stages is None),
            **{
                name: (1.0 - rate) * self.measured.get(name, 0.0) + rate * number
                for name, number in (("detections", len(standing) - stand), ("standing", stand))
            },
            "pings_left_out": scale.threshold.left_out,
            "independent_cells": scale.threshold.cells,
            "range_extent": scale.box[1] * spacing[1],
            "azimuth_extent": scale.box[0] * spacing[0],
        }

    def _moved(self, image: SonarImage, x: Image, spacing: tuple[float, float]) -> Moved | None:
        """Where cells of the image before are in this one, once the sensor has moved.

        From then on there is a second background, on a grid of the fixed frame. The one that
        predicts more is used, since poses may be wrong.
        """
        pose = np.broadcast_to(np.asarray(image.sensor_pose, float), (len(image.azimuth), 3))
        grid = self._grid
        if not isinstance(grid, FixedGrid):
            change = pose - grid.pose
            turned, gone = np.abs(wrap(change[:, 2])).max(), np.abs(change[:, :2]).max()
            if (turned <= spacing[0] and gone <= spacing[1]) or len(pose) < MIN_BEARINGS:
                return None
            self._grid = grid = FixedGrid(image.azimuth, image.range)
            for scale in self._scales:
                scale.backgrounds.append(Background(grid))
        before = copy.copy(grid)
        self._displaced = self._scales[0].backgrounds[1].displaced(x, pose, self._displaced)
        grid.look(pose + self._displaced)
        return lambda cells: grid.cells(before.places(cells))

    def _compare_ranges(self, image: SonarImage) -> None:
        """Say it where what stands lies at other ranges than before."""
        before, self.factor = self.factor, self._scale.add(image)
        if self.factor != before:
            figures = image.stamp, self.factor, 1.0 / self.factor, before
            self._say([(AS_STATED if self.factor == 1.0 else RESCALED).format(*figures)])

    def kinds(self) -> str:
        """The numbers of both kinds of detections, in words."""
        moving, standing = (self.measured.get(name, 0.0) for name in ("detections", "standing"))
        said = f"{moving:.3g} detections that do not stand, {standing:.3g} that stand"
        if not self._keeps_number:
            said += "; the stated number is kept from image {} and {:g} s on".format(*KEPT_FROM)
        return said

    @property
    def begins_again(self) -> str:
        """A sentence while the learning begins anew again and again; else empty."""
        return BEGINS_AGAIN.format(self._beginnings) * (
            self._beginnings >= KEPT_FROM[0] and not self._keeps_number
        )

    @property
    def _keeps_number(self) -> bool:
        return self.measured["images"] - self._begin >= KEPT_FROM[0] and self._time >= KEPT_FROM[1]

    def _follow_clock(self, stamp: float) -> None:
        """Note the time of an image, s, also where the clock of the stamps is set.

        With one image that leaps no time passes; if the next one does too, the clock was set.
        """
        leaps = not 0.0 <= stamp - self._since - self._time <= LONGEST_PAUSE
        if leaps and self._leaps:
            self._since = self._stamp - self._time
        if self._leaps or not leaps:
            self._time = max(self._time, stamp - self._since)
        self._stamp, self._leaps = stamp, leaps

    def _say(self, sentences: list[str]) -> None:
        self.notes += [sentence for sentence in sentences if sentence not in self.notes]

    def _prepare(self, image: SonarImage) -> tuple[float, float]:
        """Spacing of the cells, rad and m.

        All is learned anew where the cells are others than before.
        """
        azimuth, distance = spacing = [
            float(np.median(np.abs(np.diff(axis)))) if len(axis) > 1 else 1.0
            for axis in (image.azimuth, image.range)
        ]
        axes = np.array([*image.intensity.shape, *spacing, image.azimuth[0], image.range[0]])
        if not self._are_known(axes):
            if self._axes.any():
                self._say([LEARNED_ANEW])
                self._beginnings = 0 if self._keeps_number else self._beginnings + 1
            self._axes, self._begin = axes, int(self.measured["images"])
            self._since, self._time = image.stamp, 0.0
            stated = self.options.azimuth_extent / azimuth, self.options.range_extent / distance
            boxes = [
                tuple(
                    round(float(np.clip(known or length, 1, max(cells // 4, 1))))
                    for known, length, cells in zip(stated, scale, axes, strict=False)
                )
                for scale in SCALES
            ]
            gap = 2 * math.pi - float(np.ptp(image.azimuth))
            self._wraps = len(image.azimuth) > 2 and gap < FULL_TURN_GAP * azimuth
            self._grid = PosedCells(image.azimuth, image.range)
            self._grid.pose[:] = np.asarray(image.sensor_pose)
            self._scales = [
                _Scale(
                    (box[0], box[1]),
                    self.options.false_detections_per_ping,
                    self._grid,
                    np.maximum((box[0] + 1) * azimuth * image.range, (box[1] + 1) * distance)
                    / self.options.slowest_speed,
                    self._wraps,
                )
                for box in dict.fromkeys(boxes)
            ]
            self._profile = None
            self._scale, self.factor = RangeScale(image.azimuth, image.range), 1.0
            self._bright = BrightLines(*image.intensity.shape)
        return azimuth, distance

    def _are_known(self, axes: FloatArray) -> bool:
        """Whether there are as many cells as before, of about the sizes, the first by a cell."""
        before = self._axes
        turned, moved = wrap(axes[4] - before[4]), axes[5] - before[5]
        return bool(
            np.array_equal(axes[:2], before[:2])
            and (np.abs(axes[2:4] - before[2:4]) <= SAME_CELLS * before[2:4]).all()
            and abs(turned) <= 1.01 * axes[2]
            and abs(moved) <= 1.01 * axes[3]
        )

    def _best(self) -> int:
        """The smallest scale at which about as many echoes recur as at any."""
        if len(self._scales) == 1:
            return 0
        few = np.array([[one.threshold.cells] for one in self._scales]) >= MIN_CELLS * TRIALS
        recurring = np.maximum([one.recurring for one in self._scales], 0.0) * few
        recurring = recurring[:, few.all(axis=0)] if few.all(axis=0).any() else recurring
        most = recurring.max(axis=0)
        if most.max() < MIN_RECURRING * (self.measured["images"] + 1 - self._begin):
            return 0
        share = (recurring / np.maximum(most, 1e-9)).mean(axis=1)
        good = np.flatnonzero(share >= SMALL_SCALE_SHARE * share.max())
        return int(min(good, key=lambda k: math.prod(self._scales[k].box)))


def make_detector(**options: Any) -> Detector:
    """Make a detector.

    Parameters
    ----------
    **options
        Fields of `DetectorOptions`, and of `Coverage`: cells beyond its limits are not used.

    Raises
    ------
    ValueError
        If an option is unknown or not allowed.
    """
    known = {
        row.name: group for group in (DetectorOptions, Coverage) for row in parameter_table(group)
    }
    for name in options:
        if name not in known:
            raise ValueError(f"a detector has no option {name!r}; it has {', '.join(known)}")
    limits = {name: options.pop(name) for name in [*options] if known[name] is Coverage}
    return Detector(DetectorOptions(**options), Coverage(**limits))


def _distinct(evidence: FloatArray, cell: IntArray) -> float:
    """Evidence of peaks at cells (n, 2), of which an echo of the largest scale counts one."""
    _, group = np.unique(cell // np.array(SCALES[-1]), axis=0, return_inverse=True)
    largest = np.zeros(group.max(initial=-1) + 1)
    np.maximum.at(largest, group, evidence)
    return float(largest.sum() + np.minimum(evidence, 0.0).sum())


def _scan_of(image: SonarImage, echoes: cfar.Echoes, standing: FloatArray) -> Scan:
    """Detections of echoes in cells."""
    fields: dict[str, Any] = {}
    features = {
        "intensity": 20.0 * np.log10(1.0 + echoes.excess / MEAN_OVER_DEVIATION),
        "standing": standing,
    }
    for name, axis, column in (("azimuth", image.azimuth, 0), ("range", image.range, 1)):
        # Beyond the last bearing of a turn is the first again.
        place, cells = echoes.cell[:, column] % len(axis), np.arange(len(axis) + 1)
        # The direction of a single bearing is not known: its error is a radian.
        step = np.abs(np.gradient(axis)) if len(axis) > 1 else np.full(1, math.sqrt(12.0))
        spacing = np.interp(place, cells[:-1], step)
        fields[name] = np.interp(place, cells, [*axis, 2.0 * axis[-1] - axis[-2:][0]])
        fields[f"{name}_std"] = echoes.deviation[:, column] * spacing
        features[f"{name}_width"] = echoes.width[:, column] * spacing
    row = np.rint(echoes.cell[:, 0]).astype(int) % len(image.azimuth)
    pose = np.asarray(image.sensor_pose)
    return Scan(
        stamp=image.stamp,
        **fields,
        time_offset=None if image.time_offset is None else image.time_offset[row],
        features=features,
        sensor_pose=pose if pose.ndim == 1 else pose[row],
    )
