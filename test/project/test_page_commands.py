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
"""The commands of README and user pages that end by themselves within 20 s run as written."""

import re
import shlex
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from support.image_folder import GEOMETRY
from support.show import write_recording

from tsepm_ros.tools.commands.cli import main

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
pytestmark = pytest.mark.skipif(not DOCS.exists(), reason="only in the source tree")

CODE = re.compile(r"^```(\w*)\n(.*?)^```", re.DOTALL | re.MULTILINE)
COMMAND = re.compile(r"(\.venv/bin/)?(tsepm|ros2|make|python|git|rosdep|colcon|ssh|rviz2)\s")
NOT_RUN = {
    "until Ctrl-C": (
        r"ros2 run tsepm_ros (track_|sonar_|scan_player)"
        r"|tsepm (watch|record)|\S*python examples/"
    ),
    "of ROS 2 or the machine": r"git clone|rosdep|colcon|ros2 (launch|bag|run tf2_ros)|ssh|rviz2",
    "longer than 20 s": r"make demo|tsepm evaluate box --method score|tsepm design",
}
"""Commands that no test runs as they are written, and why."""


def pages() -> list[Path]:
    """README, and the pages outside of the papers, the reference and what contributors read."""
    text = (ROOT / ".ci" / "mkdocs.yml").read_text(encoding="utf-8")
    names = []
    for entry in yaml.safe_load(text[text.index("\nnav:") :])["nav"]:
        [(head, value)] = entry.items()
        if head not in ("Papers", "Reference", "Contributing"):
            names += [value] if isinstance(value, str) else [next(iter(p.values())) for p in value]
    return [ROOT / "README.md", *(DOCS / name for name in [*names, "methods.md"])]


def commands(block: str) -> list[str]:
    lines = re.sub(r"\\\n\s*", " ", block).splitlines()
    marked = [line.removeprefix("$ ") for line in lines if line.startswith("$ ")]
    return [line for line in marked or lines if COMMAND.match(line)]


BLOCKS = (
    {
        f"{page.stem} {number}": commands(block)
        for page in pages()
        for number, (kind, block) in enumerate(CODE.findall(page.read_text(encoding="utf-8")))
        if not kind and commands(block)
    }
    if DOCS.exists()
    else {}
)


def ends(command: str) -> bool:
    bare = command.removeprefix(".venv/bin/")
    return not any(re.match(pattern, bare) for pattern in NOT_RUN.values())


@pytest.fixture
def desk(tmp_path, monkeypatch):
    """A folder with what the commands read: a recording, a parameter file, images and a method."""
    rows = [f"{4 * k},{900 + 6 * k},0.3" for k in range(12)]
    ship = [f"{4 * k},0,0,0.5" for k in range(12)]
    own = "\n".join(["time_s,east_m,north_m,heading_rad", *ship, ""])
    detections = "\n".join(["time_s,range_m,azimuth_rad", *rows, ""])
    folder = Path(write_recording(tmp_path, detections=detections, own_ship=own))
    folder.rename(tmp_path / "trial")
    images = tmp_path / "images"
    images.mkdir()
    (images / "geometry.yaml").write_text(GEOMETRY)
    noise = np.random.default_rng(1).rayleigh(size=(30, 64, 200))
    np.save(images / "images.npy", noise)
    times = "\n".join(["time_s", *map(str, range(30)), ""])
    (images / "times.csv").write_text(times)
    methods = (DOCS / "methods.md").read_text(encoding="utf-8")
    (code,) = (code for kind, code in CODE.findall(methods) if "class Bold" in code)
    (tmp_path / "my_tracker.py").write_text(code)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("builtins.input", lambda *_: "")
    return SimpleNamespace(names={"RECORDING": "trial", "FOLDER": "images", "day1": "trial"})


def with_parameter_files(block: str) -> list[str]:
    """The commands of a block that end, after those of its page that write what they read."""
    lines, page = [*filter(ends, BLOCKS[block])], block.rpartition(" ")[0]
    read = re.findall(r"--params-file (\S+)", " ".join(lines))
    others = (line for name in BLOCKS if name.startswith(f"{page} ") for line in BLOCKS[name])
    return [*(one for one in others if any(f"tsepm init {name} " in one for name in read)), *lines]


@pytest.mark.parametrize(
    "block",
    [
        pytest.param(name, marks=pytest.mark.long if "evaluate" in " ".join(lines) else ())
        for name, lines in BLOCKS.items()
        if any(map(ends, lines))
    ],
)
def test_commands_that_end_by_themselves_run_as_written(block, desk, capsys):
    for line in with_parameter_files(block):
        program, *arguments = shlex.split(line, comments=True)
        assert program == "tsepm", f"{line} is neither run nor in NOT_RUN"
        code = main([desk.names.get(word, word) for word in arguments])
        assert code in (0, None), (line, capsys.readouterr().err)


def test_the_reasons_not_to_run_a_command_are_of_commands_on_pages():
    lines = [line.removeprefix(".venv/bin/") for lines in BLOCKS.values() for line in lines]
    for pattern in NOT_RUN.values():
        for part in re.sub(r"\(.*?\)", "", pattern).split("|"):
            assert any(re.match(part, line) for line in lines), part


def test_the_address_to_clone_is_that_of_the_manifest():
    manifest = (ROOT / "package.xml").read_text(encoding="utf-8")
    (address,) = re.findall(r'<url type="repository">(.+)</url>', manifest)
    assert f"git clone {address} src/tsepm_ros\n" in (ROOT / "README.md").read_text("utf-8")


def test_the_python_of_the_readme_prints_a_track(capsys):
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    (code,) = (code for kind, code in CODE.findall(text) if kind == "python")
    assert len([line for line in code.splitlines() if line]) <= 10
    exec(compile(code, "README.md", "exec"), {})
    (line,) = capsys.readouterr().out.splitlines()
    assert "3 hits in 3 pings" in line
