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
"""Tables of parameters: fields, bounds and choices, and values that are refused with a sentence."""

import math
from dataclasses import dataclass

import numpy as np
import pytest

from tsepm_ros.parameters import ParameterGroup, parameter, parameter_table
from tsepm_ros.tracker.options import CommonOptions


@dataclass(frozen=True, kw_only=True)
class Example(ParameterGroup):
    """One of everything."""

    flag: bool = parameter(True, "A flag")
    count: int = parameter(3, "A count", minimum=1, maximum=9)
    length: float = parameter(2.5, "A length", unit="m", positive=True, maximum=10.0)
    depth: float = parameter(0.0, "A depth", unit="m", minimum=0.0)
    shift: float = parameter(0.0, "A shift", minimum=-2.0, maximum=2.0)
    any: float = parameter(0.0, "Any number")
    mode: str = parameter("slow", "A mode", choices=("slow", "fast"), read_only=True)
    name: str = parameter("", "A name")


ROWS = {row.name: row for row in parameter_table(Example)}


def test_the_table_has_every_field_in_order_with_its_default_and_type():
    assert list(ROWS) == ["flag", "count", "length", "depth", "shift", "any", "mode", "name"]
    assert [row.default for row in ROWS.values()] == [True, 3, 2.5, 0.0, 0.0, 0.0, "slow", ""]
    assert [row.type for row in ROWS.values()] == [bool, int, *[float] * 4, str, str]
    assert [row.name for row in ROWS.values() if row.read_only] == ["mode"]
    assert ROWS["length"].unit == "m"


@pytest.mark.parametrize(
    ("name", "bounds"),
    [
        ("flag", ""),
        ("count", "from 1 to 9"),
        ("length", "above 0 and at most 10"),
        ("depth", "at least 0"),
        ("shift", "from -2 to 2"),
        ("any", ""),
        ("mode", "one of slow, fast"),
        ("name", ""),
    ],
)
def test_bounds_are_said_in_words(name, bounds):
    assert ROWS[name].bounds == bounds


@pytest.mark.parametrize(
    ("name", "value", "taken"),
    [
        ("flag", False, False),
        ("flag", np.bool_(True), True),
        ("count", 1, 1),
        ("count", 9, 9),
        ("count", np.int32(4), 4),
        ("length", 10, 10.0),
        ("length", 5e-324, 5e-324),
        ("length", np.float32(0.5), 0.5),
        ("length", np.array(1.5), 1.5),
        ("depth", 0, 0.0),
        ("depth", math.inf, math.inf),
        ("shift", -2.0, -2.0),
        ("mode", "fast", "fast"),
        ("name", "anything at all", "anything at all"),
    ],
)
def test_allowed_values_are_taken_in_the_parameter_s_type(name, value, taken):
    found = getattr(Example(**{name: value}), name)
    assert found == taken
    assert type(found) is type(taken) is ROWS[name].type


@pytest.mark.parametrize(("value", "taken"), [(True, "on"), (False, "off")])
def test_a_choice_of_on_and_off_takes_what_yaml_reads_as_bool(value, taken):
    assert CommonOptions(limit_speed=value).limit_speed == taken
    with pytest.raises(ValueError, match="mode"):
        Example(mode=value)  # slow or fast


@pytest.mark.parametrize(
    ("name", "value", "sentence"),
    [
        ("flag", 1, "flag must be true or false; got 1"),
        ("flag", "true", "flag must be true or false; got 'true'"),
        ("count", 0, "count must be from 1 to 9; got 0"),
        ("count", 10, "count must be from 1 to 9; got 10"),
        ("count", 2.0, "count must be an integer; got 2.0"),
        ("count", True, "count must be an integer; got True"),
        ("count", "3", "count must be an integer; got '3'"),
        ("length", 0.0, "length must be above 0 and at most 10; got 0.0"),
        ("length", -1, "length must be above 0 and at most 10; got -1"),
        ("length", 10.1, "length must be above 0 and at most 10; got 10.1"),
        ("length", math.nan, "length must be above 0 and at most 10; got nan"),
        ("length", True, "length must be a number; got True"),
        ("length", "5", "length must be a number; got '5'"),
        ("length", None, "length must be a number; got None"),
        ("length", [1.0], "length must be a number; got [1.0]"),
        ("depth", -1e-9, "depth must be at least 0; got -1e-09"),
        ("depth", "-1e-09", "depth must be at least 0; got -1e-09"),
        ("length", "1e+99", "length must be above 0 and at most 10; got 1e+99"),
        ("shift", 2.1, "shift must be from -2 to 2; got 2.1"),
        ("any", math.nan, "any must be a number; got nan"),
        ("mode", "Fast", "mode must be one of slow, fast; got 'Fast'"),
        ("mode", 1, "mode must be a text, one of slow, fast; got 1"),
        ("name", None, "name must be a text; got None"),
    ],
)
def test_other_values_are_refused_with_a_sentence(name, value, sentence):
    with pytest.raises(ValueError) as refused:
        Example(**{name: value})
    assert str(refused.value) == sentence


@pytest.mark.parametrize("value", [np.array([1.0, 2.0]), 10**400], ids=["array", "beyond float64"])
def test_what_is_no_float64_is_refused_with_a_sentence(value):
    with pytest.raises(ValueError, match="length must be"):
        Example(length=value)
