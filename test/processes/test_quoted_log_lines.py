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
"""Log lines that pages quote are what their commands print."""

import re
from pathlib import Path

import pytest
from sensor_msgs.msg import PointCloud2
from support.ros_process import RosProcess

DOCS = Path(__file__).parents[2] / "docs"
QUOTED = re.compile(r"^\[INFO\] \[track_initiator\]: (.+)$", re.MULTILINE)

pytestmark = pytest.mark.skipif(not DOCS.exists(), reason="only in the source tree")


def assert_says_what_is_quoted(process: RosProcess, page: str, number: int) -> None:
    lines = QUOTED.findall((DOCS / page).read_text(encoding="utf-8"))
    assert len(lines) == number
    for line in lines:
        process.until_said(f"[track_initiator]: {line}\n")


def test_the_lines_of_a_sonar_that_is_set_up(world, start):
    publisher = world.observer.create_publisher(PointCloud2, "/my_sonar/detections", 10)
    process = start("track_initiator", arguments=["-r", "detections:=/my_sonar/detections"])
    assert_says_what_is_quoted(process, "set_up.md", 3)
    world.observer.destroy_publisher(publisher)


@pytest.mark.long
def test_the_lines_of_simulator_and_node_by_hand(start):
    process = start("track_initiator", {"own_ship_source": "odometry"})
    process.until_said("waiting for a publisher")
    start("sonar_simulator", {"rate_factor": 100.0})
    assert_says_what_is_quoted(process, "get_started.md", 1)
