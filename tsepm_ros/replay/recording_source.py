"""What a path names: a CSV recording, a bag, or a file that is neither, with its remedy."""

from __future__ import annotations

from pathlib import Path

METADATA, DETECTIONS_FILE = "metadata.yaml", "detections.csv"
CSV, MCAP, SQLITE = ".csv", ".mcap", ".db3"
EXPECTED = (
    f"expected a .csv file of detections, a folder with {DETECTIONS_FILE}, or a bag: its folder "
    f"with {METADATA}, or its {MCAP} or {SQLITE} file"
)

_ROS_1 = "is a ROS 1 bag: convert it by rosbags-convert --src {path} --dst {path.stem}"
_PACKED = (
    "is compressed: unpack it ({tool}), or name the folder of a compressed bag, if it has "
    f"{METADATA}"
)
_STARTS = (
    (b"\x89MCAP0\r\n", MCAP),
    (b"SQLite format 3\0", SQLITE),
    (b"#ROSBAG V", ".bag"),
    (b"\x28\xb5\x2f\xfd", ".zst"),
    (b"\x1f\x8b", ".gz"),
    (b"\x04\x22\x4d\x18", ".lz4"),
    (b"BZh", ".bz2"),
    (b"\xfd7zXZ", ".xz"),
    (b"PK\x03\x04", ".zip"),
)
"""First bytes of files, and the suffix that stands for their kind."""
_TOOLS = {
    **{".zst": "unzstd", ".zstd": "unzstd", ".gz": "gunzip", ".lz4": "unlz4"},
    **{".bz2": "bunzip2", ".xz": "unxz", ".zip": "unzip"},
}
_MAX_LISTED = 8
"""Most names of a folder's content in a message."""


def kind_of(path: Path) -> str:
    """Kind of a file by its first bytes, else by its name, as a suffix in lower case."""
    with path.open("rb") as file:
        start = file.read(16)
    return next((kind for first, kind in _STARTS if start.startswith(first)), path.suffix.lower())


def source_of(path: Path | str) -> tuple[Path, bool]:
    """Find what a path names.

    Parameters
    ----------
    path : path
        A CSV file of detections, a bag's file, the metadata.yaml of a bag, or a folder.

    Returns
    -------
    source : Path
        The CSV file, or the file or folder of the bag.
    is_bag : bool

    Raises
    ------
    ValueError
        If it is no recording; the message says what was found, what was expected, and the remedy.
    """
    path = Path(path)
    if path.name == METADATA:
        path = path.parent
    try:
        return _in_folder(path) if path.is_dir() else _file(path)
    except OSError as error:
        raise ValueError(f"{path} cannot be read: {error.strerror}; {EXPECTED}") from None


def _file(path: Path) -> tuple[Path, bool]:
    kind = kind_of(path)
    if kind in (CSV, MCAP, SQLITE):
        return path, kind != CSV
    remedy = (
        _ROS_1 if kind == ".bag" else _PACKED if kind in _TOOLS else f"is no recording; {EXPECTED}"
    )
    raise ValueError(f"{path} {remedy.format(path=path, tool=f'{_TOOLS.get(kind)} {path}')}")


def _in_folder(folder: Path) -> tuple[Path, bool]:
    names = sorted(path.name for path in folder.iterdir() if not path.name.startswith("."))
    whole = [name for name in (METADATA, DETECTIONS_FILE) if name in names]
    if len(whole) == 1:
        return (folder, True) if whole == [METADATA] else (folder / DETECTIONS_FILE, False)
    paths = [folder / name for name in names]
    kinds = {path: kind_of(path) for path in paths if path.is_file()}
    candidates = [path for path in kinds if kinds[path] in (CSV, MCAP, SQLITE, ".bag", *_TOOLS)]
    if len(candidates) == 1 and CSV not in kinds.values():
        return _file(candidates[0])
    listed = ", ".join(names[:_MAX_LISTED]) + (" ..." if len(names) > _MAX_LISTED else "")
    remedy = "name one of its files" if kinds else "name a folder or a file in it"
    if not whole and {MCAP, SQLITE} & set(kinds.values()):
        remedy += f", or write {METADATA} by ros2 bag reindex {folder}"
    raise ValueError(f"{folder} holds {listed or 'nothing'}; {EXPECTED}: {remedy}")
