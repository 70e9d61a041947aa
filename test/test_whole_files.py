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
"""Files are written whole or not at all."""

import ast
import math
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tsepm_ros.tools.replay import track_files
from tsepm_ros.tools.replay.image_folder import IMAGE_FIELDS
from tsepm_ros.tools.replay.recording import DETECTION_COLUMNS
from tsepm_ros.tools.viewer import gates
from tsepm_ros.whole_files import (
    OwnedFile,
    opened_whole,
    read_json,
    read_whole_csv,
    refuse_overwriting_inputs,
    temporary_beside_file,
    write_whole_picture,
    write_whole_text,
    written_whole,
)

ROOT = Path(__file__).parents[1]


def test_a_file_appears_when_it_is_whole(tmp_path):
    path = tmp_path / "a.csv"
    with opened_whole(path) as file:
        file.write("1,2\n")
        file.flush()
        assert not path.exists()
    assert path.read_bytes() == b"1,2\n"
    assert os.listdir(tmp_path) == ["a.csv"]


@pytest.mark.parametrize("earlier", [None, "earlier"])
def test_an_error_leaves_what_was_there(tmp_path, earlier):
    path = tmp_path / "a.csv"
    if earlier:
        path.write_text(earlier)
    with pytest.raises(OSError, match="full"), opened_whole(path) as file:
        file.write("half")
        raise OSError("disk full")
    assert os.listdir(tmp_path) == (["a.csv"] if earlier else [])
    assert not earlier or path.read_text() == earlier


def test_the_file_of_a_living_writer_is_left_to_it(tmp_path):
    path = tmp_path / "a.csv"
    with written_whole(path) as one, written_whole(path) as other:
        one.write_text("one")
        other.write_text("other")
        for process in (os.getpid(), os.getppid(), 1):  # the first process is root's
            beside = tmp_path / f".a.csv.{process}-01234567.part.csv"
            beside.touch()
            temporary_beside_file(path)
            assert beside.exists()
            beside.unlink()
    assert path.read_text() == "one"
    assert os.listdir(tmp_path) == ["a.csv"]


def test_a_full_disk_leaves_what_was_there(tmp_path):
    """A limit on the size of files stands for the disk."""
    path = tmp_path / "a.txt"
    path.write_text("earlier")
    script = (
        "import resource, signal, pathlib, sys\n"
        "sys.dont_write_bytecode = True\n"  # what the limit cuts would stay
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))\n"
        "from tsepm_ros.whole_files import write_whole_text\n"
        "write_whole_text(pathlib.Path(sys.argv[1]), 'x' * 100000)\n"
    )
    ended = subprocess.run([sys.executable, "-c", script, str(path)], capture_output=True)
    assert ended.returncode == 1 and b"OSError" in ended.stderr
    assert path.read_text() == "earlier"
    assert os.listdir(tmp_path) == ["a.txt"]


def test_a_kill_leaves_what_was_there_and_the_next_writer_cleans_up(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("earlier")
    script = (
        "import os, signal, pathlib, sys\n"
        "from tsepm_ros.whole_files import opened_whole\n"
        "with opened_whole(pathlib.Path(sys.argv[1])) as file:\n"
        "    file.write('half'); file.flush(); os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    ended = subprocess.run([sys.executable, "-c", script, str(path)])
    assert ended.returncode == -signal.SIGKILL
    assert path.read_text() == "earlier"
    assert len(os.listdir(tmp_path)) == 2
    other = temporary_beside_file(tmp_path / "a.txt.b")  # of another file, and in use
    other.touch()
    write_whole_text(path, "later")
    assert path.read_text() == "later"
    assert sorted(os.listdir(tmp_path)) == sorted(["a.txt", other.name])


def test_links_devices_permissions_and_suffixes_are_as_with_a_plain_file(tmp_path):
    plain, path = tmp_path / "plain", tmp_path / "a.txt"
    plain.write_text("x")
    write_whole_text(path, "x")
    assert path.stat().st_mode == plain.stat().st_mode
    link = tmp_path / "link"
    link.symlink_to(path)
    write_whole_text(link, "y")
    assert link.is_symlink() and path.read_text() == "y"
    write_whole_text(Path(os.devnull), "z")
    assert not Path(os.devnull).is_file()
    with written_whole(tmp_path / "a.png") as temporary:
        assert temporary.suffix == ".png" and temporary.parent == tmp_path
        temporary.touch()


TRACKS = ",".join(track_files.COLUMNS)
OTHERS = {
    "tracks.csv": "stamp,track_id,x,y\n1,2,3,4\n",
    "current.csv": f"{TRACKS},label\n",
    "truth.csv": "stamp,target_id,x,y\n1,2,3,4\n",
    "crossings.csv": "stamp,track_id,gate,direction,x,y,label\n",
    "detections.csv": "scan,time_s,range_m,azimuth_rad,range_std_m,label\n",
    "picture.png": "\x89PNG\r\n\x1a\n a photograph",
    "notes.md": "# What I think of tsepm_ros\n",
    "tracks.geojson": '{"type": "FeatureCollection", "features": []}',
    "result.json": '{"tsepm_ros": 1}',
    "page.html": "<!DOCTYPE html>\n<title>tsepm_ros</title>",
    "tracks.nmea": "$RATTM,01,*00\r\n$RATLL,01,*00\r\n",
    "tracks.mcap": "\x89MCAP0\r\n /detections /tracks MCAP0\r\n",
}


@pytest.mark.parametrize("name", OTHERS)
def test_a_file_of_others_is_no_output(tmp_path, name):
    path = tmp_path / name
    refuse_overwriting_inputs([], [path])
    path.write_bytes(b"")
    refuse_overwriting_inputs([], [path])  # nothing is lost
    path.write_text(OTHERS[name], encoding="latin-1")
    remedy = "0.4.0 and earlier.*give another output, or move or remove the file"
    with pytest.raises(ValueError, match=f"{name} is not known as a result of tsepm.*{remedy}"):
        refuse_overwriting_inputs([], [path])
    with pytest.raises(ValueError, match=f"{name} is read here"):
        refuse_overwriting_inputs([path], [path])
    refuse_overwriting_inputs([], [path], own=path.read_bytes()[:5])


@pytest.mark.parametrize(
    "header",
    [
        *(f"{TRACKS}{more}" for more in ("", ",sensor", ",reason", ",sensor,reason")),
        ",".join(["scan", "time_s", *map(DETECTION_COLUMNS.__getitem__, IMAGE_FIELDS)]),
        gates.HEAD,
    ],
)
def test_the_tables_of_a_run_are_known_by_their_whole_header(tmp_path, header):
    (tmp_path / "a.csv").write_text(f"{header}\n1,2\n")
    refuse_overwriting_inputs([], [tmp_path / "a.csv"])


@pytest.mark.parametrize("suffix", ["png", "svg", "pdf", "eps"])
def test_a_picture_bears_the_signature_where_its_format_has_room_for_it(tmp_path, suffix):
    figure = pytest.importorskip("matplotlib.figure").Figure()
    path, other = tmp_path / f"a.{suffix}", tmp_path / f"b.{suffix}"
    write_whole_picture(path, figure)
    refuse_overwriting_inputs([], [path])
    with written_whole(other) as temporary:
        figure.savefig(temporary)
    with pytest.raises(ValueError, match="is not known"):
        refuse_overwriting_inputs([], [other])


@pytest.mark.parametrize("text", ["[" * 100_000, "{", b"\xff", "1" * 5000 + "x", "nan"])
def test_what_is_no_json_is_a_value_error(text):
    with pytest.raises(ValueError):
        read_json(text)


def test_a_number_beyond_any_float_is_infinite():
    assert read_json(f"[{'9' * 400}, -{'9' * 5000}, 7]") == [math.inf, -math.inf, 7]


def test_a_line_of_a_table_that_is_cut_is_named(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("a,b\n1,2\n\n3\n")
    with pytest.raises(ValueError, match=r"a.csv, line 4: expected 2 values, got \['3'\]"):
        read_whole_csv(path, ["a"])


def test_of_two_columns_of_one_name_none_is_taken_in_silence(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("a,b, a\n1,2,3\n")
    assert len(read_whole_csv(path, ["b"])) == 2, "nobody reads it"
    with pytest.raises(ValueError, match=r"a\.csv has two columns 'a': rename or remove the wrong"):
        read_whole_csv(path, ["a"])
    path.write_text("a_deg,a_rad\n1,2\n")
    with pytest.raises(ValueError, match="two columns 'a_rad'"):
        read_whole_csv(path, ["a_rad"])


def test_the_bytes_of_a_name_that_are_no_utf_8_are_written_as_they_are(tmp_path):
    write_whole_text(tmp_path / "a", os.fsdecode(b"M\xfcller"))
    assert (tmp_path / "a").read_bytes() == b"M\xfcller"


def owned(path: Path) -> OwnedFile:
    return OwnedFile(path, re.compile(b"mine"), 1000)


def test_a_file_has_one_owner_at_a_time_also_while_it_is_replaced(tmp_path):
    path = tmp_path / "deeper" / "a"
    one, other = owned(path), owned(path)
    assert one.read() == other.read() == ""
    assert not path.parent.exists(), "a look makes nothing"
    for text in ("mine 1", "mine 2"):
        one.write(text)
        for act in (other.read, other.remove, lambda: other.write("mine 3")):
            with pytest.raises(OSError, match="another node uses it"):
                act()
        assert path.read_text() == one.read() == text
    one.hold(None)
    other.write("mine 3")
    with pytest.raises(OSError, match="another node uses it"):
        one.write("mine 4")
    other.remove()
    assert os.listdir(path.parent) == []
    one.write("mine 5")
    assert other.path.read_text() == "mine 5"


def test_the_lock_of_an_owner_ends_with_its_process(tmp_path):
    path = tmp_path / "a"
    script = (
        "import os, pathlib, re, signal, sys\n"
        "from tsepm_ros.whole_files import OwnedFile\n"
        "file = OwnedFile(pathlib.Path(sys.argv[1]), re.compile(b'mine'), 1000)\n"
        "file.write('mine 1')\n"
        "print('written', flush=True)\n"
        "signal.pause()\n"
    )
    with subprocess.Popen([sys.executable, "-c", script, str(path)], stdout=subprocess.PIPE) as one:
        assert one.stdout is not None and one.stdout.readline()
        with pytest.raises(OSError, match="another node uses it"):
            owned(path).write("mine 2")
        one.kill()
    owned(path).write("mine 2")
    assert path.read_text() == "mine 2"


@pytest.mark.parametrize("content", ["boat: 1\n", "x" * 1001])
def test_a_file_of_others_is_never_owned_also_if_it_comes_later(tmp_path, content):
    path = tmp_path / "a"
    path.write_text(content)
    file = owned(path)
    for act in (file.read, file.remove, lambda: file.write("mine")):
        with pytest.raises(OSError, match="file of others"):
            act()
    assert path.read_text() == content
    path.unlink()
    file.write("mine")
    path.write_text(content)  # in place, as cp does
    with pytest.raises(OSError, match="file of others"):
        file.write("mine")
    assert path.read_text() == content


def in_place(path: Path) -> list[str]:
    """Calls that write a file in its place."""
    found = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if not isinstance(node, ast.Call):
            continue
        name = getattr(node.func, "attr", getattr(node.func, "id", ""))
        modes = {str(one.value) for one in ast.walk(node) if isinstance(one, ast.Constant)}
        method = isinstance(node.func, ast.Attribute)
        if (
            (name == "open" and modes & {"w", "wb", "x", "r+"})
            or (name in ("write_text", "write_bytes") and method)
            or name == "savefig"
        ):
            found.append(ast.unparse(node))
    return [call for call in found if "temporary" not in call]


@pytest.mark.parametrize("folder", ["tsepm_ros", "msg_adapters", "benchmarks", "docs"])
def test_no_module_writes_a_file_in_place(folder):
    if not (ROOT / folder).exists():
        pytest.skip("only in the source tree")
    assert {
        str(path.relative_to(ROOT)): calls
        for path in sorted((ROOT / folder).rglob("*.py"))
        if (calls := in_place(path))
    } == {}
