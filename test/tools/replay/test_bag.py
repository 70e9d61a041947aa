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
"""Bags: what is read, found and refused, and that a run of one is repeatable to the bit."""

import copy
import errno
import gzip
import re
import shutil
import sqlite3
from contextlib import closing
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="bags need the library rosbags")

from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
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
from tsepm_ros.settings.parameter_files import parse_parameter_file_values
from tsepm_ros.settings.settings import TRACK_INITIATOR, make_groups, settings_from
from tsepm_ros.tools.replay.bag import (
    DETECTIONS,
    LAYOUTS,
    OWN_SHIP,
    TRACKED,
    TRUTH,
    Bag,
    BagWriter,
    find_bag_topics,
)
from tsepm_ros.tools.replay.offline import BagInput, offline_bag_results
from tsepm_ros.tools.replay.recording import recording_source_of

BOTH = pytest.mark.parametrize("storage", STORAGES)


def run(path, *parameters, source="odometry"):
    """Process a bag; returns the results and the session."""
    values = parse_parameter_file_values([*PARAMETERS, *parameters])
    made = make_groups(TRACK_INITIATOR, {"own_ship_source": source, **values})
    session = Session(settings_from(made))
    with Bag(path) as bag:
        topics = find_bag_topics(bag.topics, {})
        given = MessageInput(session, made[InitiatorNodeOptions])
        return list(
            offline_bag_results(bag, topics, [BagInput(topics[DETECTIONS], session, given)])
        ), session


def read_all(path):
    """The messages of a bag in their order, each of which can be read."""
    with Bag(path) as bag:
        topics = find_bag_topics(bag.topics, {}).values()
        messages = list(bag.messages(topics))
        assert all(bag.read(message).header.frame_id for message in messages)
        return [(message.topic, message.log_ns, message.data) for message in messages]


# Reading


@BOTH
@pytest.mark.parametrize("named", ["folder", "file"])
def test_messages_come_as_they_were_recorded_in_the_order_of_reception(tmp_path, storage, named):
    entries = simulated()
    folder = write_bag(tmp_path / "bag", entries, storage)
    path = folder if named == "folder" else storage_file(folder)
    assert recording_source_of(path) == (path, True)
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


def a_database_that_is_no_bag(tmp_path):
    path = tmp_path / "other.db3"
    with closing(sqlite3.connect(path)) as database:
        database.execute("CREATE TABLE other (x)")
    return path.read_bytes()


POINTER = b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n"
REMEDIES = {
    "truncated": r"end is missing: copy it again.*(mcap recover|\.recover)",
    "other bytes": "is no bag, whatever its name says",
    "a page of a web server": "is no bag, whatever its name says",
    "a pointer of a large-file store": "a pointer of git LFS.*git lfs pull",
    "a pointer of git-annex": "a pointer of git-annex.*git annex get",
    "empty": "is empty: .*copy it again",
    "packed": "is compressed: unpack it .gunzip",
    "another database": "no bag's, or a -wal file",
}


@BOTH
@pytest.mark.parametrize("fault", REMEDIES)
@pytest.mark.parametrize("named", ["folder", "file"])
def test_a_bag_that_cannot_be_read_says_why_and_what_to_do(tmp_path, storage, fault, named):
    folder = write_bag(tmp_path / "bag", simulated(), storage)
    file = storage_file(folder)
    content = {
        "truncated": file.read_bytes()[: file.stat().st_size // 2],
        "other bytes": b"no bag " * 99,
        "a page of a web server": b"<!DOCTYPE html>",
        "a pointer of a large-file store": POINTER,
        "a pointer of git-annex": b"/annex/objects/MD5E-s77--4d7a.mcap\n",
        "empty": b"",
        "packed": gzip.compress(b"bag"),
        "another database": a_database_that_is_no_bag(tmp_path),
    }
    file.write_bytes(content[fault])
    with pytest.raises(ValueError, match=REMEDIES[fault]) as refused:
        read_all(recording_source_of(folder if named == "folder" else file)[0])
    assert "reindex" not in str(refused.value)


@BOTH
def test_a_file_that_the_metadata_names_and_that_is_missing_is_named(tmp_path, storage):
    folder = write_bag(tmp_path / "bag", simulated(), storage)
    file = storage_file(folder)
    renamed = file.rename(folder / f"other{file.suffix}")
    with pytest.raises(ValueError, match=rf"names {file.name}.*renamed.*name other\{file.suffix}"):
        Bag(folder)
    with Bag(renamed) as bag:
        assert bag.count("/detections") == 10
    renamed.unlink()
    with pytest.raises(ValueError, match=rf"names {file.name}.*copy it there$"):
        Bag(folder)


def test_a_file_beside_those_of_the_metadata_is_said_not_to_be_read(tmp_path):
    folder = write_bag(tmp_path / "bag", simulated())
    shutil.copy(storage_file(folder), folder / "more_1.mcap")
    with Bag(folder) as bag:
        assert [note for note in bag.notes if "more_1.mcap" in note and "not read" in note]


@BOTH
def test_files_are_read_in_the_order_of_their_messages_whatever_the_metadata_s(tmp_path, storage):
    entries = simulated()
    whole = write_bag(tmp_path / "whole", entries, storage)
    folder = write_bag(tmp_path / "bag", entries[len(entries) // 2 :], storage)
    late = storage_file(folder)
    early = storage_file(write_bag(tmp_path / "early", entries[: len(entries) // 2], storage))
    shutil.copy(early, folder)
    metadata = folder / "metadata.yaml"
    text = metadata.read_text()
    named = f"- {late.name}"
    assert text.count(named) == 1
    metadata.write_text(text.replace(named, f"{named}\n  - {early.name}"))
    assert read_all(folder) == read_all(whole)


@pytest.mark.parametrize("text", ["", "rosbag2: [", "other: 1", POINTER.decode()])
def test_metadata_that_is_none_has_its_own_remedy(tmp_path, text):
    folder = write_bag(tmp_path / "bag", simulated())
    (folder / "metadata.yaml").write_text(text)
    remedy = "git lfs pull" if "lfs" in text else "is no metadata of a bag .*ros2 bag reindex"
    with pytest.raises(ValueError, match=remedy):
        Bag(folder)


@BOTH
def test_figures_of_the_metadata_do_not_count_against_the_files(tmp_path, storage):
    """The quality of service is often edited, and counts are those of an earlier time."""
    folder = write_bag(tmp_path / "bag", simulated(), storage)
    text = (folder / "metadata.yaml").read_text()
    text = re.sub(r"message_count: \d+", "message_count: 0", text)
    edited = "{history: 1, depth: 9, reliability: 1, durability: 2, liveliness: 1, "
    for name in ("deadline", "lifespan", "liveliness_lease_duration"):
        edited += f"{name}: {{sec: 0, nsec: 0}}, "
    edited = f"offered_qos_profiles: [{edited}avoid_ros_namespace_conventions: false}}]"
    assert "offered_qos_profiles: []" in text
    (folder / "metadata.yaml").write_text(text.replace("offered_qos_profiles: []", edited))
    with Bag(folder) as bag:
        assert bag.count("/detections") == len(list(bag.messages(["/detections"]))) == 10


@pytest.mark.parametrize("storage", STORAGES)
@pytest.mark.parametrize("mode", ["FILE", "MESSAGE"])
def test_a_compressed_bag_is_read_from_its_folder(tmp_path, storage, mode):
    path = tmp_path / "bag"
    writer = Writer(path, version=9, storage_plugin=StoragePlugin[storage.upper()])
    writer.set_compression(CompressionMode[mode], CompressionFormat.ZSTD)
    entries = simulated()
    with writer:
        topics = {
            topic: writer.add_connection(topic, kind, typestore=STORE)
            for topic, kind in (("/detections", POINTS), ("/own_ship/odometry", ODOMETRY))
        }
        for entry in entries:
            writer.write(topics[entry.topic], round(entry.time * 1e9), serialized(entry))
    assert read_all(path) == read_all(write_bag(tmp_path / "plain", entries))
    [file] = [file for file in path.iterdir() if file.name != "metadata.yaml"]
    with pytest.raises(ValueError, match=r"compressed: .*folder"):
        read_all(recording_source_of(file)[0])


@pytest.mark.parametrize("kept", [0, 10])
@pytest.mark.parametrize("mode", ["wal", "persist"])
@pytest.mark.parametrize("named", ["folder", "file"])
def test_what_a_killed_recorder_left_beside_a_database_is_read_and_no_file_changes(
    tmp_path, kept, mode, named
):
    folder = write_bag(tmp_path / "bag", simulated(), "sqlite3")
    expected = read_all(folder)
    file = storage_file(folder)
    with closing(sqlite3.connect(file)) as source:
        script = list(source.iterdump())
    file.unlink()
    with closing(sqlite3.connect(tmp_path / file.name, isolation_level=None)) as recorder:
        if mode == "wal":
            recorder.execute("PRAGMA journal_mode = WAL")
            recorder.execute("PRAGMA wal_autocheckpoint = 0")
        messages = 0
        for line in script:
            if line.startswith(("BEGIN", "COMMIT")):
                continue
            messages += line.startswith('INSERT INTO "messages"')
            if messages == kept:
                recorder.execute("PRAGMA wal_checkpoint(TRUNCATE)")
            recorder.execute(line)
        if mode == "persist":  # killed within a change, of which a part is in the file
            recorder.execute("PRAGMA cache_size = 1")
            recorder.execute("BEGIN")
            recorder.execute("UPDATE messages SET data = zeroblob(length(data))")
        for end in ("", "-wal", "-journal"):
            if (left := tmp_path / f"{file.name}{end}").exists():
                shutil.copy(left, folder)
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert len(before) == 3
    assert read_all(folder if named == "folder" else file) == expected
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
    with Bag(folder) as bag:
        assert [note for note in bag.notes if "is read with it" in note]


ODD = {
    "a service's events": ("ros2msg", "---\nbool success\nstring message\n"),
    "no definition": ("", ""),
    "unknown to the recorder": ("unknown", ""),
    "another encoding": ("jsonschema", '{"type": "object"}'),
    "nonsense": ("ros2msg", "((("),
    "no IDL": ("ros2idl", "((("),
}


@BOTH
@pytest.mark.parametrize("odd", ODD)
def test_the_definition_of_a_topic_that_is_not_read_refuses_nothing(tmp_path, storage, odd):
    encoding, text = ODD[odd]
    kind = "other_msgs/msg/Event"
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg("bool success\n", kind))
    entries = simulated()
    expected = read_all(write_bag(tmp_path / "plain", entries, storage))
    event = Entry(entries[0].time, "/reset/_service_event", kind, b"\0\1\0\0" + bytes(40))
    path = write_bag(tmp_path / "bag", [event, *entries], storage, store)
    file = storage_file(path)
    if storage == "sqlite3":
        with sqlite3.connect(file) as database:
            database.execute(
                "UPDATE message_definitions SET encoding = ?, encoded_message_definition = ? "
                "WHERE topic_type = ?",
                (encoding, text, kind),
            )
    else:
        file.write_bytes(with_schema(file.read_bytes(), kind, encoding, text))
    for named in (path, file):
        assert read_all(named) == expected


def with_schema(content: bytes, name: str, encoding: str, text: str) -> bytes:
    """An MCAP file with another definition of a type, without the index at its end."""

    def string(value: str) -> bytes:
        return len(value.encode()).to_bytes(4, "little") + value.encode()

    done, place = bytearray(content[:8]), 8
    while content[place] != 0x0F:  # the end of the data
        size = int.from_bytes(content[place + 1 : place + 9], "little")
        kind, record = content[place], content[place + 9 : place + 9 + size]
        if kind == 0x03 and string(name) in record:
            record = record[:2] + string(name) + string(encoding) + string(text)
        done += bytes([kind]) + len(record).to_bytes(8, "little") + record
        place += 9 + size
    footer = bytes(20)
    return bytes(done) + b"\x02" + (20).to_bytes(8, "little") + footer + content[:8]


@pytest.mark.parametrize("old", ["acoustic_msgs", "marine_acoustic_msgs"])
def test_a_package_is_read_under_its_earlier_name(tmp_path, old):
    path, name = detections_without_a_definition(tmp_path)
    earlier = name.replace("marine_acoustic_msgs", old)
    with sqlite3.connect(storage_file(path)) as database:
        database.execute("UPDATE topics SET type = ? WHERE type = ?", (earlier, name))
    with Bag(storage_file(path)) as bag:
        assert find_bag_topics(bag.topics, {})[DETECTIONS] == "/detections"
        ping = read_detections(bag.read(next(bag.messages(["/detections"]))))
    assert ping.sensor_scan.scan.range == pytest.approx([300.0])


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
    path = write_bag(tmp_path / "bag", simulated())
    file = storage_file(path)
    file.write_bytes(file.read_bytes()[:-9])
    with pytest.raises(ValueError, match=r"the bag .* cannot be read.*mcap recover"):
        Bag(path)


# Topics


def test_a_bag_without_messages_is_empty_and_topics_are_found_by_name_in_any_namespace(tmp_path):
    with Bag(write_bag(tmp_path / "bag", [])) as bag:
        assert (bag.topics, bag.start_ns, bag.end_ns, bag.duration) == ({}, 0, 0, 0.0)
    topics = {f"/boat/{role}": POINTS for role in (DETECTIONS, TRACKED, TRUTH)}
    topics |= {"/boat/own_ship/odometry": ODOMETRY, "/boat/tracks": POINTS}
    topics |= {"/boat/tracks/odometry": ODOMETRY}
    roles = (DETECTIONS, OWN_SHIP, TRACKED, TRUTH)
    assert find_bag_topics(topics, {}) == {role: f"/boat/{role}" for role in roles}


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
        find_bag_topics(topics, given)


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


def test_the_error_of_a_full_disk_names_the_bag(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    writer = BagWriter(tmp_path / "bag")
    writer.add("/tracks", POINTS)
    monkeypatch.setattr(writer, "_writer", SimpleNamespace(write=full, close=full))
    for act in (lambda: writer.write("/tracks", 1, b""), writer.close):
        with pytest.raises(OSError, match="No space left") as error:
            act()
        assert error.value.filename == str(tmp_path / "bag")
