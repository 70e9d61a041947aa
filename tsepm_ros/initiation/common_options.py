"""Options that all methods share."""

from __future__ import annotations

from dataclasses import dataclass, replace

from tsepm_ros.parameters import check_group, parameter


@dataclass(frozen=True, kw_only=True)
class CommonOptions:
    """Options that mean the same in every method.

    Raises
    ------
    ValueError
        Naming the option whose value is not allowed.
    """

    max_speed: float = parameter(
        10.0, "Maximum speed of a target", unit="m/s", positive=True, maximum=1e4
    )
    min_speed: float = parameter(
        0.0,
        "Speed below which a target counts as standing still: it is published only once it moves "
        "faster with a probability of 0.9, and is kept as a fixed echo until then; 0: all are "
        "published",
        unit="m/s",
        minimum=0.0,
        maximum=1e4,
    )
    limit_speed: bool = parameter(
        True,
        "Condition the state of a new track on a speed of at most max_speed, where it is probably "
        "above; false: the state as the method's source has it. Held tracks are within max_speed",
    )
    max_detections: int = parameter(
        200_000, "Detections in a scan above which the scan is refused", minimum=1
    )
    max_potential_tracks: int = parameter(
        250_000, "Potential tracks held at most; the worst beyond are cut and counted", minimum=1
    )
    max_raw_confirmations: int = parameter(
        250_000,
        "Tracks that reach confirmation in one scan, before pruning and merging, at most; the "
        "worst beyond are cut and counted",
        minimum=1,
    )
    hold_time: float = parameter(
        120.0,
        "Time for which a confirmed track is held, and stays on tracks/current, without a "
        "detection of its own; repeated misses end it sooner",
        unit="s",
        minimum=0.0,
    )
    detection_probability: str = parameter(
        "auto",
        "Detection probability: estimated from the scans after confirmation of the held tracks, "
        "with sensor.detection_probability as the prior; given: sensor.detection_probability; or "
        "auto, estimated with the method score, most of whose tracks are true, and given with the "
        "others",
        choices=("auto", "estimated", "given"),
    )
    clutter_density: str = parameter(
        "estimated",
        "Clutter density: estimated from scan to scan on a polar grid, from "
        "sensor.clutter_density on, also where clutter ends or changes within the sensor's "
        "coverage; or given: sensor.clutter_density everywhere",
        choices=("estimated", "given"),
    )
    intensity: str = parameter(
        "auto",
        "Strengths of the detections, in any unit, as evidence with the method score: auto, where "
        "detections carry an intensity; or off",
        choices=("auto", "off"),
    )
    plots: str = parameter(
        "auto",
        "Plots, of which each is all detections of one target in a ping: on; off, where the driver "
        "sees to it that a target has one; or auto, on as soon as detections of one ping lie "
        "closer together than those of clutter do, until a reset",
        choices=("auto", "on", "off"),
    )
    target_extent: float = parameter(
        0.0,
        "How far apart the detections of one target may be in a ping, beside what the sensor's "
        "resolution adds; 0: as the detections themselves have it",
        unit="m",
        minimum=0.0,
        maximum=1e3,
    )
    plot_features: bool = parameter(
        False,
        "In clutter zones, and where targets meet, the intensity, range width and azimuth width "
        "of a detection, if measured, must resemble those of a track's own to extend it; where "
        "held targets meet, each detection goes to one of them",
    )
    encounter_time: float = parameter(
        60.0,
        "Targets meet from this long before their closest approach to as long after it, where "
        "their gates overlap; with plot_features",
        unit="s",
        minimum=0.0,
        maximum=3600.0,
    )
    tracked_timeout: float = parameter(
        60.0,
        "A downstream tracker whose last message on tracked is older than this at a scan is "
        "silent, and its tracks are held as all others; a new track that it leaves unlisted for "
        "this time ends",
        unit="s",
        positive=True,
        maximum=3600.0,
    )

    def __post_init__(self) -> None:
        check_group(self)
        if self.min_speed >= self.max_speed:
            raise ValueError(
                f"min_speed must be below max_speed; got {self.min_speed} and {self.max_speed}"
            )

    def resolved(self, most_tracks_true: bool) -> CommonOptions:
        """The options of a method: `detection_probability` is "estimated" or "given"."""
        if self.detection_probability != "auto":
            return self
        return replace(self, detection_probability="estimated" if most_tracks_true else "given")
