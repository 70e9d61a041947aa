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
"""Files that are written whole or not at all, and texts that are read whole.

The content goes to a temporary file in the same folder, which is synchronised to the disk and then
renamed: a reader sees the earlier file or the new one, also after a kill or on a full disk.
"""

from __future__ import annotations

import csv
import errno
import glob
import io
import os
import re
import secrets
import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

_REMEDIES = {
    errno.ENOENT: "check the path",
    errno.EISDIR: "name a file in it",
    errno.ENOTDIR: "name the folder, not a file in it",
    errno.EACCES: "check its permissions",
}
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_TEMPORARY = re.compile(r"\.(?P<name>.+)\.(?P<process>\d+)-[0-9a-f]{8}\.part(\.\w+)?")


def temporary_beside_file(path: Path) -> Path:
    """A free path in the folder of a file, with the same suffix, for its content until it is whole.

    Temporary files and folders that processes which no longer exist have left of the same file are
    removed.
    """
    for other in path.parent.glob(f".{glob.escape(path.name)}.*"):
        match = _TEMPORARY.fullmatch(other.name)
        if match and match["name"] == path.name and not _file_process_exists(int(match["process"])):
            remove_whole_file(other)
    return path.with_name(f".{path.name}.{os.getpid()}-{secrets.token_hex(4)}.part{path.suffix}")


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """Give a temporary path to write to; at the end of the block the file is moved to `path`.

    If the block ends with an error, the temporary file is removed and `path` is as before. A path
    that is no regular file, such as /dev/stdout, is given itself.
    """
    path = Path(os.path.realpath(path))  # a link stays a link
    if path.exists() and not path.is_file():
        yield path
        return
    temporary = temporary_beside_file(path)
    try:
        with naming_file(path):
            yield temporary
            move_whole(temporary, path)
    finally:
        remove_whole_file(temporary)


@contextmanager
def naming_file(path: Path | str) -> Iterator[None]:
    """Give the error of a full disk, which names no file, the name of the file that is written."""
    try:
        yield
    except OSError as error:
        if error.errno not in _FULL or error.filename is not None:
            raise
        raise OSError(error.errno, error.strerror, str(path)) from error


def file_error_sentence(error: OSError | UnicodeDecodeError) -> str:
    """Name the cause and the remedy of an error of a file, without the error's number."""
    if isinstance(error, UnicodeDecodeError):
        return f"it is no text in UTF-8 ({error.reason} at byte {error.start}); name another file"
    return "; ".join(filter(None, (error.strerror or str(error), _REMEDIES.get(error.errno or 0))))


def read_whole_text(path: Path) -> str:
    """Read a text in UTF-8, with or without a byte order mark, line ends unchanged.

    Raises
    ------
    ValueError
        It names the file, the cause and the remedy.
    """
    try:
        return path.read_bytes().decode("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"{path} cannot be read: {file_error_sentence(error)}") from None


def read_whole_csv(path: Path) -> list[tuple[int, list[str]]]:
    """Read the lines of a CSV file that are not blank, each with its number; the first is there.

    Raises
    ------
    ValueError
        It names the file, the cause and the remedy.
    """
    reader = csv.reader(io.StringIO(read_whole_text(path), newline=""))
    try:
        lines = [(reader.line_num, row) for row in reader if any(map(str.strip, row))]
    except csv.Error as error:
        raise ValueError(f"{path} is not a CSV file: {error}") from None
    if not lines:
        raise ValueError(f"{path} is empty: its first line names the columns")
    return lines


@contextmanager
def opened_whole(path: Path) -> Iterator[TextIO]:
    """Give a text file to write to, UTF-8 without conversion of line ends; see `written_whole`."""
    with (
        written_whole(path) as temporary,
        temporary.open("w", encoding="utf-8", newline="") as file,
    ):
        yield file


def spare_files(inputs: Iterable[Path], outputs: Iterable[Path]) -> None:
    """Refuse outputs that are inputs, by whatever name.

    Raises
    ------
    ValueError
        It names the file.
    """
    there = [path for path in inputs if os.path.exists(path)]
    for path in filter(os.path.exists, outputs):
        if any(os.path.samefile(path, output) for output in there):
            raise ValueError(f"{path} is read here and is not overwritten: give another output")


def write_whole_text(path: Path, text: str) -> None:
    """Write a text as UTF-8; see `written_whole`."""
    with opened_whole(path) as file:
        file.write(text)


def move_whole(temporary: Path, path: Path) -> None:
    """Synchronise a temporary file to the disk and move it to its path on the same disk."""
    _synchronise_file(temporary)
    os.replace(temporary, path)
    _synchronise_file(path.parent)


def remove_whole_file(path: Path) -> None:
    """Remove a file or a folder with its content, if it exists."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


def _synchronise_file(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _file_process_exists(process: int) -> bool:
    """Whether a process of this machine has this id."""
    try:
        os.kill(process, 0)
    except OSError as error:
        return not isinstance(error, ProcessLookupError)  # others belong to somebody else
    return True
