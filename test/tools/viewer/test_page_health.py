"""Health as the page shows it."""

from __future__ import annotations

from types import SimpleNamespace

from tsepm_ros.tools.viewer.page_frames import health_of_message, health_of_run


def status(name: str, level, message: str = "fine", **values: str):
    pairs = [SimpleNamespace(key=key, value=value) for key, value in values.items()]
    return SimpleNamespace(name=name, level=level, message=message, values=pairs)


def array(*statuses):
    return SimpleNamespace(status=list(statuses))


def test_entries_of_the_track_initiator_are_read_whatever_its_name():
    health = health_of_message(
        array(
            status("boat: track initiation", b"\x00", "3 scans", scans="3", empty=""),
            status("boat: own ship", b"\x01", "no data yet"),
            status("battery: charge", b"\x02", "empty"),
        )
    )
    assert health["level"] == 1
    assert health["entries"] == [
        {"task": "track initiation", "level": 0, "message": "3 scans", "values": [["scans", "3"]]},
        {"task": "own ship", "level": 1, "message": "no data yet", "values": []},
    ]


def test_an_error_is_worse_than_stale_and_levels_may_be_numbers():
    levels = [("detections", 3), ("latency", 2), ("clutter", 0)]
    health = health_of_message(array(*(status(f"n: {task}", level) for task, level in levels)))
    assert health["level"] == 2


def test_a_run_says_what_it_dropped_and_what_helps():
    health = health_of_run(5, {"heading_unknown": 2, "of_an_adapter": 1}, ["gap before 3 s"])
    assert health["level"] == 1
    sentences = [entry["message"] for entry in health["entries"]]
    assert sentences[0] == "5 scans processed"
    assert any(s.startswith("2 scans dropped: ") and "Remedy: " in s for s in sentences)
    assert "1 detection dropped: of_an_adapter" in sentences
    assert "gap before 3 s" in sentences


def test_a_run_without_scans_is_a_warning():
    assert health_of_run(0, {}, [])["level"] == 1
    assert health_of_run(1, {}, [])["level"] == 0
