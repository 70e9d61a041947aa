# Copyright 2026 tsepm_ros developers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.
"""Track initiation for active sonar: detections in, confirmed tracks out.

Importing this package never imports ROS; the nodes are in `tsepm_ros.nodes`. The public names are
imported when they are first used, so that an executable can be interrupted from its first moment.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tsepm_ros.detector.detector import make_detector
    from tsepm_ros.detector.image import SonarImage
    from tsepm_ros.methods.registry import available_methods, make_initiator
    from tsepm_ros.tracker.clutter.fixed_places import LandMask
    from tsepm_ros.tracker.scan import Scan
    from tsepm_ros.tracker.sensor import SensorModel
    from tsepm_ros.tracker.tracks import ConfirmedTrack

__version__ = "0.5.0"

_PLACES = {
    "ConfirmedTrack": "tracker.tracks",
    "LandMask": "tracker.clutter.fixed_places",
    "Scan": "tracker.scan",
    "SensorModel": "tracker.sensor",
    "SonarImage": "detector.image",
    "available_methods": "methods.registry",
    "make_detector": "detector.detector",
    "make_initiator": "methods.registry",
}

__all__ = [
    "ConfirmedTrack",
    "LandMask",
    "Scan",
    "SensorModel",
    "SonarImage",
    "available_methods",
    "make_detector",
    "make_initiator",
]


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_PLACES[name]}"), name)


def __dir__() -> list[str]:
    return __all__
