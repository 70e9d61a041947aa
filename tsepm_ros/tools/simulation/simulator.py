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
"""Simulated sonar scans with known truth."""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.tools.simulation.scenario import Scenario, ScenarioStrengths
from tsepm_ros.tracker.scan import ECHO_FEATURES, Scan
from tsepm_ros.tracker.sensor import SensorModel

CLUTTER = -1
"""Origin of a false detection."""

ECHO_ITERATIONS = 50
ECHO_TOLERANCE = 1e-9


@dataclass(frozen=True)
class SimulatedScan:
    """A scan with its truth.

    Attributes
    ----------
    scan : Scan
        The detections, in the sensor frame; the sensor pose is the true pose at the stamp.
    origin : (n,) ndarray of int
        Target index of each detection, or CLUTTER.
    truth : (k, 4) ndarray
        The targets' states at the stamp.
    complete : float
        Time at which the last echo has arrived, s.
    """

    scan: Scan
    origin: NDArray[np.int64]
    truth: FloatArray
    complete: float


class Simulator:
    """Draws the scans of a scenario.

    Parameters
    ----------
    scenario : Scenario
        Scenario to simulate.
    seed : int or sequence of int
        Seed; the same seed gives the same scans, bit for bit.
    start : float, optional
        Stamp of the first scan, s.
    name : str, optional
        Of the sensor, which the scans have.

    Attributes
    ----------
    sensors : dict of str to Simulator
        Of each of several sensors, by name: scans of the same targets, drawn on their own.
    """

    def __init__(
        self, scenario: Scenario, seed: int | list[int], start: float = 0.0, name: str = ""
    ) -> None:
        self.scenario, self.start, self._name = scenario, start, name
        self._rng = np.random.default_rng(seed)
        seen_for = (scenario.scans - 1) * scenario.period
        drawn = [state for area in scenario.areas for state in area.draw(self._rng, seen_for)]
        self.targets = [*scenario.targets, *drawn]
        self._at_start = [_moved(state, -scenario.target_start) for state in self.targets]
        # Separate streams: what else is measured does not change the positions of a seed.
        streams = np.random.SeedSequence(seed).spawn(3)
        self._rate_rng, self._feature_rng, strength_rng = map(np.random.default_rng, streams)
        areas = [area for area in scenario.areas for _ in range(area.count)]
        given = scenario.target_features or ({},) * len(scenario.targets)
        self._features = [*given, *(area.features for area in areas), scenario.clutter_features]
        self._strengths: ScenarioStrengths | None = None
        if scenario.clutter_strength is not None:
            of_targets = scenario.target_strengths or (None,) * len(scenario.targets)
            self._strengths = ScenarioStrengths(
                scenario.clutter_strength,
                [*of_targets, *(area.strength for area in areas)],
                strength_rng,
            )
        self.sensors: dict[str, Simulator] = {}
        for number, (name, part) in enumerate(scenario.sensors.items(), start=1):
            of_part = Simulator(part, [*np.atleast_1d(seed).tolist(), number], start, name)
            of_part.targets, of_part._at_start = self.targets, self._at_start
            self.sensors[name] = of_part

    def __iter__(self) -> Iterator[SimulatedScan]:
        """Draw the scans one by one, of several sensors in the order of their stamps."""
        if self.sensors:
            yield from heapq.merge(*self.sensors.values(), key=lambda one: one.scan.stamp)
            return
        for index in range(self.scenario.total_scans):
            yield self._scan(index * self.scenario.period)

    def parts(self, number: int) -> Iterator[SimulatedScan]:
        """Draw the scans as sweeps of a number of messages each, one by one.

        Each message looks at a sector of the coverage, counter-clockwise from its start, at its own
        time: the sweep takes the scan's period.
        """
        sensor = self.scenario.sensor
        width = sensor.sector_width / number
        for index in range(self.scenario.total_scans * number):
            start = sensor.azimuth_min + index % number * width
            sector = replace(sensor, azimuth_min=start, azimuth_max=start + width)
            yield self._scan(index * self.scenario.period / number, sector)

    def truth(self, time: float) -> FloatArray:
        """States of the k targets at a time after the start (s), (k, 4); k = 0 in the warm-up."""
        states = np.array(self._there(time)).reshape(-1, 4)
        states[:, 0::2] += states[:, 1::2] * time
        return states

    def _there(self, time: float) -> list[FloatArray]:
        """States at time 0 of the targets that are there at a time after the start, s."""
        there = not self.scenario.warm_up or time >= self.scenario.target_start - 1e-9
        return self._at_start if there else []

    def _scan(self, time: float, sector: SensorModel | None = None) -> SimulatedScan:
        """Draw a scan of the whole coverage, or of a sector of it."""
        seen_by = sector or self.scenario.sensor
        echoes = [
            echo
            for index, state in enumerate(self._there(time))
            if (echo := self._detect(index, state, time, seen_by)) is not None
        ]
        clutter = self._clutter(time)
        if sector is not None:
            kept = sector.covers(*clutter)
            clutter = clutter[0][kept], clutter[1][kept]
        ranges = np.array([echo[0] for echo in echoes] + clutter[0].tolist())
        azimuths = np.array([echo[1] for echo in echoes] + clutter[1].tolist())
        origin = np.array([echo[2] for echo in echoes] + [CLUTTER] * len(clutter[0]), np.int64)
        order = self._rng.permutation(len(ranges))
        ranges, azimuths, origin = ranges[order], azimuths[order], origin[order]
        speed = self.scenario.sound_speed
        offsets = ranges / speed if speed > 0 else None
        pose, features = self.scenario.sensor_pose, self._plot_features(origin)
        if self._strengths is not None:
            position = _placed(ranges, azimuths, pose(time))
            features["intensity"] = self._strengths.draw(position, origin, time)
        sensor_velocity: FloatArray = np.zeros(2)
        if self.scenario.sensor.range_rate_std > 0.0:
            delay = np.zeros(len(ranges)) if offsets is None else offsets
            velocity = self.scenario.sensor_velocity
            sensor_velocity = np.array([velocity(time + t) for t in delay]).reshape(-1, 2)
            features["range_rate"] = self._range_rates(
                time, delay, azimuths, origin, sensor_velocity
            )
        last_arrival = 0.0 if offsets is None or not len(offsets) else 2.0 * float(offsets.max())
        return SimulatedScan(
            scan=Scan(
                stamp=self.start + time,
                range=ranges,
                azimuth=azimuths,
                time_offset=offsets,
                features=features,
                sensor_pose=pose(time),
                sensor_velocity=sensor_velocity,
                sensor=self._name,
            ),
            origin=origin,
            truth=self.truth(time),
            complete=self.start + time + last_arrival,
        )

    def _detect(
        self, index: int, state: FloatArray, time: float, sensor: SensorModel
    ) -> tuple[float, float, int] | None:
        """Measure one target; None if it is missed or outside the coverage of the sensor."""
        distance, azimuth = self._echo(state, time)
        # The number of draws does not depend on the outcome: targets stay independent.
        missed = self._rng.random() >= sensor.detection_probability
        errors = self._rng.standard_normal(2)
        if missed or not sensor.covers([distance], [azimuth])[0]:
            return None
        measured = distance + errors[0] * math.sqrt(float(sensor.range_variance(distance)))
        if measured <= 0:
            return None
        return measured, azimuth + errors[1] * sensor.azimuth_std, index

    def _range_rates(
        self,
        time: float,
        delay: FloatArray,
        azimuths: FloatArray,
        origin: NDArray[np.int64],
        sensor_velocity: FloatArray,
    ) -> FloatArray:
        """Range rates of the scan's detections, (n,), m/s, to first order in v / c.

        The range rate of a target is the rate of the mean of both legs, plus an error. The range
        rate of clutter is drawn over ground, along the measured line of sight. `sensor_velocity`
        (n, 2) is valid at the reflection of each echo, `delay` (n,) after the ping, s.
        """
        sensor, pose = self.scenario.sensor, self.scenario.sensor_pose
        yaw = np.array([pose(time + 2.0 * t)[2] for t in delay])
        sight = np.stack([np.cos(azimuths + yaw), np.sin(azimuths + yaw)], axis=1)
        errors = sensor.range_rate_std * self._rate_rng.standard_normal(len(delay))
        over_ground = sensor.clutter_range_rate * self._rate_rng.standard_cauchy(len(delay))
        rates = over_ground - (sight * sensor_velocity).sum(axis=1)
        for row in np.flatnonzero(origin != CLUTTER):
            state = self._at_start[origin[row]]
            position = state[0::2] + state[1::2] * (time + delay[row])
            offset = position - pose(time + delay[row])[:2]
            relative_velocity = state[1::2] - sensor_velocity[row]
            rates[row] = relative_velocity @ offset / np.hypot(*offset) + errors[row]
        return rates

    def _echo(self, state: FloatArray, time: float) -> tuple[float, float]:
        """True range (mean of both legs) and azimuth (against the heading at arrival).

        The ping leaves at `time`, meets the moving target, and returns to the moving sensor.
        """
        pose, speed = self.scenario.sensor_pose, self.scenario.sound_speed
        sent = pose(time)[:2]
        position, velocity = state[0::2], state[1::2]
        if speed <= 0:
            return _polar(position + velocity * time, pose(time))
        out = _travel(lambda delay: position + velocity * (time + delay), sent, speed)
        reflection = position + velocity * (time + out)
        back = _travel(lambda delay: pose(time + out + delay)[:2], reflection, speed)
        _, azimuth = _polar(reflection, pose(time + out + back))
        return 0.5 * speed * (out + back), azimuth

    def _plot_features(self, origin: NDArray[np.int64]) -> dict[str, FloatArray]:
        """Features of the scan's detections, (n,) by name, for the features of any detection."""
        drawn = {}
        for name in ECHO_FEATURES:
            if not any(name in features for features in self._features):
                continue
            moments = [features.get(name, (np.nan, 0.0)) for features in self._features]
            # CLUTTER is -1, the last entry.
            mean, deviation = np.array(moments)[origin].reshape(-1, 2).T
            values = mean + deviation * self._feature_rng.standard_normal(len(origin))
            drawn[name] = values if name == "intensity" else np.maximum(values, 0.0)
        return drawn

    def _clutter(self, time: float) -> tuple[FloatArray, FloatArray]:
        """Ranges and azimuths of the clutter, including the patches."""
        parts = [self._even_clutter(time)]
        for patch in self.scenario.clutter_patches:
            x_min, x_max, y_min, y_max = patch.box
            number = self._rng.poisson(patch.density * (x_max - x_min) * (y_max - y_min))
            range_, azimuth = self._in_box(patch.box, number, time)
            covered = self.scenario.sensor.covers(range_, azimuth)
            parts.append((range_[covered], azimuth[covered]))
        return np.concatenate([part[0] for part in parts]), np.concatenate(
            [part[1] for part in parts]
        )

    def _even_clutter(self, time: float) -> tuple[FloatArray, FloatArray]:
        """Ranges and azimuths of the clutter: Poisson in number, uniform in area (Eqs. 1-2)."""
        sensor = self.scenario.sensor
        number = self._rng.poisson(sensor.clutter_density * self.scenario.area)
        if self.scenario.clutter_box is None:
            square = self._rng.uniform(sensor.min_range**2, sensor.max_range**2, number)
            start = sensor.azimuth_min
            return (
                np.sqrt(np.maximum(square, 1e-6)),
                self._rng.uniform(start, start + sensor.sector_width, number),
            )
        return self._in_box(self.scenario.clutter_box, number, time)

    def _in_box(
        self, box: tuple[float, float, float, float], number: int, time: float
    ) -> tuple[FloatArray, FloatArray]:
        """Ranges and azimuths of points, uniform in a box."""
        x_min, x_max, y_min, y_max = box
        x, y, yaw = self.scenario.sensor_pose(time)
        east = self._rng.uniform(x_min, x_max, number) - x
        north = self._rng.uniform(y_min, y_max, number) - y
        return np.hypot(east, north), np.arctan2(north, east) - yaw


def _travel(
    position_after: Callable[[float], FloatArray], start: FloatArray, speed: float
) -> float:
    """Travel time of sound from `start` to a moving point, s."""
    delay = 0.0
    for _ in range(ECHO_ITERATIONS):
        next_delay = float(np.linalg.norm(position_after(delay) - start)) / speed
        if abs(next_delay - delay) < ECHO_TOLERANCE:
            return next_delay
        delay = next_delay
    return delay


def _moved(state: FloatArray, time: float) -> FloatArray:
    """A state (4,) after a time, s, at constant velocity."""
    moved: FloatArray = state.copy()
    moved[0::2] += state[1::2] * time
    return moved


def _placed(range_: FloatArray, azimuth: FloatArray, pose: FloatArray) -> FloatArray:
    """Positions of ranges and azimuths (n,) from a pose, (n, 2), m."""
    direction = azimuth + pose[2]
    offset = range_ * np.array([np.cos(direction), np.sin(direction)])
    return np.asarray(offset.T + pose[:2])


def _polar(position: FloatArray, pose: FloatArray) -> tuple[float, float]:
    offset = position - pose[:2]
    return float(np.hypot(*offset)), math.atan2(offset[1], offset[0]) - float(pose[2])
