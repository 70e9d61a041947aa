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
"""Set up wrong, told so: what is said of the set-up from echoes of what stands, and for how long.

Each row runs `Session` on a sonar on a vessel that moves, with clutter, a diver, and one scene:
posts; a quay, echoes of which come from anywhere along it; or a convoy, posts and seven boats on
own ship's course (boats: they alone). For the first 75 s one thing is set up wrong, then it is
mended at its source. Of detections or of images, with own ship's poses in order, or with one in ten
after the next. Printed are the share of the seeds with the right finding, with the cause unknown
and with a wrong one, the median time to the first, the errors of its figure (largest, and largest
in stated deviations), the longest time from the mending until it is gone, the share of seeds that
stay silent once the remedy is followed, and the check's mean time a ping.

    python benchmarks/registration.py --seeds 10
    python benchmarks/registration.py --seeds 10 --only images
"""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from time import process_time

import numpy as np

from tsepm_ros import Scan, SensorModel, SonarImage, make_detector
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.own_ship.pose_history import PoseHistory, PoseSample
from tsepm_ros.own_ship.registration import Mounting, UnregisteredScan
from tsepm_ros.session.session import Session
from tsepm_ros.settings.node_options import SessionOptions
from tsepm_ros.settings.settings import Settings

START = 1000.0
"""Stamp of the first scan, s."""


@dataclass(frozen=True)
class Sonar:
    """A sonar as it is, its period (s), and false detections a scan."""

    sensor: SensorModel
    period: float
    clutter: float


def _sonar(range_std: float, degrees: float, reach: float, half: float, period: float) -> Sonar:
    sensor = SensorModel(
        range_std=range_std,
        range_std_fraction=0.0,
        azimuth_std=math.radians(degrees),
        min_range=0.02 * reach,
        max_range=reach,
        azimuth_min=-math.radians(half),
        azimuth_max=math.radians(half),
    )
    return Sonar(replace(sensor, clutter_density=6.0 / sensor.coverage_area), period, 6.0)


SONARS = {
    "imaging": _sonar(0.1, 0.6, 40.0, 60.0, 0.2),
    "all round": _sonar(0.3, 1.5, 100.0, 180.0, 1.0),
    "fast": _sonar(0.1, 1.0, 30.0, 35.0, 0.1),
    "slow": _sonar(3.0, 1.0, 400.0, 180.0, 3.0),
}
WAYS = ("turns", "a turn", "straight", "rest", "circle", "waves")


def way(name: str, times: FloatArray, reach: float, rng: np.random.Generator) -> FloatArray:
    """Poses (n, 3) of a vessel at times: x, y, yaw."""
    slow = reach / 40.0 if reach > 100.0 else 1.0  # a ship of a long range is no faster in turning
    fine = np.arange(0.0, times.max() + 1.0, 0.02)
    rate = np.zeros(len(fine))
    full = math.radians(4.8)
    if name in ("turns", "a turn"):
        begin, sign = 10.0 + 5.0 * rng.random(), rng.choice([-1.0, 1.0])
        while begin < fine[-1]:
            angle = math.radians(20.0 if name == "a turn" else rng.uniform(20.0, 60.0))
            ends = begin + angle / full
            rate[(fine >= begin) & (fine < ends)] = sign * full
            begin = math.inf if name == "a turn" else ends + rng.uniform(5.0, 15.0)
            sign = -sign
    elif name == "circle":
        rate[:] = math.radians(2.0)
    elif name == "waves":
        rate = math.radians(3.0) * np.cos(2 * math.pi * fine / 7.0 + rng.uniform(0, 6))
    yaw = np.cumsum(rate) * 0.02 + rng.uniform(-3.0, 3.0)
    speed = {"rest": 0.0, "a turn": 0.0}.get(name, 0.7) * slow
    x, y = np.cumsum(speed * np.cos(yaw)) * 0.02, np.cumsum(speed * np.sin(yaw)) * 0.02
    return np.stack([np.interp(times, fine, a) for a in (x, y, yaw)], axis=1)


def scene(
    sonar: Sonar,
    name: str,
    seed: int,
    seconds: float,
    standing: int = 10,
    diver: bool = True,
    place: str = "posts",
) -> Iterator[tuple[list[PoseSample], Scan, FloatArray]]:
    """Poses since the last scan, a scan as a right driver sends it, and the diver's state."""
    rng = np.random.default_rng(seed)
    sensor = sonar.sensor
    times = np.arange(0.0, seconds, sonar.period)
    of_poses = np.arange(0.0, seconds + 3.0, 0.1)
    poses = way(name, of_poses, sensor.max_range, np.random.default_rng(seed))
    track = poses[:: max(len(poses) // 50, 1)]
    at = track[rng.integers(len(track), size=standing)]
    far, around = sensor.max_range * rng.uniform(0.15, 0.95, standing), rng.uniform(-1, 1, standing)
    half = min(0.5 * sensor.sector_width + 0.3, math.pi)
    fixed = at[:, :2] + far[:, None] * np.stack(
        [np.cos(at[:, 2] + half * around), np.sin(at[:, 2] + half * around)], axis=1
    )
    middle = np.interp(0.5 * seconds, of_poses, poses[:, 2])
    boats = sensor.max_range * np.random.default_rng(seed).uniform(-0.7, 0.7, (7, 2))
    course = poses[-1, :2] - poses[0, :2]
    along = course / max(float(np.hypot(*course)), 1e-9)
    quay = poses[0, :2] + sensor.max_range * (0.4 * np.array([-along[1], along[0]]) - along)
    speed = 0.5 * (sensor.max_range / 40.0 if sensor.max_range > 100 else 1.0)
    heading = rng.uniform(-3, 3)
    velocity = speed * np.array([math.cos(heading), math.sin(heading)])
    sent = 0
    for time in times:
        pose = np.array([np.interp(time, of_poses, poses[:, k]) for k in range(3)])
        # The diver swims to and fro ahead of the vessel.
        leg = abs((time * speed / (0.4 * sensor.max_range)) % 2.0 - 1.0) - 0.5
        sign = -1.0 if (time * speed / (0.4 * sensor.max_range)) % 2.0 < 1.0 else 1.0
        swims = (
            poses[0, :2]
            + 0.5 * sensor.max_range * np.array([math.cos(middle), math.sin(middle)])
            + leg * 0.4 * sensor.max_range * velocity / speed
        )
        state = np.array([swims[0], sign * velocity[0], swims[1], sign * velocity[1]])
        objects = np.vstack([fixed, swims[None]]) if diver else fixed
        if place == "quay":  # echoes come from anywhere along a wall with recesses
            far = rng.uniform(0.0, 5.0, 200)
            step = (far % 1.2 - 0.6).clip(-0.05, 0.05) * np.where(far % 1.2 > 0.6, 1.5, 1.0)
            side = np.where(far % 2.4 > 1.2, 1.0, -1.0) * (0.05 + step)
            across = np.array([-along[1], along[0]])
            wall = far[:, None] * along + side[:, None] * across
            objects = np.vstack([quay + sensor.max_range * wall, swims])
        elif place in ("convoy", "boats"):
            moving = poses[int(10 * time), :2] + boats
            objects = np.vstack([objects, moving]) if place == "convoy" else moving
        east, north = (objects - pose[:2]).T
        r, a = np.hypot(east, north), np.arctan2(north, east) - pose[2]
        seen = sensor.covers(r, a) & (rng.random(len(r)) < 0.9)
        r = r[seen] + sensor.range_std * rng.standard_normal(seen.sum())
        a = a[seen] + sensor.azimuth_std * rng.standard_normal(seen.sum())
        n = rng.poisson(sonar.clutter)
        low, high = sensor.min_range**2, sensor.max_range**2
        r = np.append(r, np.sqrt(rng.uniform(low, high, n)))
        a = np.append(a, rng.uniform(sensor.azimuth_min, sensor.azimuth_max, n))
        until = int(np.searchsorted(of_poses, time + 0.15))
        samples = [
            PoseSample(START + t, *p, frame_id="odom", child_frame_id="sonar")
            for t, p in zip(of_poses[sent:until], poses[sent:until].tolist(), strict=True)
        ]
        sent = max(sent, until)
        yield samples, Scan(START + time, np.maximum(r, 0.01), a), state


def wrongly(
    kind: str, samples: list[PoseSample], scan: Scan, sensor: SensorModel
) -> tuple[list[PoseSample], Scan]:
    """What a driver that is set up wrong sends of it."""
    if kind == "mirrored":
        return samples, scan.replaced(azimuth=-scan.azimuth)
    if kind == "reversed":
        ends = sensor.min_range + sensor.max_range
        return samples, scan.replaced(range=np.clip(ends - scan.range, 0.01, None))
    name, _, figure = kind.partition(" ")
    if name == "late":
        return [replace(one, stamp=one.stamp + float(figure)) for one in samples], scan
    if name == "yaw":
        return [replace(one, yaw=one.yaw - math.radians(float(figure))) for one in samples], scan
    if name == "view":
        return samples, scan.replaced(azimuth=scan.azimuth * float(figure))
    if name == "ranges":
        return samples, scan.replaced(range=scan.range * float(figure))
    if name == "compass":
        return [replace(one, yaw=0.5 * math.pi - one.yaw) for one in samples], scan
    return samples, scan


def pictured(scan: Scan, sensor: SensorModel, rng: np.random.Generator) -> SonarImage:
    """An image, 128 x 400, of speckle and the detections of a scan."""
    azimuth = np.linspace(sensor.azimuth_min, sensor.azimuth_max, 128)
    distance = np.linspace(sensor.min_range, sensor.max_range, 400)
    image = rng.rayleigh(1.0, (128, 400))
    for r, a in zip(scan.range, scan.azimuth, strict=True):
        row, cell = int(np.argmin(np.abs(azimuth - a))), int(np.argmin(np.abs(distance - r)))
        echo = image[max(row - 1, 0) : row + 2, max(cell - 2, 0) : cell + 3]
        echo += rng.rayleigh(6.0, echo.shape)
    return SonarImage(scan.stamp, distance, azimuth, image)


@dataclass(frozen=True)
class Row:
    """A sonar, the way of its vessel, what it sees, what is wrong, and how it arrives."""

    sonar: str
    way: str
    place: str
    kind: str
    every: int = 0
    images: bool = False


@dataclass
class Seen:
    """What a session said: from when on (s), and its mean time a ping in the check, s."""

    findings: list[tuple[float, str]] = field(default_factory=list)
    seconds: float = 0.0

    @property
    def first(self) -> tuple[float, str]:
        """The first finding; infinite and empty without one."""
        return next((found for found in self.findings if found[1]), (math.inf, ""))


def swapped(samples: Iterable[PoseSample], every: int) -> list[PoseSample]:
    """Samples by time, the last of each so many before its predecessor; 0: in order."""
    order = list(samples)
    for last in range(every - 1, len(order), every) if every else ():
        order[last - 1], order[last] = order[last], order[last - 1]
    return order


def watched(
    row: Row, seed: int, seconds: float, wrong: float, mounting_yaw: float = 0.0, delay: float = 0.0
) -> Seen:
    """Run a session on a scene that is set up wrong for a time, s."""
    sonar = replace(SONARS[row.sonar], period=0.4) if row.images else SONARS[row.sonar]
    options = SessionOptions(own_ship_source="odometry", fixed_frame="odom", own_ship_delay=delay)
    settings = Settings(options, sensor=sonar.sensor, mounting=Mounting(yaw=mounting_yaw))
    session, seen, number = Session(settings), Seen(), 0
    take = session._registration.take

    def timed(*arguments: object) -> object:
        begin = process_time()
        notices = take(*arguments)
        seen.seconds += process_time() - begin
        return notices

    session._registration.take = timed
    detector = make_detector(false_detections_per_ping=5.0) if row.images else None
    rng, poses = np.random.default_rng(1000 + seed), PoseHistory(max_extrapolation=1.0)
    waiting: list[PoseSample] = []
    for samples, scan, _ in scene(sonar, row.way, seed, seconds, place=row.place):
        if scan.stamp - START < wrong:
            samples, scan = wrongly(row.kind, samples, scan, sonar.sensor)
        waiting += samples
        complete = len(waiting) - len(waiting) % max(row.every, 1)
        for sample in swapped(waiting[:complete], row.every):
            session.add_own_ship(sample)
        del waiting[:complete]
        for sample in samples:
            poses.add(replace(sample, stamp=sample.stamp - delay))
        if detector is not None:
            image = pictured(scan, sonar.sensor, rng)
            pose = poses.held_poses(np.array([scan.stamp]))[0, :3] if len(poses) else None
            scan = detector.process(replace(image, sensor_pose=pose))
        session.add_scan(UnregisteredScan(scan, "sonar"), scan.stamp)
        number += 1
        for _ in session.process(scan.stamp):
            pass
        now = session.figures().findings["registration"]
        if now != (seen.findings[-1][1] if seen.findings else ""):
            seen.findings.append((scan.stamp - START, now))
    seen.seconds /= number
    return seen


RIGHT = {
    "mirrored": "field bearing",
    "reversed": "image.near_first",
    "late": "own_ship_delay",
    "yaw": "give mounting.yaw",
    "view": "angles of echoes",
    "ranges": "ranges fit",
    "compass": "heading is clockwise, as a compass's",
    "right": "nothing",
}
"""Part of the finding by what is wrong."""
UNKNOWN = "unknown"
REMEDY = {"late": r"own_ship_delay (-?[\d.]+)", "yaw": r"mounting.yaw (-?[\d.]+)"}
"""Where a finding has the figure to set."""
ERROR = r"\+- ([\d.]+)"


def printed(row: Row, seeds: int, right_seconds: float) -> None:
    """Run the seeds of a row, and print it."""
    name, _, figure = row.kind.partition(" ")
    seconds, wrong = (right_seconds, 0.0) if name == "right" else (2.0 * WRONG, WRONG)
    runs = [watched(row, seed, seconds, wrong) for seed in range(seeds)]
    said = [run.first for run in runs]
    good = [(seed, *found) for seed, found in enumerate(said) if RIGHT[name] in found[1]]
    unknown = [found for found in said if UNKNOWN in found[1]]
    others = sum(bool(found[1]) for found in said) - len(good) - len(unknown)
    errors, silent, gone = "", "", ""
    if good:
        last = [runs[seed].findings[-1] for seed, *_ in good]
        ends = [begin - WRONG if not text else math.inf for begin, text in last]
        gone = f"{max(0.0, *ends):.0f}"
    if name in REMEDY and good:
        remedies = [float(re.search(REMEDY[name], text)[1]) for *_, text in good]
        stated = [float(re.search(ERROR, text)[1]) for *_, text in good]
        true = float(figure) if name == "late" else math.radians(float(figure))
        off = np.abs(np.array(remedies) - true)
        off = off if name == "late" else np.minimum(off, np.abs(2 * math.pi - off))
        shown = f"{off.max():.2f} s" if name == "late" else f"{math.degrees(off.max()):.2f} deg"
        errors = f"{shown}, {np.max(off / stated):.1f}"
        again = [
            watched(
                row, seed, WRONG, WRONG, **{"delay" if name == "late" else "mounting_yaw": value}
            )
            for (seed, *_), value in zip(good, remedies, strict=True)
        ]
        silent = f"{np.mean([not run.first[1] for run in again]):.2f}"
    cells = (
        row.sonar + " images" * row.images,
        row.way,
        row.place,
        row.kind,
        f"1 in {row.every}" if row.every else "in order",
        seeds,
        f"{len(good) / seeds:.2f}",
        f"{len(unknown) / seeds:.2f}",
        f"{others / seeds:.2f}",
        f"{np.median([begin for _, begin, _ in good]):.0f}" if good else "",
        errors,
        gone,
        silent,
        f"{1e3 * np.mean([run.seconds for run in runs]):.2f}",
    )
    print("| " + " | ".join(map(str, cells)) + " |", flush=True)


WRONG = 75.0
"""Time for which a thing is set up wrong, and then right, s."""
KINDS = ("right", "yaw 10", "yaw -45", "yaw 180", "mirrored", "reversed", "late 0.3", "view 0.5")
ROWS = (
    *(Row("imaging", "turns", "posts", kind) for kind in (*KINDS, "ranges 0.5", "compass")),
    *(Row("imaging", "turns", "posts", kind, 10) for kind in KINDS[::2]),
    *(Row("imaging", "turns", "quay", kind) for kind in KINDS[:-1]),
    *(Row("imaging", "turns", "convoy", kind, 10) for kind in KINDS[:-1]),
    *(Row("imaging", "turns", "boats", kind) for kind in ("right", "yaw 21")),
    *(Row("imaging", "straight", "posts", kind) for kind in KINDS),
    *(Row("imaging", "straight", "quay", kind) for kind in ("right", "yaw 21")),
    *(Row("imaging", "straight", "convoy", kind) for kind in ("right", "yaw 21", "reversed")),
    *(Row("imaging", "straight", "boats", kind, 10) for kind in ("right", "yaw 21")),
    *(
        Row("imaging", way, "posts", kind)
        for way in ("a turn", "waves", "circle")
        for kind in ("right", "mirrored", "late 0.3")
    ),
    *(
        Row("all round", "turns", place, kind)
        for place in ("posts", "convoy")
        for kind in KINDS[:-1]
    ),
    *(Row("all round", "turns", "quay", kind, 10) for kind in ("right", "yaw 90")),
    *(Row("all round", "turns", "boats", kind) for kind in ("right", "yaw 21")),
    *(Row("fast", "turns", "posts", kind) for kind in KINDS),
    *(
        Row("imaging", "turns", "posts", kind, every, True)
        for kind, every in zip(KINDS, 4 * (0, 10), strict=True)
    ),
    *(Row("imaging", "turns", "quay", kind, 0, True) for kind in ("right", "yaw 21", "mirrored")),
    *(Row("imaging", "straight", "convoy", kind, 10, True) for kind in ("right", "yaw 21")),
)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--only", default="", help="words of the rows wanted, such as quay")
    parser.add_argument("--right-seconds", type=float, default=200.0)
    options = parser.parse_args()
    print(
        "| sonar | way | place | set up | poses | seeds | right | unknown | wrong | time, s "
        "| error, in its own | gone, s | then silent | ms a ping |"
    )
    print("|" + "---|" * 14)
    for row in ROWS:
        words = f"{row.sonar} {row.way} {row.place} {row.kind} {'images' * row.images}"
        if all(word in words for word in options.only.split()):
            printed(row, options.seeds, options.right_seconds)


if __name__ == "__main__":
    main()
