"""Parameters of the nodes themselves."""

from __future__ import annotations

from dataclasses import dataclass

from tsepm_ros.parameters import check_group, parameter

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
class PlaybackOptions:
    """How `sonar_simulator` and `scan_player` publish what they play."""

    rate_factor: float = parameter(
        1.0, "How much faster than real time", positive=True, maximum=1e6, read_only=True
    )
    publish_clock: bool = parameter(
        False, "Publish the time of what is played on /clock", read_only=True
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


@dataclass(frozen=True, kw_only=True)
class SimulatorNodeOptions:
    """What the node `sonar_simulator` plays."""

    scenario: str = parameter(
        "four_targets", "Name of a shipped scenario, or path of a .yaml file", read_only=True
    )
    detections_type: str = parameter(
        "sensor_msgs/msg/PointCloud2", "Message type of the detections", read_only=True
    )
    seed: int = parameter(1, "Seed; the same one gives the same scans", minimum=0, read_only=True)
    start_stamp: float = parameter(
        0.0,
        "Stamp of the start; negative: the clock's time",
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

    def __post_init__(self) -> None:
        check_group(self)


@dataclass(frozen=True, kw_only=True)
class PlayerNodeOptions:
    """What the node `scan_player` plays."""

    recording: str = parameter(
        "", "Folder of CSV files; or bag: folder with metadata.yaml, .mcap or .db3", read_only=True
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

    def __post_init__(self) -> None:
        check_group(self)
