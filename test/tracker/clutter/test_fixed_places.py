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
"""Clutter that stays in place, against a loop over cells; a quay and what is no quay."""

import math
from collections import Counter
from collections.abc import Sequence

import numpy as np
import pytest

from tsepm_ros import LandMask, Scan, SensorModel
from tsepm_ros.tracker.clutter import fixed_places
from tsepm_ros.tracker.clutter import fixed_places as module
from tsepm_ros.tracker.clutter.excess import poisson_bound
from tsepm_ros.tracker.clutter.fixed_places import (
    DIRECTIONS,
    MIN_DENSITY_RATIO,
    MIN_PERIOD_TIME,
    MIN_SIDE,
    PERIOD_SCANS,
    PERIODS,
    SIDE_DEVIATIONS,
    FixedPlaces,
)
from tsepm_ros.tracker.polar_grid import MAX_DEVIATIONS
from tsepm_ros.tracker.scan import scan_positions as in_fixed_frame
from tsepm_ros.tracker.sensor import SensorView

SECTOR = SensorModel(
    range_std=1.0,
    range_std_fraction=0.0,
    azimuth_std=math.radians(1.0),
    max_range=300.0,
    azimuth_min=-math.pi / 3,
    azimuth_max=math.pi / 3,
    clutter_density=1e-4,
)

NONE = np.zeros(0, np.int64)


def view(x: float = 0.0, y: float = 0.0, yaw: float = 0.0) -> SensorView:
    return SensorView(SECTOR, (x, y, yaw), None)


def deviations(range_: np.ndarray) -> np.ndarray:
    """Standard deviations of detections at ranges (n,), m."""
    return np.maximum(SECTOR.range_std, range_ * SECTOR.azimuth_std)


def power(range_: float) -> float:
    """Power of two of the side of a cell at a range."""
    return math.log2(max(SIDE_DEVIATIONS * float(deviations(np.array(range_))), MIN_SIDE))


def cell(place: np.ndarray, level: int) -> tuple[int, int, int]:
    side = 2.0**level
    return level, math.floor(place[0] / side), math.floor(place[1] / side)


class Plain:
    """The same with loops over cells."""

    def __init__(self) -> None:
        self.periods: list[tuple[Counter, int, list[SensorView]]] = []
        self.densities: dict[tuple[int, int, int], float] = {}
        self.scans: list[tuple[float, SensorView, list]] = []

    def update(
        self, stamp: float, seen: SensorView, position: np.ndarray, range_: np.ndarray
    ) -> None:
        if len(self.scans) >= PERIOD_SCANS and stamp - self.scans[0][0] >= MIN_PERIOD_TIME:
            self.end()
            self.scans = []
        self.scans.append((stamp, seen, list(zip(position, range_, strict=True))))

    def end(self) -> None:
        counts, number, taken = Counter(), 0, []
        for _, seen, detections in self.scans:
            if number < fixed_places.MOST_DETECTIONS:
                number += len(detections)
                taken.append(seen)
                for place, range_ in detections:
                    for wider in range(3):
                        counts[cell(place, math.floor(power(range_)) + wider)] += 1
        self.periods.append((counts, len(taken), taken))
        self.periods = self.periods[-PERIODS:]
        if len(self.periods) > 1:
            cells = sorted(set().union(*(counts for counts, *_ in self.periods)))
            middles = [((x + 0.5) * 2.0**level, (y + 0.5) * 2.0**level) for level, x, y in cells]
            # By periods, the share of the views that cover each cell.
            seen = [
                np.mean([one.covers(np.array(middles)) for one in views], axis=0)
                for *_, views in self.periods
            ]
            found = zip(cells, map(self.density, cells, zip(*seen, strict=True)), strict=True)
            self.densities = {one: density for one, density in found if density}

    def number(self, of: tuple[int, int, int]) -> int:
        by_period = sorted(counts[of] for counts, *_ in self.periods)
        return sum(by_period) - by_period[-1] + by_period[-2] if by_period[-2] else 0

    def density(self, of: tuple[int, int, int], seen: Sequence[float]) -> float:
        """That of a cell, with the share of the views of each period that cover it."""
        level, x, y = of
        most = 0.0
        for right, up in DIRECTIONS:
            three = [self.number((level, x + k * right, y + k * up)) for k in (-1, 0, 1)]
            low = float(poisson_bound(np.array(sum(three), float), -MAX_DEVIATIONS))
            most = max(most, min(low / 3.0, 2.0 * min(three)))
        first = next(i for i, (counts, *_) in enumerate(self.periods) if counts[of])
        scans = 0.0
        for (_, number, _), share in list(zip(self.periods, seen, strict=True))[first:]:
            scans += number * float(share)
        return most / (scans * 4.0**level) if scans else 0.0

    def at(self, place: np.ndarray, range_: float) -> float:
        level = round(power(range_))
        return max(self.densities.get(cell(place, level + wider), 0.0) for wider in (0, 1))


def quay(rng: np.random.Generator, number: float = 15.0) -> np.ndarray:
    """Places of echoes on a line that the sensor sees at an angle, (n, 2), in even clutter."""
    along = rng.uniform(-200.0, 200.0, rng.poisson(number))
    line = np.stack([140.0 + 0.3 * along, 0.95 * along], axis=1)
    return np.concatenate([line, rng.uniform(-290.0, 290.0, (rng.poisson(8), 2))])


def detected(
    places: np.ndarray, pose: tuple[float, float, float], rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Ranges and azimuths, with errors, of the places in the sector of a sensor."""
    apart = places - pose[:2]
    range_ = np.hypot(*apart.T) + SECTOR.range_std * rng.standard_normal(len(apart))
    azimuth = np.arctan2(apart[:, 1], apart[:, 0]) - pose[2]
    azimuth += SECTOR.azimuth_std * rng.standard_normal(len(apart))
    seen = SECTOR.covers(range_, azimuth)
    return range_[seen], azimuth[seen]


def placed(range_: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
    """Positions (n, 2) about the sensor, along the axes of the fixed frame."""
    return range_[:, None] * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)


@pytest.mark.parametrize("turning", [False, True], ids=["still", "turning"])
@pytest.mark.parametrize("most", [fixed_places.MOST_DETECTIONS, 100], ids=["all", "some"])
def test_densities_are_those_of_a_loop_over_cells(most, turning, monkeypatch):
    monkeypatch.setattr(fixed_places, "MOST_DETECTIONS", most)
    rng, plain, learned = np.random.default_rng(3), Plain(), FixedPlaces(SensorModel())
    compared = 0
    for ping in range(115):
        pose = (0.5 * ping, -20.0, 0.05 * ping if turning else 0.0)
        range_, azimuth = detected(quay(rng), pose, rng)
        position = placed(range_, azimuth + pose[2]) + pose[:2]
        plain.update(0.4 * ping, view(*pose), position, range_)
        learned.update(0.4 * ping, view(*pose), position, deviations(range_), NONE)
        if ping % 3 == 0 and learned.known:
            expected = [plain.at(*one) for one in zip(position, range_, strict=True)]
            cells = learned.cells(position, deviations(range_))
            np.testing.assert_allclose(learned.density(cells), expected, rtol=1e-12)
            compared += int(np.count_nonzero(expected))
        assert learned.known or not any(plain.densities.values())
    assert compared > 10


def learned_from(places, pings: int = 200) -> FixedPlaces:
    """Where clutter stays, from the places of detections at 1 ping/s."""
    learned, rng = FixedPlaces(SensorModel()), np.random.default_rng(1)
    for ping in range(pings):
        range_, azimuth = detected(places(ping, rng), (0.0, 0.0, 0.0), rng)
        position = placed(range_, azimuth)
        learned.update(float(ping), view(), position, deviations(range_), NONE)
    return learned


def density_at(learned: FixedPlaces, place: tuple[float, float]) -> float:
    position = np.array([place])
    cells = learned.cells(position, deviations(np.hypot(*position.T)))
    return float(learned.density(cells)[0]) if learned.known else 0.0


def test_the_density_of_a_quay_is_found_within_a_factor_of_two():
    learned = learned_from(lambda ping, rng: quay(rng))
    # 15 echoes on 399 m; there a cell of 4 m holds 4.2 m of it, nearly all of its width. Of the
    # cells beside it, an oblique line passes through a part.
    density = 15.0 / 398.5 * 4.2 / 16.0
    assert 0.5 * density < density_at(learned, (142.0, 6.0)) < 1.2 * density


def silent(ping, rng):
    return np.zeros((0, 2))


@pytest.mark.parametrize(
    ("places", "pings"),
    [
        pytest.param(lambda ping, rng: np.array([[150.0, 50.0]]), 200, id="stands still"),
        pytest.param(lambda ping, rng: np.array([[60.0 + 5.0 * ping, 10.0]]), 60, id="passes"),
        pytest.param(silent, (PERIODS + 2) * PERIOD_SCANS, id="nothing"),
        pytest.param(
            lambda ping, rng: quay(rng) if ping < 24 else silent(ping, rng),
            24 + (PERIODS + 2) * PERIOD_SCANS,
            id="after a quay, until no period with detections is left",
        ),
    ],
)
def test_a_target_is_no_clutter_and_without_detections_nothing_stays(places, pings):
    learned = learned_from(places, pings)
    assert not learned.known or density_at(learned, (150.0, 50.0)) == 0.0


@pytest.mark.parametrize(("silence", "pings"), [(0, 24), (40, 120)])
def test_a_quay_is_found_at_once_and_after_silence(silence, pings):
    def places(ping, rng):
        return silent(ping, rng) if ping < silence else quay(rng)

    assert learned_from(places, pings).known


def test_even_clutter_is_hardly_raised():
    def places(ping, rng):
        return rng.uniform(-300.0, 300.0, (rng.poisson(36), 2))  # 1e-4 1/m^2

    learned, rng = learned_from(places), np.random.default_rng(2)
    range_, azimuth = detected(rng.uniform(-300.0, 300.0, (4000, 2)), (0.0, 0.0, 0.0), rng)
    position = placed(range_, azimuth)
    cells = learned.cells(position, deviations(range_))
    raised = learned.density(cells) / 1e-4
    raised[raised < MIN_DENSITY_RATIO] = 1.0
    assert np.mean(raised > 1.0) < 0.1
    assert np.log(raised).mean() < 0.1


def test_where_the_fixed_frame_begins_does_not_matter():
    far = np.array([-5e5, 4e6])  # as in a national grid; a multiple of every side

    def moved(offset):
        learned, rng = FixedPlaces(SensorModel()), np.random.default_rng(4)
        for ping in range(60):
            range_, azimuth = detected(quay(rng), (0.0, 0.0, 0.0), rng)
            position = placed(range_, azimuth)
            position = np.round(position * 16.0) / 16.0 + offset
            learned.update(float(ping), view(*offset), position, deviations(range_), NONE)
        return learned.density(learned.cells(position, deviations(range_)))

    assert moved(np.zeros(2)).max() > 0.0
    np.testing.assert_allclose(moved(far), moved(np.zeros(2)), rtol=1e-9)


def test_a_scan_that_is_observed_again_is_not_counted_again():
    learned, rng = FixedPlaces(SensorModel()), np.random.default_rng(5)
    for stamp in (*range(40), *range(30, 40), *range(40, 80)):
        range_ = rng.uniform(100.0, 200.0, 5)
        position = placed(range_, 0.0 * range_)
        learned.update(float(stamp), view(), position, deviations(range_), NONE)
    assert sum(one.scans for one in learned._periods) == 72  # nine whole periods of 80 scans


def test_of_many_views_in_a_period_the_share_of_each_counts():
    """Eight arcs in turn, for sixteen scans a period: a place is seen in two scans of each."""
    learned, rng = FixedPlaces(SensorModel()), np.random.default_rng(6)
    for ping in range(160):
        arc = (-math.pi / 3 + (ping % 8) * math.pi / 12, math.pi / 12)
        range_, azimuth = detected(quay(rng, 40.0), (0.0, 0.0, 0.0), rng)
        seen = np.mod(azimuth - arc[0], 2.0 * math.pi) < arc[1]
        range_, azimuth = range_[seen], azimuth[seen]
        position = placed(range_, azimuth)
        looked = SensorView(SECTOR, (0.0, 0.0, 0.0), arc)
        learned.update(0.3125 * ping, looked, position, deviations(range_), NONE)
    along = np.linspace(-110.0, 110.0, 45)
    found = [density_at(learned, (140.0 + 0.3 * one, 0.95 * one)) for one in along]
    # A line of 40 echoes on 399 m, as wide as 4 m or more.
    assert np.mean(np.array(found) > 0.0) > 0.75
    assert max(found) < 2.0 * 40.0 / 398.5 / 4.0


@pytest.mark.parametrize("yaw", [0.0, 0.7, -2.5])
def test_a_place_is_on_land_where_its_cell_is(yaw):
    """Against a loop over the cells, each of which knows its own places."""
    rng = np.random.default_rng(1)
    occupied = rng.random((7, 13)) < 0.4
    mask = LandMask(occupied, 2.5, (100.0, -40.0, yaw))
    assert mask.cells == occupied.sum()
    assert mask.area == pytest.approx(6.25 * occupied.sum())
    along, across = (
        np.array([math.cos(yaw), math.sin(yaw)]),
        np.array([-math.sin(yaw), math.cos(yaw)]),
    )
    for row, column in np.ndindex(occupied.shape):
        u, v = rng.uniform(0.01, 0.99, (2, 5))
        places = np.array([100.0, -40.0])
        places = places + 2.5 * ((column + u)[:, None] * along + (row + v)[:, None] * across)
        assert mask.covers(places).tolist() == [bool(occupied[row, column])] * 5
    outside = np.array([[-0.1, 3.0], [13.1, 3.0], [5.0, -0.1], [5.0, 7.1]]) * 2.5
    assert not mask.covers(np.array([100.0, -40.0]) + outside @ np.stack([along, across])).any()
    assert not mask.covers(np.array([[1e300, 0.0], [-1e300, 1e300]])).any()


def test_detections_are_judged_where_they_are_in_the_fixed_frame():
    mask = LandMask([[True]], 10.0, (95.0, 45.0, 0.0))
    scan = Scan(0.0, [50.0, 50.0, 50.0], [0.0, -1.0, 2.0], sensor_pose=(100.0, 0.0, math.pi / 2))
    assert mask.covers(in_fixed_frame(scan)).tolist() == [True, False, False]
    poses = [(100.0, 0.0, math.pi / 2), (50.0, 50.0, 1.0), (0.0, 0.0, 0.0)]
    scan = Scan(0.0, [50.0, 50.0, 50.0], [0.0, -1.0, 2.0], sensor_pose=poses)
    assert mask.covers(in_fixed_frame(scan)).tolist() == [True, True, False]


BAD = {
    "resolution": (math.nan, 0.0, -1.0, math.inf, 1e-9, 1e7),
    "origin": ((math.nan, 0, 0), (0, math.inf, 0), (0, 0, math.nan), (1e12, 0, 0), (0, 0)),
    "occupied": ([True, False], np.zeros((1, 1, 1))),
}


@pytest.mark.parametrize(
    ("name", "value"), [(name, value) for name, values in BAD.items() for value in values]
)
def test_a_chart_that_is_none_is_refused(name, value):
    good = {"occupied": [[True]], "resolution": 1.0, "origin": (0.0, 0.0, 0.0)}
    with pytest.raises(ValueError, match=f"^{name} "):
        LandMask(**{**good, name: value})


def test_a_chart_is_bounded():
    wide = np.broadcast_to(np.array(False), (20_000, 20_000))  # takes no memory
    with pytest.raises(ValueError, match=r"^occupied must have two axes and at most"):
        LandMask(wide, 1.0)
    assert module.MAX_CELLS <= 1e8
