"""Contradictions between the stated sensor and what is received.

Questions about parameters that look like degrees; no value is converted.

Whether the sensor's figures as given fit what the scans show, in sentences with the remedy.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

from tsepm_ros.own_ship.mounting import Mounting
from tsepm_ros.tracker.clutter.measurement_errors import FittedErrors
from tsepm_ros.tracker.clutter.seen_extent import Extent
from tsepm_ros.tracker.sensor import SensorModel
from tsepm_ros.tracker.tracker import Tracker

MAX_LIKELY_STD = 0.2
"""Standard deviation of an azimuth, rad (11 degrees), beyond which it looks like degrees."""
MAX_LIKELY_RESOLUTION = 0.8
"""Width of a beam, rad (46 degrees), beyond which it looks like degrees."""
MAX_LIKELY_YAW = 3.2
"""Yaw of a mounting, rad (half a turn), beyond which it looks like degrees."""


def questions(sensor: SensorModel, mounting: Mounting) -> list[str]:
    """Questions about parameters in radians that look like degrees, a sentence each."""
    return [
        f"{name} is {value:g} rad, which is {math.degrees(value):.0f} degrees: if {value:g} "
        f"degrees are meant, set {math.radians(value):.4g}"
        for name, value, limit in (
            ("sensor.azimuth_std", sensor.azimuth_std, MAX_LIKELY_STD),
            ("sensor.azimuth_resolution", sensor.azimuth_resolution, MAX_LIKELY_RESOLUTION),
            ("mounting.yaw", mounting.yaw, MAX_LIKELY_YAW),
        )
        if abs(value) > limit
    ]


AREA_FACTOR = 2.0
"""Factor by which the coverage as given may exceed the area in which detections fall."""
MIN_LOG_RATIO = 14.0
"""Log-likelihood ratio of the smaller area from which on it is said."""
MAX_OUTSIDE_SHARE = 0.05
"""Share of the detections outside the coverage that is accepted."""
MIN_OUTSIDE = 20
"""Detections outside the coverage from which on it is said."""
OUTSIDE_SCANS = 100
"""Scans, the last, over which these are counted."""
ERROR_FACTOR = 1.5
"""Factor by which the errors as given may differ from those of the innovations."""
LEAST_FACTOR = 0.01
"""Factor below which detections have no errors of a sensor: they are simulated, or rounded."""
RATE_WINDOW = 3600.0
"""Time over which confirmations are counted, s."""
RATE_FACTOR = 10.0
"""Confirmations may exceed the target false-track rate by this factor: there are targets too."""
SCANS_BETWEEN = 10
MIN_EMPTY_SECTOR = math.pi / 3.0
"""Sector without detections, rad, below which they count as all round: chance leaves gaps."""
MIN_CONFIRMATIONS = 30
"""Confirmations from which on a flood is said."""


@dataclass(frozen=True)
class SensorFigures:
    """Learned figures beside those that are given.

    Attributes
    ----------
    sensor : SensorModel
        As given.
    seen : Extent or None
        Where clutter is seen; None before enough detections.
    seen_detections : int
        Detections from which this is known.
    outside : int
        Detections outside the coverage, in the last `OUTSIDE_SCANS`.
    detections : int
        All detections of these.
    outside_extent : Extent or None
        Ranges and sector of all detections, where some are outside the coverage.
    errors : FittedErrors or None
        Errors that fit the held tracks' innovations.
    confirmed : int
        Tracks confirmed within `duration`.
    duration : float
        s, at most `RATE_WINDOW`.
    false_tracks_per_hour : float or None
        The target false-track rate; None where the method has none.
    """

    sensor: SensorModel = field(default_factory=SensorModel)
    seen: Extent | None = None
    seen_detections: int = 0
    outside: int = 0
    detections: int = 0
    outside_extent: Extent | None = None
    errors: FittedErrors | None = None
    confirmed: int = 0
    duration: float = 0.0
    false_tracks_per_hour: float | None = None


def findings(figures: SensorFigures) -> dict[str, str]:
    """Sentences by subject, for what does not fit."""
    found = {
        "coverage": coverage_too_large(figures),
        "coverage_too_small": coverage_too_small(figures),
        "errors": errors_differ(figures),
        "confirmations": many_confirmations(figures),
    }
    return {subject: sentence for subject, sentence in found.items() if sentence}


def coverage_too_large(figures: SensorFigures) -> str:
    """Detections fall in a small part of the coverage."""
    seen, given = figures.seen, figures.sensor.coverage_area
    if seen is None or seen.area <= 0.0 or given < AREA_FACTOR * seen.area:
        return ""
    if figures.seen_detections * math.log(given / seen.area) < MIN_LOG_RATIO:
        return ""
    return (
        f"all detections are {_of(seen)}; by the parameters, the coverage is "
        f"{_of(Extent.of(figures.sensor))}: if the sonar covers no more, set "
        f"{_settings(seen, figures.sensor)} (m, rad)"
    )


def coverage_too_small(figures: SensorFigures) -> str:
    """Detections are dropped since they lie outside the coverage."""
    share = figures.outside / max(figures.detections, 1)
    extent = figures.outside_extent
    if extent is None or figures.outside < MIN_OUTSIDE or share < MAX_OUTSIDE_SHARE:
        return ""
    return (
        f"{100.0 * share:.0f} % of the detections are outside the coverage and dropped; they are "
        f"{_of(extent)}: set {_settings(extent, figures.sensor)}, unless the coverage is limited "
        "on purpose"
    )


def errors_differ(figures: SensorFigures) -> str:
    """The errors of range or azimuth do not fit the detections of held tracks."""
    errors = figures.errors
    if errors is None:
        return ""
    if min(errors.range_factor, errors.azimuth_factor) < LEAST_FACTOR:
        return (
            "as the detections of held tracks show, errors of range or azimuth are less than "
            f"{100.0 * LEAST_FACTOR:g} % of those of the parameters: are the detections simulated?"
        )
    parts = []
    if not 1.0 / ERROR_FACTOR <= errors.range_factor <= ERROR_FACTOR:
        parts.append(
            f"range errors are {errors.range_factor:.2g} times those of the parameters (at a "
            f"median range of {errors.median_range:.3g} m): set sensor.range_std to "
            f"{errors.range_std:.2g} and sensor.range_std_fraction to "
            f"{errors.range_std_fraction:.2g}"
        )
    if not 1.0 / ERROR_FACTOR <= errors.azimuth_factor <= ERROR_FACTOR:
        parts.append(
            f"azimuth errors are {errors.azimuth_factor:.2g} times those of the parameters: set "
            f"sensor.azimuth_std to {errors.azimuth_std:.2g} rad "
            f"({math.degrees(errors.azimuth_std):.2g} degrees)"
        )
    return "as the detections of held tracks show, " + "; ".join(parts) if parts else ""


def many_confirmations(figures: SensorFigures) -> str:
    """Far more tracks are confirmed than the target false-track rate allows."""
    rate, confirmed = figures.false_tracks_per_hour, figures.confirmed
    if rate is None or confirmed < MIN_CONFIRMATIONS:
        return ""
    if confirmed <= RATE_FACTOR * rate * figures.duration / 3600.0:
        return ""
    return (
        f"{confirmed} tracks were confirmed in {figures.duration / 60.0:.0f} min; the target "
        f"false-track rate is {rate:g} per hour. If there are fewer targets, see "
        "docs/watch_and_operate.md, too many tracks"
    )


def _is_sector(extent: Extent) -> bool:
    """Whether an extent leaves out more than a chance gap."""
    seen = extent.azimuth_max - extent.azimuth_min
    return not extent.all_round and 2.0 * math.pi - seen >= MIN_EMPTY_SECTOR


def _of(extent: Extent) -> str:
    """An extent in words."""
    sector = "all round"
    if _is_sector(extent):
        sector = (
            f"between {math.degrees(extent.azimuth_min):.0f} and "
            f"{math.degrees(extent.azimuth_max):.0f} degrees"
        )
    return f"from {_rounded_down(extent.min_range):g} to {extent.max_range:.4g} m, {sector}"


def _settings(extent: Extent, sensor: SensorModel) -> str:
    """Parameters that make an extent the coverage."""
    settings = {"sensor.max_range": f"{_rounded_up(extent.max_range):g}"}
    if extent.min_range < sensor.min_range:
        settings["sensor.min_range"] = f"{_rounded_down(extent.min_range):g}"
    if _is_sector(extent):
        settings["sensor.azimuth_min"] = f"{extent.azimuth_min:.3g}"
        settings["sensor.azimuth_max"] = f"{extent.azimuth_max:.3g}"
    return ", ".join(f"{name} to {value}" for name, value in settings.items())


def _rounded_up(value: float) -> float:
    """To two significant digits, not below."""
    step = 10.0 ** (math.floor(math.log10(value)) - 1)
    return step * math.ceil(value / step - 0.1)


def _rounded_down(value: float) -> float:
    """To two significant digits, not above."""
    if value < 1e-300:  # its step would vanish
        return 0.0
    step = 10.0 ** (math.floor(math.log10(value)) - 1)
    return step * math.floor(value / step)


class SensorCheck:
    """Compares the sensor's figures with what an initiator learned; says each finding once."""

    def __init__(self) -> None:
        self._said: set[str] = set()
        self._scans = 0
        self._confirmed: deque[float] = deque(maxlen=10_000)
        self._outside: deque[tuple[int, int]] = deque(maxlen=OUTSIDE_SCANS)
        self._first_stamp: float | None = None

    def observe(self, stamp: float, confirmed: int, outside: int, detections: int) -> None:
        """Count what a scan brought.

        Parameters
        ----------
        stamp : float
            s, ascending.
        confirmed : int
            New tracks.
        outside, detections : int
            Detections outside the coverage, and all.
        """
        self._outside.append((outside, detections))
        if self._first_stamp is None:
            self._first_stamp = stamp
        self._confirmed.extend([stamp] * confirmed)
        while self._confirmed and self._confirmed[0] < stamp - RATE_WINDOW:
            self._confirmed.popleft()

    def figures(self, initiator: Tracker) -> SensorFigures:
        """Learned figures beside those that are given."""
        learned, sensor = initiator.learned, initiator.sensor
        seen, all_seen = learned.seen_extent, learned.all_extent
        stamp, first = initiator.stamp, self._first_stamp
        duration = 0.0 if stamp is None or first is None else stamp - first
        outside = sum(number for number, _ in self._outside)
        return SensorFigures(
            sensor=sensor,
            seen=seen.estimate if seen.certain else None,
            seen_detections=seen.detections,
            outside=outside,
            detections=sum(number for _, number in self._outside),
            outside_extent=all_seen.estimate if outside else None,
            errors=learned.errors.fitted,
            confirmed=len(self._confirmed),
            duration=min(duration, RATE_WINDOW),
            false_tracks_per_hour=getattr(initiator.options, "false_tracks_per_hour", None),
        )

    def news(self, initiator: Tracker) -> list[tuple[str, str]]:
        """Subjects and sentences not found before; looked for at every tenth scan."""
        self._scans += 1
        if self._scans % SCANS_BETWEEN:
            return []
        found = findings(self.figures(initiator))
        new = [(subject, said) for subject, said in found.items() if subject not in self._said]
        self._said |= {subject for subject, _ in new}
        return new

    def say_again(self) -> None:
        """Say every finding again, and count anew: the figures as given may have changed."""
        self._said = set()
        self._outside.clear()
