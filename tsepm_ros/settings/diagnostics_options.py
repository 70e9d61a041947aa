"""Thresholds of the diagnostics."""

from __future__ import annotations

from dataclasses import dataclass

from tsepm_ros.parameters import check_group, parameter


@dataclass(frozen=True, kw_only=True)
class DiagnosticsOptions:
    """From where on something is not healthy.

    Raises
    ------
    ValueError
        Naming the option whose value is not allowed.
    """

    window: float = parameter(
        60.0,
        "Time for which a drop, a late scan, a cut or a long latency keeps its entry from ok",
        unit="s",
        positive=True,
        maximum=86_400.0,
    )
    scan_period: float = parameter(
        0.0,
        "Expected time between scans; 0: the median of their stamps",
        unit="s",
        minimum=0.0,
        maximum=3600.0,
    )
    scan_period_factor: float = parameter(
        2.0, "Times the expected period that is still good", minimum=1.0, maximum=1000.0
    )
    stale_time: float = parameter(
        60.0,
        "Without a scan, or own-ship data, for longer than this an entry is stale",
        unit="s",
        positive=True,
        maximum=86_400.0,
    )
    max_latency: float = parameter(
        1.0,
        "Time from a scan's arrival until everything is published, waiting included, that is good",
        unit="s",
        positive=True,
        maximum=3600.0,
    )
    max_own_ship_age: float = parameter(
        3.0,
        "Own-ship data may be older than this neither now nor at the newest scan",
        unit="s",
        positive=True,
        maximum=3600.0,
    )
    max_dropped_share: float = parameter(
        0.1, "Share of single detections that may be dropped", minimum=0.0, maximum=1.0
    )
    clutter_factor: float = parameter(
        3.0,
        "Times that the density of detections may differ from the clutter density in use",
        minimum=1.0,
        maximum=1e6,
    )

    def __post_init__(self) -> None:
        check_group(self)
