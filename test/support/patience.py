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
"""Time limits of tests that hang: ten times what a quiet machine takes."""

PATIENCE = 10.0


def patient(seconds: float) -> float:
    """Time limit for an action of a duration on a quiet machine, s."""
    return PATIENCE * seconds


WAIT = patient(3.0)
"""For a node or a process to start, to answer or to end, s."""

TEST = patient(15.0)
"""For a test, s."""

LONG_TEST = patient(60.0)
"""For a test that is marked `long`, s."""
