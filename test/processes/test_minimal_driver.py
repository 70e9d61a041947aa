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
"""The minimal driver of the examples, run as a process beside the initiator."""

from pathlib import Path

import numpy as np
import pytest
from sensor_msgs.msg import PointCloud2
from support.sonar_driver import points

from tsepm_ros.nodes.track_initiator import TrackInitiator

DRIVER = Path(__file__).parents[2] / "examples" / "minimal_driver.py"

pytestmark = pytest.mark.skipif(not DRIVER.exists(), reason="only in the source tree")


def test_it_has_25_lines():
    source = DRIVER.read_text(encoding="utf-8")
    assert len(source[source.index('"""') :].splitlines()) <= 25, "without the licence"


def test_its_target_is_started_by_the_initiator(world, start):
    """The only target is at y = 150 m; five false detections a ping are within 425 m."""
    received = world.listen(PointCloud2, "tracks")
    sensor = {"sensor.range_std": 1.0, "sensor.range_std_fraction": 0.0, "sensor.max_range": 430.0}
    values = {"method": "score", "max_speed": 3.0, "sensor.clutter_density": 1e-5, **sensor}
    world.make(TrackInitiator, values)
    process = start("minimal_driver", script=DRIVER)
    world.until(lambda: any(message.width for message in received), "a confirmed track")
    [first, *_] = [point for message in received for point in points(message)]
    assert first["state_y"] == pytest.approx(150.0, abs=10.0)
    assert -101.0 < first["state_x"] < 0.0
    assert first["state_vx"] == pytest.approx(1.0, abs=1.0)
    assert np.isfinite([first[f"cov_{i}{i}"] for i in range(4)]).all()
    assert not world.dropped()
    assert process.running
    process.interrupt()
    assert process.exit_code() == 0, process.said
    assert "Traceback" not in process.said
