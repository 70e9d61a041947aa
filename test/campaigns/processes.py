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
"""Starts and ends of every node by SIGINT and SIGTERM at random times.

From the moment at which its handlers are set a node ends with code 0, without a traceback, within
`MOST_CPU`, and leaves nothing in shared memory. Before that moment the signal's own end is right.
"""

import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import campaign
import numpy as np
from campaign import Finding, Tried
from invariants import require
from support.ros_domains import own_domain
from support.ros_process import executable

NODES = (
    *("track_initiator", "sonar_detector", "sonar_simulator", "scan_player", "track_viewer"),
    "track_bridge",
)
LONGEST = 1.0
"""Longest time from the start, or from the setting of the handlers, to the signal, s."""
WAIT = 60.0
MOST_CPU = 0.3
"""Most CPU time from a signal to the end, s."""


def handlers_set(process: subprocess.Popen[bytes]) -> bool:
    """Whether a process catches SIGTERM now."""
    try:
        status = Path(f"/proc/{process.pid}/status").read_text()
    except OSError:
        return False
    caught = next(line for line in status.splitlines() if line.startswith("SigCgt"))
    return bool(int(caught.split()[1], 16) & 1 << (signal.SIGTERM - 1))


def segments(process: subprocess.Popen[bytes]) -> set[str]:
    """Segments of shared memory that only this process has made: not the ports' of a domain."""
    try:
        maps = Path(f"/proc/{process.pid}/maps").read_text()
    except OSError:
        return set()
    paths = {line.split()[-1] for line in maps.splitlines() if "/dev/shm/fastrtps_" in line}
    return {path for path in paths if "port" not in path}


def cpu_time(process: subprocess.Popen[bytes]) -> float:
    """CPU time of a process until now, s; 0 if it has ended."""
    try:
        fields = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def children() -> float:
    """CPU time of the processes that have ended, s."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _until_ready(process: subprocess.Popen[bytes]) -> None:
    end = time.monotonic() + WAIT
    while not handlers_set(process) and process.poll() is None and time.monotonic() < end:
        time.sleep(0.002)


def case(number: int, rng: np.random.Generator) -> Tried:
    """A start and an end of a node."""
    name = NODES[number % len(NODES)]
    signals = [signal.SIGINT, signal.SIGTERM]
    chosen = signals[number // len(NODES) % 2]
    delay = float(rng.uniform(0.0, LONGEST))
    with own_domain() as domain, tempfile.TemporaryDirectory(prefix="tsepm_ends_") as folder:
        process = _started(name, Path(folder), domain)
        try:
            if number % 5:  # in most cases from the first moment at which the end must be clean
                _until_ready(process)
            time.sleep(delay)
            ready, held = handlers_set(process), segments(process)
            before = cpu_time(process) + children()
            process.send_signal(chosen)
            if rng.random() < 0.3:
                time.sleep(float(rng.uniform(0.0, 0.05)))
                process.send_signal(signals[rng.integers(2)])
            code = process.wait(WAIT)
            used = children() - before
        except subprocess.TimeoutExpired:
            raise Finding(f"{name} does not end, {chosen.name} after {delay:.3f} s") from None
        finally:
            process.kill()
            process.wait()
        said = (Path(folder) / "output").read_text(errors="replace")
    where = f"{name}, {chosen.name} after {delay:.3f} s: code {code}, {said[-1500:]}"
    if ready:
        require(code == 0, where)
        require(used <= MOST_CPU, f"{where}; {used:.2f} s of CPU time after the signal")
        for word in ("Traceback", "terminate called", "Segmentation"):
            require(word not in said, where)
        left = [path for path in held if Path(path).exists()]
        require(not left, f"{where}; {left} left behind")
    else:
        require(code in (0, -signal.SIGINT, -signal.SIGTERM, 1, 130), where)
    return Counter({f"{name}, {chosen.name}, {'ready' if ready else 'too early'}": 1, "ends": 1})


def _started(name: str, folder: Path, domain: int) -> subprocess.Popen[bytes]:
    """The node in a domain, with something to do."""
    recording = folder / "recording"
    recording.mkdir()
    rows = [f"{2 * k},{3000 + k},0.5" for k in range(100)]
    (recording / "detections.csv").write_text("\n".join(["time_s,range_m,azimuth_rad", *rows, ""]))
    parameters = {
        "track_initiator": ["diagnostics_period:=0.05"],
        "sonar_simulator": ["rate_factor:=100.0", "loop:=true"],
        "scan_player": [f"recording:={recording}", "rate_factor:=100.0", "loop:=true"],
        "track_viewer": ["port:=0"],
    }.get(name, [])
    command = [executable(name), "--ros-args"]
    for text in parameters:
        command += ["-p", text]
    environment = {
        **os.environ,
        "ROS_DOMAIN_ID": str(domain),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_LOG_DIR": str(folder / "log"),
    }
    with (folder / "output").open("wb") as output:
        return subprocess.Popen(
            command, env=environment, stdin=subprocess.DEVNULL, stdout=output, stderr=output
        )


if __name__ == "__main__":
    sys.exit(campaign.main("processes", __doc__, case))
