"""Compare the outputs of two commits on random scenes, recordings and a bag, or their time.

python benchmarks/compare_commits.py BASE [HEAD] [--tolerance 1e-12] [--time]

HEAD is the working tree if not given. Differences are relative to the norm of BASE's numbers;
tolerance 0 requires equality to the bit. If a side fails in a scene, the scans before are compared
and the side counts as shorter. A failure of HEAD (H) is a difference, a failure of BASE (B) alone
is not.
"""

from __future__ import annotations

import argparse
import csv
import os
import pickle
import re
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from compare_worker import OPTIONS
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

ROOT = Path(__file__).resolve().parents[1]
WORKER = (sys.executable, str(ROOT / "benchmarks" / "compare_worker.py"))
STORE = get_typestore(Stores.ROS2_JAZZY)
FORMATS = {2: "u1", 4: "<u2", 6: "<u4", 7: "<f4", 8: "<f8"}
NUMBERS = ("state", "covariance", "figures", "held state", "held cov.")
COUNTED = ("runs", "tracks", "to the bit", "other hits", "other counts", "B shorter", "H shorter")
NOISE = "sensor.range_std:=15.0 sensor.range_std_fraction:=0.0 max_speed:=15.0"
LEARNING = "clutter_density:=estimated detection_probability:=estimated"
Run = dict[str, Any]


def compare(base: Run, head: Run) -> Counter[str]:
    """Count the differences in one run, and find the largest differences of numbers."""
    pairs = list(zip(base["scans"], head["scans"], strict=False))
    counts = Counter({"runs": 1, "tracks": sum(len(a["hits"]) for a, _ in pairs)})
    counts["other hits"] = any(a["hits"] != b["hits"] for a, b in pairs)
    counts["other counts"] = any(
        a["counts"] != b["counts"]
        or any(b["statistics"].get(k, v) != v for k, v in a["statistics"].items())
        for a, b in pairs
    )
    counts["B shorter"] = len(base["scans"]) < len(head["scans"])
    counts["H shorter"] = len(head["scans"]) < len(base["scans"])
    same = all(a.get("bytes") == b.get("bytes") for a, b in pairs)
    for name in NUMBERS:
        counts[name] = max((_apart(a[name], b[name]) for a, b in pairs), default=0.0)
        same &= all(a[name].tobytes() == b[name].tobytes() for a, b in pairs)
    counts["to the bit"] = same and not counts["other hits"] and not counts["other counts"]
    return counts


def _apart(a: np.ndarray, b: np.ndarray) -> float:
    """Largest difference of rows relative to the first's norm; for figures to at least 1."""
    if a.shape != b.shape:
        return np.inf
    with np.errstate(invalid="ignore"):
        apart = np.linalg.norm(np.where((a == b) | (np.isnan(a) & np.isnan(b)), 0.0, b - a), axis=1)
        size = np.maximum(np.linalg.norm(np.nan_to_num(a), axis=1), float(a.shape[1] == 1))
        ratio = np.where(apart == 0.0, 0.0, apart / np.maximum(size, 1e-300))
    return float(np.nan_to_num(ratio, nan=np.inf).max(initial=0.0))


def report(pairs: Iterable[tuple[Run, Run]], tolerance: float) -> bool:
    """Print a table of comparisons and the differing runs; returns whether all runs agree."""
    table: dict[str, Counter[str]] = {}
    differing, agree = [], True
    for base, head in pairs:
        counts, row = compare(base, head), table.setdefault(base["row"], Counter())
        for name in COUNTED:
            row[name] += counts[name]
        for name in NUMBERS:
            row[name] = max(row[name], counts[name])
        differs = counts["other hits"] or counts["other counts"] or counts["H shorter"]
        differs = differs or max(counts[name] for name in NUMBERS) > tolerance
        differs = differs or not base["scans"] or (tolerance == 0.0 and not counts["to the bit"])
        agree &= not differs
        if differs or counts["B shorter"]:
            kind = "DIFFERS" if differs else "BASE failed"
            abouts = dict.fromkeys((base["about"], head["about"]))  # with the exception, if any
            differing.append(f"{kind}: {base['row']}, {' | '.join(abouts)}")
    print(f"{'':28}" + "".join(f"{name:>13}" for name in (*COUNTED, *NUMBERS)))
    for name, row in table.items():
        cells = [*(str(row[key]) for key in COUNTED), *(f"{row[key]:.1e}" for key in NUMBERS)]
        print(f"{name:28}" + "".join(f"{cell:>13}" for cell in cells))
    print(*differing[:40], f"... {len(differing)} in total" * (len(differing) > 40), sep="\n")
    return agree


class Side:
    """A source tree and the folder in which it runs."""

    def __init__(self, tree: Path, work: Path) -> None:
        self.tree, self.work = tree, work
        threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
        self.environment = {**os.environ, **threads, "PYTHONPATH": str(tree)}
        self.work.mkdir()

    def worker(self, *arguments: object, **options: Any) -> subprocess.CompletedProcess[str]:
        """Run the worker until it ends."""
        command = [*WORKER, *map(str, arguments)]
        return subprocess.run(command, env=self.environment, cwd=self.work, text=True, **options)

    def scenes(self, number: int) -> Path:
        """Run the random scenes; returns the file of their results."""
        self.worker("scenes", self.work / "scenes", number, check=True)
        return self.work / "scenes"

    def run(self, name: str, recording: Path, parameters: str) -> Run:
        """Run the command `tsepm run` on a recording or a bag."""
        setup = (self.tree / "setup.py").read_text(encoding="utf-8")
        [entry] = re.findall(r'"tsepm = ([\w.]+):(\w+)"', setup)
        out = self.work / f"{recording.stem} {name}"
        given = [part for value in parameters.split() for part in ("-p", value)]
        run = ("command", *entry, "run", recording, "--out", out, *given)
        done = self.worker(*run, capture_output=True)
        result = {"row": f"{recording.stem} {name}", "about": parameters, "scans": [], "out": out}
        if done.returncode:
            return result | {"about": done.stderr[-200:]}
        with (out / "tracks.csv").open(encoding="utf-8", newline="") as file:
            table = [row[:-1] for row in csv.reader(file)]  # without the column of sentences
        scans = list(_clouds(out / "tracks.mcap"))
        dropped = sorted(re.findall(r"dropped: (\d+) ", done.stderr))
        scans[-1] |= {"bytes": (*scans[-1]["bytes"], table), "statistics": {"dropped": dropped}}
        return result | {"scans": scans}


def _clouds(path: Path) -> Iterator[Run]:
    """Results of each scan, from the messages on `tracks` and `tracks/current`."""
    with AnyReader([path], default_typestore=STORE) as bag:
        messages = [(link.topic, time, data) for link, time, data in bag.messages()]
    new, held = ([m for m in messages if m[0] == t] for t in ("/tracks", "/tracks/current"))
    for (_, time, data), (_, _, held_data) in zip(new, held, strict=True):
        tracks, current = _points(data), _points(held_data)
        yield {
            "hits": tracks["hit_count"].tolist(),
            "counts": [time, tracks["track_id"].tolist(), current["track_id"].tolist()],
            "statistics": {},
            "figures": _columns(tracks, ("evaluation", "score", "age")).reshape(-1, 1),
            **{"state": _columns(tracks, "state"), "covariance": _columns(tracks, "cov")},
            **{"held state": _columns(current, "state"), "held cov.": _columns(current, "cov")},
            "bytes": (data, held_data),
        }


def _points(data: bytes) -> np.ndarray:
    cloud: Any = STORE.deserialize_cdr(data, "sensor_msgs/msg/PointCloud2")
    layout = [(field.name, FORMATS[field.datatype], field.offset) for field in cloud.fields]
    kind = dict(zip(("names", "formats", "offsets"), zip(*layout, strict=True), strict=True))
    return np.frombuffer(cloud.data.tobytes(), np.dtype(kind | {"itemsize": cloud.point_step}))


def _columns(points: np.ndarray, prefix: str | tuple[str, ...]) -> np.ndarray:
    names = [name for name in points.dtype.names or () if name.startswith(prefix)]
    return np.stack([points[name] for name in names], axis=1)


def runs(sides: list[Side], scenes: int, recordings: Path) -> Iterator[tuple[Run, Run]]:
    """Iterate over all pairs of runs; the two runs of a pair are done at the same time."""
    bag = sides[0].work / "bag"
    sides[0].worker("bag", bag, check=True)
    plan = [(name, bag, f"method:={name} {NOISE} sensor.max_range:=3000.0") for name in OPTIONS]
    folders = sorted(path.parent for path in recordings.rglob("detections.csv"))
    print("\n".join(map(str, folders)) or f"note: no recordings in {recordings}")
    for folder in folders:
        given = f"bearing_reference:=north {NOISE}"
        plan += [(name, folder, f"method:={name} {given}") for name in ("score", "tsepm")]
        plan.append(("learning", folder, f"method:=score {given} {LEARNING}"))
    with ThreadPoolExecutor(2) as pool:
        paths = pool.map(lambda side: side.scenes(scenes), sides)
        with next(paths).open("rb") as base, next(paths).open("rb") as head:
            for _ in range(scenes * len(OPTIONS) + scenes // 4):
                yield pickle.load(base), pickle.load(head)
        for entry in plan:
            base_run, head_run = pool.map(lambda side, entry=entry: side.run(*entry), sides)
            yield base_run, head_run


GIVEN = {"clutter_density": "given", "detection_probability": "given", "plots": "off"}
ESTIMATED = {"clutter_density": "estimated", "detection_probability": "estimated", "plots": "off"}
TIMED = {
    "tsepm, given": ("tsepm", GIVEN),
    "score, given": ("score", GIVEN),
    "score, learned": ("score", ESTIMATED),
    "score, all": ("score", {**ESTIMATED, "plots": "auto", "min_speed": 0.1}),
}
"""Methods and options whose time is compared; a commit without an option goes without it."""
SCENES = {"disc 3.6e-8": 160, "imaging": 160, "disc 1e-6": 60, "disc 5e-6": 30}
"""Scenes and numbers of pings: discs of 9 km with clutter of a density, and an imaging sonar."""
SETTLING = 0.4
"""Part of the pings after which they are compared."""


def time_both(sides: list[Side], repeats: int) -> None:
    """Print the processor time per ping of both sides, ping by ping in turn, and the ratio."""
    print(f"{'method':15} {'scene':12} BASE ms  HEAD ms  BASE / HEAD: median (min .. max)")
    for about, (method, options) in TIMED.items():
        for scene in SCENES:
            pings = [_ping_times(sides, method, options, scene, seed) for seed in range(repeats)]
            ratio = [np.median(times[:, 0] / times[:, 1]) for times in pings]
            base, head = 1e3 * np.median(np.concatenate(pings), axis=0)
            print(f"{about:15} {scene:12} {base:7.3f} {head:8.3f}  {np.median(ratio):.3f} ", end="")
            print(f"({min(ratio):.3f} .. {max(ratio):.3f})", flush=True)


def _sensor(scene: str) -> dict[str, float]:
    if scene == "imaging":
        errors = {"range_std": 0.2, "range_std_fraction": 0.0, "azimuth_std": 0.01}
        return {**errors, "max_range": 100.0, "clutter_density": 5e-4}
    return {"clutter_density": float(scene.split()[1])}


def _pings(scene: str, seed: int) -> Iterator[dict[str, Any]]:
    """Scans of clutter with a target in a disc, or with ten targets, 20 times a second."""
    rng = np.random.default_rng(seed)
    imaging = scene == "imaging"
    reach, period = (100.0, 0.05) if imaging else (9000.0, 12.0)
    place = rng.uniform(-60.0, 60.0, (10, 2)) if imaging else np.array([[3000.0, 2000.0]])
    velocity = rng.uniform(-1.0, 1.0, (10, 2)) if imaging else np.array([[4.0, 0.0]])
    mean = 16.0 if imaging else float(scene.split()[1]) * np.pi * reach**2
    for ping in range(SCENES[scene]):
        n = rng.poisson(mean)
        x, y = (place + period * ping * velocity)[rng.random(len(place)) < 0.9].T
        errors = rng.normal(0.0, (0.2, 0.01), (len(x), 2)).T
        range_ = np.append(reach * np.sqrt(rng.uniform(1e-4, 1.0, n)), np.hypot(x, y) + errors[0])
        azimuth = np.append(rng.uniform(-np.pi, np.pi, n), np.arctan2(y, x) + errors[1])
        yield {"stamp": 1.0 + period * ping, "range": range_, "azimuth": azimuth}


def _ping_times(
    sides: list[Side], method: str, options: dict[str, Any], scene: str, seed: int
) -> np.ndarray:
    """Times of the settled pings, (n, 2), s."""
    streams = dict.fromkeys(("stdin", "stdout"), subprocess.PIPE)
    workers = [
        subprocess.Popen([*WORKER, "time"], env=side.environment, **streams) for side in sides
    ]
    times = np.zeros((SCENES[scene], 2))
    for worker in workers:
        worker.stdin.write(pickle.dumps((method, _sensor(scene), options)))
    for ping, keywords in enumerate(_pings(scene, seed)):
        scan = pickle.dumps(keywords)
        for index in (0, 1) if (ping + seed) % 2 else (1, 0):
            workers[index].stdin.write(scan)
            workers[index].stdin.flush()
            times[ping, index] = float(workers[index].stdout.readline())
    for worker in workers:
        worker.communicate(pickle.dumps(None))
    return times[round(SETTLING * len(times)) :]


def main() -> int:
    """Compare; returns 0 if all runs agree within the tolerance."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("base")
    parser.add_argument("head", nargs="?")
    parser.add_argument("--tolerance", type=float, default=0.0)
    parser.add_argument("--scenes", type=int, default=300)
    parser.add_argument("--recordings", type=Path, help="default: shared/data beside the checkout")
    parser.add_argument("--time", action="store_true", help="compare the time per ping instead")
    parser.add_argument("--repeats", type=int, default=5)
    given, git = parser.parse_args(), ["git", "-C", str(ROOT)]
    common = [*git, "rev-parse", "--path-format=absolute", "--git-common-dir"]
    checkout = Path(
        subprocess.run(common, check=True, capture_output=True, text=True).stdout
    ).parent
    recordings = given.recordings or checkout.parent / "shared" / "data"
    with tempfile.TemporaryDirectory() as folder:
        trees = [Path(folder) / "base", Path(folder) / "head" if given.head else ROOT]
        worktrees = list(zip(trees, [given.base, given.head], strict=True))[: 1 + bool(given.head)]
        try:
            for tree, revision in worktrees:
                subprocess.run([*git, "worktree", "add", "--detach", tree, revision], check=True)
            sides = [Side(tree, Path(folder) / f"work{n}") for n, tree in enumerate(trees)]
            if given.time:
                time_both(sides, given.repeats)
                return 0
            return 0 if report(runs(sides, given.scenes, recordings), given.tolerance) else 1
        finally:
            for tree, _ in worktrees:
                subprocess.run([*git, "worktree", "remove", "--force", tree], check=False)


if __name__ == "__main__":
    sys.exit(main())
