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
"""What was learned, as a text that outlives a restart.

It has the clutter map, where clutter is seen and the detection probability, with the sensor and the
time. What was learned fades with its age: after `HALF_LIFE` it counts as if half as many scans had
been seen. A text is used whole or refused: every number has bounds, and numbers that contradict
each other were not written by a run.
"""

from __future__ import annotations

import dataclasses
import json
import re
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.parameters import shown_parameter
from tsepm_ros.tracker.clutter.learned import COVERAGE, Surroundings
from tsepm_ros.tracker.clutter.sensor_performance import MAX_GAP
from tsepm_ros.tracker.polar_grid import MEMORY_SCANS
from tsepm_ros.tracker.sensor import SensorModel
from tsepm_ros.whole_files import read_json

FORMAT, FORMAT_OF_SEVERAL = 1, 2
"""Version of the text, of a sensor and of several."""
SIGNATURE = re.compile(rb'\s*\{\s*"format":\s*\d+,\s*"time":')
"""Begin of a learned state of any version."""
HALF_LIFE = 6.0 * 3600.0
"""Age at which what was learned counts half, s."""
MAX_HALF_LIVES = 40.0
"""What is older counts as if of this age: smaller shares vanish in products."""
INVALID_CONTENT = "its content is not that of a learned state"


class OtherCoverageError(ValueError):
    """A text is of a sensor of another coverage."""


def write_learned(learned: Surroundings, sensor: SensorModel, frame_id: str, time: float) -> str:
    """Write what was learned.

    Parameters
    ----------
    learned : Surroundings
    sensor : SensorModel
        As given.
    frame_id : str
        The sensor's frame.
    time : float
        Since 1970, s.

    Returns
    -------
    str
        JSON.

    Raises
    ------
    ValueError
        If a number is not finite.
    """
    counts, scans = learned.clutter_map.memory
    range_, azimuth = learned.seen_extent.places
    detected, covered = learned.detection_probability.memory
    return json.dumps(
        {
            "format": FORMAT,
            "time": time,
            "frame_id": frame_id,
            "sensor": dataclasses.asdict(sensor),
            "clutter_scans": scans,
            "clutter_counts": np.round(counts, 6).tolist(),
            # With its error, a detection in the coverage may be beyond its edge.
            "seen_range": range_.clip(sensor.min_range, sensor.max_range).round(3).tolist(),
            "seen_azimuth": np.round(azimuth, 6).tolist(),
            "detected": detected,
            "covered": covered,
        },
        allow_nan=False,
    )


def joined_learned(texts: Mapping[str, str], time: float) -> str:
    """The text of several sensors by their names; that of a single one, without a name, as it is.

    Parameters
    ----------
    texts : mapping of str to str
        From `write_learned`.
    time : float
        Since 1970, s.
    """
    if "" in texts:
        return texts[""]
    contents = {name: json.loads(text) for name, text in texts.items()}
    return json.dumps({"format": FORMAT_OF_SEVERAL, "time": time, "sensors": contents})


def learned_of(text: str, sensor: str) -> str:
    """What a joined text has of a sensor; the text itself for a single one, without a name.

    Raises
    ------
    ValueError
        If it has nothing of the sensor.
    """
    if not sensor:
        return text
    content = read_json(text)
    is_joined = isinstance(content, dict) and content.get("format") == FORMAT_OF_SEVERAL
    if not (is_joined and isinstance(of_sensors := content.get("sensors"), dict)):
        raise ValueError("it is not a learned state of several sensors")
    if sensor not in of_sensors:
        raise ValueError(f"it has nothing of {sensor}")
    return json.dumps(of_sensors[sensor])


def read_learned(
    text: str, sensor: SensorModel, frame_id: str, time: float, max_age: float
) -> tuple[Surroundings, float]:
    """Read what was learned before.

    Parameters
    ----------
    text : str
        From `write_learned`.
    sensor : SensorModel
        As given now.
    frame_id : str
        The sensor's frame; empty: not known yet.
    time : float
        Since 1970, s.
    max_age : float
        s.

    Returns
    -------
    learned : Surroundings
    age : float
        s.

    Raises
    ------
    OtherCoverageError
        If the coverage is another; nothing else was looked at then but the age.
    ValueError
        If the text is not of this format, of another sensor, older than `max_age` or of a time to
        come; the message says which.
    """
    content = _content(text)
    age = time - float(_numbers(content, "time", 0, -1e12, 1e12))
    if not 0.0 <= age <= max_age:
        raise ValueError(
            f"it is {'stale' if age > 0.0 else 'of a time to come'}: {abs(age) / 3600.0:.3g} h, at "
            f"most {max_age / 3600.0:g} h"
        )
    for name in COVERAGE:
        if content["sensor"].get(name) != getattr(sensor, name):
            raise OtherCoverageError(
                f"it is of another sensor: sensor.{name} was "
                f"{shown_parameter(content['sensor'].get(name))} and is {getattr(sensor, name)!r}"
            )
    if frame_id and content["frame_id"] not in ("", frame_id):
        raise ValueError(
            f"it is of another sensor: its frame was {shown_parameter(content['frame_id'])} and is "
            f"{frame_id!r}"
        )
    fresh = Surroundings.initial(sensor)
    numbers = {name: _numbers(content, name, *row) for name, row in _bounds(sensor).items()}
    for fault, contradicts in _contradictions(numbers, fresh.clutter_map.grid.shape).items():
        if contradicts:
            raise ValueError(f"{INVALID_CONTENT}: {fault}")
    share = 0.5 ** min(age / HALF_LIFE, MAX_HALF_LIVES)
    scans, detected, covered = (
        share * float(numbers[name]) for name in ("clutter_scans", "detected", "covered")
    )
    fresh.seen_extent.take(np.array([numbers["seen_range"], numbers["seen_azimuth"]]))
    fresh.clutter_map.remember(share * numbers["clutter_counts"], scans, fresh.seen_extent.region)
    fresh.detection_probability.remember(detected, covered)
    return fresh, age


def _content(text: str) -> dict[str, Any]:
    """The content of a text."""
    try:
        content = read_json(text)
    except ValueError:
        raise ValueError("it is not JSON") from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise ValueError(f"it is not a learned state of format {FORMAT}")
    if not isinstance(content.get("frame_id"), str) or not isinstance(content.get("sensor"), dict):
        raise ValueError("it names no sensor")
    return content


def _bounds(sensor: SensorModel) -> dict[str, tuple[int, float, float]]:
    """Dimensions, least and largest value of each number, or list of numbers."""
    return {
        "clutter_scans": (0, 0.0, MEMORY_SCANS + 1.0),
        "clutter_counts": (2, 0.0, 1e7),
        # Places were rounded when they were written.
        "seen_range": (1, sensor.min_range - 1e-3, sensor.max_range + 1e-3),
        "seen_azimuth": (1, -3.1416, 3.1416),
        "detected": (0, 0.0, 1e6),
        "covered": (0, 0.0, 1e6),
    }


def _numbers(
    content: dict[str, Any], name: str, dimensions: int, low: float, high: float
) -> FloatArray:
    """The numbers of a name as floats, if they are of these dimensions and within the bounds."""
    with suppress(ValueError):  # lists of unequal lengths
        values = np.asarray(content.get(name))
        within = values.dtype.kind in "fi" and values.ndim == dimensions
        if within and ((values >= low) & (values <= high)).all():
            return values.astype(float)
    raise ValueError(
        f"{INVALID_CONTENT}: {name} must be "
        f"{('a number', 'numbers', 'rows of numbers')[dimensions]} "
        f"from {low:g} to {high:g}; got {shown_parameter(content.get(name))}"
    )


def _contradictions(numbers: dict[str, FloatArray], shape: tuple[int, int]) -> dict[str, bool]:
    """Faults of numbers that are within their bounds, and whether the content has them.

    A detection of a target covers one scan at least, and `MAX_GAP` at most.
    """
    return {
        f"clutter_counts must be {shape[0]} rows of {shape[1]} numbers": (
            numbers["clutter_counts"].shape != shape
        ),
        "clutter_scans must be at least 1 where there are clutter_counts": bool(
            numbers["clutter_counts"].any() and numbers["clutter_scans"] < 1.0
        ),
        "seen_range and seen_azimuth must be as many": (
            len(numbers["seen_range"]) != len(numbers["seen_azimuth"])
        ),
        f"covered must be from detected to {MAX_GAP:g} times detected": not (
            0.98 * numbers["detected"] <= numbers["covered"] <= 1.02 * MAX_GAP * numbers["detected"]
        ),
    }
