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
"""The odometry of NMEA sentences of the examples, run as a process."""

import socket
from pathlib import Path

import pytest
from nav_msgs.msg import Odometry

SCRIPT = Path(__file__).parents[2] / "examples" / "nmea_odometry.py"
SENTENCES = (
    b"$GPHDT,90.0,T*0C\r\n$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47\r\n"
)

pytestmark = pytest.mark.skipif(not SCRIPT.exists(), reason="only in the source tree")


def test_sentences_by_udp_become_odometry_until_it_is_interrupted(world, start):
    received = world.listen(Odometry, "own_ship/odometry")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as boat:
        boat.bind(("127.0.0.1", 0))
        port = boat.getsockname()[1]
    process = start("nmea_odometry", script=SCRIPT, arguments=["--", "--port", str(port)])
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as boat:

        def is_heard():
            boat.sendto(SENTENCES, ("127.0.0.1", port))
            return process.running and received

        world.until(is_heard, "odometry")
    assert received[0].header.frame_id == "map"
    assert received[0].pose.pose.orientation.w == pytest.approx(1.0)  # towards east
    process.interrupt()
    assert process.exit_code() == 0, process.said
    assert "Traceback" not in process.said
