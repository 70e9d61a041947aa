"""The detector: sonar images to detections, with the number of false ones kept.

Every image passes through the same stages: conditioned, normalised by its background, smoothed over
the extent of an echo, compared with a learned threshold; the peaks above it are measured.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from tsepm_ros.detector.cfar import (
    Box,
    CfarClutterMap,
    CfarThreshold,
    Echoes,
    Image,
    Modes,
    cfar_conditioned,
    cfar_echoes,
    cfar_normalised,
    cfar_peaks,
    cfar_smoothed,
)
from tsepm_ros.detector.image import DetectorOptions, SonarImage
from tsepm_ros.numerics.arrays import BoolArray
from tsepm_ros.parameters import parameter_table
from tsepm_ros.tracker.scan import Scan
from tsepm_ros.tracker.sensor import Coverage

SCALES = ((3, 5), (1, 1), (5, 15))
"""Bearings and ranges of an echo of unknown extent, the one to begin with first."""
TRIAL = 20
"""Pings after which one of the scales is chosen."""
ENOUGH = 0.85
"""Part of the most recurring detections with which a smaller scale is chosen."""
MIN_RECURRING = 0.5
"""Recurring detections a ping without which nothing is known of the extent."""
MIN_CELLS = 4.0
"""Independent cells of a scale that may be chosen, per false detection."""
SAME_CELLS = 0.02
"""Relative change of number, size and first range up to which cells are the same as before."""
FULL_TURN_GAP = 2.5
"""Largest gap between the last and the first bearing of a full turn, in spacings."""
MEAN_OVER_DEVIATION = math.sqrt(math.pi / (4.0 - math.pi))
"""Of Rayleigh amplitudes, 1.91."""


class Stages(NamedTuple):
    """An image at its stages, (b, m) each, and the threshold of the smoothed one."""

    conditioned: Image
    background: Image
    smoothed: Image
    threshold: float


class _DetectorScale:
    """The stages from the background to the measured echoes, for one box of an echo."""

    def __init__(self, box: Box, number: float) -> None:
        self.box, self.threshold = box, CfarThreshold(number)

    def detect(self, x: Image, defined: BoolArray, modes: Modes) -> tuple[Echoes, Stages]:
        y, background = cfar_normalised(x, defined, self.box, modes)
        z = cfar_smoothed(y, self.box, modes)
        peaks, cell = cfar_peaks(z, defined, self.box, modes, self.threshold.kept)
        level = self.threshold.update(peaks)
        echoes = cfar_echoes(y, cell[peaks.height > level], self.box, modes[0] == "wrap")
        return echoes, Stages(x, background, z, level)


class Detector:
    """Makes a scan of detections of each image; see `make_detector`.

    Attributes
    ----------
    measured : dict of str to float
        images; empty (images of which no cell has statistics: nothing but NaN, or one value);
        false_detections a ping, as the threshold was learned; independent_cells (peaks: the most
        detections that there could be); range_extent (m) and azimuth_extent (rad), stated or
        learned.
    stages : Stages or None
        Of the last image; None if it was empty.
    """

    def __init__(self, options: DetectorOptions, coverage: Coverage | None = None) -> None:
        self.options, self.coverage = options, coverage or Coverage()
        self.reset()

    def reset(self) -> None:
        """Forget all images."""
        self.measured: dict[str, float] = {"images": 0, "empty": 0}
        self.stages: Stages | None = None
        self._map = CfarClutterMap(self.options.clutter_map)
        self._axes: tuple[float, ...] = (0.0,) * 5
        self._scales: list[_DetectorScale] = []

    def process(self, image: SonarImage) -> Scan:
        """Detections of an image.

        Parameters
        ----------
        image : SonarImage

        Returns
        -------
        Scan
            With `range_std`, `azimuth_std` and the features intensity (dB above the background),
            range_width and azimuth_width. Empty if no cell of the image has statistics.

        Raises
        ------
        ValueError
            If no cell of the image is in the coverage.
        """
        spacing, turn = self._prepare(image)
        covered = self.coverage.covers(
            image.range, image.azimuth[:, None], 0.5 * spacing[1], 0.5 * spacing[0]
        )
        if not covered.any():
            raise ValueError(
                "no cell of the image is in the coverage, which min_range, max_range, azimuth_min "
                f"and azimuth_max limit: {self.coverage}"
            )
        there = np.isfinite(image.intensity) & covered
        values = np.where(there, image.intensity, 0.0)
        amplitude = np.asarray(values / (np.abs(values).max() or 1.0), np.float32)
        x, defined = cfar_conditioned(amplitude, there)
        x = self._map.subtracted(x, defined)
        modes: Modes = ("wrap" if turn else "constant", "constant")
        tried = [scale.detect(x, defined, modes) for scale in self._scales]
        best = self._best()
        scale, (echoes, stages) = self._scales[best], tried[best]
        self.stages = stages if defined.any() else None
        self.measured = {
            "images": self.measured["images"] + 1,
            "empty": self.measured["empty"] + (self.stages is None),
            "false_detections": scale.threshold.measured,
            "independent_cells": scale.threshold.cells,
            "range_extent": scale.box[1] * spacing[1],
            "azimuth_extent": scale.box[0] * spacing[0],
        }
        if self.measured["images"] - self._begin >= TRIAL:
            self._scales = [scale]
        return _scan_of_detector(image, echoes)

    def _prepare(self, image: SonarImage) -> tuple[tuple[float, float], bool]:
        """Spacing of the cells, rad and m, and whether the bearings are a full turn.

        All is learned anew where the cells are others than before.
        """
        azimuth, distance = (
            float(np.median(np.abs(np.diff(axis)))) if len(axis) > 1 else 1.0
            for axis in (image.azimuth, image.range)
        )
        axes = (*image.intensity.shape, azimuth, distance, float(image.range[0]))
        if not np.allclose(axes, self._axes, rtol=SAME_CELLS):
            stated = self.options.azimuth_extent / azimuth, self.options.range_extent / distance
            boxes = [
                tuple(
                    round(float(np.clip(known or length, 1, max(cells // 4, 1))))
                    for known, length, cells in zip(stated, scale, axes, strict=False)
                )
                for scale in SCALES
            ]
            number = self.options.false_detections_per_ping
            self._scales = [
                _DetectorScale((box[0], box[1]), number) for box in dict.fromkeys(boxes)
            ]
            self._axes, self._begin = axes, int(self.measured["images"])
        gap = 2 * math.pi - float(np.ptp(image.azimuth))
        return (azimuth, distance), len(image.azimuth) > 2 and gap < FULL_TURN_GAP * azimuth

    def _best(self) -> int:
        """The smallest scale at which about as many echoes recur as at any."""
        least = MIN_CELLS * self.options.false_detections_per_ping
        thresholds = [scale.threshold for scale in self._scales]
        recurring = [
            threshold.recurring if threshold.cells >= least else 0.0 for threshold in thresholds
        ]
        pings = self.measured["images"] + 1 - self._begin
        if max(recurring) < MIN_RECURRING * pings:
            return 0
        good = [k for k, number in enumerate(recurring) if number >= ENOUGH * max(recurring)]
        return min(good, key=lambda k: math.prod(self._scales[k].box))


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


def _scan_of_detector(image: SonarImage, echoes: Echoes) -> Scan:
    """Detections of echoes in cells."""
    fields: dict[str, Any] = {}
    features = {"intensity": 20.0 * np.log10(1.0 + echoes.excess / MEAN_OVER_DEVIATION)}
    for name, axis, column in (("azimuth", image.azimuth, 0), ("range", image.range, 1)):
        cell, cells = echoes.cell[:, column], np.arange(len(axis))
        step = np.abs(np.gradient(axis)) if len(axis) > 1 else np.ones(1)
        spacing = np.interp(cell, cells, step)
        fields[name] = np.interp(cell, cells, axis)
        fields[f"{name}_std"] = echoes.deviation[:, column] * spacing
        features[f"{name}_width"] = echoes.width[:, column] * spacing
    row = np.clip(np.rint(echoes.cell[:, 0]).astype(int), 0, len(image.azimuth) - 1)
    pose = np.asarray(image.sensor_pose)
    return Scan(
        stamp=image.stamp,
        **fields,
        time_offset=None if image.time_offset is None else image.time_offset[row],
        features=features,
        sensor_pose=pose if pose.ndim == 1 else pose[row],
    )
