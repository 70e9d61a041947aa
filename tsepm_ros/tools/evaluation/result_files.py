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
"""Files of results: of runs, with which an interrupted study continues, and of their tables.

Runs are made in several processes. A file of runs is JSON lines: a header with what its runs depend
on, then a line per run. Its name has a digest of the header, so that other options, another seed or
another version have other files. A result file has the tables of a command, with everything that is
needed to repeat them.
"""

from __future__ import annotations

import argparse
import ast
import functools
import hashlib
import importlib.util
import itertools
import json
import multiprocessing
import os
import platform
import re
import signal
import sys
import threading
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from importlib.machinery import PathFinder
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

import tsepm_ros
from tsepm_ros.ending_signals import ending_signals_held
from tsepm_ros.tools.terminal import Progress, silent_terminal
from tsepm_ros.whole_files import read_json, read_whole_text, write_whole_text, written_whole

Job = TypeVar("Job")
Made = TypeVar("Made")

MAX_ENDS = 3
"""Ends of processes in a row, without a result in between, after which a study ends."""
WATCH_PERIOD = 0.5
"""Time between a worker's checks of its parent, s."""
PACKAGE = Path(tsepm_ros.__file__).parent
INSTALLED = re.compile(
    "|".join(
        [
            *map(re.escape, (str(PACKAGE), sys.prefix, sys.base_prefix)),
            r".*[/\\](site|dist)-packages",
        ]
    )
)
"""Begin of the path of a module of the package, or of an installed module."""
GOLDENS = PACKAGE.parent / "test" / "golden"


def _attach_result_worker() -> None:
    """Prepare a worker process, which ends with the process that started it.

    An interrupt from the terminal reaches all processes; the starting process ends the others. If
    it is killed, nobody does, so each worker watches it.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    threading.Thread(target=_end_result_worker, args=(os.getppid(),), daemon=True).start()


def _end_result_worker(process: int) -> None:
    """End this process once its parent, whose id is given, has ended."""
    parent = multiprocessing.parent_process()
    while os.getppid() == process and parent is not None and parent.is_alive():
        time.sleep(WATCH_PERIOD)
    os._exit(1)


def mapped_results(
    function: Callable[[Job], Made], jobs: Sequence[Job], processes: int | Executor = 1
) -> Generator[Made, None, None]:
    """Results of a function for each job, in their order; closed early, no more are done.

    Parameters
    ----------
    function : callable
        A function that can be imported by its name.
    jobs : sequence
    processes : int or Executor, optional
        Number of processes on this machine; 1 means this process alone. An executor of another
        kind, such as that of a cluster, replaces its lost workers by itself and stays open.
    """
    made: dict[int, Made] = {}
    results = completed_results(function, jobs, processes)
    for place in range(len(jobs)):
        while place not in made:
            made |= [next(results)]
        yield made.pop(place)


def completed_results(
    function: Callable[[Job], Made], jobs: Sequence[Job], processes: int | Executor = 1
) -> Generator[tuple[int, Made], None, None]:
    """Places of jobs and their results, as they are completed; see `mapped_results`.

    A process that ends, as where the system kills it for want of memory, is replaced, and its job
    done again.

    Raises
    ------
    OSError
        If processes ended `MAX_ENDS` times without a result in between.
    """
    if processes == 1:
        yield from enumerate(map(function, jobs))
        return
    if isinstance(processes, Executor):
        places = {processes.submit(function, job): place for place, job in enumerate(jobs)}
        try:
            yield from ((places[future], future.result()) for future in as_completed(places))
        finally:
            for future in places:
                future.cancel()
        return
    waiting, ends = dict(enumerate(jobs)), 0
    while waiting:
        pool = ProcessPoolExecutor(processes, initializer=_attach_result_worker)
        try:
            with ending_signals_held():  # the first job starts the processes
                futures = {pool.submit(function, job): place for place, job in waiting.items()}
            for future in as_completed(futures):
                result, ends = future.result(), 0
                del waiting[futures[future]]
                yield futures[future], result
        except BrokenProcessPool:
            ends += 1
            if ends == MAX_ENDS:
                raise OSError(
                    f"processes of the study were ended {ends} times, by the system if memory is "
                    "short: give fewer --workers"
                ) from None
        finally:
            pool.shutdown(cancel_futures=True)


def result_goldens_digest() -> str:
    """Digest of the golden outputs, with which figures are measured; empty outside a source tree.

    It changes where results change on purpose, not where code is renamed, moved or made faster.
    """
    return _result_digest(GOLDENS.glob("*.json")) if GOLDENS.is_dir() else ""


@functools.cache
def result_code_key(*files: Path) -> str:
    """Digest of the package's modules, and of other files, by which stored runs are found again.

    Any change of the code discards an unfinished study: its runs are of one code.
    """
    return _result_digest([*PACKAGE.rglob("*.py"), *files])


def result_outside_files(*objects: Any) -> list[Path]:
    """Files of the user's own code, if one of some functions or classes is not of the package.

    These are all modules that are loaded and not installed, since a method may be made of several;
    modules that they import later, as within a function; and files that an object names in its
    attribute ``files``, such as weights.
    """
    own = {item.__module__ for item in objects if not item.__module__.startswith("tsepm_ros.")}
    waiting = [*sys.modules] if own else []
    files: dict[str, Path] = {}
    while waiting:
        name = waiting.pop()
        file = _module_file(name)
        if name not in files and file and (name in own or not INSTALLED.match(file)):
            files[name] = Path(file)
            waiting += _imported_names(name, files[name])
    named = (Path(file) for item in objects for file in getattr(item, "files", ()))
    return [*dict.fromkeys([*files.values(), *named])]


def _module_file(name: str) -> str | None:
    """The file of a module, loaded or not, which is not imported for that; None without one."""
    if name in sys.modules:
        return getattr(sys.modules[name], "__file__", None)
    folders, spec = None, None
    for part in itertools.accumulate(name.split("."), "{}.{}".format):
        spec = PathFinder.find_spec(part, folders)
        folders = spec.submodule_search_locations or [] if spec else []
    return spec.origin if spec else None


def _imported_names(name: str, file: Path) -> Iterator[str]:
    """Modules that the statements of a module import, those within functions too."""
    package = name if file.stem == "__init__" else name.rpartition(".")[0]
    with suppress(SyntaxError, ValueError, ImportError):  # no source
        for node in ast.walk(ast.parse(file.read_bytes())):
            if isinstance(node, ast.Import):
                yield from (alias.name for alias in node.names)
            elif isinstance(node, ast.ImportFrom):
                relative = "." * node.level + (node.module or "")
                base = importlib.util.resolve_name(relative, package)
                yield from (base, *(f"{base}.{alias.name}" for alias in node.names))


def _result_digest(files: Iterable[Path]) -> str:
    content = hashlib.sha256()
    for path in sorted(files):
        content.update(path.name.encode() + path.read_bytes())
    return content.hexdigest()[:8]


class ResultRunFile:
    """The finished runs of a study; an incomplete last line is removed from the file.

    Parameters
    ----------
    folder : Path
        Folder of the file.
    names : sequence of str
        Parts of the file's name.
    header : mapping
        Everything that the runs depend on: numbers, texts, arrays, lists and mappings of these.

    Attributes
    ----------
    path : Path
    results : dict
        Result of each run, as JSON, by the run's index.

    Raises
    ------
    ValueError
        If the existing file has another header or is damaged before its last line.
    """

    def __init__(self, folder: Path, names: Sequence[str], header: Mapping[str, Any]) -> None:
        text = json.dumps(header, default=np.ndarray.tolist)
        code = hashlib.sha256(text.encode()).hexdigest()[:8]
        name = "-".join(re.sub(r"\W+", "_", part) for part in names)
        self.path = folder / f"{name}-{code}.jsonl"
        folder.mkdir(parents=True, exist_ok=True)
        content = self.path.read_bytes() if self.path.exists() else b""
        head, _, runs = content.partition(b"\n")
        if f"{text}\n".encode().startswith(content):
            write_whole_text(self.path, text + "\n")
        elif head != text.encode():
            raise ValueError(
                f"{self.path} is not a run file of this study: it was made by another version, "
                "method, options, scenario or seed, or is a file of others; move it away"
            )
        whole = runs[: runs.rfind(b"\n") + 1]
        if len(whole) < len(runs):
            with written_whole(self.path) as temporary:
                temporary.write_bytes(head + b"\n" + whole)
        self.results: dict[int, Any] = dict(map(self._run, whole.splitlines()))

    def append(self, index: int, result: Any) -> None:
        """Add a run and write it at once."""
        with self.path.open("a", encoding="utf-8") as file:
            file.write(json.dumps([index, result]) + "\n")
        self.results[index] = result

    def _run(self, line: bytes) -> tuple[int, Any]:
        """The index and the result of a run."""
        with suppress(TypeError, ValueError):
            index, result = read_json(line)
            if type(index) is int:
                return index, result
        raise ValueError(
            f"{self.path} is damaged: {line[:40]!r} is not a run; remove the line or the file"
        )


def complete_result_files(
    files: Sequence[ResultRunFile],
    runs: int,
    function: Callable[[Job], Any],
    job_of: Callable[[int, int], Job],
    *,
    processes: int | Executor = 1,
    progress: Progress = silent_terminal,
) -> Iterator[list[Any]]:
    """Do the missing runs of each file, and give all, as JSON, of each file once it is complete.

    Parameters
    ----------
    files : sequence of ResultRunFile
    runs : int
    function : callable
        Does a job and returns its result as JSON; importable by its name.
    job_of : callable
        The job of a file and a run, given by their indices.
    processes : int or Executor, optional
        See `mapped_results`.
    progress : callable, optional
        Shows the number of missing runs that are done.
    """
    missing = [
        (row, index)
        for row, file in enumerate(files)
        for index in range(runs)
        if index not in file.results
    ]
    jobs = [job_of(*place) for place in missing]
    results = iter(progress(completed_results(function, jobs, processes), len(jobs)))
    for file in files:
        while not file.results.keys() >= {*range(runs)}:
            job, result = next(results)
            row, index = missing[job]
            files[row].append(index, result)
        yield [file.results[index] for index in range(runs)]
    next(results, None)  # ends the processes and the bar


Row = Mapping[str, Any]


@dataclass(frozen=True, kw_only=True)
class Result:
    """Figures of a command.

    Attributes
    ----------
    command : str
        The command that repeats them.
    version : str
        Release of the package.
    goldens : str
        Digest of the golden outputs, see `result_goldens_digest`.
    seed, runs : int
    parameters : mapping
        Parameters that differ from the defaults.
    header : list of str
    rows : list of list of str
        The table as printed.
    measures : list of mapping, optional
        The same figures as numbers, null for an unknown one.
    numpy, python : str
        Versions of what they were computed with.
    """

    command: str
    seed: int
    runs: int
    header: list[str]
    rows: list[list[str]]
    parameters: Mapping[str, Any] = field(default_factory=dict)
    measures: Sequence[Row] = field(default_factory=list)
    version: str = tsepm_ros.__version__
    goldens: str = field(default_factory=result_goldens_digest)
    numpy: str = np.__version__
    python: str = field(default_factory=platform.python_version)


def add_result_file(parser: argparse.ArgumentParser) -> None:
    """Add the path of the result file."""
    parser.add_argument(
        "--result",
        type=Path,
        help="also write the figures to a JSON file, see docs/contributing.md",
    )


def write_result(path: Path, result: Result) -> None:
    """Write a result file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole_text(path, json.dumps(asdict(result), indent=1, ensure_ascii=False) + "\n")


def read_result(path: Path) -> Result:
    """Read a result file.

    Raises
    ------
    ValueError
        If it is not a result file.
    """
    try:
        return Result(**read_json(read_whole_text(path)))
    except (TypeError, ValueError) as error:
        raise ValueError(f"{path} is not a result file: {error}") from None
