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
"""Learned numbers that were replaced harm no target, in whole scenes."""

from collections import Counter

import numpy as np
from support import learned_texts


def test_replaced_numbers_are_refused_or_targets_confirm_as_without_the_text():
    cases, tried = range(24), Counter()
    for number in cases:
        tried += learned_texts.check_replaced(number, np.random.default_rng((1, number)))
    used = tried["learned values, used"]
    assert 0.05 < used / len(cases) < 0.5, "both outcomes are tried"
