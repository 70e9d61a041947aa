"""Nodes come and go in one process."""

from __future__ import annotations

import gc
import os
from dataclasses import dataclass
from pathlib import Path

import pytest
from support.boat import Boat
from support.ros_world import World
from support.sonar_driver import pings

from tsepm_ros.tools.players.scan_player import ScanPlayer
from tsepm_ros.tools.players.sonar_simulator import SonarSimulator


@dataclass(frozen=True)
class Used:
    """What this process uses."""

    threads: int
    files: int
    memory: int

    @classmethod
    def now(cls) -> Used:
        gc.collect()
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        return cls(
            threads=len(os.listdir("/proc/self/task")),
            files=len(os.listdir("/proc/self/fd")),
            memory=pages * os.sysconf("SC_PAGE_SIZE"),
        )


def live(domain: int, recording: Path) -> None:
    """Start every node, let the initiator work, and end them."""
    with World(domain) as world:
        boat = Boat(world)
        world.make(SonarSimulator)
        world.make(ScanPlayer, {"recording": str(recording)})
        boat.send(pings(6))


@pytest.mark.long
@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="needs /proc")
def test_twenty_rounds_leave_no_thread_or_file_or_memory_behind(domain, tmp_path):
    (tmp_path / "detections.csv").write_text("time_s,range_m,azimuth_rad\n0,1000,0.1\n")
    for _ in range(5):
        live(domain, tmp_path)
    before = Used.now()
    for _ in range(20):
        live(domain, tmp_path)
    after = Used.now()
    assert after.threads <= before.threads
    assert after.files <= before.files
    assert after.memory < before.memory + 20e6
