"""Health of a session: its entries on /diagnostics.

The entries of ``/diagnostics``: for each task its figures, and its message while healthy.

The history behind a session's diagnostics: arrivals, latencies and counts of the window.

Counts are totals since the start or the last reset; a level covers the last
`DiagnosticsOptions.window` only.
"""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from tsepm_ros.diagnostics.health_figures import (
    LAST_SCANS,
    Arrival,
    Connections,
    Counts,
    HealthFigures,
    Latency,
    ScanRecord,
    Status,
    overall,
    status_of,
)
from tsepm_ros.diagnostics.judgements import (
    CLUTTER,
    LATENCY,
    QUALITY_OF_SERVICE,
    SENSOR,
    densities,
    findings_of,
)
from tsepm_ros.session.drop_reasons import DETECTIONS, INITIATION, LAND, OWN_SHIP, TRACKER
from tsepm_ros.session.result import SessionSnapshot
from tsepm_ros.session.scan_queue import Now, waited
from tsepm_ros.settings.node_options import DiagnosticsOptions


@dataclass(frozen=True)
class Entry:
    """Content of one entry.

    Attributes
    ----------
    healthy : callable
        Returns the message if no rule applies.
    values : callable
        Returns the figures.
    """

    healthy: Callable[[HealthFigures], str]
    values: Callable[[HealthFigures], Mapping[str, object]]


def statuses(figures: HealthFigures) -> list[Status]:
    """Return the overall status, and that of every task."""
    found = [
        status_of(task, findings_of(task, figures), entry.healthy(figures), entry.values(figures))
        for task, entry in ENTRIES.items()
    ]
    return [overall(found), *found]


def _initiation(figures: HealthFigures) -> str:
    totals = figures.snapshot.totals
    return f"{totals.scans} scans, {totals.confirmed} confirmed tracks"


def _initiation_values(figures: HealthFigures) -> Mapping[str, object]:
    snapshot = figures.snapshot
    return {
        **dataclasses.asdict(snapshot.totals),
        "potential_tracks": snapshot.potential_tracks,
        "potential_tracks_most": snapshot.totals.potential_tracks,
        "tracks": snapshot.tracks,
        **{f"tracks.{state}": number for state, number in snapshot.states.items()},
        **{f"ended.{reason}": number for reason, number in sorted(snapshot.ends.items())},
        "fixed_echoes": snapshot.fixed_echoes,
        "detection_probability": snapshot.detection_probability,
        "detection_probability_estimated": snapshot.detection_probability_estimated,
        **figures.dropped_of(INITIATION),
    }


def _detections(figures: HealthFigures) -> str:
    sentence = f"{figures.snapshot.totals.detections} detections"
    if math.isnan(figures.interval):
        return sentence
    return f"{sentence}, a scan every {figures.interval:.3g} s"


def _detections_values(figures: HealthFigures) -> Mapping[str, object]:
    return {
        "received": figures.snapshot.totals.detections,
        "dropped_share": figures.dropped_share,
        "scan_interval_s": figures.interval,
        "scan_period_expected_s": figures.period,
        "since_last_scan_s": figures.since_scan,
        "intensity": figures.snapshot.intensity,
        "sweep": figures.snapshot.sweep,
        "sweep_latency_ms": 1e3 * figures.snapshot.sweep_latency,
        **figures.dropped_of(DETECTIONS),
    }


def _own_ship(figures: HealthFigures) -> str:
    source = figures.own_ship_source
    if source == "none":
        return "not needed: the sensor does not move"
    return f"own-ship data from {source}"


def _own_ship_values(figures: HealthFigures) -> Mapping[str, object]:
    if figures.own_ship_source == "none":
        return {"source": "none"}
    return {
        "source": figures.own_ship_source,
        "mounting": figures.snapshot.mounting,
        "age_s": figures.since_own_ship,
        "behind_newest_scan_s": figures.own_ship_behind,
        "waiting_for_own_ship": figures.snapshot.waiting,
        **figures.dropped_of(OWN_SHIP),
    }


def _latency(figures: HealthFigures) -> str:
    return f"at most {1e3 * figures.longest_latency(lambda latency: latency.total):.3g} ms"


def _latency_values(figures: HealthFigures) -> Mapping[str, object]:
    last = figures.scans[-1].latency if figures.scans else Latency()
    longest = figures.longest_latency
    return {
        "latency_ms": 1e3 * last.to_tracks,
        "latency_all_ms": 1e3 * last.to_all,
        "waiting_ms": 1e3 * last.waiting,
        "core_ms": 1e3 * last.core,
        "publishing_ms": 1e3 * last.publishing,
        "total_most_ms": 1e3 * longest(lambda latency: latency.total),
        "waiting_most_ms": 1e3 * longest(lambda latency: latency.waiting),
        "core_most_ms": 1e3 * longest(lambda latency: latency.core),
        "publishing_most_ms": 1e3 * longest(lambda latency: latency.publishing),
    }


def _clutter_values(figures: HealthFigures) -> Mapping[str, object]:
    return {
        "clutter_density": figures.snapshot.clutter_density,
        "detection_density": figures.detection_density,
    }


def _sensor_values(figures: HealthFigures) -> Mapping[str, object]:
    learned = figures.snapshot.sensor_figures
    values: dict[str, object] = {
        "confirmed_tracks": learned.confirmed,
        "confirmed_tracks_within_s": learned.duration,
    }
    if learned.seen is not None:
        values |= {
            "seen_min_range": learned.seen.min_range,
            "seen_max_range": learned.seen.max_range,
            "seen_azimuth_min": learned.seen.azimuth_min,
            "seen_azimuth_max": learned.seen.azimuth_max,
        }
    if learned.errors is not None:
        values |= {
            "fitted_range_std": learned.errors.range_std,
            "fitted_range_std_fraction": learned.errors.range_std_fraction,
            "fitted_azimuth_std": learned.errors.azimuth_std,
        }
    return values


def _quality_of_service_values(figures: HealthFigures) -> Mapping[str, object]:
    connections = figures.connections
    return {
        **{f"topics.{name}": topic for name, topic in connections.topics.items()},
        **{f"mismatches.{name}": n for name, n in sorted(connections.mismatches_heard.items())},
    }


def _tracker(figures: HealthFigures) -> str:
    return {"none": "no report yet", "alive": "reports arrive"}.get(figures.snapshot.tracker, "")


def _tracker_values(figures: HealthFigures) -> Mapping[str, object]:
    return {"tracker": figures.snapshot.tracker, **figures.dropped_of(TRACKER)}


def _land(figures: HealthFigures) -> str:
    area = figures.snapshot.land_area
    return f"detections on {area:.3g} m^2 are left out" if area else "no land is charted"


def _land_values(figures: HealthFigures) -> Mapping[str, object]:
    return {
        "land_area_m2": figures.snapshot.land_area,
        "on_land": figures.snapshot.totals.on_land,
        **figures.dropped_of(LAND),
    }


ENTRIES = {
    INITIATION: Entry(_initiation, _initiation_values),
    DETECTIONS: Entry(_detections, _detections_values),
    OWN_SHIP: Entry(_own_ship, _own_ship_values),
    LATENCY: Entry(_latency, _latency_values),
    CLUTTER: Entry(densities, _clutter_values),
    SENSOR: Entry(lambda _: "nothing speaks against them", _sensor_values),
    QUALITY_OF_SERVICE: Entry(
        lambda _: "all connections are compatible", _quality_of_service_values
    ),
    TRACKER: Entry(_tracker, _tracker_values),
    LAND: Entry(_land, _land_values),
}
"""Every entry by its task, in the order of publication."""

MAX_RECORDS = 10_000
"""Scans of the window that are remembered at most: bounds memory and time."""

NO_CONNECTIONS = Connections()
"""Connections of a session without a node."""


class Health:
    """Records the history of a session for its diagnostics.

    Parameters
    ----------
    options : DiagnosticsOptions

    Attributes
    ----------
    options : DiagnosticsOptions
        May be replaced at any time.
    latency : Latency
        Latency of the last scan.
    """

    def __init__(self, options: DiagnosticsOptions) -> None:
        self.options = options
        self.reset()

    def reset(self) -> None:
        """Discard the history."""
        self.latency = Latency()
        self._scans: deque[ScanRecord] = deque(maxlen=MAX_RECORDS)
        self._arrivals: deque[Arrival] = deque(maxlen=MAX_RECORDS)
        self._heard: dict[str, Now] = {}
        self._counts: deque[tuple[float, Counts]] = deque()

    def heard(self, task: str, now: Now) -> None:
        """Record the time of an arrival of data for a task, `DETECTIONS` or `OWN_SHIP`."""
        self._heard[task] = now

    def arrived(self, stamp: float, now: Now) -> None:
        """Record the stamp (s) of an arriving scan, processed or not."""
        self._arrivals.append(Arrival(_first(now), stamp))
        self._forget(self._arrivals)

    def processed(self, detections: int, latency: Latency, now: Now) -> None:
        """Record a processed scan."""
        self.latency = latency
        self._scans.append(ScanRecord(_first(now), detections, latency))
        self._forget(self._scans)

    def report(
        self, snapshot: SessionSnapshot, now: Now, connections: Connections = NO_CONNECTIONS
    ) -> list[Status]:
        """Return the status of every task.

        Parameters
        ----------
        snapshot : SessionSnapshot
        now : float or tuple of float
            Time on the clocks of `heard` and `processed`, s. The first clock measures the window.
        connections : Connections, optional

        Returns
        -------
        list of Status
        """
        figures = HealthFigures(
            options=self.options,
            snapshot=snapshot,
            connections=connections,
            recent=self._recent(Counts.of(snapshot), _first(now)),
            scans=tuple(self._scans),
            arrivals=tuple(self._arrivals),
            since_scan=self._since(DETECTIONS, now),
            since_own_ship=self._since(OWN_SHIP, now),
            time=_first(now),
        )
        return statuses(figures)

    def _forget(self, records: deque[Arrival] | deque[ScanRecord]) -> None:
        """Forget the records before the window, except the last `LAST_SCANS` of all."""
        begin = records[-1].time - self.options.window
        while len(records) > LAST_SCANS and records[0].time < begin:
            records.popleft()

    def _since(self, task: str, now: Now) -> float:
        return waited(self._heard[task], now) if task in self._heard else math.nan

    def _recent(self, counts: Counts, time: float) -> Counts:
        """Record the present counts and return the counts since the beginning of the window."""
        begin = time - self.options.window
        while len(self._counts) > 1 and self._counts[1][0] <= begin:
            self._counts.popleft()
        at_begin = self._counts and self._counts[0][0] <= begin
        before = self._counts[0][1] if at_begin else Counts()
        self._counts.append((time, counts))
        return counts - before


def _first(now: Now) -> float:
    return now[0] if isinstance(now, tuple) else now
