"""Fixed echoes as visualization_msgs/MarkerArray, for RViz and Foxglove."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tsepm_ros.kinematics.track import TrackArrays
from tsepm_ros.sensing.conversion import major_sigma

if TYPE_CHECKING:
    from std_msgs.msg import Header
    from visualization_msgs.msg import MarkerArray

    from tsepm_ros.kinematics.track import ConfirmedTrack

FIXED_ECHO_COLOR = 0.95, 0.75, 0.2
"""Red, green and blue: unlike tracks, potential tracks and truth."""
_THICKNESS = 0.01  # m; RViz refuses a scale of 0
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
    from visualization_msgs.msg import Marker, MarkerArray

    markers = [Marker(header=header, action=Marker.DELETEALL)]
    arrays = TrackArrays.of(echoes)
    if not len(arrays):
        return MarkerArray(markers=markers)  # RViz rejects a marker without points
    cubes = _marker(header, "position", Marker.CUBE_LIST)
    sigma = major_sigma(arrays.covariance[:, 0::2, 0::2])
    size = max(minimum_size, float(np.median(sigma)), _THICKNESS)
    cubes.scale.x = cubes.scale.y = cubes.scale.z = size
    cubes.points = [Point(x=x, y=y) for x, y in arrays.state[:, 0::2].tolist()]
    markers.append(cubes)
    for number, row in enumerate(np.argsort(-arrays.age, kind="stable")[:MAX_LABELS].tolist()):
        echo = arrays[row]
        label = _marker(header, "label", Marker.TEXT_VIEW_FACING, number)
        label.scale.z = size
        label.pose.position.x, label.pose.position.y = echo.position.tolist()
        label.pose.position.y += size
        label.text = f"{echo.track_id}: {echo.age / 60.0:.1f} min"
        markers.append(label)
    return MarkerArray(markers=markers)


def _marker(header: Header, namespace: str, kind: int, number: int = 0) -> Any:
    from visualization_msgs.msg import Marker

    marker = Marker(header=header, ns=namespace, id=number, type=kind, action=Marker.ADD)
    marker.color.r, marker.color.g, marker.color.b = FIXED_ECHO_COLOR
    marker.color.a = 1.0
    return marker
