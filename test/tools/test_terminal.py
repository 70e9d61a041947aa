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
"""Progress is shown on a terminal and nowhere else."""

import fcntl
import os
import pty
import struct
import subprocess
import sys
import termios

from tsepm_ros.tools import terminal
from tsepm_ros.tools.terminal import terminal_progress, terminal_progress_bar, write_terminal_line

SHOW = (
    "from tsepm_ros.tools.terminal import terminal_progress\n"
    "print(*terminal_progress(range(3), 3, 'work'))"
)


def test_a_terminal_shows_the_work_and_a_pipe_does_not():
    main, terminal = pty.openpty()
    fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack("4H", 24, 80, 0, 0))
    done = subprocess.run(
        [sys.executable, "-c", SHOW], stdout=subprocess.PIPE, stderr=terminal, check=True
    )
    assert done.stdout == b"0 1 2\n"
    assert b"work" in os.read(main, 4096)
    os.close(terminal)
    os.close(main)
    piped = subprocess.run([sys.executable, "-c", SHOW], capture_output=True, check=True)
    assert piped.stderr == b""


def test_without_the_library_of_the_bars_the_work_is_done_without_them(monkeypatch, capsys):
    monkeypatch.setattr(terminal, "tqdm", None)
    assert list(terminal_progress(iter("abc"), 3, "work")) == ["a", "b", "c"]
    with terminal_progress_bar(3, "pings", "ping", keep=True) as bar:
        bar.set_postfix_str("confirmed tracks: 1", refresh=False)
        bar.update(3 - bar.n)
    write_terminal_line("a line", sys.stdout)
    assert capsys.readouterr() == ("a line\n", "")
