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
"""Each model of the tracker is needed by a scene."""

import ablations
import pytest

FEW = {
    "where clutter is seen",
    "hull of where clutter is seen",
    "errors of the sensor",
    "a start may have a track",
    "lumps of clutter",
    "clutter behind clutter",
    "a start continues a track",
    "planned threshold",
}
"""Models whose scene needs more runs."""


@pytest.mark.long
@pytest.mark.parametrize("name", ablations.MODELS)
def test_a_scene_is_worse_without_the_model(name):
    found, without = ablations.measured(ablations.MODELS[name], 4 if name in FEW else 2, 1)
    assert found < without


def test_what_is_left_out_is_there_again_afterwards():
    model = ablations.MODELS["turns"]
    ((owner, name, value),) = model.without
    before = getattr(owner, name)
    with model.left_out():
        assert getattr(owner, name) == value != before
    assert getattr(owner, name) == before
