"""The tables of parameters as YAML and Markdown."""

from __future__ import annotations

from collections.abc import Mapping

from tsepm_ros.methods.registry import METHODS
from tsepm_ros.settings.tables import Groups, full_table
from tsepm_ros.settings.value_text import yaml_text


def as_yaml(node: str, groups: Groups) -> str:
    """A parameter file with every parameter's default, as ROS reads it."""
    lines = [f"{node}:", "  ros__parameters:"]
    for row in full_table(groups):
        note = ", ".join(part for part in (row.unit, row.bounds) if part)
        lines.append(f"    # {row.description}{f' [{note}]' if note else ''}")
        lines.append(f"    {row.name}: {yaml_text(row.default)}")
    return "\n".join(lines) + "\n"


def as_page(nodes: Mapping[str, Groups]) -> str:
    """The documentation's page of parameters: a section per node, a table per prefix."""
    parts = [
        "# Parameters",
        "Made by `tsepm parameters all --markdown`; a test compares. How to find the values that "
        "your sonar needs: [tuning](tuning.md). A number is written with its point, 4.0 and not 4: "
        "ROS parameters are typed. What is *live* may change while the node runs and takes effect "
        "at the next scan.",
    ]
    for node, groups in nodes.items():
        parts.append(f"## `{node}`")
        for prefix in dict.fromkeys(prefix for prefix, _ in groups):
            method = prefix.removesuffix(".")
            if prefix:
                parts.append(f"### `{prefix}*`")
            if method in METHODS:
                parts.append(f"Of the method [`{method}`](methods/{method}.md).")
            parts.append(
                as_markdown(tuple(group for group in groups if group[0] == prefix)).rstrip()
            )
    return "\n\n".join(parts) + "\n"


def as_markdown(groups: Groups) -> str:
    """A table of all parameters for the documentation."""
    lines = [
        "| parameter | default | unit | allowed | live | meaning |",
        "|---|---|---|---|---|---|",
    ]
    lines += [
        f"| `{row.name}` | `{yaml_text(row.default)}` | {row.unit} | {row.bounds} "
        f"| {'no' if row.read_only else 'yes'} | {row.description} |"
        for row in full_table(groups)
    ]
    return "\n".join(lines) + "\n"
