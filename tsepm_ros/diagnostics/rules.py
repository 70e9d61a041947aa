"""The rules of health: from figures to sentences that say what is wrong.

A rule's function returns its sentence, empty where nothing is wrong. Beside it stand the level, the
options that it compares with, and what to do, which docs/operating.md has too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from tsepm_ros.diagnostics.health_figures import HealthFigures
from tsepm_ros.diagnostics.status import Finding, Level
from tsepm_ros.session.drop_reasons import DETECTIONS, INITIATION, OWN_SHIP, TRACKER

LATENCY, CLUTTER, QUALITY_OF_SERVICE = "latency", "clutter", "quality of service"
"""Entries to which no drop belongs."""

MIN_SCANS = 5
"""Scans before the density of detections is judged."""
MIN_DETECTIONS = 20.0
"""Detections, expected or found, before it is."""

Judgement = Callable[[HealthFigures], str]


@dataclass(frozen=True)
class Rule:
    """One thing that may not be healthy.

    Attributes
    ----------
    level : Level
        That of an entry in which it is so.
    judge : callable
        Returns the sentence that says it, or an empty one.
    remedy : str
        What to do.
    thresholds : tuple of str
        Options of `DiagnosticsOptions` that it compares with.
    """

    level: Level
    judge: Judgement
    remedy: str
    thresholds: tuple[str, ...] = ()


def _in_words(drops: Mapping[str, int]) -> str:
    """Drops by reason, the most frequent first."""
    ordered = sorted(drops.items(), key=lambda drop: -drop[1])
    return "dropped: " + ", ".join(f"{number} {name}" for name, number in ordered)


def drops_of(task: str) -> Judgement:
    """Make the judgement of a task's drops, those of single detections aside."""

    def judge(figures: HealthFigures) -> str:
        drops = figures.recent_drops(task)
        return _in_words(drops) if drops else ""

    return judge


def cut_hypotheses(figures: HealthFigures) -> str:
    """Whether a limit cut hypotheses."""
    cut = figures.recent.cut
    return f"a limit cut {cut} hypotheses" if cut > 0 else ""


def unread_type(figures: HealthFigures) -> str:
    """Whether detections are published as a type that the node has not subscribed to."""
    unread = ", ".join(figures.connections.unread)
    return f"detections are published as {unread}, which is not read" if unread else ""


def no_publisher(figures: HealthFigures) -> str:
    """Whether there is no publisher of detections."""
    return "" if figures.connections.subscribed else "no publisher of detections yet"


def no_scan_yet(figures: HealthFigures) -> str:
    """Whether no scan has come."""
    return "no scan yet" if math.isnan(figures.since_scan) else ""


def scans_stopped(figures: HealthFigures) -> str:
    """Whether scans have stopped."""
    silent = figures.since_scan
    return f"no scan for {silent:.3g} s" if silent > figures.options.stale_time else ""


def scan_overdue(figures: HealthFigures) -> str:
    """Whether the next scan is late."""
    silent, period = figures.since_scan, figures.period
    late = silent > figures.options.scan_period_factor * period
    return f"no scan for {silent:.3g} s, one is expected every {period:.3g} s" if late else ""


def scan_rate(figures: HealthFigures) -> str:
    """Whether scans come at another rate than expected."""
    interval, period, factor = figures.interval, figures.period, figures.options.scan_period_factor
    other = interval > factor * period or interval * factor < period
    return f"a scan every {interval:.3g} s, expected is {period:.3g} s" if other else ""


def scan_gaps(figures: HealthFigures) -> str:
    """Whether there are gaps between scans."""
    number, longest = figures.gaps, figures.longest_interval
    gaps = "1 gap" if number == 1 else f"{number} gaps"
    return f"{gaps} between scans longer than {longest:.3g} s" if number else ""


def detections_dropped(figures: HealthFigures) -> str:
    """Whether too many detections are dropped one by one."""
    share = figures.dropped_share
    if share <= figures.options.max_dropped_share:
        return ""
    drops = _in_words(figures.recent_drops(DETECTIONS, of_detections=True))
    return f"{100 * share:.3g} % of the detections {drops}"


def all_detections_dropped(figures: HealthFigures) -> str:
    """Whether every detection is dropped."""
    return detections_dropped(figures) if figures.dropped_share == 1.0 else ""


def unused_own_ship_on(topic: str) -> str:
    """What is said where own-ship data is published on a topic and not used."""
    return (
        f"odometry is published on {topic}, but own_ship_source is none: the sensor is taken not "
        "to move"
    )


def own_ship_unused(figures: HealthFigures) -> str:
    """Whether own-ship data is published and not used."""
    topic = figures.connections.unused_own_ship
    return unused_own_ship_on(topic) if topic and figures.own_ship_source == "none" else ""


def own_ship_drops(figures: HealthFigures) -> str:
    """Whether own-ship data, where it is used, or scans for lack of it were dropped."""
    return "" if figures.own_ship_source == "none" else drops_of(OWN_SHIP)(figures)


def _of_odometry(judge: Judgement) -> Judgement:
    """A judgement of odometry only: data from tf is looked up when it is needed."""
    return lambda figures: judge(figures) if figures.own_ship_source == "odometry" else ""


@_of_odometry
def no_own_ship_yet(figures: HealthFigures) -> str:
    """Whether no own-ship data has come."""
    return "no own-ship data yet" if math.isnan(figures.since_own_ship) else ""


@_of_odometry
def own_ship_stopped(figures: HealthFigures) -> str:
    """Whether own-ship data has stopped."""
    age = figures.since_own_ship
    return f"no own-ship data for {age:.3g} s" if age > figures.options.stale_time else ""


@_of_odometry
def own_ship_old(figures: HealthFigures) -> str:
    """Whether own-ship data is too old now."""
    age = figures.since_own_ship
    return f"no own-ship data for {age:.3g} s" if age > figures.options.max_own_ship_age else ""


@_of_odometry
def own_ship_behind(figures: HealthFigures) -> str:
    """Whether own-ship data is too old at the newest scan."""
    behind = figures.own_ship_behind
    late = behind > figures.options.max_own_ship_age
    return f"own-ship data is {behind:.3g} s older than the newest scan" if late else ""


def overload(figures: HealthFigures) -> str:
    """Whether a scan took longer than the time to the next."""
    busiest = figures.longest_latency(lambda latency: latency.core + latency.publishing)
    interval = figures.interval
    sentence = f"a scan took {busiest:.3g} s, the next came after {interval:.3g} s"
    return sentence if busiest > interval else ""


def long_latency(figures: HealthFigures) -> str:
    """Whether a scan was done too late."""
    longest = figures.longest_latency(lambda latency: latency.total)
    late = longest > figures.options.max_latency
    return f"a scan was done {longest:.3g} s after its arrival" if late else ""


def is_density_judged(figures: HealthFigures) -> bool:
    """Whether there are enough scans and detections to judge the density in use by."""
    number = max(figures.detections, figures.clutter_expected)
    return len(figures.scans) >= MIN_SCANS and number >= MIN_DETECTIONS


def densities(figures: HealthFigures) -> str:
    """The density in use in words, and that of the detections where it can be judged."""
    in_use = f"{figures.snapshot.clutter_density:.3g} per m^2 in use"
    found = f", detections are {figures.detection_density:.3g}"
    return in_use + found if is_density_judged(figures) else in_use


def clutter_contradicted(figures: HealthFigures) -> str:
    """Whether the detections contradict the clutter density in use."""
    factor, expected = figures.options.clutter_factor, figures.clutter_expected
    found = max(figures.detections, 1.0)
    other = found > factor * expected or expected > factor * found
    return (
        f"clutter density of {densities(figures)}" if other and is_density_judged(figures) else ""
    )


def mismatch(figures: HealthFigures) -> str:
    """Whether an endpoint now has a quality of service that does not fit."""
    return "; ".join(
        f"the other side of {topic} asks or offers what does not fit: not connected"
        for topic in figures.connections.mismatches
    )


def tracker_silent(figures: HealthFigures) -> str:
    """Whether the downstream tracker has stopped reporting."""
    return "the downstream tracker is silent" if figures.snapshot.tracker == "silent" else ""


_SEE_REASONS = "See the reasons below"
_NO_SCAN = "Check the topic and its type: `ros2 topic info -v`; remap `detections`"
_LOST_PINGS = (
    "Pings are lost: look at the driver and the network. A sonar that changes its period: leave "
    "`scan_period` at 0"
)
_NAVIGATION = "Look at the navigation; compare its clock with the sonar's"

RULES: dict[str, tuple[tuple[Rule, ...], ...]] = {
    INITIATION: (
        (Rule(Level.ERROR, drops_of(INITIATION), "See `internal_error` below"),),
        (
            Rule(
                Level.WARN,
                cut_hypotheses,
                "Too many detections for the limits: check the entry `clutter`; raise "
                "`max_potential_tracks` or `max_scan_time` where there is time left",
            ),
        ),
    ),
    DETECTIONS: (
        (
            Rule(Level.ERROR, unread_type, "Start the node again, or give `detections_type`"),
            Rule(Level.WARN, no_publisher, _NO_SCAN),
            Rule(Level.WARN, no_scan_yet, _NO_SCAN),
            Rule(Level.STALE, scans_stopped, "The driver has stopped", ("stale_time",)),
            Rule(Level.WARN, scan_overdue, _LOST_PINGS, ("scan_period", "scan_period_factor")),
        ),
        (
            Rule(Level.WARN, scan_rate, _LOST_PINGS, ("scan_period", "scan_period_factor")),
            Rule(Level.WARN, scan_gaps, _LOST_PINGS, ("scan_period", "scan_period_factor")),
        ),
        (Rule(Level.WARN, drops_of(DETECTIONS), _SEE_REASONS),),
        tuple(
            Rule(
                level,
                judge,
                "See the reasons below; where a sensor marks empty rays in its own way, raise the "
                "share",
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
                "The navigation has stopped; tracks of a moving vessel end here",
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
                "It cannot keep up: raise thresholds in the sonar, or lower "
                "`max_potential_tracks` and `max_scan_time`",
            ),
        ),
        (
            Rule(
                Level.WARN,
                long_latency,
                "`waiting`: own-ship data comes late. `core`: see `clutter`. `publishing`: fewer "
                "listeners to markers",
                ("max_latency",),
            ),
        ),
    ),
    CLUTTER: (
        (
            Rule(
                Level.WARN,
                clutter_contradicted,
                "Give `sensor.clutter_density` as found (`detection_density`), or "
                "`clutter_density:=estimated`. Too low a value gives false tracks, too high a "
                "one gives none. Check `sensor.max_range` and the sector too: the density is "
                "over that coverage",
                ("clutter_factor",),
            ),
        ),
    ),
    QUALITY_OF_SERVICE: (
        (
            Rule(
                Level.ERROR,
                mismatch,
                "Named in the message: give the other side the reliability and durability of the "
                "table in the README, or set `detections_reliability`",
            ),
        ),
    ),
    TRACKER: (
        (Rule(Level.WARN, drops_of(TRACKER), _SEE_REASONS),),
        (
            Rule(
                Level.WARN,
                tracker_silent,
                "Its tracks are held here; restart it",
            ),
        ),
    ),
}
"""Rules by entry; of the rules in one tuple only the first that finds something counts."""


def findings_of(task: str, figures: HealthFigures) -> list[Finding]:
    """Return what the rules of a task find."""
    findings = []
    for alternatives in RULES[task]:
        judged = ((rule.level, rule.judge(figures)) for rule in alternatives)
        findings += [Finding(level, sentence) for level, sentence in judged if sentence][:1]
    return findings
