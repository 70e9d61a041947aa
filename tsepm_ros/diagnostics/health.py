"""What a session's health is judged by over time: arrivals, latencies and counts of the window.

Counts are totals since the start or the last reset; a level is of the last
`DiagnosticsOptions.window` only, so that what is over is over.
"""

from __future__ import annotations

import math
from collections import deque

from tsepm_ros.diagnostics.entries import statuses
from tsepm_ros.diagnostics.health_figures import (
    Arrival,
    Connections,
    Counts,
    HealthFigures,
    Latency,
    ScanRecord,
)
from tsepm_ros.diagnostics.status import Status
from tsepm_ros.session.clocks import Now, waited
from tsepm_ros.session.drop_reasons import DETECTIONS, OWN_SHIP
from tsepm_ros.session.snapshot import SessionSnapshot
from tsepm_ros.settings.diagnostics_options import DiagnosticsOptions

MAX_SCANS = 50
"""Scans over which intervals and the density of detections are taken."""

NO_CONNECTIONS = Connections()
"""Of a session without a node."""


class Health:
    """Remembers what is needed to judge the health of a session.

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
        self._scans: deque[ScanRecord] = deque(maxlen=MAX_SCANS)
        self._arrivals: deque[Arrival] = deque(maxlen=MAX_SCANS)
        self._heard: dict[str, Now] = {}
        self._counts: deque[tuple[float, Counts]] = deque()

    def heard(self, task: str, now: Now) -> None:
        """Note that data for a task, `DETECTIONS` or `OWN_SHIP`, arrived at a time."""
        self._heard[task] = now

    def arrived(self, stamp: float, now: Now) -> None:
        """Note the stamp (s) of a scan that arrived, whether it will be processed or not."""
        self._arrivals.append(Arrival(_first(now), stamp))

    def processed(self, detections: int, latency: Latency, now: Now) -> None:
        """Note a processed scan."""
        self.latency = latency
        self._scans.append(ScanRecord(_first(now), detections, latency))

    def report(
        self, snapshot: SessionSnapshot, now: Now, connections: Connections = NO_CONNECTIONS
    ) -> list[Status]:
        """Judge every task.

        Parameters
        ----------
        snapshot : SessionSnapshot
        now : float or tuple of float
            Time on the clocks of `heard` and `processed`, s. The window is one of the first.
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

    def _since(self, task: str, now: Now) -> float:
        return waited(self._heard[task], now) if task in self._heard else math.nan

    def _recent(self, counts: Counts, time: float) -> Counts:
        """What was counted since the window began; takes the count of now."""
        begin = time - self.options.window
        while len(self._counts) > 1 and self._counts[1][0] <= begin:
            self._counts.popleft()
        at_begin = self._counts and self._counts[0][0] <= begin
        before = self._counts[0][1] if at_begin else Counts()
        self._counts.append((time, counts))
        return counts - before


def _first(now: Now) -> float:
    return now[0] if isinstance(now, tuple) else now
