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
"""Report of the peer timing as text and as JSON."""

from __future__ import annotations

import dataclasses
import itertools
import json
import math
import os
import platform
import re
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

import clutter_figures as figures
from clutter_figures import Summary, Timing, raw_before_cut, settled, summarise

from tsepm_ros.tools.terminal import terminal_table

PACKAGES = ("numpy", "scipy", "stonesoup", "norfair")


def timing_text(timing: Timing) -> str:
    """Times, ratios, memory and tracks of one timing, then its counts."""
    summaries = {name: summarise(timing, name) for name in timing.peers}
    mean = sum(len(scan) for scan in timing.scene.scans) / len(timing.scene.scans)
    title = f"clutter {timing.density:.3g} per m^2 ({timing.name}), {mean:.0f} detections a scan"
    remarks = [f"\n! {name}: {item.stopped}" for name, item in summaries.items() if item.stopped]
    return f"\n{title}\n{_times(summaries)}\n\n{_counts(timing, summaries)}{''.join(remarks)}"


def _times(summaries: dict[str, Summary]) -> str:
    head = ["time per scan, ms", "scans", "median", "p95", "worst", "cpu ratio", "10-90 %"]
    head += ["in sum", "MB", "at start", "new tracks", "of target", "first in"]
    rows = []
    for name, item in summaries.items():
        ratio = ["-", "-", "-"]
        if item.ratio is not None:
            interval = f"{item.ratio.low:.3g}-{item.ratio.high:.3g}"
            ratio = [f"{item.ratio.median:.3g}", interval, f"{item.ratio.over_run:.3g}"]
        times = [_number(1e3 * value) for value in (item.median, item.p95, item.worst)]
        memory = [_number(item.memory), _number(item.memory_at_start)]
        first = str(item.first_of_target) if item.of_target else "-"
        tracks = [str(item.new), str(item.of_target), first]
        rows.append([name, str(item.scans), *times, *ratio, *memory, *tracks])
    return terminal_table(head, rows)


def _counts(timing: Timing, summaries: dict[str, Summary]) -> str:
    head = ["counts per scan", "potential", "theory", "most", "theory"]
    head += ["raw", "theory", "most", "theory", "confirmed", "cut in all"]
    rows = []
    for name, item in summaries.items():
        if not item.scans:
            continue
        mean, most = item.mean_counts, item.most
        potential = [_number(mean["potential"]), "-", str(most["potential"]), "-"]
        raw = ["-", "-", "-", "-"]
        if "raw" in mean:
            raw = [_number(raw_before_cut(mean)), "-", str(most["raw"]), "-"]
        if name in timing.theory:
            theory, part = timing.theory[name], settled(item.scans)
            potential[1] = _number(theory.potential[part].mean())
            potential[3] = _number(theory.potential.max())
            raw[1] = _number(theory.raw[part].mean())
            raw[3] = _number(theory.raw.max())
        rows.append([name, *potential, *raw, _number(mean["confirmed"]), str(item.cut)])
    return terminal_table(head, rows)


def _number(value: float) -> str:
    if math.isnan(value):
        return "-"
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"


def growth_text(timings: Sequence[Timing]) -> str:
    """Exponents between neighbouring densities, and the fitted cost of each count."""
    head = ["d log / d log(clutter)"]
    head += [f"{low.name}..{high.name}" for low, high in itertools.pairwise(timings)]
    rows = [
        [row, *("-" if math.isnan(value) else f"{value:.2f}" for value in values)]
        for row, values in figures.exponents(timings).items()
    ]
    lines = [terminal_table(head, rows), ""]
    for name in timings[0].theory:
        cost = figures.fit_cost(timings, name)
        if cost is not None:
            lines.append(
                f"{name}: {1e3 * cost.scan:.2f} ms per scan + {1e6 * cost.detection:.2f} us per "
                f"detection + {1e6 * cost.potential:.2f} us per potential track + "
                f"{1e6 * cost.raw:.2f} us per raw confirmation (fit)"
            )
    return "\n".join(lines)


def agreement_text(timings: Sequence[Timing]) -> str:
    """In how many scans the tracks are those of the oracle."""
    scans, same_tracks, same_hits = figures.agreement(timings)
    return f"the oracle's tracks in {same_tracks} of {scans} scans, its hits in {same_hits}"


def environment() -> dict[str, Any]:
    """Versions and processor of this machine."""
    installed = {package.name: package.version for package in metadata.distributions()}
    return {
        "python": platform.python_version(),
        "processor": _processor(),
        "processors": os.cpu_count(),
        **{name: installed.get(name, "not installed") for name in PACKAGES},
    }


def _processor() -> str:
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        text = ""
    model = re.search(r"^model name\s*: (.*)", text, re.MULTILINE)
    return model[1] if model else platform.processor()


def as_json(timings: Sequence[Timing], options: dict[str, Any]) -> str:
    """All measurements with the figures derived from them."""
    content = {
        "environment": environment(),
        "options": options,
        "densities": [_timing_content(timing) for timing in timings],
        "exponents": figures.exponents(timings),
    }
    # nan becomes null: JSON has no nan.
    return json.dumps(json.loads(json.dumps(content), parse_constant=lambda _: None), indent=1)


def _timing_content(timing: Timing) -> dict[str, Any]:
    return {
        "name": timing.name,
        "clutter_density": timing.density,
        "theory": {
            name: {key: array.tolist() for key, array in vars(expected).items()}
            for name, expected in timing.theory.items()
        },
        "contenders": {
            name: {
                **dataclasses.asdict(summarise(timing, name)),
                "seconds": peer.seconds,
                "cpu_seconds": peer.cpu,
                "counts": peer.counts,
            }
            for name, peer in timing.peers.items()
        },
    }
