"""What has been learned of the surroundings, whatever the method."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from tsepm_ros.environment.clutter_map import ClutterMap
from tsepm_ros.environment.clutter_range_rates import ClutterRangeRates
from tsepm_ros.environment.detection_probability import DetectionProbability
from tsepm_ros.environment.feature_association import Surroundings
from tsepm_ros.sensing.sensor import SensorModel


@dataclass(frozen=True)
class Learned:
    """What the scans so far taught; it survives a change of method.

    Attributes
    ----------
    clutter_map : ClutterMap
    clutter_range_rates : ClutterRangeRates
        Range rates of clutter.
    detection_probability : DetectionProbability
        As the held tracks are detected.
    features : Surroundings
        Features of the plots.
    """

    clutter_map: ClutterMap
    clutter_range_rates: ClutterRangeRates = field(default_factory=ClutterRangeRates)
    detection_probability: DetectionProbability = field(default_factory=DetectionProbability)
    features: Surroundings = field(default_factory=Surroundings)

    @classmethod
    def nothing(cls, sensor: SensorModel) -> Learned:
        """Before the first scan of a sensor."""
        return cls(ClutterMap(sensor))

    def under(self, sensor: SensorModel) -> Learned:
        """What remains of it for a sensor: its clutter map only in the same coverage."""
        if self.clutter_map.fits(sensor):
            return self
        return replace(self, clutter_map=ClutterMap(sensor))
