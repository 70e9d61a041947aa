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
"""Amplitudes of clutter, learned from scan to scan: units, gain, levels and texture."""

import dataclasses
import math

import numpy as np
import pytest

from tsepm_ros.tools.simulation import Simulator, load_scenario
from tsepm_ros.tools.simulation.scenario import ClutterStrength
from tsepm_ros.tracker.clutter import amplitude
from tsepm_ros.tracker.clutter.amplitude import (
    LAGS,
    RINGS_PER_CELL,
    ClutterAmplitudes,
    Levels,
    level_by_range,
    level_of_ping,
)
from tsepm_ros.tracker.clutter.amplitude_law import ScanAmplitudes
from tsepm_ros.tracker.clutter.density import ClutterMap
from tsepm_ros.tracker.measurement import DETECTION

BOX = load_scenario("box")

MAP = ClutterMap(BOX.sensor)

REACH = 120.0 * np.arange(LAGS + 1) + 380.0


def judged(
    learner: ClutterAmplitudes, amplitude, index: int, range_, azimuth
) -> ScanAmplitudes | None:
    """What a learner says of a scan of clutter, from which it learns then."""
    detections = np.zeros(len(amplitude), DETECTION)
    detections["intensity"], detections["index"] = amplitude, np.arange(len(amplitude))
    detections["scan"] = index
    detections["position"] = (range_ * np.array([np.cos(azimuth), np.sin(azimuth)])).T
    cells = MAP.grid.cells(range_, azimuth)
    found = learner.judge(detections, 16, cells, range_)
    learner.update(np.ones(len(amplitude)), 750.0, REACH)
    return found


class Sea:
    """Clutter of a law through a learner."""

    def __init__(self, clutter: ClutterStrength | None = None, seed: int = 1) -> None:
        self.learner = ClutterAmplitudes(MAP.grid)
        law = clutter or ClutterStrength()
        scene = dataclasses.replace(BOX, scans=200, targets=(), clutter_strength=law)
        self._scans = enumerate(Simulator(scene, seed))

    def pings(
        self, number: int, changed=lambda amplitude, range_: amplitude
    ) -> list[ScanAmplitudes | None]:
        found = []
        for index, simulated in (next(self._scans) for _ in range(number)):
            scan = simulated.scan
            amplitude = changed(scan.features["intensity"], scan.range)
            found.append(judged(self.learner, amplitude, index, scan.range, scan.azimuth))
        return found


def normalised(scans) -> np.ndarray:
    """u of the amplitudes of scans: the inverse of `scaled_values`."""
    return np.concatenate(
        [one.ratio.count * np.log1p(one.scaled / one.ratio.count) for one in scans]
    )


@pytest.mark.parametrize(
    "changed",
    [
        lambda amplitude, range_: amplitude,
        lambda amplitude, range_: np.sqrt(amplitude),
        lambda amplitude, range_: 10.0 * np.log10(amplitude) - 20.0,
        lambda amplitude, range_: np.clip(np.floor(20.0 * amplitude) + 1.0, 1.0, 255.0),
        lambda amplitude, range_: amplitude * (5000.0 / range_) ** 4,
        lambda amplitude, range_: np.where(range_ > 7000.0, 10.0 * amplitude, amplitude),
    ],
    ids=["power", "amplitude", "decibels", "8 bits", "fall with range", "step with range"],
)
def test_normalised_amplitudes_of_clutter_are_exponential_in_any_unit(changed):
    sea = Sea()
    sea.pings(16, changed)
    found = normalised(sea.pings(40, changed))
    assert found.mean() == pytest.approx(1.0, abs=0.12)
    assert np.mean(found > 3.0) == pytest.approx(np.exp(-3.0), abs=0.025)


def test_nothing_is_said_before_there_are_references():
    sea = Sea()
    assert sea.pings(1) == [None]
    assert "too few" in sea.learner.use
    assert sea.pings(1) != [None]
    assert sea.learner.use.startswith("used")


def test_amplitudes_that_vanish_say_nothing_and_those_that_appear_again_go_on():
    sea = Sea()
    sea.pings(16)

    def missing(amplitude, range_):
        return np.full(len(amplitude), np.nan)

    assert sea.pings(3, missing) == [None] * 3
    assert sea.learner.use == "not used: no amplitudes"
    assert None not in sea.pings(1)


def test_saturated_amplitudes_count_as_the_share_that_saturates():
    """A tenth of the clutter is at the top value: no normalised amplitude is above ln 10."""
    sea = Sea()

    def saturated(amplitude, range_):
        return np.minimum(amplitude, np.log(10.0))

    sea.pings(30, saturated)
    of_top: list[float] = []

    def noted(amplitude, range_):
        of_top.append(np.mean(amplitude >= np.log(10.0)))
        return saturated(amplitude, range_)

    strongest = [
        np.sort(normalised([found]))[::-1][: round(share * len(found.scaled))]
        for found, share in zip(sea.pings(20, noted), of_top, strict=True)
    ]
    at_top = np.concatenate(strongest)
    assert np.median(at_top) == pytest.approx(np.log(10.0), abs=0.2)


@pytest.mark.parametrize("gain", [100.0, 0.01])
def test_a_change_of_gain_does_not_pass_for_strong_echoes(gain):
    sea = Sea()
    sea.pings(16)
    found = normalised(sea.pings(8, lambda amplitude, range_: gain * amplitude))
    assert found.mean() == pytest.approx(1.0, abs=0.45)
    assert np.mean(found > 4.0) < 0.06


def test_a_change_to_decibels_drops_the_law_of_before():
    sea = Sea()
    sea.pings(30)

    def decibels(amplitude, range_):
        return -30.0 + 10.0 * np.log10(amplitude)

    first = sea.pings(8, decibels)[0]
    assert first is None, "begun anew as decibels"
    assert normalised(sea.pings(20, decibels)).mean() == pytest.approx(1.0, abs=0.15)


def test_texture_is_seen_and_independent_clutter_has_none():
    for law, shape in (("rayleigh", 1.0), ("k", 0.5)):
        independent = Sea(ClutterStrength(law, shape))
        independent.pings(30)
        assert independent.learner.texture.doubt < 0.02
    textured = Sea(ClutterStrength("k", 0.5, texture_length=500.0))
    last = textured.pings(30)[-1]
    assert textured.learner.texture.doubt > 0.1
    assert last.ratio.count < 10.0
    assert "neighbouring clutter is alike" in textured.learner.use


def test_a_large_scan_is_bounded_in_memory():
    learner = ClutterAmplitudes(MAP.grid)
    rng = np.random.default_rng(1)
    for scan in range(3):
        n = 20_000
        range_, azimuth = rng.uniform(0.0, 9000.0, n), rng.uniform(-3.0, 3.0, n)
        judged(learner, rng.exponential(size=n), scan, range_, azimuth)
    assert learner.use == "used: compared with 128 of clutter"


GAIN = math.log(100.0)


def test_the_order_of_a_large_scan_does_not_matter():
    rng, laws = np.random.default_rng(6), []
    pings = [rng.uniform((0.0, 100.0, -3.1), (1.0, 9000.0, 3.1), (150, 3)) for _ in range(8)]
    for order in (
        lambda ping: ping,
        lambda ping: ping[::-1],
        lambda ping: ping[ping[:, 0].argsort()],
    ):
        learner = ClutterAmplitudes(MAP.grid)
        for index, ping in enumerate(pings):
            judged(learner, order(ping)[:, 0], index, *order(ping)[:, 1:].T)
        laws.append(judged(learner, np.array([0.3, 0.9]), 9, np.full(2, 1e3), np.zeros(2)).scaled)
    np.testing.assert_allclose(laws, [laws[0]] * 3, rtol=1e-9)


def pings_of(rng, number: int, size: int):
    return [np.log(rng.exponential(size=size)) for _ in range(number)]


MEDIAN = math.log(math.log(2.0))


def level_of(level: float, pings) -> float:
    return level_of_ping(level, np.concatenate(pings), [len(ping) for ping in pings])


def test_a_level_that_does_not_change_stays_to_the_bit():
    pings = pings_of(np.random.default_rng(1), 64, 36)
    levels = [level_of(MEDIAN, pings[: last + 1]) for last in range(16, 64)]
    assert np.mean(np.array(levels) == MEDIAN) > 0.9


def test_targets_alone_in_a_calm_sea_do_not_raise_the_level():
    """Two of three detections a ping are 20 dB above the clutter."""
    pings = [
        ping + np.array([GAIN, GAIN, 0.0]) for ping in pings_of(np.random.default_rng(3), 1, 3)
    ]
    assert level_of(MEDIAN, [*pings_of(np.random.default_rng(4), 16, 3), *pings]) == MEDIAN


def test_a_step_is_found_within_a_cell():
    """Its ring has the level of either side, and no other has a mixture of both."""
    rng, side, step = np.random.default_rng(2), 40, 20 * RINGS_PER_CELL + 3
    places = Levels((side, side), True)
    for _ in range(40):
        ring, column = rng.integers(side * RINGS_PER_CELL, size=200), rng.integers(side, size=200)
        values = np.clip(rng.normal(size=200) + np.where(ring < step, -1.15, 1.15), -4.0, 4.0)
        places.update(places.places_of(ring, column), values, np.ones(200), 4.0, 1.5)
    places.renew()
    near = step + np.arange(-4, 4)
    found = places.by_range(places.places_of(near, np.full(8, 7)))
    np.testing.assert_allclose(found[1:] - found[:-1], 2.3 * (np.arange(7) == 3), atol=0.35)


def beside_a_target(value: float) -> Levels:
    """Levels of even clutter, with a detection of this value in a single cell in each ping."""
    rng = np.random.default_rng(7)
    places = Levels((40, 40), False)
    for _ in range(12):
        cells = rng.integers(40, size=31), rng.integers(40, size=31)
        cells[0][-1] = cells[1][-1] = 20
        values = rng.normal(size=31)
        values[-1] = value
        places.update(
            places.places_of(RINGS_PER_CELL * cells[0], cells[1]), values, np.ones(31), 4.0, 1.0
        )
    places.renew()
    return places


def test_a_target_of_one_detection_a_ping_does_not_raise_its_place():
    places = beside_a_target(4.0)
    assert places.at(places.places_of(np.array([20 * RINGS_PER_CELL]), np.array([20])))[0] < 0.3


ROWS = 20

COUNT = np.full(ROWS, 30.0)


@pytest.mark.parametrize(
    "level",
    [
        np.linspace(2.5, -2.5, ROWS),
        np.where(np.arange(ROWS) < 12, -1.0, 1.5),
        np.select([np.arange(ROWS) < 5, np.arange(ROWS) < 12], [2.0, -1.0]),
    ],
    ids=["power", "step", "two steps"],
)
def test_changes_with_range_are_found(level):
    rng = np.random.default_rng(8)
    level = level - level.mean()
    total = COUNT * level + np.sqrt(COUNT) * rng.normal(size=ROWS)
    found = level_by_range(COUNT, total - total.mean(), 2.0, 1.0)
    np.testing.assert_allclose(found, level, atol=0.5)
    assert np.abs(found - level).mean() < 0.2


def test_clutter_of_one_level_has_no_change_with_range():
    rng = np.random.default_rng(9)
    for _ in range(100):
        total = np.sqrt(COUNT) * rng.normal(size=ROWS)
        assert not level_by_range(COUNT, total - total.mean(), 2.0, 1.0).any()
    assert not level_by_range(np.zeros(ROWS), np.zeros(ROWS), 2.0, 1.0).any()


def test_the_level_of_a_few_values_of_a_coarse_scale_is_finite():
    rng = np.random.default_rng(10)
    for _ in range(100):
        count = np.bincount(rng.integers(50, 200, 31), minlength=272).astype(float)
        total = count * rng.choice([-69.1, 0.0, 0.7], 272)
        total -= count * total.sum() / count.sum()
        assert np.isfinite(level_by_range(count, total, 0.0, 30.0)).all()


def test_an_unknown_target_is_no_change_with_range():
    count, total = COUNT / 10.0, np.zeros(ROWS)
    count[3] += 6.0
    total[3] += 6.0 * 2.0
    assert not level_by_range(count, total - count * total.sum() / count.sum(), 2.0, 1.0).any()


def test_the_level_of_a_window_moves_only_where_too_few_values_are_on_one_side():
    values = np.arange(100.0)
    # A target of 16 detections does not count in a rise: the median is that of 84 values.
    for level in (30.0, 42.0, 50.0, 62.0):
        assert amplitude.level_of_window(level, values, 100) == level
    low = math.floor(42.0 - 12.5)
    assert amplitude.level_of_window(low - 1.0, values, 100) == 42.0
    assert amplitude.level_of_window(float(low), values, 100) == low
    assert amplitude.level_of_window(63.5, values, 100) == 50.0
    assert amplitude.level_of_window(62.5, values, 100) == 62.5
    assert amplitude.level_of_window(-9.0, values[:5], 2) == -9.0, "too few to tell"


def test_the_last_pings_are_those_of_so_many_numbers():
    references = np.zeros(6, amplitude.REFERENCE)
    references["ping"] = [3, 4, 4, 5, 7, 7]
    assert amplitude.of_last_pings(references, 1)["ping"].tolist() == [7, 7]
    assert amplitude.of_last_pings(references, 3)["ping"].tolist() == [5, 7, 7]
    assert len(amplitude.of_last_pings(references, 5)) == 6


def test_the_end_of_the_scale_is_seen_by_a_few_values_at_it():
    weight = np.array([1.0, 1.0, 1.0, 0.5, 0.5])
    assert amplitude._end_of_scale(np.array([1.0, 9.0, 9.0, 9.0, 3.0]), weight) == (
        math.inf,
        1.0,
    )
    top, share = amplitude._end_of_scale(np.array([9.0, 9.0, 9.0, 9.0, 3.0]), weight)
    assert (top, share) == (9.0, pytest.approx(4.5 / 5.0))
