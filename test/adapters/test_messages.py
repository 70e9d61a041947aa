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
"""Classes of messages: each is imported from its package when it is used."""

import importlib

import numpy as np
import pytest
from support import foreign_messages
from support.driver_messages import MAKERS

from msg_adapters import (
    MessageError,
    make_header,
    message_class,
    messages,
    write_detections,
)
from tsepm_ros import Scan

HEADER = make_header(1_700_000_000 * 10**9, "sonar")
NOTHING = Scan(1.7e9, np.zeros(0), np.zeros(0))


@pytest.mark.parametrize("name", ["Time", "Point", "Odometry", "PointCloud2", "MarkerArray"])
def test_a_class_is_that_of_its_package(name):
    package = importlib.import_module(f"{messages.PACKAGES[name]}.msg")
    assert getattr(messages, name) is getattr(package, name)


def test_a_name_that_is_no_message_is_no_attribute():
    with pytest.raises(AttributeError, match="there is no class 'PointCloud3'"):
        getattr(messages, "PointCloud" + "3")


@pytest.mark.parametrize("type_name", [name for name in MAKERS if "sensor_msgs" not in name])
def test_a_package_that_is_not_installed_is_named(type_name, monkeypatch):
    foreign_messages.remove(monkeypatch)
    package = type_name.partition("/")[0]
    with pytest.raises(MessageError, match=f"needs the package '{package}'") as error:
        message_class(type_name)
    assert error.value.reason == "package_not_installed"
    with pytest.raises(MessageError, match=package):
        write_detections(type_name, HEADER, NOTHING, sound_speed=1500.0)
