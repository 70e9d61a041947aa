"""The rules of the diagnostics: problems of each entry, with level, thresholds and remedy.

docs/diagnostics.md lists them.
"""

from __future__ import annotations

from dataclasses import dataclass

from tsepm_ros.diagnostics.health_figures import HealthFigures
from tsepm_ros.diagnostics.judgements import (
    Judgement,
    all_detections_dropped,
    clock_stands,
    clutter_contradicted,
    cut_hypotheses,
    detections_dropped,
    drops_of,
    long_latency,
    mismatch,
    no_own_ship_yet,
    no_publisher,
    no_scan_yet,
    overload,
    own_ship_behind,
    own_ship_drops,
    own_ship_old,
    own_ship_stopped,
    own_ship_unused,
    scan_gaps,
    scan_overdue,
    scan_rate,
    scans_stopped,
    sensor_finding,
    tracker_silent,
    unread_type,
)
from tsepm_ros.diagnostics.status import Finding, Level
from tsepm_ros.session.drop_reasons import DETECTIONS, INITIATION, LAND, OWN_SHIP, TRACKER

LATENCY, CLUTTER, QUALITY_OF_SERVICE = "latency", "clutter", "quality of service"
SENSOR = "sensor parameters"
"""Entries without drops."""


@dataclass(frozen=True)
class Rule:
    """One problem that an entry may have.

    Attributes
    ----------
    level : Level
        Level of an entry with the problem.
    judge : callable
        Returns the sentence that names the problem, or an empty sentence.
    remedy : str
    thresholds : tuple of str
        Options of `DiagnosticsOptions` that are thresholds of the rule.
    """

    level: Level
    judge: Judgement
    remedy: str
    thresholds: tuple[str, ...] = ()


_SEE_REASONS = "See the reasons below"
_NO_SCAN = "Check the topic and its type: `ros2 topic info -v`; remap `detections`"
_LOST_PINGS = (
    "Pings are lost: check the driver and the network. For a sonar with a variable period, leave "
    "`scan_period` at 0"
)
_NAVIGATION = "Check the navigation; compare its clock with the sonar's"

RULES: dict[str, tuple[tuple[Rule, ...], ...]] = {
    INITIATION: (
        (Rule(Level.ERROR, drops_of(INITIATION), "See `internal_error` below"),),
        (
            Rule(
                Level.WARN,
                cut_hypotheses,
                "Too many detections for the limits: check the entry `clutter`; raise "
                "`max_potential_tracks` or `max_scan_time` if computing time is left",
            ),
        ),
    ),
    DETECTIONS: (
        (
            Rule(Level.ERROR, unread_type, "Restart the node, or set `detections_type`"),
            Rule(Level.WARN, no_publisher, _NO_SCAN),
            Rule(Level.WARN, no_scan_yet, _NO_SCAN),
            Rule(Level.STALE, scans_stopped, "The driver has stopped", ("stale_time",)),
            Rule(Level.WARN, scan_overdue, _LOST_PINGS, ("scan_period", "scan_period_factor")),
        ),
        (
            Rule(Level.WARN, scan_rate, _LOST_PINGS, ("scan_period", "scan_period_factor")),
            Rule(Level.WARN, scan_gaps, _LOST_PINGS, ("scan_period", "scan_period_factor")),
        ),
        (Rule(Level.WARN, clock_stands, "Publish /clock, or set `use_sim_time` to false"),),
        (Rule(Level.WARN, drops_of(DETECTIONS), _SEE_REASONS),),
        tuple(
            Rule(
                level,
                judge,
                "See the reasons below; if a sensor marks empty rays in its own way, raise "
                "`max_dropped_share`",
                ("max_dropped_share",),
            )
            for level, judge in (
                (Level.ERROR, all_detections_dropped),
                (Level.WARN, detections_dropped),
            )
        ),
    ),
    OWN_SHIP: (
        (
            Rule(
                Level.WARN,
                own_ship_unused,
                "Set `own_ship_source` to odometry if the sonar moves",
            ),
        ),
        (Rule(Level.WARN, own_ship_drops, _NAVIGATION),),
        (
            Rule(Level.WARN, no_own_ship_yet, _NAVIGATION),
            Rule(
                Level.STALE,
                own_ship_stopped,
                "The navigation has stopped; scans of a moving vessel are dropped",
                ("stale_time",),
            ),
            Rule(Level.WARN, own_ship_old, _NAVIGATION, ("max_own_ship_age",)),
            Rule(Level.WARN, own_ship_behind, _NAVIGATION, ("max_own_ship_age",)),
        ),
    ),
    LATENCY: (
        (
            Rule(
                Level.ERROR,
                overload,
                "The node cannot keep up: raise the sonar's detection threshold, or reduce "
                "`max_potential_tracks` and `max_scan_time`",
            ),
        ),
        (
            Rule(
                Level.WARN,
                long_latency,
                "`waiting`: own-ship data arrives late. `core`: see `clutter`. `publishing`: "
                "reduce the subscribers to markers",
                ("max_latency",),
            ),
        ),
    ),
    CLUTTER: (
        (
            Rule(
                Level.WARN,
                clutter_contradicted,
                "Set `clutter_density` to estimated, or `sensor.clutter_density` to "
                "`detection_density`. Too low a value causes false tracks, too high a "
                "value prevents tracks. Check `sensor.max_range` and the sector too: the density "
                "refers to that coverage",
                ("clutter_factor",),
            ),
        ),
    ),
    SENSOR: tuple(
        (Rule(Level.WARN, sensor_finding(subject), remedy),)
        for subject, remedy in (
            (
                "coverage",
                "Set the parameters that the message names. The density and the threshold already "
                "refer to where detections fall; tracks are still predicted over the whole "
                "coverage as given",
            ),
            (
                "outside_coverage",
                "Set the parameters that the message names; nothing if the coverage is limited on "
                "purpose",
            ),
            (
                "errors",
                "Set the parameters that the message names: errors that are too small lose "
                "targets, errors that are too large delay tracks and admit false tracks",
            ),
            (
                "confirmations",
                "See docs/watch_and_operate.md, too many tracks: objects that stand still, several "
                "detections per target, clumped clutter",
            ),
        )
    ),
    QUALITY_OF_SERVICE: (
        (
            Rule(
                Level.ERROR,
                mismatch,
                "The message names the topic: set the reliability and durability of the other side "
                "as in docs/topics.md, or set `detections_reliability`",
            ),
        ),
    ),
    TRACKER: (
        (Rule(Level.WARN, drops_of(TRACKER), _SEE_REASONS),),
        (
            Rule(
                Level.WARN,
                tracker_silent,
                "The node maintains the tracker's tracks; restart the tracker",
            ),
        ),
    ),
    LAND: ((Rule(Level.WARN, drops_of(LAND), _SEE_REASONS),),),
}
"""Rules by entry; of the rules in one tuple, only the first that applies counts."""


def findings_of(task: str, figures: HealthFigures) -> list[Finding]:
    """Return the findings of a task's rules."""
    findings = []
    for alternatives in RULES[task]:
        judged = ((rule.level, rule.judge(figures)) for rule in alternatives)
        findings += [Finding(level, sentence) for level, sentence in judged if sentence][:1]
    return findings
