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
"""What is on the page: its files, and the frames that it draws.

A frame is a scan as the page draws it: a JSON object, the same live, replayed and in a file. What a
page shows is kept by its server: bounded, and sent to each browser as what changed.

Numbers are integers, which are quicker to write than decimals: positions and semi-axes in cm,
speeds in mm/s, angles in mrad, times in ms, evidence in percent. The page converts them to SI.

============= ===================================================================================
field         meaning
============= ===================================================================================
``number``    counts the frames of a source from 1
``stamp``     the scan's stamp, s
``frame_id``  the fixed frame of all positions
``own_ship``  x, y, heading (from x, counter-clockwise), vx, vy and age, or null; null: unknown
``detections``  x and y of each detection in turn
``potential`` a row per potential track: x, y, vx, vy, evidence (null: no score)
``tracks``    a row per confirmed track: id, x, y, vx, vy, semi-axes of its 95 % ellipse and the
              angle of the major one, standard deviation of the speed, time since the last
              detection, `TrackStatus`, existence in percent; where own ship is known, the time
              of the closest approach to it, its distance and the standard deviation of that
``fixed``     as ``tracks``, of fixed echoes
``restart``   true if all tracks before it were discarded
``sensors``   of several sensors: the number of each detection's, in their order
``seen``      of several: for each track, a bit of each sensor that sees it, in their order
``arrived``   when a live frame came, ms, of the clock of ``now``
``age``       time from the stamp until then, where both clocks are of one time
============= ===================================================================================

What does not change from scan to scan is said once per track, in its facts, in SI: see
`page_track_facts`; or once, in the info of the source: see `page_geographic_terms` and
`PageRecordedScene`.

Health has the levels, tasks and sentences of the diagnostics.
"""

from __future__ import annotations

import base64
import json
import math
import statistics
from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from msg_adapters.nav_messages import OCCUPIED, read_land
from msg_adapters.track_messages import drawn_candidates, track_ellipses
from tsepm_ros.diagnostics.health import COVERAGE, ENTRIES, QUALITY_OF_SERVICE
from tsepm_ros.diagnostics.health_figures import ORDER, OVERALL, Level
from tsepm_ros.diagnostics.input_health import INPUTS
from tsepm_ros.numerics.arrays import FloatArray, IntArray
from tsepm_ros.own_ship.pose_history import PoseHistory, PoseSample
from tsepm_ros.own_ship.registration import Mounting, registration_axes
from tsepm_ros.session.drop_reasons import DETECTIONS, INITIATION, drop_reason_of
from tsepm_ros.session.inputs import Arrival
from tsepm_ros.session.session import ScanResult
from tsepm_ros.tools.bridge.geographic import GeographicReference
from tsepm_ros.tools.pictures.run_scene import scene_vessel_pose
from tsepm_ros.tools.viewer.alarms import (
    MIN_PATIENCE,
    PATIENCE_INTERVALS,
    closest_approaches,
    finite_tracks,
)
from tsepm_ros.tracker.maintenance.track_maintenance import ENDS
from tsepm_ros.tracker.measurement import convert_measurements
from tsepm_ros.tracker.sensor import SensorModel
from tsepm_ros.tracker.tracker import Tracker
from tsepm_ros.tracker.tracks import ConfirmedTrack, TrackArrays

Frame = dict[str, Any]
"""A frame, or the facts of a track: what `json.dumps` takes."""

PageSensor = tuple[SensorModel, Mounting, float | None]
"""One of several sensors: its model, its mounting, and the yaw of this where headings are known."""

MAX_POTENTIAL = 500
"""Potential tracks of a frame, those nearest to confirmation."""

CENTIMETERS, MILLIMETERS, MILLIRADIANS, MILLISECONDS, PERCENT = 100.0, 1e3, 1e3, 1e3, 100.0
"""Integers of a frame per m, m/s, rad, s and 1."""

_ELLIPSE_UNITS = np.array([CENTIMETERS, CENTIMETERS, MILLIRADIANS])
_APPROACH_UNITS = np.array([MILLISECONDS, CENTIMETERS, CENTIMETERS])
GEOGRAPHIC_ORDER = 5
GEOGRAPHIC_REACH = 200e3
"""Distance from the origin up to which the page has latitudes and longitudes, m."""
GEOGRAPHIC_SHARE = 0.1
"""The same as a share of the distance to the nearer pole: with both, errors are below 1 m."""
_DEGREE = 111e3  # m, of latitude

OWN_SHIP_SAMPLES = 100
"""Poses that are kept: some for each scan, so that they reach back over several."""

_LARGEST = 1e15  # a larger number is drawn nowhere
_SLOWEST = 1e-9  # m/s; slower velocities have no direction
MAX_LAND = 512
"""Cells along a side of the land that the page shows."""


def make_page_frame(
    stamp: float,
    frame_id: str,
    *,
    number: int = 0,
    detections: FloatArray | None = None,
    tracks: Sequence[ConfirmedTrack] = (),
    potential: Sequence[ConfirmedTrack] = (),
    fixed: Sequence[ConfirmedTrack] = (),
    own_ship: Sequence[float] | FloatArray | None = None,
    resting: Sequence[float] | None = None,
    restart: bool = False,
    sensors: Sequence[int] = (),
    seen: Mapping[int, int] = MappingProxyType({}),
) -> Frame:
    """Make the frame of one scan.

    Parameters
    ----------
    stamp : float
        s.
    frame_id : str
        The fixed frame.
    number : int, optional
    detections : (n, 2) ndarray, optional
        Positions in the fixed frame, m. Positions that are not finite are left out.
    tracks, potential, fixed : sequence of ConfirmedTrack, optional
        Confirmed tracks, potential tracks and fixed echoes at the stamp. Tracks with a state that
        is not finite are left out.
    own_ship : (x, y, heading, vx, vy, age), optional
        m, rad, m/s and s; what is nan is unknown.
    resting : (x, y, heading, vx, vy), optional
        Own ship where it does not move and no data of it comes.
    restart : bool, optional
        Whether all earlier tracks were discarded before this scan.
    sensors : sequence of int, optional
        Of several sensors, the number of each detection's.
    seen : mapping of int to int, optional
        Of several sensors, a bit of each that sees a track, by the track's id.

    Returns
    -------
    dict
    """
    rows = page_track_rows(tracks, resting if own_ship is None else own_ship)
    several: Frame = {"seen": [seen.get(row[0], 0) for row in rows]} if seen else {}
    if detections is not None and len(sensors):
        finite = np.isfinite(detections).all(axis=1)
        several["sensors"] = np.array(sensors)[finite].tolist()
    return {
        "number": number,
        "stamp": stamp,
        "frame_id": frame_id,
        "own_ship": _pose(own_ship),
        "detections": _positions(detections),
        "potential": page_potential_rows(potential),
        "tracks": rows,
        "fixed": page_track_rows(fixed),
        **({"restart": True} if restart else {}),
        **several,
    }


def page_track_rows(
    tracks: Sequence[ConfirmedTrack], own_ship: Sequence[float] | FloatArray | None = None
) -> list[list[int]]:
    """Rows of confirmed tracks, see the module's table; with closest approaches to own ship.

    An ellipse of a covariance that is not finite has semi-axes of 0.
    """
    arrays = finite_tracks(tracks)
    approaches = np.zeros((len(arrays), 0))
    if (
        own_ship is not None
        and len(own_ship) >= 5
        and np.isfinite([*own_ship[:2], *own_ship[3:5]]).all()
    ):
        approaches = closest_approaches(arrays, list(own_ship)) * _APPROACH_UNITS
    numbers = np.hstack(
        [
            arrays.track_id[:, None],
            _integers(arrays.state[:, 0::2], CENTIMETERS),
            _integers(arrays.state[:, 1::2], MILLIMETERS),
            _integers(track_ellipses(arrays.covariance[:, 0::2, 0::2]), _ELLIPSE_UNITS),
            _integers(
                page_speed_std(arrays.state[:, 1::2], arrays.covariance[:, 1::2, 1::2]), MILLIMETERS
            ),
            _integers(np.nan_to_num(arrays.time_since_hit)[:, None], MILLISECONDS),
            arrays.status[:, None],
            _integers(np.nan_to_num(arrays.existence_probability, nan=1.0)[:, None], PERCENT),
            _integers(np.nan_to_num(approaches), 1.0),
        ]
    )
    return list(numbers.tolist())


def page_potential_rows(tracks: Sequence[ConfirmedTrack]) -> list[list[int | None]]:
    """Rows of potential tracks, the least likely first, so that the likely ones are drawn on top.

    The evidence is the score relative to the threshold for confirmation, as RViz shows it: see
    `msg_adapters.track_messages.drawn_candidates`.
    """
    arrays = finite_tracks(tracks)
    scored = bool(np.isfinite(arrays.score).any())
    rows, evidence = drawn_candidates(arrays)
    order = np.argsort(evidence, kind="stable")[-MAX_POTENTIAL:]
    state = arrays.state[rows[order]]
    numbers = np.hstack(
        [
            _integers(state[:, 0::2], CENTIMETERS),
            _integers(state[:, 1::2], MILLIMETERS),
            _integers(np.nan_to_num(evidence[order])[:, None], PERCENT),
        ]
    ).tolist()
    return list(numbers) if scored else [[*row[:4], None] for row in numbers]


def page_track_facts(
    tracks: Sequence[ConfirmedTrack],
    confirmed: float | None,
    *,
    reasons: Sequence[str] | None = None,
    hits: Sequence[Sequence[Sequence[float]]] | None = None,
) -> dict[str, Frame]:
    """What the page says of each track besides its row, by its id.

    Parameters
    ----------
    tracks : sequence of ConfirmedTrack
    confirmed : float or None
        Stamp of the confirmation, s; None: unknown, as of tracks older than the viewer.
    reasons : sequence of str, optional
        Reason of each confirmation; by default as far as the tracks themselves say it.
    hits : sequence, optional
        Time (s), x and y (m) of each hit of each track, oldest first; of several its sensor.

    Returns
    -------
    dict
        ``first``: stamp of the first hit, s, or None; ``confirmed``, ``hits``, ``reason``,
        ``revision``. A recording adds ``ended``: stamp, s, and reason.
    """
    arrays = TrackArrays.from_tracks(tracks)
    return {
        str(track.track_id): {
            "first": round(track.stamp - track.age, 3) if math.isfinite(track.age) else None,
            "confirmed": confirmed,
            "hits": list(hits[row]) if hits is not None else [],
            "reason": reasons[row]
            if reasons is not None
            else page_start_reason(track, int(arrays.hit_count[row])),
            "revision": track.revision,
        }
        for row, track in enumerate(arrays)
    }


def page_start_reason(track: ConfirmedTrack, hit_count: int) -> str:
    """Why a track of a message was confirmed, by its counts and figures; empty without hits."""
    if not hit_count:
        return ""
    reason = f"{hit_count} hits in {track.scan_count} pings"
    threshold = track.score - track.evaluation
    if math.isfinite(threshold):
        return f"{reason}; log-likelihood ratio {track.score:.1f}, threshold {threshold:.1f}"
    if math.isfinite(track.evaluation):
        return f"{reason}; evaluation {track.evaluation:.2f}"
    return reason


def encode_page_content(content: object) -> str:
    """Encode as JSON; a number that is not finite is a ValueError."""
    return json.dumps(content, separators=(",", ":"), allow_nan=False)


def page_speed_std(velocity: FloatArray, covariance: FloatArray) -> FloatArray:
    """Standard deviations of speeds.

    Parameters
    ----------
    velocity : (n, 2) ndarray
        m/s.
    covariance : (n, 2, 2) ndarray
        m^2/s^2.

    Returns
    -------
    (n, 1) ndarray
        Standard deviation of the velocity along itself, m/s; 0 where the covariance is not finite.
    """
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    along = velocity / np.maximum(speed, _SLOWEST)[:, None]
    along[speed < _SLOWEST] = np.sqrt(0.5)
    variance = np.einsum("ni,nij,nj->n", along, covariance, along)
    variance = np.where(np.isfinite(variance), np.maximum(variance, 0.0), 0.0)
    return np.asarray(np.sqrt(variance)[:, None], float)


def _integers(values: FloatArray, unit: float | FloatArray) -> IntArray:
    return np.rint(np.clip(values * unit, -_LARGEST, _LARGEST)).astype(np.int64)


def _positions(positions: FloatArray | None) -> list[int]:
    if positions is None:
        return []
    finite = positions[np.isfinite(positions).all(axis=1)]
    return list(_integers(finite, CENTIMETERS).ravel().tolist())


def _pose(pose: Sequence[float] | FloatArray | None) -> list[int | None] | None:
    if pose is None or not all(math.isfinite(value) for value in pose[:2]):
        return None
    position, heading = _integers(np.array(pose[:2]), CENTIMETERS).tolist(), float(pose[2])
    known = math.isfinite(heading)
    speeds, age = np.array(pose[3:5]), pose[5:]
    return [
        *position,
        round(math.remainder(heading, math.tau) * MILLIRADIANS) if known else None,
        *(
            _integers(speeds, MILLIMETERS).tolist()
            if np.isfinite(speeds).all()
            else [None] * len(speeds)
        ),
        *(round(max(one, 0.0) * MILLISECONDS) for one in age),
    ]


def page_own_ship_history() -> PoseHistory:
    """Poses of own ship from which its velocity is known, where its source does not say it."""
    return PoseHistory(min_samples=OWN_SHIP_SAMPLES, min_span=0.0)


def page_own_ship_velocity(poses: PoseHistory, stamp: float) -> list[float]:
    """Velocity at a stamp, m/s: as the source says, or by differences of poses; or nan."""
    return list(poses.rates(np.array([stamp]), stamp)[0, :2].tolist())


def page_geographic_terms(origin: str) -> Frame:
    """Latitude and longitude as polynomials in x and y, for the page, from geodesics.

    Parameters
    ----------
    origin : str
        ``latitude,longitude`` of the fixed frame's origin in degrees, x east and y north; empty:
        not known.

    Returns
    -------
    dict
        ``north``: true; ``geographic``: ``origin`` (degrees), ``reach`` R (m) and ``terms``, rows
        of i, j, a, b: latitude and longitude exceed the origin's by the sums of
        ``a (x / R)^i (y / R)^j`` and ``b (x / R)^i (y / R)^j``. Empty without an origin.

    Raises
    ------
    ValueError
        If it is not a latitude and a longitude, is near a pole, or the library is missing.
    """
    if not origin:
        return {}
    reference = GeographicReference.read(origin)
    origin_degrees = [reference.latitude, reference.longitude]
    to_pole = _DEGREE * (90.0 - abs(reference.latitude))
    reach = min(GEOGRAPHIC_REACH, GEOGRAPHIC_SHARE * to_pole)
    nodes = np.polynomial.chebyshev.chebpts1(2 * GEOGRAPHIC_ORDER)
    east, north = (axis.ravel() for axis in np.meshgrid(nodes, nodes))
    try:
        degrees = reference.geographic(reach * np.stack([east, north], axis=1)) - origin_degrees
    except ImportError:
        raise ValueError(
            "origin needs the library pyproj: pip install pyproj, or the package python3-pyproj"
        ) from None
    degrees[:, 1] = (degrees[:, 1] + 180.0) % 360.0 - 180.0
    orders = range(GEOGRAPHIC_ORDER + 1)
    powers = [(i, j) for i in orders for j in orders if i + j <= GEOGRAPHIC_ORDER]
    basis = np.stack([east**i * north**j for i, j in powers], axis=1)
    factors = np.linalg.lstsq(basis, degrees, rcond=None)[0].tolist()
    terms = [[*power, *pair] for power, pair in zip(powers, factors, strict=True)]
    return {"north": True, "geographic": {"origin": origin_degrees, "reach": reach, "terms": terms}}


def page_health_of_message(message: Any) -> dict[str, Frame]:
    """Read a message of ``/diagnostics``.

    Parameters
    ----------
    message : diagnostic_msgs.msg.DiagnosticArray

    Returns
    -------
    dict
        Health of nodes of this package by name: all entries; `OVERALL` where it is alone.
        ``level``, 0 to 3, is the worst of the ``entries`` with their ``task``, ``level``,
        ``message`` and ``values``.
    """
    found: dict[str, list[dict[str, Any]]] = {}
    for status in message.status:
        node, _, task = status.name.rpartition(": ")
        of_others = node == status.hardware_id and task in (OVERALL, *INPUTS)
        if task.rpartition("/")[2] in ENTRIES or of_others:  # of several sensors NAME/TASK
            level = status.level
            found.setdefault(node, []).append(
                _health_entry(
                    task,
                    Level(level[0] if isinstance(level, bytes) else int(level)),
                    status.message,
                    ((value.key, value.value) for value in status.values),
                )
            )
    return {
        node: _health(node, [one for one in entries if one["task"] != OVERALL] or entries)
        for node, entries in found.items()
    }


def page_topics_of_message(message: Any) -> dict[str, dict[str, str]]:
    """Topics that the track initiators of a message of ``/diagnostics`` use, by node and name."""
    return {
        status.hardware_id: {
            value.key.removeprefix("topics."): value.value
            for value in status.values
            if value.key.startswith("topics.")
        }
        for status in message.status
        if status.name == f"{status.hardware_id}: {QUALITY_OF_SERVICE}"
    }


Notices = tuple[Mapping[str, int], Iterable[str]]
"""Of a run: drops by reason, and other notices."""


def page_health_of_run(
    scans: int,
    dropped: Mapping[str, int],
    notes: Iterable[str],
    of_sensors: Mapping[str, Notices] = MappingProxyType({}),
) -> Frame:
    """Health of a finished run offline: what was dropped and noticed.

    Parameters
    ----------
    scans : int
        Number of processed scans.
    dropped : mapping of str to int
        Drops by reason.
    notes : iterable of str
        Other notices.
    of_sensors : mapping of str to (mapping, iterable), optional
        The same of each of several sensors by its name.
    """
    entries = [_health_entry(INITIATION, Level.OK, f"{scans} scans processed")]
    if not scans:
        entries = [_health_entry(INITIATION, Level.WARN, "no scan was processed")]
    for sensor, (drops, notices) in {"": (dropped, notes), **of_sensors}.items():
        of = f"{sensor}/" * bool(sensor)
        for name, number in sorted(drops.items()):
            reason = drop_reason_of(name)
            lost = f"{number} {reason.lost}{'' if number == 1 else 's'} dropped"
            remedy = f". Remedy: {reason.remedy}" if reason.remedy else ""
            message = f"{lost}: {reason.meaning or name}{remedy}"
            entries.append(_health_entry(of + reason.task, Level.WARN, message))
        entries += [_health_entry(of + DETECTIONS, Level.OK, notice) for notice in notices]
    return _health("", entries)


def _health_entry(
    task: str, level: int, message: str, values: Iterable[tuple[str, str]] = ()
) -> dict[str, Any]:
    pairs = [[key, value] for key, value in values if value]
    return {"task": task, "level": int(level), "message": message, "values": pairs}


def _health(node: str, entries: list[dict[str, Any]]) -> Frame:
    worst = max((entry["level"] for entry in entries), key=ORDER.index)
    return {"node": node, "level": worst, "entries": entries}


def page_image_frame(stamp: float, cell: float, levels: bytes) -> Frame:
    """A sonar image in the plane of the sensor, see `msg_adapters.image_messages.Plan`."""
    return {"stamp": stamp, "cell": cell, "levels": base64.b64encode(levels).decode()}


def land_frame(message: Any) -> Frame | None:
    """Land of a chart for the page, see `msg_adapters.nav_messages.read_land`; None without cells.

    ``frame_id``; ``cell`` (m); ``origin`` (x, y, direction of the rows); ``width``, cells of a row;
    and ``bits``, eight cells in a byte. At most `MAX_LAND` cells along a side: a cell is land if
    any of the chart's cells in it is.
    """
    land, info = read_land(message), message.info
    if land is None:
        return None
    rows = np.asarray(message.data, np.int8).reshape(info.height, info.width) >= OCCUPIED
    if registration_axes(message.header.frame_id) == "down":
        rows = rows.T
    step = math.ceil(max(rows.shape) / MAX_LAND)
    filled = np.pad(rows, [(0, -length % step) for length in rows.shape])
    height, width = (length // step for length in filled.shape)
    cells = filled.reshape(height, step, width, step).any(axis=(1, 3))
    return {
        "frame_id": message.header.frame_id.lstrip("/"),
        "cell": step * land.resolution,
        "origin": land.origin,
        "width": width,
        "bits": base64.b64encode(np.packbits(cells).tobytes()).decode(),
    }


class PageRecordedScene:
    """Collects the results of a run.

    Parameters
    ----------
    title : str
    north : bool
        Whether y of the fixed frame is north.
    truth : sequence of (m, 3) ndarray, optional
        Time (s), x and y (m) of each target.
    mounting_yaw : float or None, optional
        As for `tsepm_ros.tools.pictures.run_scene.scene_vessel_pose`.
    sensor : SensorModel, optional
        Whose sector is drawn.
    origin : str, optional
        As for `page_geographic_terms`, which may raise ValueError.
    sensors : mapping of str to (SensorModel, Mounting, float or None), optional
        Of several, in their order, each with its `mounting_yaw`.
    """

    def __init__(
        self,
        title: str,
        north: bool,
        truth: Sequence[FloatArray] = (),
        mounting_yaw: float | None = 0.0,
        sensor: SensorModel | None = None,
        origin: str = "",
        sensors: Mapping[str, PageSensor] = MappingProxyType({}),
    ) -> None:
        self.title = title
        self._info: Frame = {"kind": "recording", "title": title, "north": north}
        self._info |= page_geographic_terms(origin)
        if sensors:  # each from its own axis, with its place on own ship
            self._info["sensors"] = [
                {
                    "name": name,
                    "sector": [getattr(one, limit) for limit in COVERAGE],
                    "place": [at.x, at.y, at.yaw],
                }
                for name, (one, at, _) in sensors.items()
            ]
        elif sensor is not None:  # ranges, m, and the start and end of the azimuth from the bow
            yaw = mounting_yaw or 0.0
            azimuths = [sensor.azimuth_min + yaw, sensor.azimuth_max + yaw]
            self._info["sector"] = [sensor.min_range, sensor.max_range, *azimuths]
            self._info["mounting_yaw"] = yaw
        self._poses = page_own_ship_history()
        self._truth = [np.round(path, 2).tolist() for path in truth]
        self._mounting_yaw, self._sensors = mounting_yaw, sensors
        self._frames: list[Frame] = []
        self._facts: dict[str, Frame] = {}
        self._scans: dict[int, tuple[float, FloatArray, list[int]]] = {}
        self._heading = math.nan  # as one of several sensors knew it last
        self._stamps: dict[str, list[float]] = {name: [] for name in sensors}

    def __len__(self) -> int:
        """Number of scans."""
        return len(self._frames)

    def add(self, result: ScanResult, initiator: Tracker) -> None:
        """Take the result of a scan, before its initiator processes the next one."""
        detections = convert_measurements(result.scan, initiator.sensor.model, 0)["position"]
        index = initiator.scan_index
        if index <= max(self._scans, default=-1):  # the initiator has started over
            self._scans = {}
        number = [initiator.sensor.number] * bool(self._sensors)
        self._scans[index] = result.stamp, detections, number
        self._stamps.setdefault(result.scan.sensor, []).append(result.stamp)
        bits = initiator.seen_by(result.current).tolist()
        frame = make_page_frame(
            result.stamp,
            result.frame_id,
            number=len(self._frames) + 1,
            detections=detections,
            tracks=result.current,
            potential=initiator.potential_tracks(),
            fixed=result.fixed_echoes,
            own_ship=self._own_ship(result),
            restart=result.arrival is Arrival.RESTART,
            sensors=number * len(detections),
            seen=dict(zip(result.current.track_id.tolist(), bits, strict=True)) if number else {},
        )
        self._frames.append(frame)
        fresh = [
            row
            for row, key in enumerate(result.current.track_id.tolist())
            if str(key) not in self._facts
        ]
        self._facts.update(page_track_facts(result.current.where(np.array(fresh, int)), None))
        for track_id, end in result.ended.items():
            self._facts.get(str(track_id), {})["ended"] = [result.stamp, ENDS[end]]
        self._facts.update(
            page_track_facts(
                result.new,
                result.stamp,
                reasons=[initiator.reason(track) for track in result.new],
                hits=[self._hits(track) for track in result.new],
            )
        )

    def _own_ship(self, result: ScanResult) -> list[float] | None:
        own = (None, None, self._mounting_yaw)
        _, mounting, yaw = self._sensors.get(result.scan.sensor, own)
        pose = scene_vessel_pose(result.scan, yaw)
        if result.arrival is Arrival.RESTART:
            self._poses.clear()
        if pose is None:
            return None
        if mounting is not None:  # own ship is one, wherever its sensors are, and which sees
            pose[2] = self._heading = self._heading if math.isnan(pose[2]) else pose[2]
            sine, cosine = np.nan_to_num([math.sin(pose[2]), math.cos(pose[2])])
            pose[:2] -= np.array([[cosine, -sine], [sine, cosine]]) @ (mounting.x, mounting.y)
        self._poses.add(PoseSample(result.stamp, float(pose[0]), float(pose[1]), 0.0))
        return [*pose.tolist(), *page_own_ship_velocity(self._poses, result.stamp)]

    def document(
        self,
        dropped: Mapping[str, int],
        notes: Iterable[str] = (),
        images: Iterable[Frame] = (),
        of_sensors: Mapping[str, Notices] = MappingProxyType({}),
    ) -> str:
        """The recording, JSON: everything that a page is told, see `PageState.since`, and truth.

        Parameters
        ----------
        dropped : mapping of str to int
            Drops by reason.
        notes : iterable of str, optional
            Other notices of the run.
        images : iterable of dict, optional
            Sonar images, see `page_image_frame`.
        of_sensors : mapping, optional
            As for `page_health_of_run`.
        """
        for sensor in self._info.get("sensors", ()):  # as data is said to be missing live
            stamps = self._stamps[sensor["name"]] or [-math.inf]
            patience = PATIENCE_INTERVALS * statistics.median(np.diff(stamps).tolist() or [0.0])
            sensor["silent_from"] = max(stamps[-1] + max(MIN_PATIENCE, patience), 0.0)
        return encode_page_content(
            {
                "all": True,
                "info": self._info,
                "truth": self._truth,
                "health": [page_health_of_run(len(self._frames), dropped, notes, of_sensors)],
                "facts": self._facts,
                "frames": self._frames,
                "images": list(images),
            }
        )

    def _hits(self, track: ConfirmedTrack) -> list[list[float]]:
        """Time (s), x and y (m) of each hit, as far as it is known; of several, the sensor."""
        hits = []
        for scan_index, detection_index in track.hits:
            stamp, positions, sensor = self._scans.get(scan_index, (0.0, np.zeros((0, 2)), []))
            if detection_index < len(positions):
                hits.append([stamp, *np.round(positions[detection_index], 2).tolist(), *sensor])
        return hits
