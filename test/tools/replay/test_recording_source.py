"""What a path names, and what is said of paths that name no recording."""

import bz2
import gzip

import pytest

from tsepm_ros.tools.replay.recording import source_of

MCAP, SQLITE, ROS_1 = b"\x89MCAP0\r\n", b"SQLite format 3\0", b"#ROSBAG V2.0\n"
TABLE = b"time_s,range_m,azimuth_rad\n"


@pytest.fixture
def holding(tmp_path):
    """Make a folder of files by name and content."""

    def make(**files: bytes):
        for name, content in files.items():
            (tmp_path / name.replace("__", ".")).write_bytes(content)
        return tmp_path

    return make


@pytest.mark.parametrize("name", ["run2.csv", "RUN2.CSV", "detections.csv", "own_ship.csv"])
def test_a_csv_file_names_itself(holding, name):
    path = holding(**{name: TABLE, "other.csv": TABLE}) / name
    assert source_of(path) == (path, False)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        *(("a.mcap", MCAP), ("a.db3", SQLITE), ("A.MCAP", MCAP), ("a.mcap.active", MCAP)),
        *(("a.sqlite3", SQLITE), ("a.mcap", b""), ("a.db3", b"")),
    ],
)
def test_a_bag_s_file_names_itself_by_its_content_or_suffix(holding, name, content):
    path = holding(**{name: content}) / name
    assert source_of(path) == (path, True)


@pytest.mark.parametrize("name", ["trial_0.mcap", "trial.db3", "TRIAL.MCAP"])
def test_a_folder_of_one_bag_file_without_metadata_names_it(holding, name):
    folder = holding(**{name: MCAP, "notes.txt": b"", ".hidden.mcap": MCAP})
    assert source_of(folder) == (folder / name, True)


def test_metadata_and_detections_name_the_folder_s_recording(holding, tmp_path):
    folder = holding(metadata__yaml=b"", a__mcap=MCAP, b__mcap=MCAP)
    assert source_of(folder) == source_of(folder / "metadata.yaml") == (folder, True)
    (folder / "metadata.yaml").unlink()
    (folder / "detections.csv").write_bytes(TABLE)
    assert source_of(folder) == (folder / "detections.csv", False)


@pytest.mark.parametrize(
    ("files", "words"),
    [
        ({}, ["holds nothing", "expected", "metadata.yaml"]),
        ({"notes__txt": b""}, ["holds notes.txt", "expected"]),
        ({"run1__csv": TABLE, "run2__csv": TABLE}, ["run1.csv, run2.csv", "name one of its files"]),
        ({"run1__csv": TABLE}, ["holds run1.csv", "name one of its files"]),
        ({"a_0__mcap": MCAP, "a_1__mcap": MCAP}, ["a_0.mcap, a_1.mcap", "ros2 bag reindex"]),
        (
            {"metadata__yaml": b"", "detections__csv": TABLE},
            ["detections.csv, metadata.yaml", "name one of its files"],
        ),
        ({"trial__bag": ROS_1}, ["trial.bag is a ROS 1 bag", "rosbags-convert --src"]),
        ({"a__csv": TABLE, "a__csv__gz": gzip.compress(TABLE, mtime=0)}, ["holds a.csv, a.csv.gz"]),
        ({"tracks__csv": TABLE, "tracks__mcap": MCAP}, ["tracks.csv, tracks.mcap", "name one"]),
        ({"a__bag": ROS_1, "b__db3__zstd": b""}, ["holds a.bag, b.db3.zstd", "name one"]),
        ({f"f{k}": b"" for k in range(20)}, ["f0, f1", "..."]),
    ],
)
def test_a_folder_says_what_it_holds_and_what_is_expected(holding, files, words):
    with pytest.raises(ValueError) as refused:
        source_of(holding(**files))
    for word in words:
        assert word in str(refused.value)
    assert len(str(refused.value)) < 500


def test_a_folder_of_bags_asks_for_one(tmp_path):
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "metadata.yaml").touch()
    with pytest.raises(ValueError, match=r"holds first, second; .*name a folder or a file in it"):
        source_of(tmp_path)


@pytest.mark.parametrize(
    ("name", "content", "remedy"),
    [
        ("a.bag", ROS_1, "ROS 1 bag: convert it by rosbags-convert"),
        ("a.bag", b"", "ROS 1 bag"),
        ("noted", ROS_1, "ROS 1 bag"),
        ("a.db3.zstd", b"\x28\xb5\x2f\xfd", "compressed: unpack it .unzstd .*name the folder"),
        ("a.mcap.zst", b"", "compressed: unpack it .unzstd"),
        ("a.csv.gz", gzip.compress(TABLE, mtime=0), "compressed: unpack it .gunzip"),
        ("a.csv", gzip.compress(TABLE, mtime=0), "compressed: unpack it .gunzip"),
        ("a.csv.bz2", bz2.compress(TABLE), "compressed: unpack it .bunzip2"),
        ("a.zip", b"PK\x03\x04", "compressed: unpack it .unzip"),
        ("a.json", b"{}", "is no recording; expected a .csv file"),
        ("a.pcap", b"", "is no recording; expected a .csv file"),
    ],
)
def test_a_file_that_is_not_read_has_its_own_remedy(holding, name, content, remedy):
    path = holding(**{name: content, "detections.csv": TABLE}) / name
    with pytest.raises(ValueError, match=f"{name} .*{remedy}"):
        source_of(path)


def test_a_path_that_does_not_exist_is_named(tmp_path):
    with pytest.raises(ValueError, match=r"missing\.csv cannot be read: No such file"):
        source_of(tmp_path / "missing.csv")
