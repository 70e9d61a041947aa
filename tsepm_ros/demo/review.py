"""Evaluation and picture of a recorded run.

The track messages do not contain the hits. The recorded messages are therefore processed offline
by the same algorithm. The review checks that both give the same tracks, bit for bit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from msg_adapters import time_to_ns, track_states
from tsepm_ros.analysis.simulated_run import judge_starts
from tsepm_ros.analysis.text_tables import text_table
from tsepm_ros.analysis.truth import origins_of
from tsepm_ros.demo.target_table import target_table
from tsepm_ros.demo.topic_collector import TopicCollector
from tsepm_ros.kinematics.track import ConfirmedTrack
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.parameters import Value
from tsepm_ros.pictures.run_scene import (
    RunScene,
    ScanView,
    position_at,
    truth_paths,
)
from tsepm_ros.replay.message_input import MessageInput
from tsepm_ros.replay.recording import Recording
from tsepm_ros.session.result import ScanResult
from tsepm_ros.session.session import Session
from tsepm_ros.settings.node_options import InitiatorNodeOptions
from tsepm_ros.settings.tables import TRACK_INITIATOR, make_groups, settings_from
from tsepm_ros.simulation import Scenario, Simulator


@dataclass
class Review:
    """Table and picture of a run.

    Attributes
    ----------
    table : str
    scene : RunScene
        Content of the picture.
    failure : str
        Reason of the failure; empty if the run succeeded.
    """

    table: str
    scene: RunScene
    failure: str = ""


def replay(
    collector: TopicCollector, parameters: Mapping[str, Value]
) -> tuple[list[ScanResult], Session]:
    """Process the recorded messages offline.

    Raises
    ------
    ValueError
        If a parameter is unknown or its value is not allowed.
    """
    groups = make_groups(TRACK_INITIATOR, parameters)
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
    collector: TopicCollector, scenario: Scenario, seed: int, parameters: Mapping[str, Value]
) -> Review:
    """Evaluate a simulated run against its truth."""
    results, session = replay(collector, parameters)
    simulator = Simulator(scenario, seed)
    scans = list(simulator)
    tracks = [track for result in results for track in result.new]
    processed = [result.stamp for result in results]
    stamps = [simulated.scan.stamp for simulated in scans]
    origins = origins_of(processed, stamps, [simulated.origin for simulated in scans])
    scene = _scene(
        f"{scenario.name}, seed {seed}, method {session.settings.session.method}", results, session
    )
    scene.judged = judge_starts(simulator, tracks, origins)
    scene.truth = [
        np.array([(one.scan.stamp, *one.truth[target][0::2]) for one in scans])
        for target in range(len(simulator.targets))
    ]
    review = Review(table=target_table(scene), scene=scene)
    missing = len(simulator.targets) - len(scene.true_starts)
    if not _same_as_node(collector, tracks):
        review.failure = "the node's tracks differ from the same messages processed offline"
    elif missing:
        review.failure = f"{missing} of {len(simulator.targets)} targets were not truly started"
    return review


def review_recording(
    collector: TopicCollector,
    recording: Recording,
    parameters: Mapping[str, Value],
    tolerance: float,
) -> Review:
    """Evaluate a recorded run by the distance of its starts from the recorded targets."""
    results, session = replay(collector, parameters)
    tracks = [track for result in results for track in result.new]
    shift = results[0].stamp - recording.scans[0].time if results else 0.0
    truth = [path + np.array([shift, 0.0, 0.0]) for path in truth_paths(recording.targets)]
    distances = [_distance(track, truth) for track in tracks]
    scene = _scene(f"recording, method {session.settings.session.method}", results, session)
    scene.truth = truth
    scene.elsewhere = {
        track.track_id
        for track, distance in zip(tracks, distances, strict=True)
        if distance > tolerance
    }
    rows = [
        [
            str(track.track_id),
            f"{track.stamp - results[0].stamp:.0f}",
            str(scene.start_scans[track.track_id]),
            f"{distance:.0f}",
            f"{np.sqrt(np.trace(track.position_covariance)):.0f}",
            f"{np.hypot(*track.velocity):.1f}",
        ]
        for track, distance in zip(tracks, distances, strict=True)
        if distance <= tolerance
    ]
    header = ["track", "found after [s]", "pings", "distance [m]", "1 sigma [m]", "speed [m/s]"]
    review = Review(
        table=f"new tracks within {tolerance:g} m of a target\n" + text_table(header, rows),
        scene=scene,
    )
    if not _same_as_node(collector, tracks):
        review.failure = "the node's tracks differ from the same messages processed offline"
    elif recording.targets and not rows:
        review.failure = "no recorded target was started"
    return review


def _scene(title: str, results: Sequence[ScanResult], session: Session) -> RunScene:
    settings = session.settings
    views = [ScanView.of(result, settings.sensor, settings.mounting.yaw) for result in results]
    return RunScene(title, views)


def _same_as_node(collector: TopicCollector, tracks: Sequence[ConfirmedTrack]) -> bool:
    if len(collector.tracks) != len(tracks):
        return False
    records = np.array([record for _, record in collector.tracks])
    if not len(records):
        return True
    return bool((track_states(records) == np.array([track.state for track in tracks])).all())


def _distance(track: ConfirmedTrack, truth: Sequence[FloatArray]) -> float:
    """Distance from the nearest recorded target at the track's time, m; infinite if none."""
    positions = (position_at(path, track.stamp) for path in truth)
    return min(
        (
            float(np.hypot(*(track.position - position)))
            for position in positions
            if position is not None
        ),
        default=math.inf,
    )
