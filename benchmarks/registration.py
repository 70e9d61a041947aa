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
"""Set up wrong, told so: what is said of clocks, mirrors and ranges from what stands, and when.

Each row has a sonar on a vessel that turns and moves, objects that stand, clutter, and a diver; one
thing is set up wrong. Printed are the share of the seeds with the right note and with another, the
median time to it, and the share that is silent once the remedy is followed.

    python benchmarks/registration.py --seeds 20 --images 5
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from tsepm_ros import Scan, SensorModel, SonarImage, make_detector
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.own_ship.pose_history import PoseHistory, PoseSample
from tsepm_ros.own_ship.registration import Mounting, UnregisteredScan, register_in_fixed_frame
from tsepm_ros.session.registration_check import RegistrationCheck

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
    sonar: Sonar, name: str, seed: int, seconds: float, standing: int = 10, diver: bool = True
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
    speed = 0.5 * (sensor.max_range / 40.0 if sensor.max_range > 100 else 1.0)
    heading = rng.uniform(-3, 3)
    velocity = speed * np.array([math.cos(heading), math.sin(heading)])
    sent = 0
    for time in times:
        pose = np.array([np.interp(time, of_poses, poses[:, k]) for k in range(3)])
        # The diver swims to and fro ahead of the vessel.
        leg = abs((time * speed / (0.4 * sensor.max_range)) % 2.0 - 1.0) - 0.5
        sign = -1.0 if (time * speed / (0.4 * sensor.max_range)) % 2.0 < 1.0 else 1.0
        place = (
            poses[0, :2]
            + 0.5 * sensor.max_range * np.array([math.cos(middle), math.sin(middle)])
            + leg * 0.4 * sensor.max_range * velocity / speed
        )
        state = np.array([place[0], sign * velocity[0], place[1], sign * velocity[1]])
        objects = np.vstack([fixed, place[None]]) if diver else fixed
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
    if kind.startswith("late"):
        late = float(kind.split()[1])
        return [replace(one, stamp=one.stamp + late) for one in samples], scan
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


def noted(
    sonar: Sonar, name: str, kind: str, seed: int, seconds: float, images: bool, delay: float = 0.0
) -> tuple[float, str]:
    """Time to the note, s, and the note; infinite and empty without one."""
    check, poses = RegistrationCheck(delay), PoseHistory(max_extrapolation=1.0)
    rng = np.random.default_rng(1000 + seed)
    detector = make_detector(false_detections_per_ping=5.0) if images else None
    for samples, right, _ in scene(sonar, name, seed, seconds):
        scan = right
        samples, scan = wrongly(kind, samples, scan, sonar.sensor)
        for sample in samples:
            shifted = replace(sample, stamp=sample.stamp - delay)
            poses.add(shifted)
            check.add_pose(shifted)
        times = np.array([scan.stamp])
        if not poses or poses.held_poses(times) is None or len(poses) < 3:
            continue
        if detector is not None:
            image = pictured(scan, sonar.sensor, rng)
            pose = poses.held_poses(times)[0, :3]
            scan = detector.process(replace(image, sensor_pose=pose))
        arrived = UnregisteredScan(scan, "sonar")
        try:
            registered = register_in_fixed_frame(arrived, poses, Mounting())
        except ValueError:
            continue
        for notice in check.take(arrived, registered, sonar.sensor, Mounting()):
            return scan.stamp - START, notice.sentence
    return math.inf, ""


RIGHT = {"mirrored": "field bearing", "reversed": "image.near_first", "late": "own_ship_delay"}
"""Part of the note by what is wrong."""
ROWS = (
    ("imaging", "turns", ("right", "mirrored", "late 0.3", "reversed")),
    ("imaging", "a turn", ("right", "mirrored", "late 0.3")),
    ("imaging", "waves", ("right", "mirrored", "late 0.3")),
    ("imaging", "straight", ("right", "reversed")),
    ("imaging", "circle", ("right", "mirrored")),
    ("all round", "turns", ("right", "mirrored", "late 0.3", "reversed")),
    ("fast", "turns", ("right", "mirrored", "late 0.3", "reversed")),
)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--images", type=int, default=0, help="seeds of images, imaging only")
    parser.add_argument("--seconds", type=float, default=75.0)
    parser.add_argument("--right-seconds", type=float, default=600.0)
    options = parser.parse_args()
    print("| sonar | way | set up | seeds | right note | other note | time, s | then silent |")
    print("|---|---|---|---|---|---|---|---|")
    for images, seeds in ((False, options.seeds), (True, options.images)):
        for name, course, kinds in ROWS if seeds else ():
            sonar = replace(SONARS[name], period=0.4) if images else SONARS[name]
            for kind in kinds:
                seconds = options.right_seconds if kind == "right" else options.seconds
                seconds = min(seconds, 200.0) if images else seconds
                if images and name != "imaging":
                    continue
                found = [noted(sonar, course, kind, seed, seconds, images) for seed in range(seeds)]
                wanted = RIGHT.get(kind.split()[0], "nothing")
                good = [time for time, note in found if wanted in note]
                others = sum(bool(note) and wanted not in note for _, note in found)
                silent = ""
                if kind.startswith("late") and good:
                    delays = [
                        (seed, float(note.partition("own_ship_delay ")[2].partition(",")[0]))
                        for seed, (_, note) in enumerate(found)
                        if wanted in note
                    ]
                    again = [
                        noted(sonar, course, kind, seed, seconds, images, delay)[1]
                        for seed, delay in delays
                    ]
                    silent = f"{np.mean([not note for note in again]):.2f}"
                row = (
                    name + " images" * images,
                    course,
                    kind,
                    seeds,
                    f"{len(good) / seeds:.2f}",
                    f"{others / seeds:.2f}",
                    f"{np.median(good):.0f}" if good else "",
                    silent,
                )
                print("| " + " | ".join(map(str, row)) + " |", flush=True)


if __name__ == "__main__":
    main()
