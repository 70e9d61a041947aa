"""Tracks in sensor_msgs/PointCloud2, with state and full covariance.

No standard message has the covariance between position and velocity; this layout has it.

============================== ======== =======================================================
field                          datatype meaning
============================== ======== =======================================================
``x``, ``y``, ``z``            FLOAT32  position, m; z is 0
``track_id``                   UINT32   unique for the life of the node
``state_x`` ... ``state_vy``   FLOAT64  ``[x, vx, y, vy]``, m and m/s, fixed frame, at the stamp
``cov_00`` ... ``cov_33``      FLOAT64  covariance of that state, row by row
``evaluation``, ``score``      FLOAT64  figures of the method; nan if it has none
``hit_count``, ``scan_count``  UINT16   hits, and scans since the first; at most 65535
``age``                        FLOAT64  time since the first hit, s
``stationary_probability``     FLOAT64  that the target stands still; nan where not known
``signal_to_clutter_db``       FLOAT64  strength over that of clutter, dB; nan where not known
``revision``                   UINT16   0 as first published, then the number of its correction
``existence_probability``      FLOAT64  that the target exists; nan where not known
``time_since_hit``             FLOAT64  time since the target was last detected, s
============================== ======== =======================================================
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from msg_adapters.point_cloud import cloud_of, read_fields
from msg_adapters.stamps import MessageError, ns_to_seconds, time_to_ns
from tsepm_ros.own_ship.registration import exchanged
from tsepm_ros.tracker.maintenance.external_tracker import TrackerReport
from tsepm_ros.tracker.tracks import ConfirmedTrack, TrackArrays

if TYPE_CHECKING:
    from sensor_msgs.msg import PointCloud2
    from std_msgs.msg import Header


STATE_FIELDS = ("state_x", "state_vx", "state_y", "state_vy")
COVARIANCE_FIELDS = tuple(f"cov_{row}{column}" for row in range(4) for column in range(4))

TRACK_DTYPE = np.dtype(
    [
        *((name, "<f4") for name in ("x", "y", "z")),
        ("track_id", "<u4"),
        *((name, "<f8") for name in (*STATE_FIELDS, *COVARIANCE_FIELDS, "evaluation", "score")),
        *((name, "<u2") for name in ("hit_count", "scan_count")),
        ("age", "<f8"),
        ("stationary_probability", "<f8"),
        ("signal_to_clutter_db", "<f8"),
        ("revision", "<u2"),
        ("existence_probability", "<f8"),
        ("time_since_hit", "<f8"),
    ],
    align=True,  # each float64 at a multiple of 8; the item size too
)
"""One point of the cloud."""

_BLOCKS_DTYPE = np.dtype(
    [
        ("xyz", "<f4", (3,)),
        ("track_id", "<u4"),
        ("numbers", "<f8", (22,)),
        ("counts", "<u2", (2,)),
        ("age", "<f8"),
        ("stationary_probability", "<f8"),
        ("signal_to_clutter_db", "<f8"),
        ("revision", "<u2"),
        ("existence_probability", "<f8"),
        ("time_since_hit", "<f8"),
    ],
    align=True,
)
"""The same bytes with fields of equal type combined, for assignment of whole blocks."""

OPTIONAL_FIELDS = {
    "stationary_probability": np.nan,
    "signal_to_clutter_db": np.nan,
    "revision": 0,
    "existence_probability": np.nan,
    "time_since_hit": 0.0,
}
"""Fields that clouds of earlier versions lack, and their values then."""

_PLAIN = ("age", *(name for name in OPTIONAL_FIELDS if name != "revision"))
MAX_AGE = 1e9
"""Largest age that is read, s: the square of a larger one could overflow."""
_MAX_COUNT = int(np.iinfo(np.uint16).max)
_MAX_ID = int(np.iinfo(np.uint32).max)


def track_cloud(header: Header, tracks: Sequence[ConfirmedTrack]) -> PointCloud2:
    """Build a cloud of tracks; without tracks it is empty and has all fields.

    Parameters
    ----------
    header : std_msgs.msg.Header
        The fixed frame, and the stamp of every state. Points have no stamps, so predict the tracks
        to this stamp with `ConfirmedTrack.predicted` first.
    tracks : sequence of ConfirmedTrack

    Returns
    -------
    sensor_msgs.msg.PointCloud2

    Raises
    ------
    ValueError
        If a track_id does not fit 32 bits without a sign.
    """
    return cloud_of(header, *track_points(tracks))


def track_points(tracks: Sequence[ConfirmedTrack]) -> tuple[NDArray[Any], bool]:
    """Return the points of tracks as `track_cloud` packs them.

    Parameters
    ----------
    tracks : sequence of ConfirmedTrack

    Returns
    -------
    points : (n,) ndarray of TRACK_DTYPE
        With zero padding.
    is_dense : bool
        Whether every number but those of `OPTIONAL_FIELDS` is finite.

    Raises
    ------
    ValueError
        If a track_id does not fit 32 bits without a sign.
    """
    arrays = TrackArrays.of(tracks)
    bad_ids = arrays.track_id[(arrays.track_id < 0) | (arrays.track_id > _MAX_ID)]
    if len(bad_ids):
        raise ValueError(f"track_id must be from 0 to {_MAX_ID}; got {bad_ids[0]}")
    records = np.zeros(len(arrays), _BLOCKS_DTYPE)
    records["xyz"][:, :2] = arrays.state[:, 0::2]
    records["track_id"] = arrays.track_id
    numbers = records["numbers"]
    numbers[:, :4] = arrays.state
    numbers[:, 4:20] = arrays.covariance.reshape(-1, 16)
    numbers[:, 20] = arrays.evaluation
    numbers[:, 21] = arrays.score
    records["counts"][:, 0] = np.minimum(arrays.hit_count, _MAX_COUNT)
    records["counts"][:, 1] = np.minimum(arrays.scan_count, _MAX_COUNT)
    for name in _PLAIN:
        records[name] = getattr(arrays, name)
    records["revision"] = np.minimum(arrays.revision, _MAX_COUNT)
    is_dense = bool(np.isfinite(numbers).all() and np.isfinite(arrays.age).all())
    return records.view(TRACK_DTYPE), is_dense


def read_track_cloud(cloud: PointCloud2) -> NDArray[Any]:
    """Read a cloud of tracks: the inverse of `track_cloud`.

    Parameters
    ----------
    cloud : sensor_msgs.msg.PointCloud2
        With the fields of this layout, in any order, and perhaps others; `OPTIONAL_FIELDS` may be
        missing.

    Returns
    -------
    (n,) ndarray of TRACK_DTYPE
        `track_states` and `track_covariances` give its states and covariances as arrays.

    Raises
    ------
    MessageError
        If a field is missing or malformed, or a track_id is invalid.
    """
    given = {field.name for field in cloud.fields}
    absent = [name for name in OPTIONAL_FIELDS if name not in given]
    names = [name for name in TRACK_DTYPE.names or () if name not in absent]
    integers = [name for name in names if TRACK_DTYPE[name].kind == "u"]
    values = read_fields(cloud, names, integers=integers)
    ids = values["track_id"]
    if not ((ids >= 0) & (ids <= _MAX_ID) & (ids == np.floor(ids))).all():
        raise MessageError("bad_id", f"track_id must be an integer from 0 to {_MAX_ID}")
    records = np.zeros(len(ids), TRACK_DTYPE)
    with np.errstate(invalid="ignore", over="ignore"):  # counts may be nan
        for name in names:
            records[name] = values[name]
    for name in absent:
        records[name] = OPTIONAL_FIELDS[name]
    return records


def tracker_report(cloud: PointCloud2) -> TrackerReport:
    """Read a cloud of tracks as a downstream tracker's report, in east and north.

    Raises
    ------
    MessageError
        If it does not have the layout of `read_track_cloud`.
    """
    stamp = ns_to_seconds(time_to_ns(cloud.header.stamp))
    records = read_track_cloud(cloud)
    records["age"] = np.clip(records["age"], 0.0, MAX_AGE)
    tracks = track_arrays(records, stamp)
    frame_id = cloud.header.frame_id.lstrip("/")
    return TrackerReport(stamp=stamp, frame_id=frame_id, tracks=exchanged(tracks, frame_id))


def track_arrays(records: NDArray[Any], stamp: float) -> TrackArrays:
    """Return tracks that were read as `TrackArrays`, without hits.

    Parameters
    ----------
    records : (n,) ndarray of TRACK_DTYPE
    stamp : float
        Stamp of the message, s.
    """
    return TrackArrays(
        track_id=records["track_id"].astype(np.int64),
        stamp=np.full(len(records), stamp),
        state=track_states(records),
        covariance=track_covariances(records),
        hits=[()] * len(records),
        hit_count=records["hit_count"].astype(np.int64),
        scan_count=records["scan_count"].astype(np.int64),
        revision=records["revision"].astype(np.int64),
        **{name: records[name].copy() for name in ("evaluation", "score", *_PLAIN)},
    )


def track_states(records: NDArray[Any]) -> NDArray[np.float64]:
    """Return the states of tracks that were read, (n, 4): ``[x, vx, y, vy]``, m and m/s."""
    return np.stack([records[name] for name in STATE_FIELDS], axis=-1)


def track_covariances(records: NDArray[Any]) -> NDArray[np.float64]:
    """Return the covariances of tracks that were read, (n, 4, 4), in the order of the state."""
    rows = np.stack([records[name] for name in COVARIANCE_FIELDS], axis=-1)
    return rows.reshape(-1, 4, 4)
