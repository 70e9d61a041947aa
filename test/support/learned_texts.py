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
"""Texts of what was learned with numbers replaced, and restarts with them."""

import json
import math
from collections import Counter
from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np
import pytest

from tsepm_ros import Scan, SensorModel, make_initiator
from tsepm_ros.session import learned_text as learned_memory
from tsepm_ros.tracker.clutter.learned import Surroundings
from tsepm_ros.tracker.tracker import Tracker

TIME = 1e9
"""Time of the texts, since 1970, s."""
DAY = 86_400.0
SENSORS = {
    "disc": (SensorModel(clutter_density=1e-7), 1e-7),
    "sector": (
        SensorModel(min_range=200.0, max_range=5000.0, azimuth_min=0.3, azimuth_max=1.8),
        2e-6,
    ),
}
"""Sensors, and their clutter's density, 1/m^2."""
SCENES = list(SENSORS)
LEARNT_FROM, TARGET = (2500.0, -3.0, 2000.0, 2.0), (1500.0, 3.0, 1500.0, -2.0)
REPLACEMENTS: tuple[Any, ...] = (
    *(0, 0.0, -1, -1.0, -1e308, 5e-324, 1e-320, 1e-310, 1e200, -1e200, 1e308, 2**63, 2**64),
    *(math.inf, -math.inf, math.nan, 10**18, int("9" * 400), 10**400, -(10**400)),
    *("1", "x", "", [], [1.0], [[0]], None, True, False, {}),
)


def scans(scene: str, number: int, seed: int, target: tuple[float, ...], first: int) -> list[Scan]:
    """Scans of even clutter and of a target [x, vx, y, vy]."""
    sensor, density = SENSORS[scene]
    rng, made = np.random.default_rng(seed), []
    for k in range(number):
        n = rng.poisson(density * sensor.coverage_area)
        range_ = np.sqrt(rng.uniform(sensor.min_range**2, sensor.max_range**2, n))
        azimuth = sensor.azimuth_min + rng.uniform(0.0, sensor.sector_width, n)
        if rng.random() < 0.9:
            x, y = target[0] + 12.0 * k * target[1], target[2] + 12.0 * k * target[3]
            range_ = np.append(range_, math.hypot(x, y) * (1.0 + 0.015 * rng.standard_normal()))
            error = sensor.azimuth_std * rng.standard_normal()
            azimuth = np.append(azimuth, math.atan2(y, x) + error)
        made.append(Scan(12.0 * (first + k), range_, azimuth))
    return made


@cache
def learned_text(scene: str) -> str:
    """What a run of 60 scans has learned."""
    sensor = SENSORS[scene][0]
    initiator = make_initiator("score", sensor=sensor)
    for scan in scans(scene, 60, 7, LEARNT_FROM, 0):
        initiator.process(scan)
    return learned_memory.write_learned(initiator.sensor.learned, sensor, "sonar", TIME)


def read(scene: str, text: str) -> Surroundings:
    return learned_memory.read_learned(text, SENSORS[scene][0], "sonar", TIME, DAY)[0]


def confirming_ping(scene: str, learned: Surroundings | None) -> tuple[int | None, Tracker]:
    """Ping at which a target confirms after a restart, with what was learned or without."""
    initiator, found = make_initiator("score", sensor=SENSORS[scene][0]), None
    if learned is not None:
        initiator.sensor.learned = learned
    for k, scan in enumerate(scans(scene, 25, 11, TARGET, 1000)):
        place = TARGET[0] + 12.0 * k * TARGET[1], TARGET[2] + 12.0 * k * TARGET[3]
        new = [math.dist(track.state[0::2], place) < 400.0 for track in initiator.process(scan)]
        found = k if found is None and any(new) else found
        if found is not None and k > found:
            break
    return found, initiator


@cache
def confirming_ping_alone(scene: str) -> int:
    found = confirming_ping(scene, None)[0]
    assert found is not None
    return found


def places(node: Any, *at: Any) -> Iterator[tuple[Any, ...]]:
    """Keys and indices that lead to every number."""
    if isinstance(node, (dict, list)):
        for key, value in node.items() if isinstance(node, dict) else enumerate(node):
            yield from places(value, *at, key)
    elif isinstance(node, (int, float)):
        yield at


def with_numbers_replaced(text: str, rng: np.random.Generator) -> tuple[str, str]:
    """The text with one to three numbers replaced, and which; mostly each name is as likely."""
    content = json.loads(text)
    every = list(places(content))
    by_name: dict[Any, list[tuple[Any, ...]]] = {}
    for place in every:
        by_name.setdefault(place if place[0] == "sensor" else place[0], []).append(place)
    names, chosen = list(by_name), {}
    for _ in range(rng.integers(1, 4)):
        among = by_name[names[rng.integers(len(names))]] if rng.random() < 0.7 else every
        chosen[among[rng.integers(len(among))]] = REPLACEMENTS[rng.integers(len(REPLACEMENTS))]
    for place, value in chosen.items():
        node = content
        for key in place[:-1]:
            node = node[key]
        node[place[-1]] = value
    return json.dumps(content), ", ".join(
        f"{at}: {str(value)[:20]}" for at, value in chosen.items()
    )


def check_replaced(number: int, rng: np.random.Generator) -> Counter[str]:
    """A text with numbers replaced is refused with a sentence, or used as well as none."""
    scene = SCENES[number % len(SCENES)]
    text, what = with_numbers_replaced(learned_text(scene), rng)
    try:
        learned = read(scene, text)
    except ValueError as error:
        assert "\n" not in str(error) and len(str(error)) < 400, f"{what}: {error}"
        return Counter({"learned values": 1, "learned values, refused": 1})
    found, initiator = confirming_ping(scene, learned)
    alone = confirming_ping_alone(scene)
    late = found is None or abs(found - alone) > 1
    assert not late, f"{scene}, {what}: confirms at ping {found}, not {alone}"
    again = learned_memory.write_learned(
        initiator.sensor.learned, initiator.sensor.model, "sonar", TIME
    )
    json.loads(again, parse_constant=pytest.fail)
    read(scene, again)
    return Counter({"learned values": 1, "learned values, used": 1})
