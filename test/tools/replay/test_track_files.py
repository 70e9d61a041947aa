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
"""Tracks as GeoJSON and as a terminal's table."""

from __future__ import annotations

import io
import json
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest

from tsepm_ros.tools.bridge.geographic import GeographicReference
from tsepm_ros.tools.replay.track_files import track_lines_file, track_listing_file
from tsepm_ros.tracker.tracks import ConfirmedTrack, TrackArrays


def lines(steps):
    """The collection of one track at positions, a scan each."""
    file = io.StringIO()
    with track_lines_file(file, GeographicReference(10.0, 179.99)) as made:
        for number, (east, north) in enumerate(steps):
            state = np.array([east, 1.0, north, 0.0])
            track = ConfirmedTrack(4, float(number), state, np.eye(4), (), 0.0, status=number)
            held = TrackArrays.from_tracks([track])
            made(SimpleNamespace(current=held, stamp_ns=number * 10**9, ended={}))
        gone = TrackArrays.from_tracks([])
        made(SimpleNamespace(current=gone, stamp_ns=10**10, ended={4: "missed"}))
    return json.loads(file.getvalue())["features"]


def test_geojson_has_a_line_with_times_and_end_a_point_or_lines_beside_180_degrees():
    (feature,) = lines([(0.0, 0.0), (10.0, 0.0)])
    assert feature["geometry"]["type"] == "LineString"
    assert feature["geometry"]["coordinates"][0] == [179.99, 10.0]
    found = feature["properties"]
    assert found["times"] == ["1970-01-01T00:00:00+00:00", "1970-01-01T00:00:01+00:00"]
    assert found["status"] == ["confirmed", "coasting"]
    assert (found["course"], found["speed"], found["ended"]) == (90.0, 1.0, "missed")
    (feature,) = lines([(0.0, 0.0)])
    assert feature["geometry"] == {"type": "Point", "coordinates": [179.99, 10.0]}
    (feature,) = lines([(0.0, 0.0), (2000.0, 0.0)])
    assert feature["geometry"]["type"] == "MultiLineString"
    west, east = feature["geometry"]["coordinates"]
    assert west[-1][0] == 180.0
    assert east[0][0] == -180.0
    assert west[-1][1] == east[0][1]


def test_a_run_that_fails_leaves_no_collection_and_unknown_ends_are_none():
    file = io.StringIO()
    with (
        pytest.raises(OSError, match="full"),
        track_lines_file(file, GeographicReference(0, 0)) as made,
    ):
        made(SimpleNamespace(current=TrackArrays.from_tracks([]), stamp_ns=0, ended={9: "missed"}))
        raise OSError("full")
    assert file.getvalue() == ""


@pytest.mark.parametrize(
    ("frame", "north", "heading", "angle"),
    [
        ("odom", True, "course [deg]", "90"),
        ("odom_ned", True, "course [deg]", "0"),
        ("sonar", False, "direction [deg]", "0"),
    ],
)
def test_a_course_is_clockwise_from_north(frame, north, heading, angle):
    """The track moves along x: east, north, or ahead of a sonar that knows no north."""
    file = io.StringIO()
    listing = track_listing_file(file, lambda track: "because", north=north)
    track = ConfirmedTrack(3, 12.0, np.array([10.0, 2.0, 20.0, 0.0]), np.eye(4), (), 0.0)
    listing(Mock(new=[track], frame_id=frame))
    head, line = file.getvalue().splitlines()
    assert heading in head and line.split()[-2:] == [angle, "because"]
