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
"""The public names of Python: a release leaves none out, and each can be imported."""

import importlib
import subprocess
import sys

import pytest

NAMES = {
    "tsepm_ros": """
        ConfirmedTrack LandMask Scan SensorModel SonarImage available_methods make_detector
        make_initiator
    """,
    "msg_adapters": """
        TRACK_DTYPE MessageError Ping PlacedDetections clear_markers detections_cloud
        diagnostics fixed_echo_markers make_header message_class ns_to_seconds ns_to_time
        odometry_message placed_detections_cloud potential_track_markers read_detections
        read_fields read_land read_own_ship read_placed_detections read_track_cloud
        seconds_to_ns supported_types time_to_ns track_cloud track_covariances track_markers
        track_odometry track_states tracker_report truth_markers truth_tracks write_cloud
        write_detections
    """,
    "tsepm_ros.tools.simulation": """
        CLUTTER Scenario SimulatedScan Simulator load_scenario shipped_scenarios
    """,
}


@pytest.mark.parametrize("package", NAMES)
def test_a_package_offers_the_names_that_were_promised(package):
    assert sorted(importlib.import_module(package).__all__) == sorted(NAMES[package].split())


@pytest.mark.parametrize("package", NAMES)
def test_each_public_name_is_imported_alone_and_without_ros(package):
    """In a process of its own: what another test has imported does not count."""
    code = f"""
import sys
for name in ("rclpy", "sensor_msgs", "nav_msgs", "visualization_msgs"):
    sys.modules[name] = None
for name in {NAMES[package].split()!r}:
    exec(f"from {package} import {{name}}")
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_a_name_that_is_not_public_is_refused():
    with pytest.raises(ImportError, match="Tracker"):
        exec("from tsepm_ros import Tracker")
