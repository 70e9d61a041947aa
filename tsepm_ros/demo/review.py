"""Evaluation and picture of a recorded run.

The track messages do not contain the hits. The recorded messages are therefore processed offline
by the same algorithm. The review checks that both give the same tracks, bit for bit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from msg_adapters import time_to_ns, track_states
from tsepm_ros.analysis.simulated_run import judge_starts
from tsepm_ros.analysis.text_tables import text_table
from tsepm_ros.analysis.truth import Judged, Outcome, origins_of
from tsepm_ros.demo.topic_collector import TopicCollector
from tsepm_ros.kinematics.track import ConfirmedTrack
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.pictures.plan_position import PlanPicture
from tsepm_ros.pictures.run_scene import position_at, truth_paths
from tsepm_ros.replay.message_input import MessageInput
from tsepm_ros.replay.recording import Recording
from tsepm_ros.sensing.conversion import convert
from tsepm_ros.session.result import ScanResult
from tsepm_ros.session.session import Session
from tsepm_ros.settings.node_options import InitiatorNodeOptions
from tsepm_ros.settings.tables import TRACK_INITIATOR, make_groups, settings_from
from tsepm_ros.settings.value_text import parse_values
from tsepm_ros.simulation import Scenario, Simulator


@dataclass
class Review:
    """Tables, lines and picture of a run.

    Attributes
    ----------
    table : str
    lines : list of str
    picture : PlanPicture
    insets : list of (2,) ndarray
        Points to enlarge.
    failure : str
        Reason of the failure; empty if the run succeeded.
    """

    table: str
    picture: PlanPicture
    lines: list[str] = field(default_factory=list)
    insets: list[FloatArray] = field(default_factory=list)
    failure: str = ""


def replay(
    collector: TopicCollector, parameters: Sequence[str]
) -> tuple[list[ScanResult], Session]:
    """Process the recorded messages offline.

    Raises
    ------
    ValueError
        If a parameter is unknown or its value is not allowed.
    """
    values = {"own_ship_source": "odometry", **parse_values(parameters)}
    groups = make_groups(TRACK_INITIATOR, values)
    session = Session(settings_from(groups))
    message_input = MessageInput(session, groups[InitiatorNodeOptions])
    for message in collector.own_ship:
        message_input.take_own_ship(message)
    results: list[ScanResult] = []
    for message in sorted(collector.detections, key=lambda m: time_to_ns(m.header.stamp)):
        message_input.take_detections(message, now=0.0)
        results.extend(session.process())
    return results, session


def review_simulation(
    collector: TopicCollector, scenario: Scenario, seed: int, parameters: Sequence[str]
) -> Review:
    """Evaluate a simulated run against its truth."""
    results, session = replay(collector, parameters)
    simulator = Simulator(scenario, seed)
    scans = list(simulator)
    tracks = [track for result in results for track in result.new]
    processed = [result.stamp for result in results]
    stamps = [simulated.scan.stamp for simulated in scans]
    origins = origins_of(processed, stamps, [simulated.origin for simulated in scans])
    judged = judge_starts(simulator, tracks, origins)
    starts = {
        judgement.target: judgement.track
        for judgement in judged
        if judgement.outcome is Outcome.TRUE
    }
    number = len(simulator.targets)
    scan_of = {result.stamp: index + 1 for index, result in enumerate(results)}
    times = np.linspace(0.0, scenario.duration, 2)
    on_target = [
        judgement.track
        for judgement in judged
        if judgement.outcome in (Outcome.TRUE, Outcome.REDUNDANT)
    ]
    review = Review(
        table=target_table(judged, simulator, scan_of),
        picture=PlanPicture(
            title=f"{scenario.name}, seed {seed}, method {session.settings.session.method}",
            detections=_positions(results, session),
            truth=[
                np.array([simulator.truth(time)[target][0::2] for time in times])
                for target in range(number)
            ],
            on_target=list(starts.values()),
            off_target=[
                judgement.track for judgement in judged if judgement.outcome is not Outcome.TRUE
            ],
            off_target_label="false, misplaced and redundant starts",
        ),
        lines=[
            counts_line(judged, scenario.scans, scenario.area),
            _timing(results),
            f"{len(on_target)} starts on {len(starts)} of {number} targets",
        ],
        insets=[simulator.truth(scenario.duration / 2)[target][0::2] for target in range(number)],
    )
    if not _same_as_node(collector, tracks):
        review.failure = "the node's tracks differ from the same messages processed offline"
    elif len(starts) < number:
        review.failure = f"{number - len(starts)} of {number} targets were not truly started"
    return review


def review_recording(
    collector: TopicCollector, recording: Recording, parameters: Sequence[str], tolerance: float
) -> Review:
    """Evaluate a recorded run by the distance of its starts from the recorded targets."""
    results, session = replay(collector, parameters)
    tracks = [track for result in results for track in result.new]
    shift = results[0].stamp - recording.scans[0].time if results else 0.0
    truth = truth_paths(recording.targets)
    distances = [_distance(track, truth, shift) for track in tracks]
    near = [track for track, d in zip(tracks, distances, strict=True) if d <= tolerance]
    far = [track for track, d in zip(tracks, distances, strict=True) if d > tolerance]
    scan_of = {result.stamp: index + 1 for index, result in enumerate(results)}
    rows = [
        [
            str(scan_of[track.stamp]),
            f"{track.stamp:.1f}",
            f"{distance:.0f}",
            f"{np.sqrt(np.trace(track.position_covariance)):.0f}",
            f"{np.hypot(*track.velocity):.1f}",
        ]
        for track, distance in zip(tracks, distances, strict=True)
        if distance <= tolerance
    ]
    header = ["scan", "time [s]", "distance [m]", "sigma [m]", "speed [m/s]"]
    own_ship = np.array(
        [
            (*motion.state[0::2], math.nan if motion.yaw is None else motion.yaw)
            for motion in recording.own_ship
        ]
    ).reshape(-1, 3)
    review = Review(
        table=f"starts within {tolerance:g} m of a target\n" + text_table(header, rows),
        picture=PlanPicture(
            title=f"recording, method {session.settings.session.method}",
            detections=_positions(results, session),
            truth=[path[:, 1:] for path in truth],
            on_target=near,
            off_target=far,
            own_ship=own_ship,
            velocity_seconds=20.0,
            on_target_label=f"starts within {tolerance:g} m of a target",
            off_target_label="starts elsewhere",
        ),
        lines=[
            f"{len(near)} starts on a target, {len(far)} elsewhere, in {len(results)} scans",
            _timing(results),
        ],
    )
    if not _same_as_node(collector, tracks):
        review.failure = "the node's tracks differ from the same messages processed offline"
    elif recording.targets and not near:
        review.failure = "no recorded target was started"
    return review


def _positions(results: Sequence[ScanResult], session: Session) -> list[FloatArray]:
    sensor = session.settings.sensor
    return [convert(result.scan, sensor, 0)["position"] for result in results]


def _timing(results: Sequence[ScanResult]) -> str:
    times = 1e3 * np.array([result.core_seconds for result in results] or [np.nan])
    return (
        "core, the same messages offline: time per scan "
        f"median {np.median(times):.2f} ms, worst {times.max():.2f} ms"
    )


def _same_as_node(collector: TopicCollector, tracks: Sequence[ConfirmedTrack]) -> bool:
    if len(collector.tracks) != len(tracks):
        return False
    records = np.array([record for _, record in collector.tracks])
    if not len(records):
        return True
    return bool((track_states(records) == np.array([track.state for track in tracks])).all())


def _distance(track: ConfirmedTrack, truth: Sequence[FloatArray], shift: float) -> float:
    """Distance from the nearest recorded target at the track's time, m; infinite if none."""
    positions = (position_at(path, track.stamp - shift) for path in truth)
    return min(
        (
            float(np.hypot(*(track.position - position)))
            for position in positions
            if position is not None
        ),
        default=math.inf,
    )


def target_table(judged: Sequence[Judged], simulator: Simulator, scan_of: dict[float, int]) -> str:
    """Table of each target's first true start against the truth.

    Parameters
    ----------
    judged : sequence of Judged
        The run's tracks.
    simulator : Simulator
    scan_of : dict of float to int
        Number of the scan, from 1, by its stamp.
    """
    starts = {
        judgement.target: judgement for judgement in judged if judgement.outcome is Outcome.TRUE
    }
    rows = [
        _target_row(target, starts.get(target), simulator, scan_of)
        for target in range(len(simulator.targets))
    ]
    header = ["target", "scan", "truth x, y [m]", "start x, y", "error (sigma)", "truth v [m/s]"]
    return text_table([*header, "start v", "error (sigma)"], rows)


def _target_row(
    target: int, start: Judged | None, simulator: Simulator, scan_of: dict[float, int]
) -> list[str]:
    if start is None:
        return [str(target), "not started", *[""] * 6]
    truth, state = simulator.truth(start.track.stamp)[target], start.track.state
    sigma = np.sqrt(np.diag(start.track.covariance))
    return [
        str(target),
        str(scan_of[start.track.stamp]),
        f"{truth[0]:.0f}, {truth[2]:.0f}",
        f"{state[0]:.0f}, {state[2]:.0f}",
        f"{start.position_error:.0f} ({np.hypot(sigma[0], sigma[2]):.0f})",
        f"{truth[1]:.1f}, {truth[3]:.1f}",
        f"{state[1]:.1f}, {state[3]:.1f}",
        f"{start.velocity_error:.1f} ({np.hypot(sigma[1], sigma[3]):.1f})",
    ]


def counts_line(judged: Sequence[Judged], scans: int, area: float) -> str:
    """One line that counts the tracks by outcome.

    Parameters
    ----------
    judged : sequence of Judged
    scans : int
    area : float
        Area covered, m^2.
    """
    number = {
        outcome: sum(judgement.outcome is outcome for judgement in judged) for outcome in Outcome
    }
    wrong = number[Outcome.FALSE] + number[Outcome.MISPLACED]
    return (
        f"{len(judged)} confirmed tracks: {number[Outcome.TRUE]} true, "
        f"{number[Outcome.REDUNDANT]} redundant, {number[Outcome.MISPLACED]} misplaced, "
        f"{number[Outcome.FALSE]} false; false and misplaced {wrong / (scans * area / 1e6):.3f} "
        "per scan and km^2"
    )
