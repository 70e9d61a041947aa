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
"""Every reason that is counted is described, and no other."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from msg_adapters.ping import ReadingOptions, good_detections
from tsepm_ros.session.drop_reasons import (
    CUT,
    DROP_REASONS,
    MAX_SENTENCE,
    drop_reason_of,
    shortened_reason,
)
from tsepm_ros.session.inputs import UNUSABLE

ROOT = Path(__file__).parents[2]

SOURCES = [
    path
    for package in ("tsepm_ros", "msg_adapters")
    for path in ROOT.glob(f"{package}/**/*.py")
    if path.parent.name != "bridge"  # what a bridge does not send, its log alone says
]
NOT_COUNTED = {"not_finite", "zero_quaternion", "undefined_heading", "bad_id", "no_own_ship"}
"""Of odometry and of what is tracked: counted as own_ship_invalid and as tracked_bad_id; and of a
bridge."""


def literals(path: Path) -> Iterator[str]:
    """Texts that stand in a module where reasons do."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Call):
            yield from of_call(node, path)
        elif isinstance(node, ast.Assign) and isinstance(node.value, ast.IfExp):
            if getattr(node.targets[0], "id", "") == "reason":
                yield from texts(node.value)
        elif isinstance(node, ast.Dict) and path.name == "inputs.py":
            yield from (key.value for key in node.keys if is_text(key))


def of_call(node: ast.Call, path: Path) -> Iterator[str]:
    """Those in a call that drops or refuses."""
    name = getattr(node.func, "attr", getattr(node.func, "id", ""))
    refuses = name in ("refusing", "_drop") and path.parent.name in ("msg_adapters", "session")
    if (refuses or name in ("drop", "MessageError", "Rejection")) and node.args:
        yield from texts(node.args[0])  # of a choice between two, both
    if name == "_refuse":  # rows of reason, whether it applies, and sentence
        rows = [one.elts for one in ast.walk(node) if isinstance(one, ast.Tuple)]
        yield from (row[0].value for row in rows if len(row) == 3 and is_text(row[0]))
    for keyword in node.keywords:
        if keyword.arg in ("reason", "prefix") and name == "_dropping":
            yield keyword.value.value
        if keyword.arg == "faults" and isinstance(keyword.value, ast.Dict):
            yield from (key.value for key in keyword.value.keys)


def texts(node: ast.AST) -> Iterator[str]:
    yield from (one.value for one in ast.walk(node) if is_text(one))


def is_text(node: ast.AST | None) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def faults_of_numbers() -> set[str]:
    """The reasons of all adapters, from numbers that are wrong in every way."""
    bad = np.array([1.0, np.nan, np.inf, -np.inf, 0.0, -1.0, 1e-300, 1e300])
    n = len(bad)
    found: set[str] = set()
    names = ("range", "azimuth", "range_std", "azimuth_std", "time_offset", "transmit_offset")
    for name in names:
        values = {"range": np.ones(n), "azimuth": np.zeros(n), name: bad}
        found |= set(good_detections(0, "sonar", ReadingOptions(), **values).dropped)
    return found


def counted() -> set[str]:
    """Everything that the code counts."""
    found = {text for path in SOURCES for text in literals(path)}
    parts = {text for text in found if text.endswith("_")}  # of scan_..., tracked_...
    assert parts == {"scan_", "tracked_"}
    found -= parts
    layouts = {name for name in found if f"tracked_{name}" in DROP_REASONS}
    of_layouts = {f"tracked_{name}" for name in layouts}
    of_stamps = {f"scan_{arrival.value}" for arrival in UNUSABLE}
    of_bearings = {"bearing_stamp", "bearing_azimuth", "bearing_geometry"}
    return (found - NOT_COUNTED) | of_layouts | of_stamps | of_bearings | faults_of_numbers()


def test_every_reason_of_the_code_is_described_and_no_other():
    assert counted() == set(DROP_REASONS)


@pytest.mark.parametrize("name", DROP_REASONS)
def test_a_description_says_what_is_lost_why_and_what_to_do(name):
    reason = DROP_REASONS[name]
    assert reason.lost in ("detection", "scan", "message", "pose", "target", "report", "chart")
    assert reason.meaning and reason.remedy
    assert "|" not in reason.meaning + reason.remedy


def test_a_reason_of_another_s_adapter_is_one_of_detections():
    assert (drop_reason_of("my_own").task, drop_reason_of("my_own").lost) == (
        "detections",
        "detection",
    )


def test_a_sentence_that_is_too_long_lacks_its_middle_and_another_nothing():
    fits = "ab" * (MAX_SENTENCE // 2)
    assert shortened_reason(fits) == fits
    begin, end = shortened_reason(f"{fits}c").split(CUT)
    assert fits.startswith(begin) and fits.endswith(end[:-1]) and end.endswith("c")
    assert len(begin + CUT + end) == MAX_SENTENCE and abs(len(begin) - len(end)) <= 1


def test_the_operating_page_has_every_reason_with_its_remedy():
    page = (ROOT / "docs/diagnostics.md").read_text(encoding="utf-8")
    for name, reason in DROP_REASONS.items():
        assert re.search(rf"`{name}`(, `\w+`)*: {re.escape(reason.meaning)}", page)
        assert f"| {reason.lost} | {reason.remedy} |" in page
