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
"""Golden outputs: tracks, confirmed tracks and counts of short scenes, compared with stored ones.

    python test/golden/golden_outputs.py          print what differs from the stored outputs
    python test/golden/golden_outputs.py renew    the same, and store the outputs of this code

`make golden` renews. A difference is a changed result: it is intended, and stands in the commit
that causes it, or it is an error.
"""

import argparse
import json
import math
import sys
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from tsepm_ros import Scan, SensorModel
from tsepm_ros.own_ship.registration import UnregisteredScan
from tsepm_ros.session.session import ScanResult, Session
from tsepm_ros.settings.node_options import SessionOptions
from tsepm_ros.settings.settings import Settings
from tsepm_ros.tools.simulation import Scenario, Simulator
from tsepm_ros.tools.simulation.scenario import ClutterStrength, TargetStrength, load_scenario
from tsepm_ros.tracker.options import CommonOptions
from tsepm_ros.tracker.scan import ScanArc

FOLDER = Path(__file__).parent
TOLERANCE = 1e-9
"""Of a number, relative to the largest of its field, at least 1."""
DIGITS = 12
HELD_EVERY = 4
"""Scans after which the confirmed tracks are recorded."""
FAST = SensorModel(
    range_std=0.2,
    range_std_fraction=0.0,
    azimuth_std=0.01,
    max_range=100.0,
    azimuth_min=-1.2,
    azimuth_max=1.2,
    detection_probability=0.9,
    clutter_density=3e-4,
)
"""A sonar of five pings a second."""
MOVING = ((40.0, -0.5, 10.0, 0.3), (60.0, 0.4, -20.0, 0.6))
"""States of its two targets at the first ping: x, vx, y, vy."""


def box_results(method: str, scans: int = 14, **changes: Any) -> Iterator[ScanResult]:
    """The box scene, with the values of the scenario that are given changed."""
    scenario = replace(load_scenario("box"), scans=scans, **changes)
    return simulated_results(scenario, method=method)


def simulated_results(scenario: Scenario, **session: Any) -> Iterator[ScanResult]:
    """A simulated scenario, seed 1."""
    settings = Settings(session=SessionOptions(**session), sensor=scenario.sensor)
    scans = [UnregisteredScan(one.scan, "sonar") for one in Simulator(scenario, 1)]
    return results(settings, scans)


def cluster_results() -> Iterator[ScanResult]:
    """Two targets that give two to four echoes a ping."""
    rng = np.random.default_rng(3)
    scans = []
    for index in range(40):
        points = [false_detections(rng, 6)]
        for x, vx, y, vy in MOVING:
            centre = np.array([x + 0.2 * index * vx, y + 0.2 * index * vy])
            points.append(centre + rng.uniform(-0.6, 0.6, (rng.integers(2, 5), 2)))
        x, y = np.concatenate(points).T
        scans.append(UnregisteredScan(Scan(0.2 * index, np.hypot(x, y), np.arctan2(y, x)), "sonar"))
    common = CommonOptions(max_speed=2.5, target_extent=1.5, min_speed=0.2)
    return results(Settings(sensor=FAST, common=common), scans)


def false_detections(rng: np.random.Generator, mean: float) -> np.ndarray:
    """Positions in the coverage of `FAST`, (n, 2), uniform in area."""
    number = rng.poisson(mean)
    distance = FAST.max_range * np.sqrt(rng.uniform(1e-4, 1.0, number))
    azimuth = rng.uniform(FAST.azimuth_min, FAST.azimuth_max, number)
    return np.stack([distance * np.cos(azimuth), distance * np.sin(azimuth)], axis=1)


def sweep_results() -> Iterator[ScanResult]:
    """A turning beam: a message for each of 90 sectors, a turn in 2 s."""
    rng = np.random.default_rng(5)
    sensor = replace(FAST, azimuth_min=-math.pi, azimuth_max=math.pi)
    width, messages = 2.0 * math.pi / 90, []
    for index in range(90 * 12):
        time, start = index * 2.0 / 90, (index % 90) * width - math.pi
        echoes = [
            (math.hypot(x + time * vx, y + time * vy), math.atan2(y + time * vy, x + time * vx))
            for x, vx, y, vy in MOVING
        ]
        seen = [(r, a) for r, a in echoes if start <= a < start + width]
        seen += [(rng.uniform(2.0, 99.0), start + 0.5 * width)] * (rng.random() < 0.1)
        range_, azimuth = np.array(seen, float).reshape(-1, 2).T
        range_ = range_ + 0.2 * rng.standard_normal(len(range_))
        beams = ScanArc(start, width, True)
        messages.append(UnregisteredScan(Scan(time, range_, azimuth), "sonar", beams=beams))
    return results(Settings(session=SessionOptions(sweep="auto"), sensor=sensor), messages)


def results(settings: Settings, scans: list[UnregisteredScan]) -> Iterator[ScanResult]:
    """Results of a session that takes the scans one by one."""
    session = Session(settings)
    for scan in scans:
        session.add_scan(scan, 0.0)
        yield from session.process()
    yield from session.process(last=True)


SEA = load_scenario("box")
SCENES = {
    "box": lambda: box_results("score"),
    "box_tsepm": lambda: box_results("tsepm", scans=9),
    "four_targets": lambda: simulated_results(load_scenario("four_targets")),
    "clusters": cluster_results,
    "amplitudes": lambda: box_results(
        "score", clutter_strength=ClutterStrength(), target_strengths=(TargetStrength(6.0),)
    ),
    "range_rates": lambda: box_results("score", sensor=replace(SEA.sensor, range_rate_std=0.5)),
    "sweep": sweep_results,
}
"""Results of each scene by its name."""


def output(name: str) -> list[dict[str, Any]]:
    """What is compared of a scene: a mapping for each scan."""
    scans = []
    for index, result in enumerate(SCENES[name]()):
        counts = {key: value for key, value in vars(result.statistics).items() if value}
        scan = {"stamp": result.stamp, "counts": counts, "new": described(result.starts)}
        if index % HELD_EVERY == HELD_EVERY - 1:
            scan["held"] = described(result.current)
        if result.ended:
            scan["ended"] = result.ended
        scans.append(scan)
    return scans


def described(tracks: Any) -> dict[str, Any]:
    """Tracks by their ids, with rounded numbers."""
    return {
        f"track {track.track_id}": {
            "hits": [f"{scan}/{row}" for scan, row in track.hits],
            "state": rounded(track.state),
            "covariance": rounded(track.covariance[np.triu_indices(4)]),
            "score": rounded([track.evaluation, track.score]),
            "revision": int(track.revision),
        }
        for track in tracks
    }


def rounded(numbers: Any) -> list[float | None]:
    """Numbers with `DIGITS` significant digits; None for one that is not known."""
    return [float(f"{number:.{DIGITS}g}") if math.isfinite(number) else None for number in numbers]


def path_of(name: str) -> Path:
    """The file of a scene's stored output."""
    return FOLDER / f"{name}.json"


def stored(name: str) -> list[dict[str, Any]]:
    """The stored output of a scene; empty if there is none."""
    path = path_of(name)
    return json.loads(path.read_text("utf-8")) if path.exists() else []


def differences(name: str, now: list[dict[str, Any]]) -> list[str]:
    """What differs from the stored output, a line each: the scene, the scan and the track."""
    before = stored(name)
    lines = [f"{name}: {len(before)} scans before, {len(now)} now"] * (len(before) != len(now))
    for index, (old, new) in enumerate(zip(before, now, strict=False)):
        lines += [f"{name}, scan {index}, {line}" for line in compared(old, new)]
    return lines


def compared(old: Any, new: Any, where: str = "") -> Iterator[str]:
    """Differences of two values of JSON."""
    if isinstance(old, Mapping) and isinstance(new, Mapping):
        for key in sorted({*old, *new}):
            place = f"{where} {key}".strip()
            if key not in new or key not in old:
                yield f"{place}: {'only before' if key in old else 'only now'}"
            else:
                yield from compared(old[key], new[key], place)
    elif _numbers(old) and _numbers(new) and len(old) == len(new):
        scale = max([1.0, *(abs(number) for number in old if number is not None)])
        for place, (one, other) in enumerate(zip(old, new, strict=True)):
            if (one is None) != (other is None) or (
                one is not None and abs(other - one) > TOLERANCE * scale
            ):
                yield f"{where}[{place}]: {one} before, {other} now{_share(one, other)}"
    elif old != new:
        yield f"{where}: {old} before, {new} now"


def _numbers(value: Any) -> bool:
    return isinstance(value, list) and all(
        one is None or isinstance(one, (int, float)) for one in value
    )


def _share(old: float | None, new: float | None) -> str:
    return f" ({(new - old) / abs(old):+.2g} of it)" if old and new is not None else ""


def renew(name: str, now: list[dict[str, Any]]) -> None:
    """Store the output of a scene, a scan a line."""
    lines = ",\n".join(json.dumps(scan, separators=(",", ":")) for scan in now)
    path_of(name).write_text(f"[\n{lines}\n]\n", encoding="utf-8")


def main() -> int:
    """Compare or renew."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("action", nargs="?", default="compare", choices=("compare", "renew"))
    options = parser.parse_args()
    found = []
    for name in SCENES:
        now = output(name)
        found += differences(name, now)
        if options.action == "renew":
            renew(name, now)
    print(*found, sep="\n")
    print(f"{len(found)} differences", file=sys.stderr)
    return 1 if found and options.action == "compare" else 0


if __name__ == "__main__":
    raise SystemExit(main())
