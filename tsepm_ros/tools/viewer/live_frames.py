"""Frames from the messages of live topics, gathered by stamp, and their way to the server.

Nothing here needs rclpy.
"""

from __future__ import annotations

import math
import time
from collections import OrderedDict, deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from msg_adapters import (
    MessageError,
    ns_to_seconds,
    read_fields,
    read_own_ship,
    read_track_cloud,
    time_to_ns,
)
from msg_adapters.track_messages import STATE_FIELDS, TRACK_DTYPE, track_arrays
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.own_ship.pose_history import PoseSample
from tsepm_ros.own_ship.registration import exchanged, stated_axes
from tsepm_ros.session.drop_reasons import shortened
from tsepm_ros.settings.node_options import ViewerNodeOptions
from tsepm_ros.tools.viewer.page_frames import (
    Frame,
    encode,
    geographic_terms,
    health_of_message,
    image_frame,
    make_frame,
    own_ship_history,
    own_ship_velocity,
    track_facts,
)
from tsepm_ros.tools.viewer.page_state import PageState
from tsepm_ros.tracker.tracks import NO_TRACKS, TrackArrays

if TYPE_CHECKING:
    from tsepm_ros.tools.viewer.page_server import PageServer


DETECTIONS, NEW, TRACKS = "detections/placed", "tracks", "tracks/current"
POTENTIAL, FIXED = "potential_tracks", "fixed_echoes"
OWN_SHIP, DIAGNOSTICS, IMAGE = "own_ship/odometry", "/diagnostics", "image/plan"
"""The topics that are watched, named as in the track initiator."""

CLOUDS = (NEW, DETECTIONS, TRACKS, POTENTIAL, FIXED)
ATTRIBUTES = {NEW: "new", TRACKS: "tracks", POTENTIAL: "potential"}
"""Attributes of `ScanMessages` by topic."""

MAX_PENDING = 16
"""Scans that wait to be drawn, and scans whose messages may still arrive late."""

MAX_HEADING_VARIANCE = 10.0
"""A heading with a larger variance, rad^2, is unknown: sources write large numbers for that."""

MAX_OWN_SHIP_AGE = 5.0
"""Age of own ship's newest message, s, up to which closest approaches are shown."""

MIN_CELL = 1e-3
"""Smallest accuracy of potential tracks' positions, m."""


@dataclass
class ScanMessages:
    """The messages of one scan.

    Attributes
    ----------
    stamp_ns : int
    number : int
        Number of the frame.
    restart : bool
        Whether its stamp goes back.
    clouds : dict of str to message
        Messages that have not been read, by topic.
    frame_id : str
        The fixed frame; empty before a message was read.
    detections : (n, 2) ndarray
    new, tracks, potential, fixed : TrackArrays
    """

    stamp_ns: int
    number: int
    restart: bool
    clouds: dict[str, Any] = field(default_factory=dict)
    frame_id: str = ""
    detections: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))
    new: TrackArrays = NO_TRACKS
    tracks: TrackArrays = NO_TRACKS
    potential: TrackArrays = NO_TRACKS

    @property
    def stamp(self) -> float:
        """The scan's stamp, s."""
        return ns_to_seconds(self.stamp_ns)


class LiveFrames:
    """Gathers the messages of each scan to a frame.

    Messages belong together by their stamps. A stamp that goes back on its own topic is a restart
    of the source. Fixed echoes are shown until the next message of them.

    Parameters
    ----------
    report : callable
        Called with the topic and the error for a message that cannot be read.
    """

    def __init__(self, report: Callable[[str, MessageError], None]) -> None:
        self._report = report
        self._pending: OrderedDict[int, ScanMessages] = OrderedDict()
        self._recent: OrderedDict[int, ScanMessages] = OrderedDict()
        self._newest: dict[str, int] = {}  # stamp by topic, ns
        self._number = 0
        self._fixed: tuple[str, TrackArrays] = "", NO_TRACKS
        self._own_ship: PoseSample | None = None
        self._poses = own_ship_history()
        self._known: set[int] = set()

    def take(self, topic: str, cloud: Any) -> None:
        """Take a message of one of the CLOUDS; a message that is too late is left out."""
        stamp_ns = time_to_ns(cloud.header.stamp)
        restart = stamp_ns < self._newest.get(topic, stamp_ns)
        if restart:
            self._start_over()
        last = max(self._newest.values(), default=stamp_ns)
        self._newest[topic] = stamp_ns
        scan = self._recent.get(stamp_ns)
        if scan is None and stamp_ns >= last:
            self._number += 1
            scan = self._recent[stamp_ns] = ScanMessages(stamp_ns, self._number, restart)
        if scan is None or (stamp_ns < last and stamp_ns not in self._pending):
            return
        scan.clouds[topic] = cloud
        self._pending[stamp_ns] = scan
        for kept in (self._pending, self._recent):
            while len(kept) > MAX_PENDING:
                kept.popitem(last=False)

    def take_own_ship(self, message: Any) -> None:
        """Take the own ship's odometry."""
        try:
            self._own_ship = read_own_ship(message)
            self._poses.add(self._own_ship)
        except MessageError as error:
            self._report(OWN_SHIP, error)

    def take_frames(self) -> list[tuple[Frame, dict[str, Frame]]]:
        """Make the frames of the scans with new messages, each with its new tracks' facts."""
        pending, self._pending = self._pending, OrderedDict()
        return [self._frame(scan) for scan in pending.values()]

    def _start_over(self) -> None:
        self._pending.clear()
        self._recent.clear()
        self._newest.clear()
        self._poses.clear()
        self._fixed = "", NO_TRACKS

    def _frame(self, scan: ScanMessages) -> tuple[Frame, dict[str, Frame]]:
        for topic, cloud in scan.clouds.items():
            try:
                self._read(scan, topic, cloud)
            except MessageError as error:
                self._report(topic, error)
        facts = self._new_facts(scan, TRACKS in scan.clouds)
        scan.clouds.clear()
        fixed_frame, fixed = self._fixed
        frame = make_frame(
            scan.stamp,
            scan.frame_id,
            detections=scan.detections,
            tracks=scan.tracks,
            potential=scan.potential,
            fixed=fixed if fixed_frame == scan.frame_id else (),
            own_ship=self._pose(scan),
            restart=scan.restart,
        )
        frame["number"] = scan.number
        return frame, facts

    def _read(self, scan: ScanMessages, topic: str, cloud: Any) -> None:
        scan.frame_id = cloud.header.frame_id.lstrip("/")
        if not cloud.width * cloud.height:
            if topic == FIXED:
                self._fixed = scan.frame_id, NO_TRACKS
            return
        if topic == DETECTIONS:
            position = read_fields(cloud, ("position_x", "position_y"))
            scan.detections = np.stack([position["position_x"], position["position_y"]], axis=1)
            if stated_axes(scan.frame_id) == "down":
                scan.detections = scan.detections[:, ::-1]
            return
        read = _potential if topic == POTENTIAL else _tracks
        tracks = exchanged(read(cloud, scan.stamp), scan.frame_id)
        if topic == FIXED:
            self._fixed = scan.frame_id, tracks
        else:
            setattr(scan, ATTRIBUTES[topic], tracks)

    def _new_facts(self, scan: ScanMessages, complete: bool) -> dict[str, Frame]:
        """Facts of the tracks that are confirmed by a scan or seen for the first time.

        `complete`: whether the held tracks have arrived, so that others are forgotten.
        """
        new_ids, ids = scan.new.track_id.tolist(), scan.tracks.track_id.tolist()
        first_seen = [row for row, key in enumerate(ids) if key not in self._known]
        facts = track_facts(scan.tracks.where(np.array(first_seen, int)), None)
        facts.update(track_facts(scan.new, scan.stamp))
        self._known = {*ids, *new_ids} if complete else self._known.union(new_ids)
        return facts

    def _pose(self, scan: ScanMessages) -> list[float] | None:
        """Own ship at the scan's stamp, or as in its newest message without a velocity."""
        pose = self._own_ship
        if pose is None or pose.frame_id != scan.frame_id:
            return None
        known = pose.covariance is None or pose.covariance[2, 2] < MAX_HEADING_VARIANCE
        elapsed = scan.stamp - pose.stamp
        fresh = elapsed <= MAX_OWN_SHIP_AGE
        vx, vy = own_ship_velocity(self._poses, scan.stamp) if fresh else (math.nan, math.nan)
        moved = np.nan_to_num(elapsed * np.array([vx, vy]))
        return [pose.x + moved[0], pose.y + moved[1], pose.yaw if known else math.nan, vx, vy]


def _tracks(cloud: Any, stamp: float) -> TrackArrays:
    return track_arrays(read_track_cloud(cloud), stamp)


def _potential(cloud: Any, stamp: float) -> TrackArrays:
    """Read potential tracks, without what the page does not show.

    The message has no hits. Hypotheses in the same place, to the accuracy of their positions, are
    taken for those of one newest detection, which is then their only hit.
    """
    names = (*STATE_FIELDS, "cov_00", "cov_22", "evaluation", "score")
    values = read_fields(cloud, names)
    records = np.zeros(len(values["score"]), TRACK_DTYPE)
    for name in names:
        records[name] = values[name]
    tracks = track_arrays(records, stamp)
    variance = np.nan_to_num(values["cov_00"] + values["cov_22"], posinf=0.0)
    side = 2.0 * np.sqrt(max(float(np.median(variance)), MIN_CELL**2))
    with np.errstate(invalid="ignore"):
        cells = np.nan_to_num(np.floor(tracks.state[:, 0::2] / side))
    _, place = np.unique(cells[:, 0] + 1j * cells[:, 1], return_inverse=True)
    return replace(tracks, hits=[((0, index),) for index in place.tolist()])


GATHERING_TIME = 0.015
"""Time for the messages of a scan to arrive before the scan is drawn, s."""
IMAGE_TIME, MAX_IMAGE = 3.0, 1 << 16
"""Time for which images are received after a browser asked for one, s; and their most bytes."""
MAX_WAITING = 500
"""Messages that wait for the server's thread."""


def make_server(
    options: ViewerNodeOptions,
    title: str,
    state: PageState | None = None,
) -> PageServer:
    """Make a `PageServer`, see there.

    Raises
    ------
    ValueError
        If its library is not installed, or it cannot be bound.
    """
    try:
        from tsepm_ros.tools.viewer.page_server import PageServer
    except ImportError:
        raise ValueError(
            "the page needs the library tornado: pip install tornado, the extra viewer, or the "
            "package python3-tornado"
        ) from None
    return PageServer(options, title, state)


class LiveFeed:
    """Takes messages in one thread, and shows them in the server's.

    Parameters
    ----------
    options : ViewerNodeOptions
    title : str
    topic : str
        Topic of the held tracks, for a page that waits for it.
    report : callable
        Called with a sentence for a message that cannot be read, in the server's thread.
    read_own_ship : callable, optional
        Makes a message of what is received on OWN_SHIP; only the newest is read.

    Raises
    ------
    ValueError
        As in `make_server` and `geographic_terms`.
    """

    def __init__(
        self,
        options: ViewerNodeOptions,
        title: str,
        topic: str,
        report: Callable[[str], None],
        read_own_ship: Callable[[Any], Any] = lambda message: message,
    ) -> None:
        self._report = report
        self._read_own_ship = read_own_ship
        self._frames = LiveFrames(self._report_error)
        self._state = PageState(
            {"kind": "live", "title": title, "topic": topic, **geographic_terms(options.origin)},
            options.kept_scans,
        )
        self._waiting: deque[tuple[str, Any]] = deque(maxlen=MAX_WAITING)
        self._own_ship: Any = None
        self._scheduled = False
        self._published: bool | None = None
        self.server = make_server(options, title, self._state)
        self.server.start()

    def take(self, topic: str, message: Any) -> None:
        """Take a message; `topic` is one of those of `tsepm_ros.tools.viewer.live_frames`."""
        if topic == OWN_SHIP:
            self._own_ship = message  # waits for the next scan
            return
        self._waiting.append((topic, message))
        if not self._scheduled:
            self._scheduled = True
            self.server.call_later(GATHERING_TIME, self._show)

    @property
    def shows_image(self) -> bool:
        """Whether a browser shows sonar images."""
        return time.monotonic() - self._state.image_asked < IMAGE_TIME

    def take_image(self, message: Any) -> None:
        """Take a sonar image, nav_msgs/OccupancyGrid in the plane of the sensor."""
        stamp, levels = ns_to_seconds(time_to_ns(message.header.stamp)), bytes(message.data)
        if len(levels) <= MAX_IMAGE:
            self._state.image = encode(image_frame(stamp, message.info.resolution, levels))

    def published(self, known: bool) -> None:
        """Say whether anything publishes held tracks, for a page that waits for them."""
        if known != self._published:
            self._published = known
            self._state.put_info(published=known)

    def watching(self, topic: str) -> None:
        """Say which topic of held tracks is shown."""
        self._state.put_info(title=f"Tracks on {topic}", topic=topic)

    def _show(self) -> None:
        """Read what has arrived, in the server's thread."""
        self._scheduled = False
        while self._waiting:
            topic, message = self._waiting.popleft()
            if topic != DIAGNOSTICS:
                self._frames.take(topic, message)
            elif (health := health_of_message(message)) is not None:
                self._state.put_health(health)
        own_ship, self._own_ship = self._own_ship, None
        if own_ship is not None:
            self._frames.take_own_ship(self._read_own_ship(own_ship))
        for frame, facts in self._frames.take_frames():
            self._state.put(frame, facts)

    def _report_error(self, topic: str, error: MessageError) -> None:
        self._report(shortened(f"a message on {topic} cannot be shown: {error}"))
