"""JIPDA beside the method `score` on recordings with truth.

    python benchmarks/recordings_peers.py FOLDER [FOLDER ...]

The table of `identity.py recordings`, in sum over the folders (CSV files, bearings from north), for
`score` at several rates of false tracks, everything learned, and for joint integrated probabilistic
data association (`contenders/jipda.py`) at several existence probabilities of confirmation, with
the clutter density `--clutter-density` and the targets' acceleration `--acceleration-density`.

The last two columns are differences from the first row: of the delay, over the targets that both
have held, and of the starts elsewhere, over the recordings, with one-sided 95 % bounds. They are
normal ones: for a few targets and recordings they are too narrow rather than too wide.
"""

from __future__ import annotations

import argparse
import dataclasses
import shlex
import sys
from collections.abc import Iterator
from pathlib import Path

import fixed_threads  # noqa: F401  # before numpy
import identity
import numpy as np
from contenders.jipda import Jipda, Parameters, Track, converted

from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.session.result import ScanResult
from tsepm_ros.settings.settings import Settings
from tsepm_ros.tools.evaluation.intervals import Z_90, mean
from tsepm_ros.tools.evaluation.result_files import add_result, write_table
from tsepm_ros.tools.replay.offline import process_recording
from tsepm_ros.tools.replay.recording import Recording, read_recording
from tsepm_ros.tools.terminal import text_table
from tsepm_ros.tracker.options import ScoreOptions
from tsepm_ros.tracker.tracks import ConfirmedTrack, TrackArrays

GATE = 40.0  # m, within which a track is on a target
OWN_ERROR = 6.6  # m in each coordinate, beside those of range and bearing


def fixed_detections(result: ScanResult) -> tuple[FloatArray, FloatArray]:
    """Positions and covariances of a scan's detections in the fixed frame."""
    scan = result.scan
    x, y, yaw = scan.sensor_pose
    assert scan.range_std is not None
    assert scan.azimuth_std is not None
    position, covariance = converted(
        scan.range, scan.azimuth + yaw, scan.range_std, scan.azimuth_std
    )
    return position + np.array([x, y]), covariance


def arrays(tracks: list[Track], stamp: float) -> TrackArrays:
    """Tracks of JIPDA as those of the package."""
    return TrackArrays.of(
        [
            ConfirmedTrack(
                track.track_id, stamp, track.state, track.covariance, tuple(track.hits), np.nan
            )
            for track in tracks
        ]
    )


def watched_jipda(
    recording: Recording, results: list[ScanResult], parameters: Parameters, density: float
) -> identity.Watched:
    """What is seen of the targets with JIPDA on the scans that a session registered."""
    tracker, watched = Jipda(parameters), identity.Watched(GATE)
    for result in results:
        position, covariance = fixed_detections(result)
        new = tracker.process(result.stamp, position, covariance, np.full(len(position), density))
        held = [track for track in tracker.tracks if track.confirmed]
        watched.take(
            result.stamp,
            identity.truth_at(recording, result.stamp),
            arrays(new, result.stamp),
            arrays(held, result.stamp),
        )
    return watched


def watched_score(recording: Recording, results: list[ScanResult]) -> identity.Watched:
    """What is seen of the targets with the package."""
    watched = identity.Watched(GATE)
    for result in results:
        truth = identity.truth_at(recording, result.stamp)
        watched.take(result.stamp, truth, result.new, result.current)
    return watched


def at_rate(rate: float) -> Settings:
    """Settings of `identity`, with another rate of false tracks."""
    options = {"score": ScoreOptions(false_tracks_per_hour=rate)}
    return dataclasses.replace(identity.settings_of("estimated"), methods=options)


def less_first(watched: list[identity.Watched], first: list[identity.Watched]) -> list[str]:
    """Delays and starts elsewhere less those of the first row, pair by pair."""
    delays = [
        delay - of_first.delays[target]
        for one, of_first in zip(watched, first, strict=True)
        for target, delay in one.delays.items()
        if target in of_first.delays
    ]
    elsewhere = [
        len(one.elsewhere) - len(of_first.elsewhere)
        for one, of_first in zip(watched, first, strict=True)
    ]
    return [mean(values, Z_90).text("+.2f") for values in (delays, elsewhere)]


def rows(given: argparse.Namespace) -> Iterator[list[str]]:
    """The rows of the table."""
    recordings = [
        identity.with_errors(read_recording(folder), OWN_ERROR) for folder in given.folders
    ]
    results: list[list[ScanResult]] = []
    first: list[identity.Watched] = []
    for rate in given.rates:
        results = [process_recording(each, at_rate(rate), "north")[0] for each in recordings]
        watched = [watched_score(*pair) for pair in zip(recordings, results, strict=True)]
        first = first or watched
        yield [*identity.row_of(f"score, {rate:g}/h", watched), *less_first(watched, first)]
    for confirm in given.confirm:
        parameters = Parameters(
            detection_probability=0.92,
            max_speed=15.0,
            acceleration_density=given.acceleration_density,
            confirm=confirm,
        )
        watched = [
            watched_jipda(*pair, parameters, given.clutter_density)
            for pair in zip(recordings, results, strict=True)
        ]
        row = identity.row_of(f"JIPDA, existence {confirm:g}", watched)
        yield [*row, *less_first(watched, first)]


def main() -> None:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folders", type=Path, nargs="+")
    parser.add_argument("--rates", type=float, nargs="+", default=[1.0, 10.0, 100.0], help="1/h")
    parser.add_argument("--confirm", type=float, nargs="+", default=[0.999, 0.99, 0.9])
    parser.add_argument("--clutter-density", type=float, default=5e-6, help="of JIPDA, 1/m^2")
    parser.add_argument("--acceleration-density", type=float, default=0.1, help="m^2/s^3")
    add_result(parser)
    given = parser.parse_args()
    header = [*identity.HEADER, "delay less first", "elsewhere less first"]
    table = list(rows(given))
    print(text_table(header, table))
    command = f"python benchmarks/recordings_peers.py {shlex.join(sys.argv[1:])}"
    write_table(given.result, command, (header, table), seed=0, runs=1)


if __name__ == "__main__":
    main()
