"""One side of `compare_commits`: runs the package on PYTHONPATH on random scenes."""

from __future__ import annotations

import dataclasses
import importlib
import math
import os
import pickle
import pkgutil
import re
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import yaml

SWITCHES: dict[str, float] = yaml.safe_load("""
{moving: 0.5, pose_errors: 0.4, offsets: 0.4, own_errors: 0.4, irregular: 0.5, lost_pings: 0.3,
empty_scans: 0.25, sector: 0.4, outside: 0.15, zone: 0.3, rates: 0.4, features: 0.6,
plot_features: 0.2, learn_density: 0.2, learn_detection: 0.4, limits: 0.15}
""")
"""Properties of a scene with their probabilities."""
CALM = dict.fromkeys(
    ("moving", "pose_errors", "offsets", "empty_scans", "outside", "lost_pings"), False
)
OPTIONS: dict[str, dict[str, list[Any]]] = yaml.safe_load("""
tsepm: {rule: &rules [[3, 4], [4, 5], [4, 6], [5, 8]], gate_probability: &gates [0.9, 0.99],
  estimator: &fits [unweighted, weighted, polar], merging: [moments, refit],
  evaluation: [normalized_distance, clutter_statistic], pruning_reading: [literal, squared],
  clutter_test_size: &sizes [0.05, 0.5], merging_probability: &merging [0.9, 0.98]}
score: {false_tracks_per_hour: [0.1, 1.0, 30.0], miss_probability: [0.005, 0.05], window: [5, 9],
  gate_probability: *gates, process_noise: [0.0, 0.001, 0.01], estimator: [weighted, polar],
  max_per_detection: [3, 100]}
sequential: {rule: *rules, gate_sigmas: &sigmas [0.0, 2.0], gate_error: [range, major_axis],
  matching: [oldest, nearest, shared], process_noise: &noises [0.0, 0.001],
  estimator: [least_squares, linear_fitting, kalman_filter]}
heuristic: {rule: *rules, min_step_speed: &slow [0.0, 0.5], max_acceleration: [0.3, 1.0],
  max_turn: [1.5, 3.0], gate_sigmas: *sigmas}
logic: {rule: *rules, gate_probability: *gates, degree: [1, 2, 3], missed: [waits, ends]}
hough: {rule: [[4, 5], [5, 8], [6, 8]], angles: [20, 45], cell: [150.0, 300.0]}
modified_hough: {rule: *rules, max_turn: [0.5, 1.5], min_step_speed: *slow, gate_sigmas: *sigmas}
clutter_test: {rule: *rules, gate_probability: *gates, clutter_test_size: *sizes, estimator: *fits}
split_merge: {rule: *rules, gate_probability: *gates, merging_probability: *merging}
multiple_model: {rule: *rules, speeds: [1, 2], headings: [4, 8], gate_probability: *gates,
  process_noise: *noises}
""")
"""Values from which each method's options are drawn; a rule is (min_hits, window)."""
RENAMED = {"min_step_speed": "min_speed"}
"""Names that options had in earlier commits."""


def draw_options(method: str, *seed: int) -> dict[str, Any]:
    """Draw the options of a method."""
    rng = np.random.default_rng([7, list(OPTIONS).index(method), *seed])
    drawn = {name: values[rng.integers(len(values))] for name, values in OPTIONS[method].items()}
    if "rule" in drawn:
        drawn["min_hits"], drawn["window"] = drawn.pop("rule")
    kind = locate("METHODS")[method]
    kind = pkgutil.resolve_name(kind) if isinstance(kind, str) else kind
    known = {field.name for field in dataclasses.fields(kind.Options)}
    return {RENAMED.get(name, name) if name not in known else name: drawn[name] for name in drawn}


def draw_scene(seed: int, **fixed: bool) -> dict[str, Any]:
    """Draw a scene: keywords of its scans, sensor and common options."""
    rng = np.random.default_rng([11, seed])
    on = {name: bool(rng.random() < chance) for name, chance in SWITCHES.items()} | fixed
    low, high, near = (-2.2, 1.3, 300.0) if on["sector"] else (-math.pi, math.pi, 0.0)
    reach, clutter = float(rng.choice([3000.0, 4000.0])), float(rng.choice([15.0, 25.0, 35.0]))
    density = clutter / (0.5 * (high - low) * (reach**2 - near**2))
    sensor = {
        **{"min_range": near, "max_range": reach, "azimuth_min": low, "azimuth_max": high},
        "range_std": float(rng.choice([5.0, 20.0])),
        "range_std_fraction": float(rng.choice([0.0, 0.005, 0.015])),
        "azimuth_std": math.radians(float(rng.choice([0.5, 1.0, 2.0]))),
        "detection_probability": float(rng.choice([0.7, 0.9, 0.98])),
        "clutter_density": density * float(rng.choice([0.5, 1.0, 2.0])),
        "range_rate_std": 0.5 * on["rates"],
    }
    common = {
        "max_speed": float(rng.choice([8.0, 12.0])),
        "hold_time": float(rng.choice([40.0, 120.0])),
        "plot_features": on["plot_features"],
        "clutter_density": ("given", "estimated")[on["learn_density"]],
        "detection_probability": ("given", "estimated")[on["learn_detection"]],
        "max_potential_tracks": 60 if on["limits"] else 5000,
        "max_raw_confirmations": 6 if on["limits"] else 200,
    }
    number, length = int(rng.integers(1, 4)), int(rng.integers(11, 18))
    place = reach * _unit(rng.uniform(low, high, number)) * rng.uniform(0.2, 0.7, (number, 1))
    velocity = rng.uniform(-5.0, 5.0, (number, 2))
    if number == 3:  # two of them meet
        place[2] = place[1] + 6.0 * length * (velocity[1] - velocity[2]) + rng.uniform(-30, 30, 2)
    intervals = rng.uniform(6.0, 18.0, length) if on["irregular"] else np.full(length, 12.0)
    scans = []
    for elapsed in np.cumsum(intervals)[rng.random(length) >= 0.15 * on["lost_pings"]]:
        now = place + velocity * elapsed
        scans.append(_draw_scan(rng, on, sensor, rng.poisson(clutter), elapsed, now, velocity))
    name = f"scene {seed} ({' '.join(switch for switch in on if on[switch])})"
    return {"scans": scans, "sensor": sensor, "common": common, "name": name}


def _unit(angle: np.ndarray) -> np.ndarray:
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def _draw_scan(
    rng: np.random.Generator,
    on: dict[str, bool],
    sensor: dict[str, float],
    clutter: int,
    elapsed: float,
    place: np.ndarray,
    velocity: np.ndarray,
) -> dict[str, Any]:
    motion = np.array([3.0, -2.0, 0.002]) * on["moving"]
    pose, (low, high) = motion * elapsed, (sensor["azimuth_min"], sensor["azimuth_max"])
    seen = rng.random(len(place)) < sensor["detection_probability"]
    to, reach, patch = (place - pose[:2])[seen], sensor["max_range"], clutter // 3 * on["zone"]
    r = np.append(np.hypot(*to.T), reach * np.sqrt(rng.uniform(1e-4, 1.0, clutter)))
    a = np.append(np.arctan2(*to.T[::-1]) - pose[2], rng.uniform(low, high, clutter))
    r += np.hypot(sensor["range_std"], sensor["range_std_fraction"] * r) * rng.normal(size=len(r))
    a += sensor["azimuth_std"] * rng.normal(size=len(a))
    r[len(r) - patch :] = reach * rng.uniform(0.4, 0.5, patch)
    a[len(a) - patch :] = rng.uniform(0.1, 0.4, patch)
    covered = (r > sensor["min_range"]) & (r < reach) & ((a - low) % (2 * math.pi) < high - low)
    kept = (covered | on["outside"]) & (r > 1.0) & (rng.random() >= 0.15 * on["empty_scans"])
    rows = rng.permutation(np.flatnonzero(kept))
    n, r, a, of_target = len(rows), r[rows], a[rows], rows < len(to)
    own = np.append(velocity[seen], np.zeros((clutter, 2)), axis=0)[rows]
    rate = ((own - motion[:2]) * _unit(a + pose[2])).sum(axis=1)
    rate += np.where(of_target, 0.5, 3.0) * rng.normal(size=n)
    sigma = np.where(of_target, 0.1, 0.8)
    optional = {
        "sensor_pose_covariance": ("pose_errors", np.diag([25.0, 16.0, 1e-4])),
        "time_offset": ("offsets", r / 1500.0),
        "sensor_pose": ("offsets", pose + r[:, None] / 1500.0 * motion),
        "range_std": ("own_errors", rng.uniform(5.0, 60.0, n)),
        "azimuth_std": ("own_errors", rng.uniform(0.005, 0.03, n)),
    }
    features = {
        "range_rate": ("rates", np.where(rng.random(n) < 0.1, np.nan, rate)),
        "intensity": ("features", 20.0 * np.exp(sigma * rng.normal(size=n))),
        "range_width": ("features", 15.0 * np.exp(sigma * rng.normal(size=n))),
        "azimuth_width": ("features", 0.03 * np.exp(sigma * rng.normal(size=n))),
    }
    scan = {"stamp": 1000.0 + elapsed, "range": r, "azimuth": a, "sensor_pose": pose}
    scan |= {name: value for name, (switch, value) in optional.items() if on[switch]}
    scan["features"] = {name: value for name, (switch, value) in features.items() if on[switch]}
    return scan | {"sensor_velocity": motion[:2]}


def locate(name: str) -> Any:
    """Find an object of the package by its name, whatever the layout of the package."""
    package = importlib.import_module("tsepm_ros")
    pattern = re.compile(rf"^(class |def )?{name}\b *[:(=]", re.MULTILINE)
    for module in pkgutil.walk_packages(package.__path__, "tsepm_ros."):
        path = Path(package.__path__[0], *module.name.split(".")[1:])
        source = path / "__init__.py" if module.ispkg else path.with_suffix(".py")
        if pattern.search(source.read_text(encoding="utf-8")):
            return getattr(importlib.import_module(module.name), name)
    raise ImportError(f"tsepm_ros defines no {name}")


def output(initiator: Any, stamp: float, new: Any) -> dict[str, Any]:
    """Results of a scan: new tracks in the order of their hits, held tracks by their ids."""
    held = initiator.current if hasattr(initiator, "current") else initiator.hold.current
    new, held = sorted(new, key=lambda t: t.hits), sorted(held, key=lambda t: t.track_id)
    numbers = [[value] for t in new for value in (t.stamp, t.evaluation, t.score, t.age)]
    return {
        "hits": [tuple((int(scan), int(row)) for scan, row in t.hits) for t in new],
        "counts": [stamp, *((t.track_id, t.scan_count) for t in new), *(t.track_id for t in held)],
        "statistics": dataclasses.asdict(initiator.statistics),
        "state": np.array([t.state for t in new], float).reshape(-1, 4),
        "covariance": np.array([t.covariance for t in new], float).reshape(-1, 16),
        "figures": np.array(numbers, float).reshape(-1, 1),
        "held state": np.array([t.state for t in held], float).reshape(-1, 4),
        "held cov.": np.array([t.covariance for t in held], float).reshape(-1, 16),
    }


def run_scene(seed: int, method: str) -> dict[str, Any]:
    """Run a method on a scene, until an exception, which is part of the result."""
    from tsepm_ros import Scan, SensorModel, make_initiator

    scene, scans, failure = draw_scene(seed), [], ""
    options = scene["common"] | draw_options(method, seed)
    initiator = make_initiator(method, sensor=SensorModel(**scene["sensor"]), **options)
    try:
        for scan in scene["scans"]:
            scans.append(output(initiator, scan["stamp"], initiator.process(Scan(**scan))))
    except Exception as error:
        failure = repr(error)
    return {"row": method, "about": f"{scene['name']} {failure}", "scans": scans}


def run_change(seed: int) -> dict[str, Any]:
    """Run a session whose options or method change halfway."""
    from tsepm_ros import Scan

    learns, other = seed % 4 >= 2, seed % 2
    scene = draw_scene(1000 + seed, **CALM, learn_density=learns, learn_detection=learns)
    methods = [list(OPTIONS)[(seed // 4 + turn * other) % len(OPTIONS)] for turn in (0, 1)]

    def settings(turn: int) -> Any:
        own = draw_options(methods[turn], seed, turn)
        values = scene["common"] | {f"sensor.{name}": v for name, v in scene["sensor"].items()}
        values |= {f"{methods[turn]}.{name}": value for name, value in own.items()}
        values |= {"method": methods[turn], "max_speed": 10.0 + turn}
        return locate("settings_from")(locate("make_groups")(locate("TRACK_INITIATOR"), values))

    session, scans, half = locate("Session")(settings(0)), [], len(scene["scans"]) // 2
    for index, scan in enumerate(scene["scans"]):
        if index == half:
            session.configure(settings(1))
        values = {name: scan[name] for name in scan if not name.startswith("sensor_")}
        session.add_scan(locate("SensorScan")(Scan(**values), "sonar"), 0.0)
        tracker = session.tracker if hasattr(session, "tracker") else session.initiator
        scans += [output(tracker, result.stamp, result.new) for result in session.process()]
    row = f"{'method' if other else 'options'} changed{', learning' * learns}"
    return {"row": row, "about": f"{' to '.join(methods)}, {scene['name']}", "scans": scans}


def results(scenes: int) -> Iterator[dict[str, Any]]:
    """Iterate over the runs of all methods on all scenes, and the runs with changes."""
    for seed in range(scenes):
        yield from (run_scene(seed, method) for method in OPTIONS)
    yield from (run_change(seed) for seed in range(scenes // 4))


def answer_times() -> None:
    """Take scans on standard input and answer with the processor time of each, s."""
    from tsepm_ros import Scan, SensorModel, make_initiator

    method, sensor, options = pickle.load(sys.stdin.buffer)
    common = {field.name for field in dataclasses.fields(locate("CommonOptions"))}
    options = {name: value for name, value in options.items() if name in common}
    initiator = make_initiator(method, sensor=SensorModel(**sensor), **options)
    while (keywords := pickle.load(sys.stdin.buffer)) is not None:
        scan, begin = Scan(**keywords), time.process_time()
        initiator.process(scan)
        print(time.process_time() - begin, flush=True)


def main() -> None:
    """Run by arguments: scenes FILE NUMBER, time, bag FOLDER, or command MODULE FUNCTION ..."""
    side = Path(os.environ["PYTHONPATH"]).resolve()
    assert Path(importlib.import_module("tsepm_ros").__path__[0]).resolve().parent == side
    kind, *rest = sys.argv[1:]
    if kind == "time":
        answer_times()
    elif kind == "bag":  # of a turning sonar, by the simulator and the tests' writer
        [helpers] = side.glob("test/**/bag_files.py")
        sys.path.insert(0, str(helpers.parent))
        bags = importlib.import_module("bag_files")
        bags.write_bag(Path(rest[0]), bags.simulated(bags.small_scenario(scans=40)))
    elif kind == "command":  # the console script, without pictures, which take long
        sys.modules["matplotlib"] = None  # type: ignore[assignment]
        module, function, *sys.argv[1:] = rest
        sys.exit(getattr(importlib.import_module(module), function)())
    else:
        with Path(rest[0]).open("wb") as file:
            for result in results(int(rest[1])):
                pickle.dump(result, file)


if __name__ == "__main__":
    main()
