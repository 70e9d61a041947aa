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
"""Structured mutation of messages: some of their values become values that no driver means."""

import array
import copy
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

FLOATS = (
    *(0.0, -0.0, 1.0, -1.0, 0.5, 1e-3, 1e3, 59.9, 60.0, 61.0, 1e5, 1e6, 1e7, 1e9, 1e12, -1e12),
    *(1e-9, 1e-12, 1e-30, 1e-45, 5e-324, 1e-160, 1e150, 1e154, 1e155, 1e300, 1.7e308, -1.7e308),
    *(3.4e38, -3.4e38, float("inf"), float("-inf"), float("nan"), np.pi, -np.pi, 2 * np.pi, 1e17),
)
INTEGERS = (
    *(0, 1, 2, 3, 4, 7, 8, 9, 99, 100, 127, 128, 255, 256, 1000, 65535, 65536, 10**6, 10**9 - 1),
    *(10**9, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1, 2**64 - 1, -1, -2, -128, -(2**15), -(2**31)),
)
TEXTS = (
    *("", " ", "/", "sonar", "odom", "map", "elsewhere", "range", "azimuth", "x", "y", "bearing"),
    *("time_offset", "range_std", "../../etc/passwd", "%s%n", "\n", "a\nb", "\x1b[31m", "x" * 5000),
    *("\u202e\u0000", "none", "{}", "'; --"),
)
MAX_LEAVES = 400
"""Leaves of a message among which one is chosen; more are not listed."""

Set = Callable[[Any], None]
Leaf = tuple[Any, Set]
"""A value and what sets it."""


def names_of(message: Any) -> list[str]:
    """Names of a message's fields, of rclpy's classes or of stand-ins."""
    if hasattr(message, "get_fields_and_field_types"):
        return list(message.get_fields_and_field_types())
    return list(getattr(type(message), "__slots__", ()))


def leaves(message: Any) -> Iterator[Leaf]:
    """Values of a message that are no messages, at any depth; lists of messages are such, too."""
    for name in names_of(message):
        value = getattr(message, name)

        def put(new: Any, owner: Any = message, name: str = name) -> None:
            setattr(owner, name, new)

        if names_of(value):
            yield from leaves(value)
            continue
        yield value, put
        if isinstance(value, list):
            for element in value[:20]:
                if names_of(element):
                    yield from leaves(element)


def mutate(message: Any, rng: np.random.Generator) -> None:
    """Make one to three changes in a message."""
    for _ in range(int(rng.integers(1, 4))):
        if hasattr(message, "point_step") and rng.random() < 0.5:
            _change_points(message, rng)
            continue
        choice = [leaf for leaf, _ in zip(leaves(message), range(MAX_LEAVES), strict=False)]
        value, put = choice[rng.integers(len(choice))]
        for _ in range(4):  # a class of rclpy refuses what its field cannot hold
            try:
                put(changed(value, rng))
                break
            except (AssertionError, OverflowError, TypeError, ValueError):
                continue


def changed(value: Any, rng: np.random.Generator) -> Any:
    """Another value of the same type."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, str):
        return TEXTS[rng.integers(len(TEXTS))]
    if isinstance(value, bytes):
        return bytes(rng.integers(0, 256, 1, dtype=np.uint8))
    if isinstance(value, int):
        return INTEGERS[rng.integers(len(INTEGERS))]
    if isinstance(value, float):
        if rng.random() < 0.2:
            return value * float(10.0 ** rng.uniform(-12, 12))
        return FLOATS[rng.integers(len(FLOATS))]
    if isinstance(value, list | array.array | np.ndarray):
        return _changed_sequence(value, rng)
    return value


def _changed_sequence(value: Any, rng: np.random.Generator) -> Any:
    """Shorter, longer, empty, in another order, or with other elements."""
    number = len(value)
    kind = rng.integers(6)
    if isinstance(value, np.ndarray) and number in (9, 36):  # a covariance; its length is fixed
        kind = 5
    if kind == 0 or not number:
        return value[:0] if number else value
    if kind == 1:
        return value[: int(rng.integers(number))]
    if kind == 2:
        return value + value[: int(rng.integers(1, number + 1))] if not _is_array(value) else value
    if kind == 3 and not _is_array(value):
        order = rng.permutation(number)
        listed = [value[index] for index in order]
        return array.array(value.typecode, listed) if isinstance(value, array.array) else listed
    new = copy.copy(value)
    share = rng.choice([1, 2, number])
    hostile: Any = None
    for index in rng.integers(0, number, share).tolist():
        if hostile is None or rng.random() < 0.5:
            hostile = _element(value[index], rng)
        try:
            new[index] = hostile
        except (OverflowError, TypeError, ValueError):
            continue
    return new


def _element(value: Any, rng: np.random.Generator) -> Any:
    if isinstance(value, np.floating):
        return changed(float(value), rng)
    if isinstance(value, np.integer):
        return changed(int(value), rng)
    return changed(value, rng)


def _is_array(value: Any) -> bool:
    return isinstance(value, np.ndarray)


def _change_points(cloud: Any, rng: np.random.Generator) -> None:
    """Change numbers in the data of a cloud: a field of some points, or bytes anywhere."""
    data = bytearray(bytes(cloud.data))
    if not data or not cloud.fields:
        return
    if rng.random() < 0.15:
        for place in rng.integers(0, len(data), int(rng.integers(1, 9))).tolist():
            data[place] = int(rng.integers(256))
    else:
        field = cloud.fields[rng.integers(len(cloud.fields))]
        form = {7: "<f4", 8: "<f8", 6: "<u4", 4: "<u2"}.get(field.datatype, "<f4")
        points = min(max(1, cloud.width * cloud.height), 1000)
        chosen = range(points) if rng.random() < 0.2 else rng.integers(0, points, 2).tolist()
        for point in chosen:
            start = point * cloud.point_step + field.offset
            with np.errstate(all="ignore"):
                new = FLOATS[rng.integers(len(FLOATS))]
                new = new if form[1] == "f" else abs(INTEGERS[rng.integers(len(INTEGERS))]) % 2**16
                part = np.array(new).astype(form).tobytes()
            if start + len(part) <= len(data):
                data[start : start + len(part)] = part
    cloud.data = array.array("B", bytes(data))
