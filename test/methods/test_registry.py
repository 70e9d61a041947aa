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
"""Methods by name: their classes, their options, and what is refused."""

import sys

import pytest

from tsepm_ros import LandMask, SensorModel
from tsepm_ros.methods.registry import (
    METHODS,
    NODE_METHODS,
    available_methods,
    make_initiator,
    make_method,
    registered_method,
    registered_option_names,
)
from tsepm_ros.methods.score import Score
from tsepm_ros.methods.tsepm import Tsepm
from tsepm_ros.tracker.method import Method


def test_each_name_is_that_of_a_class_and_an_unknown_one_is_refused_with_all_names():
    assert available_methods() == tuple(METHODS)
    assert (registered_method("tsepm"), registered_method("score")) == (Tsepm, Score)
    assert all(issubclass(registered_method(name), Method) for name in METHODS)
    assert set(NODE_METHODS) <= set(METHODS)
    with pytest.raises(ValueError, match=r"method must be one of .*score.*; got 'scores'"):
        registered_method("scores")


def test_a_method_has_the_common_options_and_its_own():
    assert {"max_speed", "false_tracks_per_hour"} <= registered_option_names("score")
    assert "false_tracks_per_hour" not in registered_option_names("tsepm")


def test_options_go_to_the_group_that_has_them():
    made = make_method("score", sensor=SensorModel(), max_speed=4.0, false_tracks_per_hour=9.0)
    assert (made.common.max_speed, made.options.false_tracks_per_hour) == (4.0, 9.0)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"min_hits": 3}, "min_hits is not an option of method 'score'"),
        ({"max_sped": 3.0}, "did you mean max_speed"),
        ({"max_range": 3.0}, "did you mean sensor.max_range"),
        ({"max_speed": -1.0}, "max_speed must be above 0"),
    ],
)
def test_an_option_that_a_method_does_not_have_or_take_is_refused(options, sentence):
    with pytest.raises(ValueError, match=sentence):
        make_method("score", sensor=SensorModel(), **options)


def test_the_sensor_is_a_model():
    with pytest.raises(TypeError, match="sensor must be a SensorModel; got float"):
        make_method("score", sensor=3.0)


def test_an_initiator_has_its_method_and_the_land():
    land = LandMask([[True]], 10.0, (0.0, 0.0, 0.0))
    made = make_initiator("tsepm", sensor=SensorModel(), land=land, min_hits=3, window=4)
    assert isinstance(made.method, Tsepm)
    assert (made.method.options.min_hits, made.land) == (3, land)


def test_an_unknown_method_is_refused_and_the_known_are_named():
    with pytest.raises(ValueError, match=r"^method must be one of tsepm.*got 'unknown'"):
        make_initiator("unknown", sensor=SensorModel())


def test_an_option_that_the_method_does_not_have_is_refused_by_name():
    with pytest.raises(ValueError, match=r"^colour is not an option of method 'tsepm'.*min_hits"):
        make_initiator("tsepm", sensor=SensorModel(), colour="red", min_hits=4)


@pytest.mark.parametrize("sensor", [None, {"range_std": 1.0}, SensorModel], ids=str)
def test_a_wrong_sensor_is_refused_by_name(sensor):
    with pytest.raises(TypeError, match="sensor must be a SensorModel"):
        make_initiator("tsepm", sensor=sensor)


OUTSIDE = """
from tsepm_ros.methods.score import Score
from tsepm_ros.tracker.method import Method
number = 3
class Own(Score): ...
class Unlike: ...
class Bare(Method): ...
class Broken(Score):
    def __init__(self, *given):
        raise RuntimeError("no licence")
"""


@pytest.fixture
def outside(tmp_path, monkeypatch):
    """A module in the working folder, which is not on Python's path."""
    (tmp_path / "outside_methods.py").write_text(OUTSIDE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    yield
    sys.modules.pop("outside_methods", None)


def test_a_method_from_outside_the_package_is_made_by_its_place(outside):
    made = make_initiator("outside_methods:Own", sensor=SensorModel(), false_tracks_per_hour=3.0)
    assert type(made.method).__name__ == "Own"
    assert made.method.options.false_tracks_per_hour == 3.0


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("not_there:Own", "No module named 'not_there'"),
        ("outside_methods:Absent", "has no attribute 'Absent'"),
        ("outside_methods:", "expected module:name"),
        (":Own", "expected module:name"),
        ("outside_methods:Unlike", "is not a subclass of tsepm_ros.tracker.method.Method"),
        ("outside_methods:number", "is not a subclass"),
        ("outside_methods:Bare", "has no dataclass Options"),
        ("outside_methods:Broken", "cannot be made: RuntimeError: no licence"),
    ],
)
def test_what_is_no_method_from_outside_is_refused_by_its_place(outside, name, said):
    with pytest.raises(ValueError, match=said) as refused:
        make_initiator(name, sensor=SensorModel())
    assert str(refused.value).startswith(name)


def test_a_former_option_is_read_with_a_sentence():
    with pytest.warns(UserWarning, match=r"^plots: no longer used: target_extent above 0"):
        made = make_initiator("score", sensor=SensorModel(), plots="on", target_extent=3.0)
    assert made.common.target_extent == 3.0
