"""What the node learned is kept over a restart."""

import json
import os

import pytest
from support.boat import Boat
from support.sonar_driver import pings

from tsepm_ros.nodes.track_initiator import TrackInitiator


def test_what_was_learned_is_there_after_a_restart(world, tmp_path):
    path = tmp_path / "deeper" / "learned.json"
    boat = Boat(world, learned_file=str(path))
    sent = pings()
    boat.send(sent)
    world.until(lambda: world.figures()["scans"] == str(len(sent)), "the diagnostics")
    learned = float(world.figures()["clutter_density"])
    world.end(boat.node)
    assert json.loads(path.read_text())["clutter_scans"] > 0.0
    again = Boat(world, learned_file=str(path))
    world.until(lambda: world.figures()["scans"] == "0", "the diagnostics of the new node")
    assert float(world.figures()["clutter_density"]) == pytest.approx(learned, rel=0.1)
    assert learned != 1e-6
    world.until_logged("is used from")
    assert "what was learned" in world.reset().message
    world.end(again.node)
    assert not path.exists(), "a reset forgets the file"


REPLACED = [
    ({"time": 10**400}, "time"),
    ({"clutter_counts": [[1e308]]}, "clutter_counts"),
    ({"seen_range": [1e308], "seen_azimuth": [0.0]}, "seen_range"),
]
PATHS = [
    ("~nosuchuser/learned.json", "home directory"),
    ("x" * 5000, "too long"),
    ("deeper/" + "x" * 230, "more than 200 bytes"),
    ("", "no regular file"),
    ("fifo", "no regular file"),
    ("/dev/zero", "no regular file"),
]


def test_a_file_with_a_number_out_of_bounds_is_refused_at_the_start_and_written_anew(
    world, tmp_path
):
    path = tmp_path / "learned.json"
    boat = Boat(world, learned_file=str(path))
    boat.send(pings())
    world.end(boat.node)
    good = json.loads(path.read_text())
    for replaced, named in REPLACED:
        path.write_text(json.dumps(good | replaced))
        node = world.make(TrackInitiator, {"learned_file": str(path)})
        world.until_logged("is not used", f"{named} must be")
        world.end(node)
    again, sent = Boat(world, learned_file=str(path)), pings()
    assert len(again.send(sent)) == len(sent)
    assert world.dropped() == {}
    world.end(again.node)
    assert json.loads(path.read_text(), parse_constant=pytest.fail)["clutter_scans"] <= 50.0


def test_a_path_that_cannot_be_a_file_is_refused_with_a_short_sentence(world, tmp_path):
    os.mkfifo(tmp_path / "fifo")
    for number, (path, said) in enumerate(PATHS, 1):
        given = path if path[:1] == "~" else str(tmp_path / path)
        node = world.make(TrackInitiator, {"learned_file": given})

        def refusals() -> list[str]:
            return [line for line in world.logged() if "is not used" in line]

        world.until(lambda number=number: len(refusals()) == number, "the refusal")
        assert said in refusals()[-1]
        world.end(node)
    assert all(len(line) < 800 for line in world.logged(30))


def test_a_folder_that_cannot_be_written_does_not_stop_the_node(world, tmp_path, capfd):
    (tmp_path / "file").write_text("")
    boat = Boat(world, learned_file=str(tmp_path / "file" / "learned.json"))
    boat.send(pings())
    world.end(boat.node)
    assert "cannot be written" in capfd.readouterr().err
