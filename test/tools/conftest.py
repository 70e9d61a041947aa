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
"""What tests of several tools share."""

import re
from pathlib import Path

import numpy as np
import pytest
from support.image_folder import GEOMETRY

from tsepm_ros.tools.design import prediction
from tsepm_ros.tools.evaluation import result_files


@pytest.fixture
def little_clutter(monkeypatch):
    """A bound on the work: rates of false tracks are told less exactly."""
    monkeypatch.setattr(prediction, "MAX_CLUTTER_DETECTIONS", 1_000.0)


@pytest.fixture
def tests_installed(monkeypatch):
    """Modules of tests, of which a worker has hundreds, are not looked at as a user's own code."""
    tests = re.escape(str(Path(__file__).parents[2]))
    installed = re.compile(f"{result_files.INSTALLED.pattern}|{tests}")
    monkeypatch.setattr(result_files, "INSTALLED", installed)


@pytest.fixture
def folder(tmp_path):
    """Twelve images of noise with an echo that moves, as one array."""
    rng = np.random.default_rng(1)
    images = np.abs(rng.standard_normal((12, 64, 200)) + 1j * rng.standard_normal((12, 64, 200)))
    for k, image in enumerate(images):
        image[30:32, 100 + 2 * k : 103 + 2 * k] = 20.0
    np.savez(tmp_path / "images.npz", np.uint8(10 * images))
    (tmp_path / "geometry.yaml").write_text(GEOMETRY)
    (tmp_path / "times.csv").write_text("time_s\n" + "".join(f"{k}\n" for k in range(12)))
    return tmp_path
