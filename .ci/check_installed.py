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
"""Check what `colcon build` installed: executables, share files, and that the nodes start and end.

Usage, with the install space sourced and test/ in PYTHONPATH: check_installed.py PREFIX
"""

import os
import signal
import subprocess
import sys
from importlib import metadata, resources
from itertools import chain
from pathlib import Path

import rclpy
from ament_index_python.packages import get_package_share_directory
from rcl_interfaces.srv import ListParameters
from support.patience import WAIT

PACKAGE = "tsepm_ros"
EXECUTABLES = [
    *("track_initiator", "sonar_detector", "sonar_simulator", "scan_player", "track_viewer"),
    *("track_bridge", "tsepm", "tsepm_demo"),
]
NODES = [name for name in EXECUTABLES if name not in ("scan_player", "tsepm", "tsepm_demo")]
"""Executables that run without parameters until they are interrupted."""
SHARED = ["package.xml", "config/*.yaml", "launch/*.xml"]
OF_CONFIG = ["rviz/*", "foxglove/*", "sros2/*"]
"""Of config/ in the source tree, and beside it in the share directory."""
DOMAIN = 1 + os.getpid() % 100  # so that checks side by side do not meet


def check_files(prefix: Path) -> None:
    """Check that every file of the source tree is where ROS and Python look for it."""
    for name in EXECUTABLES:
        assert os.access(prefix / "lib" / PACKAGE / name, os.X_OK), f"no executable {name}"
    share = Path(get_package_share_directory(PACKAGE))
    assert share == prefix / "share" / PACKAGE, f"share directory is {share}"
    for folder, patterns in ((Path(), SHARED), (Path("config"), OF_CONFIG)):
        for source in chain.from_iterable(folder.glob(pattern) for pattern in patterns):
            name = source.relative_to(folder)
            assert (share / name).is_file(), f"not in share: {name}"
    package = Path(str(resources.files(PACKAGE)))
    assert package.is_relative_to(prefix), f"another {PACKAGE} is imported: {package}"
    data = ("tools/simulation/scenarios/*.yaml", "tools/viewer/page/*")
    for source in chain.from_iterable(Path().glob(f"{PACKAGE}/{pattern}") for pattern in data):
        assert (package.parent / source).is_file(), f"not in the package: {source}"
    for script in metadata.distribution(PACKAGE).entry_points:
        assert callable(script.load()), script


def check_node(executable: Path) -> None:
    """Start a node, wait until it answers a service call, interrupt it: it must exit 0."""
    name = executable.name
    process = subprocess.Popen([executable], env={**os.environ, "ROS_DOMAIN_ID": str(DOMAIN)})
    try:
        node = rclpy.create_node(f"check_{name}")
        client = node.create_client(ListParameters, f"/{name}/list_parameters")
        assert client.wait_for_service(WAIT), f"{name} did not come up"
        answer = client.call_async(ListParameters.Request())
        rclpy.spin_until_future_complete(node, answer, timeout_sec=WAIT)
        assert answer.done(), f"{name} does not answer"
        node.destroy_node()
        process.send_signal(signal.SIGINT)
        code = process.wait(WAIT)
        assert code == 0, f"{name} ended with {code} on SIGINT"
    finally:
        process.kill()
        process.wait()


def main() -> None:
    """Run all checks."""
    prefix = Path(sys.argv[1]).resolve()
    check_files(prefix)
    subprocess.run([prefix / "lib" / PACKAGE / "tsepm", "--help"], check=True)
    rclpy.init(domain_id=DOMAIN)
    for name in NODES:
        check_node(prefix / "lib" / PACKAGE / name)
    rclpy.shutdown()
    print("executables, share files and nodes are in order")


if __name__ == "__main__":
    main()
