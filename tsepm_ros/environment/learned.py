"""Models of the surroundings, independent of the method."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from tsepm_ros.environment.clutter_clumps import ClutterClumps
from tsepm_ros.environment.clutter_map import ClutterMap
from tsepm_ros.environment.clutter_range_rates import ClutterRangeRates
from tsepm_ros.environment.clutter_strengths import ClutterStrengths
from tsepm_ros.environment.detection_probability import DetectionProbability
from tsepm_ros.environment.feature_association import Surroundings
from tsepm_ros.environment.measurement_errors import MeasurementErrors
from tsepm_ros.environment.persistent_clutter import PersistentClutter
from tsepm_ros.environment.scan_interval import ScanInterval
from tsepm_ros.environment.secondary_echoes import SecondaryEchoes
from tsepm_ros.environment.seen_extent import EVERYWHERE, Extent, SeenExtent
from tsepm_ros.sensing.sensor import SensorModel

ERRORS = "range_std", "range_std_fraction", "azimuth_std"
"""Fields of a sensor that innovations are compared with."""


@dataclass(frozen=True)
class Learned:
    """Models learned from the scans so far; they survive a change of method.

    Attributes
    ----------
    clutter_map : ClutterMap
    clumps : ClutterClumps
        How much lumpier clutter is than the map.
    seen_extent : SeenExtent
        Where clutter is seen, in the coverage.
    strengths : ClutterStrengths
        Strengths of clutter.
    persistent : PersistentClutter
        Where clutter stays in the fixed frame.
    all_extent : SeenExtent
        Where detections are, outside the coverage too, of scans that have such.
    secondary_echoes : SecondaryEchoes
        Clutter behind targets, and behind other clutter of a scan.
    scan_interval : ScanInterval
    clutter_range_rates : ClutterRangeRates
        Range rates of clutter.
    detection_probability : DetectionProbability
        Estimated from the held tracks.
    features : Surroundings
        Features of the plots.
    errors : MeasurementErrors
        Innovations of the held tracks' detections.
    """

    clutter_map: ClutterMap
    clumps: ClutterClumps
    seen_extent: SeenExtent
    strengths: ClutterStrengths
    persistent: PersistentClutter
    all_extent: SeenExtent = field(default_factory=lambda: SeenExtent(EVERYWHERE))
    secondary_echoes: SecondaryEchoes = field(default_factory=SecondaryEchoes)
    scan_interval: ScanInterval = field(default_factory=ScanInterval)
    clutter_range_rates: ClutterRangeRates = field(default_factory=ClutterRangeRates)
    detection_probability: DetectionProbability = field(default_factory=DetectionProbability)
    features: Surroundings = field(default_factory=Surroundings)
    errors: MeasurementErrors = field(default_factory=MeasurementErrors)

    @classmethod
    def initial(cls, sensor: SensorModel) -> Learned:
        """Models before the first scan of a sensor."""
        clutter_map = ClutterMap(sensor)
        shape, wraps = clutter_map.grid.shape, clutter_map.grid.wraps
        strengths = ClutterStrengths(shape, wraps)
        clumps = ClutterClumps(shape, wraps)
        seen = SeenExtent(Extent.of(sensor))
        return cls(clutter_map, clumps, seen, strengths, PersistentClutter(sensor))

    def anew(self, sensor: SensorModel) -> Learned:
        """Models before the first scan of a sensor, but with where clutter stays."""
        return replace(Learned.initial(sensor), persistent=self.persistent)

    def under(self, sensor: SensorModel, before: SensorModel) -> Learned:
        """The models for a sensor in place of the one before.

        The clutter map is kept only for the same coverage, innovations only for the same errors.
        """
        same_errors = all(getattr(sensor, name) == getattr(before, name) for name in ERRORS)
        kept = self if same_errors else replace(self, errors=MeasurementErrors())
        if self.clutter_map.fits(sensor):
            return kept
        fresh = Learned.initial(sensor)
        return replace(
            kept,
            clutter_map=fresh.clutter_map,
            clumps=fresh.clumps,
            seen_extent=fresh.seen_extent,
            strengths=fresh.strengths,
            secondary_echoes=SecondaryEchoes(),
        )
