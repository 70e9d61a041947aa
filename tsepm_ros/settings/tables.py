"""The parameter tables of the nodes: their groups, and the options made from values."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from tsepm_ros.initiation.common_options import CommonOptions
from tsepm_ros.methods.registry import METHODS
from tsepm_ros.own_ship.mounting import Mounting
from tsepm_ros.parameters import Parameter, Value, check_value, table, unknown_parameter
from tsepm_ros.sensing.sensor import SensorModel
from tsepm_ros.settings.diagnostics_options import DiagnosticsOptions
from tsepm_ros.settings.node_options import (
    InitiatorNodeOptions,
    PlaybackOptions,
    PlayerNodeOptions,
    SimulatorNodeOptions,
)
from tsepm_ros.settings.session_options import SessionOptions
from tsepm_ros.settings.settings import Settings
from tsepm_ros.settings.viewer_options import ViewerNodeOptions

Groups = tuple[tuple[str, type[Any]], ...]
"""Groups of parameters, each with the prefix of its names."""

TRACK_INITIATOR: Groups = (
    ("", SessionOptions),
    ("", InitiatorNodeOptions),
    ("", CommonOptions),
    ("diagnostics.", DiagnosticsOptions),
    ("sensor.", SensorModel),
    ("mounting.", Mounting),
    *((f"{name}.", kind.Options) for name, kind in METHODS.items()),
)
SONAR_SIMULATOR: Groups = (("", SimulatorNodeOptions), ("", PlaybackOptions))
SCAN_PLAYER: Groups = (("", PlayerNodeOptions), ("", PlaybackOptions))
TRACK_VIEWER: Groups = (("", ViewerNodeOptions),)

NODES: dict[str, Groups] = {
    "track_initiator": TRACK_INITIATOR,
    "sonar_simulator": SONAR_SIMULATOR,
    "scan_player": SCAN_PLAYER,
    "track_viewer": TRACK_VIEWER,
}
"""Every node's groups of parameters."""


def full_table(groups: Groups) -> Iterator[Parameter]:
    """Iterate over all parameters of groups, with their full names."""
    for prefix, group in groups:
        for row in table(group):
            yield replace(row, name=prefix + row.name)


def make_groups(groups: Groups, values: Mapping[str, Value]) -> dict[type[Any], Any]:
    """Make every group from values by full name; a missing value is the default.

    Raises
    ------
    ValueError
        If a name is unknown, or a value is not allowed by itself or in combination with another;
        the message has the full name.
    """
    rows = {row.name: row for row in full_table(groups)}
    for name, value in values.items():
        if name not in rows:
            raise ValueError(unknown_parameter(name, rows))
        check_value(name, value, rows)
    options = {}
    for prefix, group in groups:
        given = {
            row.name: values[prefix + row.name]
            for row in table(group)
            if prefix + row.name in values
        }
        try:
            options[group] = group(**given)
        except ValueError as error:
            raise ValueError(f"{prefix}{error}") from None
    if groups is TRACK_INITIATOR:
        _check_combination(options)
    return options


def _check_combination(options: Mapping[type[Any], Any]) -> None:
    """Refuse values of different groups that contradict each other."""
    settings_from(options)
    session: SessionOptions = options[SessionOptions]
    from_north = options[InitiatorNodeOptions].bearing_reference == "north"
    if from_north and session.own_ship_source == "none" and not session.fixed_frame:
        raise ValueError(
            "fixed_frame must be given if bearing_reference is north and own_ship_source is none: "
            "the tracks are then in an east-north frame, not in the sensor frame"
        )
    if from_north and session.own_ship_source == "none" and not options[SensorModel].all_round:
        raise ValueError(
            "own_ship_source must not be none if bearing_reference is north and "
            "sensor.azimuth_min to sensor.azimuth_max is a sector: the sector turns with the "
            "heading"
        )


def settings_from(options: Mapping[type[Any], Any]) -> Settings:
    """Settings of a session, from the options of the groups of TRACK_INITIATOR."""
    return Settings(
        session=options[SessionOptions],
        sensor=options[SensorModel],
        common=options[CommonOptions],
        methods={name: options[kind.Options] for name, kind in METHODS.items()},
        mounting=options[Mounting],
    )
