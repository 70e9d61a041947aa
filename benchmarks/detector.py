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
"""The detector of images, measured: what it must hold, a Markdown table for each part.

- false: false detections an image over the stated number, from image 61 on; by law, correlation and
  texture of the clutter, scale, fall of the reverberation, a step of the gain, and moving targets;
- detection: share of targets detected at 20 false an image, beside the same stages with the true
  background and quantile, the size stated to both;
- tracks: false tracks of the tracker behind it, at 100 an hour, with 95 % intervals;
- gain: share of weak targets with a track after 20 images, at 100 false tracks an hour, by false
  detections an image, with intensities and without;
- time: processor time of an image, and growth of memory;
- piles: detections in open water, and before two piles with shadows, over what their area gives;
  tracks of a diver, of piles and wall, and elsewhere;
- stops: a target that comes, stops for some images and leaves, and one that comes to its place;
- quay: tracks of a diver, of a quay and piles, and elsewhere, of a fixed and a drifting sonar;
- moving: a sonar that moves over a ground, with poses of several kinds;
- shades: things that shade and leave: false detections on their rays over their share;
- speeds: detections told as standing, by speed and by images a second;
- basin: a scanning sonar of 8 s a turn between walls: swimmers detected, and false detections;
- first: false detections over the stated number in images 10 to 40;
- pool, radar, clips, sweeps: real data (`--data FOLDER`, with aquascan, radar, didson and moving;
  not part of the package).

    python benchmarks/detector.py PART [--images 100] [--data FOLDER]
"""

from __future__ import annotations

import argparse
import collections
import csv
import itertools
import os
import resource
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

os.environ["OMP_NUM_THREADS"] = "1"
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import numpy as np
from result_tables import printed, write_table
from scipy import ndimage
from scipy.stats import chi2

from tsepm_ros import Scan, SensorModel, SonarImage, make_detector, make_initiator
from tsepm_ros.detector import cfar
from tsepm_ros.detector.detector import Detector
from tsepm_ros.tools.evaluation.result_files import add_result_file
from tsepm_ros.tools.simulation import Scenario
from tsepm_ros.tools.simulation.images import ImageModel, ImageSimulator
from tsepm_ros.tools.simulation.scenario import (
    ClutterStrength,
    ScenarioOwnShipMotion,
    TargetStrength,
)
from tsepm_ros.tools.terminal import terminal_progress
from tsepm_ros.tracker.scan import MIN_STANDING

Rows = Iterator[Sequence[str]]

NUMBERS = 5.0, 20.0, 100.0
SETTLED = 60
"""Images before the measured ones: the background is known then."""
CELLS = 128, 400
SENSOR = SensorModel(
    range_std=0.1, range_std_fraction=0.0, azimuth_std=0.01, min_range=1.0, max_range=41.0,
    azimuth_min=-1.0, azimuth_max=1.0,
)  # fmt: skip
STEP = 2.0 / CELLS[0], 40.0 / CELLS[1]
"""Spacing of the cells, rad and m."""
POOL_OPTIONS = {
    "score": {"max_speed": 1.5, "false_tracks_per_hour": 10.0},
    "kalman": {"max_speed": 1.5, "min_hits": 4, "window": 6, "misses": 4,
               "process_noise": 0.2},
}  # fmt: skip
CLIP_OPTIONS = {
    "score": {"max_speed": 2.0},
    "kalman": {"max_speed": 2.0, "min_hits": 5, "window": 7, "misses": 8,
               "process_noise": 0.2},
}  # fmt: skip
"""Options of the methods: swimmers rest, so that what stands starts tracks; the Kalman tracker has
the rule, misses, noise and extent that suit the scene best, see `curves.py`."""
TARGETS = ((15, 0.1, 3, 0.05), (20, 0.1, -5, -0.1), (30, 0, 10, 0), (25, -0.05, 0, 0.1),
           (34, 0.02, -12, 0.1))  # fmt: skip
K = ClutterStrength("k", 0.5)
CASES: dict[str, tuple[ImageModel, ClutterStrength | None]] = {
    "Rayleigh": (ImageModel(), None),
    "K, shape 0.5": (ImageModel(), K),
    "K, shape 2": (ImageModel(), ClutterStrength("k", 2.0)),
    "log-normal": (ImageModel(), ClutterStrength("log_normal", 1.0)),
    "gamma, 8 bits": (ImageModel(scale="gamma"), None),
    "logarithm, 8 bits": (ImageModel(scale="log"), None),
    "K 0.5, logarithm, 8 bits": (ImageModel(scale="log"), K),
    "correlated over 2.5 cells": (ImageModel(blur=(1.0, 1.0)), None),
    "correlated over 5 cells": (ImageModel(blur=(2.0, 2.0)), None),
    "texture over 8 x 20 cells": (ImageModel(texture=(8.0, 20.0)), ClutterStrength("k", 1.0)),
    "40 dB of fall": (ImageModel(fall_db=40.0), None),
    "40 dB of fall, logarithm": (ImageModel(fall_db=40.0, scale="log"), None),
}


def scenario(images: int, **fields: Any) -> Scenario:
    """A scene of the benchmark's sonar, an image a second."""
    return Scenario(name="images", scans=images, period=1.0, sensor=SENSOR, **fields)


def stated(size: Sequence[float]) -> dict[str, float]:
    """Extents of an echo of a size in cells."""
    return {"azimuth_extent": size[0] * STEP[0], "range_extent": size[1] * STEP[1]}


def places(scan: Scan) -> np.ndarray:
    """Positions of detections in the sensor frame, (n, 2)."""
    return scan.range[:, None] * np.stack([np.cos(scan.azimuth), np.sin(scan.azimuth)], axis=1)


def false_ones(pings: list[np.ndarray], near: float) -> list[int]:
    """Detections of each ping that are not in a place with echoes in over half of the pings."""
    seen = [np.zeros(len(ping)) for ping in pings]
    for other in pings:
        for ping, count in zip(pings, seen, strict=True):
            apart = np.linalg.norm(ping[:, None] - other, axis=2)
            count += apart.min(axis=1, initial=np.inf) < near
    return [int((count <= len(pings) / 2).sum()) for count in seen]


def ratio(
    images: Iterable[tuple[SonarImage, np.ndarray]],
    number: float,
    size: Sequence[float],
    target: Sequence[float] = (2.0, 2.0),
) -> tuple[float, float]:
    """False detections over the stated number, and independent cells."""
    detector, pings = make_detector(false_detections_per_ping=number, **stated(size)), []
    reach = np.maximum(np.maximum(size, target), 2.0) * STEP
    for k, (image, truth) in enumerate(images):
        scan = detector.process(image)
        own = np.zeros(len(scan), bool)
        for state in truth:
            bearing = np.arctan2(state[2], state[0])
            own |= (np.abs(scan.range - np.hypot(state[0], state[2])) < reach[1]) & (
                np.abs(scan.azimuth - bearing) < reach[0]
            )
        if k >= SETTLED:
            pings.append(places(scan)[~own])
    return float(np.mean(false_ones(pings, reach[1]))) / number, detector.measured[
        "independent_cells"
    ]


def false_table(options: argparse.Namespace) -> Rows:
    """False detections by the law of the clutter."""
    sizes = ((1, 1), (3, 7))
    yield ["clutter", *(f"{n:g} false, {s[0]} x {s[1]} cells" for s in sizes for n in NUMBERS)]
    images = SETTLED + options.images
    for name, (model, law) in CASES.items():
        drawn = list(ImageSimulator(scenario(images, clutter_strength=law), model, options.seed))
        yield [name, *cells(drawn, sizes)]
    for size in ((0.0, 0.0), (3.0, 7.0)):
        of_targets = {"target_strengths": (TargetStrength(20.0),) * len(TARGETS)}
        scene = scenario(images, targets=tuple(np.array(t, float) for t in TARGETS), **of_targets)
        drawn = list(ImageSimulator(scene, ImageModel(target_size=size), options.seed))
        yield [
            f"five targets of {size[0]:g} x {size[1]:g} cells, 20 dB",
            *cells(drawn, sizes, size),
        ]
    yield ["gain + 20 dB: images 5 to 10 after", *cells(stepped(options), sizes)]


def cells(
    drawn: list[Any], sizes: Sequence[Sequence[float]], target: Sequence[float] = (2.0, 2.0)
) -> Iterator[str]:
    """Entries of a row: the ratio, in brackets beyond a tenth of the independent cells."""
    for size in sizes:
        for number in NUMBERS:
            value, independent = ratio(drawn, number, size, target)
            yield f"{value:.2f}" if number <= independent / 10 else f"({value:.2f})"


def stepped(options: argparse.Namespace) -> list[Any]:
    """Images in which the gain rises by 20 dB five before the measured ones, in 8 bits."""
    drawn = ImageSimulator(scenario(SETTLED + 6), ImageModel(), options.seed)
    gains = np.where(np.arange(SETTLED + 6) < SETTLED - 5, 0.0, 20.0)
    return [
        (replace(image, intensity=np.clip(80 + 40 * np.log10(image.intensity) + 2 * gain, 0, 255)
                 .round().astype(np.uint8)), truth)
        for gain, (image, truth) in zip(gains, drawn, strict=True)
    ]  # fmt: skip


def detection_table(options: argparse.Namespace) -> Rows:
    """Detection probability beside that of the same stages with the true background."""
    yield ["target, cells", "dB", "detected", "with true background and quantile", "difference"]
    rng = np.random.default_rng(options.seed)
    number, images = 20.0, SETTLED + options.images
    for size in ((1, 1), (3, 7), (5, 15)):
        noise = ImageSimulator(scenario(options.images), ImageModel(), options.seed + 1)
        heights = [peaks_of(image, size)[0] for image, _ in noise]
        level = np.sort(np.concatenate(heights))[-int(number * len(heights))]
        for strength in (3.0, 6.0, 10.0, 15.0, 20.0):
            detector = make_detector(false_detections_per_ping=number, **stated(size))
            got = np.zeros((2, options.images))
            for k in range(images):
                # Four targets at new places in each image: none is learned.
                angle, distance = rng.uniform(-0.9, 0.9, 4), np.array([8.0, 16.0, 25.0, 35.0])
                state = np.zeros((4, 4))
                state[:, 0], state[:, 2] = distance * np.cos(angle), distance * np.sin(angle)
                scene = scenario(1, targets=tuple(state),
                                 target_strengths=(TargetStrength(strength),) * 4)  # fmt: skip
                model = ImageModel(target_size=size if size != (1, 1) else (0, 0))
                [(image, _)] = ImageSimulator(scene, model, options.seed + 100 + k)
                scan = detector.process(image)
                if k < SETTLED:
                    continue
                height, cell = peaks_of(image, size)
                cell = cell[height > level]
                true = image.azimuth[cell[:, 0]], image.range[cell[:, 1]]
                for row, (azimuth, range_) in enumerate(((scan.azimuth, scan.range), true)):
                    hit = (np.abs(azimuth - angle[:, None]) < max(size[0], 2) * STEP[0]) & (
                        np.abs(range_ - distance[:, None]) < max(size[1], 2) * STEP[1]
                    )
                    got[row, k - SETTLED] = hit.any(axis=1).mean()
            mean = got.mean(axis=1)
            row = f"{size[0]} x {size[1]}", f"{strength:g}", *(f"{share:.3f}" for share in mean)
            yield [*row, f"{mean[0] - mean[1]:+.3f}"]


def peaks_of(image: SonarImage, size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Heights and cells of the peaks with the true mean and deviation of Rayleigh amplitudes."""
    y = np.asarray((image.intensity - 0.5 * np.sqrt(np.pi)) / np.sqrt(1 - np.pi / 4), np.float32)
    peaks, cell = cfar.peaks(
        cfar.smoothed(y, size, False), np.ones(y.shape, bool), size, False, 10_000
    )
    return peaks.height, cell


def tracks_table(options: argparse.Namespace) -> Rows:
    """False tracks behind the detector, and what intensities gain."""
    yield ["scene", "images", "expected", "false tracks", "over the target, 95 %"]
    moving = ScenarioOwnShipMotion(speed=0.5, turn_rate=0.02)
    for name, own_ship, law in (
        ("fixed, Rayleigh", ScenarioOwnShipMotion(), None),
        ("fixed, K 0.5", ScenarioOwnShipMotion(), K),
        ("moving, Rayleigh", moving, None),
    ):
        scene = scenario(options.images, own_ship=own_ship, clutter_strength=law)
        images = (image for image, _ in ImageSimulator(scene, ImageModel(), options.seed))
        yield [name, *false_tracks(images, SENSOR, options.images, 1.0)]
    if options.data:
        yield ["BR24 rotations, shuffled and rolled", *shuffled(options)]


def false_tracks(
    images: Iterable[SonarImage], sensor: SensorModel, number: int, period: float
) -> list[str]:
    """Starts of tracks at 100 an hour, expected and found."""
    detector = make_detector(**stated((1, 1)))
    initiator = make_initiator("score", sensor=sensor, max_speed=2.0, false_tracks_per_hour=100.0)
    starts: set[int] = set()
    for image in terminal_progress(images, number, "tracks", "image"):
        starts |= {track.track_id for track in initiator.process(detector.process(image))}
    expected = 100.0 * number * period / 3600.0
    low, high = chi2.ppf(0.025, 2 * len(starts)) / 2, chi2.ppf(0.975, 2 * len(starts) + 2) / 2
    interval = f"{np.nan_to_num(low) / expected:.2f} to {high / expected:.2f}"
    text = f"{len(starts) / expected:.2f} ({interval})"
    return [f"{number}", f"{expected:.1f}", f"{len(starts)}", text]


def gain_table(options: argparse.Namespace) -> Rows:
    """What a low threshold with intensities gains over a high one."""
    yield ["false an image", "target, dB", "with intensity", "without", "runs"]
    target = np.array([15.0, 0.3, 3.0, 0.2])
    for strength in (2.0, 3.0):
        for number in (1.0, 5.0, 20.0, 60.0):
            held = np.zeros(2)
            for run in range(options.images):
                held += tracked(target, strength, number, options.seed + run)
            shares = (f"{share:.2f}" for share in held / options.images)
            yield [f"{number:g}", f"{strength:g}", *shares, f"{options.images}"]


def tracked(target: np.ndarray, strength: float, number: float, seed: int) -> np.ndarray:
    """Whether a target has a track after 20 images, with intensities and without, (2,)."""
    quiet, strengths = scenario(SETTLED), (TargetStrength(strength),)
    loud = scenario(20, targets=(target,), target_strengths=strengths)
    model = ImageModel(target_size=(2.0, 4.0))
    detector = make_detector(false_detections_per_ping=number, **stated((2, 4)))
    initiators = [
        make_initiator("score", sensor=SENSOR, max_speed=2.0, false_tracks_per_hour=100.0,
                       intensity=intensity) for intensity in ("auto", "off")
    ]  # fmt: skip
    held = np.zeros(2)
    drawn = [*ImageSimulator(quiet, model, seed), *ImageSimulator(loud, model, seed + 10_000)]
    for k, (image, truth) in enumerate(drawn):
        scan = detector.process(replace(image, stamp=float(k)))
        for row, initiator in enumerate(initiators):
            initiator.process(scan)
            for state in truth:
                held[row] = any(
                    np.hypot(t.state[0] - state[0], t.state[2] - state[2]) < 1.0
                    for t in initiator.current.sure
                )
    return held


def radar_images(folder: Path, number: int, seed: int) -> Iterator[SonarImage]:
    """Rotations of the radar in random order, each turned by a random angle."""
    echoes = np.load(folder / "br24_noise.npz")["image"]
    rng = np.random.default_rng(seed)
    azimuth = -2 * np.pi * np.arange(echoes.shape[1]) / echoes.shape[1]
    ranges = 10.0 * (np.arange(echoes.shape[2]) + 0.5)
    for k in range(number):
        image = np.roll(rng.choice(echoes), rng.integers(echoes.shape[1]), axis=0)
        yield SonarImage(2.52 * k, ranges, azimuth, image)


def shuffled(options: argparse.Namespace) -> list[str]:
    """False tracks on the radar's rotations."""
    sensor = SensorModel(range_std=10.0, range_std_fraction=0.0, azimuth_std=0.005, max_range=10240)
    number = options.images
    images = radar_images(options.data / "radar", number, options.seed)
    return false_tracks(images, sensor, number, 2.52)


def radar_table(options: argparse.Namespace) -> Rows:
    """False detections on the radar's noise, rotations in random order and turned."""
    yield ["false", "found over stated", "independent cells"]
    for number in NUMBERS:
        detector, counts = make_detector(false_detections_per_ping=number), []
        total = SETTLED + options.images
        for image in radar_images(options.data / "radar", total, options.seed):
            counts.append(len(detector.process(image)))
        found_ = np.mean(counts[SETTLED:]) / number
        yield [f"{number:g}", f"{found_:.2f}", f"{detector.measured['independent_cells']:g}"]


def pool_table(options: argparse.Namespace) -> Rows:
    """Labelled swimmers of the pool detected and held, and what else was detected and held."""
    yield ["starts by", "stated", "extent", "labels detected", "others per scan",
           "false per scan from 21 on", "labels held", "tracks elsewhere per minute"]  # fmt: skip
    known = {"range_extent": 0.6, "azimuth_extent": 15 * np.pi / 200}
    extents = ((known, "0.6 m x 13.5 degrees"), ({}, "learned"))
    for method, number, (extent, words) in itertools.product(
        options.method, options.stated or (3.0, 5.0, 8.0, 20.0), extents
    ):
        yield [f"`{method}`", f"{number:g}", words, *pool(options, number, extent, method)]


Labels = list[tuple[str, np.ndarray, str]]
"""Name, place (2,), m, and state of what is labelled in an image."""


def pool_images(folder: Path) -> Iterator[tuple[SonarImage, Labels]]:
    """Images of the pool, and its swimmers."""
    data, labels = np.load(folder / "ping360_pool.npz"), collections.defaultdict(list)
    with (folder / "swimmers.csv").open() as file:
        for row in csv.DictReader(file):
            bearing = float(row["bearing_gradian"]) * np.pi / 200
            place = float(row["sample"]) * 0.04 * np.array([np.cos(bearing), np.sin(bearing)])
            labels[int(row["scan"])].append((row["swimmer"], place, row["state"]))
    scans, last = zip(data["time_s"], data["bearing_gradian"], data["image"], strict=True), -1.0
    for k, (stamp, bearing, image) in enumerate(scans):
        last = max(float(stamp), last + 0.5)  # whole seconds are known
        ranges = (np.arange(image.shape[1]) + 0.5) * 0.04
        yield SonarImage(last, ranges, bearing * np.pi / 200, image), labels[k]


def pool_parts(number: float, extent: dict[str, float]) -> tuple[Detector, SensorModel]:
    """Detector and sensor of the pool."""
    sensor = SensorModel(
        range_std=0.3, range_std_fraction=0.0, azimuth_std=0.05, min_range=0.5, max_range=20.0,
        detection_probability=0.85, clutter_density=number / (np.pi / 2 * 20.0**2),
    )  # fmt: skip
    return make_detector(false_detections_per_ping=number, **extent), sensor


def pool(
    options: argparse.Namespace, number: float, extent: dict[str, float], method: str
) -> list[str]:
    """A row of the pool: labels within 1 m of a detection, held within 1.2 m."""
    detector, sensor = pool_parts(number, extent)
    given = POOL_OPTIONS.get(method, {})
    initiator = make_initiator(method, sensor=sensor, clutter_density=options.density, **given)
    found_, held, count = 0, 0, 0
    others, ids, near, stamps = [], set(), set(), []
    for image, labels in pool_images(options.data / "aquascan"):
        scan = detector.process(image)
        initiator.process(scan)
        stamps.append(image.stamp)
        tracks = {
            track.track_id: np.asarray(track.state)[[0, 2]] for track in initiator.current.sure
        }
        place, own = places(scan), np.zeros(len(scan), bool)
        ids |= set(tracks)
        for _, truth, _ in labels:
            apart = np.linalg.norm(place - truth, axis=1)
            own |= apart < 1.0
            close = {key for key, at in tracks.items() if np.linalg.norm(at - truth) < 1.2}
            near |= close
            count, found_, held = count + 1, found_ + bool((apart < 1.0).any()), held + bool(close)
        others.append(place[~own])
    false = false_ones(others, 1.0)[20:]
    minutes = (stamps[-1] - stamps[0]) / 60.0
    shares = f"{found_ / count:.3f}", f"{np.mean([len(o) for o in others]):.1f}"
    elsewhere = f"{len(ids - near) / minutes:.1f}"
    return [*shares, f"{np.mean(false):.1f}", f"{held / count:.3f}", elsewhere]


def time_table(options: argparse.Namespace) -> Rows:
    """Processor time of an image, and memory."""
    yield ["cells", "ms an image", "of 10 Hz", "memory grown over the second half, MB"]
    rng = np.random.default_rng(options.seed)
    for m, b in ((500, 256), (1000, 512)):
        drawn = [np.abs(rng.standard_normal((b, m)) + 1j * rng.standard_normal((b, m)))
                 .astype(np.float32) for _ in range(40)]  # fmt: skip
        detector = make_detector(**stated((3, 7)))
        axes = np.linspace(1.0, 41.0, m), np.linspace(-1.0, 1.0, b)
        begin, middle = time.process_time(), 0
        for k in range(options.images):
            detector.process(SonarImage(0.1 * k, *axes, drawn[7 * k % 40]))
            if k == options.images // 2:
                middle = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        ms = 1e3 * (time.process_time() - begin) / options.images
        grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - middle) / 1024
        yield [f"{m} x {b}", f"{ms:.1f}", f"{ms / 100.0:.2f}", f"{grown:.1f}"]


PILES = (20.0, 3.0), (22.0, -4.0)
"""Places of the piles, m."""
SHADOW = 10.0 ** (-8.0 / 20.0)
"""What a shadow leaves of an amplitude."""


def shaded(image: SonarImage, places: Iterable[Sequence[float]]) -> SonarImage:
    """An image with shadows of three bearings behind places."""
    values = np.array(image.intensity)
    for x, y in places:
        bearings = np.abs(image.azimuth - np.arctan2(y, x)) < 1.5 * STEP[0]
        values[np.ix_(bearings, image.range > np.hypot(x, y) + 1.0)] *= SHADOW
    return replace(image, intensity=values)


def piles_table(options: argparse.Namespace) -> Rows:
    """A wall, two piles and a diver, all with shadows, before a sonar that does not move."""
    yield ["false", "open water", "before the piles", "diver held", "its tracks",
           "on piles and wall", "elsewhere"]  # fmt: skip
    walls = tuple((x, y, x + 0.3, y, 25.0) for x, y in PILES)
    model = ImageModel(target_size=(3.0, 5.0), walls=(*walls, (34.0, -20.0, 30.0, 20.0, 25.0)))
    diver = (np.array((12.0, 0.02, -10.0, 0.09)),)
    scene = scenario(SETTLED + options.images, targets=diver)
    drawn = list(ImageSimulator(scene, model, options.seed))
    reach = np.array([np.hypot(*pile) - 1.0 for pile in PILES])
    for number in (5.0, 20.0):
        detector = make_detector(false_detections_per_ping=number, **stated((3, 5)))
        initiator = make_initiator("score", sensor=SENSOR, max_speed=2.0)
        counts, near, seen = np.zeros(2), collections.defaultdict(set), 0
        for k, (image, truth) in enumerate(drawn):
            own = truth[0, 0::2]
            scan = detector.process(shaded(image, (*PILES, own)))
            initiator.process(scan)
            for track in initiator.current:
                at = np.asarray(track.state)[[0, 2]]
                on = min(np.linalg.norm(at - pile) for pile in PILES) < 1.5 or at[0] > 28.0
                is_diver = np.linalg.norm(at - own) < 1.5
                near["diver" if is_diver else "fixed" if on else "elsewhere"].add(track.track_id)
                seen += is_diver and k >= SETTLED
            if k >= SETTLED:
                place = places(scan)
                free = place[np.linalg.norm(place - own, axis=1) > 2.0]
                bearing, distance = np.arctan2(*free.T[::-1]), np.linalg.norm(free, axis=1)
                apart = np.abs(bearing[:, None] - [np.arctan2(y, x) for x, y in PILES])
                before = (apart < 2.5 * STEP[0]) & (distance[:, None] < reach)
                counts += before.sum(), (distance < 18.0).sum()
        share = np.array([5 / CELLS[0] * (reach - 1.0).sum() / 40.0, 17.0 / 40.0])
        ratios = counts / (number * share * options.images)
        fixed = near["fixed"] - near["diver"]
        yield [f"{number:g}", *(f"{value:.2f}" for value in ratios[::-1]),
               f"{seen / options.images:.2f}", f"{len(near['diver'])}", f"{len(fixed)}",
               f"{len(near['elsewhere'] - near['diver'] - fixed)}"]  # fmt: skip


def stops_table(options: argparse.Namespace) -> Rows:
    """Nine targets of 3 x 7 cells that stop, and others that pass the places that they left."""
    yield ["stop, images", "detected, first 60", "last 60", "flagged, first 20", "after these",
           "others detected at the places", "elsewhere"]  # fmt: skip
    rng, rows = np.random.default_rng(options.seed), np.arange(10, 118, 12)
    stops_at = 100 + 25 * np.arange(len(rows))
    for stop in (60, 200, 400, 700):
        detector, end = make_detector(**stated((3, 7))), SETTLED + stop
        seen = np.zeros((2, end + 60, len(rows)))
        moved = 8 * np.r_[-SETTLED:0, np.zeros(stop, int), 1:31, -15:15]
        for k, after in enumerate(moved):
            [(image, _)] = ImageSimulator(scenario(1), ImageModel(), options.seed + k)
            columns = stops_at + after
            for row, column in zip(rows, columns, strict=True):
                if 5 < column < CELLS[1] - 5:
                    cell = np.s_[row - 1 : row + 2, column - 3 : column + 4]
                    image.intensity[cell] += rng.rayleigh(0.6, (3, 7))
            scan = detector.process(replace(image, stamp=float(k)))
            own = (np.abs(scan.azimuth[:, None] - image.azimuth[rows]) < 2 * STEP[0]) & (
                np.abs(scan.range[:, None] - 1.0 - (columns + 0.5) * STEP[1]) < 4 * STEP[1]
            )
            stands = scan.features["standing"] >= MIN_STANDING
            seen[:, k] = own.any(axis=0), own[stands].any(axis=0)
        parts = (
            (0, range(SETTLED, SETTLED + 60)),
            (0, range(end - min(60, stop - 60), end)),
            (1, range(SETTLED, SETTLED + 20)),
            (1, range(SETTLED + 20, end)),
            (0, [end + 45]),
            (0, [end + 41, end + 42, end + 48, end + 49]),
        )
        shares = [seen[kind, images].mean() if images else np.nan for kind, images in parts]
        yield [f"{stop}", *(f"{share:.2f}" for share in shares)]


OWN_SHIP = {"fixed": None, "drifts and turns": ScenarioOwnShipMotion(speed=0.05, turn_rate=0.0015)}
POSE_ERRORS = np.array([0.2, 0.2, np.radians(0.5)]), 0.99
"""Standard deviations, m and rad, and how much of an error the next image keeps."""


def quay_table(options: argparse.Namespace) -> Rows:
    """Five minutes before a quay and piles: a diver with a shadow who stops for 30 s."""
    yield ["own ship", "seed", "diver held", "its tracks", "on structure", "elsewhere"]
    quay = (34.0, -20.0, 30.0, 20.0, 25.0)
    model = ImageModel(walls=(*((x, y, x + 0.3, y, 25.0) for x, y in PILES), quay))
    for (name, own_ship), seed in itertools.product(OWN_SHIP.items(), range(1, 4)):
        scene = scenario(300, **({"own_ship": own_ship} if own_ship else {}))
        rng, error, near = np.random.default_rng(seed), np.zeros(3), collections.defaultdict(set)
        detector = make_detector(false_detections_per_ping=5.0, **stated((3, 5)))
        initiator = make_initiator(
            "score", sensor=SENSOR, max_speed=2.0, false_tracks_per_hour=10.0
        )
        held = seen = 0
        for k, (image, _) in enumerate(ImageSimulator(scene, model, seed)):
            pose = np.atleast_2d(image.sensor_pose)[0]
            swum = min(k, 120) + max(k - 150, 0)
            diver, values = np.array([12.0 + 0.02 * swum, 0.09 * swum - 10.0]), image.intensity
            for place in (diver, *PILES):
                x, y = np.array(place) - pose[:2]
                beams = np.abs(image.azimuth - (np.arctan2(y, x) - pose[2])) < 1.5 * STEP[0]
                behind = image.range > np.hypot(x, y) + 1.0
                if place is diver:
                    row = round((np.arctan2(y, x) - pose[2] - image.azimuth[0]) / STEP[0])
                    column = round((np.hypot(x, y) - image.range[0]) / STEP[1])
                    visible = 2 < row < CELLS[0] - 3 and 3 < column < CELLS[1] - 4
                    if visible:
                        cell = np.s_[row - 1 : row + 2, column - 2 : column + 3]
                        values[cell] += rng.rayleigh(2.0, (3, 5))
                values[np.ix_(beams, behind)] *= SHADOW
            if own_ship:
                fresh = np.sqrt(1.0 - POSE_ERRORS[1] ** 2) * rng.standard_normal(3)
                error = POSE_ERRORS[1] * error + fresh * POSE_ERRORS[0]
            initiator.process(detector.process(replace(image, sensor_pose=pose + error)))
            seen += visible
            for track in initiator.current:
                x, y = at = np.asarray(track.state)[[0, 2]]
                on_pile = min(np.linalg.norm(at - pile) for pile in PILES) < 1.5
                kind = "structure" if on_pile or abs(x + 0.1 * y - 32.0) < 2.0 else "elsewhere"
                kind = "diver" if np.linalg.norm(at - diver) < 1.5 else kind
                near[kind].add(track.track_id)
                held += kind == "diver" and visible
        near["structure"] -= near["diver"]
        near["elsewhere"] -= near["diver"] | near["structure"]
        numbers = (f"{len(near[kind])}" for kind in ("diver", "structure", "elsewhere"))
        yield [name, f"{seed}", f"{held / seen:.2f}", *numbers]


GROUND = 1200, 0.25
"""Cells of the ground, each way, and their size, m."""
STRENGTHS = 1.2, 2.5
"""Rises of the cells of targets, in amplitudes of the ground there."""
MOTIONS = {"fixed": (0.0, 0.0), "0.05 m an image": (0.05, 0.0), "0.5 m an image": (0.5, 0.0),
           "turns by 20 degrees": (0.0, 20.0), "0.5 m, and turns": (0.5, 20.0)}  # fmt: skip
POSES = {"exact": (0.0, 0.0, 0.0), "none": (np.inf, 0.0, 0.0), "slow errors": (0.5, 1.0, 0.998),
         "white errors": (0.5, 1.0, 0.0), "wrong by 5 m": (5.0, 0.0, 0.0)}  # fmt: skip
"""Errors, m and degrees, and how much of an error the next image keeps."""


def over_the_ground(
    motion: Sequence[float], images: int, seed: int, targets: bool = True
) -> Iterator[tuple[np.ndarray, SonarImage, list[tuple[float, float]]]]:
    """Images of a ground that changes with aspect, of a quay, and of targets: poses, and places."""
    rng, (n, size) = np.random.default_rng(seed), GROUND
    fields = [ndimage.gaussian_filter(rng.standard_normal((n, n)), 3.0) for _ in range(3)]
    always, ahead, abeam = (np.exp(1.2 * field / field.std()) for field in fields)
    azimuth, distance = (
        (np.arange(CELLS[0]) + 0.5) * STEP[0] - 1.0,
        1.0 + STEP[1] * (np.arange(CELLS[1]) + 0.5),
    )
    for k in range(images):
        turned = np.radians(motion[1]) * np.sin(2.0 * np.pi * k / 80.0)
        pose = np.array([motion[0] * (k - images / 2), 0.0, turned])
        bearing = turned + azimuth[:, None]
        x, y = pose[0] + np.cos(bearing) * distance, np.sin(bearing) * distance
        index = tuple(np.clip((at / size + n / 2).astype(int), 0, n - 1) for at in (x, y))
        along = 0.5 + 0.5 * np.cos(2.0 * bearing)
        power = 0.6 * always[index]
        power += 0.4 * (along * ahead[index] + (1.0 - along) * abeam[index])
        power[np.abs(x + 0.2 * y - 30.0) < 0.3] *= 16.0
        level = np.sqrt(power)
        amplitude, own = rng.rayleigh(size=CELLS) * level, []
        for rise in STRENGTHS * 2 if targets else ():
            row, column = (int(rng.integers(20, length - 20)) for length in CELLS)
            cell = np.s_[row - 1 : row + 2, column - 2 : column + 3]
            amplitude[cell] += rise * level[row, column] * rng.rayleigh(0.6, (3, 5))
            own.append((azimuth[row], distance[column]))
        yield pose, SonarImage(0.1 * k, distance, azimuth, amplitude), own


def moving_table(options: argparse.Namespace) -> Rows:
    """A sonar that moves, with poses of several kinds; at a threshold of 10 detections an image."""
    yield ["motion", "poses", *(f"detected, {rise:g}" for rise in STRENGTHS), "detections",
           "standing", "ms"]  # fmt: skip
    for motion, (name, poses) in itertools.product(MOTIONS, POSES.items()):
        seen, number, took = np.zeros((2, options.images)), np.zeros(2), time.process_time()
        detector, error = (
            make_detector(false_detections_per_ping=10.0, **stated((3, 5))),
            np.zeros(3),
        )
        rng, begin = np.random.default_rng(options.seed), SETTLED + 20
        drawn = over_the_ground(MOTIONS[motion], begin + options.images, options.seed)
        took = 0.0
        for k, (pose, image, own) in enumerate(drawn):
            fresh = rng.standard_normal(3) * [1.0, 1.0, np.radians(1.0)]
            scale, keeps = np.array([poses[0], poses[0], poses[1]]), poses[2]
            if np.isfinite(poses[0]):
                error = keeps * error + np.sqrt(1.0 - keeps**2) * fresh * scale
                image = replace(image, sensor_pose=pose + error)
            start = time.process_time()
            scan = detector.process(image)
            took += time.process_time() - start
            if k < begin:
                continue
            number += len(scan), np.count_nonzero(scan.features["standing"] >= MIN_STANDING)
            near = [
                bool(((np.abs(scan.azimuth - at[0]) < 2.5 * STEP[0])
                      & (np.abs(scan.range - at[1]) < 5 * STEP[1])).any())
                for at in own
            ]  # fmt: skip
            seen[:, k - begin] = np.reshape(near, (2, 2)).mean(axis=0)
        yield [motion, name, *(f"{share:.2f}" for share in seen.mean(axis=1)),
               *(f"{n / options.images:.1f}" for n in number),
               f"{1e3 * took / (begin + options.images):.1f}"]  # fmt: skip


def shades_table(options: argparse.Namespace) -> Rows:
    """Four things that shade four bearings each, stand and leave, from a sonar at rest or not.

    The last rows are those of a large bright thing, a fifth of the field of view, which leaves: the
    false detections where it was, and the share of the targets that are detected there.
    """
    yield ["ground", "own ship", "comes at, s", "stands, s", "false on the rays over their share",
           "elsewhere"]  # fmt: skip
    stays = ((SETTLED, 10), (SETTLED, 30), (SETTLED, 60), (0, 60))
    for ground, motion, (begin, stay) in itertools.product(
        ("even", "rough"), ("fixed", "0.05 m an image"), stays
    ):
        counts, share, after = np.zeros(2), 0.0, options.images
        for seed in range(options.seed, options.seed + 2):
            detector = make_detector(**stated((3, 5)))
            drawn = over_the_ground(MOTIONS[motion], begin + stay + after, seed)
            rng = np.random.default_rng(seed)
            for k, (pose, image, _) in enumerate(drawn):
                values = (
                    np.array(image.intensity) if ground == "rough" else rng.rayleigh(size=CELLS)
                )
                middle = np.array([MOTIONS[motion][0] * 0.5 * (begin - after), 0.0])
                on_ray, reach = np.zeros(CELLS, bool), np.zeros(CELLS, bool)
                for bearing in (-0.75, -0.25, 0.25, 0.75):
                    x, y = middle + 9.0 * np.array([np.cos(bearing), np.sin(bearing)]) - pose[:2]
                    beams = np.abs(image.azimuth - np.arctan2(y, x)) < 2.0 * STEP[0]
                    on_ray |= np.outer(beams, image.range > np.hypot(x, y) + 1.0)
                    reach |= np.outer(beams, np.abs(image.range - np.hypot(x, y)) < 0.3)
                if begin <= k < begin + stay:
                    values[on_ray] *= SHADOW
                    values[reach] *= 6.0
                scan = detector.process(
                    replace(image, stamp=float(k), intensity=values, sensor_pose=pose)
                )
                if k >= begin + stay:
                    row = np.rint((scan.azimuth - image.azimuth[0]) / STEP[0]).astype(int)
                    column = np.rint((scan.range - image.range[0]) / STEP[1]).astype(int)
                    ray = on_ray[np.clip(row, 0, CELLS[0] - 1), np.clip(column, 0, CELLS[1] - 1)]
                    moves = ~(scan.features["standing"] >= MIN_STANDING)
                    counts += np.count_nonzero(ray & moves), np.count_nonzero(~ray & moves)
                    share += float(on_ray.mean())
        number = 5.0 * np.array([share, 2 * after - share])
        yield [
            ground,
            motion,
            f"{begin}",
            f"{stay}",
            *(f"{ratio:.2f}" for ratio in counts / number),
        ]
    for stay in (60, 120):
        yield ["even", "fixed", "0", f"{stay}, large", *large_thing_leaves(options, stay)]


def large_thing_leaves(options: argparse.Namespace, stay: int) -> list[str]:
    """False detections where it was, over their share, and targets detected there."""
    rng, detector = np.random.default_rng(options.seed), make_detector(**stated((3, 5)))
    azimuth = (np.arange(CELLS[0]) + 0.5) * STEP[0] - 1.0
    distance = 1.0 + STEP[1] * (np.arange(CELLS[1]) + 0.5)
    false, seen = 0, 0
    for k in range(stay + options.images):
        values = rng.rayleigh(size=CELLS)
        if k < stay:
            values[50:76, 150:300] *= 4.0
        row, column = rng.integers(54, 72), rng.integers(160, 290)
        values[row - 1 : row + 2, column - 2 : column + 3] += rng.rayleigh(2.0, (3, 5))
        scan = detector.process(SonarImage(float(k), distance, azimuth, values))
        if k >= stay:
            own = (np.abs(scan.azimuth - azimuth[row]) < 2.5 * STEP[0]) & (
                np.abs(scan.range - distance[column]) < 5 * STEP[1]
            )
            there = (np.abs(scan.azimuth) < 0.22) & (np.abs(scan.range - 23.5) < 8.0)
            false += np.count_nonzero(there & ~own & ~(scan.features["standing"] >= MIN_STANDING))
            seen += own.any()
    share = 26 * 150 / np.prod(CELLS)
    return [
        f"{false / (5.0 * share * options.images):.2f}",
        f"{seen / options.images:.2f} detected",
    ]


RATES = 0.1, 0.5, 1.0, 4.0, 10.0, 40.0
"""Images a second."""
SPEEDS = 0.05, 0.1, 0.2, 0.5, 1.0, 2.0
"""Of targets, m/s."""


def speeds_table(options: argparse.Namespace) -> Rows:
    """Shares of the detections of a target in each direction that are told as standing, known."""
    yield ["speed, m/s", *(f"{rate:g} Hz" for rate in RATES)]
    azimuth, distance = np.linspace(-1.0, 1.0, 64), 1.0 + 0.1 * np.arange(200)
    for speed in SPEEDS:
        row = []
        for rate in RATES:
            rng = np.random.default_rng(options.seed)
            detector = make_detector(azimuth_extent=3 * 2.0 / 63, range_extent=0.5)
            stood, known, seen, number = 0, 0, 0, max(round(40.0 * rate), 60)
            for k in range(number):
                image, cells = rng.rayleigh(size=(64, 200)), []
                gone = speed * k / rate
                for start, beam in ((2.0, 10), (7.3, 32)):
                    cells.append((beam, 10 + 10.0 * ((start + gone) % 17.0)))
                cells.append((5.0 + (10.0 + gone / (8.0 * 2.0 / 63)) % 54.0, 150.0))
                for b, c in cells:
                    i, j = round(b), round(c)
                    image[i - 1 : i + 2, j - 2 : j + 3] += rng.rayleigh(3.0, (3, 5))
                scan = detector.process(SonarImage(k / rate, distance, azimuth, image))
                standing = scan.features["standing"]
                for b, c in cells:
                    own = (np.abs(scan.azimuth - (b * 2.0 / 63 - 1.0)) < 0.06) & (
                        np.abs(scan.range - 1.0 - 0.1 * c) < 0.5
                    )
                    if own.any() and k >= number // 2:
                        seen += 1
                        known += int(np.isfinite(standing[own]).any())
                        stood += int((standing[own] >= MIN_STANDING).any())
            row.append(f"{stood / max(known, 1):.2f} of {known / max(seen, 1):.2f}")
        yield [f"{speed:g}", *row]


def basin_table(options: argparse.Namespace) -> Rows:
    """Five swimmers between walls before a scanning sonar, 8 s a turn; 5 false are stated."""
    yield ["seed", "detected in turns 3 to 14", "in turns 15 to 30", "false over stated, 3 to 14",
           "15 to 30"]  # fmt: skip
    azimuth, ranges = 2.0 * np.pi * np.arange(400) / 400, 0.04 * (np.arange(500) + 0.5)
    extent = {"range_extent": 0.6, "azimuth_extent": 15 * np.pi / 200}
    for seed in range(options.seed, options.seed + 5):
        rng = np.random.default_rng(seed)
        detector = make_detector(**extent)
        with np.errstate(divide="ignore"):
            sides = np.array([9.0 / np.cos(azimuth), -7.0 / np.cos(azimuth),
                              6.0 / np.sin(azimuth), -5.0 / np.sin(azimuth)])  # fmt: skip
        wall = np.where(sides > 0.0, sides, np.inf).min(axis=0)
        level = np.where(ranges < wall[:, None], 1.0, 0.6)
        level[np.abs(ranges - wall[:, None]) < 0.25] = 5.0
        level[np.abs(ranges - 2.0 * wall[:, None]) < 0.25] = 2.0
        place = rng.uniform([-6.0, -4.0], [8.0, 5.0], (5, 2))
        heading, speed = rng.uniform(-np.pi, np.pi, 5), rng.uniform(0.3, 1.0, 5)
        seen, false = np.zeros((30, 5)), np.zeros(30)
        for k in range(30):
            image = rng.rayleigh(size=(400, 500)) * level
            for one in range(5):
                bearing = np.arctan2(place[one, 1], place[one, 0]) % (2.0 * np.pi)
                distance = np.hypot(*place[one])
                beams = np.abs((azimuth - bearing + np.pi) % (2.0 * np.pi) - np.pi) < 0.1
                cells = np.abs(ranges - distance) < 0.3
                image[np.ix_(beams, cells)] += rng.rayleigh(0.4, (beams.sum(), cells.sum()))
            scan = detector.process(SonarImage(8.0 * k, ranges, azimuth, image))
            at = places(scan)
            apart = np.linalg.norm(at[:, None] - place, axis=2)
            seen[k] = apart.min(axis=0, initial=np.inf) < 1.0
            beam = np.rint(scan.azimuth % (2 * np.pi) / (2 * np.pi) * 400).astype(int) % 400
            of_wall = (np.abs(scan.range - wall[beam]) < 1.0) | (
                np.abs(scan.range - 2.0 * wall[beam]) < 1.0
            )
            false[k] = np.count_nonzero(~of_wall & (apart.min(axis=1, initial=np.inf) > 1.5))
            heading += rng.normal(0.0, 0.4, 5)
            moved = place + 8.0 * speed[:, None] * np.stack([np.cos(heading), np.sin(heading)], 1)
            out = (moved < [-6.3, -4.3]).any(axis=1) | (moved > [8.3, 5.3]).any(axis=1)
            out |= np.hypot(*moved.T) < 1.0
            heading[out] += 2.5
            place = np.where(out[:, None], place + rng.uniform(-1.0, 1.0, (5, 2)), moved)
            place = np.clip(place, [-6.3, -4.3], [8.3, 5.3])
        yield [f"{seed}", f"{seen[2:14].mean():.2f}", f"{seen[14:].mean():.2f}",
               f"{false[2:14].mean() / 5.0:.2f}", f"{false[14:].mean() / 5.0:.2f}"]  # fmt: skip


def first_table(options: argparse.Namespace) -> Rows:
    """Detections not told as standing over the stated number, from image 10 on."""
    yield [
        "scene",
        *(f"{n:g} false, {part}" for n in (5.0, 20.0) for part in ("10 to 20", "20 to 40")),
    ]
    scenes: dict[str, list[SonarImage]] = {
        name: [image for image, _ in ImageSimulator(scenario(40, clutter_strength=law), model, 1)]
        for name, (model, law) in CASES.items()
        if name in ("Rayleigh", "K, shape 0.5", "texture over 8 x 20 cells")
    }
    model = ImageModel(walls=((34.0, -20.0, 30.0, 20.0, 25.0),))
    scenes["wall"] = [image for image, _ in ImageSimulator(scenario(40), model, options.seed)]
    for name, motion in MOTIONS.items():
        drawn = over_the_ground(motion, 40, options.seed, targets=False)
        scenes[f"rough ground, {name}"] = [replace(image, sensor_pose=p) for p, image, _ in drawn]
    for name in ("lamprey1", "lamprey3") if options.data else ():
        data = np.load(options.data / "didson" / f"{name}.npz")
        axes, count = (data["range_m"], data["azimuth_rad"]), len(data["image"])
        for start in range(0, count - 39, 60):
            part = range(start, min(start + 40, count))
            scenes[f"{name}, from image {start}"] = [
                SonarImage(float(data["time_s"][k]), *axes, data["image"][k]) for k in part
            ]
    for name, images in scenes.items():
        row = []
        for number in (5.0, 20.0):
            step = [abs(float(np.median(np.diff(a)))) for a in (images[0].azimuth, images[0].range)]
            detector = make_detector(
                false_detections_per_ping=number, azimuth_extent=3 * step[0],
                range_extent=5 * step[1],
            )  # fmt: skip
            counts = [
                np.count_nonzero(~(detector.process(image).features["standing"] >= MIN_STANDING))
                for image in images
            ]
            row += [np.mean(counts[9:20]) / number, np.mean(counts[20:]) / number]
        yield [name, *(f"{value:.2f}" for value in row)]


def sweeps_table(options: argparse.Namespace) -> Rows:
    """Radars of cars that drive: whether a following car and a standing bus are detected."""
    yield ["data, stated", "poses", "sweeps: . not detected, d detected, S as standing"]
    for (name, number), known in itertools.product(
        (("oxford_radar_11_coarse", 50.0), ("radiate_tiny_foggy_18", 50.0)), (False, True)
    ):
        data = np.load(options.data / "moving" / f"{name}.npz")
        times, pose = data["time_s"], np.array(data["pose"], float)
        pose[:, 2] = np.unwrap(pose[:, 2])
        detector = make_detector(
            false_detections_per_ping=number, range_extent=1.5, azimuth_extent=0.03
        )
        letters = ""
        for k, stamp in enumerate(times):
            pair = slice(k, k + 2) if k + 1 < len(times) else slice(k - 1, k + 1)
            rate = np.diff(pose[pair], axis=0)[0] / np.diff(times[pair])[0]
            poses = pose[k] + np.outer(data["beam_time_s"][k] - stamp, rate)
            axes = data["range_m"], data["azimuth_rad"], data["image"][k]
            scan = detector.process(
                SonarImage(float(stamp), *axes, sensor_pose=poses if known else None)
            )
            if "label_id" in data:
                label = data["label_xy_size_m"][k, list(data["label_id"]).index(1)]
                near = (
                    np.linalg.norm(places(scan) - label[:2], axis=1) < 0.5 * label[2:].max() + 1.0
                )
            else:  # a car follows
                near = (np.abs(scan.azimuth) > np.pi - 0.25) & (np.abs(scan.range - 11.5) < 4.5)
            stands = scan.features["standing"][near] >= MIN_STANDING
            letters += "." if not near.any() else "S" if stands.any() else "d"
        yield [f"{name}, {number:g}", "yes" if known else "no", letters]


def clips_table(options: argparse.Namespace) -> Rows:
    """Clips of an imaging sonar that does not move, from image 21 on; fish of the first."""
    yield ["starts by", "clip, stated", "not standing over stated", "all per image",
           "labels detected", "flagged", "labels held", "tracks on each fish",
           "other tracks"]  # fmt: skip
    for method, name, number in itertools.product(
        options.method, ("lamprey1", "lamprey3"), options.stated or (5.0, 20.0)
    ):
        row = clip(options.data / "didson", name, number, method)
        yield [f"`{method}`", f"{name}, {number:g}", *row]


def clip_images(folder: Path, name: str) -> Iterator[tuple[SonarImage, Labels]]:
    """Images of a clip, and the fish of lamprey1."""
    data, labels = np.load(folder / f"{name}.npz"), collections.defaultdict(list)
    azimuth, ranges = data["azimuth_rad"], data["range_m"]
    if name == "lamprey1":
        with (folder / f"{name}_fish.csv").open() as file:
            for row in csv.DictReader(file):
                bearing, distance = float(row["azimuth_rad"]), float(row["range_m"])
                place = distance * np.array([np.cos(bearing), np.sin(bearing)])
                labels[int(row["frame"])].append((row["fish"], place, "moving"))
    for k, (stamp, image) in enumerate(zip(data["time_s"], data["image"], strict=True)):
        yield SonarImage(float(stamp), ranges, azimuth, image), labels[k]


def clip_parts(first: SonarImage, number: float) -> tuple[Detector, SensorModel]:
    """Detector and sensor of a clip, by its first image."""
    azimuth, ranges = first.azimuth, first.range
    step = float(np.ptp(azimuth)) / (len(azimuth) - 1), float(np.ptp(ranges)) / (len(ranges) - 1)
    sensor = SensorModel(
        range_std=2 * step[1], range_std_fraction=0.0, azimuth_std=step[0],
        min_range=ranges[0], max_range=ranges[-1], azimuth_min=azimuth.min(),
        azimuth_max=azimuth.max(),
    )  # fmt: skip
    extent = {"azimuth_extent": 3 * step[0], "range_extent": 5 * step[1]}
    return make_detector(false_detections_per_ping=number, **extent), sensor


def clip(folder: Path, name: str, number: float, method: str) -> list[str]:
    """A row of a clip: fish of an own id each are A B C; a track is near within 0.25 m."""
    images = list(clip_images(folder, name))
    detector, sensor = clip_parts(images[0][0], number)
    step = sensor.azimuth_std, 0.5 * sensor.range_std
    initiator = make_initiator(method, sensor=sensor, **CLIP_OPTIONS.get(method, {}))
    counts, found_, ids, fish = [], np.zeros(3, int), set(), collections.defaultdict(set)
    total = 0
    for image, labels in images:
        scan = detector.process(image)
        initiator.process(scan)
        tracks = {track.track_id: np.asarray(track.state)[[0, 2]] for track in initiator.current}
        ids |= set(tracks)
        stands = scan.features["standing"] >= MIN_STANDING
        counts.append((np.sum(~stands), len(scan)))
        total += len(labels)
        for own, at, _ in labels:
            near = (np.abs(scan.azimuth - np.arctan2(*at[::-1])) < 3 * step[0]) & (
                np.abs(scan.range - np.hypot(*at)) < 5 * step[1]
            )
            close = {key for key, xy in tracks.items() if np.linalg.norm(xy - at) < 0.25}
            found_ += bool(near.any()), bool(near.any()) and stands[near].all(), bool(close)
            fish[own] |= close
    mean = np.mean(counts[20:], axis=0)
    shares = [f"{count} of {total}" for count in found_] if total else [""] * 3
    own_ids = ", ".join(f"{own} {len(fish[own])}" for own in sorted(fish))
    others = f"{len(ids - set().union(*fish.values()))}"
    return [f"{mean[0] / number:.2f}", f"{mean[1]:.0f}", *shares, own_ids, others]


PARTS = {
    "false": false_table,
    "detection": detection_table,
    "tracks": tracks_table,
    "gain": gain_table,
    "time": time_table,
    "pool": pool_table,
    "radar": radar_table,
    "piles": piles_table,
    "stops": stops_table,
    "quay": quay_table,
    "clips": clips_table,
    "moving": moving_table,
    "shades": shades_table,
    "speeds": speeds_table,
    "basin": basin_table,
    "first": first_table,
    "sweeps": sweeps_table,
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("part", choices=PARTS)
    parser.add_argument("--images", type=int, default=100, help="measured images; default 100")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--density", default="estimated", choices=("estimated", "given"))
    parser.add_argument("--data", type=Path, help="folder of the real data")
    parser.add_argument(
        "--method", nargs="+", default=["score"], help="of pool and clips; default score"
    )
    parser.add_argument("--stated", nargs="+", type=float, help="detections, of pool and clips")
    add_result_file(parser)
    options = parser.parse_args(arguments)
    if options.part in ("pool", "radar", "clips", "sweeps") and options.data is None:
        parser.error("real data need --data FOLDER")
    table = printed(PARTS[options.part](options))
    line = f"python benchmarks/detector.py {options.part}"
    if options.data:
        line += " --data FOLDER"
    if options.part in ("pool", "clips"):
        stated = [f"{number:g}" for number in options.stated or ()]
        line += f" --method {' '.join(options.method)}"
        line += f" --stated {' '.join(stated)}" if stated else ""
    else:
        line += f" --images {options.images}"
    write_table(options.result, line, table, seed=options.seed, runs=1)


if __name__ == "__main__":
    main()
