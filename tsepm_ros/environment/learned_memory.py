"""What was learned, as a text that outlives a restart.

The text has the clutter map, where clutter is seen, its strengths and the detection probability,
with the sensor and the time. What was learned fades with its age: after `HALF_LIFE` it counts as if
half as many scans had been seen.
"""

from __future__ import annotations

import dataclasses
import json
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from tsepm_ros.environment.learned import Learned
from tsepm_ros.sensing.sensor import SensorModel

FORMAT = 1
"""Version of the text."""
HALF_LIFE = 6.0 * 3600.0
"""Age at which what was learned counts half, s."""
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
    """
    counts, scans = learned.clutter_map.memory
    range_, azimuth = learned.seen_extent.places
    strengths, references, decibels = learned.strengths.memory
    detected, covered = learned.detection_probability.memory
    content = {
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
    }
    return json.dumps(content)


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
    age = time - content["time"]
    if not 0.0 <= age <= max_age:
        when = "stale" if age > 0.0 else "of a time to come"
        raise ValueError(f"it is {when}: {abs(age) / 3600.0:.3g} h, at most {max_age / 3600.0:g} h")
    given = content["sensor"]
    for name in COVERAGE:
        if given.get(name) != getattr(sensor, name):
            raise ValueError(
                f"it is of another sensor: sensor.{name} was {given.get(name)!r} and is "
                f"{getattr(sensor, name)!r}"
            )
    if frame_id and content["frame_id"] not in ("", frame_id):
        raise ValueError(
            f"it is of another sensor: its frame was {content['frame_id']!r} and is {frame_id!r}"
        )
    share = 0.5 ** (age / HALF_LIFE)
    fresh = Learned.initial(sensor)
    try:
        places = np.array([content["seen_range"], content["seen_azimuth"]], float)
        _check(places.ndim == 2 and _all_finite(places) and bool((places[0] >= 0.0).all()))
        counts = np.array(content["clutter_counts"], float)
        figures = [float(content[name]) for name in ("clutter_scans", "detected", "covered")]
        _check(_all_finite(counts) and _all_finite(np.array(figures)))
        _check(bool((counts >= 0.0).all()) and min(figures) >= 0.0)
        _check(counts.shape == fresh.clutter_map.memory[0].shape)
        # Texts of earlier versions have no strengths.
        strengths = np.array(content.get("strengths", []), float)
        references = float(content.get("strengths_count", 0.0))
        _check(strengths.ndim == 1 and _all_finite(np.append(strengths, references)))
    except (KeyError, TypeError, ValueError, OverflowError):
        raise ValueError("its content is not that of a learned state") from None
    fresh.seen_extent.remember(places[0], places[1])
    fresh.clutter_map.remember(share * counts, share * figures[0], fresh.seen_extent.region)
    decibels = bool(content.get("strengths_in_decibels", False))
    fresh.strengths.remember(np.sort(strengths), share * references, decibels)
    fresh.detection_probability.remember(share * figures[1], share * figures[2])
    return Remembered(fresh, age)


def _content(text: str) -> dict[str, Any]:
    try:
        content = json.loads(text)
    except (ValueError, RecursionError):
        raise ValueError("it is not JSON") from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise ValueError(f"it is not a learned state of format {FORMAT}")
    time, frame_id = content.get("time"), content.get("frame_id")
    if not isinstance(time, (int, float)) or not math.isfinite(time):
        raise ValueError("it has no time")
    if not isinstance(frame_id, str) or not isinstance(content.get("sensor"), dict):
        raise ValueError("it names no sensor")
    return content


def _check(valid: bool) -> None:
    if not valid:
        raise ValueError


def _all_finite(values: np.ndarray[Any, Any]) -> bool:
    return bool(np.isfinite(values).all())
