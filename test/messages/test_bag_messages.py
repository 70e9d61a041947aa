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
"""Messages of every supported type as the library rosbags reads them from a bag."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from msg_adapters import (
    make_header,
    odometry_message,
    read_detections,
    read_own_ship,
    supported_types,
)

pytest.importorskip("rosbags", reason="bags need the library rosbags")

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from support.bag_files import Entry, of_definition, write_bag
from support.driver_messages import MAKERS, echoes_of

from tsepm_ros.own_ship.pose_history import PoseSample
from tsepm_ros.tools.replay.bag import LAYOUTS, Bag


@pytest.fixture(scope="module")
def store():
    made = get_typestore(Stores.ROS2_JAZZY)
    for name, text in LAYOUTS.items():
        made.register(get_types_from_msg(text, name))
    return made


def type_name(message: Any) -> str:
    kind = type(message)
    return f"{kind.__module__.partition('.')[0]}/msg/{kind.__name__}"


def through_a_bag(store: Any, tmp_path: Any, message: Any) -> Any:
    name = type_name(message)
    data = bytes(store.serialize_cdr(of_definition(store, message, name), name))
    with Bag(write_bag(tmp_path / "bag", [Entry(1.0, "/a", name, data)], store=store)) as bag:
        [found] = bag.messages(["/a"])
        return bag.read(found)


def assert_same(one: Any, other: Any) -> None:
    """Whether two values are equal to the bit, field by field."""
    assert type(one) is type(other)
    if dataclasses.is_dataclass(one):
        for field in dataclasses.fields(one):
            assert_same(getattr(one, field.name), getattr(other, field.name))
    elif isinstance(one, dict):
        assert one.keys() == other.keys()
        for name in one:
            assert_same(one[name], other[name])
    else:
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("echoes", [12, 0])
@pytest.mark.parametrize("name", supported_types())
def test_a_bags_message_is_read_like_the_one_of_ros(store, tmp_path, name, echoes):
    message, _ = MAKERS[name](make_header(12_000_000_345, "sonar"), echoes_of(3)[:echoes])
    expected = read_detections(message)
    found = read_detections(through_a_bag(store, tmp_path, message))
    assert len(expected) > 5 if echoes else (len(expected), expected.dropped) == (0, {})
    assert_same(expected, found)


def test_a_bags_odometry_is_read_like_the_one_of_ros(store, tmp_path):
    covariance = np.diag([4.0, 9.0, 0.01])
    rates = (3.0, 4.0, 0.05)
    sample = PoseSample(7.0, 1.5, -2.5, 0.7, covariance, rates, 0.1, -0.2, "odom", "sonar")
    message = odometry_message(sample)
    expected, found = read_own_ship(message), read_own_ship(through_a_bag(store, tmp_path, message))
    assert_same(expected, found)
