"""What a session's figures say of its health: one status for each task, as on ``/diagnostics``.

Counts are totals since the start or the last reset; a level tells of the last
`DiagnosticsOptions.window` only, so that what is over is over.
"""

from __future__ import annotations

import dataclasses
import math
import statistics
from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from tsepm_ros.diagnostics.status import Connections, Finding, Latency, Level, Status
from tsepm_ros.session.clocks import Now, waited
from tsepm_ros.session.drop_reasons import DETECTIONS, INITIATION, OWN_SHIP, TRACKER, reason_of
from tsepm_ros.session.snapshot import SessionSnapshot
from tsepm_ros.settings.diagnostics_options import DiagnosticsOptions

SCANS = 50
"""Scans over which intervals and the density of detections are taken."""
LEAST_SCANS = 5
"""Scans before the density of detections is judged."""
LEAST_DETECTIONS = 20.0
"""Detections, expected or found, before it is."""

NO_CONNECTIONS = Connections()
"""Of a session without a node."""


@dataclass(frozen=True)
class _ScanRecord:
    """One processed scan: when, by the first clock (s), its detections and latency."""

    time: float
    detections: int
    latency: Latency


@dataclass(frozen=True)
class _Arrival:
    """One scan, processed or not: when it arrived, by the first clock (s), and its stamp (s)."""

    time: float
    stamp: float


@dataclass(frozen=True)
class _Picture:
    """All that a status is made from."""

    options: DiagnosticsOptions
    figures: SessionSnapshot
    connections: Connections
    recent: Counter[str]
    """Drops of the window by reason; and `_scans`, `_detections` and `_cut`."""
    scans: Sequence[_ScanRecord]
    arrivals: Sequence[_Arrival]
    since_scan: float
    since_own_ship: float
    time: float

    @property
    def recent_scans(self) -> list[_ScanRecord]:
        """Scans of the window."""
        return [scan for scan in self.scans if self.time - scan.time <= self.options.window]

    @property
    def interval(self) -> float:
        """Median of the stamps' intervals, s; nan while unknown."""
        steps = [b.stamp - a.stamp for a, b in pairwise(self.arrivals) if b.stamp > a.stamp]
        return statistics.median(steps) if steps else math.nan

    @property
    def period(self) -> float:
        """Expected time between scans, s; nan while unknown."""
        return self.options.scan_period or self.interval

    def dropped_of(self, task: str) -> dict[str, object]:
        """Totals of the drops that belong to a task, as values."""
        return {
            f"dropped.{name}": number
            for name, number in sorted(self.figures.dropped.items())
            if reason_of(name).task == task
        }

    def recent_drops(self, task: str, *, of_detections: bool = False) -> Counter[str]:
        """Drops of the window that belong to a task: of single detections, or of all else."""
        return Counter(
            {
                name: number
                for name, number in self.recent.items()
                if number > 0
                and name[0] != "_"
                and reason_of(name).task == task
                and (reason_of(name).lost == "detection") is of_detections
            }
        )


class Health:
    """Remembers what is needed to tell the health of a session.

    Parameters
    ----------
    options : DiagnosticsOptions

    Attributes
    ----------
    options : DiagnosticsOptions
        May be replaced at any time.
    latency : Latency
        That of the last scan.
    """

    def __init__(self, options: DiagnosticsOptions) -> None:
        self.options = options
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self.latency = Latency()
        self._scans: deque[_ScanRecord] = deque(maxlen=SCANS)
        self._arrivals: deque[_Arrival] = deque(maxlen=SCANS)
        self._heard: dict[str, Now] = {}
        self._counts: deque[tuple[float, Counter[str]]] = deque()

    def heard(self, task: str, now: Now) -> None:
        """Note that data for a task, `DETECTIONS` or `OWN_SHIP`, arrived at a time."""
        self._heard[task] = now

    def arrived(self, stamp: float, now: Now) -> None:
        """Note the stamp (s) of a scan that arrived, whether it will be processed or not."""
        self._arrivals.append(_Arrival(_first(now), stamp))

    def processed(self, detections: int, latency: Latency, now: Now) -> None:
        """Note a processed scan."""
        self.latency = latency
        self._scans.append(_ScanRecord(_first(now), detections, latency))

    def report(
        self, figures: SessionSnapshot, now: Now, connections: Connections = NO_CONNECTIONS
    ) -> list[Status]:
        """Judge every task.

        Parameters
        ----------
        figures : Figures
        now : float or tuple of float
            Time on the clocks of `heard` and `processed`, s. The window is one of the first.
        connections : Connections, optional

        Returns
        -------
        list of Status
        """
        picture = _Picture(
            self.options,
            figures,
            connections,
            self._recent(figures, _first(now)),
            tuple(self._scans),
            tuple(self._arrivals),
            self._since(DETECTIONS, now),
            self._since(OWN_SHIP, now),
            _first(now),
        )
        return [judge(picture) for judge in _TASKS]

    def _since(self, task: str, now: Now) -> float:
        return waited(self._heard[task], now) if task in self._heard else math.nan

    def _recent(self, figures: SessionSnapshot, time: float) -> Counter[str]:
        """What was counted since the window began; takes the count of now."""
        totals = figures.totals
        counts = Counter(
            _scans=totals.scans,
            _detections=totals.detections,
            _cut=totals.cut_potential_tracks + totals.cut_confirmations,
        )
        counts.update(figures.dropped)
        begin = time - self.options.window
        while len(self._counts) > 1 and self._counts[1][0] <= begin:
            self._counts.popleft()
        before = Counter[str]()
        if self._counts and self._counts[0][0] <= begin:
            before = self._counts[0][1]
        self._counts.append((time, counts))
        recent = Counter(counts)
        recent.subtract(before)
        return recent


def _first(now: Now) -> float:
    return now[0] if isinstance(now, tuple) else now


def _status(
    task: str, findings: Sequence[Finding], otherwise: str, values: Mapping[str, object]
) -> Status:
    """The status of some findings, the worst first; ok where there are none."""
    worst_first = sorted(findings, key=lambda finding: -finding[0])
    if not worst_first:
        return Status(task, Level.OK, otherwise, values)
    message = "; ".join(sentence for _, sentence in worst_first)
    return Status(task, worst_first[0][0], message, values)


def _said(drops: Mapping[str, int]) -> str:
    """Drops in words, the most frequent first."""
    ordered = sorted(drops.items(), key=lambda drop: -drop[1])
    return "dropped: " + ", ".join(f"{number} {name}" for name, number in ordered)


def _drop_findings(picture: _Picture, task: str) -> list[Finding]:
    drops = picture.recent_drops(task)
    return [(Level.WARN, _said(drops))] if drops else []


def _initiation(picture: _Picture) -> Status:
    figures, totals = picture.figures, picture.figures.totals
    values: dict[str, object] = dataclasses.asdict(totals)
    values["potential_tracks"] = figures.potential_tracks
    values["potential_tracks_most"] = totals.potential_tracks
    values["tracks"] = figures.tracks
    values["detection_probability"] = figures.detection_probability
    values["detection_probability_estimated"] = figures.detection_probability_estimated
    values.update(picture.dropped_of(INITIATION))
    findings = [(Level.ERROR, said) for _, said in _drop_findings(picture, INITIATION)]
    if picture.recent["_cut"] > 0:
        findings.append((Level.WARN, f"a limit cut {picture.recent['_cut']} hypotheses"))
    message = f"{totals.scans} scans, {totals.confirmed} confirmed tracks"
    return _status(INITIATION, findings, message, values)


def _detections(picture: _Picture) -> Status:
    single = picture.recent_drops(DETECTIONS, of_detections=True)
    number = sum(single.values())
    share = number / max(number + max(picture.recent["_detections"], 0), 1)
    findings = [*_silence(picture), *_rate(picture), *_drop_findings(picture, DETECTIONS)]
    if share > picture.options.max_dropped_share:
        level = Level.ERROR if share == 1.0 else Level.WARN
        findings.append((level, f"{100 * share:.3g} % of the detections {_said(single)}"))
    values: dict[str, object] = {
        "received": picture.figures.totals.detections,
        "dropped_share": share,
        "scan_interval_s": picture.interval,
        "scan_period_expected_s": picture.period,
        "since_last_scan_s": picture.since_scan,
        **picture.dropped_of(DETECTIONS),
    }
    message = f"{picture.figures.totals.detections} detections"
    if not math.isnan(picture.interval):
        message += f", a scan every {picture.interval:.3g} s"
    return _status(DETECTIONS, findings, message, values)


def _silence(picture: _Picture) -> list[Finding]:
    """Whether scans come at all."""
    unread = ", ".join(picture.connections.unread)
    if unread:
        return [(Level.ERROR, f"detections are published as {unread}, which is not read")]
    if not picture.connections.subscribed:
        return [(Level.WARN, "no publisher of detections yet")]
    silent, options = picture.since_scan, picture.options
    if math.isnan(silent):
        return [(Level.WARN, "no scan yet")]
    if silent > options.stale_time:
        return [(Level.STALE, f"no scan for {silent:.3g} s")]
    if silent > options.scan_period_factor * picture.period:
        expected = f"one is expected every {picture.period:.3g} s"
        return [(Level.WARN, f"no scan for {silent:.3g} s, {expected}")]
    return []


def _rate(picture: _Picture) -> list[Finding]:
    """Whether they come as often as expected."""
    period, factor = picture.period, picture.options.scan_period_factor
    interval = picture.interval
    if interval > factor * period or interval * factor < period:
        return [(Level.WARN, f"a scan every {interval:.3g} s, expected is {period:.3g} s")]
    begin = picture.time - picture.options.window
    long, before = 0, 0.0
    for a, b in pairwise(picture.arrivals):
        step = b.stamp - a.stamp
        # A rise after a fall is the way back from a single bad stamp.
        long += b.time >= begin and before >= 0 and step > factor * period
        before = step
    if long:
        gaps = "1 gap" if long == 1 else f"{long} gaps"
        return [(Level.WARN, f"{gaps} between scans longer than {factor * period:.3g} s")]
    return []


def unused_own_ship(topic: str) -> str:
    """What is said where own-ship data is published on a topic and not used."""
    return (
        f"odometry is published on {topic}, but own_ship_source is none: the sensor is taken not "
        "to move"
    )


def _own_ship(picture: _Picture) -> Status:
    figures = picture.figures
    values: dict[str, object] = {"source": figures.own_ship_source}
    if figures.own_ship_source == "none":
        topic = picture.connections.unused_own_ship
        unused = [(Level.WARN, unused_own_ship(topic))] if topic else []
        return _status(OWN_SHIP, unused, "not needed: the sensor does not move", values)
    values["mounting"] = figures.mounting
    behind = math.nan
    if figures.scan_stamp is not None and figures.own_ship_stamp is not None:
        behind = figures.scan_stamp - figures.own_ship_stamp
    values["age_s"] = picture.since_own_ship
    values["behind_newest_scan_s"] = behind
    values["waiting_for_own_ship"] = figures.waiting
    values.update(picture.dropped_of(OWN_SHIP))
    findings = _drop_findings(picture, OWN_SHIP)
    if figures.own_ship_source == "odometry":
        findings += _own_ship_age(picture, behind)
    return _status(OWN_SHIP, findings, f"own-ship data from {figures.own_ship_source}", values)


def _own_ship_age(picture: _Picture, behind: float) -> list[Finding]:
    """Whether own-ship data is new enough; with tf it is looked up when it is needed."""
    options, age = picture.options, picture.since_own_ship
    if math.isnan(age):
        return [(Level.WARN, "no own-ship data yet")]
    if age > options.stale_time:
        return [(Level.STALE, f"no own-ship data for {age:.3g} s")]
    if age > options.max_own_ship_age:
        return [(Level.WARN, f"no own-ship data for {age:.3g} s")]
    if behind > options.max_own_ship_age:
        return [(Level.WARN, f"own-ship data is {behind:.3g} s older than the newest scan")]
    return []


def _latency(picture: _Picture) -> Status:
    last = picture.scans[-1].latency if picture.scans else Latency()
    recent = [scan.latency for scan in picture.recent_scans]
    longest = max((one.total for one in recent), default=0.0)
    busiest = max((one.core + one.publishing for one in recent), default=0.0)
    values: dict[str, object] = {
        "latency_ms": 1e3 * last.to_tracks,
        "latency_all_ms": 1e3 * last.to_all,
        "waiting_ms": 1e3 * last.waiting,
        "core_ms": 1e3 * last.core,
        "publishing_ms": 1e3 * last.publishing,
        "total_most_ms": 1e3 * longest,
        "waiting_most_ms": 1e3 * max((one.waiting for one in recent), default=0.0),
        "core_most_ms": 1e3 * max((one.core for one in recent), default=0.0),
        "publishing_most_ms": 1e3 * max((one.publishing for one in recent), default=0.0),
    }
    findings: list[Finding] = []
    if busiest > picture.interval:
        said = f"a scan took {busiest:.3g} s, the next came after {picture.interval:.3g} s"
        findings.append((Level.ERROR, said))
    if longest > picture.options.max_latency:
        said = f"a scan was done {longest:.3g} s after its arrival"
        findings.append((Level.WARN, said))
    return _status("latency", findings, f"at most {1e3 * longest:.3g} ms", values)


def _clutter(picture: _Picture) -> Status:
    figures, factor = picture.figures, picture.options.clutter_factor
    scans = len(picture.scans)
    found = float(sum(scan.detections for scan in picture.scans))
    exposure = scans * figures.coverage_area
    expected = figures.clutter_density * exposure
    density = found / exposure if exposure else math.nan
    values: dict[str, object] = {
        "clutter_density": figures.clutter_density,
        "detection_density": density,
    }
    said = f"{figures.clutter_density:.3g} per m^2 in use"
    findings: list[Finding] = []
    if scans >= LEAST_SCANS and max(found, expected) >= LEAST_DETECTIONS:
        said += f", detections are {density:.3g}"
        if max(found, 1.0) > factor * expected or expected > factor * max(found, 1.0):
            findings.append((Level.WARN, f"clutter density of {said}"))
    return _status("clutter", findings, said, values)


def _quality_of_service(picture: _Picture) -> Status:
    heard = picture.connections.mismatches_heard
    values = {f"mismatches.{topic}": number for topic, number in sorted(heard.items())}
    findings = [
        (Level.ERROR, f"the other side of {topic} asks or offers what does not fit: not connected")
        for topic in picture.connections.mismatches
    ]
    return _status("quality of service", findings, "everything fits", values)


def _tracker(picture: _Picture) -> Status:
    findings = _drop_findings(picture, TRACKER)
    if picture.figures.tracker == "silent":
        findings.append((Level.WARN, "the downstream tracker is silent"))
    values = {"tracker": picture.figures.tracker, **picture.dropped_of(TRACKER)}
    said = {"none": "none has been heard", "alive": "heard"}.get(picture.figures.tracker, "")
    return _status(TRACKER, findings, said, values)


_TASKS: tuple[Callable[[_Picture], Status], ...] = (
    _initiation,
    _detections,
    _own_ship,
    _latency,
    _clutter,
    _quality_of_service,
    _tracker,
)
