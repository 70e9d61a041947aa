"""Thresholds of the diagnostics."""

from __future__ import annotations

from dataclasses import dataclass

from tsepm_ros.parameters import check_group, parameter


@dataclass(frozen=True, kw_only=True)
class DiagnosticsOptions:
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
    clutter_factor: float = parameter(
        3.0,
        "Maximum factor between the density of detections and the clutter density in use",
        minimum=1.0,
        maximum=1e6,
    )

    def __post_init__(self) -> None:
        check_group(self)
