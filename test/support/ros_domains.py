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
"""Domains that no other test or campaign on this machine has at the same time."""

import fcntl
import itertools
import os
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

DOMAINS = 100
"""Domains 1 to 100 keep clear of the ports that the system hands out."""

_candidates = (1 + (os.getpid() + number) % DOMAINS for number in itertools.count())


@contextmanager
def own_domain() -> Iterator[int]:
    """A domain that nobody else has now, or this process had lately."""
    for number in itertools.islice(_candidates, DOMAINS):
        path = Path(tempfile.gettempdir()) / f"tsepm_ros_domain_{number}.lock"
        with ExitStack() as stack:
            try:
                lock = stack.enter_context(path.open("a"))
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:  # somebody else has it
                continue
            yield number
            return
    raise RuntimeError("every domain is in use")
