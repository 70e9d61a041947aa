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
"""Each model of the tracker beside the scene that needs it, with and without the model.

    python benchmarks/ablations.py [--only MODEL ...] [--runs N] [--seed 1]

A model that no scene needs goes. Every figure is a mean over runs; less is better. Lost: share of
the target's scans without a track. Ids: changes of a target's track. False: tracks a run that were
never near a target. Delay: s from a target's first scan to its track, or to the end of the run.
`score` accepts 10 false tracks an hour, or as many as a scene says; it has the defaults otherwise.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from typing import Any
from unittest import mock

import fixed_threads  # noqa: F401  # before numpy
import numpy as np
from amplitude_scenes import BOX
from clear_mot import Truth
from crowds import GroupWatch
from crowds_scenes import HARBOUR, PERIOD, course, drawn, path
from groups_scenes import GROUPS, Seen, ping, sonar, states

from tsepm_ros import Scan, SensorModel, make_initiator
from tsepm_ros.tools.simulation import Simulator
from tsepm_ros.tools.simulation.scenario import ClutterStrength, TargetStrength
from tsepm_ros.tools.terminal import terminal_table
from tsepm_ros.tracker import confirmation, evaluation, merging, motion, range_rates
from tsepm_ros.tracker.clusters.extended_targets import SeveralEchoesTest
from tsepm_ros.tracker.clutter import amplitude, density, excess, fixed_places
from tsepm_ros.tracker.maintenance import branches, confirmed_tracks, stationary
from tsepm_ros.tracker.maintenance.target_manoeuvre import TargetManoeuvre
from tsepm_ros.tracker.threshold import Threshold

RADAR = SensorModel(range_std=8.0, range_std_fraction=0.0, max_range=500.0)
SONAR = SensorModel(
    range_std=10.0, range_std_fraction=0.0, azimuth_std=math.radians(1.0), clutter_density=1e-6
)
EVEN = 76.0
"""False detections of that sonar in a scan."""
DENSE = replace(HARBOUR, clutter_density=20.0 / HARBOUR.coverage_area)
SELDOM = replace(DENSE, detection_probability=0.5)


@dataclass(frozen=True)
class Scene:
    """Scans with truth: of a sensor, drawn from a seed, with options of `make_initiator`."""

    sensor: SensorModel
    draw: Callable[[np.random.Generator], Seen]
    gate: float = 20.0
    options: tuple[tuple[str, Any], ...] = (("max_speed", 10.0),)

    def figures(self, seed: list[int]) -> dict[str, float]:
        """What a run comes to."""
        given = {"false_tracks_per_hour": 10.0} | dict(self.options)
        made, watch = make_initiator("score", sensor=self.sensor, **given), GroupWatch(self.gate)
        started = 0
        for scan, truth in self.draw(np.random.default_rng(seed)):
            new = made.process(scan)
            places = np.reshape([state[0::2] for state in truth.values()], (-1, 2))
            apart = np.linalg.norm(new.state[:, 0::2] - places[:, None], axis=2)
            started += int((apart.min(axis=0, initial=math.inf) > self.gate).sum())
            watch.take(scan.stamp, truth, made.current.sure)
        last = watch.stamps[-1]
        delays = [watch.found.get(target, last) - begun for target, begun in watch.begun.items()]
        number = max(sum(watch.targets), 1)
        return {
            "false": started,
            "lost": watch.misses / number,
            "ids": watch.clear.switches / max(len(watch.begun), 1),
            "delay": float(np.mean(delays)) if delays else 0.0,
            "tracks": len(set().union(*watch.ids)),
        }


def disc(rng: np.random.Generator, number: float, max_range: float) -> np.ndarray:
    """Range and azimuth of clutter, even in area."""
    count = rng.poisson(number)
    azimuth = rng.uniform(-math.pi, math.pi, count)
    return np.array([max_range * np.sqrt(rng.uniform(1e-4, 1.0, count)), azimuth])


def clutter_alone(
    scans: int, period: float, ranges: Callable[..., np.ndarray]
) -> Callable[..., Seen]:
    """Clutter at drawn ranges, all round."""

    def draw(rng: np.random.Generator) -> Iterator[tuple[Scan, Truth]]:
        for k in range(scans):
            range_ = ranges(rng, k)
            yield Scan(period * k, range_, rng.uniform(-math.pi, math.pi, len(range_))), {}

    return draw


def ring(rng: np.random.Generator, scan: int) -> np.ndarray:
    """A ring of clutter at 3 km, beside even clutter."""
    near = 3000.0 + 20.0 * rng.standard_normal(rng.poisson(20))
    return np.append(near, disc(rng, EVEN, 9000.0)[0])


def reverberation(rng: np.random.Generator, scan: int) -> np.ndarray:
    """Clutter that falls with range."""
    near = rng.exponential(40.0, rng.poisson(20)) + 0.5
    return np.append(near, disc(rng, 10.0, 1000.0)[0])


def lumps(rng: np.random.Generator) -> Iterator[tuple[Scan, Truth]]:
    """Clutter in forty lumps of 300 m that are denser and thinner."""
    centres = 6000.0 * np.sqrt(rng.random(40)) * np.exp(2j * math.pi * rng.random(40))
    share = rng.lognormal(0.0, 1.5, 40)
    for k in range(100):
        place = rng.choice(centres, rng.poisson(40), p=share / share.sum())
        place = place + 300.0 * (
            rng.standard_normal(len(place)) + 1j * rng.standard_normal(len(place))
        )
        lump, even = np.array([np.abs(place), np.angle(place)]), disc(rng, 0.5 * EVEN, 9000.0)
        yield Scan(12.0 * k, *np.concatenate([lump, even], axis=1)), {}


def bursts(rng: np.random.Generator) -> Iterator[tuple[Scan, Truth]]:
    """Clutter that comes together, ten detections behind each other, elsewhere each scan."""
    for k in range(200):
        near, count = rng.uniform(500.0, 3000.0), 10
        bearing = rng.uniform(-math.pi, math.pi) + 0.01 * rng.standard_normal(count)
        burst = near + 3000.0 * rng.random(count), bearing
        yield Scan(12.0 * k, *np.concatenate([burst, disc(rng, 20.0, 9000.0)], axis=1)), {}


def band(rng: np.random.Generator) -> Iterator[tuple[Scan, Truth]]:
    """Clutter on a fairway alone, 200 m wide and 100 m off."""
    turn = np.exp(1j * rng.uniform(-math.pi, math.pi))
    for k in range(30):
        count = rng.poisson(40)
        along, across = rng.uniform(-1500.0, 1500.0, count), rng.uniform(100.0, 300.0, count)
        place = turn * (along + 1j * across)
        yield Scan(3.0 * k, np.abs(place), np.angle(place)), {}


def short_range(rng: np.random.Generator) -> Iterator[tuple[Scan, Truth]]:
    """A swimmer, and clutter up to 300 m in a sector, of a sonar whose range nobody set."""
    bearing, heading = rng.uniform(-0.7, 0.7), np.exp(1j * rng.uniform(-math.pi, math.pi))
    start = rng.uniform(100.0, 190.0) * np.exp(1j * bearing)
    velocity = np.array([[heading.real, heading.imag]])
    for k in range(90):
        place, (range_, azimuth) = start + k * heading, disc(rng, 20.0, 300.0)
        error, seen = rng.standard_normal(2), rng.random() < 0.9
        own = [[abs(place) + 0.5 * error[0]], [np.angle(place) + 0.02 * error[1]]]
        echoes = np.append(np.array(own)[:, : int(seen)], [range_, azimuth / 3.0], axis=1)
        yield Scan(float(k), *echoes), states(np.array([[place.real, place.imag]]), velocity)


def squalls(rng: np.random.Generator) -> Iterator[tuple[Scan, Truth]]:
    """Sixteen times as much clutter for 10 s of a minute."""
    for k in range(240):
        yield Scan(0.5 * k, *disc(rng, 80.0 if 60 <= k % 120 < 80 else 5.0, 400.0)), {}


def too_fast(rng: np.random.Generator) -> Seen:
    """A boat at 15 m/s, which is not wanted where targets have 10 m/s at most."""
    seen = drawn(HARBOUR, PERIOD, [path(course(rng, 24, 15.0)[0])], rng)
    return ((scan, {}) for scan, _ in seen)


def ghosts(rng: np.random.Generator) -> Iterator[tuple[Scan, Truth]]:
    """A vessel that passes 60 m off, with ghosts behind it."""
    for k in range(45):
        place = np.array([60.0, -90.0 + 4.0 * k])
        bearing, number = math.atan2(place[1], place[0]), rng.poisson(5.0)
        own = [[np.hypot(*place) + 5.0 * rng.standard_normal()], [bearing]]
        behind = rng.uniform(350.0, 490.0, number), bearing + 0.1 * rng.standard_normal(number)
        seen = np.concatenate([own, behind, disc(rng, 2.0, 500.0)], axis=1)
        yield Scan(1.7 * k, *seen), states(place[None], np.array([[0.0, 4.0 / 1.7]]))


SECTOR = replace(sonar(1.0, 1.0, 300.0, 60.0), clutter_density=1e-4)


def piles(rng: np.random.Generator) -> Iterator[tuple[Scan, Truth]]:
    """Forty piles of a quay, each seen in one ping of 4 on average."""
    places = np.stack([np.full(40, 150.0), rng.uniform(-150.0, 150.0, 40)], axis=1)
    seen = rng.uniform(0.05, 0.45, 40)
    for k in range(200):
        now = list(places[rng.random(40) < seen])
        yield ping(SECTOR, rng, float(k), now, 0.0, probability=1.0), {}


def outages(scans: int) -> Callable[[np.random.Generator], Seen]:
    """A boat that is not seen for so many of 50 scans."""

    def draw(rng: np.random.Generator) -> Iterator[tuple[Scan, Truth]]:
        states_ = path(course(rng, 150, 1.0)[0])
        for k, (scan, truth) in enumerate(drawn(HARBOUR, PERIOD, [states_], rng)):
            if 20 <= k % 50 < 20 + scans:
                scan, _ = next(drawn(HARBOUR, PERIOD, [np.full((1, 4), np.nan)], rng))
                scan = replace(scan, stamp=PERIOD * k)
            yield scan, truth

    return draw


def strong(law: ClutterStrength, ratio_db: float, fix: Callable[..., Any] | None = None):
    """The box after pings of clutter alone; its target's echoes are that much stronger."""
    scene = replace(
        BOX, scans=40, clutter_strength=law, target_strengths=(TargetStrength(ratio_db, "steady"),)
    )

    def draw(rng: np.random.Generator) -> Iterator[tuple[Scan, Truth]]:
        for k, simulated in enumerate(Simulator(scene, int(rng.integers(2**31)))):
            scan, kept = simulated.scan, (simulated.origin < 0) | (k >= 20)
            features = {name: values[kept] for name, values in scan.features.items()}
            made = replace(
                scan, range=scan.range[kept], azimuth=scan.azimuth[kept], features=features
            )
            yield (
                (fix(made, k) if fix else made),
                dict(enumerate(simulated.truth)) if k >= 20 else {},
            )

    return draw


def textured(rng: np.random.Generator) -> Iterator[tuple[Scan, Truth]]:
    """The box without its target; neighbours in its clutter are alike in strength."""
    law = ClutterStrength("k", 0.5, texture_length=500.0, texture_time=180.0)
    scene = replace(BOX, scans=100, targets=(), target_strengths=(), clutter_strength=law)
    return ((made.scan, {}) for made in Simulator(scene, int(rng.integers(2**31))))


def by_range(scan: Scan, index: int) -> Scan:
    """Amplitudes that fall with range, by a time-varied gain that was not set."""
    level = scan.features["intensity"] * (3000.0 / scan.range) ** 2
    return replace(scan, features={"intensity": level})


def gain_steps(scan: Scan, index: int) -> Scan:
    """A gain that steps every 7 pings."""
    return replace(
        scan, features={"intensity": scan.features["intensity"] * 4.0 ** (index // 7 % 2)}
    )


def strong_boats(rng: np.random.Generator) -> Iterator[tuple[Scan, Truth]]:
    """Four boats of 10 dB, seen in half of the scans of denser clutter."""
    away = rng.uniform(80.0, 300.0, 4)
    paths = [path(course(rng, 60, 2.0, away=far)[0]) for far in away]
    for scan, truth in drawn(SELDOM, PERIOD, paths, rng):
        place = scan.range * np.exp(1j * scan.azimuth)
        boats = np.array([state[0] + 1j * state[2] for state in truth.values()])
        near = (np.abs(place - boats[:, None]) < 12.0).any(axis=0)
        level = rng.exponential(np.where(near, 11.0, 1.0))
        yield replace(scan, features={"intensity": level}), truth


def in_clutter(rng: np.random.Generator) -> Seen:
    """A boat in denser clutter."""
    return drawn(DENSE, PERIOD, [path(course(rng, 40, 3.0)[0])], rng)


def rated(rng: np.random.Generator) -> Seen:
    """The boat in denser clutter, whose range rates are measured."""
    for scan, truth in in_clutter(rng):
        x, vx, y, vy = truth[0]
        near = np.abs(scan.range * np.exp(1j * scan.azimuth) - (x + 1j * y)) < 15.0
        own, error = (
            vx * np.cos(scan.azimuth) + vy * np.sin(scan.azimuth),
            rng.normal(size=len(scan)),
        )
        rate = np.where(near, own + 0.3 * error, 3.0 * error)
        yield replace(scan, features={"range_rate": rate}), truth


def late(rng: np.random.Generator) -> Seen:
    """The boat in denser clutter comes after 100 scans."""
    states_ = path(course(rng, 150, 1.5)[0])
    states_[:100] = np.nan
    return drawn(DENSE, PERIOD, [states_], rng)


def rough(rng: np.random.Generator) -> Seen:
    """A boat that is measured with errors of 6 m and 2 degrees."""
    true = replace(HARBOUR, range_std=6.0, azimuth_std=math.radians(2.0))
    return drawn(true, PERIOD, [path(course(rng, 80, 1.5)[0])], rng)


def group(name: str) -> Scene:
    """One of the groups of `crowds.py`."""
    found = GROUPS[name]
    return Scene(
        found.sensor,
        lambda rng: found.draw(found.sensor, rng),
        found.gate,
        (("max_speed", found.max_speed),),
    )


@dataclass(frozen=True)
class Model:
    """A model, how it is left out, and the scene whose figure needs it.

    Attributes
    ----------
    scene : Scene
    figure : str
        Of `Scene.figures`.
    without : tuple of (object, str, object)
        Attributes of the package, and what stands in their place.
    options : dict
        Options of `make_initiator` that leave it out.
    """

    scene: Scene
    figure: str
    without: tuple[tuple[Any, str, Any], ...] = ()
    options: dict[str, Any] | None = None

    @contextmanager
    def left_out(self) -> Iterator[Scene]:
        """The scene, run without the model."""
        with ExitStack() as stack:
            for owner, name, value in self.without:
                stack.enter_context(mock.patch.object(owner, name, value))
            given = dict(self.scene.options) | (self.options or {})
            yield replace(self.scene, options=tuple(given.items()))


def same(values: Any, *_: Any, **__: Any) -> Any:
    """In place of a rule that changes its first argument."""
    return values


def nothing(*_: Any, **__: Any) -> None:
    """In place of a rule that changes something in place."""


def no_hull(*_: Any) -> None:
    """In place of a convex hull."""
    raise density.QhullError


NO_START_CONTINUES = lambda starts, *_: np.full(len(starts), -1)  # noqa: E731
MODELS = {
    "rings of the clutter map": Model(
        Scene(SONAR, clutter_alone(100, 12.0, ring)),
        "false",
        ((density._MapEstimate, "_raise_rings", nothing),),
    ),
    "windows of the clutter map": Model(
        Scene(
            SensorModel(
                range_std=1.0,
                range_std_fraction=0.0,
                azimuth_std=math.radians(1.0),
                max_range=1000.0,
                clutter_density=2e-5,
            ),
            clutter_alone(240, 1.5, reverberation),
        ),
        "false",
        ((density.WindowBounds, "moved", lambda self, density, *_: density),),
    ),
    "where clutter is seen": Model(
        Scene(SensorModel(clutter_density=1e-6), short_range, 15.0),
        "false",
        ((density.SeenClutterExtent, "update", nothing),),
    ),
    "hull of where clutter is seen": Model(
        Scene(
            replace(RADAR, max_range=1600.0),
            band,
            options=(("max_speed", 10.0), ("false_tracks_per_hour", 100.0)),
        ),
        "false",
        ((density, "ConvexHull", no_hull),),
    ),
    "level of a scan": Model(
        Scene(HARBOUR, squalls, options=(("max_speed", 10.0), ("false_tracks_per_hour", 300.0))),
        "false",
        ((density.ClutterMap, "take_level", nothing),),
    ),
    "clutter behind targets": Model(
        Scene(RADAR, ghosts, 40.0, (("max_speed", 15.0),)),
        "false",
        (
            (
                excess.SecondaryEchoes,
                "behind_targets",
                lambda self, _, cells: np.ones(len(cells.row)),
            ),
        ),
    ),
    "clutter that stays": Model(
        Scene(SECTOR, piles, 8.0, (("min_speed", 0.5),)),
        "false",
        ((fixed_places.FixedPlaces, "known", False),),
    ),
    "detection probability": Model(
        group("P_D 0.4"), "lost", options={"detection_probability": "given"}
    ),
    "proof of tracks that show it": Model(
        Scene(DENSE, late, options=(("max_speed", 10.0), ("false_tracks_per_hour", 1000.0))),
        "false",
        ((confirmed_tracks, "NEW_EXISTENCE_BY_SCANS", 0.99),),
    ),
    "errors of the sensor": Model(
        Scene(replace(HARBOUR, range_std=2.0, azimuth_std=math.radians(0.7)), rough),
        "tracks",
        options={"sensor_errors": "given"},
    ),
    "a start may have a track": Model(
        Scene(replace(HARBOUR, range_std=1.0, azimuth_std=math.radians(0.3)), rough),
        "tracks",
        ((merging, "may_have_track", lambda starts, *_: np.zeros(len(starts), bool)),),
    ),
    "lumps of clutter": Model(
        Scene(SONAR, lumps),
        "false",
        ((excess.Overdispersion, "variance", 0.0),),
    ),
    "clutter behind clutter": Model(
        Scene(SONAR, bursts),
        "false",
        ((excess.SecondaryEchoes, "among", lambda self, cells, *_: np.ones(len(cells.row))),),
    ),
    "fading": Model(
        Scene(HARBOUR, outages(8)),
        "lost",
        tuple((module, "fading_predicted", same) for module in (evaluation, branches)),
    ),
    "velocity prior that ends at v_max": Model(
        Scene(HARBOUR, too_fast),
        "false",
        (
            (evaluation, "LOG_GAIN", 0.0),
            (confirmation, "LOG_GAIN", 0.0),
            (confirmation, "decided_by_speed", same),
        ),
    ),
    "branches of a track": Model(
        group("boat among buoys"), "lost", ((branches, "MOST_BRANCHES", 1),)
    ),
    "target manoeuvre": Model(
        group("boat that turns"), "lost", ((TargetManoeuvre, "update", nothing),)
    ),
    "turns": Model(group("boat that turns"), "lost", ((motion, "SCANS_TO_TURN", math.inf),)),
    "a start continues a track": Model(
        Scene(HARBOUR, outages(25)), "ids", ((merging, "continued", NO_START_CONTINUES),)
    ),
    "several echoes of a target": Model(
        group("vessel of 20 m"), "tracks", ((SeveralEchoesTest, "log_ratio", 0.0),)
    ),
    "planned threshold": Model(
        Scene(DENSE, in_clutter), "delay", ((Threshold, "prepare", nothing),)
    ),
    "range rates": Model(
        Scene(replace(DENSE, range_rate_std=0.3), rated),
        "delay",
        ((range_rates, "measured", lambda detections: np.zeros(detections.shape, bool)),),
    ),
    "amplitudes": Model(
        Scene(BOX.sensor, strong(ClutterStrength(), 10.0), 370.0),
        "delay",
        options={"intensity": "off"},
    ),
    "levels of places": Model(
        Scene(BOX.sensor, strong(ClutterStrength(), 10.0, by_range), 370.0),
        "delay",
        ((amplitude.Levels, "at", lambda self, places: np.zeros(len(places))),),
    ),
    "amplitude of a track": Model(
        Scene(SELDOM, strong_boats),
        "lost",
        (
            (
                confirmed_tracks.ConfirmedTracks,
                "amplitude_increment",
                lambda self, track, *_: np.zeros(len(track)),
            ),
        ),
    ),
    "level of a ping": Model(
        Scene(BOX.sensor, strong(ClutterStrength(), 10.0, gain_steps), 370.0),
        "delay",
        ((amplitude, "level_of_ping", same),),
    ),
    "texture of the amplitudes": Model(
        Scene(BOX.sensor, textured), "false", ((amplitude.Texture, "doubt", 0.0),)
    ),
    "a track stands still": Model(
        replace(group("boat among buoys"), options=(("max_speed", 8.0), ("min_speed", 0.5))),
        "tracks",
        ((stationary, "stationary_probability", lambda options, state, *_: np.zeros(len(state))),),
    ),
}


def measured(model: Model, runs: int, seed: int) -> tuple[float, float]:
    """The figure of a model's scene with it and without it."""
    found = [model.scene.figures([seed, run])[model.figure] for run in range(runs)]
    with model.left_out() as scene:
        without = [scene.figures([seed, run])[model.figure] for run in range(runs)]
    return float(np.mean(found)), float(np.mean(without))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="+", choices=MODELS, default=list(MODELS))
    parser.add_argument("--runs", type=int, default=8)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    rows = []
    for name in options.only:
        model = MODELS[name]
        found, without = measured(model, options.runs, options.seed)
        rows.append([name, model.figure, f"{found:.3g}", f"{without:.3g}"])
        print(*rows[-1], sep="  ", flush=True)
    print(terminal_table(["model", "figure", "with it", "without it"], rows))


if __name__ == "__main__":
    main()
