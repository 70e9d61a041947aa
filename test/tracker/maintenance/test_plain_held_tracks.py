"""Held tracks are maintained as in plain loops: by track, detection and mode of motion."""

import functools
import math
from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from support.batches import batches
from support.plain_held_tracks import Coverage, PlainMaintenance, Rule
from support.plain_tsepm import Parameters

from tsepm_ros import ConfirmedTrack, Scan, SensorModel
from tsepm_ros.tracker import motion
from tsepm_ros.tracker.clutter.sensor_performance import DetectionProbability
from tsepm_ros.tracker.maintenance import track_maintenance
from tsepm_ros.tracker.maintenance.data_association import GATE_PROBABILITY
from tsepm_ros.tracker.maintenance.track_maintenance import TrackMaintenance
from tsepm_ros.tracker.measurement import convert
from tsepm_ros.tracker.options import CommonOptions
from tsepm_ros.tracker.sensor import EchoPoses, echo_poses_of
from tsepm_ros.tracker.tracks import TrackArrays

SCENES = 120
BATCH = 10
ALWAYS = 20
TOLERANCE = 1e-7
MAX_SPEED = 10.0
OPTIONS = ("sector", "moving", "offsets", "rates", "own_errors", "pose_errors", "reports")
ENDS = "not_detected", "missed", "left", "duplicate", "tracker"
STATES = "published", "withheld", "back"
MOTION = np.array([3.0, -2.0, 0.002])
"""Of a sensor that moves, m/s and rad/s."""


@pytest.fixture(autouse=True)
def exact_speed_limit(monkeypatch):
    """Integrals over narrow densities at v_max are as exact as the plain ones, not to 1e-7 only."""
    nodes, weights = np.polynomial.legendre.leggauss(80)
    monkeypatch.setattr(motion, "NODES", nodes)
    monkeypatch.setattr(motion, "WEIGHTS", weights)


@dataclass
class HeldScene:
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
        self.tracked_timeout = float(rng.choice([15.0, 40.0]))
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


def assert_close(found: Any, expected: Any) -> None:
    expected = np.asarray(expected, float)
    scale = max(float(np.linalg.norm(expected)), 1e-30)
    assert np.abs(found - expected).max() <= TOLERANCE * scale


@functools.cache
def compare(seed: int) -> Counter[str]:
    """Compare all scans of a scene; returns what was compared, and why tracks ended."""
    scene, counts = HeldScene(seed), Counter()
    rng, sensor = scene.rng, scene.sensor()
    options = CommonOptions(
        hold_time=scene.hold_time,
        tracked_timeout=scene.tracked_timeout,
        target_extent=scene.target_extent,
    )
    maintenance = TrackMaintenance(options)
    settings = Parameters(
        **scene.errors, clutter_density=1e-6, max_speed=MAX_SPEED, min_hits=3, window=4
    )
    plain = PlainMaintenance(
        Rule(
            settings,
            scene.hold_time,
            scene.tracked_timeout,
            scene.detection_probability,
            scene.range_rate_std,
            scene.edges["max_range"],
            scene.target_extent,
        )
    )
    coverage, poses = Coverage(**scene.edges), EchoPoses(np.zeros(1), np.zeros((1, 3)))
    stamp, next_id, learned = 0.0, 0, DetectionProbability()
    for index in range(14):
        new = scene.new_tracks(next_id, stamp)
        next_id += len(new)
        existence = rng.uniform(0.2, 0.99, len(new))
        existence[rng.random(len(new)) < 0.1] = 0.012  # soon ends by it
        maintenance.add(TrackArrays.of(new), existence)
        for track, probability in zip(new, existence, strict=True):
            plain.add(track.track_id, stamp, track.state, track.covariance, float(probability))
        if scene.has["reports"] and rng.random() < 0.6:
            held = maintenance.held.tracks
            listed = held.where((rng.random(len(held)) < 0.9) & (held.track_id % 3 > 0))
            report = stamp + float(rng.uniform(-2.0, 6.0))
            listed = listed.predicted(report - 1.0)
            maintenance.follow(report, listed)
            plain.follow(report, {t.track_id: (t.stamp, t.state, t.covariance) for t in listed})
        stamp += float(rng.uniform(2.0, 14.0))
        values = scene.scan(stamp)
        clutter = 10.0 ** rng.uniform(-8.0, -5.0, len(values["range"]))
        scan = Scan(**values)
        poses = echo_poses_of(scan) or poses
        coverage.move(values)

        def detectable(positions, poses=poses):
            return np.where(sensor.covers(*poses.polar(positions)), 0.8, 0.0)

        whole = scene.looks_everywhere()
        found = convert(scan, sensor, index)
        withheld = {track.id for track in plain.tracks if not track.published}
        density = maintenance.step(
            stamp, found, clutter, detectable, sensor, MAX_SPEED, whole=whole
        )
        expected = plain.step(values, clutter, lambda place: 0.8 * coverage.covers(place), whole)
        counts["back"] += sum(track.published and track.id in withheld for track in plain.tracks)
        counts += assert_same(maintenance, plain)
        for found, value, lowest in zip(density, expected, clutter, strict=True):
            assert found == pytest.approx(value, rel=1e-6, abs=1e-9 * lowest)
        counts["explained"] += sum(value > 0.0 for value in expected)
        counts["empty"] += not len(clutter)
        learned.update(*maintenance.covered, GATE_PROBABILITY)
        assert learned.estimate(0.9) == pytest.approx(
            plain.learned_detection_probability(0.9), rel=1e-7
        )
        counts["outside"] += sum(not coverage.covers(t.position) for t in maintenance.held.tracks)
    return counts + Counter({name: 1 for name, has in scene.has.items() if has})


def assert_same(maintenance: TrackMaintenance, plain: PlainMaintenance) -> Counter[str]:
    """The table is that of the plain version, and the same tracks ended."""
    held, tracks = maintenance.held, plain.tracks
    assert held.tracks.track_id.tolist() == [track.id for track in tracks]
    assert maintenance.ended == {id_: why for why, ids in plain.ended.items() for id_ in ids}
    shown = [track.id for track in tracks if track.published]
    assert maintenance.current.track_id.tolist() == shown
    for row, track in enumerate(tracks):
        state, covariance = track.mean
        assert_close(held.tracks.state[row], state)
        assert_close(held.tracks.covariance[row], covariance)
        for mode, expected in enumerate(track.modes):
            assert_close(held.models.probability[row, mode], expected.probability)
            assert_close(held.models.state[row, mode], expected.state)
            assert_close(held.models.covariance[row, mode], expected.covariance)
        assert held.tracks.time_since_hit[row] == track.stamp - track.last_detected
    for name in ("existence", "proven", "visible", "covered_scans", "last_detected"):
        of_tracks = [getattr(track, name) for track in tracks]
        np.testing.assert_allclose(getattr(held, name), of_tracks, rtol=1e-7, atol=1e-12)
    assert held.agreeing_scans.tolist() == [track.agreeing for track in tracks]
    np.testing.assert_allclose(held.hit_sigma**2, [t.hit_variance for t in tracks], rtol=2e-7)
    np.testing.assert_array_equal(held.tracks.existence_probability, held.existence)
    expected = sorted((j, p) for (_, j), p in plain.association.items() if p > 1e-12)
    found = sorted(
        pair for pair in zip(*maintenance.held_association, strict=True) if pair[1] > 1e-12
    )
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-9)
    counts = {why: len(ids) for why, ids in plain.ended.items()}
    counts |= {"tracks": len(tracks), "associations": len(expected)}
    return Counter(counts | {"published": len(shown), "withheld": len(tracks) - len(shown)})


@pytest.mark.parametrize("first", batches(SCENES, ALWAYS, BATCH))
def test_equals_the_plain_version(first: int) -> None:
    counts = sum((compare(seed) for seed in range(first, first + BATCH)), Counter())
    compared = "tracks", "associations", "explained", "outside"
    assert {*compared, *ENDS[:2], *STATES, "reports", "rates"} <= set(+counts)


def test_the_scenes_have_every_option_and_state_and_end_tracks_by_every_rule() -> None:
    counts = sum((compare(seed) for seed in range(ALWAYS)), Counter())
    assert {"empty", "parts", *ENDS, *STATES, *OPTIONS} <= set(counts)
    assert {*ENDS, "replaced", "cleared", "forgotten"} == set(track_maintenance.ENDS)
