"""Held tracks of targets with several detections a ping."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from tsepm_ros.maintenance.held_tracks import HeldTracks
from tsepm_ros.numerics.arrays import FloatArray
from tsepm_ros.sensing.plots import PlotExtent

FURTHER_PLOTS = 1.0
"""Mean number of plots, beside its own, of a target with several detections a ping: a choice."""


def further_plots(
    held: HeldTracks, positions: FloatArray, extent: PlotExtent, sensor_position: FloatArray
) -> FloatArray:
    """Density of plots that targets of an extent may have beside their own.

    `FURTHER_PLOTS` of each target that exists, uniform within the extent of where it is.

    Parameters
    ----------
    held : HeldTracks
    positions : (d,) ndarray
        m.
    extent : PlotExtent
    sensor_position : (2,) ndarray
        m.

    Returns
    -------
    (d,) ndarray
        1/m^2.
    """
    density = np.zeros(len(positions))
    if not len(positions) or not len(held):
        return density
    centre = held.tracks.state[:, 0::2] - sensor_position
    range_ = np.hypot(*centre.T)
    sight = centre / np.maximum(range_, 1e-9)[:, None]
    across = extent.across_at(range_)
    area = 4.0 * np.maximum(extent.along, 1e-9) * np.maximum(across, 1e-9)
    found = cKDTree(positions).query_ball_point(
        centre + sensor_position, np.hypot(extent.along, across)
    )
    for track, rows in enumerate(found):
        apart = positions[rows] - sensor_position - centre[track]
        east, north = sight[track]
        inside = np.abs(apart @ sight[track]) <= extent.along
        inside &= np.abs(apart @ np.array([-north, east])) <= across[track]
        density[rows] += inside * FURTHER_PLOTS * held.existence[track] / area[track]
    return density
