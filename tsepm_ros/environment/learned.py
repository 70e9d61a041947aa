"""Models of the surroundings, independent of the method."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from tsepm_ros.environment.clutter_map import ClutterMap
from tsepm_ros.environment.clutter_range_rates import ClutterRangeRates
from tsepm_ros.environment.detection_probability import DetectionProbability
from tsepm_ros.environment.feature_association import Surroundings
from tsepm_ros.sensing.sensor import SensorModel


@dataclass(frozen=True)
class Learned:
    """Models learned from the scans so far; they survive a change of method.

    Attributes
    ----------
    clutter_map : ClutterMap
    clutter_range_rates : ClutterRangeRates
        Range rates of clutter.
    detection_probability : DetectionProbability
        Estimated from the held tracks.
    features : Surroundings
        Features of the plots.
    """

    clutter_map: ClutterMap
    clutter_range_rates: ClutterRangeRates = field(default_factory=ClutterRangeRates)
    detection_probability: DetectionProbability = field(default_factory=DetectionProbability)
    features: Surroundings = field(default_factory=Surroundings)

    @classmethod
    def initial(cls, sensor: SensorModel) -> Learned:
        """Models before the first scan of a sensor."""
        return cls(ClutterMap(sensor))

    def under(self, sensor: SensorModel) -> Learned:
        """The models for a sensor; the clutter map is kept only for the same coverage."""
        if self.clutter_map.fits(sensor):
            return self
        return replace(self, clutter_map=ClutterMap(sensor))
