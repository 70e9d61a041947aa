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
"""What the page on the hand-over says of Stone Soup, where that is installed."""

from datetime import UTC, datetime, timedelta
from types import SimpleNamespace

import numpy as np
import pytest
from support.handover_page import run_page

from msg_adapters import TRACK_DTYPE
from tsepm_ros.tracker import motion

DATATYPES = {"<f4": 7, "<f8": 8, "<u2": 4, "<u4": 6}
"""Of sensor_msgs/PointField."""
STATE = np.array([3000.0, 4.0, 1500.0, -2.0])
A = np.random.default_rng(5).standard_normal((4, 4)) * [[60.0], [1.0], [60.0], [1.0]]
COVARIANCE = A @ A.T


def cloud() -> SimpleNamespace:
    """A message on `tracks` with one new track, as it would arrive; needs no ROS."""
    record = np.zeros(1, TRACK_DTYPE)
    record["track_id"] = 7
    for name, value in zip(("state_x", "state_vx", "state_y", "state_vy"), STATE, strict=True):
        record[name] = value
    for row, column in np.ndindex(4, 4):
        record[f"cov_{row}{column}"] = COVARIANCE[row, column]
    fields = [
        SimpleNamespace(name=name, offset=offset, datatype=DATATYPES[kind.str], count=1)
        for name, (kind, offset) in TRACK_DTYPE.fields.items()
    ]
    stamp = SimpleNamespace(sec=1_700_000_000, nanosec=123_456_000)
    header, step = SimpleNamespace(stamp=stamp, frame_id="odom"), TRACK_DTYPE.itemsize
    layout = {"fields": fields, "is_bigendian": False, "point_step": step, "row_step": step}
    return SimpleNamespace(header=header, height=1, width=1, data=record.tobytes(), **layout)


def test_stone_soup_starts_predicts_and_measures_as_a_filter_here_does():
    pytest.importorskip("stonesoup")
    page = run_page(stone_soup=True)
    [track] = page["stone_soup_tracks"](cloud())
    [start] = track
    assert track.id == "7"
    assert start.timestamp == datetime(2023, 11, 14, 22, 13, 20, 123_456, tzinfo=UTC)
    np.testing.assert_array_equal(start.state_vector.ravel(), STATE)
    np.testing.assert_array_equal(start.covar, COVARIANCE)
    later = page["predictor"].predict(start, timestamp=start.timestamp + timedelta(seconds=12))
    state, covariance = motion.predict(STATE[None], COVARIANCE[None], 12.0, 0.01)
    np.testing.assert_allclose(later.state_vector.ravel().astype(float), state[0], rtol=1e-12)
    np.testing.assert_allclose(later.covar.astype(float), covariance[0], rtol=1e-9)
    models = pytest.importorskip("stonesoup.models.measurement.nonlinear")
    [[start]] = run_page(stone_soup=True)["stone_soup_tracks"](cloud())
    model = models.CartesianToBearingRange(ndim_state=4, mapping=(0, 2), noise_covar=np.eye(2))
    bearing, distance = model.function(start, noise=False).ravel()
    assert float(bearing) == pytest.approx(np.arctan2(1500.0, 3000.0))
    assert float(distance) == pytest.approx(np.hypot(1500.0, 3000.0))
