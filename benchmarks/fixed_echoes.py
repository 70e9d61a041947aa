"""Fixed echoes, measured: what `min_speed` keeps back, and how much later it publishes.

- reflectors: share of five fixed reflectors that is ever published, and share of the pings after
  the first 30 in which each is listed as a fixed echo; at P_D 0.8, for a fixed sonar, for a sonar
  whose own pose is uncertain, for a moving sonar, and for errors larger than stated;
- swimmers: ping of publication with `min_speed`, without, and of an oracle that knows the
  associations and is sure by the same test; radial, tangential and any course;
- departures: reflectors that set off after a minute, against an oracle that also knows when;
- quay: tracks published on a quay, whose echoes are piles that are seen seldom or random glints,
  in the first minute and in the next four, and how a swimmer along it, 30 m off, is held.

    python benchmarks/fixed_echoes.py reflectors|swimmers|departures|quay [--runs 20]
"""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Iterable, Iterator
from dataclasses import replace

os.environ["OMP_NUM_THREADS"] = "1"
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import numpy as np
from fixed_echoes_scenes import (
    AZIMUTH_STD,
    RANGE_STD,
    Ping,
    Scene,
    Target,
    piles,
    reflectors,
    swimmer,
)

from tsepm_ros import make_initiator
from tsepm_ros.tools.terminal import with_progress
from tsepm_ros.tracker.clusters.grouping import chosen

MIN_SPEED, MAX_SPEED = 0.3, 10.0
SURE = 0.9
SHARE = 0.9
"""Prior share of what stands still, as in the package."""
PARTS = 0.5, 0.25, 0.125, 0.125
"""Shares of moving targets of at most MAX_SPEED, half of it, ..., as in the package."""
NEAR = 15.0
"""Distance within which a fixed echo is a reflector's, m."""
LEARNING, ENTERS = 60, 180
"""Quay: pings of the first minute, and the ping at which the swimmer enters."""


def oracle(pings: list[Ping], target: int, known: Target | None = None) -> Iterator[float]:
    """Probability of moving by the true hits alone, ping by ping.

    The test of the package on a least-squares fit to the true hits, by sums over a grid of
    velocities. With a `known` target, its place and the time at which it sets off are known.
    """
    information, moment = np.zeros((4, 4)), np.zeros(4)
    step = 0.04
    axis = np.arange(-MAX_SPEED, MAX_SPEED + step / 2, step)
    vx, vy = np.meshgrid(axis, axis)
    speed = np.hypot(vx, vy)
    if known is not None:
        tight = np.zeros((2, 4))
        tight[0, 0] = tight[1, 2] = 1.0
        information += 1e8 * tight.T @ tight
        moment += 1e8 * tight.T @ np.asarray(known.place)
    for ping in pings:
        scan = ping.scan
        time = scan.stamp - (known.sets_off if known is not None else 0.0)
        for row in np.flatnonzero(ping.origin == target):
            if time < 0.0:
                continue
            x, y = ping.truth[target] - scan.sensor_pose[:2]
            distance, angle = math.hypot(x, y), math.atan2(y, x)
            turn = np.array(
                [[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]
            )
            error = turn @ np.diag([RANGE_STD, AZIMUTH_STD * distance]) ** 2 @ turn.T
            azimuth = scan.azimuth[row]
            seen = scan.range[row] * np.array([math.cos(azimuth), math.sin(azimuth)])
            rows = np.array([[1.0, time, 0.0, 0.0], [0.0, 0.0, 1.0, time]])
            weight = rows.T @ np.linalg.inv(error)
            information += weight @ rows
            moment += weight @ (seen + scan.sensor_pose[:2])
        if np.linalg.matrix_rank(information) < 4:
            yield 0.0
            continue
        covariance = np.linalg.inv(information)
        mean = covariance @ moment
        spread = covariance[1::2, 1::2]
        inverse = np.linalg.inv(spread)
        apart = np.stack([vx - mean[1], vy - mean[3]])
        density = np.exp(-0.5 * np.einsum("iab,ij,jab->ab", apart, inverse, apart))
        at_rest = math.exp(-0.5 * mean[1::2] @ inverse @ mean[1::2])
        slow = density[speed < MIN_SPEED].mean()
        fast = 0.0
        for part, limit in zip(PARTS, MAX_SPEED / 2.0 ** np.arange(len(PARTS)), strict=True):
            fast += part * density[(speed >= MIN_SPEED) & (speed <= limit)].mean()
        yield (1 - SHARE) * fast / ((1 - SHARE) * fast + SHARE * 0.5 * (at_rest + slow))


def options(scene: Scene, min_speed: float, args: argparse.Namespace) -> dict[str, object]:
    """Options of an initiator for a scene."""
    common = {"sensor": scene.sensor, "max_speed": MAX_SPEED, "min_speed": min_speed}
    return common | {"clutter_density": args.density}


def first_published(
    pings: list[Ping], scene: Scene, min_speed: float, args: argparse.Namespace
) -> tuple[dict[int, int], dict[int, int], int]:
    """Ping of the first track of each target, pings in which it was a fixed echo, other tracks."""
    initiator = make_initiator(args.method, **options(scene, min_speed, args))
    published: dict[int, int] = {}
    listed = dict.fromkeys(range(len(scene.targets)), 0)
    others = 0
    for number, ping in enumerate(pings):
        for track in initiator.process(ping.scan):
            apart = np.hypot(*(ping.truth - track.position).T)
            target = int(np.argmin(apart))
            if apart[target] < NEAR:
                published.setdefault(target, number)
            else:
                others += 1
        places = initiator.fixed_echoes.state[:, 0::2]
        for target, place in enumerate(ping.truth):
            near = len(places) and np.hypot(*(places - place).T).min() < NEAR
            listed[target] += bool(near and number >= 30)
    return published, listed, others


def seeds(args: argparse.Namespace) -> Iterable[int]:
    """Seeds of the runs, with progress on a terminal."""
    return with_progress(range(args.seed, args.seed + args.runs), args.runs, "runs")


def run_reflectors(args: argparse.Namespace) -> None:
    """Print what becomes of fixed reflectors."""
    plain = Scene(detection_probability=0.8)
    kinds = {
        "fixed sonar": plain,
        "false detections 100 a ping": replace(plain, false=100.0),
        "own heading 1 degree, position 1 m": replace(
            plain, heading_std=math.radians(1.0), position_std=1.0
        ),
        "the same, lasting 30 s": replace(
            plain, heading_std=math.radians(1.0), position_std=1.0, pose_memory=30.0
        ),
        "sonar at 1 m/s": replace(plain, speed=1.0, pings=40),
        "errors 1.3 times the stated": replace(plain, echo_std=(1.3, 1.3)),
    }
    for name, kind in kinds.items():
        if not name.startswith(args.only):
            continue
        published = listed = others = 0
        for seed in seeds(args):
            rng = np.random.default_rng([seed, 17])
            scene = replace(kind, targets=reflectors(rng))
            first, pings, other = first_published(list(scene.draw(rng)), scene, MIN_SPEED, args)
            published += len(first)
            listed += sum(pings.values())
            others += other
        number = 5 * args.runs
        share = listed / max(number * (kind.pings - 30), 1)
        print(
            f"{name}: {published} of {number} published, listed in {share:.3f} of the pings, "
            f"{others} other tracks",
            flush=True,
        )


def run_swimmers(args: argparse.Namespace) -> None:
    """Print when swimmers are published."""
    for course in ("radial", "tangential", "any"):
        rows = []
        for seed in seeds(args):
            rng = np.random.default_rng([seed, 18])
            scene = Scene([swimmer(rng, course)], pings=60)
            pings = list(scene.draw(rng))
            sure = [probability >= SURE for probability in oracle(pings, 0)]
            rows.append(
                [
                    first_published(pings, scene, MIN_SPEED, args)[0].get(0, math.inf),
                    first_published(pings, scene, 0.0, args)[0].get(0, math.inf),
                    sure.index(True) if True in sure else math.inf,
                ]
            )
        slow, free, oracles = np.array(rows, float).T
        _print_delays(course, "without", slow - free)
        _print_delays(course, "the oracle", slow - np.maximum(oracles, free))
        print(f"  pings (from 0): with {slow.mean():.1f}, without {free.mean():.1f}, ", end="")
        print(f"oracle {oracles.mean():.1f}", flush=True)


def run_departures(args: argparse.Namespace) -> None:
    """Print when reflectors that set off are published."""
    for course in ("radial", "tangential", "any"):
        later, missed = [], 0
        for seed in seeds(args):
            rng = np.random.default_rng([seed, 19])
            target = replace(swimmer(rng, course), sets_off=60.0)
            scene = Scene([target])
            pings = list(scene.draw(rng))
            sure = [probability >= SURE for probability in oracle(pings, 0, target)]
            first = first_published(pings, scene, MIN_SPEED, args)[0].get(0, math.inf)
            missed += first < 60
            later.append(first - sure.index(True))
        _print_delays(course, "the oracle", np.array(later, float))
        print(f"  published before they set off: {missed}", flush=True)


def run_quay(args: argparse.Namespace) -> None:
    """Print how many tracks a quay gives, and what becomes of a swimmer in front of it."""
    plain = Scene(false=5.0, pings=300)
    kinds = {
        "piles": plain,
        "glints": replace(plain, glints=12.0),
        "piles, sonar at 0.2 m/s": replace(plain, speed=0.2),
    }
    for name, kind in kinds.items():
        early, late, delay, held, on = np.array([quay_run(kind, s, args) for s in seeds(args)]).T
        print(
            f"{name}: {early.mean():.2f} tracks a run in the first minute, {late.mean():.2f} in "
            f"the next four; swimmer held from ping {np.median(delay):.0f} on in "
            f"{held.mean():.3f} of the pings; plots on in {on.sum():.0f} of {args.runs}",
            flush=True,
        )


def quay_run(kind: Scene, seed: int, args: argparse.Namespace) -> tuple[int, int, int, float, bool]:
    """A quay, and a swimmer along it.

    Returns
    -------
    early, late : int
        Tracks elsewhere than at the swimmer, in the first `LEARNING` pings and later.
    delay : int
        Pings from the swimmer's first to a track near it.
    held : float
        Share of the pings from then on with a track near it.
    plots_on : bool
        Whether plots were made at the end.
    """
    rng = np.random.default_rng([seed, 20])
    swims = Target((120.0 - 0.3 * 60.0, -57.0), (0.3, 0.95), ENTERS)
    places = [] if kind.glints else piles(rng)
    scene = replace(kind, targets=[*places, swims])
    initiator = make_initiator(args.method, **options(scene, MIN_SPEED, args))
    elsewhere, near = [], []
    for number, ping in enumerate(scene.draw(rng)):
        scan, place = ping.scan, ping.truth[-1]
        present = number >= ENTERS
        if not present:
            scan = chosen(scan, np.flatnonzero(ping.origin != len(places)))
        away = [np.hypot(*(place - track.position)) for track in initiator.process(scan)]
        elsewhere += [number for distance in away if not (present and distance < NEAR)]
        tracks = initiator.current.state[:, 0::2]
        near.append(bool(np.hypot(*(tracks - place).T).min(initial=np.inf) < 5.0))
    early = sum(number < LEARNING for number in elsewhere)
    first = near.index(True, ENTERS) if True in near[ENTERS:] else kind.pings
    held = float(np.mean(near[first:])) if first < kind.pings else 0.0
    return early, len(elsewhere) - early, first - ENTERS, held, initiator.plots.active


def _print_delays(course: str, reference: str, later: np.ndarray) -> None:
    print(
        f"{course}: later than {reference} by {np.median(later):.0f} pings in the median, "
        f"{np.quantile(later, 0.9, method='lower'):.0f} at 0.9, {later.max():.0f} at most; "
        f"more than two in {np.mean(later > 2):.2f}",
        flush=True,
    )


def main() -> None:
    """Run a part."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parts = {
        "reflectors": run_reflectors,
        "swimmers": run_swimmers,
        "departures": run_departures,
        "quay": run_quay,
    }
    parser.add_argument("part", choices=parts)
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--method", default="score")
    parser.add_argument("--density", default="estimated")
    parser.add_argument("--only", default="", help="reflectors: the kinds that begin so")
    args = parser.parse_args()
    parts[args.part](args)


if __name__ == "__main__":
    main()
