"""The entries of ``/diagnostics``: for each task its figures, and its message while healthy."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from tsepm_ros.diagnostics.health_figures import HealthFigures, Latency
from tsepm_ros.diagnostics.judgements import densities
from tsepm_ros.diagnostics.rules import CLUTTER, LATENCY, QUALITY_OF_SERVICE, SENSOR, findings_of
from tsepm_ros.diagnostics.status import Status, overall, status_of
from tsepm_ros.session.drop_reasons import DETECTIONS, INITIATION, LAND, OWN_SHIP, TRACKER


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
    mismatches = figures.connections.mismatches_heard
    return {f"mismatches.{topic}": number for topic, number in sorted(mismatches.items())}


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
