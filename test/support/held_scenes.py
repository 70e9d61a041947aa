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
"""Scenes of confirmed tracks, and what maintenance makes of them compared with plain loops."""

import functools
import math
from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np

from support.plain_confirmed_tracks import Branch, PlainStep, PlainTrack, Rule
from support.plain_tsepm import Parameters
from tsepm_ros import ConfirmedTrack, Scan, SensorModel
from tsepm_ros.tracker.maintenance.confirmed_tracks import ConfirmedTracks
from tsepm_ros.tracker.maintenance.track_maintenance import TrackMaintenance
from tsepm_ros.tracker.measurement import convert_measurements
from tsepm_ros.tracker.options import CommonOptions
from tsepm_ros.tracker.tracks import TrackArrays, TrackStatus

SCENES = 42

BATCH = 6

ALWAYS = 6

TOLERANCE = 1e-7

MAX_SPEED = 10.0

OPTIONS = ("sector", "moving", "offsets", "rates", "own_errors", "pose_errors")

ENDS = "not_detected", "missed", "left"

STATES = "sure", "coasting", "back"

MODES = "probability", "state", "covariance"

FIGURES = "existence", "proven", "covered_scans", "last_detected", "hit_sigma"

MOTION = np.array([3.0, -2.0, 0.002])


@dataclass
class ConfirmedScene:
    """Targets that may vanish, tracks that start in their place or elsewhere, and scans."""

    seed: int

    def __post_init__(self) -> None:
        self.rng = rng = np.random.default_rng([77, self.seed])
        switches = rng.random(len(OPTIONS)) < 0.4
        self.has = dict(zip(OPTIONS, switches.tolist(), strict=True))
        low, high = (-2.0, 1.5) if self.has["sector"] else (-math.pi, math.pi)
        self.edges = {"azimuth_min": low, "azimuth_max": high}
        self.edges |= {"min_range": 200.0, "max_range": 3500.0}
        self.errors = {
            "range_std": float(rng.choice([0.0, 20.0])),
            "range_std_fraction": float(rng.choice([0.005, 0.015])),
            "azimuth_std": math.radians(float(rng.choice([0.5, 1.0, 2.0]))),
        }
        self.range_rate_std = 0.5 * self.has["rates"]
        self.detection_probability = float(rng.choice([0.6, 0.9, 0.98]))
        self.hold_time = float(rng.choice([25.0, 60.0, 200.0]))
        self.place = rng.uniform(-2800.0, 2800.0, (4, 2))
        self.velocity = rng.uniform(-6.0, 6.0, (4, 2))
        self.place[1] = self.place[0] + rng.uniform(-150.0, 150.0, 2)  # they compete
        self.velocity[1] = self.velocity[0] + rng.uniform(-1.0, 1.0, 2)
        self.gone = rng.uniform(20.0, 250.0, 4)
        self.parts = np.random.default_rng([78, self.seed])
        self.has["parts"] = bool(self.parts.random() < 0.4)
        self.target_extent = float(self.parts.choice([0.0, 60.0]))

    def sensor(self) -> SensorModel:
        return SensorModel(
            **self.errors,
            **self.edges,
            detection_probability=self.detection_probability,
            range_rate_std=self.range_rate_std,
        )

    def looks_everywhere(self) -> bool:
        """Whether the next scan looks at the whole coverage."""
        return not (self.has["parts"] and self.parts.random() < 0.4)

    def scan(self, stamp: float) -> dict[str, Any]:
        rng, has = self.rng, self.has
        pose, sensor_velocity = MOTION * has["moving"] * stamp, MOTION[:2] * has["moving"]
        empty = rng.random() < 0.06
        seen = (rng.random(4) < 0.85) & (stamp < self.gone) & (not empty)
        to = (self.place + self.velocity * stamp)[seen] - pose[:2]
        n = 0 if empty else int(rng.poisson(12.0))
        r = np.append(np.hypot(*to.T), rng.uniform(100.0, 3600.0, n))
        a = np.append(np.arctan2(to[:, 1], to[:, 0]) - pose[2], rng.uniform(-3.0, 3.0, n))
        about = rng.integers(0, max(len(to), 1), n // 2) if len(to) else np.zeros(0, int)
        r[len(to) : len(to) + len(about)] = r[about] + rng.normal(0.0, 80.0, len(about))
        a[len(to) : len(to) + len(about)] = a[about] + rng.normal(0.0, 0.03, len(about))
        r = np.abs(r + 15.0 * rng.standard_normal(len(r))) + 1.0
        a = a + 0.01 * rng.standard_normal(len(a))
        scan: dict[str, Any] = {"stamp": stamp, "range": r, "azimuth": a, "sensor_pose": pose}
        scan["sensor_velocity"] = sensor_velocity
        if has["offsets"]:
            scan["time_offset"] = r / 1500.0
            scan["sensor_pose"] = pose + scan["time_offset"][:, None] * MOTION * has["moving"]
        if has["rates"]:
            own = np.append(self.velocity[seen], np.zeros((n, 2)), axis=0) - sensor_velocity
            sight = np.stack([np.cos(a + pose[2]), np.sin(a + pose[2])], axis=1)
            rate = (own * sight).sum(axis=1) + 0.5 * rng.standard_normal(len(r))
            missing = (rng.random(len(r)) < 0.2) & (not has["offsets"])
            scan["features"] = {"range_rate": np.where(missing, np.nan, rate)}
        if has["own_errors"]:
            scan["range_std"] = rng.uniform(10.0, 60.0, len(r))
            scan["azimuth_std"] = rng.uniform(0.005, 0.03, len(r))
        if has["pose_errors"]:
            scan["sensor_pose_covariance"] = np.diag([25.0, 16.0, 1e-4])
        return scan

    def new_tracks(self, first_id: int, stamp: float) -> list[ConfirmedTrack]:
        """Tracks near some of the targets, a second of a target included; or of nothing."""
        rng, made = self.rng, []
        for target in np.flatnonzero(rng.random(5) < (0.6 if stamp < 20.0 else 0.12)):
            state = np.array([*rng.uniform(-2500.0, 2500.0, 2), *rng.uniform(-5.0, 5.0, 2)])
            if target < 4:
                now = self.place[target] + self.velocity[target] * stamp
                state = np.append(now, self.velocity[target]) + rng.normal(0, [30, 30, 1, 1])
            root = np.diag([30.0, 2.0, 30.0, 2.0]) @ (np.eye(4) + 0.3 * rng.uniform(-1, 1, (4, 4)))
            id_, state = first_id + len(made), state[[0, 2, 1, 3]]
            made.append(ConfirmedTrack(id_, stamp, state, root @ root.T, ((0, 0),), 0.0))
        return made


def plain_tracks(held: ConfirmedTracks) -> list[PlainTrack]:
    """The rows of confirmed tracks, one by one."""
    branches, models = held.branches, held.branches.models
    first, end = branches.first, np.cumsum(branches.number)
    return [
        PlainTrack(
            int(held.tracks.track_id[i]),
            [
                Branch(
                    math.exp(branches.log_weight[k]),
                    float(branches.faded[k, 0]),
                    *(getattr(models, name)[k].copy() for name in MODES),
                )
                for k in range(first[i], end[i])
            ],
            (held.fits.state[i], held.fits.covariance[i]),
            float(held.fits.change_odds[i]),
            *(getattr(held, name)[i].item() for name in FIGURES),
            bool(held.status[i] == TrackStatus.CONFIRMED),
        )
        for i in range(len(held))
    ]


@functools.cache
def compare(seed: int) -> Counter[str]:
    """Compare all scans of a scene; returns what was compared, and why tracks ended."""
    scene, counts = ConfirmedScene(seed), Counter()
    rng, sensor = scene.rng, scene.sensor()
    options = CommonOptions(
        hold_time=scene.hold_time, target_extent=scene.target_extent, min_existence=0.0
    )
    maintenance = TrackMaintenance(options)
    settings = Parameters(
        **scene.errors, clutter_density=1e-6, max_speed=MAX_SPEED, min_hits=3, window=4
    )
    rule = Rule(
        settings,
        scene.hold_time,
        scene.detection_probability,
        scene.range_rate_std,
        scene.edges["max_range"],
        scene.target_extent,
    )
    stamp, next_id = 0.0, 0
    for index in range(14):
        new = scene.new_tracks(next_id, stamp)
        next_id += len(new)
        existence = rng.uniform(0.2, 0.99, len(new))
        existence[rng.random(len(new)) < 0.2] = 1.1e-5  # soon ends by it
        maintenance.add(TrackArrays.from_tracks(new), existence)
        elapsed = float(rng.uniform(2.0, 14.0))
        stamp += elapsed
        values = scene.scan(stamp)
        clutter = 10.0 ** rng.uniform(-8.0, -5.0, len(values["range"]))
        pose = MOTION * scene.has["moving"] * stamp

        def detectable(positions, pose=pose):
            x, y = (positions - pose[:2]).T
            return 0.8 * sensor.covers(np.hypot(x, y), np.arctan2(y, x) - pose[2])

        whole, plain = (
            scene.looks_everywhere(),
            PlainStep(rule, plain_tracks(maintenance.confirmed)),
        )
        noise = maintenance.manoeuvre.process_noise(options, 0.0)
        found = convert_measurements(Scan(**values), sensor, index)
        probability = maintenance.step(
            stamp, found, clutter, detectable, sensor, MAX_SPEED, whole=whole
        )
        if plain.tracks:
            before = {t.track_id for t in plain.tracks if t.sure}
            plain.take(values, elapsed, clutter, detectable, whole, noise)
            assert_same(maintenance, plain)
            np.testing.assert_allclose(probability, plain.probability, rtol=1e-6, atol=1e-8)
            shown = {t.track_id for t in plain.tracks if t.sure}
            counts.update(plain.ended.values())
            counts += Counter(back=len(shown - before), sure=len(shown))
            counts += Counter(coasting=len(plain.tracks) - len(shown), tracks=len(plain.tracks))
            counts += Counter(own=len(plain.own), empty=not len(clutter), branched=plain.branched)
            counts += Counter(outside=sum(not t.seen for t in plain.tracks))
    return counts + Counter({name: 1 for name, has in scene.has.items() if has})


def assert_same(maintenance: TrackMaintenance, plain: PlainStep) -> None:
    """The tracks are those of the plain version, and the same ended."""
    held = plain_tracks(maintenance.confirmed)
    assert maintenance.ended == plain.ended
    assert [t.track_id for t in held] == [t.track_id for t in plain.tracks]
    for one, other in zip(held, plain.tracks, strict=True):
        assert one.sure == other.sure
        assert len(one.branches) == len(other.branches)
        for name in (*FIGURES, "odds"):
            np.testing.assert_allclose(
                getattr(one, name), getattr(other, name), rtol=1e-6, atol=1e-12, err_msg=name
            )
        for a, b in zip(one.branches, other.branches, strict=True):
            np.testing.assert_allclose([a.weight, a.faded], [b.weight, b.faded], rtol=1e-6)
            np.testing.assert_allclose(a.probability, b.probability, rtol=1e-6, atol=1e-12)
            for mode in range(2):
                assert_close(
                    (a.state[mode], a.covariance[mode]), (b.state[mode], b.covariance[mode])
                )
        assert_close(one.fit, other.fit)
        assert_close(one.mean(), other.mean())
    tracks = maintenance.confirmed.tracks
    for row, track in enumerate(held):
        assert_close((tracks.state[row], tracks.covariance[row]), track.mean())
        assert tracks.time_since_hit[row] == tracks.stamp[row] - track.last_detected
        assert tracks.existence_probability[row] == track.existence
    shown = [t.track_id for t in held if t.sure]
    assert maintenance.current.sure.track_id.tolist() == shown
    assert maintenance.current.track_id.tolist() == [t.track_id for t in held], "the others coast"
    assert sorted(zip(*maintenance.probable_detections, strict=True)) == sorted(plain.own)
    found = np.transpose(maintenance.covered)
    np.testing.assert_allclose(found, np.reshape(plain.covered, (-1, 2)), rtol=1e-6, atol=1e-12)


def assert_close(one: tuple[np.ndarray, ...], other: tuple[np.ndarray, ...]) -> None:
    """A state and its covariance are those of another."""
    for found, expected in zip(one, other, strict=True):
        assert np.abs(found - expected).max() <= TOLERANCE * np.linalg.norm(expected)
