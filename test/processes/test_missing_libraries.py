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
"""The node needs few libraries; what needs more says in one sentence what is missing."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from sensor_msgs.msg import PointCloud2
from support import missing
from support.bag_files import simulated, write_bag
from support.patience import WAIT
from support.sonar_driver import Driver, pings

from msg_adapters import read_track_cloud
from msg_adapters.messages import PACKAGES

ROOT = Path(__file__).parents[2]
OPTIONAL = (
    *("tqdm", "matplotlib", "PIL", "tornado", "rosbags", "rosbag2_py", "tf2_ros"),
    *("stonesoup", "autoware_perception_msgs", "marine_acoustic_msgs", "radar_msgs", "vision_msgs"),
)
"""Modules without which the node works."""
HIGHER_STOREYS = ("tsepm_ros.tools", "tsepm_ros.studies")
PYTHON_PACKAGES = {"python3-numpy": "numpy", "python3-scipy": "scipy", "python3-yaml": "yaml"}


def test_the_node_runs_without_any_library_of_the_tools(world, start):
    script = missing.script("track_initiator", (*OPTIONAL, *HIGHER_STOREYS))
    node = start("track_initiator", script=script)
    driver, tracks = world.add(Driver(world.context)), world.listen(PointCloud2, "tracks")
    world.until(lambda: world.observer.count_subscribers("detections"), "the node")
    world.until_connected()
    for ping in pings(14):
        driver.ping(ping)
    world.until(lambda: any(message.width for message in tracks), "a track")
    points = np.concatenate([read_track_cloud(message) for message in tracks])
    assert np.hypot(points["x"] - 3000.0, points["y"] - 1500.0).min() < 1000.0  # the target
    node.interrupt()
    assert node.exit_code() == 0
    assert "Traceback" not in node.said


def imported(folder: Path) -> set[str]:
    """Top-level modules that the modules below a folder import."""
    names: set[str] = set()
    for path in folder.rglob("*.py"):
        if {"tools", "studies"} & set(path.relative_to(ROOT).parts):
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                names |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                names.add(node.module or "")
    return {name.partition(".")[0] for name in names}


@pytest.mark.skipif(not (ROOT / "package.xml").exists(), reason="only in the source tree")
def test_the_manifest_names_first_what_the_node_imports():
    manifest = (ROOT / "package.xml").read_text(encoding="utf-8")
    needed = re.findall("<exec_depend>(.+)</exec_depend>", manifest.partition("Format 3")[0])
    modules = imported(ROOT / "tsepm_ros") | imported(ROOT / "msg_adapters")
    modules |= set(PACKAGES.values())  # imported when they are first used
    others = modules - sys.stdlib_module_names - {"tsepm_ros", "msg_adapters", *OPTIONAL}
    assert {PYTHON_PACKAGES.get(name, name) for name in needed} == others


def outcome(executable: str, without: str, *arguments: str) -> tuple[int, str]:
    """Exit code and standard error of an executable without some modules."""
    command = [sys.executable, "-c", missing.script(executable, tuple(without.split())), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=WAIT)
    assert "Traceback" not in done.stderr
    return done.returncode, done.stderr


def parameters(**values: object) -> list[str]:
    given = (("-p", f"{name}:={value}") for name, value in values.items())
    return ["--ros-args", *(part for pair in given for part in pair)]


BAG = "bag_of_the_test"
RUN = ("run", "four_targets")
FROM_TF = parameters(own_ship_source="tf", fixed_frame="map")


@pytest.mark.long
@pytest.mark.parametrize(
    ("executable", "without", "arguments", "named"),
    [
        ("tsepm", "matplotlib", [*RUN, "--picture", "p.png"], "need matplotlib"),
        ("tsepm", "tornado", ["watch", "four_targets"], "pip install tornado"),
        ("tsepm", "rclpy", ["watch"], "live topics need ROS 2"),
        ("tsepm", "rosbags rosbag2_py", ["run", BAG], "pip install rosbags"),
        ("track_viewer", "tornado", [], "pip install tornado"),
        ("track_initiator", "tf2_ros", FROM_TF, "tf2_ros is not installed"),
        ("track_initiator", "scipy", [], "No module named 'scipy'"),
    ],
    ids=str,
)
def test_a_tool_says_in_one_sentence_what_is_missing(
    tmp_path, monkeypatch, executable, without, arguments, named
):
    monkeypatch.chdir(tmp_path)
    if BAG in " ".join(arguments):
        write_bag(tmp_path / BAG, simulated())
    code, said = outcome(executable, without, *arguments)
    assert code in (1, 2)
    assert named in said.splitlines()[-1]


@pytest.mark.long
def test_a_run_without_libraries_does_what_it_can(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    without = "matplotlib PIL rosbags tornado rclpy tqdm"
    code, written = outcome("tsepm", without, *RUN, "--out", "o", "--html", "page.html")
    assert code == 0
    assert "no picture: it needs matplotlib" in written and "page: page.html" in written
