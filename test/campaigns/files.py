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
"""Broken files and arguments, and what the commands say of them.

A case breaks one file in its bytes, lines or values, or the arguments of a command, in a process
with limits and in a folder of its own; or it replaces up to three numbers of learned values.
"""

import contextlib
import functools
import os
import re
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

import campaign
import numpy as np
from campaign import Tried
from invariants import require
from support import learned_texts
from support.bag_files import simulated, small_scenario, storage_file, write_bag

from tsepm_ros.settings.parameter_files import ANY_NODE
from tsepm_ros.settings.settings import TRACK_INITIATOR, make_groups, settings_from
from tsepm_ros.tools.commands.cli import COMMANDS, main
from tsepm_ros.tools.commands.given_parameters import given_parameters_as_yaml, given_parameters_for
from tsepm_ros.tools.commands.run_command import OUTPUTS
from tsepm_ros.tools.simulation import shipped_scenarios

LIMIT = 60
"""Processor time of a command, s."""
MEMORY = 3 * 2**30
"""Address space of a command, bytes."""
WRONG_RUN = ("evaluate", "box", "--method", "heuristic", "--runs", "2", "--scans", "4")
TOKENS = (
    *("nan", "inf", "-inf", "1e308", "1e-308", "1e999", "-1", "0", "1e18", "9" * 400, "0x10", ""),
    *("null", "true", "[]", "{}", "[" * 300, "{a: " * 200, "&a [*a, *a]", "*a", "!!python/name:os"),
    *("!!python/object/apply:os.system ['touch pwned']", "\x00", "\ufeff", "\udcff", '"', "'", ","),
    *("2024-01-01", "1_000", "~", "..", "../../pwned", "/etc/passwd", "x" * 100_000, "é" * 50),
)
BOMB = "\n".join(
    ["a: &a [x, x, x, x, x, x, x, x, x]"]
    + [
        f"{b}: &{b} [{', '.join(f'*{a}' for _ in range(9))}]"
        for a, b in zip("abcdefgh", "bcdefghi", strict=True)
    ]
)
Command = Callable[[Path], Sequence[str] | Callable[[], object]]


TABLES = {
    "detections": [
        "time_s,range_m,azimuth_rad,range_std_m,intensity",
        *(f"{12.0 * k},{3000.0 + 5.0 * k},{0.5 + 0.001 * k},20.0,{k % 3}.5" for k in range(8)),
    ],
    "own_ship": [
        "time_s,east_m,north_m,east_mps,heading_rad",
        *(f"{2.0 * k - 6.0},{k}.0,0.0,0.5,{0.01 * k}" for k in range(60)),
    ],
    "target": ["time_s,east_m,north_m", *(f"{12.0 * k},2000.0,{1500.0 + k}" for k in range(8))],
}
"""Lines of a recording's files."""
FOLDERS = {
    "arrays": "range: [1, 60]\nazimuth: [-1.0, 1.0]\nfalse_detections_per_ping: 3.0\n",
    "pictures": "near_range: 1.0\nfar_range: 24.0\nazimuth: [1, -1]\nrows: fan\nport_first: true\n",
}
"""Geometries of folders of images."""


@functools.cache
def originals() -> Path:
    """Good files of every kind, made once."""
    folder = Path(tempfile.mkdtemp(prefix="tsepm_files_"))
    (folder / "recording").mkdir()
    for name, lines in TABLES.items():
        (folder / "recording" / f"{name}.csv").write_text("\n".join([*lines, ""]))
    for storage in ("mcap", "sqlite3"):
        write_bag(folder / storage, simulated(small_scenario(scans=4)), storage)
    rng = np.random.default_rng(3)
    for name, text in FOLDERS.items():
        (folder / name).mkdir()
        (folder / name / "geometry.yaml").write_text(text)
        images = rng.rayleigh(20.0, (3, 24, 60)).astype(np.uint8)
        names = [f"{k}.{'pgm' if name == 'pictures' else 'npy'}" for k in range(3)]
        rows = [f"{k}.5,{one}" for k, one in enumerate(names)]
        (folder / name / "times.csv").write_text("\n".join(["time_s,file", *rows, ""]))
        for one, image in zip(names, images, strict=True):
            if name == "arrays":
                np.save(folder / name / one, image)
            else:
                (folder / name / one).write_bytes(b"P5\n60 24\n255\n" + image.tobytes())
    scenarios = Path(campaign.ROOT) / "tsepm_ros" / "tools" / "simulation" / "scenarios"
    for name in shipped_scenarios():
        text = (scenarios / f"{name}.yaml").read_text()
        (folder / f"{name}.yaml").write_text(re.sub(r"scans: \d+", "scans: 3", text))
    (folder / "parameters.yaml").write_text(
        given_parameters_as_yaml("track_initiator", TRACK_INITIATOR, ANY_NODE)
    )
    (folder / "learned.json").write_text(learned_texts.learned_text(learned_texts.SCENES[0]))
    out = folder / "runs"
    code, _, error = run([*WRONG_RUN, "--workers", "1", "--out", str(out)], folder)
    require(code == 0, f"the evaluation that is to be broken fails: {error}")
    for kind, (_, command) in KINDS.items():
        code, _, error = run(command(folder), folder)
        require(code == 0, f"{kind} is refused before it is broken: {error}")
    return folder


def run(given: Sequence[str] | Callable[[], object], folder: Path) -> tuple[int, str, str]:
    """Run a command, or a function, in a process with limits; its code, output and errors."""
    outputs = [folder / "stdout", folder / "stderr"]
    child = os.fork()
    if child:
        end = time.monotonic() + 10 * LIMIT
        while time.monotonic() < end:
            ended, status = os.waitpid(child, os.WNOHANG)
            if ended:
                texts = [path.read_text(errors="replace") for path in outputs]
                return os.waitstatus_to_exitcode(status), *texts
            time.sleep(0.002)
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        return -signal.SIGALRM, "", "it hangs"
    signal.alarm(0)
    code = 99
    with contextlib.suppress(BaseException):
        for path, descriptor in zip(outputs, (1, 2), strict=True):
            os.dup2(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), descriptor)
        os.chdir(folder)
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        resource.setrlimit(resource.RLIMIT_CPU, (LIMIT, LIMIT))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        try:
            code = main(given) if not callable(given) else _called(given)
        except SystemExit as error:
            code = error.code if isinstance(error.code, int) else 98
        except BaseException:
            traceback.print_exc()
        sys.stdout.flush()
        sys.stderr.flush()
    os._exit(code)


def _called(function: Callable[[], object]) -> int:
    """Call a reader, whose refusals are ValueErrors and OSErrors."""
    try:
        function()
    except (ValueError, OSError) as error:
        print(f"refused: {error}", file=sys.stderr)
        return 2
    return 0


def _parameters(folder: Path) -> Callable[[], object]:
    path = folder / "parameters.yaml"
    return lambda: settings_from(
        make_groups(TRACK_INITIATOR, given_parameters_for(path, "/track_initiator"))
    )


def _learned(folder: Path) -> Callable[[], object]:
    text = folder / "learned.json"
    return lambda: learned_texts.read(learned_texts.SCENES[0], text.read_text(encoding="utf-8"))


def _run(name: str) -> Command:
    return lambda folder: ["run", str(folder / name)]


def _runs(folder: Path) -> Sequence[str]:
    return [*WRONG_RUN, "--workers", "1", "--out", str(folder / "runs")]


KINDS: dict[str, tuple[str, Command]] = {
    **{f"{one}.csv": (f"recording/{one}.csv", _run("recording")) for one in TABLES},
    "mcap": ("mcap/*.mcap", _run("mcap")),
    "mcap alone": ("mcap/*.mcap", lambda folder: ["run", str(storage_file(folder / "mcap"))]),
    "sqlite3": ("sqlite3/*.db3", _run("sqlite3")),
    "metadata": ("mcap/metadata.yaml", _run("mcap")),
    **{f"geometry of {one}": (f"{one}/geometry.yaml", _run(one)) for one in FOLDERS},
    **{f"times of {one}": (f"{one}/times.csv", _run(one)) for one in FOLDERS},
    "array": ("arrays/*.npy", _run("arrays")),
    "picture": ("pictures/*.pgm", _run("pictures")),
    "parameters": ("parameters.yaml", _parameters),
    "learned": ("learned.json", _learned),
    "runs": ("runs/**/*.jsonl", _runs),
    **{f"scenario {name}": (f"{name}.yaml", _run(f"{name}.yaml")) for name in shipped_scenarios()},
}
"""The file to break and what reads it, by kind."""


def broken(content: bytes, rng: np.random.Generator) -> bytes:
    """The content with one to three faults."""
    for _ in range(int(rng.integers(1, 4))):
        content = FAULTS[rng.integers(len(FAULTS))](content, rng)
    return content


def _cut(content: bytes, rng: np.random.Generator) -> bytes:
    return content[: int(rng.integers(len(content) + 1))]


def _flip(content: bytes, rng: np.random.Generator) -> bytes:
    changed = bytearray(content)
    for place in rng.integers(0, max(1, len(content)), int(rng.integers(1, 9))).tolist():
        if place < len(changed):
            changed[place] = int(rng.integers(256))
    return bytes(changed)


def _lines(content: bytes, rng: np.random.Generator) -> bytes:
    """A line is repeated, removed or moved."""
    lines = content.split(b"\n")
    place, other = rng.integers(0, len(lines), 2).tolist()
    line = lines.pop(place) if rng.random() < 0.6 else lines[place]
    if rng.random() < 0.6:
        lines.insert(other, line)
    return b"\n".join(lines)


def _cut_line(content: bytes, rng: np.random.Generator) -> bytes:
    """A line, mostly the last one, has lost its end."""
    lines = content.rstrip(b"\n").split(b"\n")
    place = -1 if rng.random() < 0.6 else int(rng.integers(len(lines)))
    lines[place] = lines[place][: int(rng.integers(len(lines[place]) + 1))]
    return b"\n".join(lines)


def _token(content: bytes, rng: np.random.Generator) -> bytes:
    """A word or a number becomes another text."""
    found = list(re.finditer(rb"[\w.+-]+", content[:200_000]))
    if not found:
        return content
    match = found[rng.integers(len(found))]
    token = TOKENS[rng.integers(len(TOKENS))].encode(errors="surrogateescape")
    return content[: match.start()] + token + content[match.end() :]


def _block(content: bytes, rng: np.random.Generator) -> bytes:
    """A block of bytes is zero, repeated or removed, as by a bad disk."""
    size = int(rng.integers(1, 600))
    start = int(rng.integers(len(content) + 1))
    middle = [bytes(size), content[start : start + size] * 2, b""][rng.integers(3)]
    return content[:start] + middle + content[start + size :]


def _other(content: bytes, rng: np.random.Generator) -> bytes:
    """Something else altogether."""
    return [b"", b"\n", BOMB.encode(), b"- 1\n", b"1", b"\xff\xfe", bytes(5000)][rng.integers(7)]


FAULTS = (_cut, _cut_line, _flip, _lines, _token, _token, _token, _block, _other)


def case(number: int, rng: np.random.Generator) -> Tried:
    """A broken file or, for three of eight cases, arguments, learned values or files of others."""
    if number % 8 == 6:
        return learned_texts.check_replaced(number // 8, rng)
    with tempfile.TemporaryDirectory(prefix="tsepm_case_") as name:
        folder = Path(name)
        if number % 8 == 5:
            return others(folder, rng)
        if number % 8 == 7:
            return _judged("arguments", arguments(rng), folder)
        kind = list(KINDS)[number % len(KINDS)]
        pattern, command = KINDS[kind]
        for source in originals().iterdir():
            if source.name.split(".")[0] == pattern.split("/")[0].split(".")[0]:
                _copy(source, folder / source.name)
        paths = sorted(folder.glob(pattern))
        path = paths[rng.integers(len(paths))]
        path.write_bytes(broken(path.read_bytes(), rng))
        return _judged(kind, command(folder), folder)


def others(folder: Path, rng: np.random.Generator) -> Tried:
    """A file of others that has the name of a result stays as it is."""
    files = [path for path in sorted(originals().rglob("*")) if path.is_file()]
    files = [path for path in files if "runs" not in path.parts]  # results themselves
    content = broken(files[rng.integers(len(files))].read_bytes(), rng)
    path = folder / "out" / str(rng.choice(OUTPUTS))
    path.parent.mkdir()
    path.write_bytes(content)
    run_it = ["run", str(originals() / "recording"), "--out", str(folder / "out")]
    tried = _judged("file of others", run_it, folder)
    require(not content or path.read_bytes() == content, f"{path.name} was replaced")
    require(not content or tried["file of others, refused"] == 1, f"{path.name} was not refused")
    return tried


def _copy(source: Path, target: Path) -> None:
    if source.is_dir():
        shutil.copytree(source, target)
    else:
        shutil.copy(source, target)


def arguments(rng: np.random.Generator) -> list[str]:
    """Arguments of a command, of which some are nonsense."""
    command = str(rng.choice(list(COMMANDS)))
    usable = ["box", "--runs", "1", "--out", "out", "-p", "method:=tsepm", "--seed", "2"]
    words = [
        *usable,
        *("--scene", "name:=", "a:=b", "sensor.max_range:=1e9", "max_speed:=", "=", "-p", "--"),
        *("--runs", "0", "-1", "--seed", "x", "--workers", "0", "--method", "nonsense"),
        *("--horizon", "run.png", "missing/", "/dev/null", "--scans"),
        *(token for token in TOKENS if "\x00" not in token and len(token) < 2000),
    ]
    # Without a command that simulates for long: a nonsense word is among them.
    chosen = rng.choice(words, int(rng.integers(0, 5))).tolist()
    return [command, *chosen, "--no-such-argument"]


def _judged(kind: str, given: Sequence[str] | Callable[[], object], folder: Path) -> Tried:
    """Run, and check the end."""
    code, _, error = run(given, folder)
    what = f"{kind}: code {code}, {error[-1500:]!r}"
    require("Traceback" not in error, f"{kind}: a traceback: {error[-1500:]}")
    require(0 <= code <= 2, what)
    require(not list(folder.rglob("pwned")), f"{kind}: it ran code of the file")
    lines = [line for line in error.splitlines() if line.startswith(("refused:", "failed:"))]
    if code and kind != "arguments":
        require(len(lines) == 1 and error.splitlines()[-1] == lines[0], what)
        require(len(lines[0]) < 1000, f"{kind}: the sentence is long: {lines[0][:1000]}")
    leftovers = [path for path in folder.rglob(".*.part*")]
    require(not leftovers, f"{kind}: {leftovers} left behind")
    return Counter({"files": 1, f"{kind}, {'refused' if code else 'read'}": 1})


if __name__ == "__main__":
    try:
        sys.exit(campaign.main("files", __doc__, case))
    finally:
        if originals.cache_info().currsize:
            shutil.rmtree(originals(), ignore_errors=True)
