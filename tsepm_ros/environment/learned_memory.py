"""What was learned, as a text that outlives a restart.

The text has the clutter map, where clutter is seen, its strengths and the detection probability,
with the sensor and the time. What was learned fades with its age: after `HALF_LIFE` it counts as if
half as many scans had been seen. A text is used whole or refused: every number has bounds, and
numbers that contradict each other were not written by a run.
"""

from __future__ import annotations

import dataclasses
import json
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from tsepm_ros.environment.clutter_map import MEMORY
from tsepm_ros.environment.clutter_strengths import MEMORY_QUANTILES
from tsepm_ros.environment.detection_probability import MAX_GAP
from tsepm_ros.environment.learned import Learned
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.parameters import shown
from tsepm_ros.sensing.sensor import SensorModel

FORMAT = 1
"""Version of the text."""
HALF_LIFE = 6.0 * 3600.0
"""Age at which what was learned counts half, s."""
MAX_HALF_LIVES = 40.0
"""What is older counts as if of this age: smaller shares vanish in products."""
UNLEARNED = "its content is not that of a learned state"
COVERAGE = ("min_range", "max_range", "azimuth_min", "azimuth_max")
"""Fields of the sensor that must be the same."""


@dataclass(frozen=True)
class Remembered:
    """What was learned before.

    Attributes
    ----------
    learned : Learned
    age : float
        s.
    """

    learned: Learned
    age: float


def written(learned: Learned, sensor: SensorModel, frame_id: str, time: float) -> str:
    """Write what was learned.

    Parameters
    ----------
    learned : Learned
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
    strengths, references, decibels = learned.strengths.memory
    detected, covered = learned.detection_probability.memory
    return json.dumps(
        {
            "format": FORMAT,
            "time": time,
            "frame_id": frame_id,
            "sensor": dataclasses.asdict(sensor),
            "clutter_scans": scans,
            "clutter_counts": np.round(counts, 6).tolist(),
            "seen_range": np.round(range_, 3).tolist(),
            "seen_azimuth": np.round(azimuth, 6).tolist(),
            "detected": detected,
            "covered": covered,
            "strengths": np.round(strengths, 6).tolist(),
            "strengths_count": references,
            "strengths_in_decibels": decibels,
        },
        allow_nan=False,
    )


def read(text: str, sensor: SensorModel, frame_id: str, time: float, max_age: float) -> Remembered:
    """Read what was learned before.

    Parameters
    ----------
    text : str
        From `written`.
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
    Remembered

    Raises
    ------
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
            raise ValueError(
                f"it is of another sensor: sensor.{name} was "
                f"{shown(content['sensor'].get(name))} and is {getattr(sensor, name)!r}"
            )
    if frame_id and content["frame_id"] not in ("", frame_id):
        raise ValueError(
            f"it is of another sensor: its frame was {shown(content['frame_id'])} and is "
            f"{frame_id!r}"
        )
    fresh = Learned.initial(sensor)
    numbers = {name: _numbers(content, name, *row) for name, row in _bounds(sensor).items()}
    for fault, found in _contradictions(content, numbers, fresh.clutter_map.grid.shape).items():
        if found:
            raise ValueError(f"{UNLEARNED}: {fault}")
    share = 0.5 ** min(age / HALF_LIFE, MAX_HALF_LIVES)
    scans, detected, covered, references = (
        share * float(numbers[name])
        for name in ("clutter_scans", "detected", "covered", "strengths_count")
    )
    fresh.seen_extent.remember(numbers["seen_range"], numbers["seen_azimuth"])
    fresh.clutter_map.remember(share * numbers["clutter_counts"], scans, fresh.seen_extent.region)
    fresh.strengths.remember(numbers["strengths"], references, content["strengths_in_decibels"])
    fresh.detection_probability.remember(detected, covered)
    return Remembered(fresh, age)


def _content(text: str) -> dict[str, Any]:
    """The content of a text; texts of earlier versions have no strengths."""
    try:
        content = json.loads(text)
    except (ValueError, RecursionError):
        raise ValueError("it is not JSON") from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise ValueError(f"it is not a learned state of format {FORMAT}")
    if not isinstance(content.get("frame_id"), str) or not isinstance(content.get("sensor"), dict):
        raise ValueError("it names no sensor")
    return {"strengths": [], "strengths_count": 0.0, "strengths_in_decibels": False} | content


def _bounds(sensor: SensorModel) -> dict[str, tuple[int, float, float]]:
    """Dimensions, least and largest value of each number, or list of numbers."""
    return {
        "clutter_scans": (0, 0.0, MEMORY + 1.0),
        "clutter_counts": (2, 0.0, 1e7),
        # Places were rounded when they were written.
        "seen_range": (1, sensor.min_range - 1e-3, sensor.max_range + 1e-3),
        "seen_azimuth": (1, -3.1416, 3.1416),
        "detected": (0, 0.0, 1e6),
        "covered": (0, 0.0, 1e6),
        "strengths": (1, -1e10, 1e10),
        "strengths_count": (0, 0.0, 1e4),
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
        f"{UNLEARNED}: {name} must be {('a number', 'numbers', 'rows of numbers')[dimensions]} "
        f"from {low:g} to {high:g}; got {shown(content.get(name))}"
    )


def _contradictions(
    content: dict[str, Any], numbers: dict[str, FloatArray], shape: tuple[int, int]
) -> dict[str, bool]:
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
        f"strengths must be {MEMORY_QUANTILES} in ascending order, or none": bool(
            len(numbers["strengths"]) not in (0, MEMORY_QUANTILES)
            or (np.diff(numbers["strengths"]) < 0.0).any()
        ),
        "strengths_in_decibels must be true or false": not isinstance(
            content["strengths_in_decibels"], bool
        ),
    }
