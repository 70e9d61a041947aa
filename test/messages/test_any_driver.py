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
"""Messages of every supported type give the tracks of the core, and none does harm."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import Point, Pose, Vector3
from support.driver_messages import MAKERS, echoes_of

from msg_adapters import (
    MessageError,
    detections,
    make_header,
    read_detections,
    supported_types,
)
from msg_adapters.point_cloud import NO_TIMES
from tsepm_ros import Scan, SensorModel, make_initiator
from tsepm_ros.session.session import Session
from tsepm_ros.settings.node_options import SessionOptions
from tsepm_ros.settings.settings import Settings

START = 1_700_000_000

PERIOD = 12

PINGS = 12

EVERY_TYPE = pytest.mark.parametrize("type_name", list(MAKERS))

SAID = {"PointCloud2": (NO_TIMES,), "LaserScan": (detections.NO_TIMES,)}

METHODS = pytest.mark.parametrize("method", ["tsepm", "score"])


def header_at(seconds: float, frame_id: str = "sonar") -> Any:
    return make_header(round(seconds * 1e9), frame_id)


def test_every_supported_type_is_tested_here():
    assert set(MAKERS) == set(supported_types())


@METHODS
@EVERY_TYPE
def test_messages_give_the_tracks_of_the_core_on_the_same_numbers(type_name, method):
    # Both compute in float64 from the same numbers, float32 where the message has them: what
    # differs is the order of operations. 1e-9 of a state is micrometres.
    session = Session(Settings(SessionOptions(method=method)))
    core = make_initiator(method, sensor=SensorModel())
    confirmed = 0
    for index in range(PINGS):
        stamp = START + PERIOD * index
        message, numbers = MAKERS[type_name](header_at(stamp), echoes_of(index))
        detections = read_detections(message)
        said = SAID.get(type_name.rpartition("/")[2], ())
        assert (detections.dropped, detections.assumptions) == ({}, said)
        session.add_scan(detections.sensor_scan, 0.0)
        [result] = session.process()
        expected = core.process(Scan(stamp=stamp, **numbers))
        assert [track.hits for track in result.new] == [track.hits for track in expected]
        for one, other in zip(result.new, expected, strict=True):
            np.testing.assert_allclose(one.state, other.state, rtol=1e-9, atol=1e-9)
            scale = np.linalg.norm(other.covariance)
            np.testing.assert_allclose(one.covariance, other.covariance, rtol=0, atol=1e-9 * scale)
        confirmed += len(expected)
    assert confirmed >= 2, "the scene must confirm tracks, or nothing was compared"
    assert session.dropped == {}


NASTY = (math.nan, math.inf, -math.inf, 0.0, -1.0, 1e-45, 3e38, -3e38, 1.6, 1e8)


def spoil(value: Any, rng: np.random.Generator, largest: float) -> Any:
    """A value of the same type with nasty numbers in it and of another length."""
    if isinstance(value, float):
        return rng.choice([*NASTY, largest]) if rng.random() < 0.2 else value
    if isinstance(value, int | str):
        return value
    if hasattr(value, "typecode") or isinstance(value, list):
        items = [spoil(item, rng, largest) for item in value]
        if rng.random() < 0.3:
            items = items[: rng.choice([0, 1, len(items) // 2])]
        return items
    return value


DOUBLES = (Point, Pose, Vector3)


def spoil_message(message: Any, rng: np.random.Generator) -> None:
    """Spoil every field of a message and of the messages in it, in place."""
    fields = getattr(message, "__slots__", ())
    largest = 1e308 if isinstance(message, DOUBLES) else 3e38
    for name in (field.lstrip("_") for field in fields if field != "_check_fields"):
        value = getattr(message, name)
        if hasattr(value, "__slots__") and not hasattr(value, "typecode"):
            spoil_message(value, rng)
        elif isinstance(value, list) and value and hasattr(value[0], "__slots__"):
            for item in value:
                spoil_message(item, rng)
            setattr(message, name, spoil(value, rng, largest))
        elif name not in ("covariance", "data", "fields"):
            setattr(message, name, spoil(value, rng, largest))


@EVERY_TYPE
@pytest.mark.filterwarnings("error")
def test_nothing_that_arrives_is_worse_than_refused(type_name):
    rng = np.random.default_rng(5)
    outcomes = set()
    for trial in range(80):
        message, _ = MAKERS[type_name](header_at(START), echoes_of(trial))
        if type_name.endswith("PointCloud2"):
            data = np.frombuffer(message.data, np.float32).copy()
            data[rng.random(len(data)) < 0.1] = rng.choice(NASTY)
            message.data = data.tobytes()[: rng.choice([len(data) * 4, len(data)])]
        else:
            spoil_message(message, rng)
        try:
            found = read_detections(message, sound_speed=1500.0 * (trial % 2))
        except MessageError as error:
            outcomes.add(error.reason)
            continue
        dataclasses.replace(found.scan)  # passes all the checks of the constructor
        outcomes |= found.dropped.keys()
        outcomes |= {"good"} if len(found) else set()
    assert len(outcomes) > 3, outcomes
    assert "good" in outcomes
