"""The race's figures as text and as JSON."""

from __future__ import annotations

import dataclasses
import itertools
import json
import math
import os
import platform
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

from clutter_figures import (
    Heat,
    Requirement,
    Summary,
    exponents,
    fit_cost,
    raw_before_cut,
    requirements,
    settled,
    summarise,
)

PACKAGES = ("numpy", "scipy", "stonesoup", "norfair")


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Rows under a head, columns as wide as needed, the first one to the left."""
    widths = [max(len(row[column]) for row in [head, *rows]) for column in range(len(head))]

    def line(row: Sequence[str]) -> str:
        first = row[0].ljust(widths[0])
        rest = [cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True)]
        return "  ".join([first, *rest]).rstrip()

    return "\n".join([line(head), *map(line, rows)])


def heat_text(heat: Heat) -> str:
    """Times, ratios, memory and tracks of one heat, then its counts."""
    sea = heat.scene.sea
    summaries = {name: summarise(heat, name) for name in heat.lanes}
    mean = sum(len(scan) for scan in heat.scene.scans) / len(heat.scene.scans)
    title = f"clutter {sea.clutter_density:.3g} per m^2 ({heat.name}), {mean:.0f} detections a scan"
    return f"\n{title}\n{_times(summaries)}\n\n{_counts(heat, summaries)}{_remarks(summaries)}"


def _times(summaries: dict[str, Summary]) -> str:
    head = ["time per scan, ms", "scans", "median", "p95", "worst"]
    head += [
        "cpu ratio",
        "10-90 %",
        "in sum",
        "MB",
        "at start",
        "new tracks",
        "of target",
        "first in",
    ]
    rows = []
    for name, item in summaries.items():
        ratio = ["-", "-", "-"]
        if item.ratio is not None:
            spread = f"{item.ratio.low:.3g}-{item.ratio.high:.3g}"
            ratio = [f"{item.ratio.median:.3g}", spread, f"{item.ratio.over_run:.3g}"]
        times = [_number(1e3 * value) for value in (item.median, item.p95, item.worst)]
        memory = [_number(item.memory), _number(item.memory_at_start)]
        first = str(item.first_of_target) if item.of_target else "-"
        tracks = [str(item.new), str(item.of_target), first]
        rows.append([name, str(item.scans), *times, *ratio, *memory, *tracks])
    return table(head, rows)


def _counts(heat: Heat, summaries: dict[str, Summary]) -> str:
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
        if name in heat.theory:
            theory, part = heat.theory[name], settled(item.scans)
            potential[1] = _number(theory.potential[part].mean())
            potential[3] = _number(theory.potential.max())
            raw[1] = _number(theory.raw[part].mean())
            raw[3] = _number(theory.raw.max())
        rows.append([name, *potential, *raw, _number(mean["confirmed"]), str(item.cut)])
    return table(head, rows)


def _remarks(summaries: dict[str, Summary]) -> str:
    return "".join(
        f"\n! {name}: {item.stopped}" for name, item in summaries.items() if item.stopped
    )


def _number(value: float) -> str:
    if math.isnan(value):
        return "-"
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"


def growth_text(heats: Sequence[Heat]) -> str:
    """Exponents between neighbouring densities, and what a unit of each count costs."""
    head = ["d log / d log(clutter)"]
    head += [f"{one.name}..{other.name}" for one, other in itertools.pairwise(heats)]
    rows = [
        [row, *("-" if math.isnan(value) else f"{value:.2f}" for value in values)]
        for row, values in exponents(heats).items()
    ]
    lines = [table(head, rows), ""]
    for name in heats[0].theory:
        cost = fit_cost(heats, name)
        if cost is not None:
            lines.append(
                f"{name}: {1e3 * cost.scan:.2f} ms per scan + {1e6 * cost.detection:.2f} us per "
                f"detection + {1e6 * cost.potential:.2f} us per potential track + "
                f"{1e6 * cost.raw:.2f} us per raw confirmation (fit)"
            )
    return "\n".join(lines)


def requirements_text(found: Sequence[Requirement]) -> str:
    """A line per requirement."""
    words = {True: "holds", False: "FALLS SHORT", None: "-"}
    return "\n".join(f"{words[item.holds]:11s}  {item.text}: {item.measured}" for item in found)


def environment() -> dict[str, Any]:
    """What was measured on."""
    versions = {}
    for name in PACKAGES:
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            versions[name] = "not installed"
    return {
        "python": platform.python_version(),
        "processor": _processor(),
        "processors": os.cpu_count(),
        **versions,
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor()


def as_json(heats: Sequence[Heat], options: dict[str, Any]) -> str:
    """Everything measured, with the figures made from it."""
    content = {
        "environment": environment(),
        "options": options,
        "heats": [_heat_content(heat) for heat in heats],
        "exponents": exponents(heats),
        "requirements": [dataclasses.asdict(item) for item in requirements(heats)],
    }
    return json.dumps(_without_nan(content), indent=1)


def _heat_content(heat: Heat) -> dict[str, Any]:
    return {
        "name": heat.name,
        "clutter_density": heat.density,
        "theory": {
            name: {
                "potential": expected.potential.tolist(),
                "started": expected.started.tolist(),
                "raw": expected.raw.tolist(),
            }
            for name, expected in heat.theory.items()
        },
        "contenders": {
            name: {
                **dataclasses.asdict(summarise(heat, name)),
                "seconds": lane.seconds,
                "cpu_seconds": lane.cpu,
                "counts": lane.counts,
            }
            for name, lane in heat.lanes.items()
        },
    }


def _without_nan(value: Any) -> Any:
    """The same with None for what JSON has no number for."""
    if isinstance(value, dict):
        return {key: _without_nan(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_without_nan(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
