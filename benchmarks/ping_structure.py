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
"""What one ping and one image run through: calls, functions and files of the package.

    python benchmarks/ping_structure.py

The ping is the first of the scene `box` (seed 1) from the 60th on after which one confirmed track
is held. Named functions count, not comprehensions, generators or lambdas. The first line is of the
node, from the message to the publication of its results; the second of `Tracker.process` alone.
The images are the last of a sonar at rest and of one that moves, in `Detector.process`. Each line
has the budget of its calls, and the calls aimed at; more calls than the budget are an error.
"""

from __future__ import annotations

import argparse
import itertools
import os
import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import CodeType, FrameType

os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")

import rclpy
from compare_commits import Images
from rclpy.parameter import Parameter

import msg_adapters
import tsepm_ros
from msg_adapters import detections_cloud, make_header
from tsepm_ros.nodes.track_initiator import TrackInitiator
from tsepm_ros.tools.simulation import Simulator, load_scenario

FIRST = 60
OURS = tuple(str(Path(package.__file__).parent) for package in (tsepm_ros, msg_adapters))
VERB = ("tracker.py", "process")
"""File and name of the function that processes a scan."""
IMAGES = 40
"""Images of which the last one counts."""
BUDGETS = {
    "ping, message to publication": (555, 500),
    "ping, in process": (388, 400),
    "image, fixed": (248, 250),
    "image, moving": (297, 300),
}
"""Calls at most, lowered with what is merged, and calls aimed at."""


@contextmanager
def counted() -> Iterator[tuple[Counter[CodeType], Counter[CodeType]]]:
    """Calls of package functions in the block: all, and those within the verb."""
    every: Counter[CodeType] = Counter()
    within: Counter[CodeType] = Counter()
    depth = 0

    def profile(frame: FrameType, event: str, _: object) -> None:
        nonlocal depth
        code = frame.f_code
        if not code.co_filename.startswith(OURS):
            return
        verb = (Path(code.co_filename).name, code.co_name) == VERB
        if event == "call" and not code.co_name.startswith("<"):
            every[code] += 1
            within[code] += depth > 0 or verb
        depth += verb * {"call": 1, "return": -1}.get(event, 0)

    sys.setprofile(profile)
    try:
        yield every, within
    finally:
        sys.setprofile(None)


def told(name: str, calls: Counter[CodeType]) -> bool:
    """Print numbers of calls, functions and files; whether the calls are within their budget."""
    called = [code for code, number in calls.items() if number]
    files = {code.co_filename for code in called}
    budget, aim = BUDGETS[name]
    print(
        f"{name}: {calls.total()} calls of {len(called)} functions in {len(files)} files; "
        f"at most {budget}, aim {aim}"
    )
    return calls.total() <= budget


def ping() -> bool:
    """Run the scene through a node; whether its calls are within their budgets."""
    rclpy.init(domain_id=os.getpid() % 100 + 1)
    scenario = replace(load_scenario("box"), scans=200)
    sensor = {f"sensor.{name}": value for name, value in vars(scenario.sensor).items()}
    node = TrackInitiator(
        parameter_overrides=[Parameter(name, value=value) for name, value in sensor.items()]
    )
    within = False
    for index, simulated in enumerate(Simulator(scenario, 1), 1):
        scan = simulated.scan
        header = make_header(round(scan.stamp * 1e9), "sonar")
        message = detections_cloud(header, range=scan.range, azimuth=scan.azimuth)
        with counted() as (every, of_verb):
            node.take_detections(message)
        if index >= FIRST and len(node._session.tracker.current.sure) == 1:
            names = "ping, message to publication", "ping, in process"
            within = all([told(*line) for line in zip(names, (every, of_verb), strict=True)])
            break
    node.destroy_node()
    rclpy.try_shutdown()
    return within


def image(moves: bool) -> bool:
    """Run images through a detector; whether the calls of the last are within their budget."""
    detector = tsepm_ros.make_detector()
    *before, last = (
        tsepm_ros.SonarImage(**drawn)
        for drawn in itertools.islice(Images(128, 400, moves).drawn(1), IMAGES)
    )
    for one in before:
        detector.process(one)
    with counted() as (every, _):
        detector.process(last)
    return told(f"image, {'moving' if moves else 'fixed'}", every)


def main() -> int:
    """Print, and end with 1 where a budget is exceeded."""
    argparse.ArgumentParser(description=__doc__.splitlines()[0]).parse_args()
    return int(not all([ping(), image(False), image(True)]))


if __name__ == "__main__":
    sys.exit(main())
