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
"""The parameter files of several sensors, read as the nodes read them."""

from pathlib import Path

import pytest

from tsepm_ros.own_ship.registration import Mounting
from tsepm_ros.settings.node_options import InitiatorNodeOptions
from tsepm_ros.settings.settings import (
    SONAR_DETECTOR,
    TRACK_INITIATOR,
    make_groups,
    options_by_sensor,
)
from tsepm_ros.tools.commands.given_parameters import given_parameters_for
from tsepm_ros.tracker.sensor import SensorModel

EXAMPLES = Path(__file__).parents[2] / "examples"

pytestmark = pytest.mark.skipif(not EXAMPLES.exists(), reason="only in the source tree")


def by_sensor(file: str):
    values = given_parameters_for(EXAMPLES / file, "/boat/track_initiator")
    return options_by_sensor(make_groups(TRACK_INITIATOR, values))


def test_two_sonars_share_what_has_no_name_and_their_detectors_have_the_same_mounting():
    sensors = by_sensor("two_sonars.yaml")
    port, starboard = (sensors[name] for name in ("port", "starboard"))
    assert port[SensorModel] == starboard[SensorModel]
    assert port[SensorModel].max_range == 40.0
    for name, options in sensors.items():
        node = f"/boat/{name}/sonar_detector"
        detector = given_parameters_for(EXAMPLES / "two_sonars.yaml", node)
        assert make_groups(SONAR_DETECTOR, detector)[Mounting] == options[Mounting]
        assert detector["tracker_sensor"] == name
    assert port[Mounting].yaw == -starboard[Mounting].yaw > 0.0, "it looks to port"


def test_a_radar_beside_a_sonar_has_its_own_model_time_and_north():
    sensors = by_sensor("radar_and_sonar.yaml")
    radar, sonar = (sensors[name] for name in ("radar", "sonar"))
    assert radar[SensorModel].all_round and not sonar[SensorModel].all_round
    reference = radar[InitiatorNodeOptions].bearing_reference
    assert (reference, sonar[InitiatorNodeOptions].bearing_reference) == ("north", "bow")
    assert radar[InitiatorNodeOptions].sound_speed == 0.0
    assert sonar[Mounting].x == 6.0
