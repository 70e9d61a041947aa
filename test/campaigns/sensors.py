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
"""Several sensors in one picture: mutated sets of parameters, and mutated messages in process.

Every set is refused with a sentence that names a parameter, or a picture is made with it. Messages
of three sensors come at random latencies, some mutated, some on the topic of another sensor, with
clocks that go back, alone or together, and sensors that fall silent.
"""

import copy
import math
import sys
from collections import Counter
from typing import Any

import campaign
import numpy as np
from campaign import Tried
from invariants import TrackBook, check_reasons, lost_scans, require
from mutation import mutate
from parameters import rows, values_of
from support.vessel import PARAMETERS, SENSORS, Vessel

from msg_adapters.message_input import MessageInput
from tsepm_ros.parameters import Value
from tsepm_ros.session.session import Session
from tsepm_ros.session.shared_picture import SharedPicture, share_picture
from tsepm_ros.settings.node_options import InitiatorNodeOptions
from tsepm_ros.settings.settings import (
    OF_SENSOR,
    TRACK_INITIATOR,
    make_groups,
    options_by_sensor,
    settings_from,
)

NAMES = ("port", "starboard", "radar", "Port", "a", "x" * 64, "sonar_2", "abc")
BAD_NAMES = ("", "sensor", "tracks", "2nd", "a/b", "a.b", "x" * 65, "\u00e4", "port ", "_a", "\n")
DURATION = 4.0
"""Of a stream, s."""


def case(number: int, rng: np.random.Generator) -> Tried:
    """A set of parameters, and with every second one that is accepted a stream of messages."""
    given = {**PARAMETERS, **mutated_parameters(rng)} if number % 4 else dict(PARAMETERS)
    try:
        options = options_by_sensor(make_groups(TRACK_INITIATOR, given))
        sessions = {name: Session(settings_from(one)) for name, one in options.items()}
        share_picture(sessions)
    except ValueError as error:
        said = str(error)
        own = {name.rpartition(".")[2] for name in given}
        named = any(name and name in said for name in own) or "method" in said
        require(named, f"{given}: the refusal names no parameter: {said}")
        require("\n" not in said and len(said) < 700, f"{given}: {said}")
        return Counter({"sets": 1, "refused": 1})
    if number % 2:
        return Counter({"sets": 1, "accepted": 1})
    return Counter({"sets": 1, "accepted": 1}) + streamed(sessions, options, rng)


def mutated_parameters(rng: np.random.Generator) -> dict[str, Any]:
    """Some parameters with other values, names of sensors in front, and other names."""
    changed: dict[str, Any] = {}
    listed = list(rows().values())
    for _ in range(int(rng.integers(1, 4))):
        row = listed[rng.integers(len(listed))]
        values: list[Value] = values_of(row) if row.type is not tuple else [("port",), (), "port"]
        front = str(rng.choice(["", *SENSORS, "other"], p=[0.3, 0.2, 0.2, 0.2, 0.1]))
        if front and rng.random() < 0.7:  # else also those of the picture
            of_sensor = [one for one in listed if one.name.startswith(OF_SENSOR)]
            row = of_sensor[rng.integers(len(of_sensor))]
            values = values_of(row)
        value = values[rng.integers(len(values))]
        if rng.random() < 0.6:
            value = row.default
        changed[f"{front}.{row.name}" if front else row.name] = value
    if rng.random() < 0.3:
        names = rng.choice(NAMES, rng.integers(0, 5)).tolist()
        if rng.random() < 0.5:
            names.append(str(rng.choice(BAD_NAMES)))
        changed["sensors"] = names
    return changed


class FedPicture:
    """A picture that is fed with messages, and the counts of what comes of them."""

    def __init__(self, sessions: dict[str, Session], options: Any) -> None:
        self.sessions = sessions
        self.picture: SharedPicture = next(iter(sessions.values())).picture
        self.inputs = {
            name: MessageInput(sessions[name], one[InitiatorNodeOptions])
            for name, one in options.items()
        }
        common = next(iter(sessions.values())).settings.common
        self.book = TrackBook(common.max_speed, math.inf)
        self.sent, self.results = Counter[str](), Counter[str]()

    def take(self, now: Any, **more: Any) -> None:
        stamp = -math.inf
        for result in self.picture.process(now, **more):
            self.book.check(result)
            self.results[result.scan.sensor] += 1
            restarted = result.arrival.name == "RESTART"
            require(result.stamp >= stamp or restarted, "scans are not in the order of stamps")
            stamp = result.stamp
            bits = self.picture.tracker.seen_by(result.current)
            require((bits < 2 ** len(self.sessions)).all(), "a bit of no sensor")

    def check(self) -> None:
        for name, session in self.sessions.items():
            check_reasons(session.dropped)
            if session.settings.session.sweep == "off":
                waits = session.figures().waiting
                counted = self.results[name] + lost_scans(session.dropped) + waits
                said = f"{self.results[name]} results, {waits} wait; {dict(session.dropped)}"
                require(counted == self.sent[name], f"{name}: {self.sent[name]} messages: {said}")


def streamed(sessions: dict[str, Session], options: Any, rng: np.random.Generator) -> Tried:
    """A stream of three sensors, as the vessel sends it and worse."""
    fed, tried = FedPicture(sessions, options), Counter[str]()
    names = [*sessions]
    vessel = Vessel(
        late={name: float(rng.choice([0.0, 0.05, 0.5, 2.0])) for name in SENSORS},
        silent={str(rng.choice(SENSORS)): (2.0, float(rng.choice([3.0, 99.0])))},
        back=float(rng.choice([0.0, 0.0, 3.0, 500.0])),
        seed=int(rng.integers(2**31)),
    )
    share = float(rng.choice([0.0, 0.1, 0.5]))
    alone = str(rng.choice(["", *SENSORS], p=[0.7, 0.1, 0.1, 0.1]))
    for now, name, message in vessel.messages(DURATION):
        to = name
        if name and name == alone and now > 3.0:
            message.header.stamp.sec -= 100
        if rng.random() < share:
            message = copy.deepcopy(message)
            if name and rng.random() < 0.2:
                to = str(rng.choice(names))
            else:
                mutate(message, rng)
            tried["mutated"] += 1
        clocks = (now, math.nan if rng.random() < 0.02 else now)
        if not to:
            next(iter(fed.inputs.values())).take_own_ship(message)
        elif to in sessions:
            fed.sent[to] += 1
            fed.inputs[to].take_detections(message, clocks)
        tried["messages"] += 1
        fed.take(clocks)
    for name in names:
        fed.picture.figures_of(name, (DURATION, DURATION))
    fed.picture.figures()
    fed.take((99.0, 99.0))
    fed.take(math.inf, last=True)
    fed.check()
    tried["results"] += fed.results.total()
    tried["drops"] += sum(sum(one.dropped.values()) for one in sessions.values())
    return tried


if __name__ == "__main__":
    sys.exit(campaign.main("sensors", __doc__, case))
