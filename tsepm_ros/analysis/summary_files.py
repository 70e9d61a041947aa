"""Files of run records, to which an interrupted evaluation comes back.

A file is JSON lines: a header that says what its runs depend on, then a line per run. Its name has
a digest of the header, so that other options, another seed or another version have other files.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import re
from pathlib import Path
from typing import IO, Any

import numpy as np

from tsepm_ros.analysis.operating_points import OperatingPoint, digest
from tsepm_ros.analysis.run_summary import RunSummary
from tsepm_ros.simulation import Scenario

JUDGES = ("bounds", "gospa", "run_summary", "simulated_run", "truth")
"""Modules here that decide what is recorded of a run."""


def header_of(scenario: Scenario, point: OperatingPoint, seed: int) -> dict[str, Any]:
    """What the records of a file depend on, as JSON gives it back."""
    here = Path(__file__).parent
    code = [*(here / f"{name}.py" for name in JUDGES), *(here.parent / "simulation").glob("*.py")]
    content = {
        "version": point.version,
        "simulated_and_judged_by": digest(code),
        "method": point.method,
        "options": dict(point.options),
        "scenario": dataclasses.asdict(scenario),
        "seed": seed,
    }
    header: dict[str, Any] = json.loads(json.dumps(content, default=np.ndarray.tolist))
    return header


class SummaryFile:
    """The recorded runs of an operating point on a scenario.

    Parameters
    ----------
    folder : Path
        Where the file is, or will be.
    scenario : Scenario
    point : OperatingPoint
    seed : int

    Attributes
    ----------
    path : Path
    records : dict of int to RunRecord
        By the index of the run.

    Raises
    ------
    ValueError
        If the file there has another header or is damaged in the middle.
    """

    def __init__(self, folder: Path, scenario: Scenario, point: OperatingPoint, seed: int) -> None:
        header = header_of(scenario, point, seed)
        code = hashlib.sha256(json.dumps(header, sort_keys=True).encode()).hexdigest()[:8]
        names = (scenario.name, point.method, point.label)
        name = "-".join(re.sub(r"\W+", "_", part) for part in names)
        self.path = folder / f"{name}-{code}.jsonl"
        self.records: dict[int, RunSummary] = {}
        self._file: IO[str] | None = None
        folder.mkdir(parents=True, exist_ok=True)
        lines = self._whole_lines()
        if not lines:
            self.path.write_text(json.dumps(header) + "\n", encoding="utf-8")
            return
        if self._parsed(lines[0]) != header:
            raise ValueError(
                f"{self.path} was made by another version, method, options, scenario or seed"
            )
        for line in lines[1:]:
            content = self._parsed(line)
            self.records[content.pop("run")] = RunSummary.from_json(content)

    def __enter__(self) -> SummaryFile:
        """Open the file for more runs."""
        self._file = self.path.open("a", encoding="utf-8")
        return self

    def __exit__(self, *_: object) -> None:
        """Close it."""
        assert self._file is not None
        self._file.close()

    def append(self, index: int, record: RunSummary) -> None:
        """Add a run to the open file; a killed process does not lose it."""
        assert self._file is not None
        self._file.write(json.dumps({"run": index, **record.as_json()}) + "\n")
        self._file.flush()
        self.records[index] = record

    def _whole_lines(self) -> list[bytes]:
        """The file's lines; a last one that was cut off is removed from it."""
        if not self.path.exists():
            return []
        content = self.path.read_bytes()
        whole = content[: content.rfind(b"\n") + 1]
        if len(whole) < len(content):
            with self.path.open("r+b") as file:
                file.truncate(len(whole))
        return whole.splitlines()

    def _parsed(self, line: bytes) -> dict[str, Any]:
        try:
            content: dict[str, Any] = json.loads(line)
        except ValueError:
            raise ValueError(f"{self.path} is damaged: {line[:40]!r} is not a run") from None
        return content
