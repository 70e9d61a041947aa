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
"""With min_speed: fixed reflectors are not published, swimmers are, and soon."""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from fixed_echoes import MAX_SPEED, MIN_SPEED
from fixed_echoes_scenes import (
    AZIMUTH_STD,
    RANGE_STD,
    Ping,
    Scene,
    Target,
    reflectors,
    swimmer,
)
from support.builders import reconfigured

from tsepm_ros import make_initiator

REFLECTORS = Scene(detection_probability=0.8, pings=40)

SURE = 0.9

SHARE = 0.9

PARTS = 0.5, 0.25, 0.125, 0.125


def oracle(pings: list[Ping], target: int, known: Target | None = None) -> Iterator[float]:
    """Probability of moving by the true hits alone, ping by ping.

    The test of the package on a least-squares fit to the true hits, by sums over a grid of
    velocities. With a `known` target, its place and the time at which it sets off are known.
    """
    information, moment = np.zeros((4, 4)), np.zeros(4)
    step = 0.04
    axis = np.arange(-MAX_SPEED, MAX_SPEED + step / 2, step)
    vx, vy = np.meshgrid(axis, axis)
    speed = np.hypot(vx, vy)
    if known is not None:
        tight = np.zeros((2, 4))
        tight[0, 0] = tight[1, 2] = 1.0
        information += 1e8 * tight.T @ tight
        moment += 1e8 * tight.T @ np.asarray(known.place)
    for ping in pings:
        scan = ping.scan
        time = scan.stamp - (known.sets_off if known is not None else 0.0)
        for row in np.flatnonzero(ping.origin == target):
            if time < 0.0:
                continue
            x, y = ping.truth[target] - scan.sensor_pose[:2]
            distance, angle = math.hypot(x, y), math.atan2(y, x)
            turn = np.array(
                [[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]
            )
            error = turn @ np.diag([RANGE_STD, AZIMUTH_STD * distance]) ** 2 @ turn.T
            azimuth = scan.azimuth[row]
            seen = scan.range[row] * np.array([math.cos(azimuth), math.sin(azimuth)])
            rows = np.array([[1.0, time, 0.0, 0.0], [0.0, 0.0, 1.0, time]])
            weight = rows.T @ np.linalg.inv(error)
            information += weight @ rows
            moment += weight @ (seen + scan.sensor_pose[:2])
        if np.linalg.matrix_rank(information) < 4:
            yield 0.0
            continue
        covariance = np.linalg.inv(information)
        mean = covariance @ moment
        spread = covariance[1::2, 1::2]
        inverse = np.linalg.inv(spread)
        apart = np.stack([vx - mean[1], vy - mean[3]])
        density = np.exp(-0.5 * np.einsum("iab,ij,jab->ab", apart, inverse, apart))
        at_rest = math.exp(-0.5 * mean[1::2] @ inverse @ mean[1::2])
        slow = density[speed < MIN_SPEED].mean()
        fast = 0.0
        for part, limit in zip(PARTS, MAX_SPEED / 2.0 ** np.arange(len(PARTS)), strict=True):
            fast += part * density[(speed >= MIN_SPEED) & (speed <= limit)].mean()
        yield (1 - SHARE) * fast / ((1 - SHARE) * fast + SHARE * 0.5 * (at_rest + slow))


def initiator_of(scene: Scene, min_speed: float = MIN_SPEED, method: str = "score", **options):
    return make_initiator(
        method, sensor=scene.sensor, max_speed=MAX_SPEED, min_speed=min_speed, **options
    )


def published_reflectors(seeds: range, pings: int, **kind) -> tuple[int, int, float]:
    """How many reflectors were published, of how many, and the share listed in the end."""
    published = listed = 0
    for seed in seeds:
        rng = np.random.default_rng([seed, 23])
        scene = replace(REFLECTORS, targets=reflectors(rng), pings=pings, **kind)
        initiator = initiator_of(scene, clutter_density="estimated")
        places, found = np.array([target.place for target in scene.targets]), set()
        for ping in scene.draw(rng):
            for track in initiator.process(ping.scan):
                apart = np.hypot(*(places - track.position).T)
                found |= {int(np.argmin(apart))} if apart.min() < 15.0 else set()
        published += len(found)
        echoes = initiator.fixed_echoes.state[:, 0::2]
        apart = np.hypot(*np.moveaxis(places[:, None] - echoes[None], -1, 0))
        listed += int((apart.min(axis=1) < 5.0).sum())
        assert len(echoes) <= len(places) + 1
        assert not set(initiator.fixed_echoes.track_id) & set(initiator.current.track_id)
    return published, 5 * len(seeds), listed / (5 * len(seeds))


@pytest.mark.parametrize(
    "kind", [{"heading_std": 0.02, "position_std": 1.0}, {"speed": 1.0}], ids=["pose", "moving"]
)
def test_errors_of_the_own_pose_and_a_moving_sonar_move_no_reflector(kind):
    published, _, listed = published_reflectors(range(1, 3), 30, **kind)
    assert published == 0
    assert listed >= 0.9


@pytest.mark.long
def test_few_of_a_hundred_reflectors_are_ever_published_in_two_minutes():
    published, number, listed = published_reflectors(range(1, 21), 120)
    assert number == 100
    assert published <= 6
    assert listed >= 0.95


def first_track(initiator, pings):
    """Number of the ping of the first track on the scene's target, and the track."""
    for number, ping in enumerate(pings):
        for track in initiator.process(ping.scan):
            if np.hypot(*(ping.truth[0] - track.position)) < 15.0:
                return number, track
    raise AssertionError("no track on the target")


@pytest.mark.parametrize(("course", "seed"), [("radial", 1), ("radial", 2), ("any", 3), ("any", 4)])
def test_a_swimmer_is_published_soon_after_an_oracle_is_sure(course, seed):
    rng = np.random.default_rng([seed, 24])
    scene = Scene([swimmer(rng, course)], pings=40)
    pings = list(scene.draw(rng))
    (free, _), (number, track) = (
        first_track(initiator_of(scene, min_speed, clutter_density="estimated"), pings)
        for min_speed in (0.0, MIN_SPEED)
    )
    sure = [probability >= SURE for probability in oracle(pings, 0)].index(True)
    assert number <= max(sure, free) + 2
    assert track.stationary_probability <= 0.5
    assert track.scan_count == number + 1 - track.hits[0][0]


def test_a_reflector_that_sets_off_becomes_a_track_under_its_id():
    rng = np.random.default_rng([5, 25])
    target = replace(swimmer(rng, "radial"), sets_off=30.0)
    scene = Scene([target], pings=50)
    pings = list(scene.draw(rng))
    initiator = initiator_of(scene, clutter_density="estimated")
    for ping in pings[:30]:
        new = initiator.process(ping.scan)
        assert all(np.hypot(*(ping.truth[0] - track.position)) >= 15.0 for track in new)
    apart = np.hypot(*(pings[29].truth[0] - initiator.fixed_echoes.state[:, 0::2]).T)
    (echo_id,) = initiator.fixed_echoes.track_id[apart < 3.0]
    later, track = first_track(initiator, pings[30:])
    sure = [probability >= SURE for probability in oracle(pings, 0, target)].index(True)
    assert 30 + later <= sure + 10
    assert track.track_id == echo_id
    assert track.stamp == 30 + later
    assert echo_id in initiator.current.track_id


def test_min_speed_may_change_between_scans():
    rng = np.random.default_rng([2, 26])
    scene = replace(REFLECTORS, targets=reflectors(rng), pings=30)
    initiator = initiator_of(scene)
    pings = list(scene.draw(rng))
    for ping in pings[:20]:
        initiator.process(ping.scan)
    echoes = initiator.fixed_echoes
    assert len(echoes) >= 4
    common = replace(initiator.common, min_speed=0.0)
    reconfigured(initiator, initiator.sensor.model, common, initiator.options)
    new = initiator.process(pings[20].scan)
    assert set(echoes.track_id) <= set(new.track_id)
    assert len(initiator.fixed_echoes) == 0
    assert initiator.statistics.confirmed == len(new)
