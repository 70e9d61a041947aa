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
"""The scenes of the chain: sonar images, where their targets are, and what the data sheet says.

Every scene has a data sheet: the answers of `tsepm init`, nothing else, make its detector and its
tracker. Levels are amplitudes over the median of the bottom.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from detector import clip_images, pool_images, radar_images
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from tsepm_ros import SonarImage
from tsepm_ros.numerics.arrays import BoolArray, FloatArray


class Target(NamedTuple):
    """A target in view: its place (2,) at the image's stamp, m, its state, and where its echo is.

    The echo is elsewhere where a bearing is looked at later than at the stamp.
    """

    place: FloatArray
    state: str
    echo: FloatArray


Truth = dict[Any, Target]
"""Targets in view by name, in the fixed frame."""
MOVES, RESTS = "moves", "rests"


@dataclass(frozen=True, eq=False)
class View:
    """An image, and the truth at its stamp.

    Attributes
    ----------
    image : SonarImage
        With the pose that own ship states; without one the sonar does not move.
    truth : Truth
    labelled : bool
        Whether everything that moves is known.
    """

    image: SonarImage
    truth: Truth
    labelled: bool = True


def nowhere(at: FloatArray) -> BoolArray:
    """That positions (n, 2) are on no structure."""
    return np.zeros(len(at), bool)


@dataclass(frozen=True, eq=False)
class ChainScene:
    """A scene.

    Attributes
    ----------
    answers : tuple of str
        What its data sheet answers to the questions of `tsepm init`, as arguments.
    views : callable
        The views of a seed.
    gate : float
        Distance within which a detection or a track is a target's, m.
    on_structure : callable
        Whether positions (n, 2) are on something built, (n,).
    """

    answers: tuple[str, ...]
    views: Callable[[int], Iterator[View]]
    gate: float
    on_structure: Callable[[FloatArray], BoolArray] = nowhere


def data_sheet(**answers: float | str) -> tuple[str, ...]:
    """Answers for a sonar of images, as arguments; names have underscores."""
    words = ["--images", "yes"]
    for name, value in answers.items():
        words += [f"--{name.replace('_', '-')}", value if isinstance(value, str) else f"{value:g}"]
    return tuple(words)


def pool(folder: Path) -> ChainScene:
    """A Ping360 at the edge of a pool; five swimmers, 30 turns of 2.9 s, 146 labels."""
    states = {"stand": RESTS, "struggle": "struggles", "moving": MOVES}

    def views(_: int) -> Iterator[View]:
        for image, labels in pool_images(folder / "aquascan"):
            yield View(image, {name: Target(at, states[state], at) for name, at, state in labels})

    answers = data_sheet(
        max_range=20, min_range=0.5, sector=180, sector_centre=180, beam_width=2, range_cell=0.04,
        interval=2.9, max_speed=2,
    )  # fmt: skip
    return ChainScene(answers, views, 1.2)


def clip(folder: Path, name: str) -> ChainScene:
    """A DIDSON before the bottom of a river; lamprey1 has 37 labels of three fish."""

    def views(_: int) -> Iterator[View]:
        for image, labels in clip_images(folder / "didson", name):
            truth = {own: Target(at, MOVES, at) for own, at, _ in labels}
            yield View(image, truth, labelled=bool(truth))

    answers = data_sheet(
        max_range=10, sector=29, beam_width=0.3, range_cell=0.02, interval=0.1, max_speed=2
    )
    return ChainScene(answers, views, 0.25)


def radar(folder: Path, rotations: int) -> ChainScene:
    """A BR24 with two or three steady echoes in noise; rotations in random order and turned."""

    def views(seed: int) -> Iterator[View]:
        for image in radar_images(folder / "radar", rotations, seed):
            yield View(image, {})

    answers = data_sheet(
        max_range=10240, beam_width=5.2, range_cell=10, sound_speed=0, interval=2.52, max_speed=15
    )
    return ChainScene(answers, views, 50.0)


def as_byte(amplitude: FloatArray) -> NDArray[np.uint8]:
    """An amplitude as a driver sends it: logarithmic, in 8 bits, 0.5 dB a step."""
    return np.clip(110.0 + 40.0 * np.log10(np.maximum(amplitude, 1e-3)), 0, 255).astype(np.uint8)


def decibels(value: float) -> float:
    """The amplitude of a level."""
    return float(10.0 ** (value / 20.0))


# Fish in a river: the sonar of a fish counter, which is fixed.

FISH_CELLS, FISH_FIELD, FISH_RANGES = (96, 512), math.radians(28.0), (2.0, 12.0)
FISH_IMAGES, FISH_PERIOD, FISH_CROSS = 600, 0.1, 14


@dataclass(frozen=True)
class Fish:
    """A fish of a length (m) that crosses the beams from its start (s), or holds its place.

    It swims to port at a speed (m/s; negative: to starboard) and away at another, at a range (m).
    """

    start: float
    range: float
    away: float
    speed: float
    length: float
    phase: float

    @property
    def half(self) -> float:
        """Distance from the middle of the field of view at which it comes and leaves, m."""
        return self.range * math.sin(FISH_FIELD / 2) + 0.3

    def place(self, time: float) -> FloatArray | None:
        """Its place (2,), while it is there."""
        after = time - self.start
        lasts = 2.0 * self.half / abs(self.speed) if self.speed else 45.0
        if not 0.0 <= after <= lasts:
            return None
        if not self.speed:
            return np.array(
                [self.range + 0.08 * math.sin(0.7 * time), 0.6 + 0.1 * math.sin(0.4 * time)]
            )
        across = self.speed * after - math.copysign(self.half, self.speed)
        return np.array(
            [self.range + self.away * after + 0.1 * math.sin(1.3 * after + self.phase), across]
        )


def fish_views(seed: int, images: int = FISH_IMAGES) -> Iterator[View]:
    """Images of a bed with rocks, and of the fish: each is seven glints across the beams."""
    rng, (beams, cells) = np.random.default_rng([seed, 75]), FISH_CELLS
    near, far = FISH_RANGES
    range_ = near + (np.arange(cells) + 0.5) / cells * (far - near)
    azimuth = (np.arange(beams) + 0.5) / beams * FISH_FIELD - FISH_FIELD / 2
    rise = 0.4 + 1.2 * np.clip((range_ - 6.0) / 4.0, 0.0, 1.0)
    bed = gaussian_filter(rise * np.exp(0.5 * rng.standard_normal(FISH_CELLS)), (2.0, 4.0))
    for _ in range(8):
        row, column = rng.integers(3, beams - 3), rng.integers(150, cells - 10)
        bed[row - 2 : row + 3, column - 4 : column + 5] += 3.0
    school = [
        Fish(rng.uniform(0, 50), rng.uniform(3.5, 11.0), rng.normal(0, 0.12),
             rng.choice([-1, 1]) * rng.uniform(0.35, 1.1), rng.uniform(0.25, 0.6), float(k))
        for k in range(FISH_CROSS)
    ] + [Fish(10.0, 7.0, 0.0, 0.0, 0.4, 0.0)]  # fmt: skip
    along, step = np.linspace(-0.5, 0.5, 7), FISH_FIELD / beams
    for k in range(images):
        time, power, truth = FISH_PERIOD * k, bed.copy(), Truth()
        for number, fish in enumerate(school):
            at = fish.place(time)
            if at is None:
                continue
            x = at[0] + 0.04 * np.sin(6.0 * time + 4.0 * along)
            y = at[1] + fish.length * along
            row = np.arctan2(y, x)[:, None] / step + 0.5 * (beams - 1)
            column = (np.hypot(x, y)[:, None] - range_[0]) / (range_[1] - range_[0])
            beam = np.exp(-0.5 * ((np.arange(beams) - row) / 0.7) ** 2)
            pulse = np.exp(-0.5 * ((np.arange(cells) - column) / 1.5) ** 2)
            power += (rng.exponential(1.5, 7)[:, None] * beam).T @ pulse
            if near < np.hypot(*at) < far and abs(math.atan2(at[1], at[0])) < FISH_FIELD / 2:
                truth[number] = Target(at, MOVES if fish.speed else RESTS, at)
        speckle, noise = rng.rayleigh(0.8, (2, *FISH_CELLS))
        yield View(
            SonarImage(time, range_, azimuth, as_byte(power * speckle + 0.15 * noise)), truth
        )


FISH = ChainScene(
    data_sheet(max_range=12, min_range=2, sector=28, beam_width=0.3, range_cell=0.02, interval=0.1,
               max_speed=2),
    fish_views, 0.6,
)  # fmt: skip


# A diver over a textured bottom with a wall and piles, before a sonar that rests or drives.

BOTTOM_SIZE, BOTTOM_CELL = (110.0, 80.0), 0.1
"""Of the ground from (-10, -40), and of its cells, m."""
TEXTURES, TEXTURE_DB = (0.3, 2.0), 3.5
"""Scales of the texture, m, and the standard deviation of the level, dB."""
SECTOR, BOTTOM_RANGES = math.radians(90.0), (1.0, 31.0)
WALL = np.array([(12.0, 14.0), (90.0, 24.0)])
PILES = np.array([(16.0, -5.0), (21.0, 4.0), (27.0, -7.0), (34.0, 2.0), (41.0, -6.0)])
PILE_RADIUS, DIVER = 0.2, (0.5, 0.8)
"""Radius of a pile, and half widths of the diver and of his shadow, m."""
WALL_DB, PILE_DB, DIVER_DB, SHADOW_DB, NOISE_DB = 18.0, 22.0, 10.0, -10.0, -20.0
SWIMS, RESTS_FOR = 0.4, 40.0
"""Speed of the diver, m/s, and the time for which he rests, s."""


@dataclass(frozen=True)
class BottomScene:
    """A sonar before a bottom.

    Attributes
    ----------
    drives : bool
        At 0.5 m/s, turning by up to 8 degrees/s; else it rests.
    cells : (int, int)
        Bearings and ranges.
    images : int
    period : float
        s.
    poses : str
        A name of `POSES`.
    """

    drives: bool = False
    cells: tuple[int, int] = (256, 600)
    images: int = 600
    period: float = 0.2
    poses: str = "exact"

    def pose(self, time: float) -> FloatArray:
        """Where the sonar is, x, y and yaw: it turns to and fro within 20 s."""
        if not self.drives:
            return np.zeros(3)
        yaw = math.radians(8.0) * 10.0 / math.pi * math.sin(math.pi * time / 10.0)
        return np.array([0.5 * time, 0.0, yaw])

    def diver(self, time: float) -> tuple[FloatArray, str]:
        """Where the diver is: he comes from starboard, rests, and leaves past the piles."""
        comes, place = (
            (10.0, np.array([34.0, -3.0])) if self.drives else (45.0, np.array([12.0, 1.0]))
        )
        before, after = min(time - comes, 0.0), max(time - comes - RESTS_FOR, 0.0)
        moved = SWIMS * (before * np.array([0.3, 0.954]) + after * np.array([0.8, 0.6]))
        return place + moved, MOVES if before or after else RESTS

    def answers(self) -> tuple[str, ...]:
        """The data sheet."""
        beams, cells = self.cells
        near, far = BOTTOM_RANGES
        told = data_sheet(
            max_range=far, min_range=near, sector=math.degrees(SECTOR),
            beam_width=math.degrees(SECTOR) / beams, range_cell=(far - near) / cells,
            interval=self.period, max_speed=2,
        )  # fmt: skip
        return (*told, "--own-ship", "odometry") if self.drives else told

    def views(self, seed: int) -> Iterator[View]:
        """Draw the images."""
        rng = np.random.default_rng([seed, 69])
        ground, error, (beams, cells) = textured_ground(rng), np.zeros(3), self.cells
        near, far = BOTTOM_RANGES
        range_ = near + (np.arange(cells) + 0.5) / cells * (far - near)
        azimuth = (np.arange(beams) + 0.5) / beams * SECTOR - SECTOR / 2
        scale, keeps = POSES[self.poses]
        for k in range(self.images):
            time = self.period * k
            pose, (diver, state) = self.pose(time), self.diver(time)
            level = seen_ground(ground, pose, azimuth, range_)
            shade(
                level,
                pose,
                azimuth,
                range_,
                [*PILES, diver],
                [PILE_RADIUS] * len(PILES) + [DIVER[0]],
            )
            truth = Truth()
            bearing, distance = polar(diver, pose)
            if abs(bearing) < SECTOR / 2 and near < distance < far:
                truth["diver"] = Target(diver, state, diver)
                rows = np.abs(azimuth - bearing) < np.maximum(DIVER[0] / distance, SECTOR / beams)
                columns = np.abs(range_ - distance) < 0.5 * DIVER[1]
                level[np.ix_(rows, columns)] = decibels(DIVER_DB)
            amplitude = level * rng.rayleigh(1.0 / math.sqrt(2.0), self.cells)
            amplitude += decibels(NOISE_DB) * rng.rayleigh(1.0 / math.sqrt(2.0), self.cells)
            error = keeps * error + math.sqrt(1.0 - keeps**2) * scale * rng.standard_normal(3)
            image = SonarImage(time, range_, azimuth, as_byte(amplitude))
            if self.drives:
                image = replace(image, sensor_pose=pose + error)
            yield View(image, truth)

    def scene(self) -> ChainScene:
        """The scene."""
        return ChainScene(self.answers(), self.views, 1.2, on_bottom_structure)


POSES = {
    "exact": (np.zeros(3), 0.0),
    "white": (np.array([0.1, 0.1, math.radians(0.3)]), 0.0),
    "slow": (np.array([0.3, 0.3, math.radians(1.0)]), 0.995),
}
"""Standard deviations of own ship's errors, m and rad, and what the next image keeps of one."""


def textured_ground(rng: np.random.Generator) -> FloatArray:
    """Levels of the cells of the ground: log-normal, of two scales."""
    shape = tuple(round(size / BOTTOM_CELL) for size in BOTTOM_SIZE)
    fields = []
    for scale in TEXTURES:
        # A Gaussian filter of s / 2 makes a correlation that falls to 1/e at the lag s.
        field = gaussian_filter(rng.standard_normal(shape), 0.5 * scale / BOTTOM_CELL)
        fields.append(field / field.std())
    return np.asarray(
        10.0 ** (TEXTURE_DB / 20.0 * np.sum(fields, axis=0) / math.sqrt(len(TEXTURES)))
    )


def polar(place: FloatArray, pose: FloatArray) -> tuple[float, float]:
    """Bearing and range of a place (2,) from a pose."""
    x, y = place - pose[:2]
    bearing = math.atan2(y, x) - pose[2]
    return (bearing + math.pi) % (2.0 * math.pi) - math.pi, math.hypot(x, y)


def seen_ground(
    ground: FloatArray, pose: FloatArray, azimuth: FloatArray, range_: FloatArray
) -> FloatArray:
    """Levels (b, m) of the ground and the wall, and of the shadow behind it."""
    bearing = azimuth + pose[2]
    ahead, port = np.cos(bearing), np.sin(bearing)
    x = (pose[0] + 10.0 + np.outer(ahead, range_)) / BOTTOM_CELL
    y = (pose[1] + BOTTOM_SIZE[1] / 2 + np.outer(port, range_)) / BOTTOM_CELL
    level = ground[x.astype(np.intp) % ground.shape[0], y.astype(np.intp) % ground.shape[1]]
    wall = WALL[1] - WALL[0]
    to_wall = WALL[0] - pose[:2]
    across = ahead * wall[1] - port * wall[0]
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = (to_wall[0] * wall[1] - to_wall[1] * wall[0]) / across
        share = (to_wall[0] * port - to_wall[1] * ahead) / across
    hit = (distance > 0.0) & (share > 0.0) & (share < 1.0)
    distance = np.where(hit, distance, np.inf)[:, None]
    level[range_ > distance] *= decibels(SHADOW_DB)
    level[np.abs(range_ - distance) < 0.2] *= decibels(WALL_DB - SHADOW_DB / 2)
    return np.asarray(level)


def shade(
    level: FloatArray,
    pose: FloatArray,
    azimuth: FloatArray,
    range_: FloatArray,
    places: list[FloatArray],
    radii: list[float],
) -> None:
    """Draw the piles, all places but the last, and the shadows behind all of them."""
    step = float(azimuth[1] - azimuth[0])
    for number, (place, radius) in enumerate(zip(places, radii, strict=True)):
        bearing, distance = polar(place, pose)
        rows = np.abs(azimuth - bearing) < max(radius / max(distance, 1.0), 0.5 * step)
        level[np.ix_(rows, range_ > distance)] *= decibels(SHADOW_DB)
        if number < len(places) - 1:
            level[np.ix_(rows, np.abs(range_ - distance) < radius)] = decibels(PILE_DB)


def on_bottom_structure(at: FloatArray) -> BoolArray:
    """Whether positions are within 1 m of the wall or of a pile."""
    wall = WALL[1] - WALL[0]
    share = np.clip((at - WALL[0]) @ wall / (wall @ wall), 0.0, 1.0)
    apart = np.linalg.norm(at - WALL[0] - share[:, None] * wall, axis=1)
    piles = np.linalg.norm(at[:, None] - PILES, axis=2).min(axis=1)
    return np.asarray(np.minimum(apart, piles) < 1.0)


# Swimmers in a basin, before a scanner that turns once in eight seconds.

TURN, BEARINGS, BASIN_RANGES, BASIN_CELLS = 8.0, 200, (0.5, 20.0), 390
BASIN_WALLS = (-9.0, 15.0, -6.0, 10.0)
"""Least and largest x, least and largest y, m, from the sonar."""
TURNS = 40
SPEEDS = (0.3, 0.45, 0.6)
"""Of the swimmers that move, m/s; two more tread water."""


def basin_views(seed: int, turns: int = TURNS) -> Iterator[View]:
    """Turns in which every bearing has its time."""
    rng = np.random.default_rng([seed, 72])
    azimuth = 2.0 * np.pi * (np.arange(BEARINGS) + 0.5) / BEARINGS - np.pi
    near, far = BASIN_RANGES
    range_ = near + (np.arange(BASIN_CELLS) + 0.5) * (far - near) / BASIN_CELLS
    offset = TURN * np.arange(BEARINGS) / BEARINGS
    x0, x1, y0, y1 = BASIN_WALLS
    low, size = np.array([x0, y0]) + 1.5, np.array([x1 - x0, y1 - y0]) - 3.0
    start, heading = rng.uniform(0.0, 1.0, (5, 2)) * size, rng.uniform(-np.pi, np.pi, 5)
    phase = rng.uniform(0.0, 2.0 * np.pi, 5)

    def place(k: int, time: float) -> FloatArray:
        if k >= len(SPEEDS):
            sway = 0.15 * np.array([math.sin(0.5 * time + phase[k]), math.cos(0.3 * time)])
            return np.asarray(low + start[k] + sway)
        gone = start[k] + SPEEDS[k] * time * np.array([math.cos(heading[k]), math.sin(heading[k])])
        return np.asarray(low + size - np.abs(gone % (2.0 * size) - size))  # turns at the walls

    with np.errstate(divide="ignore"):
        wall = np.minimum(
            np.where(np.cos(azimuth) > 0.0, x1, x0) / np.cos(azimuth),
            np.where(np.sin(azimuth) > 0.0, y1, y0) / np.sin(azimuth),
        )[:, None]
    water = np.where(range_ > wall, decibels(-8.0), 1.0) * np.ones((BEARINGS, 1))
    water[np.abs(range_ - wall) < 0.1] = decibels(20.0)
    for turn in range(turns):
        level, truth = water.copy(), Truth()
        for k in range(5):
            at = place(k, TURN * turn)
            for _ in range(3):  # the time at which the head looks there
                row = round((math.atan2(at[1], at[0]) - azimuth[0]) / (azimuth[1] - azimuth[0]))
                at = place(k, TURN * turn + offset[row % BEARINGS])
            distance = np.hypot(*at)
            wide = max(round(0.25 / max(distance, 0.5) / (azimuth[1] - azimuth[0])), 1)
            rows = np.arange(row - wide, row + wide + 1) % BEARINGS
            level[np.ix_(rows, np.abs(range_ - distance) < 0.25)] = decibels(8.0)
            numbered = "1 and 2" if turn < 2 else "3 to 14" if turn < 14 else "from 15"
            state = f"{MOVES}, turns {numbered}" if k < len(SPEEDS) else RESTS
            truth[k] = Target(place(k, TURN * turn), state, at)
        amplitude = level * rng.rayleigh(1.0 / math.sqrt(2.0), level.shape)
        yield View(SonarImage(TURN * turn, range_, azimuth, as_byte(amplitude), offset), truth)


def on_basin_wall(at: FloatArray) -> BoolArray:
    """Whether positions are within 1 m of a wall of the basin, or beyond it."""
    x0, x1, y0, y1 = BASIN_WALLS
    inside = np.minimum(at - [x0, y0], np.array([x1, y1]) - at)
    return np.asarray(inside.min(axis=1) < 1.0)


BASIN = ChainScene(
    data_sheet(max_range=20, min_range=0.5, beam_width=1.8, range_cell=0.05, interval=TURN,
               max_speed=2),
    basin_views, 1.5, on_basin_wall,
)  # fmt: skip
