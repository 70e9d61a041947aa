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
"""Mutated sonar images in process: every type, every layout, whole and as single bearings.

In a third of the cases mutated images are only such as are refused when they are read; then the
good images must give the detections of the stream alone, to the bit. In another third one bearing
in twenty is odd, or the ranges of whole images alternate. Images without a geometry are of windows
of any size and distance, too. Each is drawn as a plan.
"""

from __future__ import annotations

import copy
import functools
import math
import resource
import sys
from collections import Counter
from typing import Any

import campaign
import numpy as np
from builtin_interfaces.msg import Duration
from campaign import Tried
from geometry_msgs.msg import Vector3
from invariants import check_reasons, require
from mutation import mutate
from sensor_msgs.msg import Image
from streams import header, stamp_of
from support import foreign_messages as foreign

from msg_adapters import MessageError
from msg_adapters.image_messages import plan_of, read_image
from msg_adapters.ping import ReadingOptions
from msg_adapters.point_cloud import detections_of_fields
from msg_adapters.sonar_images import ImageInput, detection_fields
from tsepm_ros.settings.node_options import ImageLayout, SonarDetectorNodeOptions
from tsepm_ros.settings.settings import SONAR_DETECTOR, make_groups
from tsepm_ros.tracker.sensor import Coverage

BEAMS, CELLS, START = 16, 40, 1000.0
AZIMUTH, RANGE = np.linspace(-0.6, 0.6, BEAMS), np.linspace(1.0, 40.0, CELLS)
PINGS, TURN, PER_PING = 12, 24, 12
"""Images of a stream, bearings of a turn, and most mutated images between two."""
TURNS, ODD = 12, 0.05
"""Turns of a stream with odd bearings, and their share."""
MAX_MEMORY = 1500.0
"""Resident memory of the process that is too much, MB."""
TYPES = ("projected", "raw", "mono8", "mono16", "32FC1", "fan", "column", "echo", "spokes")
WINDOWS = [(0.5, 39.5), (5e3, 5e3 + 0.3), (9e7, 9e7 + 0.3), (0.0, 1e8), (39.99, 40.0), (0.0, 2e-3)]
"""Ranges of the nearest and the farthest row of images without a geometry, m."""
OPTIONS = {
    "false_detections_per_ping": 3.0,
    "sensor.azimuth_min": -0.65,
    "sensor.azimuth_max": 0.65,
}


def stored(values: np.ndarray) -> foreign.SonarImageData:
    """8-bit numbers as they are stored."""
    return foreign.SonarImageData(
        beam_count=len(values), data=np.ascontiguousarray(values).tobytes()
    )


def time_of(kind: str, number: int) -> float:
    """Stamp of a message of a stream, s."""
    return START + (0.1 if kind in TYPES[6:] else 0.5) * number


def good(kind: str, number: int) -> Any:
    """The message of a stream at a place."""
    field = np.random.default_rng((7, number)).rayleigh(20.0, (BEAMS, CELLS)).astype(np.uint8)
    field[5, 10 + number % 20] = 250
    at = header(time_of(kind, number))
    turned = math.remainder(2.0 * math.pi * number / TURN, 2.0 * math.pi)
    if kind in ("projected", "column"):
        there = AZIMUTH if kind == "projected" else np.array([turned])
        return foreign.ProjectedSonarImage(
            header=at,
            ping_info=foreign.PingInfo(sound_speed=1500.0),
            beam_directions=[Vector3(x=0.0, y=-math.sin(a), z=math.cos(a)) for a in there],
            ranges=RANGE.tolist(),
            image=stored(field[: len(there)].T),
        )
    if kind == "raw":
        return foreign.RawSonarImage(
            header=at,
            ping_info=foreign.PingInfo(sound_speed=1500.0),
            sample_rate=750.0,
            samples_per_beam=CELLS,
            sample0=1,
            rx_angles=(-AZIMUTH).tolist(),
            tx_delays=[0.001] * BEAMS,
            image=stored(field),
        )
    if kind == "echo":
        return foreign.SonarEcho(
            header=at, angle=turned, range=40, speed_of_sound=1500, intensities=field[0].tobytes()
        )
    if kind == "spokes":
        return foreign.RadarSector(
            header=at,
            angle_start=turned,
            angle_increment=0.5 * math.pi / TURN,
            time_increment=Duration(nanosec=20_000_000),
            range_min=1.0,
            range_max=40.0,
            intensities=[foreign.RadarEcho(echoes=one.tolist()) for one in field[:4].astype(float)],
        )
    form = {"mono16": np.uint16, "32FC1": np.float32}.get(kind, np.uint8)
    rows = np.ascontiguousarray(field.T.astype(form))
    return Image(
        header=at,
        height=CELLS,
        width=BEAMS,
        step=BEAMS * rows.itemsize,
        encoding=kind if kind != "fan" else "mono8",
        data=rows.tobytes(),
    )


class Fed:
    """An input of images, what it gave and what it counted."""

    def __init__(self, options: dict[type[Any], Any]) -> None:
        self.dropped, self.found, self.said = Counter[str](), list[bytes](), Counter[str]()
        self.input = ImageInput(options, self._drop, lambda sentence: self.said.update([sentence]))
        self.options, self.sent = options, 0

    def _drop(self, reason: str, sentence: str) -> None:
        require(len(sentence) < 6000, f"a sentence of {len(sentence)} characters")
        self.dropped[reason] += 1

    def feed(self, message: Any) -> list[bytes]:
        """Give a message; what it completes is checked, and read as the tracker reads it."""
        before, turns = sum(self.dropped.values()), self.input.turns
        kept = turns.unused + len(turns._parts)
        new = []
        for ping, scan in self.input.take(message):
            fields = detection_fields(ping, scan)
            read = detections_of_fields(ping.stamp_ns, ping.frame_id, fields, ReadingOptions())
            check_reasons(Counter(read.dropped))
            require((scan.range_std > 0).all() and (scan.azimuth_std > 0).all(), "a std is not >0")
            if (stages := self.input.detector.stages) is not None:
                plan = plan_of(ping, stages)
                require(0.0 < plan.cell < np.inf, f"a plan has cells of {plan.cell} m")
                require(plan.levels.min() >= -1 and plan.levels.max() <= 100, "a level is none")
            new.append(b"".join(np.asarray(values).tobytes() for values in fields.values()))
        self.sent += 1
        drops = sum(self.dropped.values()) - before
        held = turns.unused + len(turns._parts) > kept
        require(new or drops or held, "an image is neither used, counted nor kept")
        self.found += new
        return new


def options_of(kind: str, window: tuple[float, float] = WINDOWS[0]) -> dict[type[Any], Any]:
    """Options of the node beside a driver."""
    layout = {"image.rows": "fan" if kind == "fan" else "auto"}
    names = "image.near_range", "image.far_range"
    ranges = dict(zip(names, window, strict=True)) | {"sensor.max_range": window[1]}
    return make_groups(SONAR_DETECTOR, OPTIONS | layout | ranges)


def length(kind: str) -> int:
    """Messages of a stream."""
    return PINGS if kind in TYPES[:6] else 4 * TURN


@functools.cache
def alone(kind: str) -> list[bytes]:
    """Detections of the good stream."""
    fed = Fed(options_of(kind))
    for number in range(length(kind)):
        fed.feed(good(kind, number))
    require(not fed.dropped and len(fed.found) >= 2, f"the stream {kind} is not used whole")
    return fed.found


def is_refused(message: Any, options: dict[type[Any], Any]) -> bool:
    """Whether an image is refused when it is read."""
    given: SonarDetectorNodeOptions = options[SonarDetectorNodeOptions]
    try:
        read_image(message, options[ImageLayout], options[Coverage], given.sound_speed)
    except MessageError:
        return True
    return False


def odd(kind: str, place: int, rng: np.random.Generator) -> list[Any]:
    """What comes in place of a bearing: another stamp, frame or angle, two, or nothing."""
    message, time = good(kind, place), time_of(kind, place)
    which = rng.integers(8)
    later = rng.choice([-1e3, -2.4, -0.3, -0.12, 0.12, 0.3, 2.4, 1e5])
    if which == 0:
        message.header.stamp = stamp_of(time + later)
    elif which == 1:
        message.header.stamp = stamp_of(0.0)
    elif which == 2:
        message.header.frame_id = "another"
    elif which == 3:
        message.header = good(kind, place + int(rng.integers(2, TURN))).header
    elif which == 4:
        at, message = message.header, good(kind, place + int(rng.integers(2, TURN)))
        message.header = at
    elif which == 5:
        return [message, message]
    elif which == 6:
        return [good(kind, place + 1), message]
    else:
        return []
    return [message]


def case_of_odd(kind: str, rng: np.random.Generator) -> Tried:
    """Odd bearings, which cost at most a fifth of the images; or ranges that alternate."""
    options, tried, is_whole = options_of(kind), Counter[str](), length(kind) == PINGS
    fed, clean = Fed(options), Fed(options)
    for place in range(PINGS if is_whole else TURNS * TURN):
        message = good(kind, place)
        messages = [message]
        if is_whole and rng.random() < 0.5 and hasattr(message, "height"):
            message.height, message.data = CELLS // 2, bytes(message.data)[: len(message.data) // 2]
        elif not is_whole and rng.random() < ODD:
            messages = odd(kind, place, rng)
            tried["odd bearings"] += 1
        clean.feed(good(kind, place))
        for one in messages:
            fed.feed(copy.copy(one))
            tried["messages"] += 1
    check_reasons(fed.dropped)
    require(len(fed.found) >= 0.8 * len(clean.found), f"{len(fed.found)} of {len(clean.found)}")
    require(len(fed.said) <= 3, f"sentences: {[*fed.said]}")
    tried["images beside odd ones"] += len(fed.found)
    return tried


def case(number: int, rng: np.random.Generator) -> Tried:
    """A stream with mutated images between its own."""
    kind = TYPES[number % len(TYPES)]
    refused_only = number // len(TYPES) % 3 == 0
    if number // len(TYPES) % 3 == 2:
        return case_of_odd(kind, rng)
    window = WINDOWS[0] if refused_only else WINDOWS[rng.integers(len(WINDOWS))]
    options = options_of(kind, window)
    fed, tried = Fed(options), Counter[str]()
    most = PER_PING if length(kind) == PINGS else 2
    for place in range(length(kind)):
        message = None
        for _ in range(int(rng.integers(most + 1))):
            if message is None or rng.random() < 0.5:
                message = good(kind, place)
                early = float(rng.choice([0.0, 0.01, 0.05]))
                message.header.stamp = stamp_of(time_of(kind, place) - early)
            mutate(message, rng)
            if refused_only and not is_refused(message, options):
                continue
            fed.feed(copy.copy(message))
            tried[f"mutated {kind}"] += 1
            tried["messages"] += 1
        fed.feed(good(kind, place))
    check_reasons(fed.dropped)
    if refused_only:
        require(fed.found == alone(kind), "the detections are not those of the stream alone")
        tried["good images after refused ones"] += length(kind)
    tried["drops"] += sum(fed.dropped.values())
    tried["images with detections"] += len(fed.found)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    require(memory < MAX_MEMORY, f"{memory:.0f} MB of memory")
    return tried


if __name__ == "__main__":
    sys.exit(campaign.main("images", __doc__, case))
