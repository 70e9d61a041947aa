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
"""A stand-in for tf2_ros: frames that move as they are told."""

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
from scipy.spatial.transform import Rotation

from msg_adapters import make_header
from support.sonar_driver import START_NS

Pose = tuple[tuple[float, float], list[float]]
"""x and y, m, and a quaternion (x, y, z, w)."""


@dataclass
class Transforms:
    """A stand-in for tf2_ros.Buffer: what tf knows, by s after the start, and what it was asked."""

    pose: Callable[[float], Pose]
    first: float = -math.inf
    last: float = math.inf
    frames: tuple[str, str] | None = None
    asked: list[float] = field(default_factory=list)

    def _seconds(self, time: Any) -> float:
        return (time.nanoseconds - START_NS) * 1e-9 if time.nanoseconds else self.last

    def can_transform(self, target: str, source: str, time: Any, *_: Any) -> bool:
        seconds = self._seconds(time)  # of time 0 the newest
        return self.frames in (None, (target, source)) and self.first <= seconds <= self.last

    def lookup_transform(self, target: str, source: str, time: Any, *_: Any) -> Any:
        assert self.can_transform(target, source, time), "tf2 would raise an exception"
        self.asked.append(self._seconds(time))
        (x, y), turn = self.pose(self.asked[-1])
        rotation = SimpleNamespace(**dict(zip("xyzw", turn, strict=True)))
        transform = SimpleNamespace(
            translation=SimpleNamespace(x=x, y=y, z=-4.0), rotation=rotation
        )
        header = make_header(START_NS + round(self.asked[-1] * 1e9), target)
        return SimpleNamespace(header=header, transform=transform)

    def install(self, monkeypatch: pytest.MonkeyPatch) -> None:
        """Put it in the place of tf2_ros for a test."""
        module = ModuleType("tf2_ros")
        module.Buffer = lambda **_: self  # type: ignore[attr-defined]
        module.TransformListener = lambda *_: None  # type: ignore[attr-defined]
        monkeypatch.setitem(sys.modules, "tf2_ros", module)


def level(x: float, y: float, yaw: float) -> Pose:
    return (x, y), Rotation.from_euler("z", yaw).as_quat().tolist()
