"""Running recordings and bags through a session, without ROS."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from msg_adapters import (
    MessageError,
    pose_sample,
    read_detections,
    read_own_ship,
    read_recorded_scan,
    sensor_scan,
    tracker_report,
)
from tsepm_ros.bag import DETECTIONS, OWN_SHIP, TRACKED, Bag
from tsepm_ros.clocks import Now
from tsepm_ros.own_ship import PoseSample
from tsepm_ros.parameter_groups import InitiatorNodeOptions
from tsepm_ros.recording import RecordedMotion, RecordedScan, Recording
from tsepm_ros.session import ScanResult, Session, Settings

FRAME = "recording"
UNKNOWN_YAW_VARIANCE = 1e6
"""Variance of a heading that was not recorded, rad^2."""


def process_recording(
    recording: Recording, settings: Settings, bearing_reference: str
) -> tuple[list[ScanResult], Counter[str]]:
    """Process every scan of a recording.

    Parameters
    ----------
    recording : Recording
    settings : Settings
    bearing_reference : {"bow", "north"}
        What a recorded bearing is measured from, clockwise.

    Returns
    -------
    results : list of ScanResult
    dropped : Counter
        What could not be used, by reason.
    """
    session = Session(settings)
    results = list(recording_results(recording, session, bearing_reference))
    return results, session.dropped


def recording_results(
    recording: Recording, session: Session, bearing_reference: str
) -> Iterator[ScanResult]:
    """Process the scans of a recording one by one, see `process_recording`."""
    motions = deque(recording.own_ship)
    for recorded in recording.scans:
        # As live: what the scan's echoes need has arrived, not what comes long after.
        until = recorded.time + _longest_echo(recorded)
        last = session.own_ship_stamp
        while motions and (last is None or last < until):
            last = motions[0].time
            session.add_own_ship(_pose(motions.popleft()), FRAME)
        detections = read_recorded_scan(recorded, FRAME, bearing_reference=bearing_reference)
        session.dropped.update(detections.dropped)
        session.add_scan(sensor_scan(detections), now=0.0)
        yield from session.process()


class MessageInput:
    """Gives a session the messages that the node `track_initiator` subscribes to, as it does.

    Parameters
    ----------
    session : Session
    options : InitiatorNodeOptions
        How detections are read.

    Attributes
    ----------
    assumptions : set of str
        Sentences that say what was taken to be so because the detections do not say it.
    """

    def __init__(self, session: Session, options: InitiatorNodeOptions) -> None:
        self._session = session
        self._options = options
        self.assumptions: set[str] = set()

    def take(self, role: str, message: Any, now: Now) -> None:
        """Take a message.

        Parameters
        ----------
        role : {"detections", "own_ship/odometry", "tracked"}
            The topic of the node that it belongs to.
        message : ROS message
            Read by its attributes.
        now : float or tuple of float
            When it arrived, s.
        """
        if role == DETECTIONS:
            self._take_detections(message, now)
        elif role == OWN_SHIP:
            self._take_own_ship(message)
        else:
            self._take_tracked(message)

    def _take_detections(self, message: Any, now: Now) -> None:
        try:
            detections = read_detections(
                message,
                bearing_reference=self._options.bearing_reference,
                sound_speed=self._options.sound_speed,
            )
        except MessageError as error:
            self._session.drop(error.reason, f"detections dropped: {error}")
            return
        for reason, number in detections.dropped.items():
            self._session.drop(reason, f"{number} detections dropped: {reason}", number)
        self.assumptions.update(detections.assumptions)
        self._session.add_scan(sensor_scan(detections), now)

    def _take_own_ship(self, message: Any) -> None:
        try:
            sample = read_own_ship(message)
        except MessageError as error:
            self._session.drop("own_ship_invalid", f"own-ship data dropped: {error}")
            return
        self._session.add_own_ship(pose_sample(sample), sample.frame_id, sample.child_frame_id)

    def _take_tracked(self, message: Any) -> None:
        try:
            self._session.add_tracked(tracker_report(message))
        except MessageError as error:
            self._session.drop(f"tracked_{error.reason}", f"tracked targets dropped: {error}")


def bag_results(
    bag: Bag, topics: Mapping[str, str], session: Session, given: MessageInput
) -> Iterator[ScanResult]:
    """Process the messages of a bag in the order in which they were received, as the node does.

    How long a scan waits for own-ship data is judged by the times at which they were received.

    Parameters
    ----------
    bag : Bag
    topics : mapping of str to str
        Topics by role, as of `tsepm_ros.bag.find_topics`.
    session : Session
    given : MessageInput
        Of that session. Messages that are corrupt are dropped and counted.

    Raises
    ------
    ValueError
        If the bag turns out to be damaged.
    """
    roles = {topics[role]: role for role in (DETECTIONS, OWN_SHIP, TRACKED) if role in topics}
    for message in bag.messages(roles):
        now = 1e-9 * message.log_ns
        if session.waiting:  # what has waited too long by now, did so before this message came
            yield from _processed(session, now)
        try:
            content = bag.read(message)
        except MessageError as error:
            session.drop(f"message_{error.reason}", str(error))
            continue
        given.take(roles[message.topic], content, now)
        yield from _processed(session, now)
    yield from _processed(session)


def _processed(session: Session, *now: float) -> Iterator[ScanResult]:
    """Process what can be; a scan at which the algorithm fails is lost, as in the node."""
    try:
        yield from session.process(*now)
    except (ArithmeticError, LookupError, MemoryError, ValueError) as error:
        session.drop("internal_error", f"a scan could not be processed: {error!r}")
        session.initiator.reset()


def _longest_echo(recorded: RecordedScan) -> float:
    """Time from the transmit to the arrival of the last echo, s."""
    offsets = recorded.fields.get("time_offset", np.zeros(0))
    good = offsets[np.isfinite(offsets)]
    return max(2.0 * float(good.max()), 0.0) if len(good) else 0.0


def _pose(motion: RecordedMotion) -> PoseSample:
    x, _, y, _ = motion.state.tolist()
    if motion.yaw is not None:
        return PoseSample(motion.time, x, y, motion.yaw)
    return PoseSample(motion.time, x, y, 0.0, np.diag([0.0, 0.0, UNKNOWN_YAW_VARIANCE]))
