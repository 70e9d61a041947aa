"""The text that a node prints for ``--help``."""

from __future__ import annotations

import textwrap

from tsepm_ros.parameters import table
from tsepm_ros.settings.tables import NODES

WIDTH = 100
_EXAMPLES = {
    "track_initiator": "-r detections:=/my_sonar/detections -p max_speed:=5.0",
    "sonar_simulator": "-p scenario:=four_targets -p rate_factor:=10.0",
    "scan_player": "-p recording:=my_recording -p rate_factor:=10.0",
    "track_viewer": "-r tracks/current:=/my_boat/tracks/current -p port:=8080",
}
_TOPICS = {
    "track_initiator": "subscribes to detections, own_ship/odometry and tracked; publishes tracks, "
    "tracks/current, tracks/markers and others (docs/topics.md)",
    "sonar_simulator": "publishes detections, own_ship/odometry and ground_truth (docs/topics.md)",
    "scan_player": "publishes detections, own_ship/odometry and ground_truth (docs/topics.md)",
    "track_viewer": "subscribes to tracks/current, fixed_echoes and others "
    "(docs/watch_and_operate.md)",
}


def help_text(node: str, summary: str | None) -> str:
    """Usage, an example, the topics, and the parameters' names with where they are described.

    Parameters
    ----------
    node : str
        Name of the executable, a key of NODES.
    summary : str or None
        What the node does; its first line is used.
    """
    parts = [
        f"usage: ros2 run tsepm_ros {node} [-h] [--ros-args [-p NAME:=VALUE] "
        "[-r TOPIC:=OTHER] [--params-file FILE] [-r __ns:=/NAMESPACE]]",
        (summary or "").splitlines()[0],
        f"example: ros2 run tsepm_ros {node} --ros-args {_EXAMPLES[node]}",
        f"topics: {_TOPICS[node]}",
        *_parameter_lines(node),
        f"Descriptions, units, bounds and defaults: tsepm parameters {node} (a parameter file to "
        f"edit; also in share/tsepm_ros/config/{node}.yaml), or docs/parameters.md. Numbers that "
        "are not integers need their decimal point: 5.0, not 5.",
    ]
    return "\n\n".join(textwrap.fill(part, WIDTH, subsequent_indent="  ") for part in parts)


def _parameter_lines(node: str) -> list[str]:
    """A paragraph of names per prefix."""
    names: dict[str, list[str]] = {}
    for prefix, group in NODES[node]:
        names.setdefault(prefix, []).extend(row.name for row in table(group))
    return [
        f"{f'parameters {prefix}*' if prefix else 'parameters'}: {', '.join(group)}"
        for prefix, group in names.items()
    ]
