"""Bias of a track's first position without and with the propagation model, from messages.

The simulated sonar models the travel of sound. Its messages, PointCloud2 and Odometry at 5 Hz, pass
through the adapters and a session, as in the node. The echoes have

- no times: each is taken at the stamp;
- `time_offset` in the message;
- no times, with the parameter `sound_speed`;
- no delay, for comparison: sound takes no time, and the remaining bias has other causes.

The bias is that of the position at the stamp of the confirming scan, along and across the line of
sight. The tables also have the standard deviation by the track's covariance. Every run is done
twice, with measurement errors of opposite sign, and the pair's mean counts. If both are confirmed
by the same detections, terms linear in the errors cancel, and a few runs resolve a small bias. With
the errors of a data sheet they seldom are, and the intervals are wide.

    python benchmarks/propagation.py [--pairs 200] [--noise exact data-sheet]
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import msg_adapters as ros
from tsepm_ros import SensorModel
from tsepm_ros.methods.registry import method_class
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.own_ship.pose_history import PoseSample
from tsepm_ros.session.session import Session
from tsepm_ros.settings.node_options import SessionOptions
from tsepm_ros.settings.settings import Settings
from tsepm_ros.tools.evaluation.intervals import mean
from tsepm_ros.tools.simulation import Scenario, Simulator
from tsepm_ros.tools.simulation.scenario import OwnShipMotion
from tsepm_ros.tools.terminal import text_table, with_progress
from tsepm_ros.tracker.options import CommonOptions

SOUND_SPEED = 1500.0
ODOMETRY_RATE = 5.0
AFTER = 20.0
"""Duration of odometry after the last ping, s: longer than any echo."""

NOISES = {
    "exact": SensorModel(range_std=5.0, range_std_fraction=0.0, azimuth_std=math.radians(0.05)),
    "data-sheet": SensorModel(range_std_fraction=0.015, azimuth_std=math.radians(1.0)),
}
SILENT_SEA = SensorModel(
    range_std=1e-6,
    range_std_fraction=0.0,
    azimuth_std=1e-9,
    detection_probability=0.9,
    clutter_density=1e-15,
)
"""The simulated sensor has misses, but no clutter and no errors; errors are added here."""
FAST = (np.array([7600.0, 8.0, 0.0, 0.0]),)
STILL = (np.array([8000.0, 0.0, 0.0, 0.0]),)
TURN = math.radians(2.0)
SCENES = {
    "target 8 m/s outward": (FAST, OwnShipMotion()),
    "ship turns 2 deg/s": (STILL, OwnShipMotion(turn_rate=TURN)),
    "both, ship 4 m/s": (FAST, OwnShipMotion(speed=4.0, turn_rate=TURN)),
}
METHOD_OPTIONS: dict[str, tuple[str, dict[str, Any]]] = {
    "score": ("score", {}),
    "tsepm": ("tsepm", {}),
    "tsepm, polar": ("tsepm", {"estimator": "polar"}),
}
TIMES = ("none", "time_offset", "sound_speed")
AT_ONCE = "no delay"
"""The reference without propagation delay."""


@dataclass(frozen=True)
class Bias:
    """Errors of the first positions of many pairs of runs, (along, across) the line of sight, m."""

    errors: FloatArray  # (n, 2), mean of each pair
    sigma: FloatArray  # (2,), root mean square of the deviations by the covariances


def scenario(scene: str, sound_speed: float) -> Scenario:
    """Scenario of a scene."""
    targets, ship = SCENES[scene]
    return Scenario(scene, 16, 12.0, SILENT_SEA, sound_speed, targets, own_ship=ship)


def odometry(scene: Scenario) -> list[PoseSample]:
    """The ship's odometry for a whole run, through its messages."""
    samples = []
    for index in range(round((scene.duration + AFTER) * ODOMETRY_RATE)):
        time = index / ODOMETRY_RATE
        x, y, yaw = scene.own_ship.pose(time).tolist()
        vx, vy, yaw_rate = scene.own_ship.rates(time).tolist()
        sample = PoseSample(
            time, x, y, yaw, rates=(vx, vy, yaw_rate), frame_id="odom", child_frame_id="sonar"
        )
        samples.append(ros.read_own_ship(ros.odometry_message(sample)))
    return samples


def messages(scene: Scenario, seed: list[int], sensor: SensorModel, sign: float, times: str) -> Any:
    """Every scan's message, with measurement errors of a sign, and the target's state then."""
    errors = sign * np.random.default_rng([*seed, 1]).standard_normal((scene.scans, 2))
    for simulated, (range_error, azimuth_error) in zip(Simulator(scene, seed), errors, strict=True):
        scan = simulated.scan
        range_ = scan.range + range_error * np.sqrt(sensor.range_variance(scan.range))
        timed = times == "time_offset"
        cloud = ros.detections_cloud(
            ros.make_header(ros.seconds_to_ns(scan.stamp), "sonar"),
            range=range_,
            azimuth=scan.azimuth + azimuth_error * sensor.azimuth_std,
            time_offset=range_ / SOUND_SPEED if timed else None,
        )
        yield cloud, simulated.truth[0]


def first_track(
    messages: Iterable[Any],
    scene: Scenario,
    settings: Settings,
    poses: Iterable[PoseSample],
    sound_speed: float,
) -> tuple[FloatArray, FloatArray] | None:
    """Error and variance, (along, across) each, of the target's first track; None without one."""
    session = Session(settings)
    for pose in poses:
        session.add_own_ship(pose)
    for cloud, truth in messages:
        scan = ros.read_detections(cloud, sound_speed=sound_speed).sensor_scan
        session.add_scan(scan, 0.0)
        for result in session.process():
            for track in result.new:
                sight = truth[0::2] - scene.own_ship.pose(track.stamp)[:2]
                along = sight / np.hypot(*sight)
                axes = np.array([along, [-along[1], along[0]]])
                error = axes @ (track.position - truth[0::2])
                variance = np.diag(axes @ track.covariance[0::2, 0::2] @ axes.T)
                return error, variance
    return None


def bias(noise: str, scene: str, method: str, times: str, pairs: int, seed: int = 1) -> Bias:
    """Measure the bias of the first position over seeded pairs of runs, by the names in the tables.

    Pair i is seeded with (seed, i) for all methods and kinds of times.
    """
    simulated = scenario(scene, 0.0 if times == AT_ONCE else SOUND_SPEED)
    name, options = METHOD_OPTIONS[method]
    settings = Settings(
        SessionOptions(method=name, own_ship_source="odometry"),
        NOISES[noise],
        CommonOptions(),
        {name: method_class(name).Options(**options)},
    )
    poses = odometry(simulated)
    speed = SOUND_SPEED if times == "sound_speed" else 0.0
    errors, variances = [], []
    for index in with_progress(range(pairs), pairs, f"{scene}, {method}, {times}", "pair"):
        clouds = (
            messages(simulated, [seed, index], NOISES[noise], sign, times) for sign in (1.0, -1.0)
        )
        plus, minus = (first_track(run, simulated, settings, poses, speed) for run in clouds)
        if plus is not None and minus is not None:
            errors.append((plus[0] + minus[0]) / 2)
            variances += [plus[1], minus[1]]
    return Bias(np.array(errors), np.sqrt(np.mean(variances, axis=0)))


def row(noise: str, scene: str, method: str, times: str, pairs: int) -> list[str]:
    """One line of the table."""
    measured = bias(noise, scene, method, times, pairs)
    cells = [scene, method, times, str(len(measured.errors))]
    for axis in (0, 1):
        error = mean(measured.errors[:, axis])
        half = (error.high - error.low) / 2
        cells += [f"{error.value:.2f} ± {half:.2f}", f"{measured.sigma[axis]:.1f}"]
    return [*cells, f"{np.abs(measured.errors.mean(axis=0) / measured.sigma).max():.3f}"]


HEAD = ["scene", "method", "times", "pairs"]
HEAD += [f"{name} {axis} [m]" for axis in ("along", "across") for name in ("bias", "sigma")]
HEAD += ["worst bias/sigma"]


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description="bias of the first position, from messages")
    parser.add_argument("--pairs", type=int, default=200)
    parser.add_argument("--noise", nargs="+", choices=sorted(NOISES), default=list(NOISES))
    options = parser.parse_args(arguments)
    for noise in options.noise:
        sensor = NOISES[noise]
        print(
            f"{noise}: range error {sensor.range_std:g} m and "
            f"{100 * sensor.range_std_fraction:g} %, azimuth error "
            f"{math.degrees(sensor.azimuth_std):g} degrees; seed 1; 95 % intervals"
        )
        rows = [
            row(noise, scene, method, times, options.pairs)
            for scene in SCENES
            for method in METHOD_OPTIONS
            for times in (AT_ONCE, *TIMES)
        ]
        print(text_table(HEAD, rows), flush=True)


if __name__ == "__main__":
    main()
