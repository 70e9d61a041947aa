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
"""Processing of recordings and bags by a session, without ROS."""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from msg_adapters import MessageError, read_track_cloud, seconds_to_ns, time_to_ns
from msg_adapters.message_input import MessageInput
from msg_adapters.ping import ReadingOptions
from msg_adapters.point_cloud import detections_of_fields
from msg_adapters.sonar_images import ImageInput, detection_fields
from tsepm_ros.detector.image import COVERAGE, ImageCoverage
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.own_ship.pose_history import MIN_SAMPLE_PERIOD
from tsepm_ros.own_ship.registration import UnregisteredScan, registration_axes, registration_echoes
from tsepm_ros.session.session import ScanResult, Session
from tsepm_ros.settings.settings import Settings
from tsepm_ros.tools.replay.bag import DETECTIONS, LAND, OWN_SHIP, TRACKED, TRUTH, Bag
from tsepm_ros.tools.replay.recording import Recording

FRAME = "recording"
Stream = tuple[Recording, Session, ReadingOptions]
"""A recording, the session that processes it, and how it is read."""


def process_recording(
    recording: Recording, settings: Settings, bearing_reference: str, sound_speed: float = 0.0
) -> tuple[list[ScanResult], Counter[str]]:
    """Process every scan of a recording.

    Parameters
    ----------
    recording : Recording
    settings : Settings
    bearing_reference : {"bow", "north"}
        Reference direction of recorded bearings, which are positive clockwise.
    sound_speed : float, optional
        Sound speed, m/s. Detections without times are valid range / sound_speed after the stamp;
        0: at the stamp.

    Returns
    -------
    results : list of ScanResult
    dropped : Counter
        Drops by reason.
    """
    session = Session(settings)
    stream = recording, session, ReadingOptions(bearing_reference, sound_speed)
    return list(offline_recording_results([stream])), session.dropped


def offline_recording_results(streams: Sequence[Stream]) -> Iterator[ScanResult]:
    """Process recordings in the order of their scans' stamps, each by its session.

    Parameters
    ----------
    streams : sequence of Stream
        Of several sensors the sessions share a tracker, see `share_picture`: the results name the
        sensor of each scan.
    """
    poses_left = [deque(recording.own_ship) for recording, _, _ in streams]
    scans = [
        (recorded.time, number, recorded)
        for number, (recording, _, _) in enumerate(streams)
        for recorded in recording.scans
    ]
    for _, number, recorded in sorted(scans, key=lambda scan: scan[0]):
        (_, session, options), poses = streams[number], poses_left[number]
        ping = detections_of_fields(seconds_to_ns(recorded.time), FRAME, recorded.fields, options)
        # As live: the poses up to the scan's last echo have arrived, not much later poses.
        # The extra period ensures that the thinned-out samples reach the last echo.
        until = recorded.time + _longest_echo(ping.sensor_scan) + MIN_SAMPLE_PERIOD
        last = session.own_ship.poses.last_stamp
        while poses and (last is None or last < until):
            session.add_own_ship(replace(poses.popleft(), frame_id=session.fixed_frame or FRAME))
            last = session.own_ship.poses.last_stamp  # one in doubt needs the next
        session.dropped.update(ping.dropped)
        # No clock is recorded: as on one that was right.
        session.add_scan(ping.sensor_scan, now=(recorded.time, math.nan))
        yield from session.process()
    for _, session, _ in streams:
        yield from session.process(last=True)


class BagInput(NamedTuple):
    """The topic of a sensor in a bag, and where its messages go.

    Attributes
    ----------
    topic : str
    session : Session
        Of several sensors they share a picture, see `shared_picture.share_picture`.
    messages : MessageInput
        Input of that session. Corrupt messages are dropped and counted.
    images : ImageInput or None
        Makes the detections, where the topic has images.
    """

    topic: str
    session: Session
    messages: MessageInput
    images: ImageInput | None = None


def offline_bag_results(
    bag: Bag, topics: Mapping[str, str], inputs: Sequence[BagInput]
) -> Iterator[ScanResult]:
    """Process the messages of a bag in the order of reception, as the node does.

    The times of reception determine how long a scan waits for own-ship data.

    Parameters
    ----------
    bag : Bag
    topics : mapping of str to str
        Topics by role, as from `tsepm_ros.tools.replay.bag.find_bag_topics`.
    inputs : sequence of BagInput
        Of each sensor; what is of all goes to the first.

    Raises
    ------
    ValueError
        If the bag is damaged.
    """
    roles = {topics[role]: role for role in (OWN_SHIP, TRACKED, LAND) if role in topics}
    sensors = {one.topic: one for one in inputs}
    picture, of_all = inputs[0].session.picture, inputs[0]
    for message in bag.messages([*sensors, *roles]):
        now = 1e-9 * message.log_ns
        yield from picture.process(now)  # what was due before this message arrived
        _, session, given, images = sensors.get(message.topic, of_all)
        try:
            content = bag.read(message)
        except MessageError as error:
            session.drop(error.reason, str(error))
            continue
        role = roles.get(message.topic, DETECTIONS)
        if role == DETECTIONS and images is not None:
            for ping, scan in images.take(content):
                _follow(session, images.coverage)
                if images.elsewhere:
                    session.end_tracks()
                fields, options = detection_fields(ping, scan), ReadingOptions()
                found = detections_of_fields(ping.stamp_ns, ping.frame_id, fields, options)
                session.add_scan(found.sensor_scan, now)
        elif role == DETECTIONS:
            given.take_detections(content, now)
        elif role == OWN_SHIP:
            given.take_own_ship(content)
            for images in filter(None, (one.images for one in inputs)):
                images.take_own_ship(content)
        elif role == LAND:
            given.take_land(content)
        else:
            given.take_tracked(content)
        yield from picture.process(now)
    yield from picture.process(last=True)


def _follow(session: Session, coverage: ImageCoverage | None) -> None:
    """Give the tracker the coverage of the images, as the node `sonar_detector` does."""
    sensor = session.settings.sensor
    if coverage is None or coverage.agrees([getattr(sensor, name) for name in COVERAGE]):
        return
    try:
        session.configure(replace(session.settings, sensor=replace(sensor, **coverage.values)))
    except ValueError as error:
        session.drop("bad_image", f"the coverage of an image is not used: {error}")


def offline_bag_truth(
    bag: Bag, topics: Mapping[str, str], notes: dict[str, str]
) -> list[FloatArray]:
    """Time (s), x and y (m) of the targets of a bag's ground truth, (m, 3) each.

    Rows that are not finite are left out, and counted in a note.
    """
    paths: dict[int | None, list[tuple[float, ...]]] = {}
    for message in bag.messages([topics[TRUTH]] if TRUTH in topics else []):
        try:
            cloud = bag.read(message)
            points = read_track_cloud(cloud)
            stamp = 1e-9 * time_to_ns(cloud.header.stamp)
        except MessageError:
            continue  # only pictures use the truth
        is_down = registration_axes(cloud.header.frame_id) == "down"
        for point in points:
            place = [float(point[axis]) for axis in ("state_x", "state_y")][:: -1 if is_down else 1]
            target = int(point["track_id"]) if np.isfinite(place).all() else None
            paths.setdefault(target, []).append((stamp, *place))
    if left_out := paths.pop(None, []):
        notes["truth"] = f"{len(left_out)} positions of {topics[TRUTH]} are left out: not finite"
    return [np.array(path) for path in paths.values()]


def _longest_echo(sensor_scan: UnregisteredScan) -> float:
    """Time from the transmit to the arrival of the last usable echo, s."""
    time_offset = sensor_scan.scan.time_offset
    if time_offset is None:
        return 0.0
    return 2.0 * float(time_offset[registration_echoes(sensor_scan)].max(initial=0.0))
