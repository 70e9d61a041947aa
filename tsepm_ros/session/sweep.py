"""Sweeps in parts: what a session does with messages of a beam or a sector each."""

from __future__ import annotations

import math
from typing import NamedTuple

from tsepm_ros.own_ship.registration import SensorScan
from tsepm_ros.session.clocks import Now, waited
from tsepm_ros.session.refusal import Notice, Remark
from tsepm_ros.session.sweep_assembly import SweepAssembly
from tsepm_ros.session.sweep_learning import SweepLearner
from tsepm_ros.settings.settings import Settings

MIN_SILENCE = 1.0
"""Shortest time without a message after which an open scan is ended, s."""
MAX_CUT = 4
"""Scans in a row, cut since the beam stands, after which a learned sweep is none any more."""


class Taken(NamedTuple):
    """What a message leads to.

    Attributes
    ----------
    scans : list of SensorScan
        That are complete.
    remarks : list of Refusal or Notice
    changed : bool
        Whether scans are made in another way from this message on: those before it are none.
    """

    scans: list[SensorScan]
    remarks: list[Remark]
    changed: bool = False


class Sweep:
    """Makes scans of messages, by the option `sweep`.

    Parameters
    ----------
    settings : Settings
    """

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self.reset()

    def reset(self) -> None:
        """Forget the messages that wait, and what was learned."""
        self._learner = SweepLearner()
        self._assembly: SweepAssembly | None = None
        self._heard: Now = math.nan
        given = self._settings.session.sweep_seconds
        if given:
            self._assembly = self._make(given)

    def configure(self, settings: Settings) -> None:
        """Change the sensor and the limits; the option `sweep` does not change."""
        self._settings = settings
        if self._assembly is not None:
            self._assembly.sensor = settings.sensor
            self._assembly.target_extent = settings.common.target_extent
            self._assembly.max_detections = settings.common.max_detections
            self._assembly.restart_jump = settings.session.restart_jump

    @property
    def active(self) -> bool:
        """Whether messages are put together."""
        return self._assembly is not None

    @property
    def is_open(self) -> bool:
        """Whether messages wait for the end of their sweep."""
        return self._assembly is not None and self._assembly.is_open

    @property
    def state(self) -> str:
        """How scans are made of messages, in words."""
        if self._assembly is None:
            return "a message is a scan"
        if not self._assembly.parts:
            return f"sweeps of {self._assembly.seconds:.3g} s, none complete yet"
        return f"sweeps of {self._assembly.seconds:.3g} s in {self._assembly.parts} messages"

    @property
    def latency(self) -> float:
        """Time from the first message of the last scan to its completion, by the stamps, s."""
        return 0.0 if self._assembly is None else self._assembly.waited

    def take(self, message: SensorScan, now: Now) -> Taken:
        """Take a message that arrived at `now`, s."""
        if self._assembly is not None:
            self._heard = now
            scans, refusals = self._assembly.take(message)
            if self._settings.session.sweep == "auto" and self._assembly.cut >= MAX_CUT:
                scans += self._assembly.close()
                self.reset()
                said = "the beam no longer turns: each message is a scan again"
                return Taken(scans, [*refusals, Notice("sweep", said)])
            return Taken(scans, list(refusals))
        if self._settings.session.sweep == "auto":
            turning = self._learner.take(message)
            if turning is not None:
                self._assembly = self._make(turning.seconds)
                self._heard = now
                self._assembly.take(message)
                said = (
                    f"messages are parts of a sweep of {turning.seconds:.3g} s (about "
                    f"{turning.parts} messages): they are joined to scans, and earlier tracks are "
                    "discarded"
                )
                return Taken([], [Notice("sweep", said)], changed=True)
        return Taken([message], [])

    def overdue(self, now: Now) -> list[SensorScan]:
        """End the open scan if no message has arrived for the time of a turn."""
        assembly = self._assembly
        if assembly is None or not self.is_open:
            return []
        silence = waited(self._heard, now)
        if not max(assembly.seconds, MIN_SILENCE) < silence < math.inf:
            return []
        return assembly.close()

    def close(self) -> Taken:
        """End the open scan: no message follows."""
        if self._assembly is None:
            return Taken([], [])
        refusals = self._assembly.refuse_held()
        return Taken(self._assembly.close(), list(refusals))

    def _make(self, seconds: float) -> SweepAssembly:
        settings = self._settings
        return SweepAssembly(
            seconds,
            settings.sensor,
            settings.common.target_extent,
            settings.common.max_detections,
            settings.session.restart_jump,
        )
