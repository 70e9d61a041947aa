"""Everything that is learned, and its memory over a restart.

The width of the distribution of clutter's range rates, learned from the scans.

The interval between scans, from their stamps.

Models of the surroundings, independent of the method.

What was learned, as a text that outlives a restart.

The text has the clutter map, where clutter is seen, its strengths and the detection probability,
with the sensor and the time. What was learned fades with its age: after `HALF_LIFE` it counts as if
half as many scans had been seen. A text is used whole or refused: every number has bounds, and
numbers that contradict each other were not written by a run.
"""

from __future__ import annotations

import dataclasses
import json
import statistics
from collections import deque
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.numerics.arrays import FloatArray, taken
from tsepm_ros.parameters import shown
from tsepm_ros.tracker.clutter.amplitude import MEMORY_QUANTILES, ClutterAmplitudes
from tsepm_ros.tracker.clutter.density import ClutterMap
from tsepm_ros.tracker.clutter.detection_probability import MAX_GAP, DetectionProbability
from tsepm_ros.tracker.clutter.excess import (
    MEMORY,
    Batch,
    Overdispersion,
    SecondaryEchoes,
)
from tsepm_ros.tracker.clutter.fixed_places import FixedPlaces
from tsepm_ros.tracker.clutter.measurement_errors import MeasurementErrors
from tsepm_ros.tracker.clutter.seen import EVERYWHERE, Extent, SeenExtent
from tsepm_ros.tracker.maintenance.features import Surroundings
from tsepm_ros.tracker.range_rates import measured, over_ground
from tsepm_ros.tracker.sensor import SensorModel

MIN_RATE_COUNT = 20
"""Smallest number of range rates for an estimate: below, the given width is used."""
MAX_CLUTTER_RANGE_RATE = 1e4
"""Largest estimate of the median magnitude of clutter's range rates, m/s."""
RANGE_RATE_MEMORY = 50
"""Number of latest scans in the estimate."""


class ClutterRangeRates:
    """Estimates the median magnitude of clutter's range rates: most detections are clutter."""

    def __init__(self) -> None:
        self._rates: deque[FloatArray] = deque(maxlen=RANGE_RATE_MEMORY)

    def update(self, detections: NDArray[np.void]) -> None:
        """Update the estimate with the range rates of a scan's detections."""
        rated = taken(detections, measured(detections))
        if len(rated):
            self._rates.append(np.abs(over_ground(rated)))

    def estimate(self, sensor: SensorModel) -> SensorModel:
        """The sensor with the median magnitude over ground as `clutter_range_rate`.

        With fewer than `MIN_RATE_COUNT` range rates the sensor is returned unchanged.
        """
        rates = np.concatenate(self._rates) if self._rates else np.zeros(0)
        if len(rates) < MIN_RATE_COUNT:
            return sensor
        width = max(float(np.median(rates)), 0.5 * sensor.range_rate_std)
        return replace(sensor, clutter_range_rate=min(width, MAX_CLUTTER_RANGE_RATE))


MAX_INTERVALS = 50
"""Intervals of which the median is taken."""


class ScanInterval:
    """Median of the last intervals: a lost ping or a pause does not change it.

    Attributes
    ----------
    median : float
        s; 0 while it is unknown.
    """

    def __init__(self) -> None:
        self._intervals: deque[float] = deque(maxlen=MAX_INTERVALS)
        self.median = 0.0

    def update(self, interval: float) -> None:
        """Take the time since the scan before, s; 0 for the first scan."""
        if interval > 0.0:
            self._intervals.append(interval)
            self.median = statistics.median(self._intervals)


ERRORS = "range_std", "range_std_fraction", "azimuth_std"
"""Fields of a sensor that innovations are compared with."""


@dataclass(frozen=True)
class Learned:
    """Models learned from the scans so far; they survive a change of method.

    Attributes
    ----------
    clutter_map : ClutterMap
    clumps : Overdispersion
        How much lumpier clutter is than the map.
    seen_extent : SeenExtent
        Where clutter is seen, in the coverage.
    strengths : ClutterAmplitudes
        Strengths of clutter.
    persistent : FixedPlaces
        Where clutter stays in the fixed frame.
    secondary_echoes : SecondaryEchoes
        Clutter behind targets, and behind other clutter of a scan.
    batch : Batch
        Detections of the last scans that are not learned from yet.
    all_extent : SeenExtent
        Where detections are, outside the coverage too, of scans that have such.
    scan_interval : ScanInterval
    clutter_range_rates : ClutterRangeRates
        Range rates of clutter.
    detection_probability : DetectionProbability
        Estimated from the held tracks.
    features : Surroundings
        Features of the plots.
    errors : MeasurementErrors
        Innovations of the held tracks' detections.
    """

    clutter_map: ClutterMap
    clumps: Overdispersion
    seen_extent: SeenExtent
    strengths: ClutterAmplitudes
    persistent: FixedPlaces
    secondary_echoes: SecondaryEchoes
    batch: Batch
    all_extent: SeenExtent = field(default_factory=lambda: SeenExtent(EVERYWHERE))
    scan_interval: ScanInterval = field(default_factory=ScanInterval)
    clutter_range_rates: ClutterRangeRates = field(default_factory=ClutterRangeRates)
    detection_probability: DetectionProbability = field(default_factory=DetectionProbability)
    features: Surroundings = field(default_factory=Surroundings)
    errors: MeasurementErrors = field(default_factory=MeasurementErrors)

    @classmethod
    def initial(cls, sensor: SensorModel) -> Learned:
        """Models before the first scan of a sensor."""
        clutter_map = ClutterMap(sensor)
        grid = clutter_map.grid
        return cls(
            clutter_map,
            Overdispersion(grid),
            SeenExtent(Extent.of(sensor)),
            ClutterAmplitudes(grid.shape, grid.wraps),
            FixedPlaces(sensor),
            SecondaryEchoes(grid),
            Batch(grid.shape[1]),
        )

    def learn_map(self, min_area: float) -> None:
        """Learn the density from the batch; see `ClutterMap.update`."""
        batch, seen = self.batch, self.seen_extent
        seen.update(*batch.polar, batch.weight)
        places = batch.cells, batch.weight
        self.clutter_map.update(*places, lambda: seen.region, min_area, batch.looks)

    def under(self, sensor: SensorModel, before: SensorModel) -> Learned:
        """The models for a sensor in place of the one before.

        The clutter map is kept only for the same coverage, innovations only for the same errors.
        """
        same_errors = all(getattr(sensor, name) == getattr(before, name) for name in ERRORS)
        kept = self if same_errors else replace(self, errors=MeasurementErrors())
        if self.clutter_map.fits(sensor):
            return kept
        fresh = Learned.initial(sensor)
        return replace(
            kept,
            clutter_map=fresh.clutter_map,
            clumps=fresh.clumps,
            seen_extent=fresh.seen_extent,
            strengths=fresh.strengths,
            secondary_echoes=fresh.secondary_echoes,
            batch=fresh.batch,
        )


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
