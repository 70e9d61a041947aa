"""Judgements of health: rules from figures to levels.

Judgements of the diagnostics: from figures to the sentence that names a problem.

A judgement returns an empty sentence if there is no problem. The first line of its documentation is
the condition in docs/diagnostics.md.

The rules of the diagnostics: problems of each entry, with level, thresholds and remedy.

docs/diagnostics.md lists them.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from tsepm_ros.diagnostics.health_figures import Finding, HealthFigures, Level
from tsepm_ros.session.drop_reasons import DETECTIONS, INITIATION, LAND, OWN_SHIP, TRACKER

MIN_SCANS = 5
"""Minimum number of scans for a judgement of the density of detections."""
MIN_DETECTIONS = 20.0
"""Minimum number of detections, expected or observed, for that judgement."""

Judgement = Callable[[HealthFigures], str]

SENSOR_CONDITIONS = {
    "coverage": "All detections fall in less than half of the coverage as given.",
    "outside_coverage": "More than 5 % of the detections are outside the coverage.",
    "errors": "The errors of the detections of held tracks differ from the given errors by more "
    "than a factor of 1.5.",
    "confirmations": "At least 30 tracks were confirmed within an hour, more than ten times the "
    "target false-track rate.",
}
"""Conditions of the rules on the sensor's parameters, by subject."""


def _in_words(drops: Mapping[str, int]) -> str:
    """Drops by reason, the most frequent first."""
    ordered = sorted(drops.items(), key=lambda drop: -drop[1])
    return "dropped: " + ", ".join(f"{number} {name}" for name, number in ordered)


def drops_of(task: str) -> Judgement:
    """Make the judgement of a task's drops, except those of single detections."""

    def judge(figures: HealthFigures) -> str:
        """Input of this entry was dropped."""
        drops = figures.recent_drops(task)
        return _in_words(drops) if drops else ""

    return judge


def cut_hypotheses(figures: HealthFigures) -> str:
    """Hypotheses were cut by a limit."""
    cut = figures.recent.cut
    return f"a limit cut {cut} hypotheses" if cut > 0 else ""


def unread_type(figures: HealthFigures) -> str:
    """Detections are published as a type that the node does not read."""
    now = figures.connections
    other = ", ".join(name for name in now.unread if name not in now.other_readable)
    sentences = [f"{other}, which the node does not read"] if other else []
    if now.other_readable:
        after = f"after a new start: it has subscribed to {now.subscribed_type}"
        sentences.append(f"{', '.join(now.other_readable)}, which the node reads only {after}")
    return f"detections are published as {'; and as '.join(sentences)}" if sentences else ""


def clock_stands(figures: HealthFigures) -> str:
    """The node's clock, which is simulated, stands still."""
    return figures.connections.clock_fault


def no_publisher(figures: HealthFigures) -> str:
    """There is no publisher of detections."""
    return "" if figures.connections.subscribed else "no publisher of detections yet"


def no_scan_yet(figures: HealthFigures) -> str:
    """No scan has arrived."""
    return "no scan yet" if math.isnan(figures.since_scan) else ""


def scans_stopped(figures: HealthFigures) -> str:
    """No scan arrives any more."""
    elapsed = figures.since_scan
    return f"no scan for {elapsed:.3g} s" if elapsed > figures.options.stale_time else ""


def scan_overdue(figures: HealthFigures) -> str:
    """The next scan is overdue."""
    elapsed, period = figures.since_scan, figures.period
    late = elapsed > figures.options.scan_period_factor * period
    return f"no scan for {elapsed:.3g} s, expected is a scan every {period:.3g} s" if late else ""


def scan_rate(figures: HealthFigures) -> str:
    """Scans arrive at another rate than expected."""
    interval, period, factor = figures.interval, figures.period, figures.options.scan_period_factor
    differs = interval > factor * period or interval * factor < period
    return f"a scan every {interval:.3g} s, expected is {period:.3g} s" if differs else ""


def scan_gaps(figures: HealthFigures) -> str:
    """There are gaps between scans."""
    number, longest = figures.gaps, figures.max_interval
    gaps = "1 gap" if number == 1 else f"{number} gaps"
    return f"{gaps} between scans longer than {longest:.3g} s" if number else ""


def detections_dropped(figures: HealthFigures) -> str:
    """Too many detections are dropped one by one."""
    share = figures.dropped_share
    if share <= figures.options.max_dropped_share:
        return ""
    drops = _in_words(figures.recent_drops(DETECTIONS, of_detections=True))
    return f"{100 * share:.3g} % of the detections {drops}"


def all_detections_dropped(figures: HealthFigures) -> str:
    """Every detection is dropped."""
    return detections_dropped(figures) if figures.dropped_share == 1.0 else ""


def unused_own_ship_on(topic: str) -> str:
    """Return the sentence for own-ship data that is published on a topic and not used."""
    return (
        f"odometry is published on {topic}, but own_ship_source is none: the sensor is assumed "
        "not to move"
    )


def own_ship_unused(figures: HealthFigures) -> str:
    """Odometry is published, but `own_ship_source` is none."""
    topic = figures.connections.unused_own_ship
    return unused_own_ship_on(topic) if topic and figures.own_ship_source == "none" else ""


def own_ship_drops(figures: HealthFigures) -> str:
    """Own-ship data that is used was dropped, or scans were dropped for lack of it."""
    return "" if figures.own_ship_source == "none" else drops_of(OWN_SHIP)(figures)


def _of_odometry(judge: Judgement) -> Judgement:
    """Restrict a judgement to odometry: data from tf is looked up when it is needed."""

    @functools.wraps(judge)
    def restricted(figures: HealthFigures) -> str:
        return judge(figures) if figures.own_ship_source == "odometry" else ""

    return restricted


@_of_odometry
def no_own_ship_yet(figures: HealthFigures) -> str:
    """No own-ship data has arrived."""
    return "no own-ship data yet" if math.isnan(figures.since_own_ship) else ""


@_of_odometry
def own_ship_stopped(figures: HealthFigures) -> str:
    """Own-ship data has stopped."""
    age = figures.since_own_ship
    return f"no own-ship data for {age:.3g} s" if age > figures.options.stale_time else ""


@_of_odometry
def own_ship_old(figures: HealthFigures) -> str:
    """Own-ship data is too old now."""
    age = figures.since_own_ship
    return f"no own-ship data for {age:.3g} s" if age > figures.options.max_own_ship_age else ""


@_of_odometry
def own_ship_behind(figures: HealthFigures) -> str:
    """Own-ship data is too old at the newest scan."""
    behind = figures.own_ship_behind
    late = behind > figures.options.max_own_ship_age
    return f"own-ship data is {behind:.3g} s older than the newest scan" if late else ""


def overload(figures: HealthFigures) -> str:
    """Processing and publishing take longer than the scan interval, in the median of the window."""
    median = figures.median_latency(lambda latency: latency.core + latency.publishing)
    interval = figures.interval
    sentence = f"a scan takes {median:.3g} s, longer than the scan interval of {interval:.3g} s"
    return sentence if median > interval else ""


def long_latency(figures: HealthFigures) -> str:
    """A scan was finished too late after its arrival."""
    longest = figures.longest_latency(lambda latency: latency.total)
    late = longest > figures.options.max_latency
    return f"a scan was finished {longest:.3g} s after its arrival" if late else ""


def is_density_judged(figures: HealthFigures) -> bool:
    """Whether there are enough scans and detections to judge the density in use."""
    number = max(figures.detections, figures.clutter_expected)
    return len(figures.scans) >= MIN_SCANS and number >= MIN_DETECTIONS


def densities(figures: HealthFigures) -> str:
    """The density in use in words, and the density of detections if it can be judged."""
    in_use = f"{figures.snapshot.clutter_density:.3g} per m^2 in use"
    observed = f", detections have {figures.detection_density:.3g}"
    return in_use + observed if is_density_judged(figures) else in_use


def clutter_contradicted(figures: HealthFigures) -> str:
    """The density of the last detections differs from the clutter density in use."""
    factor, expected = figures.options.clutter_factor, figures.clutter_expected
    observed = max(figures.detections, 1.0)
    differs = observed > factor * expected or expected > factor * observed
    return (
        f"clutter density of {densities(figures)}" if differs and is_density_judged(figures) else ""
    )


def sensor_finding(subject: str) -> Judgement:
    """Make the judgement of a figure of the sensor that does not fit the scans."""

    def judge(figures: HealthFigures) -> str:
        return figures.snapshot.sensor_findings.get(subject, "")

    judge.__doc__ = SENSOR_CONDITIONS[subject]
    return judge


def mismatch(figures: HealthFigures) -> str:
    """A publisher or subscriber has an incompatible quality of service."""
    return "; ".join(
        f"incompatible quality of service on {topic}: not connected"
        for topic in figures.connections.mismatches
    )


def tracker_silent(figures: HealthFigures) -> str:
    """The downstream tracker has stopped reporting."""
    return "the downstream tracker is silent" if figures.snapshot.tracker == "silent" else ""


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
