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
"""What tests with nodes share: a machine-local network, own domains, nodes and processes.

Without ROS it is imported too, so ROS is imported where a fixture is used.
"""

from __future__ import annotations

import itertools
import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

# Before anything initialises ROS: nothing leaves this machine or is written to the home directory.
os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
os.environ.setdefault("ROS_LOG_DIR", tempfile.mkdtemp(prefix="tsepm_ros_log_"))
os.environ.setdefault("FASTRTPS_DEFAULT_PROFILES_FILE", str(Path(__file__).parent / "fastdds.xml"))

from support.ros_domains import own_domain
from support.ros_process import RosProcess

if TYPE_CHECKING:
    from support.ros_world import World


@pytest.fixture
def domain() -> Iterator[int]:
    """A domain that no other test on this machine has now, or this process had lately."""
    with own_domain() as number:
        yield number


@pytest.fixture
def world(domain: int) -> Iterator[World]:
    from support.ros_world import World

    with World(domain) as made:
        yield made


@pytest.fixture
def recording(tmp_path: Path) -> str:
    """Folder of a recording of 20 scans from an own ship that lies still."""
    from support.show import write_recording

    rows = [f"{12 * scan},{1000 + scan},0.5" for scan in range(20)]
    detections = "\n".join(["time_s,range_m,azimuth_rad", *rows, ""])
    own_ship = "time_s,east_m,north_m\n0,0,0\n228,0,0\n"
    return write_recording(tmp_path, detections=detections, own_ship=own_ship)


@pytest.fixture
def start(domain: int, tmp_path: Path) -> Iterator[Callable[..., RosProcess]]:
    """Start an executable of the package in the test's domain; it is killed at the end."""
    with ExitStack() as stack:
        number = itertools.count()

        def start_process(
            name: str, parameters: dict[str, object] | None = None, **options: Any
        ) -> RosProcess:
            output = tmp_path / f"{name}_{next(number)}.txt"
            process = RosProcess(name, parameters or {}, domain, output, **options)
            return stack.enter_context(process)

        yield start_process
