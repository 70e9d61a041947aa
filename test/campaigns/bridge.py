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
"""Mutated tracks, odometry and fixes in `track_bridge`, in process.

What it sends is read by other readers: pynmea2, and JSON with the pattern of Signal K's schema.
"""

from __future__ import annotations

import copy
import json
import math
import re
import resource
import sys
from collections import Counter
from contextlib import suppress
from typing import Any

import campaign
import numpy as np
import pynmea2
from campaign import Tried
from invariants import require
from mutation import mutate
from rclpy.serialization import serialize_message
from sensor_msgs.msg import NavSatFix
from support.ros_domains import own_domain
from support.ros_world import World

from msg_adapters import make_header, odometry_message, track_cloud
from tsepm_ros import ConfirmedTrack
from tsepm_ros.own_ship.pose_history import PoseSample
from tsepm_ros.tools.bridge.track_bridge import TrackBridge

START_NS = 1_700_000_000 * 10**9
PER_CASE = 40
MAX_MEMORY = 1500.0
"""Resident memory of the process that is too much, MB."""
VESSEL = re.compile(
    r"vessels\.urn:mrn:signalk:uuid:[0-9a-f]{8}-[0-9a-f]{4}-4[0-9a-f]{3}-[89ab][0-9a-f]{3}-[0-9a-f]{12}"
)


class Receiver:
    """Stands in for the socket, and reads what is sent."""

    def __init__(self) -> None:
        self.tried: Tried = Counter()

    def sendto(self, data: bytes, _: Any) -> None:
        """Take a sentence or a delta."""
        text = data.decode("ascii")
        if text.startswith("{"):
            self._delta(json.loads(text, parse_constant=self._refuse))
        else:
            self._sentence(text)

    def close(self) -> None:
        """Take nothing more."""

    def _refuse(self, text: str) -> None:
        require(False, f"{text} in a delta")

    def _sentence(self, text: str) -> None:
        require(len(text) <= 82, f"{len(text)} characters: {text}")
        require(text.endswith("\r\n"), f"no end of line: {text}")
        require(not re.search("nan|inf", text, re.IGNORECASE), f"no number: {text}")
        one = pynmea2.parse(text.strip(), check=True)
        if one.sentence_type == "TLL":
            require(abs(one.latitude) <= 90.0 and abs(one.longitude) <= 180.0, f"no place: {text}")
            require(one.data[1] and one.data[3], f"an empty place: {text}")
        else:
            require(float(one.data[1]) > 0.0, f"at 0 miles: {text}")
        self.tried[one.sentence_type] += 1

    def _delta(self, delta: Any) -> None:
        require(bool(VESSEL.fullmatch(delta["context"])), f"no context: {delta}")
        (update,) = delta["updates"]
        values = {one["path"]: one["value"] for one in update["values"]}
        place = values["navigation.position"]
        if place is not None:
            near = abs(place["latitude"]) <= 90.0 and abs(place["longitude"]) <= 180.0
            require(near, f"no place: {delta}")
        self.tried["deltas" if place else "ends of deltas"] += 1


def tracks(rng: np.random.Generator, number: int) -> Any:
    """A cloud of up to twenty tracks."""
    held = [
        ConfirmedTrack(
            int(rng.integers(30)) + 100 * row,
            0.0,
            np.array([*rng.normal(0.0, 2000.0, 1), 1.0, *rng.normal(0.0, 2000.0, 1), -1.0]),
            np.diag([9.0, 0.1, 9.0, 0.1]),
            (),
            math.nan,
        )
        for row in range(int(rng.integers(20)))
    ]
    cloud = track_cloud(make_header(START_NS + number * 10**9, "odom"), held)
    return copy.deepcopy(cloud)  # clouds share their fields


def odometry(number: int) -> Any:
    """Own ship on its way."""
    stamp = START_NS * 1e-9 + number
    sample = PoseSample(stamp, 3.0 * number, 0.0, 0.3, rates=(3.0, 0.0, 0.0), frame_id="odom")
    return odometry_message(sample)


def fix(number: int) -> Any:
    """A position of own ship."""
    made = NavSatFix(latitude=-33.9, longitude=179.99 + 3e-5 * number, altitude=math.nan)
    made.header = make_header(START_NS + number * 10**9, "gps")
    made.status.status = 0
    made.position_covariance = [4.0, 0.0, 0.0, 0.0, 4.0, 0.0, 0.0, 0.0, 9.0]
    made.position_covariance_type = 2
    return made


def case(number: int, rng: np.random.Generator) -> Tried:
    """A bridge that gets good and mutated messages."""
    source = ("odometry", "none")[number % 2]
    options = {
        "nmea_sentences": "both",
        "nmea_period": 0.0,
        "signal_k_address": "127.0.0.1:9",
        "own_ship_source": source,
        "origin": ("", "", "10.0,-180.0", "-88.9,0.0")[int(rng.integers(4))],
    }
    receiver, tried = Receiver(), Counter[str]()
    with own_domain() as domain, World(domain) as world:
        node = world.make(TrackBridge, options)
        node._socket.close()
        node._socket = receiver
        for turn in range(PER_CASE):
            made = {"tracks": tracks(rng, turn), "own_ship": odometry(turn), "fix": fix(turn)}
            what = str(rng.choice(list(made)))
            for _ in range(int(rng.integers(1, 4))):
                mutate(made[what], rng)
            with suppress(SystemError):  # what cannot be sent, the bridge does not get
                node._keep(serialize_message(made["own_ship"]))
            node._take_fix(made["fix"])
            node._take(made["tracks"])
            tried[f"mutated {what}"] += 1
        for turn in range(PER_CASE, PER_CASE + 6):  # the good fixes are believed again
            node._keep(serialize_message(odometry(turn)))
            node._take_fix(fix(turn))
        before = receiver.tried.copy()
        held = [ConfirmedTrack(7, 0.0, np.array([50.0, 1.0, 60.0, 0.0]), np.eye(4), (), 0.0)]
        node._take(track_cloud(make_header(START_NS + 60 * 10**9, "odom"), held))
        require(receiver.tried["TLL"] > before["TLL"], f"no TLL of a good track: {node.dropped}")
        tried["drops"] = sum(node.dropped.values())
        world.end(node)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    require(memory < MAX_MEMORY, f"{memory:.0f} MB of memory")
    return tried + receiver.tried


if __name__ == "__main__":
    sys.exit(campaign.main("bridge", __doc__, case))
