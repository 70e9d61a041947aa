"""Bags: what is read, found and refused, and that a run of one is repeatable to the bit."""

import copy
import re
import sqlite3

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="bags need the library rosbags")

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from support.bag_files import (
    GRID,
    LATENCY,
    ODOMETRY,
    PARAMETERS,
    POINTS,
    STORAGES,
    STORE,
    Entry,
    cloud,
    grid,
    serialized,
    simulated,
    storage_file,
    write_bag,
)

from msg_adapters import MessageError, read_detections
from msg_adapters.message_input import MessageInput
from msg_adapters.track_messages import track_points
from tsepm_ros.session.session import Session
from tsepm_ros.settings.node_options import InitiatorNodeOptions
from tsepm_ros.settings.parameter_files import parse_values
from tsepm_ros.settings.settings import TRACK_INITIATOR, make_groups, settings_from
from tsepm_ros.tools.replay.bag import (
    DETECTIONS,
    LAYOUTS,
    OWN_SHIP,
    TRACKED,
    TRUTH,
    Bag,
    find_topics,
)
from tsepm_ros.tools.replay.offline import bag_results
from tsepm_ros.tools.replay.recording import source_of

BOTH = pytest.mark.parametrize("storage", STORAGES)


def run(path, *parameters, source="odometry"):
    """Process a bag; returns the results and the session."""
    values = parse_values([*PARAMETERS, *parameters])
    made = make_groups(TRACK_INITIATOR, {"own_ship_source": source, **values})
    session = Session(settings_from(made))
    with Bag(path) as bag:
        topics = find_topics(bag.topics, {})
        given = MessageInput(session, made[InitiatorNodeOptions])
        return list(bag_results(bag, topics, session, given)), session


# Reading


@BOTH
@pytest.mark.parametrize("named", ["folder", "file"])
def test_messages_come_as_they_were_recorded_in_the_order_of_reception(tmp_path, storage, named):
    entries = simulated()
    folder = write_bag(tmp_path / "bag", entries, storage)
    path = folder if named == "folder" else storage_file(folder)
    assert source_of(path) == (path, True)
    with Bag(path) as bag:
        assert bag.topics == {"/detections": POINTS, "/own_ship/odometry": ODOMETRY}
        assert bag.duration == pytest.approx(entries[-1].time - entries[0].time)
        found = list(bag.messages(bag.topics))
        assert [(m.topic, m.log_ns, m.data) for m in found] == [
            (entry.topic, round(entry.time * 1e9), serialized(entry)) for entry in entries
        ]
        later = list(bag.messages(["/detections"], bag.start_ns + 10**10))
        assert later == [
            m for m in found if m.topic == "/detections" and m.log_ns >= bag.start_ns + 10**10
        ]
        assert list(bag.messages([])) == []


def test_types_that_only_the_bag_knows_are_read_by_its_definition(tmp_path):
    store = get_typestore(Stores.ROS2_JAZZY)
    name = "marine_msgs/msg/Depth"
    store.register(get_types_from_msg("std_msgs/Header header\nfloat32[] depths\n", name))
    empty = cloud(3.0, "sonar", range=[], azimuth=[])
    message = store.types[name](header=empty.header, depths=np.array([1.5, 2.5], np.float32))
    entry = Entry(1.0, "/depth", name, bytes(store.serialize_cdr(message, name)))
    with Bag(write_bag(tmp_path / "bag", [entry], store=store)) as bag:
        [found] = bag.messages(["/depth"])
        content = bag.read(found)
    assert content.depths.tolist() == [1.5, 2.5]
    assert content.header.stamp.sec == 3


def test_a_bag_without_definitions_is_read_by_those_of_ros(tmp_path):
    entries = simulated()
    path = write_bag(tmp_path / "bag", entries, "sqlite3")
    with sqlite3.connect(storage_file(path)) as database:
        database.execute("DELETE FROM message_definitions")
    with Bag(path) as bag:
        content = [bag.read(message) for message in bag.messages(["/own_ship/odometry"])]
    assert [one.pose.pose.position.x for one in content] == [
        entry.message.pose.pose.position.x for entry in entries if entry.type_name == ODOMETRY
    ]


def detections_without_a_definition(tmp_path, kept=(), data=None):
    """A bag of marine_acoustic_msgs/SonarDetections; returns its folder and the type's name."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for one, text in LAYOUTS.items():
        store.register(get_types_from_msg(text, one))
    name, types = "marine_acoustic_msgs/msg/SonarDetections", store.types
    none = np.zeros(0, np.float32)
    message = types[name](
        header=cloud(1.0, "sonar", range=[]).header,
        ping_info=types["marine_acoustic_msgs/msg/PingInfo"](4e5, 1500.0, none, none),
        flags=[types["marine_acoustic_msgs/msg/DetectionFlag"](flag=0)],
        two_way_travel_times=np.array([0.4], np.float32),
        **dict.fromkeys(("tx_delays", "intensities", "tx_angles"), none),
        rx_angles=np.array([-0.25], np.float32),
    )
    data = data or bytes(store.serialize_cdr(message, name))
    entries = [Entry(1.0 + k, "/detections", name, data) for k in range(3)]
    entries.append(next(entry for entry in simulated() if entry.type_name == ODOMETRY))
    path = write_bag(tmp_path / "bag", entries, "sqlite3", store)
    with sqlite3.connect(storage_file(path)) as database:
        types_kept = ", ".join(f"'{one}'" for one in kept)
        database.execute(f"DELETE FROM message_definitions WHERE topic_type NOT IN ({types_kept})")
    return path, name


@pytest.mark.parametrize("kept", [(), (ODOMETRY,)], ids=["no definition", "one of two"])
def test_a_driver_s_messages_without_a_definition_are_read_by_a_known_layout(tmp_path, kept):
    path, name = detections_without_a_definition(tmp_path, kept)
    with Bag(path) as bag:
        assert [name in note and "no definition" in note for note in bag.notes] == [True]
        ping = read_detections(bag.read(next(bag.messages(["/detections"]))))
        assert bag.read(next(bag.messages(["/own_ship/odometry"]))).child_frame_id == "sonar"
    assert ping.sensor_scan.scan.range == pytest.approx([300.0])
    assert ping.sensor_scan.scan.azimuth == pytest.approx([0.25])


def test_an_unknown_layout_without_a_definition_is_not_called_corrupt(tmp_path):
    """The remedy for a corrupt message, to record again, would cost the user the trial."""
    path, name = detections_without_a_definition(tmp_path, data=b"\x00\x01\x00\x00" + b"\x07" * 40)
    with Bag(path) as bag:
        message = next(bag.messages(["/detections"]))
        with pytest.raises(ValueError, match=f"no definition of {name}.*ros2 bag convert"):
            bag.read(message)


@pytest.mark.parametrize(
    ("data", "said"),
    [(b"", "encapsulation"), (b"\x00\x01\x00\x00\x01", ""), (b"\x07" * 90, "")],
    ids=["empty", "short", "no CDR"],
)
def test_a_corrupt_message_is_told_apart_from_the_bag(tmp_path, data, said):
    path = write_bag(tmp_path / "bag", [Entry(1.0, "/detections", POINTS, data)])
    with Bag(path) as bag:
        [message] = bag.messages(["/detections"])
        with pytest.raises(MessageError, match=f"/detections is not a valid {POINTS}.*{said}"):
            bag.read(message)


@BOTH
@pytest.mark.parametrize("fault", ["truncated", "garbage", "empty file", "gone"])
def test_a_bag_that_cannot_be_read_is_refused_by_name(tmp_path, storage, fault):
    folder = write_bag(tmp_path / "bag", simulated(), storage)
    file = storage_file(folder)
    content = file.read_bytes()
    if fault == "gone":
        file.unlink()
    else:
        broken = {"truncated": content[: len(content) // 2], "garbage": b"no bag " * 99}
        file.write_bytes(broken.get(fault, b""))
    for path in [folder, file]:
        with pytest.raises(ValueError, match=r"the bag .* cannot be read: .*ros2 bag reindex"):
            run(path)


def test_a_number_of_messages_that_is_none_is_refused_by_name(tmp_path):
    folder = write_bag(tmp_path / "bag", simulated(), "sqlite3")
    metadata = folder / "metadata.yaml"
    text = metadata.read_text()
    assert "message_count" in text
    metadata.write_text(re.sub(r"message_count: \d+", "message_count: x", text))
    with pytest.raises(ValueError, match="cannot be read"):
        Bag(folder)


@pytest.mark.parametrize(("storage", "named"), [*zip(STORAGES, ("folder", "file"), strict=True)])
def test_ros_reads_a_bag_to_the_same_tracks_where_it_is_sourced(
    tmp_path, monkeypatch, storage, named
):
    folder = write_bag(tmp_path / "bag", simulated(), storage)
    path = folder if named == "folder" else storage_file(folder)
    expected = fingerprint(run(path)[0])
    with Bag(path) as bag:
        facts = bag.topics, bag.start_ns, bag.end_ns, bag.count("/detections")
        later = [m.log_ns for m in bag.messages(["/detections"], bag.start_ns + 10**10)]
    opened = pytest.importorskip("support.rosbag2_stand_in", exc_type=ImportError).install(
        monkeypatch
    )
    assert fingerprint(run(path)[0]) == expected
    assert opened, "by ROS"
    with Bag(path) as bag:
        assert (bag.topics, bag.start_ns, bag.end_ns, bag.count("/detections")) == facts
        assert [m.log_ns for m in bag.messages(["/detections"], bag.start_ns + 10**10)] == later
        assert bag.notes == []


def test_a_type_that_is_not_installed_is_read_by_the_bag_s_definition(tmp_path, monkeypatch):
    pytest.importorskip("support.foreign_messages", exc_type=ImportError).remove(monkeypatch)
    opened = pytest.importorskip("support.rosbag2_stand_in", exc_type=ImportError).install(
        monkeypatch
    )
    path, _ = detections_without_a_definition(tmp_path)
    with Bag(path) as bag:
        assert read_detections(bag.read(next(bag.messages(["/detections"])))).sensor_scan
    assert not opened, "by rosbags"


def test_a_bag_that_ros_cannot_read_is_refused_by_name(tmp_path, monkeypatch):
    pytest.importorskip("support.rosbag2_stand_in", exc_type=ImportError).install(monkeypatch)
    (tmp_path / "metadata.yaml").write_text("rosbag2: [")
    with pytest.raises(ValueError, match=r"the bag .* cannot be read"):
        Bag(tmp_path)


# Topics


def test_a_bag_without_messages_is_empty_and_topics_are_found_by_name_in_any_namespace(tmp_path):
    with Bag(write_bag(tmp_path / "bag", [])) as bag:
        assert (bag.topics, bag.start_ns, bag.end_ns, bag.duration) == ({}, 0, 0, 0.0)
    topics = {f"/boat/{role}": POINTS for role in (DETECTIONS, TRACKED, TRUTH)}
    topics |= {"/boat/own_ship/odometry": ODOMETRY, "/boat/tracks": POINTS}
    topics |= {"/boat/tracks/odometry": ODOMETRY}
    roles = (DETECTIONS, OWN_SHIP, TRACKED, TRUTH)
    assert find_topics(topics, {}) == {role: f"/boat/{role}" for role in roles}


@pytest.mark.parametrize(
    ("topics", "given", "sentence"),
    [
        ({}, {}, "no topic of detections; it has no topics"),
        ({"/log": "rcl_interfaces/msg/Log"}, {}, "it has /log .rcl_interfaces/msg/Log."),
        ({"/a": POINTS, "/b": POINTS}, {}, "several topics for detections: /a, /b"),
        (
            {"/x/detections": POINTS, "/y/detections": POINTS},
            {},
            "several topics for detections: /x",
        ),
        (
            {"/detections": POINTS, "/a": ODOMETRY, "/b": ODOMETRY},
            {},
            "several topics for own_ship/odometry: /a, /b",
        ),
        ({"/detections": POINTS}, {DETECTIONS: "/other"}, "no topic /other; it has /detections"),
        ({"/a": ODOMETRY}, {DETECTIONS: "/a"}, f"/a has the type {ODOMETRY}; the type of"),
        ({"/a": POINTS, "/b": POINTS}, {DETECTIONS: "a", OWN_SHIP: "b"}, "/b has the type"),
    ],
)
def test_topics_that_are_missing_wrong_or_several_are_refused_by_name(topics, given, sentence):
    with pytest.raises(ValueError, match=sentence):
        find_topics(topics, given)


# Running


def fingerprint(results):
    """Every bit of what the node would publish on `tracks` and `tracks/current`."""
    parts = [part for result in results for part in (result.new, result.current)]
    stamps = np.array([result.stamp_ns for result in results]).tobytes()
    return stamps + b"|".join(track_points(part)[0].tobytes() for part in parts)


def test_corrupt_messages_are_left_out_and_counted(tmp_path):
    good = simulated()
    bad = [Entry(1003.0, "/detections", POINTS, b"\x00\x01"), Entry(1003.0, *good[0][1:3], b"")]
    mixed = write_bag(tmp_path / "mixed", sorted(good + bad, key=lambda entry: entry.time))
    results, session = run(mixed)
    assert session.dropped == {"message_corrupt": 2}
    clean, _ = run(write_bag(tmp_path / "clean", good))
    assert fingerprint(results) == fingerprint(clean)


def test_poses_and_charts_that_cannot_be_read_are_dropped_with_a_reason(tmp_path):
    entries = simulated()
    pose = next(entry for entry in entries if entry.type_name == ODOMETRY)
    bad = copy.deepcopy(pose.message)
    bad.pose.pose.position.x = float("nan")
    grid = "nav_msgs/msg/OccupancyGrid"
    chart = STORE.types[grid](
        header=bad.header,
        info=STORE.types["nav_msgs/msg/MapMetaData"](
            map_load_time=bad.header.stamp, resolution=0.0, width=1, height=1, origin=bad.pose.pose
        ),
        data=np.zeros(1, np.int8),
    )
    entries += [Entry(pose.time, pose.topic, ODOMETRY, bad), Entry(pose.time, "/land", grid, chart)]
    _, session = run(write_bag(tmp_path / "bag", sorted(entries, key=lambda entry: entry.time)))
    assert session.dropped["own_ship_invalid"] == 1
    assert sum(number for reason, number in session.dropped.items() if "land" in reason) == 1
    assert sum(session.dropped.values()) == 2


@pytest.mark.parametrize(("time", "before"), [(999.0, 0), (1022.0, 5)])
def test_a_chart_counts_from_when_it_was_recorded(tmp_path, time, before):
    everything = grid(time, "odom", np.ones((100, 100), bool), 100.0, -5000.0, -5000.0)
    entries = sorted([*simulated(), Entry(time, "/land", GRID, everything)], key=lambda e: e.time)
    results, session = run(write_bag(tmp_path / "bag", entries))
    used = [result.statistics.detections > 0 for result in results]
    assert used == [True] * before + [False] * (10 - before)
    assert session.dropped["on_land"] == sum(len(result.scan) for result in results[before:])


@pytest.mark.parametrize(("late", "lost"), [(1.5, 0), (30.0, 10)])
def test_waiting_for_the_own_ship_is_judged_by_the_times_of_the_recording(tmp_path, late, lost):
    # Every pose comes later by some time; own_ship_timeout is 2 s.
    entries = [
        entry._replace(time=entry.time - LATENCY + late) if entry.type_name == ODOMETRY else entry
        for entry in simulated()
    ]
    entries.sort(key=lambda entry: entry.time)
    results, session = run(write_bag(tmp_path / "bag", entries))
    assert len(results) == 10 - lost
    assert sum(session.dropped.values()) == lost
