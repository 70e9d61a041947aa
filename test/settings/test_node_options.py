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
"""Groups of the nodes' options: each field is described and checked."""

import dataclasses

import pytest

from tsepm_ros import SensorModel
from tsepm_ros.methods.tsepm import TsepmOptions
from tsepm_ros.parameters import parameter_table
from tsepm_ros.settings.node_options import (
    AlarmOptions,
    InitiatorNodeOptions,
    PlaybackOptions,
    PlayerNodeOptions,
    SessionOptions,
    SimulatorNodeOptions,
    ViewerNodeOptions,
    gate_lines,
)
from tsepm_ros.tracker.options import CommonOptions

GROUPS = [
    CommonOptions,
    TsepmOptions,
    SensorModel,
    SessionOptions,
    InitiatorNodeOptions,
    PlaybackOptions,
    SimulatorNodeOptions,
    PlayerNodeOptions,
    AlarmOptions,
]


@pytest.mark.parametrize("group", GROUPS, ids=lambda group: group.__name__)
def test_every_field_of_every_group_is_in_its_table_with_a_description(group):
    rows = {row.name: row for row in parameter_table(group)}
    assert list(rows) == [field.name for field in dataclasses.fields(group)]
    for row in rows.values():
        assert row.description
        assert not row.description.endswith(".")
        assert row.check(row.default) == row.default


@pytest.mark.parametrize("group", GROUPS, ids=lambda group: group.__name__)
def test_every_group_checks_itself(group):
    for row in parameter_table(group):
        with pytest.raises(ValueError, match=f"^{row.name} must be"):
            group(**{row.name: object()})


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"host": ""}, "host must not be empty"),
        ({"token": "short"}, "at least .* characters"),
        ({"token": "ä" * 40}, "ASCII"),
        ({"token": "a line\n" * 4}, "printable"),
    ],
)
def test_an_address_or_token_that_the_page_cannot_use_is_refused(values, words):
    with pytest.raises(ValueError, match=words):
        ViewerNodeOptions(**values)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"min_range": 500.0, "max_range": 500.0}, "guard_min_range must be below"),
        ({"azimuth_min": 0.5, "azimuth_max": 0.5}, "guard_azimuth_max must be above"),
        ({"azimuth_min": -6.0, "azimuth_max": 6.0}, "by at most 2 pi"),
    ],
)
def test_a_guard_zone_without_an_area_is_refused(values, words):
    with pytest.raises(ValueError, match=words):
        AlarmOptions(**{f"guard_{name}": value for name, value in values.items()})


@pytest.mark.parametrize("start", [0.0, -3.1416, -1.0])
def test_a_guard_zone_all_round_is_a_whole_turn_as_a_coverage_is(start):
    zone = AlarmOptions(guard_azimuth_min=start, guard_azimuth_max=start + 6.2832)
    assert zone.guard_azimuth_max == start + 6.2832


def test_a_guard_zone_that_is_off_has_any_near_limit():
    assert AlarmOptions(guard_min_range=500.0).guard_max_range == 0.0


def test_gates_are_lines_with_two_ends():
    assert gate_lines("") == [] and AlarmOptions().gates == ""
    assert gate_lines("0,0,0,100; 1.5,-2,3,4;") == [(0, 0, 0, 100), (1.5, -2, 3, 4)]
    for text in ("1,2,3", "1,2,1,2", "a,b,c,d", "0,0,inf,1", "0,0,0,1;0"):
        with pytest.raises(ValueError, match=r"gates must be x1,y1,x2,y2"):
            AlarmOptions(gates=text)
