"""`tsepm watch` of a recording, and the page that `tsepm run` writes."""

import base64
import gzip
import json
import math
import re
import signal
import socket
import subprocess
import sys
import time
import urllib.request

import pytest
from support.patience import WAIT

from tsepm_ros.tools.commands.cli import main


@pytest.fixture
def recording(recording, tmp_path):
    """The recording in a folder with a name, which is the page's title."""
    folder = tmp_path / "trial"
    folder.mkdir()
    (tmp_path / "detections.csv").rename(folder / "detections.csv")
    return str(folder)


def held_by(page: str) -> dict:
    """The recording in a self-contained page."""
    data = re.search(r'id="recording">([^<]*)</script>', page)[1]
    return json.loads(gzip.decompress(base64.b64decode(data)))


def test_run_writes_a_page_beside_the_tracks(capsys, recording, tmp_path):
    assert main(["run", recording]) == 0
    plain = capsys.readouterr().out
    path = tmp_path / "run.html"
    assert main(["run", recording, "--html", str(path)]) == 0
    captured = capsys.readouterr()
    assert captured.out == plain
    assert captured.err == f"page: {path}\n"
    page = held_by(path.read_text())
    info = page["info"]
    assert info.pop("sector") == [0.0, 9000.0, -math.pi, math.pi]
    assert info.pop("mounting_yaw") == 0.0
    assert info == {"kind": "recording", "title": "trial, method score", "north": False}
    assert len(page["frames"]) == 8
    ((track_id, facts),) = page["facts"].items()
    assert facts["confirmed"] == 24.0 and len(facts["hits"]) == 3
    assert [str(row[0]) for row in page["frames"][-1]["tracks"]] == [track_id]


def test_the_page_of_a_run_says_what_was_dropped_and_has_the_places_of_its_origin(
    capsys, recording, tmp_path
):
    path = tmp_path / "run.html"
    assert main(["run", recording, "--html", str(path), "--origin", "59.65,10.63"]) == 0
    info = held_by(path.read_text())["info"]
    assert info["geographic"]["origin"] == [59.65, 10.63] and info["north"]
    with open(f"{recording}/detections.csv", "a") as file:
        file.write("\n90.0,-1.0,0.0\n")
    assert main(["run", recording, "--html", str(path)]) == 0
    health = held_by(path.read_text())["health"]
    assert health["level"] == 1
    assert any(entry["message"].startswith("1 detection dropped") for entry in health["entries"])


@pytest.mark.long
def test_watch_serves_a_recording_until_interrupted(recording):
    command = [
        sys.executable,
        "-m",
        "tsepm_ros.tools.commands.cli",
        "watch",
        recording,
        "--port",
        "0",
    ]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            line = process.stdout.readline()
            url = re.fullmatch(r"8 scans; open (http://127\.0\.0\.1:\d+/) \(Ctrl-C ends\)\n", line)[
                1
            ]
            with urllib.request.urlopen(f"{url}recording", timeout=WAIT) as answer:
                assert len(json.load(answer)["frames"]) == 8
            time.sleep(0.1)
            process.send_signal(signal.SIGINT)
            assert process.wait(WAIT) == 0
            assert process.stderr.read() == "", "silent where it is not a terminal"
        finally:
            process.kill()


def refused(capsys, *arguments: str) -> str:
    assert main(["watch", *arguments]) == 2
    error = capsys.readouterr().err
    assert error.startswith("refused: ")
    return error


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # tornado's socket
def test_a_port_in_use_is_refused_before_the_work(capsys, recording):
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        assert "choose another port" in refused(capsys, recording, "--port", str(port))


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["no_such_thing"], "no_such_thing is neither an existing path nor a shipped scenario"),
        (["four_targets", "--token", "short"], "token must have at least 16 characters"),
        (["four_targets", "--port", "70000"], "port must be from 0 to 65535"),
        (["four_targets", "--origin", "89.5,0"], "near a pole"),
        (["four_targets", "--origin", "Oslo"], "latitude,longitude in degrees, such as 59.65"),
        (["-p", "max_speed:=5.0"], "-p sets parameters of the processing of a recording"),
        (["four_targets", "--ros-args", "-r", "a:=b"], "--ros-args is for live topics"),
    ],
)
def test_arguments_that_do_not_fit_are_refused(capsys, arguments, sentence):
    assert sentence in refused(capsys, *arguments)
