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
"""Nodes come and go in one process."""

from __future__ import annotations

import gc
import os
from pathlib import Path

import pytest
from support.boat import Boat
from support.ros_world import World
from support.sonar_driver import pings

from tsepm_ros.tools.players.scan_player import ScanPlayer
from tsepm_ros.tools.players.sonar_simulator import SonarSimulator


def used() -> tuple[int, int, int]:
    """Threads, open files and resident pages of this process."""
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return len(os.listdir("/proc/self/task")), len(os.listdir("/proc/self/fd")), pages


def live(domain: int, recording: str) -> None:
    """Start every node, let the initiator work, and end them."""
    with World(domain) as world:
        boat = Boat(world)
        world.make(SonarSimulator)
        world.make(ScanPlayer, {"recording": recording})
        boat.send(pings(6))


@pytest.mark.long
@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="needs /proc")
def test_twenty_rounds_leave_no_thread_or_file_or_memory_behind(domain, recording):
    for _ in range(5):
        live(domain, recording)
    threads, files, pages = used()
    for _ in range(20):
        live(domain, recording)
    now_threads, now_files, now_pages = used()
    assert now_threads <= threads
    assert now_files <= files
    assert (now_pages - pages) * os.sysconf("SC_PAGE_SIZE") < 20e6
