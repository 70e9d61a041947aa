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
"""The example that reads a GPS compass: positions in metres, headings, and bad sentences."""

import math

import pytest
from nmea_odometry import GpsCompass

GGA = "$GPGGA,120000,{},{},1,08,0.9,3.0,M,,M,,"


def test_positions_are_metres_east_and_north_of_the_first():
    compass = GpsCompass()
    assert compass.read(GGA.format("5939.0000,N", "01037.8000,E"), 0.0)[:2] == (0.0, 0.0)
    east, north, _ = compass.read(GGA.format("5939.1000,N", "01037.9000,E"), 1.0)
    geod = pytest.importorskip("pyproj").Geod(ellps="WGS84")
    ahead, _, way = geod.inv(10.63, 59.65, 10.63 + 0.1 / 60, 59.65 + 0.1 / 60)
    assert math.hypot(east, north) == pytest.approx(way, rel=1e-4)
    assert math.degrees(math.atan2(east, north)) == pytest.approx(ahead, abs=0.01)


def test_west_of_the_date_line_is_near_to_east_of_it():
    compass = GpsCompass()
    compass.read(GGA.format("1700.0000,S", "17959.9990,E"), 0.0)
    east, north, _ = compass.read(GGA.format("1700.0000,S", "17959.9990,W"), 1.0)
    assert (east, north) == (pytest.approx(3.55, abs=0.05), 0.0)


@pytest.mark.parametrize("heading", ["$HEHDT,225.0,T", "$HETHS,225.0,A*28"])
def test_a_heading_is_a_yaw_from_east_for_one_second(heading):
    compass, here = GpsCompass(), GGA.format("5939.0,N", "01037.8,E")
    assert compass.read(heading, 0.0) is None
    assert compass.read(here, 0.9)[2] == pytest.approx(math.radians(-135.0))
    assert math.isnan(compass.read(here, 1.1)[2]), "an old heading is none"


@pytest.mark.parametrize(
    "line",
    [
        "",
        "noise",
        "$GPGGA,120000,,,,,0,00,,,M,,M,,",
        GGA.format("59", "N") + "*00",
        "$GPGGA,12",
        "$HEHDT,,T",
    ],
)
def test_a_sentence_without_a_position_gives_none(line):
    assert GpsCompass().read(line, 0.0) is None
