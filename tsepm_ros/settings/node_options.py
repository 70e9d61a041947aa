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
"""Options of the nodes: their parameters beyond those of the tracker and of the detector."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from tsepm_ros.methods.registry import available_methods
from tsepm_ros.own_ship.registration import registration_east_north_up
from tsepm_ros.parameters import WHOLE_TURN, ParameterGroup, parameter, shown_parameter

MIN_SOUND_SPEED = 100.0
"""Minimum accepted speed of sound, m/s."""
OWN_SHIP_SOURCES = ("none", "odometry", "tf")
"""Sources of the sensor's pose."""
MAX_SWEEP = 600.0
"""Longest time of a turn, s."""
MIN_TOKEN_LENGTH = 16
SENSOR_NAME, MOST_SENSORS = re.compile("[A-Za-z][A-Za-z0-9_]{0,63}"), 32
"""A name of one of several sensors, and the most of them: `seen_by` has a bit of each."""
OTHER_NAMES = (
    *("diagnostics", "sensor", "mounting", "qos_overrides", *available_methods()),
    *("detections", "own_ship", "tracks", "tracked", "potential_tracks", "fixed_echoes", "land"),
)
"""Groups of parameters and topics of the node `track_initiator`: no names of sensors."""
_IPV4 = r"((25[0-5]|2[0-4][0-9]|1?[0-9]?[0-9])(\.(?!$)|$)){4}"


def _own_ship_delay() -> float:
    """The parameter of the same name of each node that takes own ship."""
    return parameter(
        0.0,
        "Time by which the stamps of own-ship data are late; below 0: early",
        unit="s",
        minimum=-60.0,
        maximum=60.0,
        read_only=True,
    )


@dataclass(frozen=True, kw_only=True)
class InitiatorNodeOptions(ParameterGroup):
    """Options of the node `track_initiator` beyond those of a session."""

    sensors: tuple[str, ...] = parameter(
        (),
        "Names of several sensors of one picture, each with a topic NAME/detections, and with "
        "NAME. in front of parameters of its own. Empty: one sensor, on detections",
        read_only=True,
    )
    detections_type: str = parameter(
        "auto", "Message type of the detections; auto: the publisher's type", read_only=True
    )
    sound_speed: float = parameter(
        0.0,
        "Sound speed. A detection without a time is valid range / sound_speed after the "
        "stamp; 0: at the stamp. Sonar messages without a sound speed use this value; 0: "
        "1500 m/s",
        unit="m/s",
        minimum=0.0,
        maximum=10_000.0,
    )
    detections_reliability: str = parameter(
        "auto",
        "Reliability of the subscription; auto: the publisher's reliability",
        choices=("auto", "reliable", "best_effort"),
        read_only=True,
    )
    detections_depth: int = parameter(
        1000, "Maximum number of queued scans", minimum=1, maximum=100_000, read_only=True
    )
    bearing_reference: str = parameter(
        "bow",
        "Direction from which a field named bearing is measured, clockwise",
        choices=("bow", "north"),
        read_only=True,
    )
    learned_file: str = parameter(
        "",
        "File that keeps what was learned over a restart, written every minute and at the end. "
        "Empty: none",
        read_only=True,
    )
    learned_max_age: float = parameter(
        86_400.0,
        "Maximum age of learned_file; its content counts half after 6 hours",
        unit="s",
        positive=True,
        maximum=31_536_000.0,
        read_only=True,
    )
    publish_potential_tracks: bool = parameter(
        False, "Publish hypotheses with at least two hits on potential_tracks, with markers"
    )
    diagnostics_period: float = parameter(
        1.0, "Time between messages on /diagnostics", unit="s", minimum=0.05, maximum=3600.0
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        for number, name in enumerate(self.sensors):
            if not SENSOR_NAME.fullmatch(name) or name in OTHER_NAMES:
                raise ValueError(
                    f"sensors must be names of letters, digits and _ that begin with a letter, "
                    f"of at most 64, and none of {', '.join(OTHER_NAMES)}; got "
                    f"{shown_parameter(name)}"
                )
            if number >= MOST_SENSORS or name in self.sensors[:number]:
                raise ValueError(
                    f"sensors must be at most {MOST_SENSORS} different names; got "
                    f"{shown_parameter(self.sensors)}: leave out {name}"
                )
        if 0.0 < self.sound_speed < MIN_SOUND_SPEED:
            raise ValueError(
                f"sound_speed must be 0 or at least {MIN_SOUND_SPEED}; got {self.sound_speed}"
            )


@dataclass(frozen=True, kw_only=True)
class PlaybackOptions(ParameterGroup):
    """Playback options of `sonar_simulator` and `scan_player`."""

    rate_factor: float = parameter(
        1.0, "Playback speed relative to real time", positive=True, maximum=1e6, read_only=True
    )
    publish_clock: bool = parameter(False, "Publish the playback time on /clock", read_only=True)
    wait_for_subscribers: int = parameter(
        1,
        "Number of subscribers to the detections that playback waits for",
        minimum=0,
        maximum=100,
        read_only=True,
    )
    settling_time: float = parameter(
        1.0,
        "Delay from the last required subscription to the first scan, for its discovery",
        unit="s",
        minimum=0.0,
        maximum=60.0,
        read_only=True,
    )
    loop: bool = parameter(False, "Restart from the beginning at the end", read_only=True)


@dataclass(frozen=True, kw_only=True)
class SimulatorNodeOptions(ParameterGroup):
    """Options of the node `sonar_simulator`."""

    scenario: str = parameter(
        "four_targets", "Name of a shipped scenario, or path of a .yaml file", read_only=True
    )
    detections_type: str = parameter(
        "sensor_msgs/msg/PointCloud2", "Message type of the detections", read_only=True
    )
    seed: int = parameter(1, "Random seed; equal seeds give equal scans", minimum=0, read_only=True)
    messages_per_scan: int = parameter(
        1,
        "Messages per scan; more than 1: sectors of a sweep that takes the scan's period",
        minimum=1,
        maximum=10_000,
        read_only=True,
    )
    start_stamp: float = parameter(
        0.0,
        "Stamp of the start; negative: the current time",
        unit="s",
        maximum=2e9,
        read_only=True,
    )
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


@dataclass(frozen=True, kw_only=True)
class PlayerNodeOptions(ParameterGroup):
    """Options of the node `scan_player`."""

    recording: str = parameter(
        "",
        "CSV file, folder with detections.csv, or a bag: folder with metadata.yaml, .mcap or .db3",
        read_only=True,
    )
    start_offset: float = parameter(
        0.0,
        "Time to skip at the start of the recording",
        unit="s",
        minimum=0.0,
        read_only=True,
    )
    start_stamp: float = parameter(
        0.0,
        "Offset of the stamps of a CSV recording; negative: the start has the current time",
        unit="s",
        maximum=2e9,
        read_only=True,
    )
    fixed_frame: str = parameter(
        "odom", "Frame of the own ship of a CSV recording (ENU)", read_only=True
    )
    sensor_frame: str = parameter(
        "sonar", "Frame of the detections of a CSV recording", read_only=True
    )
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
    land_topic: str = parameter(
        "", "Topic of a bag to play as land; empty: found by name", read_only=True
    )


@dataclass(frozen=True, kw_only=True)
class DiagnosticsOptions(ParameterGroup):
    """Thresholds between healthy and unhealthy values.

    Raises
    ------
    ValueError
        Naming the option whose value is not allowed.
    """

    window: float = parameter(
        60.0,
        "Time for which a drop, a gap, a cut or a long latency affects the level of its entry",
        unit="s",
        positive=True,
        maximum=86_400.0,
    )
    scan_period: float = parameter(
        0.0,
        "Expected time between scans; 0: the median interval of their stamps",
        unit="s",
        minimum=0.0,
        maximum=3600.0,
    )
    scan_period_factor: float = parameter(
        2.0,
        "Maximum factor between the observed and the expected time between scans",
        minimum=1.0,
        maximum=1000.0,
    )
    stale_time: float = parameter(
        60.0,
        "Time without a scan, or without own-ship data, after which the entry is stale",
        unit="s",
        positive=True,
        maximum=86_400.0,
    )
    max_latency: float = parameter(
        1.0,
        "Maximum acceptable time from a scan's arrival to the end of publishing, "
        "including the wait for own-ship data",
        unit="s",
        positive=True,
        maximum=3600.0,
    )
    max_own_ship_age: float = parameter(
        3.0,
        "Maximum age of own-ship data, relative to now and to the newest scan",
        unit="s",
        positive=True,
        maximum=3600.0,
    )
    max_dropped_share: float = parameter(
        0.1,
        "Maximum fraction of detections that may be dropped without a warning",
        minimum=0.0,
        maximum=1.0,
    )


@dataclass(frozen=True, kw_only=True)
class SessionOptions(ParameterGroup):
    """Method, frames, and limits on the times of arriving data.

    Raises
    ------
    ValueError
        Naming the option whose value is not allowed.
    """

    method: str = parameter("score", "Track initiation method", choices=available_methods())
    own_ship_source: str = parameter(
        "none",
        "Source of the sensor's pose: none (the sensor does not move), odometry or tf",
        choices=OWN_SHIP_SOURCES,
        read_only=True,
    )
    fixed_frame: str = parameter(
        "",
        "Frame of the tracks; empty: the odometry's frame, else the detections' frame. x is east "
        "and y north; if the name ends in _ned or _frd, x is north and y east",
        read_only=True,
    )
    sensor_frame: str = parameter(
        "", "Frame of the detections; empty: the frame of the first message", read_only=True
    )
    own_ship_delay: float = _own_ship_delay()
    own_ship_timeout: float = parameter(
        2.0,
        "Maximum time that a scan waits for the own-ship data of its time",
        unit="s",
        minimum=0.0,
        maximum=3600.0,
    )
    own_ship_max_extrapolation: float = parameter(
        0.5,
        "Maximum extrapolation of the newest pose after own_ship_timeout expires",
        unit="s",
        minimum=0.0,
        maximum=3600.0,
    )
    own_ship_max_gap: float = parameter(
        10.0,
        "Maximum gap between own-ship samples for interpolation",
        unit="s",
        positive=True,
        maximum=3600.0,
    )
    restart_jump: float = parameter(
        60.0,
        "A backward step of the stamps by more than this resets the state; after a smaller step "
        "the scan is late",
        unit="s",
        minimum=0.0,
    )
    max_gap: float = parameter(
        0.0,
        "Maximum gap between scans; a longer gap drops the potential tracks. 0: the window times "
        "the median scan interval",
        unit="s",
        minimum=0.0,
    )
    max_wait: float = parameter(
        10.0,
        "Maximum time that a scan waits for scans of other sensors, which arrive later",
        unit="s",
        minimum=0.0,
        maximum=600.0,
    )
    max_scan_time: float = parameter(
        5.0,
        "Time that a scan may take on a slow computer. It bounds the pairs of potential tracks and "
        "detections (100 000 per second); not used offline",
        unit="s",
        positive=True,
        maximum=3600.0,
    )

    sweep: str = parameter(
        "auto",
        "Joining of messages of single beams or sectors. auto: once their azimuths show a sweep; "
        "off: a message is a scan; or the time in seconds of a turn or of a pass over a sector",
        numeric=True,
        read_only=True,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        registration_east_north_up(self.fixed_frame)
        if self.sweep not in ("off", "auto") and not 0.0 < self._seconds() <= MAX_SWEEP:
            raise ValueError(
                f"sweep must be off, auto, or a number of seconds above 0 and at most "
                f"{MAX_SWEEP:g}; got {self.sweep!r}"
            )

    @property
    def sweep_seconds(self) -> float:
        """The time of a turn where it is given, s; else 0."""
        return 0.0 if self.sweep in ("off", "auto") else self._seconds()

    def _seconds(self) -> float:
        try:
            return float(self.sweep)
        except ValueError:
            return math.nan


@dataclass(frozen=True, kw_only=True)
class ViewerNodeOptions(ParameterGroup):
    """Options of the node `track_viewer` and of `tsepm watch`."""

    host: str = parameter(
        "127.0.0.1",
        "Address or name on which the page is served; 0.0.0.0: on all. Browsers need a token if "
        "other machines can reach the page",
        read_only=True,
    )
    port: int = parameter(
        8470, "Port of the page; 0: any free port", minimum=0, maximum=65_535, read_only=True
    )
    token: str = parameter(
        "",
        "Token that browsers must give, at least 16 characters; empty: a new one at each start, "
        "and none if only this machine can reach the page",
        read_only=True,
    )
    kept_scans: int = parameter(
        300,
        "Maximum number of past scans that a browser receives when it connects",
        minimum=1,
        maximum=10_000,
        read_only=True,
    )
    origin: str = parameter(
        "",
        "latitude,longitude of the fixed frame's origin in degrees, x east and y north; empty: the "
        "page shows none",
        read_only=True,
    )
    alarms_file: str = parameter(
        "auto",
        "File that keeps alarms and limits; auto: in ROS_HOME (~/.ros). Empty: none",
        read_only=True,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.host:
            raise ValueError("host must not be empty; use 0.0.0.0 for all addresses")
        if self.token and len(self.token) < MIN_TOKEN_LENGTH:
            raise ValueError(
                f"token must have at least {MIN_TOKEN_LENGTH} characters, or be empty; "
                f"got {len(self.token)}"
            )
        if not (self.token.isascii() and self.token.isprintable()):
            raise ValueError("token must be of printable ASCII characters")


@dataclass(frozen=True, kw_only=True)
class AlarmOptions(ParameterGroup):
    """Alarms of `track_viewer`, the same in every browser.

    Raises
    ------
    ValueError
        Naming the option whose value is not allowed.
    """

    cpa_limit: float = parameter(
        0.0,
        "Alarm on tracks whose closest approach to own ship (CPA) is nearer; 0: none",
        unit="m",
        minimum=0.0,
        maximum=1e6,
    )
    tcpa_limit: float = parameter(
        1200.0,
        "Alarm only if the closest approach is less than this time ahead (TCPA)",
        unit="s",
        minimum=0.0,
        maximum=86_400.0,
    )
    lost_targets: bool = parameter(True, "Alarm on tracks that are no longer held")
    lost_range: float = parameter(
        0.0,
        "Alarm on lost tracks within this range of own ship only; 0: at any range",
        unit="m",
        minimum=0.0,
        maximum=1e6,
    )
    guard_min_range: float = parameter(
        0.0, "Near limit of the guard zone about own ship", unit="m", minimum=0.0, maximum=1e6
    )
    guard_max_range: float = parameter(
        0.0,
        "Far limit of the guard zone: alarm on tracks in it; 0: no guard zone",
        unit="m",
        minimum=0.0,
        maximum=1e6,
    )
    guard_azimuth_min: float = parameter(
        -math.pi,
        "Start of the guard zone's sector, counter-clockwise from the bow",
        unit="rad",
        minimum=-WHOLE_TURN,
        maximum=WHOLE_TURN,
    )
    guard_azimuth_max: float = parameter(
        math.pi,
        "End of the sector, counter-clockwise from its start",
        unit="rad",
        minimum=-WHOLE_TURN,
        maximum=WHOLE_TURN,
    )
    guard_standing: bool = parameter(False, "Guard zone also for tracks that stand still")
    gates: str = parameter(
        "",
        "Gates over which tracks are counted: x1,y1,x2,y2 in the fixed frame, m; several with "
        "semicolons",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if 0.0 < self.guard_max_range <= self.guard_min_range:
            raise ValueError(
                f"guard_min_range must be below guard_max_range; got {self.guard_min_range} and "
                f"{self.guard_max_range}"
            )
        if not 0.0 < self.guard_azimuth_max - self.guard_azimuth_min <= WHOLE_TURN + 1e-6:
            raise ValueError(
                "guard_azimuth_max must be above guard_azimuth_min by at most 2 pi; got "
                f"{self.guard_azimuth_max} and {self.guard_azimuth_min}"
            )
        gate_lines(self.gates)


def gate_lines(text: str) -> list[tuple[float, ...]]:
    """Ends x1, y1, x2, y2 of gates, m.

    Raises
    ------
    ValueError
        If they are not four finite numbers each, or both ends are the same.
    """
    try:
        lines = [tuple(map(float, gate.split(","))) for gate in text.split(";") if gate.strip()]
    except ValueError:
        lines = [()]
    for line in lines:
        if not (len(line) == 4 and all(map(math.isfinite, line)) and line[:2] != line[2:]):
            raise ValueError(
                f"gates must be x1,y1,x2,y2 with different ends, and semicolons between them; got "
                f"{text!r}"
            )
    return lines


@dataclass(frozen=True, kw_only=True)
class BridgeNodeOptions(ParameterGroup):
    """Options of the node `track_bridge`."""

    nmea_address: str = parameter(
        "127.0.0.1:10110",
        "Address and UDP port to which sentences of NMEA 0183 are sent; empty: none",
        read_only=True,
    )
    nmea_sentences: str = parameter(
        "TTM",
        "Sentences: TTM relative to own ship, TLL with latitude and longitude, or both",
        choices=("TTM", "TLL", "both"),
        read_only=True,
    )
    nmea_talker: str = parameter(
        "RA", "Two letters with which sentences begin: RA is a radar", read_only=True
    )
    signal_k_address: str = parameter(
        "",
        "Address and UDP port to which deltas of Signal K (JSON) are sent; empty: none",
        read_only=True,
    )
    nmea_period: float = parameter(
        1.0,
        "Minimum time between the sentences, or deltas, of a track, by the stamps; 0: each ping",
        unit="s",
        minimum=0.0,
        maximum=60.0,
        read_only=True,
    )
    origin: str = parameter(
        "",
        "latitude,longitude of the fixed frame's origin in degrees, x east and y north; empty: by "
        "the newest message on fix, with own ship's position",
        read_only=True,
    )
    own_ship_source: str = parameter(
        "odometry",
        "Source of own ship's pose. odometry: own_ship/odometry; tf: own_ship_frame; none: own "
        "ship rests at the fixed frame's origin",
        choices=("odometry", "tf", "none"),
        read_only=True,
    )
    own_ship_frame: str = parameter(
        "base_link",
        "With tf: frame of own ship, x ahead; its pose is taken in the frame of the tracks",
        read_only=True,
    )
    own_ship_timeout: float = parameter(
        5.0,
        "Maximum time over which own ship is extrapolated",
        unit="s",
        positive=True,
        maximum=3600.0,
        read_only=True,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        udp_address_option("nmea_address", self.nmea_address)
        udp_address_option("signal_k_address", self.signal_k_address)
        if not re.fullmatch("[A-Z]{2}", self.nmea_talker):
            raise ValueError(
                f"nmea_talker must be two capital letters, such as RA; got {self.nmea_talker!r}"
            )


def udp_address_option(name: str, text: str) -> tuple[str, int] | None:
    """Host and port of an address; None of an empty text.

    Raises
    ------
    ValueError
        If it is no ``host:port``; the message begins with a parameter's name.
    """
    if not text:
        return None
    host, _, port = text.rpartition(":")
    # A name would be looked up for each sentence.
    if not re.fullmatch(_IPV4, host) or not port.isdecimal() or not 0 < int(port) < 65_536:
        raise ValueError(
            f"{name} must be an IP address and a port, such as 127.0.0.1:10110; got {text!r}"
        )
    return host, int(port)


@dataclass(frozen=True, kw_only=True)
class SonarDetectorNodeOptions(ParameterGroup):
    """Options of the node `sonar_detector` beyond those of the detector."""

    image_type: str = parameter(
        "auto", "Message type of the images; auto: the publisher's type", read_only=True
    )
    image_reliability: str = parameter(
        "auto",
        "Reliability of the subscription; auto: the publisher's reliability",
        choices=("auto", "reliable", "best_effort"),
        read_only=True,
    )
    image_depth: int = parameter(
        10,
        "Maximum number of queued images; for messages of bearings or sectors at least 1000",
        minimum=1,
        maximum=100_000,
        read_only=True,
    )
    sound_speed: float = parameter(
        0.0,
        "Sound speed where the messages state none; 0: 1500 m/s, and echoes of sensor_msgs/Image "
        "and of radars are valid at the stamp",
        unit="m/s",
        minimum=0.0,
        maximum=10_000.0,
    )
    tracker: str = parameter(
        "track_initiator",
        "Node whose sensor.min_range, max_range, azimuth_min and azimuth_max follow those of the "
        "images, also after its restart; empty: none",
        read_only=True,
    )
    tracker_sensor: str = parameter(
        "",
        "Name of this sonar in the tracker's sensors, for a detector in a namespace below it; "
        "empty: the tracker has one sensor",
        read_only=True,
    )
    own_ship_source: str = parameter(
        "none",
        "Source of the pose of a sonar that moves, for the background of the ground: none, "
        "odometry or tf, as for track_initiator",
        choices=OWN_SHIP_SOURCES,
        read_only=True,
    )
    own_ship_delay: float = _own_ship_delay()
    fixed_frame: str = parameter(
        "", "Frame of the poses; empty: the odometry's. With tf it must be given", read_only=True
    )
    publish_normalised: bool = parameter(
        False, "Publish the normalised image on image/normalised, 32FC1, a row per beam"
    )


@dataclass(frozen=True, kw_only=True)
class ImageLayout(ParameterGroup):
    """How the rows of images lie, and the ranges and sides of a picture that states none."""

    rows: str = parameter(
        "auto",
        "What the rows of an image are; auto: beams in RawSonarImage, else ranges. fan: a picture "
        "in x and y, with the sonar at the middle of the lowest row (all round: of the picture)",
        choices=("auto", "ranges", "beams", "fan"),
    )
    near_range: float = parameter(
        -1.0,
        "sensor_msgs/Image: range of the middle of the nearest row (of beams: column); of a fan: "
        "the nearest range that it shows. Below 0: not given",
        unit="m",
        minimum=-1.0,
        maximum=1e8,
    )
    far_range: float = parameter(
        -1.0,
        "sensor_msgs/Image: range of the middle of the farthest row (of beams: column). Below 0: "
        "not given",
        unit="m",
        minimum=-1.0,
        maximum=1e8,
    )
    near_first: bool = parameter(
        False, "sensor_msgs/Image: the first row (of beams: the first column) is the nearest range"
    )
    port_first: bool = parameter(
        True, "sensor_msgs/Image: the first column (of beams: the first row) is farthest to port"
    )
    clockwise: bool = parameter(
        False, "Angles of single bearings and spokes grow clockwise, against the ROS convention"
    )
