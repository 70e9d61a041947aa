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
"""Files that are written whole or not at all, over no file of others; texts that are read whole.

The content goes to a temporary file in the same folder, which is synchronised to the disk and then
renamed: a reader sees the earlier file or the new one, also after a kill or on a full disk.

A file is replaced or removed only if it is empty or bears a signature of this package: a result of
a command `SIGNATURE`, a file that a node keeps that of its `OwnedFile`.
"""

from __future__ import annotations

import csv
import errno
import fcntl
import glob
import io
import json
import os
import re
import secrets
import shutil
import stat
from collections.abc import Collection, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import IO, Any, TextIO

_REMEDIES = {
    errno.ENOENT: "check the path",
    errno.EISDIR: "name a file in it",
    errno.ENOTDIR: "name the folder, not a file in it",
    errno.EACCES: "check its permissions",
}
CREATOR = "tsepm_ros"
"""Stands in results whose format has room for it."""
SIGNATURE = re.compile(
    rb"\A(stamp,track_id,state_x,state_vx,state_y,state_vy,(cov_[0-3]{2},){16}evaluation,score,"
    rb"hit_count,scan_count,age,stationary_probability,signal_to_clutter_db,revision,"
    rb"existence_probability,time_since_hit,status(,sensor)?(,reason)?\n"
    rb"|stamp,track_id,gate,direction,x,y\n|stamp,target_id,state_x,state_y\n"
    rb"|scan,time_s,range_m,azimuth_rad,range_std_m,azimuth_std_rad,intensity,range_width_m,"
    rb"azimuth_width_rad,standing\n|scenario,scans,runs,seed,method,point,options,"
    rb"|# Evaluation of track initiation\n"
    rb'|# Reproduction of the published results\n|\{\s*"command": "tsepm '
    rb'|\{"type": "FeatureCollection", "generator": "tsepm_ros"'
    rb'|\{"context": "[^\n]*"\$source": "tsepm_ros"|\$[A-Z]{2}TLL,'
    rb"|\x89MCAP0.{,9000}/tracks.{,99}/tracks/current.{,99}/fixed_echoes)"
    rb'|<meta name="generator" content="tsepm_ros">|[Cc]reator.{1,80}tsepm_ros',
    re.DOTALL,
)
"""What tells a result of a command from a file of others."""
MAX_HEAD = 2**24
"""Bytes of a file in which a signature is looked for."""
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_TEMPORARY = re.compile(r"\.(?P<name>.+)\.(?P<process>\d+)-[0-9a-f]{8}\.part(\.\w+)?")


def temporary_beside_file(path: Path) -> Path:
    """A free path in the folder of a file, with the same suffix, for its content until it is whole.

    Temporary files and folders that processes which no longer exist have left of the same file are
    removed.
    """
    for other in path.parent.glob(f".{glob.escape(path.name)}.*"):
        match = _TEMPORARY.fullmatch(other.name)
        if match and match["name"] == path.name and not _process_exists(int(match["process"])):
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


def file_error_sentence(error: Exception) -> str:
    """Name the cause and the remedy of an error of a file, without the error's number."""
    if isinstance(error, UnicodeDecodeError):
        return f"it is no text in UTF-8 ({error.reason} at byte {error.start}); name another file"
    cause = getattr(error, "strerror", None) or str(error)
    return "; ".join(filter(None, (cause, _REMEDIES.get(getattr(error, "errno", 0)))))


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


def read_whole_csv(path: Path, columns: Collection[str]) -> list[tuple[int, list[str]]]:
    """Read the lines of a CSV file that are not blank, each with its number.

    The first is there and names the columns, without spaces around the names.

    Parameters
    ----------
    path : Path
    columns : collection of str
        Columns that are read: none of them may be there twice, nor in radians and in degrees.

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
    if not lines or re.search("[;\t]", lines[0][1][0].strip()):
        raise ValueError(
            f"{path} has {'semicolons' if ';' in lines[0][1][0] else 'tabs'} between its columns: "
            "write commas there, and points in numbers"
            if lines
            else f"{path} is empty: its first line names the columns"
        )
    names = [name.strip() for name in lines[0][1]]
    lines[0] = lines[0][0], names
    if cut := [line for line in lines if len(line[1]) != len(names)]:
        raise ValueError(f"{path}, line {cut[0][0]}: expected {len(names)} values, got {cut[0][1]}")
    read = [f"{name[:-4]}_rad" if name.endswith("_deg") else name for name in names]
    if twice := [name for name in read if name in columns and read.count(name) > 1]:
        raise ValueError(f"{path} has two columns {twice[0]!r}: rename or remove the wrong one")
    return lines


def read_json(text: str | bytes) -> Any:
    """The content of a JSON text of a stranger; a number beyond any float is infinite.

    Raises
    ------
    ValueError
        If it is no JSON.
    """
    try:
        return json.loads(text, parse_int=lambda digits: (int, float)[len(digits) > 300](digits))
    except RecursionError:
        raise ValueError("it is nested too deep") from None


@contextmanager
def opened_whole(path: Path) -> Iterator[TextIO]:
    """Give a text file to write to, UTF-8 without conversion of line ends; see `written_whole`.

    Bytes of names of files that are no UTF-8 are written as they are.
    """
    with (
        written_whole(path) as temporary,
        temporary.open("w", encoding="utf-8", errors="surrogateescape", newline="") as file,
    ):
        yield file


def refuse_overwriting_inputs(
    inputs: Iterable[Path], outputs: Iterable[Path], own: bytes = b""
) -> None:
    """Refuse outputs that are inputs, by whatever name, or files that others have written.

    Parameters
    ----------
    inputs, outputs : iterable of Path
    own : bytes, optional
        A file that begins so is this package's too.

    Raises
    ------
    ValueError
        It names the file.
    """
    there = [path for path in inputs if os.path.exists(path)]
    for path in filter(os.path.exists, outputs):
        if any(os.path.samefile(path, output) for output in there):
            raise ValueError(f"{path} is read here and is not overwritten: give another output")
        if not path.is_file():
            continue
        with path.open("rb") as file:
            content = file.read(MAX_HEAD)
        if content and not ((own and content.startswith(own)) or SIGNATURE.search(content)):
            raise ValueError(
                f"{path} is not known as a result of tsepm and is not overwritten (results of "
                "0.4.0 and earlier may bear no mark): give another output, or move or remove the "
                "file"
            )


def write_whole_text(path: Path, text: str) -> None:
    """Write a text as UTF-8; see `written_whole`."""
    with opened_whole(path) as file:
        file.write(text)


def write_whole_picture(path: Path, figure: Any, dots_per_inch: int = 100) -> None:
    """Draw a figure of matplotlib into a file, whose suffix gives the format."""
    has_room = path.suffix.lower() in (".png", ".svg", ".pdf", ".eps")
    with written_whole(path) as temporary:
        figure.savefig(
            temporary, dpi=dots_per_inch, metadata={"Creator": CREATOR} if has_room else None
        )


class OwnedFile:
    """A file that a process keeps for itself, if there is none or an earlier one of the same kind.

    Its owner holds a lock (flock) of it, which ends with the process. The file that replaces it is
    locked before it gets the name. A file of others is never changed, also if it comes later.

    Parameters
    ----------
    path : Path
    signature : pattern of bytes
        Matches the begin of such a file.
    max_size : int
        bytes.
    """

    def __init__(self, path: Path, signature: re.Pattern[bytes], max_size: int) -> None:
        self.path = Path(os.path.realpath(path))
        self._signature, self._max_size = signature, max_size
        self._held: IO[Any] | None = None

    def read(self) -> str:
        """The content; empty if there is no file.

        Raises
        ------
        OSError
            If the file is not this process's.
        UnicodeDecodeError
        """
        with suppress(FileNotFoundError):
            return self._claim().decode()
        return ""

    def write(self, text: str) -> None:
        """Write the content whole, and its folder; errors are those of `read`."""
        with suppress(FileExistsError):  # a file has the name of the folder: opening says so
            self.path.parent.mkdir(parents=True, exist_ok=True)
        self._claim(os.O_CREAT)
        with written_whole(self.path) as temporary:
            file = temporary.open("w", encoding="utf-8", newline="")
            fcntl.flock(file, fcntl.LOCK_EX)
            print(text, end="", file=file, flush=True)
        self.hold(file)

    def remove(self) -> None:
        """Remove the file, if there is one; errors are those of `read`."""
        with suppress(FileNotFoundError):
            self._claim()
            self.path.unlink()
        self.hold(None)

    def hold(self, file: IO[Any] | None) -> None:
        """Hold the lock of a file, or of none, in place of the one before."""
        if self._held is not None:
            self._held.close()
        self._held = file

    def _claim(self, flags: int = 0) -> bytes:
        """Lock the file that has the name now, and return its content."""
        flags |= os.O_RDONLY | os.O_NONBLOCK
        with ExitStack() as stack:
            file: IO[bytes] = stack.enter_context(
                open(self.path, "rb", opener=lambda path, _: os.open(path, flags))
            )
            content, state = file.read(self._max_size + 1), os.fstat(file.fileno())
            is_own = not content or self._signature.match(content)
            if not (stat.S_ISREG(state.st_mode) and is_own and len(content) <= self._max_size):
                raise OSError("it is a file of others and stays as it is: give another path")
            if self._held and os.path.samestat(state, os.fstat(self._held.fileno())):
                return content
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise OSError("another node uses it: give each node its own") from None
            self.hold(file)
            stack.pop_all()
        return content


def move_whole(temporary: Path, path: Path) -> None:
    """Synchronise a temporary file to the disk and move it to its path on the same disk."""
    _synchronise(temporary)
    os.replace(temporary, path)
    _synchronise(path.parent)


def remove_whole_file(path: Path) -> None:
    """Remove a file or a folder with its content, if it exists."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


def _synchronise(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _process_exists(process: int) -> bool:
    """Whether a process of this machine has this id."""
    try:
        os.kill(process, 0)
    except OSError as error:
        return not isinstance(error, ProcessLookupError)  # others belong to somebody else
    return True
