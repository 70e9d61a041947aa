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
"""Latitude and longitude of positions in the fixed frame, on WGS 84.

A position is found by the geodesic from a point that is known in both: the frame's origin, or the
place of own ship at a position fix.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tsepm_ros.numerics.arrays import FloatArray

MAX_LATITUDE = 89.0
"""Largest latitude, degrees: near a pole the fixed frame's north is not that of its targets."""
MAX_DISTANCE = 2e7
"""Largest distance, m, half of the earth's circumference: nothing on the earth is farther away."""


@dataclass(frozen=True)
class GeographicReference:
    """A point whose place is known in the fixed frame and on the earth.

    Attributes
    ----------
    latitude, longitude : float
        Degrees.
    east, north : float
        m, in the fixed frame.

    Raises
    ------
    ValueError
        If the latitude is beyond `MAX_LATITUDE`, or the longitude beyond 360 degrees.
    """

    latitude: float
    longitude: float
    east: float = 0.0
    north: float = 0.0

    def __post_init__(self) -> None:
        if not abs(self.latitude) <= MAX_LATITUDE:
            raise ValueError(
                f"the latitude must be from -{MAX_LATITUDE:g} to {MAX_LATITUDE:g} degrees: near a "
                f"pole north changes within the coverage; got {self.latitude:g}"
            )
        if not abs(self.longitude) <= 360.0:
            raise ValueError(f"the longitude must be in degrees; got {self.longitude:g}")

    @classmethod
    def read(cls, text: str) -> GeographicReference:
        """The reference of a text `latitude,longitude`, at the fixed frame's origin.

        Raises
        ------
        ValueError
            If it is no such text, or out of bounds.
        """
        try:
            latitude, longitude = (float(part) for part in text.split(","))
        except ValueError:
            raise ValueError(
                "the origin must be latitude,longitude in degrees, such as 59.65,10.63; "
                f"got {text!r}"
            ) from None
        return cls(latitude, longitude)

    def geographic(self, position: FloatArray) -> FloatArray:
        """Latitude and longitude of positions.

        Parameters
        ----------
        position : (n, 2) ndarray
            East and north, m, in the fixed frame.

        Returns
        -------
        (n, 2) ndarray
            Degrees; longitudes from -180 to 180; nan beyond `MAX_DISTANCE`.

        Raises
        ------
        ImportError
            If the library pyproj is not installed.
        """
        from pyproj import Geod

        east, north = (np.reshape(position, (-1, 2)) - (self.east, self.north)).T
        away = np.hypot(east, north)
        is_near = away <= MAX_DISTANCE
        longitude, latitude, _ = Geod(ellps="WGS84").fwd(
            np.full_like(away, self.longitude),
            np.full_like(away, self.latitude),
            np.degrees(np.arctan2(east, north)),
            np.where(is_near, away, 0.0),
        )
        places = np.stack([latitude, (longitude + 180.0) % 360.0 - 180.0], axis=1)
        return np.where(is_near[:, None], places, np.nan)

    def distance(self, other: GeographicReference) -> float:
        """Distance, m, between the point of another reference and its place by this one, or nan."""
        from pyproj import Geod

        latitude, longitude = self.geographic(np.array([other.east, other.north]))[0]
        return float(
            Geod(ellps="WGS84").inv(longitude, latitude, other.longitude, other.latitude)[2]
        )
