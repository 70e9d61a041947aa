"""Parameters of the nodes themselves."""

from __future__ import annotations

from dataclasses import dataclass

from tsepm_ros.parameters import check_group, parameter

MIN_SOUND_SPEED = 100.0
"""Minimum accepted speed of sound, m/s."""


@dataclass(frozen=True, kw_only=True)
class InitiatorNodeOptions:
    """Options of the node `track_initiator` beyond those of a session."""

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
        "File that keeps what was learned (clutter density, region of clutter, detection "
        "probability) over a restart. It is written every minute and at the end. Empty: "
        "none",
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
        check_group(self)
        if 0.0 < self.sound_speed < MIN_SOUND_SPEED:
            raise ValueError(
                f"sound_speed must be 0 or at least {MIN_SOUND_SPEED}; got {self.sound_speed}"
            )


@dataclass(frozen=True, kw_only=True)
class PlaybackOptions:
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
        "Delay from the last required subscription to the first scan, in which the subscriber's "
        "side completes its discovery",
        unit="s",
        minimum=0.0,
        maximum=60.0,
        read_only=True,
    )
    loop: bool = parameter(False, "Restart from the beginning at the end", read_only=True)

    def __post_init__(self) -> None:
        check_group(self)


@dataclass(frozen=True, kw_only=True)
class SimulatorNodeOptions:
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

    def __post_init__(self) -> None:
        check_group(self)


@dataclass(frozen=True, kw_only=True)
class PlayerNodeOptions:
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

    def __post_init__(self) -> None:
        check_group(self)
