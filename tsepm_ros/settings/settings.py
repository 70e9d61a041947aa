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
"""Settings of a session, made from the parameters of the nodes.

A node's parameters are a table of groups of options; the table gives the options made from values,
and the node's text for ``--help``.
"""

from __future__ import annotations

import dataclasses
import textwrap
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import Any

from tsepm_ros.detector.image import DetectorOptions
from tsepm_ros.methods.registry import METHODS, NODE_METHODS, make_method, registered_method
from tsepm_ros.own_ship.registration import Mounting
from tsepm_ros.parameters import (
    Parameter,
    Value,
    check_parameter,
    meant_parameter,
    parameter_table,
)
from tsepm_ros.settings.node_options import (
    AlarmOptions,
    BridgeNodeOptions,
    DiagnosticsOptions,
    ImageLayout,
    InitiatorNodeOptions,
    PlaybackOptions,
    PlayerNodeOptions,
    SessionOptions,
    SimulatorNodeOptions,
    SonarDetectorNodeOptions,
    ViewerNodeOptions,
)
from tsepm_ros.tracker.method import Method
from tsepm_ros.tracker.options import NO_LONGER, CommonOptions
from tsepm_ros.tracker.sensor import Coverage, SensorModel
from tsepm_ros.tracker.tracker import Tracker

MAX_IMAGE_RATIO = 20.0
"""Range of the farthest row of an image in the largest range of the coverage, at most: images may
reach far beyond what is wanted, but not as far as in centimetres in place of metres."""
TRACK_INITIATOR: Groups = (
    ("", SessionOptions),
    ("", InitiatorNodeOptions),
    ("", CommonOptions),
    ("diagnostics.", DiagnosticsOptions),
    ("sensor.", SensorModel),
    ("mounting.", Mounting),
    *((f"{name}.", registered_method(name).Options) for name in NODE_METHODS),
)
SONAR_DETECTOR: Groups = (
    ("", SonarDetectorNodeOptions),
    ("", DetectorOptions),
    ("image.", ImageLayout),
    ("sensor.", Coverage),
    ("mounting.", Mounting),
)
NODES: dict[str, Groups] = {
    "track_initiator": TRACK_INITIATOR,
    "sonar_detector": SONAR_DETECTOR,
    "sonar_simulator": (("", SimulatorNodeOptions), ("", PlaybackOptions)),
    "scan_player": (("", PlayerNodeOptions), ("", PlaybackOptions)),
    "track_viewer": (("", ViewerNodeOptions), ("alarm.", AlarmOptions)),
    "track_bridge": (("", BridgeNodeOptions),),
}
"""Every node's groups of parameters."""
OF_SENSOR = (
    *("sensor.", "mounting.", "sensor_frame", "own_ship_delay", "sweep", "sound_speed"),
    *("bearing_reference", "detections_type", "detections_reliability", "detections_depth"),
    *("diagnostics.scan_period", "diagnostics.scan_period_factor"),
)
"""Groups and names of parameters that each of several sensors may have; all others are of the
picture as a whole."""
WIDTH = 100
_EXAMPLES = {
    "sonar_detector": "-r image:=/my_sonar/image -p false_detections_per_ping:=20.0",
    "track_initiator": "-r detections:=/my_sonar/detections -p max_speed:=5.0",
    "sonar_simulator": "-p scenario:=four_targets -p rate_factor:=10.0",
    "scan_player": "-p recording:=my_recording -p rate_factor:=10.0",
    "track_viewer": "-r tracks/current:=/my_boat/tracks/current -p port:=8080",
    "track_bridge": "-p nmea_address:=127.0.0.1:10110 -p nmea_sentences:=both",
}
_TOPICS = {
    "sonar_detector": "subscribes to image; publishes detections, detections/markers, "
    "image/plan and image/normalised (docs/sonar_images.md)",
    "track_initiator": "subscribes to detections, own_ship/odometry and tracked; publishes tracks, "
    "tracks/current, tracks/markers and others (docs/topics.md)",
    "sonar_simulator": "publishes detections, own_ship/odometry and ground_truth (docs/topics.md)",
    "scan_player": "publishes detections, own_ship/odometry and ground_truth (docs/topics.md)",
    "track_viewer": "subscribes to tracks/current, fixed_echoes and others "
    "(docs/watch_and_operate.md)",
    "track_bridge": "subscribes to tracks/current, own_ship/odometry and fix; publishes "
    "tracks/radar and tracks/objects where their packages are installed, and sends NMEA 0183 and "
    "deltas of Signal K (docs/use_the_tracks.md)",
}


@dataclass(frozen=True)
class Settings:
    """The settings of a session.

    Attributes
    ----------
    session : SessionOptions
    sensor : SensorModel
    common : CommonOptions
    methods : mapping of str to options
        Options of each method by its name; a missing method has the defaults.
    mounting : Mounting
        Pose of the sensor relative to the frame of the odometry.

    Raises
    ------
    ValueError
        If a mounting is given and the sensor's pose is that of tf.
    """

    session: SessionOptions = field(default_factory=SessionOptions)
    sensor: SensorModel = field(default_factory=SensorModel)
    common: CommonOptions = field(default_factory=CommonOptions)
    methods: dict[str, Any] = field(default_factory=dict)
    mounting: Mounting = field(default_factory=Mounting)

    def __post_init__(self) -> None:
        if self.mounting.given and self.session.own_ship_source == "tf":
            raise ValueError(
                "mounting.x, mounting.y and mounting.yaw must be 0 if own_ship_source is tf: the "
                "sensor's frame has them"
            )

    @property
    def method_options(self) -> Any:
        """Options of the chosen method."""
        method = self.session.method
        return self.methods.get(method) or registered_method(method).Options()

    def make_tracker(self) -> Tracker:
        """Make the tracker that these settings describe."""
        return Tracker(self.make_method())

    def make_method(self) -> Method:
        """Make the method that these settings describe."""
        return make_method(
            self.session.method,
            sensor=self.sensor,
            **dataclasses.asdict(self.common),
            **dataclasses.asdict(self.method_options),
        )

    @property
    def window(self) -> int:
        """Window of the chosen method, scans."""
        return int(self.method_options.window)


Groups = tuple[tuple[str, type[Any]], ...]
"""Groups of parameters, each with the prefix of its names."""


class OptionsBySensor(dict[str, dict[type[Any], Any]]):
    """The options of each of several sensors by its name."""


def settings_table(groups: Groups, sensors: Sequence[str] = ()) -> Iterator[Parameter]:
    """Iterate over all parameters of groups, with their full names, then those of sensors."""
    rows = [
        replace(row, name=prefix + row.name)
        for prefix, group in groups
        for row in parameter_table(group)
    ]
    of_each = (
        replace(row, name=f"{name}.{row.name}", plain=row.name)
        for name in sensors
        for row in rows
        if row.name.startswith(OF_SENSOR)
    )
    return chain(rows, of_each)


def settings_sensors(groups: Groups, values: Mapping[str, Any]) -> tuple[str, ...]:
    """Names of the sensors by the values of `track_initiator`; of all other nodes none.

    Raises
    ------
    ValueError
        If a name is not allowed.
    """
    is_given = "sensors" in values and ("", InitiatorNodeOptions) in groups
    return InitiatorNodeOptions(sensors=values["sensors"]).sensors if is_given else ()


def settings_with_method(groups: Groups, method: Any) -> Groups:
    """The groups of `track_initiator` with those of the chosen method; all others as they are."""
    if not isinstance(method, str) or method not in METHODS or ("", SessionOptions) not in groups:
        return groups
    return tuple(dict.fromkeys((*groups, (f"{method}.", registered_method(method).Options))))


def unknown_setting(name: str, rows: Mapping[str, Parameter]) -> str:
    """The sentence that refuses a name that is in no row: unknown, or not of a sensor."""
    sensor, _, own = name.partition(".")
    named = [row for row in rows.values() if row.name.startswith(f"{sensor}.")]
    if own in rows and named and named[0].plain:
        return f"{name} is not a parameter: {own} is of the picture as a whole; give {own} alone"
    if own in rows and own.startswith(OF_SENSOR) and not named and "sensors" in rows:
        return f"{name} is not a parameter: {sensor} is no name in sensors"
    return f"{name} is not a parameter{meant_parameter(name, rows)}"


def why_settings_unused(name: str, rows: Collection[str]) -> str:
    """Why a name is not used, though a file that nodes share may have it; empty if it is unknown.

    Parameters
    ----------
    name : str
    rows : collection of str
        Full names of the node's parameters.
    """
    if name in NO_LONGER and "max_speed" in rows:
        return NO_LONGER[name]
    group, _, own = name.partition(".")
    if "method" in rows and group in METHODS:
        return "another method is chosen" * _has_setting(registered_method(group).Options, own)
    limits = [row for row in rows if row.startswith("sensor.")]
    why = f"it takes {', '.join(limits)} alone, no model of the sensor's errors"
    return why * (group == "sensor" and bool(limits) and _has_setting(SensorModel, own))


def _has_setting(group: type[Any], name: str) -> bool:
    return name in {row.name for row in parameter_table(group)}


def make_groups(groups: Groups, values: Mapping[str, Value]) -> dict[type[Any], Any]:
    """Make every group from values by full name; a missing value is the default.

    Raises
    ------
    ValueError
        If a name is unknown, or a value is not allowed by itself or in combination with another;
        the message has the full name.
    """
    groups = settings_with_method(groups, values.get("method"))
    sensors = settings_sensors(groups, values)
    rows = {row.name: row for row in settings_table(groups, sensors)}
    for name, value in values.items():
        if name in rows:
            check_parameter(name, value, rows)
        elif not why_settings_unused(name, rows):
            raise ValueError(unknown_setting(name, rows))
    options: dict[type[Any], Any] = {}
    for prefix, group in groups:
        given = {
            row.name: values[prefix + row.name]
            for row in parameter_table(group)
            if prefix + row.name in values
        }
        try:
            options[group] = group(**given)
        except ValueError as error:
            raise ValueError(f"{prefix}{error}") from None
    if SessionOptions in options:
        _check_settings(options)
    if ImageLayout in options and Coverage in options:
        check_image_ranges(options[ImageLayout], options[Coverage])
    if sensors:
        plain = {
            name: value
            for name, value in values.items()
            if name != "sensors" and name.partition(".")[0] not in sensors
        }
        options[OptionsBySensor] = OptionsBySensor(
            {name: _options_of_sensor(groups, plain, name, values) for name in sensors}
        )
    return options


def _options_of_sensor(
    groups: Groups, plain: Mapping[str, Value], sensor: str, values: Mapping[str, Value]
) -> dict[type[Any], Any]:
    """Options of a sensor by the values that have its name in front, else by the plain values."""
    front = f"{sensor}."
    own = {
        name.removeprefix(front): value for name, value in values.items() if name.startswith(front)
    }
    try:
        return make_groups(groups, {**plain, **own})
    except ValueError as error:
        raise ValueError(f"{front}{error}") from None


def options_by_sensor(options: Mapping[type[Any], Any]) -> Mapping[str, Mapping[type[Any], Any]]:
    """The options of each sensor by its name; of a single sensor the name is empty."""
    return options.get(OptionsBySensor) or {"": options}


def _check_settings(options: Mapping[type[Any], Any]) -> None:
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


def check_image_ranges(image: ImageLayout, coverage: Coverage) -> None:
    """Check that ranges of an image contradict neither each other nor the coverage.

    Raises
    ------
    ValueError
        If they do, as of another unit.
    """
    near, far = image.near_range, image.far_range
    is_far = max(near, far / MAX_IMAGE_RATIO) >= coverage.max_range
    if is_far or 0.0 <= far <= max(near, coverage.min_range):
        raise ValueError(
            "image.near_range must be below image.far_range, and both must fit sensor.min_range "
            f"{coverage.min_range:g} m and sensor.max_range {coverage.max_range:g} m; got "
            f"{near:g} and {far:g}: give all in metres"
        )


def settings_from(options: Mapping[type[Any], Any]) -> Settings:
    """Settings of a session, from the options of the groups of TRACK_INITIATOR."""
    return Settings(
        session=options[SessionOptions],
        sensor=options[SensorModel],
        common=options[CommonOptions],
        methods={
            name: options[kind]
            for name in {*NODE_METHODS, options[SessionOptions].method}
            if (kind := registered_method(name).Options) in options
        },
        mounting=options[Mounting],
    )


def settings_help(node: str, summary: str | None) -> str:
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
        *_settings_lines(node),
        f"Descriptions, units, bounds and defaults: tsepm parameters {node} (a parameter file to "
        f"edit; also in share/tsepm_ros/config/{node}.yaml), or docs/parameters.md. Numbers that "
        "are not integers need their decimal point: 5.0, not 5.",
    ]
    return "\n\n".join(textwrap.fill(part, WIDTH, subsequent_indent="  ") for part in parts)


def _settings_lines(node: str) -> list[str]:
    """A paragraph of names per prefix."""
    groups = NODES[node]
    return [
        f"{f'parameters {prefix}*' if prefix else 'parameters'}: "
        + ", ".join(
            row.name for key, group in groups if key == prefix for row in parameter_table(group)
        )
        for prefix in dict.fromkeys(prefix for prefix, _ in groups)
    ]
