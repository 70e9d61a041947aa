"""Tracks, ground truth and fixed echoes as visualization_msgs/MarkerArray.

Tracks as visualization_msgs/MarkerArray, for RViz and Foxglove.

The ground truth of the simulator and the player, in the layout and appearance of tracks.

Fixed echoes as visualization_msgs/MarkerArray, for RViz and Foxglove.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, TypedDict

import numpy as np
from numpy.typing import NDArray

from tsepm_ros.numerics.arrays import FloatArray, summed
from tsepm_ros.tracker.measurement import major_sigma
from tsepm_ros.tracker.scan import Scan
from tsepm_ros.tracker.tracks import ConfirmedTrack, TrackArrays

if TYPE_CHECKING:
    from std_msgs.msg import Header
    from visualization_msgs.msg import Marker, MarkerArray

    from tsepm_ros.tracker.tracks import ConfirmedTrack


Color = tuple[float, float, float]

NAMESPACES = ("position", "velocity", "ellipse", "label")
"""The namespaces of a track's markers; the id of each marker is the track's id."""

TRACK_COLOR: Color = (0.1, 0.9, 0.3)

POTENTIAL_COLORS: tuple[Color, Color] = (0.45, 0.5, 0.6), (1.0, 0.6, 0.0)
"""Colours of a potential track with zero score, and of one at the threshold."""

SIZE_SHARE = 0.01
"""Size of a marker in the reach of the sensor: a few pixels where all of it is in view."""
LEAD_SHARE = 0.1
"""Way that velocity markers show of the fastest target, in the reach of the sensor."""

ELLIPSE_SCALE = math.sqrt(-2.0 * math.log(0.05))
"""Semi-axes of the 95 % ellipse in standard deviations, sqrt(chi2(2, 0.95)) = 2.4477."""

_LABEL_HEIGHT = 3.0  # in sizes of the position marker: readable if that is a few pixels
_ELLIPSE_OPACITY = 0.25
_COASTING_OPACITY = 0.5  # of every marker of a track without a detection in the last scan
_DASHES, _DASH_WIDTH = 24, 0.1  # of a coasting track's ellipse; the width in sizes
_MAX_POTENTIAL = 1000  # drawn; nested messages are slow to build in Python
_POTENTIAL_OPACITY = 0.3, 1.0  # as for the colours
_POTENTIAL_LINE = 0.25  # width, in sizes of the points
_THICKNESS = 0.01  # m; RViz refuses a scale of 0


class MarkerSizes(TypedDict):
    """Sizes of markers, as arguments of the functions that build them: m, and s."""

    minimum_size: float
    lead_time: float


def marker_sizes(reach: float, max_speed: float) -> MarkerSizes:
    """Sizes of the markers of a sensor.

    Parameters
    ----------
    reach : float
        Largest range of targets, m.
    max_speed : float
        Of targets, m/s.

    Returns
    -------
    MarkerSizes
    """
    return {"minimum_size": SIZE_SHARE * reach, "lead_time": LEAD_SHARE * reach / max_speed}


def track_markers(
    header: Header,
    tracks: Iterable[ConfirmedTrack],
    ended_ids: Iterable[int] = (),
    *,
    afresh: bool = False,
    minimum_size: float = 0.0,
    lead_time: float = 1.0,
    color: Color = TRACK_COLOR,
) -> MarkerArray:
    """Build the markers that show the current tracks and remove those of others.

    Each track has a sphere at its position, an arrow to its predicted position, its 95 % ellipse,
    and a label with id, speed, the largest standard deviation of the position, and the revision of
    a start that was corrected. Those of a track that coasts, without a detection in the last scan,
    are fainter, and its ellipse is dashed.

    Parameters
    ----------
    header : std_msgs.msg.Header
        The fixed frame, and the stamp of the states.
    tracks : iterable of ConfirmedTrack
        Every current track.
    ended_ids : iterable of int, optional
        Ids of the tracks of the last message that are not current any more.
    afresh : bool, optional
        Remove every marker of the topic first, those of other publishers included.
    minimum_size : float, optional
        Minimum size of sphere, arrow and label, m, which otherwise have the largest standard
        deviation of the position; see `marker_sizes`. The ellipse is always to scale.
    lead_time : float, optional
        Prediction time of the arrow, s; see `marker_sizes`.
    color : (float, float, float), optional
        Red, green and blue, 0 to 1.

    Returns
    -------
    visualization_msgs.msg.MarkerArray
        Deletions first.
    """
    from visualization_msgs.msg import MarkerArray

    markers = [
        _marker(header, namespace, track_id, "DELETE")
        for track_id in ended_ids
        for namespace in NAMESPACES
    ]
    if afresh:
        markers = [_marker(header, action="DELETEALL")]
    for track in tracks:
        markers += _shapes(header, track, minimum_size, lead_time, color)
    return MarkerArray(markers=markers)


def potential_track_markers(
    header: Header,
    tracks: Sequence[ConfirmedTrack],
    *,
    minimum_size: float = 0.0,
    lead_time: float = 1.0,
) -> MarkerArray:
    """Build the markers of candidate tracks, which replace those of the last message.

    For speed there are only two markers: points at the positions, and lines to the predicted
    positions. The scores of tracks with the same newest hit are summed, as in the test for
    confirmation. The best of these tracks is drawn if the sum is above 0, which means that a target
    is more likely than clutter. Its colour changes from grey to orange as the sum approaches the
    threshold, ``score - evaluation``. If the method has no score, all tracks are drawn in grey. At
    most 1000 tracks are drawn, those nearest to the threshold.

    Parameters
    ----------
    header : std_msgs.msg.Header
        The fixed frame, and the stamp of the states.
    tracks : sequence of ConfirmedTrack
    minimum_size, lead_time : float, optional
        Size of the points, m, and prediction time of the lines, s; see `marker_sizes`.

    Returns
    -------
    visualization_msgs.msg.MarkerArray
    """
    from geometry_msgs.msg import Point
    from std_msgs.msg import ColorRGBA
    from visualization_msgs.msg import MarkerArray

    markers = [_marker(header, action="DELETEALL")]
    arrays = TrackArrays.of(tracks)
    drawn, nearness = drawn_candidates(arrays)
    if not len(drawn):
        return MarkerArray(markers=markers)  # RViz rejects a marker without points
    first = np.argsort(-nearness, kind="stable")[:_MAX_POTENTIAL]
    arrays, share = arrays.where(drawn[first]), nearness[first, None]
    (grey, orange), (faint, opaque) = np.array(POTENTIAL_COLORS), _POTENTIAL_OPACITY
    rgba = np.hstack([grey + share * (orange - grey), faint + share * (opaque - faint)])
    colors = [ColorRGBA(r=r, g=g, b=b, a=a) for r, g, b, a in rgba.tolist()]
    begin = arrays.state[:, 0::2]
    ends = np.stack([begin, begin + lead_time * arrays.state[:, 1::2]], axis=1)
    points = [[Point(x=x, y=y) for x, y in line] for line in ends.tolist()]
    size = max(minimum_size, _THICKNESS)
    positions = _marker(header, "position", kind="POINTS", scale=(size, size, 0.0), opacity=1.0)
    positions.points, positions.colors = [line[0] for line in points], colors
    width = _POTENTIAL_LINE * size
    velocities = _marker(header, "velocity", kind="LINE_LIST", scale=(width, 0.0, 0.0), opacity=1.0)
    velocities.points = [point for line in points for point in line]
    velocities.colors = [color for color in colors for _ in range(2)]
    return MarkerArray(markers=[*markers, positions, velocities])


def drawn_candidates(tracks: TrackArrays) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return rows to draw, (k,), and their summed score relative to the threshold, 0 to 1, (k,).

    The scores of tracks with the same newest hit are summed, and the best of them is drawn.
    """
    scored = np.isfinite(tracks.score)
    if not scored.any():
        return np.arange(len(tracks)), np.zeros(len(tracks))
    best_first = np.flatnonzero(scored)[np.argsort(-tracks.score[scored], kind="stable")]
    newest = [tracks.hits[row][-1] for row in best_first]
    # As complex numbers, which are sorted as pairs are, and much faster.
    keys = np.array(newest) @ np.array([1.0, 1.0j])
    _, best, group = np.unique(keys, return_index=True, return_inverse=True)
    total = summed(tracks.score[best_first], group, len(best))
    rows = best_first[best]
    threshold = tracks.score[rows] - tracks.evaluation[rows]
    likely = total > 0.0
    return rows[likely], np.clip(total / threshold, 0.0, 1.0)[likely]


def clear_markers(header: Header) -> MarkerArray:
    """Build the message that removes every marker of the topic."""
    from visualization_msgs.msg import MarkerArray

    return MarkerArray(markers=[_marker(header, action="DELETEALL")])


def confidence_ellipse(covariance: NDArray[np.float64]) -> tuple[float, float, float]:
    """Return the 95 % ellipse of a Gaussian position.

    Parameters
    ----------
    covariance : (2, 2) ndarray
        m^2.

    Returns
    -------
    semi_major, semi_minor : float
        m.
    angle : float
        Of the major axis, rad, counter-clockwise from x.
    """
    semi_major, semi_minor, angle = ellipses(covariance[None])[0].tolist()
    return semi_major, semi_minor, angle


def ellipses(covariance: FloatArray) -> FloatArray:
    """Return the 95 % ellipses of Gaussian positions.

    Parameters
    ----------
    covariance : (n, 2, 2) ndarray
        m^2.

    Returns
    -------
    (n, 3) ndarray
        Semi-axes, m, the major one first, and its angle from x, rad; 0 where the covariance is not
        finite.
    """
    bad = ~np.isfinite(covariance).all(axis=(1, 2))
    xx, xy, yy = (np.where(bad, 0.0, covariance[:, i, j]) for i, j in ((0, 0), (0, 1), (1, 1)))
    mean, half_difference = 0.5 * (xx + yy), 0.5 * (xx - yy)
    radius = np.hypot(half_difference, xy)
    # Rounding can make a zero eigenvalue negative.
    variances = np.maximum(np.stack([mean + radius, mean - radius], axis=1), 0.0)
    angle = 0.5 * np.arctan2(xy, half_difference)
    return np.column_stack([ELLIPSE_SCALE * np.sqrt(variances), angle])


def _marker(
    header: Header,
    namespace: str = "",
    number: int = 0,
    action: str = "ADD",
    *,
    kind: str = "ARROW",
    scale: tuple[float, float, float] = (0.0, 0.0, 0.0),
    color: Color = (0.0, 0.0, 0.0),
    opacity: float = 0.0,
    place: Sequence[float] | FloatArray = (0.0, 0.0),
) -> Marker:
    from visualization_msgs.msg import Marker

    # Ids of markers are signed and those of tracks unsigned: the upper half becomes negative.
    signed_id = (number + 2**31) % 2**32 - 2**31
    marker = Marker(header=header, ns=namespace, id=signed_id, action=getattr(Marker, action))
    marker.type = getattr(Marker, kind)
    marker.scale.x, marker.scale.y, marker.scale.z = scale
    marker.color.r, marker.color.g, marker.color.b = color
    marker.color.a = opacity
    marker.pose.position.x, marker.pose.position.y = (float(value) for value in place)
    return marker


def _shapes(
    header: Header, track: ConfirmedTrack, minimum_size: float, lead_time: float, color: Color
) -> list[Marker]:
    """Position, velocity, ellipse and label of a track."""
    from geometry_msgs.msg import Point

    major, minor, angle = confidence_ellipse(track.position_covariance)
    sigma, coasting = major / ELLIPSE_SCALE, track.time_since_hit > 0.0
    size = max(minimum_size, sigma, _THICKNESS)
    height, dash = _LABEL_HEIGHT * size, _DASH_WIDTH * size
    opacity = _COASTING_OPACITY if coasting else 1.0
    own: dict[str, Any] = {"number": track.track_id, "color": color, "opacity": opacity}
    place, (x, y) = track.position, track.position.tolist()
    sphere = _marker(header, "position", kind="SPHERE", scale=(size,) * 3, place=place, **own)
    # Scale of an arrow between two points: diameters of shaft and head, length of the head.
    arrow = _marker(header, "velocity", scale=(0.3 * size, 0.8 * size, size), **own)
    ends = np.array([place, place + lead_time * track.velocity]).tolist()
    arrow.points = [Point(x=x, y=y) for x, y in ends]
    if coasting:  # every second segment, along the ellipse
        scale = (dash, 0.0, 0.0)
        ellipse = _marker(header, "ellipse", kind="LINE_LIST", scale=scale, place=place, **own)
        ellipse.points = [
            Point(x=major * math.cos(turn), y=minor * math.sin(turn))
            for turn in np.linspace(0.0, math.tau, 2 * _DASHES, endpoint=False).tolist()
        ]
    else:
        own["opacity"] = _ELLIPSE_OPACITY
        scale = (max(2 * major, _THICKNESS), max(2 * minor, _THICKNESS), _THICKNESS)
        ellipse = _marker(header, "ellipse", kind="CYLINDER", scale=scale, place=place, **own)
    turned = ellipse.pose.orientation
    turned.z, turned.w = math.sin(angle / 2), math.cos(angle / 2)
    own |= {"opacity": opacity, "scale": (0.0, 0.0, height), "place": (x, y + height)}
    label = _marker(header, "label", kind="TEXT_VIEW_FACING", **own)
    # ASCII only: RViz's font has no Greek letters.
    speed = math.hypot(*track.velocity)
    label.text = f"{track.track_id}: {_digits(speed, 1)} m/s, sigma {_digits(sigma, 0)} m"
    if track.revision:
        label.text += f", revision {track.revision}"
    return [sphere, arrow, ellipse, label]


def _digits(value: float, decimals: int) -> str:
    """A length or speed with some decimals, and with more where it has not two digits."""
    return f"{value:.{max(decimals, 1 - math.floor(math.log10(max(value, 0.01))))}f}"


TRUTH_COLOR = (0.17, 0.42, 0.69)


def truth_tracks(stamp: float, states: NDArray[np.float64]) -> list[ConfirmedTrack]:
    """True states as tracks without error.

    Parameters
    ----------
    stamp : float
        s.
    states : (k, 4) ndarray
        ``[x, vx, y, vy]`` of each target, m and m/s.

    Returns
    -------
    list of ConfirmedTrack
        `track_id` is the target's index, the covariance 0, the evaluation nan.
    """
    return [
        ConfirmedTrack(index, stamp, state, np.zeros((4, 4)), (), math.nan)
        for index, state in enumerate(np.reshape(states, (-1, 4)))
    ]


def truth_markers(header: Header, truth: list[ConfirmedTrack], reach: float = 0.0) -> MarkerArray:
    """Markers of the truth: position, velocity and label in `TRUTH_COLOR`.

    Their sizes are those of targets up to a distance `reach` (m), and of the fastest of these.
    """
    fastest = max((math.hypot(*track.velocity) for track in truth), default=0.0)
    return track_markers(header, truth, color=TRUTH_COLOR, **marker_sizes(reach, fastest or 1.0))


FIXED_ECHO_COLOR = 0.95, 0.75, 0.2
DETECTION_COLOR = 0.9, 0.9, 0.95
"""Red, green and blue: unlike tracks, potential tracks and truth."""
MAX_LABELS = 500
"""Labels shown, of the echoes seen for the longest; nested messages are slow to build."""


def fixed_echo_markers(
    header: Header, echoes: Sequence[ConfirmedTrack], *, minimum_size: float = 0.0
) -> MarkerArray:
    """Build the markers of fixed echoes, which replace those of the last message.

    A cube at each place, and a label with the id and the minutes since the first hit.

    Parameters
    ----------
    header : std_msgs.msg.Header
        The fixed frame, and the stamp of the states.
    echoes : sequence of ConfirmedTrack
    minimum_size : float, optional
        Length of the edges and height of the labels, m; see `track_markers.marker_sizes`. At least
        the median standard deviation of the places.

    Returns
    -------
    visualization_msgs.msg.MarkerArray
    """
    from geometry_msgs.msg import Point
    from visualization_msgs.msg import MarkerArray

    markers = [_marker(header, action="DELETEALL")]
    arrays = TrackArrays.of(echoes)
    if not len(arrays):
        return MarkerArray(markers=markers)  # RViz rejects a marker without points
    own: dict[str, Any] = {"color": FIXED_ECHO_COLOR, "opacity": 1.0}
    sigma = major_sigma(arrays.covariance[:, 0::2, 0::2])
    size = max(minimum_size, float(np.median(sigma)), _THICKNESS)
    cubes = _marker(header, "position", kind="CUBE_LIST", scale=(size,) * 3, **own)
    cubes.points = [Point(x=x, y=y) for x, y in arrays.state[:, 0::2].tolist()]
    markers.append(cubes)
    own |= {"kind": "TEXT_VIEW_FACING", "scale": (0.0, 0.0, size)}
    for number, row in enumerate(np.argsort(-arrays.age, kind="stable")[:MAX_LABELS].tolist()):
        echo = arrays[row]
        x, y = echo.position.tolist()
        label = _marker(header, "label", number, place=(x, y + size), **own)
        label.text = f"{echo.track_id}: {echo.age / 60.0:.1f} min"
        markers.append(label)
    return MarkerArray(markers=markers)


def detection_markers(header: Header, scan: Scan, size: float) -> MarkerArray:
    """Build the marker of a scan's detections, which replaces that of the last message.

    Parameters
    ----------
    header : std_msgs.msg.Header
        The sensor's frame, x ahead and y to port.
    scan : Scan
    size : float
        Diameter of the points, m.
    """
    from geometry_msgs.msg import Point
    from visualization_msgs.msg import MarkerArray

    markers = [_marker(header, action="DELETEALL")]
    if len(scan):
        points = _marker(
            header, "detection", kind="SPHERE_LIST", scale=(size,) * 3, color=DETECTION_COLOR
        )
        x, y = scan.range * np.cos(scan.azimuth), scan.range * np.sin(scan.azimuth)
        points.points = [Point(x=one, y=two) for one, two in zip(x, y, strict=True)]
        markers.append(points)
    return MarkerArray(markers=markers)
