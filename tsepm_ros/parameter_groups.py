"""The parameter tables of the nodes: every group with the prefix of its names."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import yaml

from tsepm_ros.health import DiagnosticsOptions
from tsepm_ros.initiation.common_options import CommonOptions
from tsepm_ros.methods.registry import METHODS
from tsepm_ros.own_ship.mounting import Mounting
from tsepm_ros.parameters import (
    Parameter,
    Value,
    check_group,
    parameter,
    table,
    unknown_parameter,
)
from tsepm_ros.sensing.sensor import SensorModel
from tsepm_ros.settings import SessionOptions, Settings

SLOWEST_SOUND = 100.0
"""Slowest speed that is taken for one of sound, m/s."""


@dataclass(frozen=True, kw_only=True)
class InitiatorNodeOptions:
    """What the node `track_initiator` adds to a session."""

    detections_type: str = parameter(
        "auto", "Message type of the detections; auto: that of the publisher", read_only=True
    )
    sound_speed: float = parameter(
        0.0,
        "Where a message gives no times, echoes are of range / sound_speed after the stamp; 0: of "
        "the stamp. Where a sonar message does not give its sound speed: that, or with 0 1500 m/s",
        unit="m/s",
        minimum=0.0,
        maximum=10_000.0,
    )
    detections_reliability: str = parameter(
        "auto",
        "Reliability of the subscription; auto: what the publisher offers",
        choices=("auto", "reliable", "best_effort"),
        read_only=True,
    )
    detections_depth: int = parameter(
        1000, "Scans that may queue up in a burst", minimum=1, maximum=100_000, read_only=True
    )
    bearing_reference: str = parameter(
        "bow",
        "What a field named bearing is measured from, clockwise",
        choices=("bow", "north"),
        read_only=True,
    )
    publish_potential_tracks: bool = parameter(
        False, "Publish the hypotheses of two hits and more on potential_tracks, with markers"
    )
    diagnostics_period: float = parameter(
        1.0, "Time between messages on /diagnostics", unit="s", minimum=0.05, maximum=3600.0
    )

    def __post_init__(self) -> None:
        check_group(self)
        if 0.0 < self.sound_speed < SLOWEST_SOUND:
            raise ValueError(
                f"sound_speed must be 0 or at least {SLOWEST_SOUND}; got {self.sound_speed}"
            )


@dataclass(frozen=True, kw_only=True)
class SimulatorNodeOptions:
    """Parameters of the node `sonar_simulator`."""

    scenario: str = parameter(
        "four_targets", "Name of a shipped scenario, or path of a .yaml file", read_only=True
    )
    detections_type: str = parameter(
        "sensor_msgs/msg/PointCloud2", "Message type of the detections", read_only=True
    )
    seed: int = parameter(1, "Seed; the same one gives the same scans", minimum=0, read_only=True)
    rate_factor: float = parameter(
        1.0, "How much faster than real time", positive=True, maximum=1e6, read_only=True
    )
    start_stamp: float = parameter(
        0.0,
        "Stamp of the start; negative: the clock's time",
        unit="s",
        maximum=2e9,
        read_only=True,
    )
    publish_clock: bool = parameter(False, "Publish the simulated time on /clock", read_only=True)
    own_ship_rate: float = parameter(
        1.0,
        "Rate of own_ship/odometry in simulated time",
        unit="1/s",
        positive=True,
        maximum=1000.0,
        read_only=True,
    )
    fixed_frame: str = parameter("odom", "Frame of own ship and truth", read_only=True)
    sensor_frame: str = parameter("sonar", "Frame of the detections", read_only=True)
    wait_for_subscribers: int = parameter(
        1,
        "Start when this many subscribe to the detections",
        minimum=0,
        maximum=100,
        read_only=True,
    )
    settling_time: float = parameter(
        1.0,
        "Time from the last of them to the first scan: discovery may take the middleware that long "
        "to complete on the other side",
        unit="s",
        minimum=0.0,
        maximum=60.0,
        read_only=True,
    )
    loop: bool = parameter(False, "Start again from the beginning at the end", read_only=True)

    def __post_init__(self) -> None:
        check_group(self)


@dataclass(frozen=True, kw_only=True)
class PlayerNodeOptions:
    """Parameters of the node `scan_player`."""

    recording: str = parameter(
        "", "Folder of CSV files; or bag: folder with metadata.yaml, .mcap or .db3", read_only=True
    )
    rate_factor: float = parameter(
        1.0, "How much faster than real time", positive=True, maximum=1e6, read_only=True
    )
    start_offset: float = parameter(
        0.0,
        "Leave out what was recorded before this time after the recording's start",
        unit="s",
        minimum=0.0,
        read_only=True,
    )
    start_stamp: float = parameter(
        0.0,
        "Added to the stamps of a CSV recording; negative: it starts at the clock's time",
        unit="s",
        maximum=2e9,
        read_only=True,
    )
    publish_clock: bool = parameter(False, "Publish the recorded time on /clock", read_only=True)
    fixed_frame: str = parameter(
        "odom", "Frame of a CSV recording's own ship (ENU)", read_only=True
    )
    sensor_frame: str = parameter("sonar", "Frame of a CSV recording's detections", read_only=True)
    detections_topic: str = parameter(
        "", "Topic of a bag to play as detections; empty: found by name or type", read_only=True
    )
    odometry_topic: str = parameter(
        "",
        "Topic of a bag to play as own_ship/odometry; empty: found by name or type",
        read_only=True,
    )
    tracked_topic: str = parameter(
        "", "Topic of a bag to play as tracked; empty: found by name", read_only=True
    )
    ground_truth_topic: str = parameter(
        "", "Topic of a bag to play as ground_truth; empty: found by name", read_only=True
    )
    wait_for_subscribers: int = parameter(
        1,
        "Start when this many subscribe to the detections",
        minimum=0,
        maximum=100,
        read_only=True,
    )
    settling_time: float = parameter(
        1.0,
        "Time from the last of them to the first scan: discovery may take the middleware that long "
        "to complete on the other side",
        unit="s",
        minimum=0.0,
        maximum=60.0,
        read_only=True,
    )
    loop: bool = parameter(False, "Start again from the beginning at the end", read_only=True)

    def __post_init__(self) -> None:
        check_group(self)


EXPONENT = re.compile(r"[-+]?[0-9]+(\.[0-9]*)?[eE][-+]?[0-9]+")
"""A number with an exponent, with or without its point."""

Groups = tuple[tuple[str, type[Any]], ...]

TRACK_INITIATOR: Groups = (
    ("", SessionOptions),
    ("", InitiatorNodeOptions),
    ("", CommonOptions),
    ("diagnostics.", DiagnosticsOptions),
    ("sensor.", SensorModel),
    ("mounting.", Mounting),
    *((f"{name}.", kind.Options) for name, kind in METHODS.items()),
)
SONAR_SIMULATOR: Groups = (("", SimulatorNodeOptions),)
SCAN_PLAYER: Groups = (("", PlayerNodeOptions),)

NODES: dict[str, Groups] = {
    "track_initiator": TRACK_INITIATOR,
    "sonar_simulator": SONAR_SIMULATOR,
    "scan_player": SCAN_PLAYER,
}
"""Every node's groups of parameters."""


def full_table(groups: Groups) -> Iterator[Parameter]:
    """Iterate over all parameters of some groups, with their full names."""
    for prefix, group in groups:
        for row in table(group):
            yield replace(row, name=prefix + row.name)


def make_groups(groups: Groups, values: Mapping[str, Value]) -> dict[type[Any], Any]:
    """Make every group from values by full name; a missing one has its default.

    Raises
    ------
    ValueError
        If a name is unknown or a value is not allowed, by itself or together with another; the
        sentence has the full name.
    """
    known = {row.name for row in full_table(groups)}
    for name in values:
        if name not in known:
            raise ValueError(unknown_parameter(name, known))
    made = {}
    for prefix, group in groups:
        given = {
            row.name: values[prefix + row.name]
            for row in table(group)
            if prefix + row.name in values
        }
        try:
            made[group] = group(**given)
        except ValueError as error:
            raise ValueError(f"{prefix}{error}") from None
    if groups is TRACK_INITIATOR:
        _refuse_what_does_not_go_together(made)
    return made


def _refuse_what_does_not_go_together(made: Mapping[type[Any], Any]) -> None:
    settings_from(made)
    session: SessionOptions = made[SessionOptions]
    from_north = made[InitiatorNodeOptions].bearing_reference == "north"
    if from_north and session.own_ship_source == "none" and not session.fixed_frame:
        raise ValueError(
            "fixed_frame must be given where bearing_reference is north and own_ship_source none: "
            "the tracks are then in an east-north frame, not in the sensor's"
        )
    if from_north and session.own_ship_source == "none" and not made[SensorModel].all_round:
        raise ValueError(
            "own_ship_source must not be none where bearing_reference is north and "
            "sensor.azimuth_min to sensor.azimuth_max a sector: that turns with the heading"
        )


def parse_values(assignments: Iterable[str]) -> dict[str, Value]:
    """Values from the command line's ``name:=value``, typed as in YAML.

    Raises
    ------
    ValueError
        If one is not of this form.
    """
    values = {}
    for assignment in assignments:
        name, separator, value = assignment.partition(":=")
        if not separator or not name:
            raise ValueError(f"a parameter is given as NAME:=VALUE; got {assignment!r}")
        try:
            values[name] = _typed(value)
        except yaml.YAMLError:
            raise ValueError(f"{name}: {value!r} is not a value") from None
    return values


def _typed(text: str) -> Value:
    """A value as in YAML; but 1e-9, to YAML 1.1 a text, is a number."""
    if EXPONENT.fullmatch(text.strip()):
        return float(text)
    value: Value = yaml.safe_load(text)
    return value


def settings_from(made: Mapping[type[Any], Any]) -> Settings:
    """Settings of a session, from the groups of TRACK_INITIATOR."""
    return Settings(
        session=made[SessionOptions],
        sensor=made[SensorModel],
        common=made[CommonOptions],
        methods={name: made[kind.Options] for name, kind in METHODS.items()},
        mounting=made[Mounting],
    )


def as_yaml(node: str, groups: Groups) -> str:
    """A parameter file with every parameter's default, as ROS reads it."""
    lines = [f"{node}:", "  ros__parameters:"]
    for row in full_table(groups):
        note = ", ".join(part for part in (row.unit, row.bounds) if part)
        lines.append(f"    # {row.description}{f' [{note}]' if note else ''}")
        lines.append(f"    {row.name}: {_yaml_value(row.default)}")
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
            parts.append(as_markdown(tuple(one for one in groups if one[0] == prefix)).rstrip())
    return "\n\n".join(parts) + "\n"


def as_markdown(groups: Groups) -> str:
    """A table of all parameters for the documentation."""
    lines = [
        "| parameter | default | unit | allowed | live | meaning |",
        "|---|---|---|---|---|---|",
    ]
    lines += [
        f"| `{row.name}` | `{_yaml_value(row.default)}` | {row.unit} | {row.bounds} "
        f"| {'no' if row.read_only else 'yes'} | {row.description} |"
        for row in full_table(groups)
    ]
    return "\n".join(lines) + "\n"


def _yaml_value(value: Value) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        text = repr(value)
        mantissa, exponent, power = text.partition("e")
        # YAML 1.1 takes 1e-06 for a text: a float needs its point.
        return text if "." in mantissa else f"{mantissa}.0{exponent}{power}"
    return f'"{value}"' if isinstance(value, str) else str(value)
