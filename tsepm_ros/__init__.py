"""Track initiation for active sonar: detections in, confirmed tracks out.

Importing this package never imports ROS; the nodes are in `tsepm_ros.nodes`.
"""

from tsepm_ros.environment.land import LandMask
from tsepm_ros.kinematics.track import ConfirmedTrack
from tsepm_ros.methods.registry import available_methods, make_initiator
from tsepm_ros.sensing.scan import Scan
from tsepm_ros.sensing.sensor import SensorModel

__version__ = "0.2.0"

__all__ = [
    "ConfirmedTrack",
    "LandMask",
    "Scan",
    "SensorModel",
    "available_methods",
    "make_initiator",
]


def __dir__() -> list[str]:
    return __all__
