"""The ground truth of the simulator and the player, in the layout and appearance of tracks."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from msg_adapters.track_markers import marker_sizes, track_markers
from tsepm_ros.kinematics.track import ConfirmedTrack

if TYPE_CHECKING:
    from std_msgs.msg import Header
    from visualization_msgs.msg import MarkerArray

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
