"""Held tracks as in plain loops, and which of them are published."""

import functools
import math
from collections import Counter
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from support.batches import batches
from support.builders import FIXED_RANGE_ERROR, detections
from support.held import CLUTTER, P_D, published, step, tracks
from support.plain_held_tracks import Columns, PlainStep, Rule
from support.plain_tsepm import Parameters

from tsepm_ros import ConfirmedTrack, Scan, SensorModel
from tsepm_ros.tracker import motion
from tsepm_ros.tracker.maintenance import track_maintenance
from tsepm_ros.tracker.maintenance.confirmed_tracks import ConfirmedTracks, Status
from tsepm_ros.tracker.maintenance.track_maintenance import TrackMaintenance
from tsepm_ros.tracker.measurement import convert
from tsepm_ros.tracker.options import CommonOptions
from tsepm_ros.tracker.tracks import TrackArrays

SCENES = 120

BATCH = 10

ALWAYS = 20

TOLERANCE = 1e-7

MAX_SPEED = 10.0

OPTIONS = ("sector", "moving", "offsets", "rates", "own_errors", "pose_errors")

ENDS = "not_detected", "missed", "left", "duplicate"

STATES = "published", "withheld", "back"

MOTION = np.array([3.0, -2.0, 0.002])


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


def columns(held: ConfirmedTracks) -> Columns:
    """The table of held tracks as a mapping."""
    names = ("existence", "proven", "visible", "covered_scans", "last_detected")
    names += ("agreeing_scans", "hit_sigma")
    found = {name: getattr(held, name).copy() for name in names}
    found |= {name: getattr(held.models, name) for name in ("probability", "state", "covariance")}
    found |= {"mean": held.tracks.state, "spread": held.tracks.covariance}
    return found | {
        "track_id": held.tracks.track_id,
        "published": held.status == Status.PUBLISHED,
    }


@functools.cache
def compare(seed: int) -> Counter[str]:
    """Compare all scans of a scene; returns what was compared, and why tracks ended."""
    scene, counts = HeldScene(seed), Counter()
    rng, sensor = scene.rng, scene.sensor()
    maintenance = TrackMaintenance(
        CommonOptions(hold_time=scene.hold_time, target_extent=scene.target_extent)
    )
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
        existence[rng.random(len(new)) < 0.2] = 0.011  # soon ends by it
        maintenance.add(TrackArrays.of(new), existence)
        elapsed = float(rng.uniform(2.0, 14.0))
        stamp += elapsed
        values = scene.scan(stamp)
        clutter = 10.0 ** rng.uniform(-8.0, -5.0, len(values["range"]))
        pose = MOTION * scene.has["moving"] * stamp

        def detectable(positions, pose=pose):
            x, y = (positions - pose[:2]).T
            return 0.8 * sensor.covers(np.hypot(x, y), np.arctan2(y, x) - pose[2])

        whole, plain = scene.looks_everywhere(), PlainStep(rule, columns(maintenance.held))
        found = convert(Scan(**values), sensor, index)
        density = maintenance.step(
            stamp, found, clutter, detectable, sensor, MAX_SPEED, whole=whole
        )
        if len(plain.tracks["track_id"]):
            published = plain.tracks["track_id"][plain.tracks["published"]]
            plain.take(values, elapsed, clutter, detectable, whole)
            assert_same(maintenance, plain)
            np.testing.assert_array_less(
                np.abs(density - plain.density), 1e-6 * plain.density + 1e-9 * clutter
            )
            shown = plain.tracks["published"]
            counts.update(plain.ended.values())
            counts["back"] += len(set(plain.tracks["track_id"][shown]) - {*published})
            counts += Counter(published=shown.sum(), withheld=(~shown).sum(), tracks=len(shown))
            counts += Counter(associations=len(plain.association), empty=not len(clutter))
            counts += Counter(
                explained=(density > 0.0).sum(), outside=(~plain.tracks["seen"]).sum()
            )
    return counts + Counter({name: 1 for name, has in scene.has.items() if has})


def assert_same(maintenance: TrackMaintenance, plain: PlainStep) -> None:
    """The table is that of the plain version, and the same tracks ended."""
    held = columns(maintenance.held)
    assert maintenance.ended == plain.ended
    for name in ("track_id", "published", "agreeing_scans"):
        np.testing.assert_array_equal(held[name], plain.tracks[name], err_msg=name)
    for name in ("probability", "state", "covariance", "mean", "spread"):
        found, expected = held[name], plain.tracks[name]
        within = (-1,) if found.ndim < 4 and name != "spread" else (-2, -1)
        scale = np.linalg.norm(expected, axis=within, keepdims=True)
        assert (np.abs(found - expected) <= TOLERANCE * scale).all(), name
    for name in ("existence", "proven", "visible", "covered_scans", "last_detected", "hit_sigma"):
        np.testing.assert_allclose(held[name], plain.tracks[name], rtol=1e-7, atol=1e-12)
    for found, expected in zip(maintenance.covered, plain.covered, strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-12)
    tracks = maintenance.held.tracks
    np.testing.assert_array_equal(tracks.time_since_hit, tracks.stamp - held["last_detected"])
    np.testing.assert_array_equal(tracks.existence_probability, held["existence"])
    assert maintenance.current.track_id.tolist() == held["track_id"][held["published"]].tolist()
    found, expected = (
        sorted(pair for pair in pairs if pair[1] > 1e-12)
        for pairs in (zip(*maintenance.held_association, strict=True), plain.association)
    )
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("first", batches(SCENES, ALWAYS, BATCH))
def test_equals_the_plain_version(first: int) -> None:
    counts = sum((compare(seed) for seed in range(first, first + BATCH)), Counter())
    compared = "tracks", "associations", "explained", "outside"
    assert {*compared, *ENDS[:2], *STATES, "rates"} <= set(+counts)


def test_the_scenes_have_every_option_and_state_and_end_tracks_by_every_rule() -> None:
    counts = sum((compare(seed) for seed in range(ALWAYS)), Counter())
    assert {"empty", "parts", *ENDS, *STATES, *OPTIONS} <= set(+counts)
    by_hand = {"tracker", "replaced", "cleared", "forgotten"}
    assert {*ENDS, *by_hand} == set(track_maintenance.ENDS)


def follow(hold: TrackMaintenance, path, stamps, rng) -> None:
    """Detections of a target on a path, without clutter."""
    for stamp in stamps:
        seen = np.asarray(path(stamp)) + rng.normal(0.0, 3.0, 2)
        found = detections(seen[None], stamp, 9.0)
        found["range_std"], found["azimuth_std"] = 3.0, 0.001
        hold.step(
            stamp,
            found,
            np.full(1, CLUTTER),
            lambda at: np.full(len(at), P_D),
            FIXED_RANGE_ERROR,
            10.0,
        )


def test_a_track_that_stops_becomes_a_fixed_echo_and_comes_back_under_its_id():
    rng = np.random.default_rng(4)
    hold = TrackMaintenance(CommonOptions(hold_time=1e6, min_speed=0.5))
    state = np.array([[2000.0, 5.0, 1000.0, 0.0]])
    covariance = np.diag([3.0, 0.3, 3.0, 0.3])[None] ** 2
    hold.add(replace(tracks(1), state=state, covariance=covariance), 0.99)
    follow(hold, lambda t: (2000.0 + 5.0 * min(t, 60.0), 1000.0), np.arange(1.0, 60.0), rng)
    assert hold.current.track_id.tolist() == [1]
    assert hold.current.stationary_probability[0] < 0.01
    follow(hold, lambda t: (2300.0, 1000.0), np.arange(61.0, 200.0), rng)
    assert len(hold.current) == 0
    (echo,) = hold.fixed_echoes
    assert (echo.track_id, echo.since, echo.stamp) == (1, 0.0, 199.0)
    np.testing.assert_allclose(echo.position, [2300.0, 1000.0], atol=3.0)
    assert echo.velocity.tolist() == [0.0, 0.0]
    follow(hold, lambda t: (2300.0 + 3.0 * (t - 200.0), 1000.0), np.arange(200.0, 240.0), rng)
    assert (hold.current.track_id.tolist(), len(hold.fixed_echoes)) == ([1], 0)
    assert len(hold.released) == 0, "it is no new track"


LONG = CommonOptions(hold_time=1e6)

SLOW = replace(LONG, min_speed=8.0)


def holding(*track_ids: int, options: CommonOptions = SLOW) -> TrackMaintenance:
    hold = TrackMaintenance(options)
    hold.add(tracks(*track_ids), 0.9)
    return hold


def echoes(hold: TrackMaintenance) -> list[int]:
    return [echo.track_id for echo in hold.fixed_echoes]


def test_the_end_of_what_was_never_published_is_not_told():
    hold = holding(1, 2, options=replace(SLOW, hold_time=30.0))
    for scan in range(1, 60):
        step(hold, 12.0 * scan, detectable=P_D)
        assert hold.ended == {}
    assert len(hold.held) == 0
    hold = holding(1)
    hold.clear()
    step(hold, 1.0)
    assert hold.ended == {}


def test_min_speed_does_not_take_back_what_was_published():
    hold = holding(1, options=LONG)
    hold.options = SLOW
    step(hold, 12.0)
    assert (published(hold), echoes(hold)) == ([1], [])
    assert hold.current.stationary_probability[0] > 0.5


def test_a_downstream_tracker_does_not_decline_what_it_never_heard_of():
    hold = holding(1)
    for stamp in np.arange(10.0, 160.0, 10.0):
        step(hold, stamp, detections([[2000.0 + 5.0 * stamp, 1000.0]], stamp, 400.0), P_D)
        if stamp in (10.0, 80.0, 150.0):
            hold.follow(stamp, TrackArrays.of([]))
    assert len(hold.held) == 1
    # Its time begins when the track is published.
    hold.options = LONG
    step(hold, 160.0, detections([[2800.0, 1000.0]], 160.0, 400.0), P_D)
    assert published(hold) == [1]
    hold.follow(200.0, TrackArrays.of([]))
    assert published(hold) == [1]
    hold.follow(230.0, TrackArrays.of([]))
    assert published(hold) == []


def test_a_fixed_echo_outside_the_coverage_is_remembered_as_it_is_and_never_published():
    hold = holding(1)
    for stamp in range(12, 61, 12):
        step(hold, stamp, detections([[2000.0, 1000.0]], stamp, 400.0), P_D)
    before = hold.fixed_echoes
    for stamp in range(72, 6000, 12):
        step(hold, stamp, detectable=0.0)
    after = hold.fixed_echoes
    assert after.track_id.tolist() == [1]
    np.testing.assert_allclose(after.state, before.state, rtol=1e-9)
    np.testing.assert_allclose(after.covariance, before.covariance, rtol=1e-6)
    hold.options = LONG
    step(hold, 6012.0, detectable=0.0)
    assert len(hold.released) == len(hold.current) == len(hold.held) == 0


def test_an_existence_that_is_not_known_leaves_the_others_their_probability_to_stand_still():
    fits = holding(1, 2, 3).held.fits
    alone = fits[np.array([0, 1])].stationary_probability(SLOW, np.array([0.9, 0.8]))
    found = fits.stationary_probability(SLOW, np.array([0.9, 0.8, np.nan]))
    np.testing.assert_allclose(found[:2], alone)


def test_what_is_held_back_claims_its_detections_as_every_held_track_does():
    back, shown = holding(1), holding(1, options=LONG)
    assert (published(back), published(shown)) == ([], [1])
    scan = detections([[2060.0, 1000.0], [2000.0, 9000.0]], 12.0)
    np.testing.assert_array_equal(step(back, 12.0, scan, P_D), step(shown, 12.0, scan, P_D))
    for one, other in zip(back.held_association, shown.held_association, strict=True):
        np.testing.assert_array_equal(one, other)
    assert back.held_association[1][0] > 0.9
    assert (published(back), echoes(back)) == ([], [1])


def test_what_exists_hardly_is_neither_published_nor_a_fixed_echo():
    hold = TrackMaintenance(SLOW)
    hold.add(tracks(1), 0.3)
    assert echoes(hold) == []
    hold.options = LONG
    step(hold, 1.0)
    assert (published(hold), len(hold.held)) == ([], 1)


def test_what_a_downstream_tracker_lists_is_published():
    hold = holding(1)
    hold.follow(5.0, tracks(1, 7, stamp=5.0))
    assert published(hold) == [1, 7]
    step(hold, 6.0)
    assert len(hold.released) == 0
