"""Own-ship data as it arrives: accepted, refused, or begun anew."""

from __future__ import annotations

from collections.abc import Callable

from tsepm_ros.own_ship import registration
from tsepm_ros.own_ship.pose_history import PoseCoverage, PoseHistory
from tsepm_ros.own_ship.pose_sample import PoseSample
from tsepm_ros.own_ship.registration import SensorScan
from tsepm_ros.session.refusal import Notice, Refusal
from tsepm_ros.settings.session_options import SessionOptions

LookUp = Callable[[str, float, float, str], None]


class OwnShipInput:
    """The poses of a sensor that moves, and whether they reach to a scan's time.

    Parameters
    ----------
    options : SessionOptions

    Attributes
    ----------
    source : str
        Where own-ship data comes from: as at the start, whatever options say later.
    poses : PoseHistory
    restarted : bool
        Whether the poses started over since the last scan that was processed.
    look_up : callable or None
        Called as ``look_up(sensor frame, first, last, axes)`` for the span of time (s) of a scan
        that is to be placed, to give its poses; None where they come by themselves.
    """

    def __init__(self, options: SessionOptions) -> None:
        self.source = options.own_ship_source
        self.poses = PoseHistory(
            max_extrapolation=options.own_ship_max_extrapolation,
            max_gap=options.own_ship_max_gap,
        )
        self.restarted = False
        self.look_up: LookUp | None = None
        self._options = options

    @property
    def moves(self) -> bool:
        """Whether the sensor moves in the fixed frame."""
        return self.source != "none"

    def configure(self, options: SessionOptions) -> None:
        """Change the times that count from now on."""
        self._options = options
        self.poses.max_extrapolation = options.own_ship_max_extrapolation
        self.poses.max_gap = options.own_ship_max_gap

    def reset(self) -> None:
        """Forget the poses."""
        self.poses.clear()
        self.restarted = False

    def add(self, sample: PoseSample) -> Refusal | None:
        """Add a sample, or say that it is late; one far back starts over."""
        if self._is_ahead(sample.stamp):
            self.restart(sample.stamp)
        if self.poses.add(sample):
            return None
        return Refusal(
            "own_ship_late", f"own-ship data of {sample.stamp:.3f} s is not newer than the last"
        )

    def restart_if_late_for_long(self, stamp: float) -> Notice | None:
        """Start over with the late samples, up to a stamp (s), where they are a source's only."""
        if self.poses.late_span <= self._options.own_ship_timeout:
            return None
        self.restart(stamp)
        return Notice("own_ship_restart", f"own-ship data starts over at {stamp:.3f} s")

    def restart(self, stamp: float) -> None:
        """Start over at a stamp (s): poses of before place nothing after it."""
        self.poses.start_over()
        if self._is_ahead(stamp):
            self.poses.clear()
        self.restarted = True

    def must_wait(self, arrived: SensorScan, waiting: float) -> bool:
        """Whether a scan that waited so long (s) needs poses that may still come."""
        if not self.moves:
            return False
        first, last = registration.echo_span(arrived)
        if self.look_up is not None:
            self.look_up(arrived.frame_id, first, last, arrived.axes)
        if self.poses.coverage(first, last) is not PoseCoverage.NOT_YET:
            return False
        return waiting < self._options.own_ship_timeout

    def refuse(self, arrived: SensorScan) -> Refusal | None:
        """Why there are no poses for a scan that need not wait."""
        if not self.moves:
            return None
        first, last = registration.echo_span(arrived)
        coverage = self.poses.coverage(first, last)
        reaches = coverage is PoseCoverage.YES or self.poses.can_extrapolate(last)
        if coverage is not PoseCoverage.NEVER and reaches:
            return None
        reason = "own_ship_stale" if len(self.poses) else "own_ship_missing"
        return Refusal(reason, f"no own-ship data for the scan of {arrived.scan.stamp:.3f} s")

    def _is_ahead(self, stamp: float) -> bool:
        last = self.poses.last_stamp
        return last is not None and last - stamp > self._options.restart_jump
